//! Intention points by k-means: means of the positions of recorded agents after eight seconds.

use rand::RngExt;
use reactsim_geometry::{Vec2, into_frame};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{AgentKind, FUTURE, Frame, Scenario};
use serde_json::json;

use super::intentions::nearest;
use super::{Intentions, Reservoir, ScenarioDigest, for_each_track};
use crate::WeightsError;
use crate::perception::Class;

/// Displacement in metres below which an agent counts as standing, which has a point of its own.
const STANDSTILL_DISPLACEMENT: f64 = 1.0;
/// Resolution in metres at which end points count as equal.
const RESOLUTION: f64 = 1.0 / 64.0;
/// Frames between those from which agents are followed for eight seconds.
const START_INTERVAL: usize = 5;
/// Share of the points that are straight ahead or behind.
const STRAIGHT_SHARE: f64 = 0.375;
/// Largest number of iterations.
const MAX_ROUNDS: usize = 200;

/// Recorded positions of agents after eight seconds, in their frames at the start. Left and right are
/// not distinguished.
#[derive(Debug)]
pub struct EndPoints {
    seed: u64,
    classes: [Reservoir<Vec2>; 3],
    scenarios: ScenarioDigest,
}

impl EndPoints {
    /// Creates an empty collection that keeps at most `most` end points of every class.
    pub fn new(most: usize, seed: u64) -> Self {
        let sample = |class: Class| Reservoir::new(most, seed, &format!("intentions/ends/{class}"));
        Self { seed, classes: Class::ALL.map(sample), scenarios: ScenarioDigest::default() }
    }

    /// Adds the end points of all agents of a scenario, including those that are not simulated.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios.add(scenario);
        for_each_track(scenario, |kind, track| self.add_track(kind, track));
    }

    fn add_track(&mut self, kind: AgentKind, track: &[Frame]) {
        let Some(class) = Class::of(kind) else { return };
        let at = |f: usize| track.get(f).copied().flatten().filter(|s| s.is_finite());
        let starts = (0..track.len()).step_by(START_INTERVAL);
        for (from, to) in starts.filter_map(|f| Some((at(f)?, at(f + FUTURE)?))) {
            let ahead = reactsim_geometry::direction(from.heading);
            self.add_point(class, into_frame(ahead, to.position() - from.position()));
        }
    }

    /// Adds an end point, unless the agent stands.
    pub fn add_point(&mut self, class: Class, p: Vec2) {
        if p.norm() >= STANDSTILL_DISPLACEMENT {
            let p = Vec2::new(p.x, p.y.abs());
            self.classes[class.index()].add(p, [p.x, p.y].into_iter(), RESOLUTION);
        }
    }

    /// Returns the number of distinct end points of a class that were added.
    pub fn seen(&self, class: Class) -> u64 {
        self.classes[class.index()].seen
    }

    /// Makes `count` points per class: one at the agent, some straight ahead, the others in pairs of
    /// left and right. The starting means are drawn by k-means++ (Arthur and Vassilvitskii, SODA 2007)
    /// from a stream named by seed and class.
    ///
    /// # Errors
    /// [`WeightsError`] if too few end points were recorded.
    pub fn build(&self, count: usize) -> Result<Intentions, WeightsError> {
        if !(2..=4096).contains(&count) {
            let text = format!("cannot make {count} intention points: expected 2 to 4096");
            return Err(WeightsError::Refused(text));
        }
        let mut points: [Vec<Vec2>; 3] = Default::default();
        for class in Class::ALL {
            let places = &self.classes[class.index()].kept;
            if places.len() < count {
                return Err(WeightsError::Refused(format!(
                    "found {} distinct positions of class `{class}` after 8 s, expected at least {count}: \
                     name more scenarios or request fewer points",
                    places.len()
                )));
            }
            points[class.index()] = self.means(class, places, count);
        }
        let settings = json!({
            "points": count,
            "seconds": 8,
            "straight": STRAIGHT_SHARE,
            "stands": STANDSTILL_DISPLACEMENT,
        });
        Intentions::new(points, self.scenarios.provenance("k-means", settings, self.seed))
    }

    fn means(&self, class: Class, places: &[Vec2], count: usize) -> Vec<Vec2> {
        let straight = (count as f64 * STRAIGHT_SHARE).round().max(1.0) as usize;
        // Pairs take the rest, which has to be even.
        let straight = if (count - straight).is_multiple_of(2) { straight } else { straight + 1 };
        let straight = straight.min(count);
        let pairs = (count - straight) / 2;
        let mut means = self.starts(class, places, straight + pairs);
        means[1..].sort_by(|a, b| a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x)));
        let flat = |means: &mut Vec<Vec2>| means[..straight].iter_mut().for_each(|m| m.y = 0.0);
        flat(&mut means);
        let mut of = vec![usize::MAX; places.len()];
        for _ in 0..MAX_ROUNDS {
            let mut moved = false;
            let mut sums = vec![(Vec2::zeros(), 0.0); means.len()];
            for (place, of) in places.iter().zip(&mut of) {
                let nearest = nearest(&means, *place);
                moved |= *of != nearest;
                *of = nearest;
                sums[nearest].0 += *place;
                sums[nearest].1 += 1.0;
            }
            // The first mean stays at the agent.
            for (mean, (sum, n)) in means.iter_mut().zip(&sums).skip(1) {
                if *n > 0.0 {
                    *mean = sum / *n;
                }
            }
            flat(&mut means);
            if !moved {
                break;
            }
        }
        means[1..straight].sort_by(|a, b| a.x.total_cmp(&b.x));
        means[straight..].sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let pairs = means[straight..].iter().flat_map(|m| [*m, Vec2::new(m.x, -m.y)]);
        means[..straight].iter().copied().chain(pairs).collect()
    }

    /// Returns the position of the agent, then end points drawn in proportion to the squared distance
    /// from those drawn before.
    fn starts(&self, class: Class, places: &[Vec2], count: usize) -> Vec<Vec2> {
        let mut stream = stream(self.seed, &format!("intentions/means/{class}"), 0, Purpose::Begin);
        let mut means = vec![Vec2::zeros()];
        let mut far: Vec<f64> = places.iter().map(|p| p.norm_squared()).collect();
        while means.len() < count {
            let total: f64 = far.iter().sum();
            let mut left = stream.random::<f64>() * total;
            let drawn = far.iter().position(|d| {
                left -= d;
                left < 0.0
            });
            let next = places[drawn.unwrap_or(places.len() - 1)];
            for (far, place) in far.iter_mut().zip(places) {
                *far = far.min((place - next).norm_squared());
            }
            means.push(next);
        }
        means
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// End points around `at`, on both sides.
    fn ends(at: &[(f64, f64)], seed: u64) -> EndPoints {
        let mut ends = EndPoints::new(10_000, seed);
        for class in Class::ALL {
            for (x, y) in at {
                for k in 0..40 {
                    let (dx, dy) = (0.1 * f64::from(k % 8), 0.1 * f64::from(k / 8));
                    let side = if k % 2 == 0 { 1.0 } else { -1.0 };
                    ends.add_point(class, Vec2::new(x + dx, (y + dy) * side));
                }
            }
        }
        ends
    }

    #[test]
    fn clusters_are_found_on_both_sides() {
        let ends = ends(&[(20.0, 0.0), (60.0, 0.0), (15.0, 15.0), (40.0, 8.0)], 3);
        let intentions = ends.build(7).unwrap();
        let points = intentions.of(Class::Vehicle);
        assert_eq!(points[0], Vec2::zeros());
        for wanted in [(20.35, 0.0), (60.35, 0.0), (15.35, 15.2), (15.35, -15.2), (40.35, 8.2), (40.35, -8.2)]
        {
            let wanted = Vec2::new(wanted.0, wanted.1);
            assert!(points.iter().any(|p| (p - wanted).norm() < 0.6), "{wanted} is not among {points:?}");
        }
        // The points on the left mirror those on the right.
        assert!(points.iter().all(|p| points.contains(&Vec2::new(p.x, -p.y)) || p.y == 0.0));
    }

    #[test]
    fn the_same_seed_gives_the_same_points() {
        let at = [(20.0, 0.0), (60.0, 0.0), (15.0, 15.0), (40.0, 8.0), (5.0, 1.0)];
        assert_eq!(ends(&at, 1).build(16).unwrap(), ends(&at, 1).build(16).unwrap());
        assert_ne!(ends(&at, 1).build(16).unwrap(), ends(&at, 2).build(16).unwrap());
    }

    #[test]
    fn too_little_is_refused() {
        let mut few = EndPoints::new(100, 0);
        few.add_point(Class::Vehicle, Vec2::new(0.5, 0.0));
        few.add_point(Class::Vehicle, Vec2::new(5.0, 0.0));
        assert_eq!(few.seen(Class::Vehicle), 1);
        let text = few.build(16).unwrap_err().to_string();
        assert!(
            text.contains("found 1 ") && text.contains("`vehicle`") && text.contains("at least 16"),
            "{text}"
        );
        assert!(few.build(1).unwrap_err().to_string().contains("2 to 4096"));
    }
}
