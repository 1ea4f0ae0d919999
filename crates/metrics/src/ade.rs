//! Average displacement error to the log, over one or more rollouts (ReactSim-Bench, realism protocol).

use reactsim_geometry::math;
use reactsim_scene::Frame;

use super::{Case, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Displacement errors of one scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Mean over rollouts of the mean over agents, metres.
    pub ade: f64,
    /// Minimum over rollouts of the mean over agents (WOSAC's minADE), metres.
    pub min_ade: f64,
    /// Mean over agents of the minimum over rollouts (catk's minADE), metres.
    pub min_ade_agent: f64,
    /// Number of agents with a valid step.
    pub agents: u64,
    /// Number of rollouts.
    pub rollouts: u64,
}

impl Case<'_> {
    /// Returns the state of an object at a step (1 is the first) of a rollout, or of the evaluated track if
    /// `rollout` is `None`.
    fn rolled(&self, rollout: Option<usize>, object: usize, step: usize) -> Frame {
        match rollout {
            Some(r) => self.rollouts[r][object].get(step - 1).copied().flatten(),
            None => self.objects[object].track.get(self.current + step).copied().flatten(),
        }
    }
}

impl Judgement for Option<Displacement> {
    fn compute(case: &Case<'_>) -> Self {
        let log = case.log.as_ref()?;
        let sources: Vec<Option<usize>> =
            if case.rollouts.is_empty() { vec![None] } else { (0..case.rollouts.len()).map(Some).collect() };
        let mut least = vec![f64::INFINITY; case.objects.len()];
        let (mut scene_sum, mut scenes, mut min_ade) = (0.0, 0_u64, f64::INFINITY);
        for &rollout in &sources {
            let (mut sum, mut agents) = (0.0, 0_u64);
            for i in (0..case.objects.len()).filter(|&i| case.evaluated(i)) {
                let (mut error, mut steps) = (0.0, 0_usize);
                for f in case.future() {
                    let rolled = case.rolled(rollout, i, f - case.current);
                    if let (Some(logged), Some(rolled)) = (log[i].at(f), rolled) {
                        error += math::hypot(rolled.x - logged.x, rolled.y - logged.y);
                        steps += 1;
                    }
                }
                if steps == 0 {
                    continue;
                }
                if case.options.ade_include_history {
                    steps += log[i].history.iter().flatten().count();
                }
                let ade = error / steps as f64;
                least[i] = least[i].min(ade);
                sum += ade;
                agents += 1;
            }
            if agents > 0 {
                let scene = sum / agents as f64;
                scene_sum += scene;
                scenes += 1;
                min_ade = min_ade.min(scene);
            }
        }
        if scenes == 0 {
            return None;
        }
        let reached: Vec<f64> = least.into_iter().filter(|v| v.is_finite()).collect();
        Some(Displacement {
            ade: scene_sum / scenes as f64,
            min_ade,
            min_ade_agent: reached.iter().sum::<f64>() / reached.len() as f64,
            agents: reached.len() as u64,
            rollouts: sources.len() as u64,
        })
    }
}

/// Returns the errors of the case's rollouts, or of its evaluated track if it has no rollouts; `None` without
/// a log or a step to evaluate.
pub(super) fn displacement<'c>(case: &'c Case<'_>) -> Option<&'c Displacement> {
    case.judgement::<Option<Displacement>>().as_ref()
}

/// Mean displacement over rollouts and agents.
pub(super) const ADE: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "ade",
        title: "ADE",
        unit: Unit::Metres,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, realism protocol: average displacement error",
    },
    has_events: false,
    score: |case, _| displacement(case).map(|d| Score::Value(d.ade)),
};

/// Minimum over rollouts of the mean displacement over agents.
pub(super) const MIN_ADE: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "min-ade",
        title: "minADE",
        unit: Unit::Metres,
        scope: Scope::Scenario,
        lower_is_better: true,
        source: "ReactSim-Bench, realism protocol: minADE at scene level (Waymo sim-agents)",
    },
    has_events: false,
    score: |case, _| displacement(case).map(|d| Score::Value(d.min_ade)),
};
