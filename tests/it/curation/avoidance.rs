//! Certificates: that they are found where a driver would find a way, refused where none would, and that what they say is true.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim::curation::{AvoidanceSettings, Certificate, Response, Unavoidable, certify};
use reactsim::geometry::{Vec2, direction};
use reactsim::rollout::ScriptedAv;
use reactsim::scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, FUTURE, Frame, LoggedAgent, MapParts, Scenario,
};

use crate::scenes::{agent, car, lane, later, line, real, scene, slot, state, straight};

/// The AV's log as a candidate, changed by `change` (step, logged state).
fn candidate(scenario: &Scenario, change: impl Fn(usize, AgentState) -> AgentState) -> Vec<AgentState> {
    let logged = scenario.logged(0);
    (0..=FUTURE).map(|k| logged[CURRENT + k].unwrap()).enumerate().map(|(k, s)| change(k, s)).collect()
}

/// An AV that brakes along the x axis at `rate` after `delay` seconds.
fn braking(scenario: &Scenario, rate: f64, delay: f64) -> Vec<AgentState> {
    let now = scenario.start.now(0);
    let speed = now.speed();
    candidate(scenario, |k, _| {
        let t = k as f64 * DT;
        let braked = (t - delay).clamp(0.0, speed / rate);
        let way = speed * t.min(delay) + speed * braked - 0.5 * rate * braked * braked;
        let v = direction(now.heading) * if t <= delay { speed } else { speed - rate * braked };
        let p = now.position() + direction(now.heading) * way;
        AgentState { x: p.x, y: p.y, vx: v.x, vy: v.y, ..now }
    })
}

fn found(scenario: &Scenario, av: &[AgentState]) -> Certificate {
    let certificate = certify(scenario, av, &AvoidanceSettings::default())
        .unwrap_or_else(|why| panic!("{}: {why}", scenario.id));
    recheck(scenario, av, &certificate);
    certificate
}

fn refused(scenario: &Scenario, av: &[AgentState]) -> Unavoidable {
    match certify(scenario, av, &AvoidanceSettings::default()) {
        Err(why) => why,
        Ok(certificate) => panic!("{}: {:?}", scenario.id, certificate.peak_deceleration()),
    }
}

/// Points around the rounded outline of a box: the corners are quarter circles of 0.7 times half the shorter side.
fn outline(agent: &Agent, s: &AgentState) -> Vec<Vec2> {
    let (a, b) = (0.5 * agent.length, 0.5 * agent.width);
    let r = 0.7 * a.min(b);
    let (ahead, aside) = (direction(s.heading), direction(s.heading + FRAC_PI_2));
    let mut points = Vec::new();
    for i in 0..4 {
        let turn = f64::from(i) * FRAC_PI_2;
        let (sx, sy) = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)][i as usize];
        for j in 0..=6 {
            let d = direction(turn + FRAC_PI_2 * f64::from(j) / 6.0);
            let p = Vec2::new(sx * (a - r), sy * (b - r)) + d * r;
            points.push(s.position() + ahead * p.x + aside * p.y);
        }
    }
    points
}

/// Distance from a point to the rounded box, negative inside.
fn to_box(p: Vec2, agent: &Agent, s: &AgentState) -> f64 {
    let (a, b) = (0.5 * agent.length, 0.5 * agent.width);
    let r = 0.7 * a.min(b);
    let d = p - s.position();
    let (x, y) =
        (d.dot(&direction(s.heading)).abs() - (a - r), direction(s.heading).perp(&d).abs() - (b - r));
    x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0) - r
}

/// The distance of two rounded boxes, by points of their outlines; where they are further apart, a lower bound of it.
fn distance(a: (&Agent, &AgentState), b: (&Agent, &AgentState)) -> f64 {
    let radius = |x: &Agent| 0.5 * x.length.hypot(x.width);
    let apart = (a.1.position() - b.1.position()).norm() - radius(a.0) - radius(b.0);
    if apart > 1.0 {
        return apart;
    }
    // Long sides have no points between their corners: these are added.
    let dense = |x: (&Agent, &AgentState)| -> Vec<Vec2> {
        let points = outline(x.0, x.1);
        let next = points.iter().cycle().skip(1);
        points
            .iter()
            .zip(next)
            .flat_map(|(p, q)| {
                let n = ((q - p).norm() / 0.1).ceil().max(1.0) as usize;
                (0..n).map(move |i| p + (q - p) * (i as f64 / n as f64)).collect::<Vec<_>>()
            })
            .collect()
    };
    let from = |x: (&Agent, &AgentState), y: (&Agent, &AgentState)| {
        dense(x).iter().map(|p| to_box(*p, y.0, y.1)).fold(f64::INFINITY, f64::min)
    };
    from(a, b).min(from(b, a))
}

/// Everything that a certificate promises, measured anew.
fn recheck(scenario: &Scenario, av: &[AgentState], certificate: &Certificate) {
    let agents = &scenario.start.agents;
    let mut tracks: Vec<Vec<Frame>> =
        (0..agents.len()).map(|i| scenario.logged(i)[CURRENT..].to_vec()).collect();
    tracks[0] = av.iter().copied().map(Some).collect();
    let mut responds = vec![false; agents.len()];
    for response in &certificate.responses {
        let i = slot(scenario, &response.agent);
        responds[i] = true;
        limits(scenario, i, response);
        for k in response.reaction_step + 1..=FUTURE {
            tracks[i][k] = Some(response.track[k]);
        }
    }
    let logged: Vec<Vec<Frame>> = (0..agents.len()).map(|i| scenario.logged(i)[CURRENT..].to_vec()).collect();
    for k in 1..=FUTURE {
        for i in 1..agents.len() {
            let Some(me) = tracks[i][k] else { continue };
            if agents[i].kind == AgentKind::Other {
                continue;
            }
            let apart = distance((&agents[i], &me), (&agents[0], &av[k]));
            let name = format!("{}: `{}` at step {k}", scenario.id, agents[i].id);
            assert!(apart >= -0.01, "{name} is {apart:.3} m from the AV");
            if agents[i].kind == AgentKind::Vehicle {
                let ttc = time_to_collision(&agents[i], &me, &agents[0], &av[k]);
                assert!(ttc >= 0.5, "{name}: {ttc:.2} s to the AV");
            }
            if !responds[i] {
                continue;
            }
            for j in (1..agents.len()).filter(|&j| j != i) {
                let on_foot = |k: AgentKind| k != AgentKind::Vehicle;
                let Some(them) = tracks[j][k] else { continue };
                if on_foot(agents[i].kind) && on_foot(agents[j].kind) || touch(&logged, agents, i, j) {
                    continue;
                }
                let apart = distance((&agents[i], &me), (&agents[j], &them));
                assert!(apart >= -0.01, "{name} is {apart:.3} m from `{}`", agents[j].id);
            }
        }
    }
    for response in &certificate.responses {
        let i = slot(scenario, &response.agent);
        let nearest = (1..=FUTURE)
            .filter_map(|k| Some(distance((&agents[i], &tracks[i][k]?), (&agents[0], &av[k]))))
            .fold(f64::INFINITY, f64::min);
        if nearest < 1.0 || response.clearance < 1.0 {
            assert!((nearest - response.clearance).abs() < 0.05, "{nearest} but {}", response.clearance);
        }
    }
}

/// Whether two agents (nearly) touch in the log.
fn touch(logged: &[Vec<Frame>], agents: &[Agent], i: usize, j: usize) -> bool {
    (0..=FUTURE).any(|k| {
        let (Some(a), Some(b)) = (logged[i][k], logged[j][k]) else { return false };
        distance((&agents[i], &a), (&agents[j], &b)) < 0.05
    })
}

/// The time to collision as the benchmark defines it.
fn time_to_collision(me: &Agent, s: &AgentState, other: &Agent, o: &AgentState) -> f64 {
    let d = o.position() - s.position();
    let turn = (o.heading - s.heading + PI).rem_euclid(2.0 * PI) - PI;
    let (c, n) = (turn.cos().abs(), turn.sin().abs());
    let gap = d.dot(&direction(s.heading)) - me.length / 2.0 - other.length / 2.0 * c - other.width / 2.0 * n;
    let beside =
        direction(s.heading).perp(&d).abs() - me.width / 2.0 - other.length / 2.0 * n - other.width / 2.0 * c;
    let front = gap > 0.0
        && turn.abs() <= 75_f64.to_radians()
        && beside < 0.0
        && (beside < -0.5 || turn.abs() <= 10_f64.to_radians());
    let closing = s.speed() - o.speed();
    if front && closing > 0.0 { gap / closing } else { 5.0 }
}

/// The bounds of one response: as in the log up to the reaction, then along the logged path with bounded braking and jerk.
fn limits(scenario: &Scenario, i: usize, response: &Response) {
    let log = scenario.logged(i);
    let name = format!("{}: `{}`", scenario.id, response.agent);
    let r = response.reaction_step;
    assert_eq!(response.track.len(), FUTURE + 1, "{name}");
    for k in 0..=r {
        if let Some(was) = log[CURRENT + k] {
            assert_eq!(response.track[k], was, "{name} leaves its log at step {k} < {r}");
        }
    }
    let settings = AvoidanceSettings::default();
    let at = |k: usize| response.track[k];
    let hardest_gain = 3.5;
    let mut before: Option<f64> = None;
    for k in r + 1..=FUTURE {
        let moved = (at(k).position() - at(k - 1).position()) / DT;
        let said = Vec2::new(at(k).vx, at(k).vy);
        assert!((moved - said).norm() < 1e-6, "{name}: velocity at step {k}");
        let from = if k == r + 1 && at(r).speed() < 0.1 { 0.0 } else { at(k - 1).speed() };
        if !from.is_finite() {
            continue;
        }
        let a = (said.norm() - from) / DT;
        assert!(a >= -settings.max_deceleration - 0.15, "{name} brakes at {a:.2} m/s2 at step {k}");
        assert!(a <= hardest_gain + 0.15, "{name} gains {a:.2} m/s2 at step {k}");
        if let Some(before) = before {
            let jerk = (a - before) / DT;
            // Positions lie on the chords of a path: a little more than the profile's own jerk.
            assert!(jerk.abs() <= settings.max_jerk + 3.0, "{name}: {jerk:.1} m/s3 at step {k}");
        }
        before = Some(a);
        if at(k).position() == at(k - 1).position() {
            assert_eq!(at(k).speed(), 0.0, "{name} stands at step {k}");
            assert_eq!(at(k).heading, at(k - 1).heading, "{name} stands at step {k}");
        }
    }
    // The path: nowhere further from the logged positions (up to its end) than the shift.
    let logged: Vec<Vec2> = log[CURRENT + r..].iter().flatten().map(AgentState::position).collect();
    let end = logged[logged.len() - 1];
    for k in r + 1..=FUTURE {
        let p = at(k).position();
        let beyond = (p - end).norm() < 1.5 || (end - logged[0]).norm() < (p - logged[0]).norm();
        let aside = logged
            .windows(2)
            .map(|w| {
                let (d, e) = (w[1] - w[0], p - w[0]);
                let t = if d.norm() > 0.0 { (e.dot(&d) / d.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
                (e - d * t).norm()
            })
            .fold((p - logged[0]).norm(), f64::min);
        assert!(beyond || aside <= response.nudge.abs() + 0.3, "{name} is {aside:.2} m aside at step {k}");
    }
}

fn response<'c>(certificate: &'c Certificate, id: &str) -> &'c Response {
    certificate.responses.iter().find(|r| r.agent == id).unwrap_or_else(|| panic!("no response of `{id}`"))
}

#[test]
fn a_follower_brakes_behind_an_av_that_stops() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("follower", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(certificate.responses.len(), 1);
    let own = response(&certificate, "own");
    assert_eq!(own.nudge, 0.0);
    // 1.2 m/s are lost after 0.4 s, and 0.3 s pass.
    assert_eq!(own.reaction_step, 7);
    assert!((1.5..5.01).contains(&own.peak_deceleration), "{}", own.peak_deceleration);
    assert_eq!(certificate.peak_deceleration(), own.peak_deceleration);
    assert!(own.clearance >= 0.2, "{}", own.clearance);
    assert!(own.track[FUTURE].speed() < 3.0, "{}", own.track[FUTURE].speed());
}

#[test]
fn nobody_responds_to_an_av_that_disturbs_nobody() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("undisturbed", agents, straight());
    assert_eq!(found(&scenario, &candidate(&scenario, |_, s| s)), Certificate::default());
}

#[test]
fn a_follower_of_the_follower_brakes_likewise() {
    let agents = vec![
        car("av", 20.0, 0.0, 0.0, 10.0),
        car("first", 4.0, 0.0, 0.0, 10.0),
        car("second", -10.0, 0.0, 0.0, 10.0),
        car("third", -24.0, 0.0, 0.0, 10.0),
    ];
    let scenario = scene("queue", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    let reactions: Vec<usize> =
        ["first", "second", "third"].map(|id| response(&certificate, id).reaction_step).to_vec();
    assert!(reactions[0] <= reactions[1] && reactions[1] <= reactions[2], "{reactions:?}");
}

#[test]
fn who_only_meets_the_braking_leader_reacts_to_that() {
    // The AV stops in the middle of a crossing. Only the first vehicle would get there; the second would end just before.
    let north = |id: &str, y: f64| car(id, 30.0, y, FRAC_PI_2, 10.0);
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), north("first", -71.0), north("second", -85.0)];
    let scenario = scene("second row", agents, straight());
    let av = braking(&scenario, 2.0, 0.5);
    let certificate = found(&scenario, &av);
    let (first, second) = (response(&certificate, "first"), response(&certificate, "second"));
    assert!(second.reaction_step > first.reaction_step, "{} {}", first.reaction_step, second.reaction_step);
}

/// A crossing: the AV drives east and stops in the middle; `own` comes from the south.
fn crossing(gap: f64) -> (Scenario, Vec<AgentState>) {
    let mut map = straight();
    map.lanes.push(lane("north", line((30.0, -150.0), (30.0, 150.0)), Some(15.0)));
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), car("own", 30.0, -gap, FRAC_PI_2, 10.0)];
    let scenario = scene(&format!("crossing from {gap} m"), agents, map);
    let av = braking(&scenario, 2.0, 0.5);
    (scenario, av)
}

#[test]
fn a_crossing_car_yields_or_goes_first() {
    let (scenario, av) = crossing(45.0);
    // It passes after 3.0 s in the log and in the middle of the crossing stands the AV after 5.5 s.
    let end = av[FUTURE].x;
    assert!((27.0..33.0).contains(&end), "the AV stops at {end}");
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.track[FUTURE].y < -1.0 || own.track[FUTURE].y > 5.0);
}

#[test]
fn head_on_there_is_no_way_out() {
    let agents = vec![car("av", 60.0, 3.6, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("head-on", agents, straight());
    // The AV comes over into the lane of the oncoming car and goes on.
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.6 * (1.0 - share * share * (3.0 - 2.0 * share)), ..s }
    });
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
    assert!(why.to_string().contains("`own`"), "{why}");
}

#[test]
fn a_cut_in_at_arms_length_is_too_close() {
    let agents = vec![car("av", 8.0, -3.6, 0.0, 15.0), car("own", 0.0, 0.0, 0.0, 15.0)];
    let scenario = scene("cut-in", agents, straight());
    // Within 1 s the AV is before the other car, and 9 m/s slower.
    let now = scenario.start.now(0);
    let mut x = now.x;
    let av = candidate(&scenario, |_, s| s);
    let av: Vec<AgentState> = av
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let share = (k as f64 * DT).min(1.0);
            let speed = 15.0 - 9.0 * share;
            x += if k == 0 { 0.0 } else { speed * DT };
            AgentState { x, y: -3.6 * (1.0 - share), vx: speed, ..*s }
        })
        .collect();
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. } | Unavoidable::TooEarly { .. }), "{why}");
}

#[test]
fn a_conflict_before_anybody_can_react_is_refused() {
    let agents = vec![car("av", 5.3, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("tailgating", agents, straight());
    let why = refused(&scenario, &braking(&scenario, 6.0, 0.0));
    assert!(matches!(why, Unavoidable::TooEarly { reaction: 5 | 6, .. }), "{why}");
}

#[test]
fn a_nudge_saves_where_braking_can_not() {
    // The oncoming AV reaches half a metre over into the lane of the other, all the way: stopping does not help.
    let agents = vec![car("av", 80.0, 3.2, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let mut map = straight();
    map.lanes.push(lane("right", line((-150.0, -3.5), (350.0, -3.5)), Some(15.0)));
    let scenario = scene("narrow", agents, map);
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.2 - 1.6 * share * share * (3.0 - 2.0 * share), ..s }
    });
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.nudge < 0.0 && own.nudge >= -1.0, "{}", own.nudge);
    let never = AvoidanceSettings { max_nudge: 0.0, ..AvoidanceSettings::default() };
    assert!(matches!(certify(&scenario, &av, &never), Err(Unavoidable::TooClose { .. })));
}

#[test]
fn a_pedestrian_waits() {
    let walker = agent("walker", AgentKind::Pedestrian, state(30.0, -7.0, FRAC_PI_2, 1.4));
    let scenario = scene("walker", vec![car("av", -30.0, 0.0, 0.0, 14.0), walker], straight());
    // In the log the AV is past before the walker comes; the candidate is slower.
    let av = candidate(&scenario, |k, s| {
        let now = later(&AgentState { x: -30.0, vx: 12.0, ..s }, k as f64 * DT);
        AgentState { x: now.x, vx: 12.0, ..s }
    });
    let certificate = found(&scenario, &av);
    for response in &certificate.responses {
        assert_eq!((response.agent.as_str(), response.nudge), ("walker", 0.0));
    }
}

#[test]
fn a_standing_car_that_is_run_into_can_do_nothing() {
    let agents = vec![car("av", 0.0, 3.6, 0.0, 10.0), car("own", 40.0, 0.0, 0.0, 0.0)];
    let scenario = scene("standing", agents, straight());
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 2.0).min(1.0);
        AgentState { y: 3.6 * (1.0 - share), ..s }
    });
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
}

#[test]
fn candidates_of_the_wrong_form_are_refused() {
    let scenario = scene("form", vec![car("av", 0.0, 0.0, 0.0, 10.0)], MapParts::default());
    let mut av = candidate(&scenario, |_, s| s);
    av[7].x = f64::NAN;
    assert_eq!(refused(&scenario, &av), Unavoidable::Malformed { found: 80 });
    assert_eq!(refused(&scenario, &av[..7]), Unavoidable::Malformed { found: 7 });
    assert_eq!(refused(&scenario, &[]), Unavoidable::Malformed { found: 0 });
}

#[test]
fn an_agent_with_gaps_in_its_log_is_no_trouble() {
    let mut own: LoggedAgent = car("own", 0.0, 0.0, 0.0, 10.0);
    for frame in [CURRENT + 3, CURRENT + 7, CURRENT + 20] {
        own.track[frame] = None;
    }
    for frame in CURRENT + 60..own.track.len() {
        own.track[frame] = None;
    }
    let scenario = scene("gaps", vec![car("av", 20.0, 0.0, 0.0, 10.0), own], straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(response(&certificate, "own").track.len(), FUTURE + 1);
}

#[test]
fn the_same_question_has_the_same_answer() {
    let (scenario, av) = crossing(45.0);
    assert_eq!(found(&scenario, &av), found(&scenario, &av));
}

#[test]
fn certificates_of_real_logs_hold() {
    let scenarios = real(24);
    if scenarios.is_empty() {
        println!("skipped: no data in ../shared/data/womd/train");
        return;
    }
    let (mut conflicts, mut certified) = (0, 0);
    for scenario in &scenarios {
        let Ok(av) = ScriptedAv::new(scenario, "brake:3".parse().unwrap()) else { continue };
        let track: Vec<AgentState> =
            std::iter::once(scenario.start.now(0)).chain(av.track().iter().copied()).collect();
        match certify(scenario, &track, &AvoidanceSettings::default()) {
            Ok(certificate) => {
                recheck(scenario, &track, &certificate);
                conflicts += usize::from(!certificate.responses.is_empty());
                certified += usize::from(!certificate.responses.is_empty());
            }
            Err(_) => conflicts += 1,
        }
    }
    assert!(certified * 10 >= conflicts * 7, "{certified} of {conflicts} are certified");
    assert!(certified > 3, "{certified} certificates");
}
