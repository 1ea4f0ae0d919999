//! Validation of generated maps: the rules that every [`Layout`] must satisfy. Objects on different levels
//! neither meet nor overlap. Lanes that are named but do not exist, and centre lines without extent, end the
//! validation.

mod beside;
mod crossing;
mod ground;
mod heights;
mod lanes;
mod people;
mod right_of_way;
mod survey;
mod tests;

use std::fmt::Display;

use reactsim_geometry::Vec2;

use super::super::Layout;
use survey::Survey;

/// A rule for maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    /// Links are mutual; linked ends meet, and their headings agree.
    Link,
    /// Centre lines bend no more than vehicles can turn, and do not cross themselves.
    CentreLine,
    /// Outlines of lanes are simple and contain the centre line.
    Outline,
    /// Lanes are on drivable ground.
    Drivable,
    /// Road edges have drivable ground on their left and none on their right.
    Edge,
    /// Neighbours are mutual, have the same direction and are side by side.
    Neighbour,
    /// Lanes other than connectors do not overlap.
    Overlap,
    /// Stop lines are on lanes.
    StopLine,
    /// Signal plans have a common cycle, and never release conflicting lanes.
    Signal,
    /// Priorities name lanes that meet, and decide wherever no light does.
    Priority,
    /// Vehicles enter where lanes begin, and a route leads out of the map.
    Entry,
    /// Parked vehicles are on drivable ground clear of the lanes.
    Parking,
    /// Footways are off the road, and crossings name the lanes that they cross.
    Footway,
    /// Heights, if any, agree where lanes are linked, and lanes rise gently.
    Height,
}

/// A violation of a rule: the lane, edge, spot or footway, its position, the offending value and the expected
/// one.
#[derive(Debug, PartialEq)]
pub(super) struct Flaw {
    pub(super) rule: Rule,
    text: String,
}

/// Returns the flaws of a map; none for a valid map. Each rule reports the first flaw of each object that
/// violates it.
pub(super) fn validate(layout: &Layout) -> Vec<Flaw> {
    let mut flaws = Flaws(Vec::new());
    let survey = Survey::new(layout);
    lanes::check(&survey, &mut flaws);
    beside::check(&survey, &mut flaws);
    ground::check(&survey, &mut flaws);
    right_of_way::check(&survey, &mut flaws);
    people::check(&survey, &mut flaws);
    heights::check(&survey, &mut flaws);
    flaws.0
}

/// The flaws found so far.
struct Flaws(Vec<Flaw>);

impl Flaws {
    fn add(&mut self, rule: Rule, what: impl Display, place: Vec2, found: impl Display) {
        let text = format!("{what} at ({:.2}, {:.2}): {found}", place.x, place.y);
        self.0.push(Flaw { rule, text });
    }
}
