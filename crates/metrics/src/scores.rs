//! The list of metrics, and all scores of one rollout.

use super::ade::{self, Displacement};
use super::agent_agent::{self, Overlaps};
use super::av::OfAv;
use super::collision::{self, Contact};
use super::deviation::DeviationStats;
use super::direction::{self, WrongWay};
use super::kinematics::{self, InfeasibleMotion};
use super::likelihood::{self, KinematicLikelihood};
use super::log_clinging;
use super::offroad::{self, OffRoadSteps};
use super::over_reaction;
use super::progress;
use super::red_light;
use super::ttc::{self, Approach};
use super::undisturbed;
use super::{Case, DirTracking, Event, Metric, MetricSpec, Metrics, Score};

/// Every metric: the paper's seven in its column order, the additional ones, and the metrics of the AV.
pub const METRICS: &[&dyn Metric] = &[
    &collision::AT_FAULT,
    &ttc::RISKY,
    &agent_agent::AGENT_AGENT,
    &offroad::OFF_ROAD,
    &direction::DIRECTION,
    &kinematics::ACCELERATION,
    &kinematics::CURVATURE,
    &kinematics::CURVATURE_VELOCITY,
    &collision::ANY_OVERLAP,
    &red_light::RED_LIGHT,
    &ade::ADE,
    &ade::MIN_ADE,
    &progress::PROGRESS,
    &over_reaction::OVER_REACTION,
    &over_reaction::OVER_BRAKING,
    &undisturbed::UNDISTURBED_LOSS,
    &log_clinging::LOG_CLINGING,
    &likelihood::LIKELIHOOD,
    &OfAv(0),
    &OfAv(1),
    &OfAv(2),
    &OfAv(3),
    &OfAv(4),
    &OfAv(5),
    &OfAv(6),
    &OfAv(7),
    &OfAv(8),
    &OfAv(9),
];

/// Ids of metrics of earlier versions. Files may have their values, which readers leave out.
pub const REMOVED_METRICS: [&str; 2] = ["av-pdms", "av-epdms"];

/// Returns the metric with this id.
pub fn metric(id: &str) -> Option<&'static dyn Metric> {
    METRICS.iter().copied().find(|m| m.spec().id == id)
}

/// The scores of every metric for one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Scores {
    /// Score of each metric, in the order of [`METRICS`], then those of the calling program; `None` if nothing
    /// could be evaluated.
    pub values: Vec<(&'static MetricSpec, Option<Score>)>,
    /// All counted events, and contacts that do not count.
    pub events: Vec<Event>,
    /// Deviation of the evaluated AV from the logged AV; `None` without a log.
    pub deviation: Option<DeviationStats>,
    /// All displacement statistics; `None` without a log.
    pub displacement: Option<Displacement>,
    /// Kinematic likelihood by feature; `None` without a log and rollouts of 80 steps.
    pub likelihood: Option<KinematicLikelihood>,
    /// Method by which lanes were assigned (`Auto` resolved).
    pub dir_tracking: DirTracking,
}

impl Scores {
    /// Returns the score of the metric with this id.
    pub fn score(&self, id: &str) -> Option<Score> {
        self.values.iter().find(|v| v.0.id == id)?.1
    }

    /// Returns the value of the metric with this id; `None` if it is undefined.
    pub fn value(&self, id: &str) -> Option<f64> {
        self.score(id)?.value()
    }
}

/// Computes every metric of the benchmark for one case.
pub fn score_case(case: &Case<'_>) -> Scores {
    Metrics::default().score_case(case)
}

/// The metrics over all rollouts of one scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutScores {
    /// Score of each metric with [`Scope::Scenario`](super::Scope), in the order of [`METRICS`], then those of
    /// the calling program; `None` if nothing could be evaluated.
    pub values: Vec<(&'static MetricSpec, Option<Score>)>,
    /// Displacement over all rollouts; `None` if no agent has a logged step.
    pub displacement: Option<Displacement>,
    /// Kinematic likelihood by feature; `None` without a log of 80 steps.
    pub likelihood: Option<KinematicLikelihood>,
}

/// The metric results of one object, for reports that list agents.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentScores<'c> {
    /// Collisions with other agents.
    pub overlaps: &'c Overlaps,
    /// First contact with the AV.
    pub contact: Option<Contact>,
    /// Approach to the AV; `None` for objects that are not evaluated vehicles.
    pub approach: Option<Approach>,
    /// Steps off the road.
    pub off_road: &'c OffRoadSteps,
    /// Driving direction.
    pub direction: &'c WrongWay,
    /// Accelerations and curvatures.
    pub infeasible: &'c InfeasibleMotion,
}

impl Case<'_> {
    /// Returns the metric results of one object.
    ///
    /// # Panics
    /// Panics if there is no such object.
    pub fn agent_scores(&self, object: usize) -> AgentScores<'_> {
        AgentScores {
            overlaps: &agent_agent::overlaps(self)[object],
            contact: self.contacts()[object],
            approach: self.approaches()[object],
            off_road: &offroad::off_road_steps(self)[object],
            direction: &direction::directions(self)[object],
            infeasible: &kinematics::infeasible(self)[object],
        }
    }
}
