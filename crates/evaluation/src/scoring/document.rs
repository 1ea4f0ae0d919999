//! Scores of a rollout document, as JSON.

use reactsim_formats::document::{Document, DocumentLog, DocumentScenario};
use reactsim_geometry::Vec2;
use reactsim_metrics::{
    Case, DirTracking, Displacement, KinematicLikelihood, LoggedTrack, Object, OptionError, Options, Score,
    Scores, score_case,
};
use reactsim_scene::{AgentKind, DT, LoggedAgent, MapIndex, Road};
use serde_json::{Map, Value, json};

use crate::motion::rollout_checks::Findings;
use crate::motion::{CheckedMotion, CheckedScene, Subject};
use crate::statistics::mean;

/// Count metrics: name in the result, metric id.
const COUNTS: [(&str, &str); 3] = [
    ("a_av_collision_count", "aav-collision"),
    ("a_av_overlap_count", "aav-overlap"),
    ("a_av_risky_count", "aav-ttc"),
];
/// Rate metrics: name in the result, metric id, and name among the fractions.
const RATES: [(&str, &str, &str); 6] = [
    ("a_a_collision_rate", "aa-collision", "a_a_collision"),
    ("offroad_rate", "offroad", "offroad"),
    ("direction_rate", "direction", "direction"),
    ("accel_rate", "acceleration", "accel"),
    ("steer_rate", "curvature", "steer"),
    ("steer_velocity_rate", "curvature-velocity", "steer_velocity"),
];
/// Number of features of the kinematic likelihood.
const FEATURES: usize = 4;
/// Shares of scenarios in which a count is at least 1 (reactive pressure): name in the result, metric id.
const SHARES: [(&str, &str); 3] = [
    ("share_at_fault_collision", "aav-collision"),
    ("share_any_overlap", "aav-overlap"),
    ("share_risky", "aav-ttc"),
];

/// Scores every scenario of a document and aggregates: counts over all scenarios, rates over those where they
/// are defined.
///
/// For documents `dir_tracking` is `route` unless the document sets another value.
///
/// # Errors
/// [`OptionError`] names an unknown option, or an option with an unknown value.
pub fn score_document(document: &Document) -> Result<Value, OptionError> {
    let mut options = Options { dir_tracking: DirTracking::Route, ..Options::default() };
    for (name, value) in &document.options {
        options.set(name, value)?;
    }
    let mut all = Vec::with_capacity(document.scenarios.len());
    let mut scenarios = Vec::with_capacity(document.scenarios.len());
    for scenario in &document.scenarios {
        let index = MapIndex::new(&scenario.map);
        let case = case_of(scenario, &index, options);
        let scores = score_case(&case);
        scenarios.push(scenario_json(scenario, &case, &scores));
        all.push(scores);
    }
    let (aggregate, valid) = aggregate(&all);
    let named: Map<String, Value> =
        options.named().into_iter().map(|(name, value)| (name.to_owned(), Value::from(value))).collect();
    Ok(json!({
        "aggregate": aggregate,
        "valid_scenarios": valid,
        "scenarios": scenarios,
        "options": named,
    }))
}

/// Checks the motion of every scenario of a document as `score` and runs do.
pub fn check_document(document: &Document) -> Findings {
    let mut findings = Findings::default();
    for scenario in &document.scenarios {
        let agents = scenario.agents.iter().filter_map(|logged| given_motion(logged, scenario.current));
        let agents: Vec<_> = agents.filter(|agent| agent.kind != AgentKind::Other).collect();
        let Some(av) = scenario.agents.get(scenario.av) else { continue };
        let Some(av) = av.track.get(scenario.current).copied().flatten() else { continue };
        let motion = CheckedScene {
            agents,
            entered: Vec::new(),
            replayed: Vec::new(),
            origin: Vec2::zeros(),
            av,
            subject: Subject::Agents,
        };
        for finding in motion.findings() {
            findings.add(finding.check, || format!("scenario `{}`: {}", scenario.id, finding.text));
        }
    }
    findings
}

/// Returns the motion of an agent after the current frame; `None` if it is absent then.
fn given_motion(logged: &LoggedAgent, current: usize) -> Option<CheckedMotion<'_>> {
    let (history, future) = logged.track.split_at_checked(current + 1)?;
    let now = history.last().copied().flatten()?;
    let before = history.iter().rev().nth(1).copied().flatten();
    let difference = || before.map(|b| (now.position() - b.position()) / DT);
    Some(CheckedMotion {
        id: &logged.agent.id,
        kind: logged.agent.kind,
        length: logged.agent.length,
        now,
        velocity: now.velocity().or_else(difference),
        history,
        entry0: None,
        future,
    })
}

fn case_of<'a>(scenario: &'a DocumentScenario, index: &'a MapIndex, options: Options) -> Case<'a> {
    let objects =
        scenario.agents.iter().map(|a| Object { agent: &a.agent, track: (&a.track).into() }).collect();
    let frames = scenario.current + 1 + scenario.future;
    let road = Road::new(&scenario.map, index);
    let mut case = Case::with_current(road, objects, scenario.av, scenario.current, frames, options);
    if let Some(log) = &scenario.log {
        let split = |l: &'a DocumentLog| {
            let (history, future) = l.track.split_at(scenario.current + 1);
            LoggedTrack { history, future, recorded_history: Some(&l.recorded_history) }
        };
        case = case.with_log(log.iter().map(split).collect());
    }
    let rollouts = scenario.rollouts.iter();
    case.with_rollouts(rollouts.map(|r| r.iter().map(Vec::as_slice).collect()).collect())
}

fn number(value: Option<f64>) -> Value {
    value.map_or(Value::Null, Value::from)
}

fn count(score: Option<Score>) -> u64 {
    match score {
        Some(Score::Count(n)) => n,
        _ => 0,
    }
}

fn fraction(score: Option<Score>) -> Value {
    match score {
        Some(Score::Rate { hits, valid }) => json!([hits, valid]),
        _ => json!([0, 0]),
    }
}

fn scenario_json(scenario: &DocumentScenario, case: &Case<'_>, scores: &Scores) -> Value {
    let mut out = Map::new();
    out.insert("id".into(), scenario.id.as_str().into());
    for (name, id) in COUNTS {
        out.insert(name.into(), count(scores.score(id)).into());
    }
    let mut fractions = Map::new();
    for (name, id, short) in RATES {
        out.insert(name.into(), number(scores.value(id)));
        fractions.insert(short.into(), fraction(scores.score(id)));
    }
    out.insert("fractions".into(), fractions.into());
    out.insert("ade".into(), number(scores.value("ade")));
    out.insert("progress".into(), number(scores.value("progress")));
    if let Some(d) = &scores.displacement {
        out.insert("ade_detail".into(), displacement_json(d));
    }
    if let Some(likelihood) = &scores.likelihood {
        out.insert("kinematic_likelihood".into(), likelihood_json(likelihood));
    }
    if let Some(d) = &scores.deviation {
        let deviation = json!({
            "endpoint_longitudinal": d.endpoint_longitudinal,
            "endpoint_lateral": d.endpoint_lateral,
            "ade": d.ade,
            "mean_speed_log": d.mean_speed_log,
            "mean_speed_deviated": d.mean_speed_deviated,
            "mean_speed_difference": d.mean_speed_difference,
        });
        out.insert("deviation".into(), deviation);
    }
    let agents: Vec<Value> = (0..case.objects.len()).map(|i| agent_json(case, i)).collect();
    out.insert("agents".into(), agents.into());
    out.into()
}

fn displacement_json(d: &Displacement) -> Value {
    json!({
        "ade": d.ade,
        "min_ade": d.min_ade,
        "min_ade_agent": d.min_ade_agent,
        "agents": d.agents,
        "rollouts": d.rollouts,
    })
}

fn likelihood_json(likelihood: &KinematicLikelihood) -> Value {
    let mut out = Map::new();
    for (name, value) in likelihood.features {
        out.insert(name.into(), number(value));
    }
    out.insert("kinematic".into(), number(likelihood.kinematic()));
    out.insert("objects".into(), likelihood.objects.into());
    out.into()
}

fn agent_json(case: &Case<'_>, object: usize) -> Value {
    let agent = case.objects[object].agent;
    let scores = case.agent_scores(object);
    let contact = scores
        .contact
        .map(|c| json!({ "step": c.step, "at_fault": c.fault.at_fault(), "reason": c.fault.name() }));
    let (moves, steer) = (scores.infeasible, scores.infeasible.curvature_by(case.options.curvature_yaw));
    json!({
        "id": agent.id,
        "type": agent.kind.name(),
        "present": case.present(object),
        "a_a_collision": [scores.overlaps.hits, scores.overlaps.valid],
        "collision": contact,
        "min_ttc": scores.approach.map(|a| a.min_ttc),
        "offroad": [scores.off_road.hits, scores.off_road.valid],
        "direction": {
            "candidate": scores.direction.candidate,
            "violation": !scores.direction.intervals.is_empty(),
            "first_step": scores.direction.intervals.first().map(|s| s.first),
        },
        "accel": [moves.acceleration.hits, moves.valid],
        "steer": [steer.hits, moves.valid],
    })
}

/// Returns the means over scenarios, and the number of scenarios of each mean.
fn aggregate(all: &[Scores]) -> (Map<String, Value>, Map<String, Value>) {
    let (mut means, mut valid) = (Map::new(), Map::new());
    let mut put = |name: &str, values: &mut dyn Iterator<Item = Option<f64>>| {
        let defined: Vec<f64> = values.flatten().collect();
        means.insert(name.into(), number(mean(defined.iter().copied())));
        valid.insert(name.into(), defined.len().into());
    };
    for (name, id) in COUNTS {
        put(name, &mut all.iter().map(|s| Some(count(s.score(id)) as f64)));
    }
    for (name, id, _) in RATES {
        put(name, &mut all.iter().map(|s| s.value(id)));
    }
    for (name, id) in [("ade", "ade"), ("progress", "progress")] {
        put(name, &mut all.iter().map(|s| s.value(id)));
    }
    for (name, id) in SHARES {
        put(name, &mut all.iter().map(|s| Some(f64::from(u8::from(count(s.score(id)) >= 1)))));
    }
    if all.iter().any(|s| s.likelihood.is_some()) {
        let likelihood = all.iter().map(|s| s.likelihood.as_ref().and_then(KinematicLikelihood::kinematic));
        put("kinematic_likelihood", &mut likelihood.clone());
        let mut features = Map::new();
        let mut means_of_features = Vec::new();
        for k in 0..FEATURES {
            let values = all.iter().filter_map(|s| Some(s.likelihood.as_ref()?.features[k].1));
            let mean = mean(values.flatten());
            if let Some(name) = all.iter().find_map(|s| Some(s.likelihood.as_ref()?.features[k].0)) {
                features.insert(name.into(), number(mean));
            }
            means_of_features.extend(mean);
        }
        let whole = means_of_features.len() == FEATURES;
        let kinematic = mean(means_of_features.into_iter()).filter(|_| whole);
        features.insert("kinematic".into(), number(kinematic));
        means.insert("kinematic_likelihood".into(), features.into());
    }
    (means, valid)
}
