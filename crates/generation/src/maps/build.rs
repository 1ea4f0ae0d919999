//! Building blocks of maps: reference lines, lanes along them, roads with a cross-section, connectors,
//! drivable ground.
//!
//! A map type draws its parameters, lays [`Road`]s and connectors into a [`MapBuilder`], declares
//! priorities, and calls [`MapBuilder::finish`], which unites the surfaces, cuts edges at the border, and
//! moves every point to a grid.
//!
//! Angles are radians, lengths metres, speeds m/s. Offsets from a reference line are positive to its left;
//! traffic keeps right.

mod builder;
mod connector;
mod ground;
mod lanes;
mod path;
mod profile;
mod ring;
mod road;
#[cfg(test)]
mod tests;

pub use builder::MapBuilder;
pub use connector::{MIN_TURN_RADIUS, Pose, connector};
pub use ground::{GRID_SPACING, area, edges, on_grid, union};
pub use lanes::{LaneRef, Spec};
pub use path::{Path, Piece, Station, sampling_step};
pub use profile::Profile;
pub(super) use ring::cross;
pub use ring::{fillet, ribbon};
pub use road::{
    BROKEN_WHITE, DOUBLE_YELLOW, Direction, Median, Pavement, Road, RoadLanes, SOLID_WHITE, SOLID_YELLOW,
    Section, Side,
};

/// Minimum width of ground on either side of every lane, metres: gutters and shoulders, so that wheels on
/// the line are still on the road.
pub const MARGIN: f64 = 0.5;
/// Length of ground beyond the ends of lanes at the border of the map, metres.
pub const OVERHANG: f64 = 8.0;

/// Converts miles per hour to metres per second.
pub const fn mph(value: f64) -> f64 {
    value * 0.44704
}
