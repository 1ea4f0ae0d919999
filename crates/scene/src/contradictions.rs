//! Velocities that contradict the positions of their tracks.

use reactsim_geometry::{Vec2, direction, heading_of, left};

use super::{AgentState, Frame};

/// Number of steps of a window, 1 s: noise of positions cancels within it.
const STEPS: usize = 10;
/// Smallest number of steps of a window that are recorded.
const LEAST_STEPS: f64 = 8.0;
/// Distance in metres, by positions or by velocities, from which a window shows a velocity.
const LEAST_DISTANCE: f64 = 1.0;
/// Speed in m/s from which a window shows a velocity: that of a slow pedestrian.
const LEAST_SPEED: f64 = 0.8;
/// Median deviation of the differences of positions from their median, relative to the speed, above which
/// positions are too noisy to contradict anything.
const SCATTER: f64 = 0.3;
/// Relative difference from which velocities contradict positions. It is at most 0.14 in 44,515 windows of
/// 635 Waymo recordings.
const CONTRADICTION: f64 = 0.3;
/// Relative difference within which a kind of mistake explains velocities.
const FIT: f64 = 0.25;
/// Deviation of the ratio of velocities to differences of positions from 1 from which it is stated.
const RESCALED: f64 = 0.15;
/// Ratio of velocities to differences of positions below which they count as zero.
const SMALLEST_FACTOR: f64 = 0.05;
/// Share of the windows that a kind of mistake must explain.
const MOST: f64 = 0.8;

/// Returns the velocity that a state means, given its stated velocity.
type Reading = fn(&AgentState, Vec2) -> Vec2;

/// Ways to misread a velocity, apart from its unit: the text, and the velocity that was meant.
const READINGS: [(&str, Reading); 4] = [
    ("", |_, v| v),
    (" in the frame of each agent, along and across its heading", |state, v| {
        let ahead = direction(state.heading);
        ahead * v.x + left(ahead) * v.y
    }),
    (" with x and y exchanged", |_, v| Vec2::new(v.y, v.x)),
    (" with a mirrored y axis", |_, v| Vec2::new(v.x, -v.y)),
];

/// Units with a name: size relative to m/s.
const UNITS: [(f64, &str); 6] = [
    (3.6, "km/h"),
    (1.0 / 3.6, "m/s divided by 3.6"),
    (3.281, "feet per second"),
    (2.237, "miles per hour"),
    (1.944, "knots"),
    (0.1, "metres per frame"),
];

/// The velocities of an agent in a window of 1 s in which it moves, by its states or by its positions.
#[derive(Clone, Copy)]
struct Window<'a> {
    frames: &'a [Frame],
    /// Mean velocity by positions, m/s.
    moved: Vec2,
    contradicts: bool,
}

impl<'a> Window<'a> {
    /// Returns the windows of a track, one per second, in which velocities can be judged.
    fn of_track(track: &'a [Frame], step: impl Fn(usize) -> f64) -> Vec<Self> {
        let starts = (0..track.len().saturating_sub(1)).step_by(STEPS);
        let window = |start: usize| {
            let frames = &track[start..track.len().min(start + STEPS + 1)];
            Self::new(frames, |i| step(start + i))
        };
        starts.filter_map(window).collect()
    }

    fn new(frames: &'a [Frame], step: impl Fn(usize) -> f64) -> Option<Self> {
        let pairs = steps(frames).filter_map(|(i, a, b)| {
            let stated = (a.velocity()? + b.velocity()?) / 2.0;
            Some((step(i), (b.position() - a.position()) / step(i), stated))
        });
        let none = (0.0, 0.0, Vec2::zeros(), Vec2::zeros());
        let (n, seconds, moved, stated) =
            pairs.clone().fold(none, |(n, seconds, moved, stated), (step, by, velocity)| {
                (n + 1.0, seconds + step, moved + by, stated + velocity)
            });
        let (moved, stated) = (moved / n, stated / n);
        let speed = moved.norm().max(stated.norm());
        if n < LEAST_STEPS || !(speed * seconds >= LEAST_DISTANCE && speed >= LEAST_SPEED) {
            return None;
        }
        let mut contradicts = (stated - moved).norm() > CONTRADICTION * speed;
        if contradicts {
            // A jump of the positions changes their mean, but not their median.
            let median_moved = median(pairs.clone().map(|pair| pair.1));
            let median_stated = median(pairs.clone().map(|pair| pair.2));
            let speed = median_moved.norm().max(median_stated.norm());
            let scatter = median(pairs.map(|pair| Vec2::new((pair.1 - median_moved).norm(), 0.0))).x;
            if !(speed >= LEAST_SPEED && scatter <= SCATTER * speed) {
                return None;
            }
            contradicts = (median_stated - median_moved).norm() > CONTRADICTION * speed;
        }
        Some(Self { frames, moved, contradicts })
    }

    /// Mean stated velocity, m/s, read in one way.
    fn stated(&self, read: impl Fn(&AgentState, Vec2) -> Vec2) -> Vec2 {
        mean(steps(self.frames).map(|(_, a, b)| {
            let of = |state: &AgentState| read(state, state.velocity().unwrap_or(Vec2::zeros()));
            (of(a) + of(b)) / 2.0
        }))
    }
}

/// Returns successive frames that are present, with the index of the second one.
fn steps(frames: &[Frame]) -> impl Iterator<Item = (usize, &AgentState, &AgentState)> + Clone {
    let pairs = frames.windows(2).enumerate();
    pairs.filter_map(|(i, pair)| Some((i + 1, pair[0].as_ref()?, pair[1].as_ref()?)))
}

fn mean(values: impl Iterator<Item = Vec2>) -> Vec2 {
    let (n, sum) = values.fold((0.0, Vec2::zeros()), |(n, sum), v| (n + 1.0, sum + v));
    sum / n
}

/// Returns the median of each component.
fn median(values: impl Iterator<Item = Vec2> + Clone) -> Vec2 {
    let of = |axis: fn(Vec2) -> f64| {
        let mut all: Vec<f64> = values.clone().map(axis).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    Vec2::new(of(|v| v.x), of(|v| v.y))
}

/// The kind of mistake that explains velocities.
#[derive(Clone, Copy)]
struct Mistake {
    /// Index into [`READINGS`].
    reading: usize,
    /// Angle by which all velocities are turned, radians.
    turn: f64,
    /// Ratio of the velocities to differences of positions; 0 if all velocities are zero.
    factor: f64,
}

impl Mistake {
    /// Returns the mistake that explains most windows.
    fn find(windows: &[&Window<'_>]) -> Option<Self> {
        let zero = Self { reading: 0, turn: 0.0, factor: 0.0 };
        if zero.explains_most(windows) {
            return Some(zero);
        }
        let scaled = |reading: usize, turn: f64| {
            let mistake = Self { reading, turn, factor: 1.0 };
            let ratio = |w: &&Window<'_>| {
                mistake.meant(w).dot(&w.moved) / w.moved.norm_squared().max(f64::MIN_POSITIVE)
            };
            let factor = median(windows.iter().map(|w| Vec2::new(ratio(w), 0.0))).x;
            let found = Self { factor, ..mistake };
            // Only a plain velocity has the opposite sign: mirrored ones of few agents look like others.
            let is_likely = factor > 0.0 || (reading == 0 && turn == 0.0);
            (is_likely && found.explains_most(windows)).then_some(found)
        };
        let turned = || {
            let stated = |w: &Window<'_>| w.stated(READINGS[0].1);
            let sum = mean(windows.iter().map(|w| {
                let v = stated(w);
                Vec2::new(v.dot(&w.moved), w.moved.perp(&v))
            }));
            scaled(0, heading_of(sum))
        };
        (0..READINGS.len()).find_map(|reading| scaled(reading, 0.0)).or_else(turned)
    }

    /// Velocity that a window states if this mistake was made in everything but the unit, m/s.
    fn meant(&self, window: &Window<'_>) -> Vec2 {
        let v = window.stated(READINGS[self.reading].1);
        let ahead = direction(-self.turn);
        ahead * v.x + left(ahead) * v.y
    }

    fn explains(&self, window: &Window<'_>) -> bool {
        let scale = self.factor.abs().max(SMALLEST_FACTOR);
        (self.meant(window) - window.moved * self.factor).norm() <= FIT * scale * window.moved.norm()
    }

    fn explains_most(&self, windows: &[&Window<'_>]) -> bool {
        let explained = windows.iter().filter(|w| self.explains(w)).count();
        self.factor.is_finite() && explained as f64 >= MOST * windows.len() as f64
    }

    fn text(&self) -> String {
        if self.factor == 0.0 {
            return "all velocities are zero".to_owned();
        }
        let mut text = format!("they look like velocities{}", READINGS[self.reading].0);
        if self.turn != 0.0 {
            text += &format!(" turned by {:.0}°", self.turn.to_degrees());
        }
        let size = self.factor.abs();
        if self.factor < 0.0 {
            text += " with the opposite sign";
        }
        if (size - 1.0).abs() > RESCALED {
            let unit = UNITS.iter().find(|(unit, _)| (size / unit - 1.0).abs() <= 0.05);
            let unit = unit.map(|(_, name)| format!(", in {name}")).unwrap_or_default();
            text += &format!("{unit}, {size:.2} times as large as differences of positions");
        }
        text
    }
}

/// Agents whose velocities contradict their positions.
#[derive(Debug)]
pub struct VelocityContradiction {
    /// Indices of the agents.
    pub agents: Vec<usize>,
    /// Indices of the agents whose velocities agree with their positions, and would not if the likely mistake
    /// affected them.
    pub consistent: Vec<usize>,
    /// Text about the likely mistake.
    pub likely: String,
}

impl VelocityContradiction {
    /// Compares velocities and positions in every second of each track. An agent contradicts if it does in
    /// most of those in which it moves, at least two in tracks of more than 2 s: trackers move parked
    /// vehicles for a second. `step(i)` is the time from frame `i - 1` to frame `i`, seconds.
    pub fn find<'a>(
        tracks: impl IntoIterator<Item = &'a [Frame]>,
        step: impl Fn(usize) -> f64,
    ) -> Option<Self> {
        let agents = tracks.into_iter().map(|track| {
            let least = if track.len() > 2 * STEPS { 2 } else { 1 };
            (least, Window::of_track(track, &step))
        });
        let agents: Vec<(usize, Vec<Window<'_>>)> = agents.collect();
        let windows = |i: &usize| agents[*i].1.iter();
        let is_wrong = |i: &usize| {
            let wrong = windows(i).filter(|w| w.contradicts).count();
            wrong >= agents[*i].0 && 2 * wrong > windows(i).count()
        };
        let (found, others): (Vec<usize>, Vec<usize>) = (0..agents.len()).partition(is_wrong);
        if found.is_empty() {
            return None;
        }
        let wrong: Vec<_> = found.iter().flat_map(windows).filter(|w| w.contradicts).collect();
        let mistake = Mistake::find(&wrong);
        let is_affected = |i: &usize| mistake.is_some_and(|m| windows(i).all(|w| m.explains(w)));
        let is_consistent = |i: &usize| windows(i).any(|w| !w.contradicts) && !is_affected(i);
        Some(Self {
            agents: found,
            consistent: others.into_iter().filter(is_consistent).collect(),
            likely: mistake.map_or_else(|| "no common mistake explains them".to_owned(), |m| m.text()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Agent, AgentKind, CURRENT, DT, FRAMES, LoggedAgent, Scenario, ScenarioParts};
    use AgentKind::{Cyclist, Pedestrian, Vehicle};

    /// Kind, heading in radians and speed in m/s of the agents, the AV first. The last vehicle stands.
    const AGENTS: [(AgentKind, f64, f64); 9] = [
        (Vehicle, 0.9, 11.0),
        (Vehicle, 0.0, 9.0),
        (Vehicle, 1.6, 6.0),
        (Vehicle, -2.3, 12.0),
        (Vehicle, 2.8, 4.0),
        (Vehicle, 2.0, 0.0),
        (Pedestrian, -1.2, 1.3),
        (Pedestrian, 2.2, 1.5),
        (Cyclist, 0.6, 5.0),
    ];

    /// Returns agents whose true velocities are changed by `state(agent, state)`, and that accelerate a
    /// little.
    fn scenario(change: impl Fn(usize, AgentState) -> Vec2) -> Scenario {
        let agents = AGENTS.iter().enumerate().map(|(i, &(kind, heading, speed))| {
            let state = |f: usize| {
                let t = DT * (f as f64 - CURRENT as f64);
                let acceleration = if speed > 2.0 { 0.2 } else { 0.0 };
                let p = direction(heading) * (speed * t + 0.5 * acceleration * t * t);
                let v = direction(heading) * (speed + acceleration * t);
                let state = AgentState { x: 30.0 * i as f64 + p.x, y: p.y, heading, vx: v.x, vy: v.y };
                let v = change(i, state);
                Some(AgentState { vx: v.x, vy: v.y, ..state })
            };
            let agent = Agent { id: format!("a{i}"), kind, length: 4.0, width: 2.0 };
            LoggedAgent { agent, track: (0..FRAMES).map(state).collect(), heights: Vec::new() }
        });
        Scenario::assemble(ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents: agents.collect(),
            ..ScenarioParts::default()
        })
        .unwrap()
    }

    /// Returns count and detail of the note, and the agents whose velocities are wrong by more than 0.1 m/s
    /// at the current frame.
    fn found(change: impl Fn(usize, Vec2, f64) -> Vec2) -> (u32, String, Vec<usize>) {
        let s = scenario(|i, state| change(i, state.velocity().unwrap(), state.heading));
        let wrong = (0..AGENTS.len()).filter(|&slot| {
            let i: usize = s.start.agents[slot].id[1..].parse().unwrap();
            let (_, heading, speed) = AGENTS[i];
            (s.start.now(slot).velocity().unwrap() - direction(heading) * speed).norm() > 0.1
        });
        let wrong: Vec<usize> = wrong.collect();
        // What is complete does not change.
        let mut again = s.clone();
        again.complete();
        assert_eq!(again.digest(), s.digest());
        let note = s.notes().get("velocity-contradicts").cloned();
        note.map_or((0, String::new(), wrong.clone()), |n| (n.count, n.detail.unwrap(), wrong))
    }

    #[track_caller]
    fn assert_replaced(change: impl Fn(usize, Vec2, f64) -> Vec2, count: u32, likely: &str) {
        let (n, detail, wrong) = found(change);
        assert_eq!((n, wrong), (count, Vec::new()), "{detail}");
        assert!(detail.contains("replaced by differences") && detail.ends_with(likely), "{detail}");
    }

    #[test]
    fn consistent_velocities_stay() {
        assert_eq!(found(|_, v, _| v), (0, String::new(), Vec::new()));
        let exact = scenario(|_, state| state.velocity().unwrap());
        assert!(exact.repairs.is_empty());
        assert_eq!(exact.start.now(0).vx.to_bits(), (direction(0.9) * 11.0).x.to_bits());
    }

    #[test]
    fn mistakes_of_all_agents_are_named_and_replaced() {
        let times = |factor: f64| move |_: usize, v: Vec2, _: f64| v * factor;
        assert_replaced(times(3.6), 8, "in km/h, 3.60 times as large as differences of positions");
        assert_replaced(times(0.5), 8, "velocities, 0.50 times as large as differences of positions");
        assert_replaced(
            times(0.1),
            8,
            "in metres per frame, 0.10 times as large as differences of positions",
        );
        assert_replaced(times(-1.0), 8, "velocities with the opposite sign");
        assert_replaced(times(0.0), 8, "all velocities are zero");
        let own = |v: Vec2, heading: f64| {
            let ahead = direction(heading);
            Vec2::new(v.dot(&ahead), v.dot(&left(ahead)))
        };
        // Agent 1 moves along the x axis: its velocity is the same in both frames.
        let text = "velocities in the frame of each agent, along and across its heading";
        assert_replaced(|_, v, heading| own(v, heading), 7, text);
        let text = "heading, in km/h, 3.60 times as large as differences of positions";
        assert_replaced(|_, v, heading| own(v, heading) * 3.6, 8, text);
        assert_replaced(|_, v, _| Vec2::new(v.y, v.x), 6, "with x and y exchanged");
        let turn = direction(1.0);
        assert_replaced(|_, v, _| turn * v.x + left(turn) * v.y, 8, "velocities turned by 57°");
        let random = |i: usize, v: Vec2, _: f64| v * [0.2, 4.0, -1.0, 9.0, 0.6, 0.0, 3.0, 0.1, 2.0][i];
        assert_replaced(random, 8, "no common mistake explains them");
    }

    #[test]
    fn one_source_of_velocities_is_replaced_alone() {
        let zero = |wrong: fn(usize) -> bool| {
            move |i: usize, v: Vec2, _: f64| if wrong(i) { Vec2::zeros() } else { v }
        };
        assert_replaced(zero(|i| i == 0), 1, "all velocities are zero");
        assert_replaced(zero(|i| AGENTS[i].0 == Pedestrian), 2, "all velocities are zero");
        let (n, detail, wrong) = found(zero(|i| i == 3));
        assert_eq!((n, wrong), (1, vec![3]));
        assert_eq!(detail, "kept velocities, the first of agent `a3`: all velocities are zero");
    }

    #[test]
    fn the_future_is_not_used_for_the_history() {
        // All stand in the history: nothing shows that velocities are zero.
        let later = |f: usize| f.saturating_sub(CURRENT) as f64;
        let track = |v: f64| {
            let state = |f| AgentState { x: later(f), y: 0.0, heading: 0.0, vx: v, vy: 0.0 };
            (0..FRAMES).map(|f| Some(state(f))).collect()
        };
        let agent = Agent { id: "av".into(), kind: Vehicle, length: 4.0, width: 2.0 };
        let parts = ScenarioParts {
            id: "made".into(),
            agents: vec![LoggedAgent { agent, track: track(0.0), heights: Vec::new() }],
            ..ScenarioParts::default()
        };
        let s = Scenario::assemble(parts).unwrap();
        assert_eq!(s.start.now(0).vx, 0.0);
        assert_eq!(s.log_future.tracks[0][0].unwrap().vx, 10.0);
        assert_eq!(s.notes()["velocity-contradicts"].count, 1);
    }

    #[test]
    fn noise_and_jumps_of_positions_contradict_nothing() {
        let noise = |f: usize| [0.3, -0.25, 0.1, -0.35, 0.2, 0.0, -0.1][f % 7];
        let jump = |f: usize| if f >= 5 { 6.0 } else { 0.0 };
        for aside in [noise as fn(usize) -> f64, jump] {
            let state =
                |f: usize| AgentState { x: 0.2 * f as f64, y: aside(f), heading: 0.0, vx: 2.0, vy: 0.0 };
            let track: Vec<Frame> = (0..FRAMES).map(|f| Some(state(f))).collect();
            assert!(VelocityContradiction::find([track.as_slice()], |_| DT).is_none());
        }
    }
}
