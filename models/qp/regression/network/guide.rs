//! Reference motions (guesses): the network predicts differences from them. Without them it predicts motions
//! in metres and m/s.

use burn::tensor::{Tensor, TensorData};
use reactsim_geometry::{Vec2, into_frame, left, math, smooth_step};
use reactsim_nn::perception::lane;
use reactsim_scene::DT;

use super::STATE;
use super::config::Config;

/// A path along lanes in the frame of an agent: points every [`lane::SPACING`] metres and the direction
/// there.
type LanePath = [(Vec2, Vec2)];

/// Lateral distance in metres from all paths above which a goal is reached straight.
const MAX_OFFSET: f64 = 6.0;
/// Lateral distance in metres below which a goal counts as on the path: goals are means of many
/// trajectories, whose agents kept to their lanes.
const ON_PATH_OFFSET: f64 = 1.75;
/// Time in seconds until the final lateral offset is reached.
const SETTLING_TIME: f64 = 4.0;

/// Reference motions in the layout of predictions.
pub(crate) struct References {
    /// Times of the states, s, and the logarithms of their deviations, which grow.
    states: Vec<(f64, f64)>,
    /// Time of the last state, s.
    end: f64,
}

impl References {
    /// Prepares motions of a network with this configuration.
    pub(crate) fn new(config: &Config) -> Self {
        let state = |t: f64| (t, math::ln(0.15 + 0.4 * t * t.sqrt().sqrt()));
        Self {
            states: config.times().map(state).collect(),
            end: config.states() as f64 * config.step as f64 * DT,
        }
    }

    /// Appends the states of an agent that starts at the origin with this velocity and keeps it.
    pub(crate) fn append_constant(&self, velocity: Vec2, out: &mut Vec<f32>) {
        self.append(out, |t| (velocity * t, velocity));
    }

    /// Appends, for each goal, the states of an agent that starts at the origin with this velocity and
    /// reaches the goal by the end, along one of `paths` if it leads there, otherwise straight.
    pub(crate) fn append_towards(
        &self,
        goals: &[Vec2],
        velocity: Vec2,
        paths: &[Vec<(Vec2, Vec2)>],
        out: &mut Vec<f32>,
    ) {
        let ways: Vec<Way<'_>> = paths.iter().filter_map(|path| Way::of(path, velocity)).collect();
        for &goal in goals {
            match Along::of(&ways, goal) {
                Some(along) => self.append(out, |t| along.at(t, self.end)),
                None => self.append(out, |t| straight(velocity, goal, t, self.end)),
            }
        }
    }

    /// Appends states with these positions and velocities.
    fn append(&self, out: &mut Vec<f32>, motion: impl Fn(f64) -> (Vec2, Vec2)) {
        for &(t, deviation) in &self.states {
            let (at, v) = motion(t);
            let state = [at.x, at.y, deviation, deviation, 0.0, v.x, v.y];
            out.extend(state.map(|value| value as f32));
        }
    }
}

/// Returns distance and speed after `t` of an agent with this speed that covers `length` metres in
/// `end` seconds: at constant acceleration, or, if that would lead back, braking to a halt there.
fn travelled(speed: f64, length: f64, t: f64, end: f64) -> (f64, f64) {
    if speed > 0.0 && length >= 0.0 && length < 0.5 * speed * end {
        let halt = 2.0 * length / speed;
        return if t < halt {
            (speed * t * (1.0 - 0.5 * t / halt), speed * (1.0 - t / halt))
        } else {
            (length, 0.0)
        };
    }
    let (u, rest) = (t / end, length - speed * end);
    (speed * t + rest * u * u, speed + 2.0 * rest * u / end)
}

fn straight(velocity: Vec2, goal: Vec2, t: f64, end: f64) -> (Vec2, Vec2) {
    let Some(ahead) = goal.try_normalize(1e-6) else { return (Vec2::zeros(), Vec2::zeros()) };
    let (distance, speed) = travelled(velocity.dot(&ahead), goal.norm(), t, end);
    // The velocity component across the goal direction vanishes by the end.
    let aside = velocity - ahead * velocity.dot(&ahead);
    let u = t / end;
    (ahead * distance + aside * (t * (1.0 - u)), ahead * speed + aside * (1.0 - 2.0 * u))
}

/// A path, and where the agent is on it now.
struct Way<'a> {
    path: &'a LanePath,
    /// Speed along the path, m/s.
    speed: f64,
    /// Arc length, metres.
    from: f64,
    /// Lateral offset, metres, left positive.
    offset: f64,
}

impl<'a> Way<'a> {
    /// Returns an agent at the origin on a path; `None` if the path is empty.
    fn of(path: &'a LanePath, velocity: Vec2) -> Option<Self> {
        let (from, offset) = nearest(path, Vec2::zeros())?;
        Some(Self { path, speed: velocity.dot(&path[0].1), from, offset })
    }
}

/// Motion along a path.
struct Along<'a> {
    way: &'a Way<'a>,
    /// Arc length at the end, metres.
    to: f64,
    /// Lateral offset at the end, metres, left positive.
    last_offset: f64,
}

impl<'a> Along<'a> {
    /// Returns the motion along the path that passes nearest to the goal; `None` if all paths are too
    /// far from the goal or it is behind.
    fn of(ways: &'a [Way<'_>], goal: Vec2) -> Option<Self> {
        let found = ways.iter().filter_map(|way| Some((way, nearest(way.path, goal)?)));
        let (way, (to, aside)) = found.min_by(|a, b| a.1.1.abs().total_cmp(&b.1.1.abs()))?;
        if aside.abs() > MAX_OFFSET || to < way.from {
            return None;
        }
        Some(Self { way, to, last_offset: if aside.abs() < ON_PATH_OFFSET { 0.0 } else { aside } })
    }

    fn at(&self, t: f64, end: f64) -> (Vec2, Vec2) {
        let Way { path, speed, from, offset } = *self.way;
        let length = self.to - from;
        let (s, speed) = travelled(speed, length, t, end);
        let (at, ahead) = point(path, from + s);
        // An agent that does not move keeps its offset.
        let settled = smooth_step(t / SETTLING_TIME) * if length > 0.5 { 1.0 } else { 0.0 };
        let aside = offset + (self.last_offset - offset) * settled;
        (at + left(ahead) * aside, ahead * speed)
    }
}

/// Returns arc length and lateral offset of a point, metres. The path continues straight beyond its end
/// and before its beginning.
fn nearest(path: &LanePath, p: Vec2) -> Option<(f64, f64)> {
    let far = |(at, _): &(Vec2, Vec2)| (at - p).norm_squared();
    let (i, _) = path.iter().map(far).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let (at, ahead) = path[i];
    let local = into_frame(ahead, p - at);
    Some((i as f64 * lane::SPACING + local.x, local.y))
}

/// Returns the point of a path at an arc length, and the direction there.
fn point(path: &LanePath, s: f64) -> (Vec2, Vec2) {
    let i = ((s / lane::SPACING).max(0.0) as usize).min(path.len() - 1);
    let (at, ahead) = path[i];
    let rest = s - i as f64 * lane::SPACING;
    match path.get(i + 1) {
        Some((next, _)) if rest > 0.0 => (at + (next - at) * (rest / lane::SPACING), ahead),
        _ => (at + ahead * rest, ahead),
    }
}

/// Adds the network output `[n, states, 7]` to reference states `[n, states, 7]`. The output is scaled
/// up with the time of the state.
pub(crate) fn add_to_reference(output: Tensor<3>, references: Tensor<3>, config: &Config) -> Tensor<3> {
    let scales = config.times().flat_map(|t| {
        let (place, speed) = (0.4 * t * t.sqrt(), 0.5 + 0.25 * t);
        [place, place, 1.0, 1.0, 1.0, speed, speed].map(|value| value as f32)
    });
    let scales = TensorData::new(scales.collect(), [1, config.states(), STATE]);
    references + output.clone() * Tensor::<3>::from_data(scales, &output.device())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(velocity: Vec2, goal: Vec2, paths: &[Vec<(Vec2, Vec2)>]) -> Vec<Vec2> {
        let mut out = Vec::new();
        References::new(&Config::default()).append_towards(&[goal], velocity, paths, &mut out);
        out.chunks_exact(STATE).map(|s| Vec2::new(f64::from(s[0]), f64::from(s[1]))).collect()
    }

    #[test]
    fn an_agent_that_has_to_stop_does_not_come_back() {
        let all = reference(Vec2::new(10.0, 0.0), Vec2::new(20.0, 0.0), &[]);
        assert!(all.windows(2).all(|w| w[1].x >= w[0].x - 1e-6));
        assert!((all[15] - Vec2::new(20.0, 0.0)).norm() < 1e-5);
        assert!((all[0].x - (5.0 - 0.5 * 0.25 * 10.0 / 4.0)).abs() < 1e-5);
    }

    #[test]
    fn goals_beside_a_bend_are_reached_along_it() {
        // A quarter of a circle of 20 m to the left.
        let at = |i: usize| {
            let a = i as f64 * lane::SPACING / 20.0;
            (Vec2::new(20.0 * a.sin(), 20.0 * (1.0 - a.cos())), Vec2::new(a.cos(), a.sin()))
        };
        let bend: Vec<(Vec2, Vec2)> = (0..=12).map(at).collect();
        let all = reference(Vec2::new(4.0, 0.0), Vec2::new(20.5, 20.5), &[bend]);
        let centre = Vec2::new(0.0, 20.0);
        assert!(all.iter().all(|p| ((p - centre).norm() - 20.0).abs() < 0.4), "{all:?}");
        assert!((all[15] - Vec2::new(20.0, 20.5)).norm() < 0.7, "{:?}", all[15]);
        // A goal away from all paths is reached straight.
        let straight = reference(Vec2::new(4.0, 0.0), Vec2::new(30.0, -12.0), &[]);
        assert!((straight[15] - Vec2::new(30.0, -12.0)).norm() < 1e-4);
    }
}
