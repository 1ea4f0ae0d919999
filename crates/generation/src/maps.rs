//! Generated road maps: parametric, drawn within engineering ranges, and validated in tests.

mod access;
pub mod build;
mod crosswalk;
mod driveways;
mod junctions;
mod lanes;
mod motorway;
mod overpass;
mod plain;
mod ranges;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod validate;
mod yards;

use reactsim_rollout::Stream;

use super::Layout;

/// A type of map.
pub struct MapType {
    /// Id, such as `signalised-junction`.
    pub id: &'static str,
    /// One-line description.
    pub title: &'static str,
    /// Weight among the scenarios of the preset `train`, or among the requested types if some are. Weights are
    /// chosen so that junctions and motorways are about as frequent as in recordings (the train split of the
    /// Waymo Open Motion Dataset kept outside this repository: 8 of 196 scenes with motorway lanes).
    pub weight: f64,
    /// The same weight for the preset `sensed`, which has more junctions close to one another.
    pub sensed_weight: f64,
    /// Draws the road map. The result depends only on the stream.
    pub draw: fn(&mut Stream) -> Layout,
}

impl MapType {
    /// Returns the source that scenarios of this type state.
    pub fn source(&self) -> String {
        format!("generated/{}", self.id)
    }

    /// Draws a map, and the vehicles parked off its roads.
    pub fn layout(&self, rng: &mut Stream) -> Layout {
        let mut layout = (self.draw)(rng);
        yards::add(&mut layout, rng);
        layout
    }
}

/// The map types that scenarios are drawn from unless others are requested.
#[rustfmt::skip]
pub const MAP_TYPES: &[MapType] = &[
    MapType { id: "straight-road", title: "straight road of several lanes",
        weight: 2.0, sensed_weight: 4.0, draw: plain::straight },
    MapType { id: "curved-road", title: "winding road of several lanes",
        weight: 2.0, sensed_weight: 3.0, draw: plain::curved },
    MapType { id: "narrow-street", title: "narrow street between parked cars",
        weight: 3.0, sensed_weight: 2.0, draw: plain::narrow },
    MapType { id: "lane-drop", title: "road on which the rightmost lane ends",
        weight: 0.4, sensed_weight: 0.5, draw: lanes::dropped },
    MapType { id: "lane-addition", title: "road on which a lane begins on the right",
        weight: 0.4, sensed_weight: 0.5, draw: lanes::added },
    MapType { id: "on-ramp", title: "on-ramp with an acceleration lane",
        weight: 0.3, sensed_weight: 0.15, draw: motorway::on_ramp },
    MapType { id: "off-ramp", title: "off-ramp with a deceleration lane",
        weight: 0.3, sensed_weight: 0.15, draw: motorway::off_ramp },
    MapType { id: "weaving", title: "weaving section between two ramps",
        weight: 0.2, sensed_weight: 0.1, draw: motorway::weaving },
    MapType { id: "mid-block-crosswalk", title: "street with a crosswalk away from junctions",
        weight: 2.0, sensed_weight: 2.0, draw: crosswalk::mid_block },
    MapType { id: "driveways", title: "street with driveways",
        weight: 3.0, sensed_weight: 4.0, draw: driveways::driveways },
    MapType { id: "car-park-exit", title: "aisle of a car park that joins a street",
        weight: 4.0, sensed_weight: 3.0, draw: driveways::car_park },
    MapType { id: "signalised-protected", title: "four arms, lights, left turns with a phase of their own",
        weight: 5.0, sensed_weight: 3.0, draw: junctions::signalised_protected },
    MapType { id: "signalised-permissive", title: "four arms, lights, left turns give way",
        weight: 5.0, sensed_weight: 3.0, draw: junctions::signalised_permissive },
    MapType { id: "signalised-t", title: "three arms, lights",
        weight: 3.0, sensed_weight: 3.0, draw: junctions::signalised_t },
    MapType { id: "priority-t", title: "three arms, the minor road stops or gives way",
        weight: 4.0, sensed_weight: 4.0, draw: junctions::priority_t },
    MapType { id: "priority-four-way", title: "four arms, the minor road stops or gives way",
        weight: 4.0, sensed_weight: 4.0, draw: junctions::priority_four_way },
    MapType { id: "all-way-stop", title: "everybody stops",
        weight: 4.0, sensed_weight: 2.0, draw: junctions::all_way_stop },
    MapType { id: "roundabout-1", title: "a roundabout with one lane",
        weight: 0.5, sensed_weight: 0.5, draw: junctions::roundabout_one_lane },
    MapType { id: "roundabout-2", title: "a roundabout with two lanes",
        weight: 0.3, sensed_weight: 0.3, draw: junctions::roundabout_two_lanes },
    MapType { id: "signalised-pair", title: "two junctions with coordinated lights",
        weight: 2.5, sensed_weight: 4.0, draw: junctions::signalised_pair },
    MapType { id: "signalised-and-t",
        title: "a junction with lights, and one of three arms with a sign nearby",
        weight: 2.0, sensed_weight: 4.0, draw: junctions::signalised_and_t },
];

/// The map types that are drawn only if they are requested by id.
#[rustfmt::skip]
pub const ON_REQUEST: &[MapType] = &[
    MapType { id: "overpass", title: "road on a bridge above another road (only if requested)",
        weight: 1.0, sensed_weight: 1.0, draw: overpass::overpass },
];

/// Returns all map types, including those on request.
pub fn all() -> impl Iterator<Item = &'static MapType> {
    MAP_TYPES.iter().chain(ON_REQUEST)
}

/// Returns the map type with this id.
pub fn find(id: &str) -> Option<&'static MapType> {
    all().find(|m| m.id == id)
}
