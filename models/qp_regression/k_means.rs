//! Intention points by k-means: means of the places where recorded agents are after eight seconds.

use rand::RngExt;
use reactsim::geometry::{Vec2, into_frame};
use reactsim::rollout::{Purpose, stream};
use reactsim::scene::{AgentKind, FUTURE, Frame, Scenario};
use serde_json::json;

use super::{Intentions, IntentionsError};
use crate::models::learning::Reservoir;
use crate::models::ntp::tokens::{Class, Provenance};

/// Who is within this of where he was is taken to stand, metres: that is a point of its own.
const STANDS: f64 = 1.0;
/// Places that are the same to so much are one, metres.
const SAME: f64 = 1.0 / 64.0;
/// Frames from which eight seconds are followed.
const STARTS: [usize; 3] = [0, 5, 10];
/// Part of the points that lie straight ahead or behind.
const STRAIGHT: f64 = 0.375;
/// Rounds at most.
const ROUNDS: usize = 200;

/// Recorded places where agents are after eight seconds, in their frames at the start; left and right are not told apart.
#[derive(Debug)]
pub struct EndPoints {
    seed: u64,
    classes: [Reservoir<Vec2>; 3],
    scenarios: u64,
    digest: blake3::Hasher,
}

impl EndPoints {
    /// None yet; at most so many will be kept of every class.
    pub fn new(most: usize, seed: u64) -> Self {
        let sample = |class: Class| Reservoir::new(most, seed, &format!("intentions/ends/{class}"));
        Self { seed, classes: Class::ALL.map(sample), scenarios: 0, digest: blake3::Hasher::new() }
    }

    /// Adds those of all agents of a scenario, those that are not simulated too.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios += 1;
        self.digest.update(scenario.digest().as_bytes());
        for (i, agent) in scenario.start.agents.iter().enumerate() {
            self.add_track(agent.kind, &scenario.logged(i));
        }
        for other in &scenario.unselected {
            self.add_track(other.agent.kind, &other.track);
        }
    }

    fn add_track(&mut self, kind: AgentKind, track: &[Frame]) {
        let Some(class) = Class::of(kind) else { return };
        let at = |f: usize| track.get(f).copied().flatten().filter(|s| s.is_finite());
        for (from, to) in STARTS.into_iter().filter_map(|f| Some((at(f)?, at(f + FUTURE)?))) {
            let ahead = reactsim::geometry::direction(from.heading);
            self.add_point(class, into_frame(ahead, to.position() - from.position()));
        }
    }

    /// Adds a place; nothing where it is that of someone who stands.
    pub fn add_point(&mut self, class: Class, p: Vec2) {
        if p.norm() >= STANDS {
            let p = Vec2::new(p.x, p.y.abs());
            self.classes[class.index()].add(p, [p.x, p.y].into_iter(), SAME);
        }
    }

    /// Different places of a class that were added.
    pub fn seen(&self, class: Class) -> u64 {
        self.classes[class.index()].seen
    }

    /// `count` points per class: one where the agent is, some straight ahead, the others in pairs of left and right. Means are found from
    /// starts drawn by k-means++ (Arthur and Vassilvitskii, SODA 2007) from a stream that is named by seed and class.
    ///
    /// # Errors
    /// [`IntentionsError`] where too little was recorded.
    pub fn build(&self, count: usize) -> Result<Intentions, IntentionsError> {
        if !(2..=4096).contains(&count) {
            return Err(IntentionsError::Number(count));
        }
        let mut points: [Vec<Vec2>; 3] = Default::default();
        for class in Class::ALL {
            let places = &self.classes[class.index()].kept;
            if places.len() < count {
                return Err(IntentionsError::TooFew { class, found: places.len(), wanted: count });
            }
            points[class.index()] = self.means(class, places, count);
        }
        let digest =
            if self.scenarios == 0 { String::new() } else { self.digest.finalize().to_hex().to_string() };
        let provenance = Provenance {
            method: "k-means".to_owned(),
            settings: json!({ "points": count, "seconds": 8, "straight": STRAIGHT, "stands": STANDS }),
            seed: self.seed,
            scenarios: self.scenarios,
            data: digest,
        };
        Intentions::new(points, provenance)
    }

    fn means(&self, class: Class, places: &[Vec2], count: usize) -> Vec<Vec2> {
        let straight = (count as f64 * STRAIGHT).round().max(1.0) as usize;
        // Pairs take what is left, so that has to be even.
        let straight = if (count - straight).is_multiple_of(2) { straight } else { straight + 1 };
        let straight = straight.min(count);
        let pairs = (count - straight) / 2;
        let mut means = self.starts(class, places, straight + pairs);
        means[1..].sort_by(|a, b| a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x)));
        let flat = |means: &mut Vec<Vec2>| means[..straight].iter_mut().for_each(|m| m.y = 0.0);
        flat(&mut means);
        let mut of = vec![usize::MAX; places.len()];
        for _ in 0..ROUNDS {
            let mut moved = false;
            let mut sums = vec![(Vec2::zeros(), 0.0); means.len()];
            for (place, of) in places.iter().zip(&mut of) {
                let nearest = nearest(&means, *place).0;
                moved |= *of != nearest;
                *of = nearest;
                sums[nearest].0 += *place;
                sums[nearest].1 += 1.0;
            }
            // The first one stays where the agent is.
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

    /// The place of the agent, then places drawn by the square of their distance from those drawn before.
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

/// The nearest of some means, the first of equally near ones, and its distance squared.
fn nearest(means: &[Vec2], p: Vec2) -> (usize, f64) {
    let mut best = (0, f64::INFINITY);
    for (i, mean) in means.iter().enumerate() {
        let d2 = (mean - p).norm_squared();
        if d2 < best.1 {
            best = (i, d2);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places about `at`, on both sides.
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
        let made = ends.build(7).unwrap();
        let points = made.of(Class::Vehicle);
        assert_eq!(points[0], Vec2::zeros());
        for wanted in [(20.35, 0.0), (60.35, 0.0), (15.35, 15.2), (15.35, -15.2), (40.35, 8.2), (40.35, -8.2)]
        {
            let wanted = Vec2::new(wanted.0, wanted.1);
            assert!(points.iter().any(|p| (p - wanted).norm() < 0.6), "{wanted} is not among {points:?}");
        }
        // What is left is in the mirror what is right.
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
        assert!(text.contains("`vehicle` 1 ") && text.contains("at least 16"), "{text}");
        assert!(few.build(1).unwrap_err().to_string().contains("2 to 4096"));
    }
}
