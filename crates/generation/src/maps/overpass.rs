//! A road on a bridge above another road.
//!
//! Further sources: AASHTO, A Policy on Geometric Design of Highways and Streets
//! (7th edition, 2018): a vertical clearance of 16 ft over arterials, grades of up to 5 to 7 % on urban
//! arterials, and rates of vertical curvature `K`, by which a curve of length `K A` changes the grade by `A`
//! percent. The larger one, that of sag curves, applies to crests as well.

use std::f64::consts::{FRAC_PI_3, PI};

use reactsim_geometry::{Vec2, direction};
use reactsim_rollout::Stream;
use reactsim_scene::{LaneClass, MapHeights};

use super::build::{Direction, Path, Road, Side, on_grid};
use super::lanes::gentle;
use super::plain::{any_section, whole};
use super::ranges::{centred, street};
use crate::{Draw, Layout};

/// Minimum height of the bridge's surface above the road below, metres: a clearance of 4.9 m and a structure
/// of 1.1 m.
const MIN_RISE: f64 = 6.0;
/// Maximum height of the bridge's surface above the road below, metres.
const MAX_RISE: f64 = 7.0;
/// Minimum grade of the ramps along the reference line.
const MIN_GRADE: f64 = 0.035;
/// Maximum grade of the ramps along the reference line: inner lanes of bends are up to a tenth steeper, and
/// stay below 5 %.
const MAX_GRADE: f64 = 0.045;
/// Rate of vertical curvature of sag curves, ft per percent, by speed in mph.
const CURVATURE_RATES: [(f64, f64); 5] =
    [(25.0, 26.0), (30.0, 37.0), (35.0, 49.0), (40.0, 64.0), (45.0, 79.0)];
/// Maximum distance between points with heights, metres.
const POINT_SPACING: f64 = 5.0;
/// Resolution of heights, metres: a power of two, like that of other coordinates.
const HEIGHT_STEP: f64 = 1.0 / 8192.0;

/// Draws a street on a bridge above another street or a motorway.
pub(super) fn overpass(rng: &mut Stream) -> Layout {
    let (section, speed) = any_section(rng);
    let freeway = section.class == LaneClass::Freeway;
    let length = if freeway { rng.uniform(850.0, 1000.0) } else { rng.uniform(500.0, 620.0) };
    let path = gentle(rng, length, speed);
    let middle = 0.5 * path.length();
    let below = Road::new(centred(path, middle, rng), section);
    let angle = rng.uniform(FRAC_PI_3, 2.0 * FRAC_PI_3);

    let (mut section, speed) = street(rng, (1, 2));
    // Nobody parks on a bridge.
    section.forward.parking = None;
    section.backward = section.backward.map(|side| Side { parking: None, ..side });
    let level = Road::new(Path::straight(1.0), section);
    // The deck covers the whole road below, along both sides of the bridge.
    let across = direction(angle);
    let deck = (half_width(&below) + half_width(&level) * across.x.abs()) / across.y;
    let bridge = Bridge::draw(rng, deck, speed);
    let length = 2.0 * (bridge.reach() + rng.uniform(25.0, 60.0));
    let path = gentle(rng, length, speed);
    let heading = below.path.at(middle).heading + angle + if rng.chance(0.5) { PI } else { 0.0 };
    let middle = 0.5 * path.length();
    let above = Road::new(path.placed(middle, Vec2::zeros(), heading), section);

    let mut low = whole(rng, &below, "below").finish();
    let mut high = whole(rng, &above, "above").finish();
    set_heights(&mut low, |_| 0.0);
    set_heights(&mut high, |p| bridge.height((above.path.nearest(p) - middle).abs()));
    append(&mut low, high);
    low
}

/// Returns the distance from the reference line of a road to its outer border, with pavements, metres.
fn half_width(road: &Road) -> f64 {
    let of = |direction: Direction, side: Option<Side>| {
        let beyond = side.and_then(|s| s.pavement).map_or(0.0, |p| 0.5 * p.width);
        road.kerb(direction).abs().max(road.pavement_offset(direction).abs()) + beyond
    };
    let (forward, backward) = (Some(road.section.forward), road.section.backward);
    of(Direction::Forward, forward).max(of(Direction::Backward, backward))
}

/// The elevation of a bridge, symmetrical about its middle: a level deck, and on either side a crest curve,
/// a constant grade and a sag curve. Curves are parabolas.
struct Bridge {
    /// Height of the deck, metres.
    rise: f64,
    /// Slope between the curves.
    grade: f64,
    /// Length of each vertical curve, metres.
    curve: f64,
    /// Half the length of the deck, metres.
    deck: f64,
}

impl Bridge {
    /// Draws a bridge whose deck extends some metres beyond `least` on both sides, for this speed (mph).
    fn draw(rng: &mut Stream, least: f64, speed: f64) -> Self {
        let (rise, grade) = (rng.uniform(MIN_RISE, MAX_RISE), rng.uniform(MIN_GRADE, MAX_GRADE));
        let rate = CURVATURE_RATES.iter().find(|(v, _)| *v >= speed).map_or(79.0, |e| e.1);
        // A curve that is longer than the ramp between the ends of the grade would not reach the grade.
        let curve = (0.3048 * rate * 100.0 * grade).min(rise / grade);
        Self { rise, grade, curve, deck: least + rng.uniform(6.0, 15.0) }
    }

    /// Returns the length of a ramp with both curves, metres.
    fn ramp(&self) -> f64 {
        self.rise / self.grade + self.curve
    }

    /// Returns the distance from the middle of the bridge to the end of a ramp, metres.
    fn reach(&self) -> f64 {
        self.deck + self.ramp()
    }

    /// Returns the height at a distance from the middle of the bridge, metres.
    fn height(&self, distance: f64) -> f64 {
        let (from_deck, to_ground) = (distance - self.deck, self.reach() - distance);
        let bend = |x: f64| 0.5 * self.grade * x * x / self.curve;
        if from_deck <= 0.0 {
            self.rise
        } else if to_ground <= 0.0 {
            0.0
        } else if from_deck < self.curve {
            self.rise - bend(from_deck)
        } else if to_ground < self.curve {
            bend(to_ground)
        } else {
            self.rise - self.grade * (from_deck - 0.5 * self.curve)
        }
    }
}

/// Sets the heights of all objects on a map, and adds points to edges and ground where they are too far
/// apart to describe the heights between them.
fn set_heights(layout: &mut Layout, height: impl Fn(Vec2) -> f64) {
    let map = &mut layout.map;
    for edge in &mut map.road_edges {
        edge.points = dense(&edge.points);
    }
    for ring in map.drivable_area.iter_mut().flatten().map(|p| &mut p.exterior) {
        let first = ring[0];
        ring.push(first);
        *ring = dense(ring);
        ring.pop();
    }
    let of = |points: &[Vec2]| -> Vec<f64> {
        points.iter().map(|&p| (height(p) / HEIGHT_STEP).round() * HEIGHT_STEP).collect()
    };
    map.heights = MapHeights {
        lanes: map.lanes.iter().map(|l| of(&l.points)).collect(),
        road_edges: map.road_edges.iter().map(|e| of(&e.points)).collect(),
        road_lines: map.road_lines.iter().map(|l| of(&l.points)).collect(),
        crosswalks: map.crosswalks.iter().map(|c| of(&c.outline)).collect(),
        speed_bumps: map.speed_bumps.iter().map(|s| of(&s.outline)).collect(),
        driveways: map.driveways.iter().map(|s| of(&s.outline)).collect(),
        drivable_area: map.drivable_area.iter().flatten().map(|p| of(&p.exterior)).collect(),
    };
    for footway in &mut layout.footways {
        footway.heights = of(footway.line.points());
    }
}

/// Returns the line with additional points, so that none are farther apart than [`POINT_SPACING`].
fn dense(points: &[Vec2]) -> Vec<Vec2> {
    let mut out = vec![points[0]];
    for pair in points.windows(2) {
        let count = ((pair[1] - pair[0]).norm() / POINT_SPACING).ceil().max(1.0);
        out.extend((1..count as usize).map(|k| on_grid(pair[0] + (pair[1] - pair[0]) * (k as f64 / count))));
        out.push(pair[1]);
    }
    out
}

/// Adds another map, with which this one shares no lane.
fn append(layout: &mut Layout, other: Layout) {
    let (map, more) = (&mut layout.map, other.map);
    map.lanes.extend(more.lanes);
    map.road_edges.extend(more.road_edges);
    map.road_lines.extend(more.road_lines);
    map.stop_lines.extend(more.stop_lines);
    map.crosswalks.extend(more.crosswalks);
    map.speed_bumps.extend(more.speed_bumps);
    map.driveways.extend(more.driveways);
    map.intersections.extend(more.intersections);
    map.drivable_area.get_or_insert_default().extend(more.drivable_area.into_iter().flatten());
    map.heights.lanes.extend(more.heights.lanes);
    map.heights.road_edges.extend(more.heights.road_edges);
    map.heights.road_lines.extend(more.heights.road_lines);
    map.heights.crosswalks.extend(more.heights.crosswalks);
    map.heights.speed_bumps.extend(more.heights.speed_bumps);
    map.heights.driveways.extend(more.heights.driveways);
    map.heights.drivable_area.extend(more.heights.drivable_area);
    layout.signals.extend(other.signals);
    layout.priorities.extend(other.priorities);
    layout.entries.extend(other.entries);
    layout.parking.extend(other.parking);
    layout.footways.extend(other.footways);
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};
    use reactsim_scene::levels::LEVEL_GAP;

    use super::*;
    use crate::maps::build::cross;
    use crate::maps::validate::{Rule, validate};

    #[test]
    fn a_bridge_is_continuous_and_within_its_grade() {
        let mut rng = stream(0, "bridge", 0, Purpose::Map);
        for speed in [25.0, 30.0, 35.0, 40.0, 45.0] {
            let bridge = Bridge::draw(&mut rng, 15.0, speed);
            let heights: Vec<f64> = (0..4000).map(|i| bridge.height(0.1 * f64::from(i))).collect();
            assert_eq!((heights[0], heights[3999]), (bridge.rise, 0.0), "{speed} mph");
            let slopes: Vec<f64> = heights.windows(2).map(|w| (w[0] - w[1]) / 0.1).collect();
            assert!(slopes.iter().all(|s| (-1e-9..bridge.grade + 1e-9).contains(s)), "{speed} mph");
            assert!(slopes.windows(2).all(|w| (w[1] - w[0]).abs() < 0.0005), "{speed} mph: a kink");
            assert!(slopes.iter().any(|s| *s > bridge.grade - 1e-6), "{speed} mph");
        }
    }

    /// Returns the heights of both roads at the crossings of their centre lines.
    fn crossings(layout: &Layout) -> Vec<(f64, f64)> {
        let lanes = || layout.map.lanes.iter().zip(&layout.map.heights.lanes);
        let mut found = Vec::new();
        for (low, z) in lanes().filter(|(l, _)| l.id.starts_with("below")) {
            for (high, up) in lanes().filter(|(l, _)| l.id.starts_with("above")) {
                for (i, a) in low.points.windows(2).enumerate() {
                    for (k, b) in high.points.windows(2).enumerate() {
                        if cross(a[0], a[1], b[0], b[1]).is_some() {
                            found.push((z[i], up[k]));
                        }
                    }
                }
            }
        }
        found
    }

    #[test]
    fn every_lane_crosses_every_lane_of_the_other_road_on_another_level() {
        for seed in 0..60 {
            let layout = overpass(&mut stream(seed, "overpass", 0, Purpose::Map));
            let of = |name: &str| layout.map.lanes.iter().filter(|l| l.id.starts_with(name)).count();
            let found = crossings(&layout);
            assert_eq!(found.len(), of("below") * of("above"), "seed {seed}");
            for (low, high) in found {
                assert!(
                    low == 0.0 && (MIN_RISE - 0.01..MAX_RISE + 0.01).contains(&high),
                    "seed {seed}: {high}"
                );
                assert!(high - low > LEVEL_GAP);
            }
            assert!(layout.priorities.is_empty());
        }
    }

    #[test]
    fn without_heights_the_roads_would_conflict() {
        let mut layout = overpass(&mut stream(0, "overpass", 0, Purpose::Map));
        assert_eq!(validate(&layout), []);
        layout.map.heights = MapHeights::default();
        layout.footways.iter_mut().for_each(|f| f.heights.clear());
        let rules: Vec<Rule> = validate(&layout).iter().map(|flaw| flaw.rule).collect();
        for rule in [Rule::Overlap, Rule::Priority, Rule::Edge] {
            assert!(rules.contains(&rule), "{rule:?} is not in {rules:?}");
        }
    }
}
