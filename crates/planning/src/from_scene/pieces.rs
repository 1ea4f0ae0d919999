//! Lanes, cut where the lanes beside them are cut.
//!
//! In the maps of nuPlan all lanes of a road begin and end at the same places, so that the roadblocks of a
//! road follow one another. Other maps cut every lane for itself. A lane that continues beside a cut would be
//! in one roadblock with the lane before the cut and with the lane after it.

use std::collections::BTreeSet;

use reactsim_geometry::{Polyline, Vec2};
use reactsim_scene::{LANE_HALF_WIDTH, Lane, LaneArea, LaneClass, LaneKind, RoadMap};

/// Distance in metres up to which ends of lanes side by side count as the same place. Stop lines are not
/// perpendicular to the road, so recorded ends differ by some metres.
const SAME_PLACE: f64 = 5.0;
/// Distance in metres between first or last points of two lanes up to which the lanes are branches: a
/// half-width.
const SAME_POINT: f64 = LANE_HALF_WIDTH;
/// Largest distance in metres between the centre lines of lanes side by side: wide lanes with a median
/// between.
const MAX_DISTANCE: f64 = 8.0;
/// Distance in metres between the points at which two lanes are compared.
const STEP: f64 = 2.0;
/// Largest number of points at which two lanes are compared.
const MAX_POINTS: f64 = 64.0;
/// Number of halvings that place a point of an outline on a cut: 2⁻⁴⁰ of an edge.
const HALVINGS: usize = 40;

/// The lanes of a planning map.
#[derive(Debug)]
pub(super) struct Pieces {
    /// Lanes and parts of lanes, in map order, with links to one another. Neighbours are left out: they are
    /// in [`Self::beside`].
    pub(super) lanes: Vec<Lane>,
    /// Index of the lane in the map of the scenario, per piece.
    pub(super) origins: Vec<usize>,
    /// Pairs of pieces that are side by side over more than half of the shorter one, with how parallel they
    /// are, 0 to 1; the smaller index first.
    pub(super) beside: Vec<(usize, usize, f64)>,
}

impl Pieces {
    /// Cuts the lanes of a map, without lanes for bicycles only.
    pub(super) fn of(map: &RoadMap) -> Self {
        let origins: Vec<usize> =
            (0..map.lanes.len()).filter(|&i| map.lanes[i].class != LaneClass::Bike).collect();
        let lanes: Vec<&Lane> = origins.iter().map(|&i| &map.lanes[i]).collect();
        let neighbors = neighbors(&lanes, &origins);
        let cuts = cuts(&lanes, &neighbors);
        Self::cut(&lanes, &origins, &neighbors, &cuts)
    }

    /// Cuts `lanes` at the arc lengths `cuts`.
    fn cut(
        lanes: &[&Lane],
        origins: &[usize],
        neighbors: &BTreeSet<(usize, usize)>,
        cuts: &[Vec<f64>],
    ) -> Self {
        let firsts: Vec<usize> =
            cuts.iter().scan(0, |next, cuts| Some(std::mem::replace(next, *next + cuts.len() + 1))).collect();
        let first = |lane: &usize| origins.binary_search(lane).ok().map(|lane| firsts[lane]);
        let last =
            |lane: &usize| origins.binary_search(lane).ok().map(|lane| firsts[lane] + cuts[lane].len());
        let mut pieces = Self { lanes: Vec::new(), origins: Vec::new(), beside: Vec::new() };
        for (i, lane) in lanes.iter().enumerate() {
            for k in 0..=cuts[i].len() {
                let mut piece = piece(lane, &cuts[i], k);
                let index = firsts[i] + k;
                piece.predecessors = match k {
                    0 => lane.predecessors.iter().filter_map(last).collect(),
                    _ => vec![index - 1],
                };
                piece.successors = match k {
                    k if k < cuts[i].len() => vec![index + 1],
                    _ => lane.successors.iter().filter_map(first).collect(),
                };
                pieces.lanes.push(piece);
                pieces.origins.push(origins[i]);
            }
        }
        let of = |lane: usize| firsts[lane]..=firsts[lane] + cuts[lane].len();
        for &(a, b) in neighbors {
            for (a, b) in of(a).flat_map(|a| of(b).map(move |b| (a, b))) {
                let [one, other] = [a, b].map(|lane| &pieces.lanes[lane].baseline);
                let (short, long) = if one.length() <= other.length() { (one, other) } else { (other, one) };
                let share = shared(short, long);
                if share > 0.5 {
                    pieces.beside.push((a, b, share * parallelism(short, long)));
                }
            }
        }
        pieces
    }
}

/// Returns the pairs of neighbouring lanes, by index into `lanes`, the smaller one first. Connectors of maps
/// that have other lanes too have no neighbours, and branches are not neighbours of one another.
fn neighbors(lanes: &[&Lane], origins: &[usize]) -> BTreeSet<(usize, usize)> {
    let has_lanes = lanes.iter().any(|lane| lane.kind == LaneKind::Lane);
    let is_cut = |lane: usize| !has_lanes || lanes[lane].kind == LaneKind::Lane;
    let pairs = lanes.iter().enumerate().flat_map(|(i, lane)| {
        let others = lane.left.iter().chain(&lane.right);
        others.filter_map(move |other| Some((i, origins.binary_search(&other.lane).ok()?)))
    });
    let pairs = pairs.filter(|&(a, b)| a != b && is_cut(a) && is_cut(b) && !branch(lanes[a], lanes[b]));
    pairs.map(|(a, b)| (a.min(b), a.max(b))).collect()
}

/// Returns whether two lanes are branches of a fork or of a merge: they begin, or end, at the same point.
pub(super) fn branch(a: &Lane, b: &Lane) -> bool {
    let [a, b] = [a, b].map(|lane| lane.baseline.points());
    (a[0] - b[0]).norm() < SAME_POINT || (a[a.len() - 1] - b[b.len() - 1]).norm() < SAME_POINT
}

/// Returns the arc lengths in increasing order at which each lane is cut: where a lane beside it begins, ends
/// or is cut itself.
fn cuts(lanes: &[&Lane], neighbors: &BTreeSet<(usize, usize)>) -> Vec<Vec<f64>> {
    let mut cuts: Vec<Vec<f64>> = vec![Vec::new(); lanes.len()];
    // Cuts of a lane are apart from one another, so that they come to an end.
    let mut changes = true;
    while changes {
        changes = false;
        for &(a, b) in neighbors {
            for (lane, other) in [(a, b), (b, a)] {
                let baseline = &lanes[other].baseline;
                let ends = [0.0, baseline.length()];
                for s in ends.into_iter().chain(cuts[other].clone()) {
                    changes |= cut_at(&lanes[lane].baseline, &mut cuts[lane], baseline.at(s));
                }
            }
        }
    }
    cuts
}

/// Cuts a lane beside `p`, and returns whether it was not cut there before.
fn cut_at(baseline: &Polyline, cuts: &mut Vec<f64>, p: Vec2) -> bool {
    let projection = baseline.project(p);
    let s = projection.s;
    let is_near = |other: f64| (s - other).abs() < SAME_PLACE;
    if projection.distance > MAX_DISTANCE
        || is_near(0.0)
        || is_near(baseline.length())
        || cuts.iter().copied().any(is_near)
    {
        return false;
    }
    let at = cuts.partition_point(|&other| other < s);
    cuts.insert(at, s);
    true
}

/// Returns piece `k` of a lane that is cut at `cuts`, without links. The lane itself if there are no cuts.
fn piece(lane: &Lane, cuts: &[f64], k: usize) -> Lane {
    let mut piece = Lane { left: Vec::new(), right: Vec::new(), ..lane.clone() };
    if cuts.is_empty() {
        return piece;
    }
    let (length, baseline) = (lane.baseline.length(), &lane.baseline);
    let bound = |k: usize| if k == 0 { 0.0 } else { cuts.get(k - 1).copied().unwrap_or(length) };
    let (from, to) = (bound(k), bound(k + 1));
    piece.id = format!("{}#{}", lane.id, k + 1);
    piece.baseline = part(baseline, from, to);
    if let LaneArea::Polygon(ring) = &lane.area {
        let after = |p: Vec2| if k == 0 { 1.0 } else { baseline.project(p).s - from };
        let before = |p: Vec2| if k == cuts.len() { 1.0 } else { to - baseline.project(p).s };
        let part = clipped(&clipped(ring, after), before);
        // An outline that is elsewhere than its baseline has no part here.
        let is_empty = part.len() < 3;
        let corridor = LaneArea::Corridor { half_width: LANE_HALF_WIDTH };
        piece.area = if is_empty { corridor } else { LaneArea::Polygon(part) };
    }
    piece
}

/// Returns the part of a line between two arc lengths, metres.
fn part(line: &Polyline, from: f64, to: f64) -> Polyline {
    let inner = line.points().iter().zip(line.arc()).filter(|&(_, &s)| from < s && s < to).map(|(&p, _)| p);
    let points: Vec<Vec2> = std::iter::once(line.at(from)).chain(inner).chain([line.at(to)]).collect();
    // Cuts are apart, so that the part has an extent.
    Polyline::new(&points).unwrap_or_else(|_| line.clone())
}

/// Returns the part of a ring where `inside` is positive (the algorithm of Sutherland and Hodgman).
fn clipped(ring: &[Vec2], inside: impl Fn(Vec2) -> f64) -> Vec<Vec2> {
    let mut part = Vec::with_capacity(ring.len());
    for (i, &to) in ring.iter().enumerate() {
        let from = ring[(i + ring.len() - 1) % ring.len()];
        if (inside(from) > 0.0) != (inside(to) > 0.0) {
            part.push(crossing(from, to, &inside));
        }
        if inside(to) > 0.0 {
            part.push(to);
        }
    }
    part
}

/// Returns the point of a line at which the sign of `inside` changes.
fn crossing(from: Vec2, to: Vec2, inside: &impl Fn(Vec2) -> f64) -> Vec2 {
    let (mut from, mut to) = (from, to);
    let begins_inside = inside(from) > 0.0;
    for _ in 0..HALVINGS {
        let middle = (from + to) * 0.5;
        if (inside(middle) > 0.0) == begins_inside { from = middle } else { to = middle }
    }
    (from + to) * 0.5
}

/// Returns how well a line beside a longer one begins and ends with it and keeps its distance, 0 to 1.
fn parallelism(short: &Polyline, long: &Polyline) -> f64 {
    let distance = |s: f64| long.project(short.at(s)).distance;
    let spread = (distance(0.0) - distance(short.length())).abs();
    short.length() / long.length() * (1.0 - (spread / MAX_DISTANCE).min(1.0))
}

/// Returns the share of the shorter line that is beside the other one, in the same direction, 0 to 1.
fn shared(short: &Polyline, long: &Polyline) -> f64 {
    let count = (short.length() / STEP).ceil().clamp(4.0, MAX_POINTS);
    let is_beside = |i: u32| {
        let s = (f64::from(i) + 0.5) / count * short.length();
        let projection = long.project(short.at(s));
        let (from, to) = short.segment(short.segment_at(s));
        let (other_from, other_to) = long.segment(projection.segment);
        projection.distance <= MAX_DISTANCE
            && (0.0 < projection.s && projection.s < long.length())
            && (to - from).dot(&(other_to - other_from)) > 0.0
    };
    let count = count as u32;
    (0..count).filter(|&i| is_beside(i)).count() as f64 / f64::from(count)
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use reactsim_scene::{AgentKind, LaneParts, Scenario};

    use super::*;
    use crate::fixtures::scenes::{agent, beside, lane, scenario, straight_track};
    use crate::from_scene::planning_map;

    /// Returns the scenario of a road along the x axis. Per lane of the road, from right to left, the places
    /// at which it is cut into lanes; lanes that meet are linked, and lanes side by side are neighbours.
    fn road(rows: &[&[f64]], change: impl Fn(&mut LaneParts)) -> Scenario {
        let id = |row: usize, k: usize| format!("{row}-{k}");
        let mut lanes = Vec::new();
        for (row, cuts) in rows.iter().enumerate() {
            let y = 3.5 * row as f64;
            for k in 0..cuts.len() - 1 {
                let next = (k + 2 < cuts.len()).then(|| id(row, k + 1));
                let next: Vec<&str> = next.as_deref().into_iter().collect();
                let points: Vec<(f64, f64)> =
                    (0..=10).map(|i| (cuts[k] + (cuts[k + 1] - cuts[k]) * f64::from(i) / 10.0, y)).collect();
                let mut lane = lane(&id(row, k), &points, &next);
                for (j, other) in rows.get(row + 1).iter().flat_map(|cuts| cuts.windows(2)).enumerate() {
                    if other[0] < cuts[k + 1] && cuts[k] < other[1] {
                        lane.left.push(beside(&id(row + 1, j)));
                    }
                }
                change(&mut lane);
                lanes.push(lane);
            }
        }
        scenario(vec![agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0))], lanes)
    }

    /// Returns the ids of the lanes of each roadblock that a route from the first lane passes.
    fn roadblocks(scenario: &Scenario) -> Vec<Vec<String>> {
        let map = planning_map(scenario).unwrap();
        let mut lane = 0;
        let mut passed = vec![map.lane(lane).roadblock];
        while let Some(&next) = map.lane(lane).successors.first() {
            lane = next;
            passed.push(map.lane(lane).roadblock);
        }
        let ids = |block: usize| map.lanes_of_roadblock(block).iter().map(|&lane| map.lane(lane).id.clone());
        passed.into_iter().map(|block| ids(block).collect()).collect()
    }

    #[test]
    fn lanes_are_cut_beside_the_cuts_of_others() {
        let cut = [["0-0", "1-0#1"], ["0-1", "1-0#2"]];
        assert_eq!(roadblocks(&road(&[&[-100.0, 30.0, 400.0], &[-100.0, 400.0]], |_| ())), cut);
        // Through a third lane, and where a lane is cut beside the begin of another one.
        let rows: [&[f64]; 3] = [&[-100.0, 30.0, 400.0], &[-100.0, 400.0], &[100.0, 400.0]];
        let cut = [vec!["0-0", "1-0#1"], vec!["0-1#1", "1-0#2"], vec!["0-1#2", "1-0#3", "2-0"]];
        assert_eq!(roadblocks(&road(&rows, |_| ())), cut);
        // Ends that differ by some metres are one place.
        let rows: [&[f64]; 2] = [&[-100.0, 30.0, 400.0], &[-100.0, 33.0, 400.0]];
        assert_eq!(roadblocks(&road(&rows, |_| ())), [["0-0", "1-0"], ["0-1", "1-1"]]);
        let alone = road(&[&[-100.0, 30.0, 400.0], &[-100.0, 400.0]], |lane| lane.left.clear());
        assert_eq!(roadblocks(&alone), [["0-0"], ["0-1"]]);
    }

    #[test]
    fn no_lane_leads_to_a_lane_of_its_roadblock() {
        // Cuts of three lanes at all distances from one another, shorter than the place of one cut too.
        for gap in 1..30 {
            let at = |factor: f64| 20.0 + factor * f64::from(gap);
            let rows: [&[f64]; 3] = [
                &[-100.0, 20.0, at(2.0), 400.0],
                &[-100.0, at(1.0), 400.0],
                &[-100.0, at(0.5), at(3.5), 400.0],
            ];
            let map = planning_map(&road(&rows, |_| ())).unwrap();
            for (i, lane) in map.lanes().iter().enumerate() {
                let mut next = vec![i];
                while let Some(&after) = map.lane(next[next.len() - 1]).successors.first() {
                    assert_ne!(map.lane(after).roadblock, lane.roadblock, "{gap}: {}", lane.id);
                    next.push(after);
                }
                let end = map.lane(next[next.len() - 1]).baseline.points().last().unwrap().x;
                assert_eq!(end, 400.0, "{gap}: {}", lane.id);
            }
            let total = |row: &str| -> f64 {
                let lanes = map.lanes().iter().filter(|lane| lane.id.starts_with(row));
                lanes.map(|lane| lane.baseline.length()).sum()
            };
            assert!(["0-", "1-", "2-"].into_iter().all(|row| (total(row) - 500.0).abs() < 1e-9), "{gap}");
        }
    }

    #[test]
    fn lanes_that_keep_their_distance_are_joined_before_lanes_that_merge() {
        let row = |id, y: f64, from: f64, to: f64, next: &[&str]| lane(id, &[(from, y), (to, y)], next);
        let mut lanes = vec![
            // Merges into the right lane, beside the left one.
            lane("turn", &[(10.0, -3.0), (20.0, -1.5), (30.0, 0.0)], &["0-1"]),
            row("0-0", 0.0, -100.0, 30.0, &["0-1"]),
            row("0-1", 0.0, 30.0, 400.0, &[]),
            row("1-0", 3.5, -100.0, 30.0, &["1-1"]),
            row("1-1", 3.5, 30.0, 400.0, &[]),
        ];
        for (right, left) in [(0, "1-0"), (1, "1-0"), (2, "1-1")] {
            lanes[right].left.push(beside(left));
        }
        let merging = scenario(vec![agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0))], lanes);
        let map = planning_map(&merging).unwrap();
        let block = |id: &str| map.lane(map.find_lane(id).unwrap()).roadblock;
        assert!((1..=2).all(|k| block(&format!("0-0#{k}")) == block(&format!("1-0#{k}"))));
        assert_ne!(block("turn"), block("1-0#2"));
    }

    #[test]
    fn lanes_against_each_other_are_apart() {
        let rows: [&[f64]; 2] = [&[-100.0, 400.0], &[-100.0, 400.0]];
        let opposed = road(&rows, |lane| {
            if lane.id == "1-0" {
                lane.points.reverse();
            }
        });
        assert_eq!(roadblocks(&opposed), [["0-0"]]);
    }

    #[test]
    fn outlines_are_cut_with_their_lanes() {
        let rows: [&[f64]; 2] = [&[-100.0, 30.0, 400.0], &[-100.0, 400.0]];
        let outlined = road(&rows, |lane| {
            let corner = |x: f64, y: f64| lane.points[0] + Vec2::new(x, y);
            let length = (lane.points[10] - lane.points[0]).norm();
            let ring =
                vec![corner(0.0, -1.75), corner(length, -1.75), corner(length, 1.75), corner(0.0, 1.75)];
            lane.area = LaneArea::Polygon(ring);
        });
        let map = planning_map(&outlined).unwrap();
        let at = |x: f64| map.lanes_at(Vec2::new(x, 3.6)).into_iter().map(|lane| map.lane(lane).id.as_str());
        for (places, id) in [(-99..30, "1-0#1"), (31..400, "1-0#2")] as [(Range<i32>, _); 2] {
            assert!(places.into_iter().all(|x| at(f64::from(x)).eq([id])), "{id}");
        }
        assert_eq!(map.lane_area(map.find_lane("1-0#2").unwrap()).bounds().max.x, 400.0);
    }
}
