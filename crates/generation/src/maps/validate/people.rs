//! Checks of footways and crossings.

use std::collections::BTreeSet;

use reactsim_geometry::{Polyline, Vec2, left, point_in_ring};

use super::survey::Survey;
use super::{Flaws, Rule};
use crate::heights::{height_at, on_different_levels};
use crate::maps::build::cross;

/// Distance, metres, within which ends of footways are joined.
const JOIN_DISTANCE: f64 = 3.0;
/// Maximum overlap of footways with the drivable ground, metres.
const TOUCH_TOLERANCE: f64 = 0.05;
/// Distance between tested points, metres.
const POINT_SPACING: f64 = 2.0;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    let footways = &survey.layout.footways;
    let ends = |line: &Polyline| [line.points()[0], line.points()[line.points().len() - 1]];
    for (i, footway) in footways.iter().enumerate() {
        let name = format!("footway {i}");
        let [first, last] = ends(&footway.line);
        if !(footway.width > 0.5 && footway.width < 10.0) {
            flaws.add(Rule::Footway, &name, first, format!("is {} m wide", footway.width));
        }
        if !footway.crossing {
            let half = 0.5 * footway.width;
            let points = (0..=(footway.line.length() / POINT_SPACING) as usize).flat_map(|k| {
                let s = k as f64 * POINT_SPACING;
                let (a, b) = footway.line.segment(footway.line.segment_at(s));
                let aside = left((b - a).normalize()) * half;
                let (p, height) = (footway.line.at(s), height_at(&footway.line, &footway.heights, s));
                [p, p + aside, p - aside].map(|p| (p, height))
            });
            let mut points = points.into_iter();
            if let Some((p, _)) = points.find(|&(p, z)| survey.well_drivable(p, z, TOUCH_TOLERANCE)) {
                flaws.add(Rule::Footway, &name, p, "is on drivable ground but is not a crossing");
            }
            if !(footway.crosses.is_empty() && footway.waits_for.is_empty()) {
                flaws.add(Rule::Footway, &name, first, "names lanes although it is no crossing");
            }
            continue;
        }
        for (end, s) in [(first, 0.0), (last, footway.line.length())] {
            let other = footways.iter().enumerate().filter(|(j, _)| *j != i);
            let nearest = other
                .flat_map(|(_, f)| ends(&f.line))
                .map(|p| (p - end).norm())
                .fold(f64::INFINITY, f64::min);
            if nearest > JOIN_DISTANCE {
                let found = format!("ends {nearest:.2} m from other footways, expected at most 3 m");
                flaws.add(Rule::Footway, &name, end, found);
            }
            let height = height_at(&footway.line, &footway.heights, s);
            if survey.well_drivable(end, height, TOUCH_TOLERANCE) {
                flaws.add(Rule::Footway, &name, end, "the crossing ends on drivable ground");
            }
        }
        crossed(survey, i, &name, flaws);
    }
}

fn crossed(survey: &Survey<'_>, i: usize, name: &str, flaws: &mut Flaws) {
    let footway = &survey.layout.footways[i];
    let first = footway.line.points()[0];
    let named: BTreeSet<usize> = footway.crosses.iter().map(|id| survey.find(id)).collect();
    for (i, lane) in survey.lanes.iter().enumerate() {
        let height = |p: Vec2| height_at(&footway.line, &footway.heights, footway.line.project(p).s);
        let at = meets(&footway.line, &lane.line)
            .filter(|&at| !on_different_levels(height(at), lane.height(at), 0.0));
        match (at, named.contains(&i)) {
            (Some(at), false) => {
                flaws.add(Rule::Footway, name, at, format!("crosses lane `{}` without naming it", lane.id()));
            }
            (None, true) => {
                flaws.add(Rule::Footway, name, first, format!("does not cross lane `{}`", lane.id()));
            }
            _ => {}
        }
    }
    for id in &footway.waits_for {
        if !survey.layout.signals.iter().any(|s| s.lane == *id) {
            flaws.add(Rule::Footway, name, first, format!("waits for `{id}`, which has no light"));
        }
    }
    let middle = footway.line.at(0.5 * footway.line.length());
    let painted =
        survey.layout.map.crosswalks.iter().any(|c| point_in_ring(middle, &c.outline) == Some(true));
    if !painted {
        flaws.add(Rule::Footway, name, middle, "no crosswalk of the map is under the crossing");
    }
}

/// Returns an intersection of two lines.
fn meets(a: &Polyline, b: &Polyline) -> Option<Vec2> {
    let of = |line: &Polyline| reactsim_geometry::Bounds::of(line.points().iter().copied());
    if !of(a).intersects(&of(b)) {
        return None;
    }
    let within = |p: &[Vec2]| p.windows(2).map(|w| (w[0], w[1])).collect::<Vec<_>>();
    let others = within(b.points());
    within(a.points()).iter().find_map(|&(p, q)| others.iter().find_map(|&(r, s)| cross(p, q, r, s)))
}
