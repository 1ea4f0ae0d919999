//! Colours (Okabe and Ito, "Color Universal Design").

use reactsim_scene::{AgentKind, LightState};

/// Colours of an agent.
pub(super) struct Paint {
    /// Colour of the body.
    pub(super) fill: &'static str,
    /// Colour of the outline and the trail.
    pub(super) line: &'static str,
}

/// The AV.
pub(super) const AV: Paint = Paint { fill: "#d55e00", line: "#9c4400" };
/// Vehicles.
const VEHICLE: Paint = Paint { fill: "#56a7dc", line: "#00568c" };
/// Pedestrians.
const PEDESTRIAN: Paint = Paint { fill: "#cc79a7", line: "#8f3f6d" };
/// Cyclists.
const CYCLIST: Paint = Paint { fill: "#1fb48a", line: "#006f4f" };
/// Static obstacles.
const OTHER: Paint = Paint { fill: "#a7a9ae", line: "#63666d" };

/// Ground outside the road.
pub(super) const GROUND: &str = "#f4f3ef";
/// Road surface.
pub(crate) const ROAD: &str = "#d9dbe0";
/// Bicycle lanes.
pub(super) const BIKE_LANE: &str = "#cfe0d6";
/// White road paint and zebra stripes.
pub(crate) const WHITE: &str = "#ffffff";
/// Yellow road paint.
pub(crate) const YELLOW: &str = "#e2a800";
/// Road edges.
pub(crate) const EDGE: &str = "#6c7078";
/// Centre lines and their arrows.
pub(super) const CENTER: &str = "#aeb3bd";
/// Stop lines without a light.
pub(crate) const STOP: &str = "#22252b";
/// Logged tracks next to a rollout.
pub(crate) const GHOST: &str = "#5c6068";
/// Frame of a panel.
pub(super) const FRAME: &str = "#b9bcc4";
/// Events.
pub(crate) const EVENT: &str = "#b00020";

/// Returns the colours of a kind of agent.
pub(super) const fn of(kind: AgentKind) -> &'static Paint {
    match kind {
        AgentKind::Vehicle => &VEHICLE,
        AgentKind::Pedestrian => &PEDESTRIAN,
        AgentKind::Cyclist => &CYCLIST,
        AgentKind::Other => &OTHER,
    }
}

/// Lines of charts, in turn.
pub(crate) const LINES: [&str; 4] = [AV.line, VEHICLE.line, CYCLIST.line, PEDESTRIAN.line];
/// Generated data in charts, and reference data in charts.
pub(crate) const GENERATED: &str = AV.line;
pub(crate) const REFERENCE: &str = "#a9cfea";

/// Returns the colour of a light; grey if it was not observed.
pub(super) fn light(state: Option<LightState>) -> &'static str {
    match state {
        Some(LightState::Stop | LightState::ArrowStop | LightState::FlashingStop) => "#d0021b",
        Some(LightState::Caution | LightState::ArrowCaution | LightState::FlashingCaution) => "#f0b400",
        Some(LightState::Go | LightState::ArrowGo) => "#00935f",
        Some(LightState::Unknown) | None => "#9a9da4",
    }
}
