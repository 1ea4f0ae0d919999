//! The list of metrics, and everything that they say about one rollout.

use super::ade::{self, Displacement};
use super::agent_agent::{self, Overlaps};
use super::collision::{self, Contact};
use super::deviation::{self, DeviationStats};
use super::direction::{self, WrongWay};
use super::kinematics::{self, Infeasible};
use super::likelihood::{self, KinematicLikelihood};
use super::log_clinging;
use super::offroad::{self, Ground};
use super::over_reaction;
use super::progress;
use super::ttc::{self, Approach};
use super::undisturbed;
use super::{Case, DirTracking, Event, Metric, MetricSpec, Options, Score};
use crate::scene::{Frame, HISTORY, Scenario};

/// Every metric: the paper's seven in its column order, then what is printed beside them.
pub const METRICS: &[&dyn Metric] = &[
    &collision::AtFault,
    &ttc::Risky,
    &agent_agent::AgentAgent,
    &offroad::OffRoad,
    &direction::Direction,
    &kinematics::Acceleration,
    &kinematics::Curvature,
    &kinematics::CurvatureVelocity,
    &collision::AnyOverlap,
    &ade::Ade,
    &ade::MinAde,
    &progress::Progress,
    &over_reaction::OverReaction,
    &over_reaction::OverBraking,
    &undisturbed::UndisturbedLoss,
    &log_clinging::LogClinging,
    &likelihood::Likelihood,
];

/// The metric with this id.
pub fn metric(id: &str) -> Option<&'static dyn Metric> {
    METRICS.iter().copied().find(|m| m.spec().id == id)
}

/// What every metric says about one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Scores {
    /// The value of each metric, in the order of [`METRICS`]; `None` where nothing could be judged.
    pub values: Vec<(&'static MetricSpec, Option<Score>)>,
    /// Everything that was counted, and contacts that were not.
    pub events: Vec<Event>,
    /// How far the judged AV leaves the logged one; `None` without a log.
    pub deviation: Option<DeviationStats>,
    /// Displacement in full; `None` without a log.
    pub displacement: Option<Displacement>,
    /// The kinematic likelihood by feature; `None` without a log and rollouts.
    pub likelihood: Option<KinematicLikelihood>,
    /// How lanes were assigned (`Auto` resolved).
    pub dir_tracking: DirTracking,
}

impl Scores {
    /// The score of the metric with this id.
    pub fn score(&self, id: &str) -> Option<Score> {
        self.values.iter().find(|v| v.0.id == id)?.1
    }

    /// The value of the metric with this id; `None` where it is undefined.
    pub fn value(&self, id: &str) -> Option<f64> {
        self.score(id)?.value()
    }
}

/// Computes every metric for one case.
pub fn score_case(case: &Case<'_>) -> Scores {
    let mut events = Vec::new();
    let values = METRICS.iter().map(|m| (m.spec(), m.score(case, &mut events))).collect();
    Scores {
        values,
        events,
        deviation: deviation::deviation(case),
        displacement: ade::displacement(case).cloned(),
        likelihood: likelihood::likelihood(case),
        dir_tracking: case.options.dir_tracking,
    }
}

/// The metrics over all rollouts of one scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutScores {
    /// Displacement over all rollouts; `None` where no agent has a logged step.
    pub displacement: Option<Displacement>,
    /// The kinematic likelihood by feature.
    pub likelihood: Option<KinematicLikelihood>,
}

/// Computes the metrics over several rollouts of a scenario: ADE, minADE and the kinematic likelihood.
///
/// `rollouts`: per rollout and agent (order of the scenario) 91 frames.
pub fn score_rollouts(scenario: &Scenario, rollouts: &[&[Vec<Frame>]], options: Options) -> RolloutScores {
    let future = |track: &'_ [Frame]| -> std::ops::Range<usize> { HISTORY.min(track.len())..track.len() };
    let Some(first) = rollouts.first() else {
        return RolloutScores { displacement: None, likelihood: None };
    };
    // Presence is decided at the current frame, which all rollouts share.
    let case = Case::of_rollout(scenario, first.to_vec(), options)
        .with_rollouts(rollouts.iter().map(|r| r.iter().map(|t| &t[future(t)]).collect()).collect());
    RolloutScores {
        displacement: ade::displacement(&case).cloned(),
        likelihood: likelihood::likelihood(&case),
    }
}

/// What the metrics say about one object, for reports that list agents.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentScores<'c> {
    /// Collisions with other agents.
    pub overlaps: &'c Overlaps,
    /// First contact with the AV.
    pub contact: Option<Contact>,
    /// Approach to the AV; `None` for objects that are no evaluated vehicles.
    pub approach: Option<Approach>,
    /// Ground under it.
    pub ground: &'c Ground,
    /// Driving direction.
    pub direction: &'c WrongWay,
    /// Accelerations and curvatures.
    pub infeasible: &'c Infeasible,
}

impl Case<'_> {
    /// How far the judged AV leaves the logged one; `None` without a log.
    pub fn deviation(&self) -> Option<DeviationStats> {
        deviation::deviation(self)
    }

    /// The first contact of every object with the AV; `None` for those that have none or are no evaluated vehicles.
    pub fn contacts(&self) -> &[Option<Contact>] {
        collision::contacts(self)
    }

    /// The approach of every object to the AV; `None` for those that are no evaluated vehicles.
    pub fn approaches(&self) -> &[Option<Approach>] {
        ttc::approaches(self)
    }

    /// What the metrics say about one object.
    ///
    /// # Panics
    /// When there is no such object.
    pub fn agent_scores(&self, object: usize) -> AgentScores<'_> {
        AgentScores {
            overlaps: &agent_agent::overlaps(self)[object],
            contact: collision::contacts(self)[object],
            approach: ttc::approaches(self)[object],
            ground: &offroad::grounds(self)[object],
            direction: &direction::directions(self)[object],
            infeasible: &kinematics::infeasible(self)[object],
        }
    }
}
