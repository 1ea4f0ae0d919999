//! Validation of generated maps: the rules that every [`Layout`] must satisfy. Objects on different levels
//! neither meet nor overlap.

mod beside;
pub(super) mod crossing;
mod ground;
mod heights;
mod lanes;
mod people;
mod region;
mod right_of_way;
mod survey;
#[cfg(test)]
mod tests;

use reactsim_geometry::Vec2;

use super::super::Layout;
use survey::Survey;

/// A rule for maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Lane ids are unique, and centre lines have at least two points.
    Id,
    /// Links exist and are mutual; linked ends meet, and their headings agree.
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
    /// Signal plans name existing lanes, have a common cycle, and never release conflicting lanes.
    Signal,
    /// Priorities name lanes that meet, and decide wherever no light does.
    Priority,
    /// Vehicles enter where lanes begin, and a route leads out of the map.
    Entry,
    /// Parked vehicles are on drivable ground clear of the lanes.
    Parking,
    /// Footways are off the road, and crossings name the lanes that they cross.
    Footway,
    /// Heights, if any, are known everywhere; they agree where lanes are linked, and lanes rise gently.
    Height,
}

/// A violation of a rule.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{rule:?}: {what} at ({:.2}, {:.2}): {found}", place.x, place.y)]
pub struct Flaw {
    /// The violated rule.
    pub rule: Rule,
    /// The lane, edge, spot or footway.
    pub what: String,
    /// Position, metres.
    pub place: Vec2,
    /// The offending value, and the expected one.
    pub found: String,
}

/// Returns the flaws of a map, ordered by rule; none for a valid map. Each rule reports the first flaw of
/// each object that violates it.
pub fn validate(layout: &Layout) -> Vec<Flaw> {
    let mut flaws = Flaws::default();
    let survey = Survey::new(layout, &mut flaws);
    lanes::check(&survey, &mut flaws);
    beside::check(&survey, &mut flaws);
    ground::check(&survey, &mut flaws);
    right_of_way::check(&survey, &mut flaws);
    people::check(&survey, &mut flaws);
    heights::check(&survey, &mut flaws);
    flaws.found.sort_by_key(|flaw| flaw.rule);
    flaws.found
}

/// The flaws found so far.
#[derive(Default)]
struct Flaws {
    found: Vec<Flaw>,
}

impl Flaws {
    fn add(&mut self, rule: Rule, what: impl Into<String>, place: Vec2, found: impl Into<String>) {
        self.found.push(Flaw { rule, what: what.into(), place, found: found.into() });
    }
}
