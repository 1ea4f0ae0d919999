//! Parameters of the card.

use reactsim_scene::AgentKind;
use reactsim_scene::dynamics::Pursuit;
use serde::Deserialize;

use super::styles::Styles;

/// All parameters of the card.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    pub(super) vehicle: Class,
    pub(super) cyclist: Class,
    pub(super) pedestrian: Pedestrian,
    pub(super) limits: Limits,
    pub(super) conflict: Conflict,
    pub(super) parked: ParkedCriteria,
    /// Distributions of driver styles; `None` if drivers differ by the spreads of their class only.
    #[serde(default)]
    pub(super) styles: Option<Styles>,
}

impl Parameters {
    /// Returns the parameters of vehicles of a kind.
    pub(super) fn class(&self, kind: AgentKind) -> &Class {
        if kind == AgentKind::Cyclist { &self.cyclist } else { &self.vehicle }
    }
}

/// Parameters of a class of vehicles.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Class {
    /// Time headway T, s.
    pub(super) headway: f64,
    /// Relative spread of the headway over drivers.
    pub(super) headway_spread: f64,
    /// Standstill gap s0, m.
    pub(super) standstill_gap: f64,
    /// Largest acceleration a, m/s².
    pub(super) acceleration: f64,
    /// Comfortable deceleration b, m/s².
    pub(super) deceleration: f64,
    /// Coolness c of the ACC extension.
    pub(super) coolness: f64,
    /// Comfortable lateral acceleration in curves, m/s².
    pub(super) lateral_acceleration: f64,
    /// Largest curvature, 1/m.
    pub(super) max_curvature: f64,
    /// Largest change of the curvature along the path, 1/m².
    pub(super) curvature_rate: f64,
    /// Desired speed on roads other than freeways without a known limit, m/s.
    pub(super) speed_unknown_limit: f64,
    /// Desired speed on freeways without a known limit, and largest limit that is used, m/s.
    pub(super) speed_freeway: f64,
    /// Relative spread of the desired speed over drivers.
    pub(super) speed_spread: f64,
}

impl Class {
    /// Returns the parameters of pure pursuit onto a lane at a speed in m/s.
    pub(super) fn pursuit(&self, speed: f64) -> Pursuit {
        Pursuit {
            look_ahead: (0.9 * speed).clamp(5.0, 18.0),
            max_curvature: self.max_curvature,
            max_curvature_rate: self.curvature_rate,
        }
    }
}

/// Parameters of pedestrians.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Pedestrian {
    /// Speed in m/s below which a pedestrian stands.
    pub(super) standing_speed: f64,
    /// Clearance to vehicles, m.
    pub(super) clearance: f64,
    /// Look-ahead time, s.
    pub(super) look_ahead: f64,
}

/// Bounds on the controls.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    /// Largest deceleration, m/s².
    pub(super) emergency_deceleration: f64,
    /// Largest jerk in normal driving, m/s³.
    pub(super) jerk: f64,
    /// Largest jerk in emergencies, m/s³.
    pub(super) emergency_jerk: f64,
}

/// Parameters of crossing and merging.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Conflict {
    /// Horizon of forecasts, s.
    pub(super) horizon: f64,
    /// Horizon of the AV's forecasts for evasion, s.
    pub(super) av_horizon: f64,
    /// Sampling interval of forecasts, s.
    pub(super) sample: f64,
    /// Margin along the path to the AV, m.
    pub(super) av_margin: f64,
    /// Margin along the path to other agents, m.
    pub(super) margin: f64,
    /// Time margin to the AV, s: adds to the margin in proportion to the own speed.
    pub(super) av_time_margin: f64,
    /// Handicap of turning vehicles when precedence is decided, s.
    pub(super) turn_penalty: f64,
    /// Handicap of vehicles from a stop sign when precedence is decided, s.
    pub(super) stop_penalty: f64,
}

/// Criteria by which a standing vehicle counts as parked.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ParkedCriteria {
    /// Largest displacement in the history, m.
    pub(super) travel: f64,
    /// Largest present speed, m/s.
    pub(super) speed: f64,
    /// Lateral offset from the centre line above which it is parked, m …
    pub(super) offset: f64,
    /// … or angle to the centre line above which it is parked, rad.
    pub(super) heading: f64,
}
