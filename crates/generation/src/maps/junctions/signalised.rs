//! Signalised junctions.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;

use super::control::{Phase, Plan};
use super::draw::{Kind, arm, arm_path, headings, lay, pavement, section};
use super::street::End;
use crate::maps::build::{MapBuilder, mph};
use crate::{Draw, Layout};

/// Returns the yellow time of a road with this limit (mph), seconds, rounded to tenths: reaction and
/// braking at 10 feet per second squared.
pub(super) fn yellow(limit: f64) -> f64 {
    (10.0 * (1.0 + mph(limit) / (2.0 * 3.05))).round().clamp(30.0, 50.0) / 10.0
}

/// Draws a phase of a road with this limit (mph), with a green time in the given range (seconds).
pub(super) fn phase(rng: &mut Stream, axis: usize, left: bool, limit: f64, green: (f64, f64)) -> Phase {
    let tenths = |v: f64| (10.0 * v).round() / 10.0;
    Phase {
        axis,
        left,
        green: tenths(rng.uniform(green.0, green.1)),
        yellow: if left { 3.0 } else { yellow(limit) },
        all_red: tenths(rng.uniform(1.0, 2.0)),
    }
}

/// Draws a plan from its phases, with a random offset in its cycle.
pub(super) fn plan(rng: &mut Stream, phases: Vec<Phase>) -> Plan {
    let mut plan = Plan { phases, offset: 0.0 };
    let short = 50.0 - plan.cycle();
    if short > 0.0 {
        plan.phases[0].green += short;
    }
    plan.offset = (10.0 * rng.uniform(0.0, plan.cycle())).round() / 10.0;
    plan
}

/// Draws a road that is likely to be signalised.
pub(super) fn kind(rng: &mut Stream, pocket: bool) -> Kind {
    let lanes = 1 + rng.weighted(if pocket { &[1.0, 2.0, 1.0] } else { &[2.0, 1.5, 0.0] });
    let limit = *rng.pick(if lanes == 1 { &[25.0, 30.0, 35.0] } else { &[30.0, 35.0, 40.0, 45.0] });
    // A raised median next to a pocket is still an island.
    let raised = pocket && lanes > 1 && rng.chance(0.5);
    let median = if raised { rng.uniform(5.0, 5.8) } else { rng.uniform(4.2, 5.2) };
    Kind {
        lanes,
        limit,
        median: pocket.then_some(median),
        raised,
        bike: rng.chance(0.35),
        parking: limit <= 30.0 && rng.chance(0.5),
        flow: rng.uniform(250.0, 450.0) / if lanes > 2 { 1.3 } else { 1.0 },
    }
}

/// Draws the end of an arm at the junction, with pockets.
pub(super) fn end(rng: &mut Stream, kind: &Kind, right_turns: bool) -> End {
    let (left, right) = (rng.uniform(35.0, 60.0), rng.uniform(30.0, 50.0));
    let pocket = rng.chance(0.3) && !kind.bike && right_turns;
    End::Junction { left: kind.median.map(|_| left), right: pocket.then_some(right) }
}

/// Draws four arms whose left turns have their own phase, on both roads or on the first one.
pub(crate) fn signalised_protected(rng: &mut Stream) -> Layout {
    let both = rng.chance(0.6);
    four_way(rng, [true, both], [true, both])
}

/// Draws four arms whose left turns yield to oncoming traffic.
pub(crate) fn signalised_permissive(rng: &mut Stream) -> Layout {
    let pocket = rng.chance(0.4);
    four_way(rng, [pocket, false], [false; 2])
}

fn four_way(rng: &mut Stream, pockets: [bool; 2], protected: [bool; 2]) -> Layout {
    let mut b = MapBuilder::new();
    let kinds = pockets.map(|pocket| kind(rng, pocket));
    let paved = pavement(rng, 0.9);
    let headings = headings(rng);
    let sections = kinds.map(|k| section(rng, &k, paved));
    let streets = [0, 1, 2, 3].map(|i| {
        let (kind, path) = (&kinds[i % 2], arm_path(rng, Vec2::zeros(), headings[i], true));
        let end = end(rng, kind, true);
        Some(arm(format!("a{i}"), path, sections[i % 2], end, kind.flow))
    });
    let crosswalks = [0; 4].map(|_| paved.is_some() && rng.chance(0.9));
    let (junction, movements) = lay(&mut b, rng, streets, (7.0, 10.0), crosswalks);
    let mut phases = Vec::new();
    for axis in [0, 1] {
        if protected[axis] {
            phases.push(phase(rng, axis, true, kinds[axis].limit, (8.0, 13.0)));
        }
        phases.push(phase(rng, axis, false, kinds[axis].limit, (16.0, 34.0)));
    }
    let plan = plan(rng, phases);
    plan.apply(&mut b, &movements);
    junction.walks(&mut b, |slot| plan.waits(&movements, slot));
    b.finish()
}

/// Draws three arms: a road that continues (arms 0 and 2), and one that ends there.
pub(crate) fn signalised_t(rng: &mut Stream) -> Layout {
    let mut b = MapBuilder::new();
    let pocket = rng.chance(0.6);
    let major = kind(rng, pocket);
    let drawn = kind(rng, false);
    let stem = Kind { bike: false, raised: false, lanes: drawn.lanes.min(2), ..drawn };
    let kinds = [major, stem];
    let paved = pavement(rng, 0.9);
    let headings = headings(rng);
    let sections = kinds.map(|k| section(rng, &k, paved));
    let streets = [0, 1, 2].map(|i| {
        let (kind, path) = (&kinds[i % 2], arm_path(rng, Vec2::zeros(), headings[i], true));
        // Arm 0 turns right into the stem, arm 2 left.
        let drawn = end(rng, kind, i == 0 || i == 1 && stem.lanes == 1);
        let end = match drawn {
            End::Junction { right, .. } if i == 0 => End::Junction { left: None, right },
            other => other,
        };
        Some(arm(format!("a{i}"), path, sections[i % 2], end, kind.flow))
    });
    let [first, second, third] = streets;
    let crosswalks = [0; 4].map(|_| paved.is_some() && rng.chance(0.85));
    let (junction, movements) = lay(&mut b, rng, [first, second, third, None], (7.0, 10.0), crosswalks);
    let mut phases = Vec::new();
    if pocket && rng.chance(0.5) {
        phases.push(phase(rng, 0, true, major.limit, (8.0, 13.0)));
    }
    phases.push(phase(rng, 0, false, major.limit, (20.0, 38.0)));
    phases.push(phase(rng, 1, false, stem.limit, (12.0, 24.0)));
    let plan = plan(rng, phases);
    plan.apply(&mut b, &movements);
    junction.walks(&mut b, |slot| plan.waits(&movements, slot));
    b.finish()
}
