//! Junctions with signs.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;

use super::control::{all_way, signs};
use super::draw::{Kind, arm, arm_path, headings, lay, pavement, section};
use super::street::End;
use crate::maps::build::MapBuilder;
use crate::{Draw, Layout};

/// Draws a major road, which has the right of way.
fn major(rng: &mut Stream) -> Kind {
    let lanes = 1 + rng.weighted(&[3.0, 1.0]);
    let limit = *rng.pick(if lanes == 1 { &[25.0, 30.0, 35.0, 40.0] } else { &[30.0, 35.0, 40.0] });
    let pocket = rng.chance(0.3);
    Kind {
        lanes,
        limit,
        median: pocket.then(|| rng.uniform(4.0, 4.8)),
        raised: false,
        bike: rng.chance(0.3),
        parking: limit <= 30.0 && rng.chance(0.5),
        flow: rng.uniform(250.0, 450.0) / lanes as f64,
    }
}

/// Draws a minor road, which yields.
fn minor(rng: &mut Stream) -> Kind {
    Kind {
        lanes: 1,
        limit: *rng.pick(&[25.0, 25.0, 30.0]),
        median: None,
        raised: false,
        bike: false,
        parking: rng.chance(0.5),
        flow: rng.uniform(100.0, 250.0),
    }
}

fn end(rng: &mut Stream, kind: &Kind, left_turns: bool) -> End {
    let length = rng.uniform(30.0, 45.0);
    End::Junction { left: kind.median.filter(|_| left_turns).map(|_| length), right: None }
}

/// Draws a three-arm junction: the road that ends there stops or yields.
pub(crate) fn priority_t(rng: &mut Stream) -> Layout {
    priority(rng, false)
}

/// Draws a four-arm junction: the minor road stops or yields.
pub(crate) fn priority_four_way(rng: &mut Stream) -> Layout {
    priority(rng, true)
}

fn priority(rng: &mut Stream, four: bool) -> Layout {
    let mut b = MapBuilder::new();
    let kinds = [major(rng), minor(rng)];
    let paved = pavement(rng, 0.75);
    let headings = headings(rng);
    let sections = kinds.map(|k| section(rng, &k, paved));
    let streets = [0, 1, 2, 3].map(|i| {
        let (kind, path) = (&kinds[i % 2], arm_path(rng, Vec2::zeros(), headings[i], true));
        let end = end(rng, kind, four || i == 2);
        (four || i < 3).then(|| arm(format!("a{i}"), path, sections[i % 2], end, kind.flow))
    });
    // Mostly across the minor road, which has marked crosswalks more often than the major one.
    let crosswalks = [0, 1, 2, 3].map(|i| rng.chance(if i % 2 == 1 { 0.8 } else { 0.25 }) && paved.is_some());
    let (junction, movements) = lay(&mut b, rng, streets, (6.0, 9.0), crosswalks);
    let stop = rng.chance(if four { 0.9 } else { 0.75 });
    signs(&mut b, &movements, 0, stop);
    junction.walks(&mut b, |_| Vec::new());
    b.finish()
}

/// Draws a junction of four arms (sometimes three) at which everybody stops.
pub(crate) fn all_way_stop(rng: &mut Stream) -> Layout {
    let mut b = MapBuilder::new();
    let four = rng.chance(0.8);
    let kinds = [0, 1].map(|axis| Kind {
        lanes: if axis == 0 && rng.chance(0.25) { 2 } else { 1 },
        limit: *rng.pick(&[25.0, 25.0, 30.0, 35.0]),
        median: None,
        raised: false,
        bike: rng.chance(0.2),
        parking: rng.chance(0.55),
        flow: rng.uniform(200.0, 350.0),
    });
    let kinds = kinds.map(|k| Kind { flow: k.flow / k.lanes as f64, bike: k.bike && four, ..k });
    let paved = pavement(rng, 0.85);
    let headings = headings(rng);
    let sections = kinds.map(|k| section(rng, &k, paved));
    let streets = [0, 1, 2, 3].map(|i| {
        let (kind, path) = (&kinds[i % 2], arm_path(rng, Vec2::zeros(), headings[i], true));
        (four || i < 3).then(|| arm(format!("a{i}"), path, sections[i % 2], End::PLAIN, kind.flow))
    });
    let crosswalks = [0; 4].map(|_| rng.chance(0.75) && paved.is_some());
    let (junction, movements) = lay(&mut b, rng, streets, (6.0, 8.5), crosswalks);
    all_way(&mut b, &movements);
    junction.walks(&mut b, |_| Vec::new());
    b.finish()
}
