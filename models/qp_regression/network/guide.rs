//! Guesses that predictions are the difference from.

use burn::tensor::{Tensor, TensorData};
use reactsim::geometry::{Vec2, into_frame, left, math, smooth_step};
use reactsim::scene::DT;

use super::STATE;
use super::config::Config;
use crate::models::ntp::reactive::lane;

/// A way on in the frame of an agent: points every [`lane::SPACING`] metres and the direction there.
type Way = [(Vec2, Vec2)];

/// A goal that is farther from every way is gone to straight, metres.
const ASIDE: f64 = 6.0;
/// A goal this near to a way lies on it: goals are means of what many did, who kept to their lanes, metres.
const ON_WAY: f64 = 1.75;
/// Seconds until somebody is as far aside of the way as in the end.
const SETTLES: f64 = 4.0;

/// The states of someone who is at the origin with this velocity and gets to `goal` by the end, along one of the `ways` if it leads there,
/// else straight; without a goal straight on as now. Row by row, as they are predicted, with deviations that grow.
pub(crate) fn guess(
    velocity: Vec2,
    goal: Option<Vec2>,
    ways: &[Vec<(Vec2, Vec2)>],
    config: &Config,
    out: &mut Vec<f32>,
) {
    let end = config.states() as f64 * config.step as f64 * DT;
    let along = goal.and_then(|goal| Along::of(ways, velocity, goal));
    for t in config.times() {
        let (at, v) = match (&along, goal) {
            (Some(along), _) => along.at(t, end),
            (None, Some(goal)) => straight(velocity, goal, t, end),
            (None, None) => (velocity * t, velocity),
        };
        let deviation = math::ln(0.15 + 0.4 * t * t.sqrt().sqrt());
        let state = [at.x, at.y, deviation, deviation, 0.0, v.x, v.y];
        out.extend(state.map(|value| value as f32));
    }
}

/// How far somebody with this speed has gone after `t`, and how fast he is, who goes `way` metres in `end` seconds: at constant
/// acceleration, or, where he would have to come back, braking to a halt there.
fn gone(speed: f64, way: f64, t: f64, end: f64) -> (f64, f64) {
    if speed > 0.0 && way >= 0.0 && way < 0.5 * speed * end {
        let halt = 2.0 * way / speed;
        return if t < halt {
            (speed * t * (1.0 - 0.5 * t / halt), speed * (1.0 - t / halt))
        } else {
            (way, 0.0)
        };
    }
    let (u, rest) = (t / end, way - speed * end);
    (speed * t + rest * u * u, speed + 2.0 * rest * u / end)
}

fn straight(velocity: Vec2, goal: Vec2, t: f64, end: f64) -> (Vec2, Vec2) {
    let Some(ahead) = goal.try_normalize(1e-6) else { return (Vec2::zeros(), Vec2::zeros()) };
    let (way, speed) = gone(velocity.dot(&ahead), goal.norm(), t, end);
    // What leads past the goal is lost by the end.
    let aside = velocity - ahead * velocity.dot(&ahead);
    let u = t / end;
    (ahead * way + aside * (t * (1.0 - u)), ahead * speed + aside * (1.0 - 2.0 * u))
}

/// Going along a way.
struct Along<'a> {
    way: &'a Way,
    speed: f64,
    /// Metres along the way: now, and by the end.
    from: f64,
    to: f64,
    /// Metres aside of the way, left is positive: now, and by the end.
    aside: (f64, f64),
}

impl<'a> Along<'a> {
    /// Along the way that passes nearest to the goal, if one does that is not behind.
    fn of(ways: &'a [Vec<(Vec2, Vec2)>], velocity: Vec2, goal: Vec2) -> Option<Self> {
        let found = ways.iter().filter_map(|way| Some((way, nearest(way, goal)?)));
        let (way, (to, aside)) = found.min_by(|a, b| a.1.1.abs().total_cmp(&b.1.1.abs()))?;
        let (from, aside_now) = nearest(way, Vec2::zeros())?;
        if aside.abs() > ASIDE || to < from {
            return None;
        }
        let aside = if aside.abs() < ON_WAY { 0.0 } else { aside };
        Some(Self { way, speed: velocity.dot(&way[0].1), from, to, aside: (aside_now, aside) })
    }

    fn at(&self, t: f64, end: f64) -> (Vec2, Vec2) {
        let (s, speed) = gone(self.speed, self.to - self.from, t, end);
        let (at, ahead) = point(self.way, self.from + s);
        // Who does not move does not go aside.
        let settled = smooth_step(t / SETTLES) * if self.to - self.from > 0.5 { 1.0 } else { 0.0 };
        let aside = self.aside.0 + (self.aside.1 - self.aside.0) * settled;
        (at + left(ahead) * aside, ahead * speed)
    }
}

/// How far along a way a point is and how far aside, metres. Beyond its end the way goes straight on, and before its beginning too.
fn nearest(way: &Way, p: Vec2) -> Option<(f64, f64)> {
    let far = |at: &(Vec2, Vec2)| (at.0 - p).norm_squared();
    let (i, (at, ahead)) = way.iter().enumerate().min_by(|a, b| far(a.1).total_cmp(&far(b.1)))?;
    let local = into_frame(*ahead, p - at);
    Some((i as f64 * lane::SPACING + local.x, local.y))
}

/// The point of a way and the direction there.
fn point(way: &Way, s: f64) -> (Vec2, Vec2) {
    let i = ((s / lane::SPACING).max(0.0) as usize).min(way.len() - 1);
    let (at, ahead) = way[i];
    let rest = s - i as f64 * lane::SPACING;
    match way.get(i + 1) {
        Some((next, _)) if rest > 0.0 => (at + (next - at) * (rest / lane::SPACING), ahead),
        _ => (at + ahead * rest, ahead),
    }
}

/// What a network says, `[n, states, 7]`, as a difference from guesses `[n, states, 7]`: the later the state, the more a number of the
/// network is worth.
pub(crate) fn applied(said: Tensor<3>, guesses: Tensor<3>, config: &Config) -> Tensor<3> {
    let mut worth = Vec::with_capacity(config.states() * STATE);
    for t in config.times() {
        let (place, speed) = (0.4 * t * t.sqrt(), 0.5 + 0.25 * t);
        worth.extend([place, place, 1.0, 1.0, 1.0, speed, speed].map(|value| value as f32));
    }
    let worth = TensorData::new(worth, [1, config.states(), STATE]);
    let worth = Tensor::<3>::from_data(worth, &said.device());
    guesses + said * worth
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guessed(velocity: Vec2, goal: Vec2, ways: &[Vec<(Vec2, Vec2)>]) -> Vec<Vec2> {
        let mut out = Vec::new();
        guess(velocity, Some(goal), ways, &Config::default(), &mut out);
        out.chunks_exact(STATE).map(|s| Vec2::new(f64::from(s[0]), f64::from(s[1]))).collect()
    }

    #[test]
    fn who_is_to_stop_does_not_come_back() {
        let all = guessed(Vec2::new(10.0, 0.0), Vec2::new(20.0, 0.0), &[]);
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
        let all = guessed(Vec2::new(4.0, 0.0), Vec2::new(20.5, 20.5), &[bend]);
        let centre = Vec2::new(0.0, 20.0);
        assert!(all.iter().all(|p| ((p - centre).norm() - 20.0).abs() < 0.4), "{all:?}");
        assert!((all[15] - Vec2::new(20.0, 20.5)).norm() < 0.7, "{:?}", all[15]);
        // One that no way leads to is gone to straight.
        let straight = guessed(Vec2::new(4.0, 0.0), Vec2::new(30.0, -12.0), &[]);
        assert!((straight[15] - Vec2::new(30.0, -12.0)).norm() < 1e-4);
    }
}
