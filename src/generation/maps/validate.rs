//! Checks of generated maps: what every [`Layout`] promises, rule by rule.

mod beside;
pub(super) mod crossing;
mod ground;
mod lanes;
mod people;
mod region;
mod right_of_way;
mod survey;
#[cfg(test)]
mod tests;

use super::super::Layout;
use crate::geometry::Vec2;
use survey::Survey;

/// What a map must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Ids of lanes are unique, and a centre line has at least two points.
    Id,
    /// Links exist and are mutual, ends meet and headings agree.
    Link,
    /// Centre lines bend no more than vehicles can turn, and do not cross themselves.
    CentreLine,
    /// The outline of a lane is simple and holds its centre line.
    Outline,
    /// Lanes lie on drivable ground.
    Drivable,
    /// Road edges have drivable ground on their left and none on their right.
    Edge,
    /// Neighbours are mutual, go the same way and lie side by side.
    Neighbour,
    /// Lanes that are no connectors do not overlap.
    Overlap,
    /// Stop lines lie on lanes.
    StopLine,
    /// Signal plans name lanes, have one cycle, and let nobody meet.
    Signal,
    /// Priorities name lanes that meet, and decide wherever no light does.
    Priority,
    /// Vehicles come in where lanes begin, and find a way out.
    Entry,
    /// Parked vehicles stand on drivable ground beside the lanes.
    Parking,
    /// People walk beside the road, and cross where it is said.
    Footway,
}

/// Something about a map that is not as it must be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{rule:?}: {what} at ({:.2}, {:.2}): {found}", place.x, place.y)]
pub struct Flaw {
    /// The rule that is broken.
    pub rule: Rule,
    /// The lane, edge, spot or footway.
    pub what: String,
    /// Where, metres.
    pub place: Vec2,
    /// What was found, with its value, and what it must be.
    pub found: String,
}

/// The flaws of a map, rule by rule; none for a sound one. Each rule tells the first flaw of each thing that breaks it.
pub fn validate(layout: &Layout) -> Vec<Flaw> {
    let mut flaws = Flaws::default();
    let survey = Survey::new(layout, &mut flaws);
    lanes::check(&survey, &mut flaws);
    beside::check(&survey, &mut flaws);
    ground::check(&survey, &mut flaws);
    right_of_way::check(&survey, &mut flaws);
    people::check(&survey, &mut flaws);
    flaws.found.sort_by_key(|flaw| flaw.rule);
    flaws.found
}

/// The flaws that were found so far.
#[derive(Default)]
struct Flaws {
    found: Vec<Flaw>,
}

impl Flaws {
    fn add(&mut self, rule: Rule, what: impl Into<String>, place: Vec2, found: impl Into<String>) {
        self.found.push(Flaw { rule, what: what.into(), place, found: found.into() });
    }
}
