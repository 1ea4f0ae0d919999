//! Certificates, which prove that conflicts with a deviated AV can be avoided, and their difficulty.

use std::fmt;

use crate::{AgentState, named_enum};

/// Responses with which no agent touches the AV or has a time to collision with it below half a second: a
/// perfect simulator has no collision and no risky approach in the scenario.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Certificate {
    /// One response per agent that does not simply replay its log, in the order of the agents.
    pub responses: Vec<Response>,
}

/// The motion with which one agent avoids the AV, or avoids another agent that avoids the AV.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Id of the agent.
    pub agent: String,
    /// Id of the agent whose response causes this one; `None` for a response to the AV itself.
    pub leader: Option<String>,
    /// Last step at which the agent still follows its log: 0.3 s after the deviation (or the leader's
    /// response) is visible.
    pub reaction_step: usize,
    /// Lateral shift from the logged path, metres, left positive; 0 for a response by speed alone.
    pub nudge: f64,
    /// Peak deceleration, m/s² (not negative).
    pub peak_deceleration: f64,
    /// Smallest distance between the boxes of agent and AV (with rounded corners, as in the metrics), metres.
    pub clearance: f64,
    /// Minimum effort of the agent; `None` if it was not measured.
    pub effort: Option<Effort>,
    /// 81 states in the scenario frame: steps 0 to 80.
    pub track: Vec<AgentState>,
}

/// The minimum effort that a conflict demands of one agent while all others move as in the certificate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Smallest peak deceleration with which the agent can respond, m/s², to 0.1 m/s².
    pub required_deceleration: f64,
    /// Seconds from the step at which the conflict is first visible to the latest step at which a response
    /// with at most 6 m/s² can still begin.
    pub time_to_react: f64,
}

named_enum! {
    name, from_name;

    /// The difficulty for the agents of avoiding a deviated AV.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Difficulty {
        /// Comfortable braking in good time is enough.
        Easy = "easy",
        /// Neither easy nor hard.
        Medium = "medium",
        /// Hard braking, a prompt reaction or a swerve is needed.
        Hard = "hard",
    }
}

/// Required deceleration below which a conflict may be easy, m/s²: comfortable braking (about the comfortable
/// deceleration of the intelligent driver model, 1.5 m/s²).
pub const EASY_DECELERATION: f64 = 1.5;
/// Time to react from which a conflict may be easy, seconds: the perception-reaction time assumed in road
/// design (AASHTO, "A Policy on Geometric Design of Highways and Streets").
pub const EASY_TIME_TO_REACT: f64 = 2.5;
/// Required deceleration from which a conflict is hard, m/s²: the usual upper bound of non-emergency braking
/// (ISO 15622 allows adaptive cruise control up to 3.5 m/s²).
pub const HARD_DECELERATION: f64 = 3.0;
/// Time to react below which a conflict is hard, seconds: about the perception-reaction time of an attentive
/// driver.
pub const HARD_TIME_TO_REACT: f64 = 1.0;

impl fmt::Display for Difficulty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Certificate {
    /// Returns the peak deceleration over all responses, m/s²; 0 without responses.
    pub fn peak_deceleration(&self) -> f64 {
        self.responses.iter().fold(0.0, |a, r| a.max(r.peak_deceleration))
    }

    /// Returns the smallest peak deceleration with which every agent can respond, m/s²: 0 without responses,
    /// `None` if it was not measured for all of them.
    pub fn required_deceleration(&self) -> Option<f64> {
        self.responses.iter().try_fold(0.0_f64, |a, r| Some(a.max(r.effort?.required_deceleration)))
    }

    /// Returns the shortest time to react over all responses, seconds; `None` without responses, or if it was
    /// not measured for all of them.
    pub fn time_to_react(&self) -> Option<f64> {
        let least =
            self.responses.iter().try_fold(f64::INFINITY, |a, r| Some(a.min(r.effort?.time_to_react)))?;
        least.is_finite().then_some(least)
    }

    /// Returns whether an agent has to leave its path because braking and accelerating alone did not avoid
    /// the conflict.
    pub fn needs_swerve(&self) -> bool {
        self.responses.iter().any(|r| r.nudge != 0.0)
    }

    /// Returns the grade of the conflict; `None` if the effort of a response was not measured.
    ///
    /// Hard: at least [`HARD_DECELERATION`], less than [`HARD_TIME_TO_REACT`], or a swerve. Easy: less than
    /// [`EASY_DECELERATION`], at least [`EASY_TIME_TO_REACT`], and no swerve. Medium: all others.
    pub fn difficulty(&self) -> Option<Difficulty> {
        let deceleration = self.required_deceleration()?;
        let time = self.time_to_react().unwrap_or(f64::INFINITY);
        Some(if deceleration >= HARD_DECELERATION || time < HARD_TIME_TO_REACT || self.needs_swerve() {
            Difficulty::Hard
        } else if deceleration < EASY_DECELERATION && time >= EASY_TIME_TO_REACT {
            Difficulty::Easy
        } else {
            Difficulty::Medium
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn response(deceleration: f64, time: f64, nudge: f64) -> Response {
        Response {
            agent: "a".to_owned(),
            leader: None,
            reaction_step: 5,
            nudge,
            peak_deceleration: 4.0,
            clearance: 1.0,
            effort: Some(Effort { required_deceleration: deceleration, time_to_react: time }),
            track: Vec::new(),
        }
    }

    fn grade(responses: Vec<Response>) -> Option<Difficulty> {
        Certificate { responses }.difficulty()
    }

    #[test]
    fn the_hardest_response_decides() {
        use Difficulty::{Easy, Hard, Medium};
        assert_eq!(grade(vec![]), Some(Easy));
        assert_eq!(grade(vec![response(1.4, 2.5, 0.0)]), Some(Easy));
        assert_eq!(grade(vec![response(1.5, 2.5, 0.0)]), Some(Medium));
        assert_eq!(grade(vec![response(1.4, 2.4, 0.0)]), Some(Medium));
        assert_eq!(grade(vec![response(1.4, 1.0, 0.0)]), Some(Medium));
        assert_eq!(grade(vec![response(1.4, 3.0, 0.0), response(2.9, 3.0, 0.0)]), Some(Medium));
        assert_eq!(grade(vec![response(3.0, 3.0, 0.0), response(0.0, 3.0, 0.0)]), Some(Hard));
        assert_eq!(grade(vec![response(0.5, 0.9, 0.0)]), Some(Hard));
        assert_eq!(grade(vec![response(0.5, 3.0, -0.5)]), Some(Hard));
    }

    #[test]
    fn responses_without_effort_have_no_grade() {
        let unknown = Response { effort: None, ..response(0.0, 9.0, 0.0) };
        assert_eq!(grade(vec![response(4.0, 3.0, 0.0), unknown]), None);
    }

    #[test]
    fn names_round_trip() {
        assert!(Difficulty::ALL.into_iter().all(|d| Difficulty::from_name(d.name()) == Some(d)));
        assert_eq!(Difficulty::from_name("Hard"), None);
    }
}
