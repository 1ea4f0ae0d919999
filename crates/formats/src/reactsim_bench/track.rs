//! The trajectory of a file under a layout: 80 states at 10 Hz.

use std::f64::consts::PI;
use std::fmt;

use reactsim_geometry::{Vec2, direction, heading_of, math, wrap};
use reactsim_scene::{AgentState, CURRENT, FUTURE};

use super::content::Content;
use super::layout::{Choice, END, Fit, Layout, Point, TICK, Windows};
use crate::nuplan::Pose;

/// Speed from which the direction of motion shows the heading, m/s.
const MOVING: f64 = 2.0;
/// Largest difference of a heading from that of the log, and mean one from the direction of motion, radians.
const SAME_HEADING: f64 = 0.25;
/// Radians by which headings from the motion must fit better than those of a column: a column of other
/// numbers fits worse than that.
const CLOSER: f64 = 0.02;
/// Shortest distance that shows a direction, metres.
const SHORTEST: f64 = 0.05;

/// Where the headings are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Heading {
    /// Cosine and sine in these columns.
    Vector(usize, usize),
    /// Radians in a column.
    Radians(usize),
    /// Degrees in a column.
    Degrees(usize),
    /// Nowhere: the direction of motion is taken.
    Motion,
}

impl fmt::Display for Heading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Motion => f.write_str("headings from the motion"),
            Self::Radians(column) => write!(f, "headings in column {column}"),
            Self::Degrees(column) => write!(f, "headings in degrees in column {column}"),
            Self::Vector(cos, sin) => write!(f, "headings as cosine and sine in columns {cos} and {sin}"),
        }
    }
}

/// Entry of a trajectory in world coordinates.
#[derive(Clone, Copy)]
struct Knot {
    /// Ticks after the current frame.
    time: i32,
    at: Vec2,
    heading: f64,
}

impl Heading {
    /// Returns how well the headings fit to the log and to the motion, by place, if they do.
    pub(super) fn fitting(
        content: &Content,
        windows: &Windows,
        layout: &Layout,
        choice: &Choice,
    ) -> Vec<(Self, Fit)> {
        let Some((table, _)) = layout.find(content) else { return Vec::new() };
        let columns: Vec<usize> =
            (0..table.names.len()).filter(|c| *c != layout.column && *c != layout.column + 1).collect();
        let place = |name: &str| choice.columns.iter().position(|n| n == name);
        let all = match (place("heading"), place("cos").zip(place("sin")), choice.columns.is_empty()) {
            (Some(column), ..) => vec![Self::Radians(column)],
            (None, Some((cos, sin)), _) => vec![Self::Vector(cos, sin)],
            (None, None, false) => Vec::new(),
            (None, None, true) => {
                let single = columns.iter().flat_map(|c| [Self::Radians(*c), Self::Degrees(*c)]);
                let next = |c: &usize| columns.contains(&(c + 1)).then_some((*c, c + 1));
                let pairs = columns.iter().filter_map(next);
                let pairs = pairs.flat_map(|(a, b)| [Self::Vector(a, b), Self::Vector(b, a)]);
                single.chain(pairs).chain([Self::Motion]).collect()
            }
        };
        let fit =
            |h: Self| Some(Fit { cost: h.cost(content, windows, layout)?, is_log: false, shape: [0; 2] });
        all.into_iter().filter_map(|h| Some((h, fit(h)?))).collect()
    }

    fn cost(self, content: &Content, windows: &Windows, layout: &Layout) -> Option<f64> {
        let knots = knots(content, windows, layout, self)?;
        let now = layout.sample.of(windows)?[CURRENT].heading;
        let begin = wrap(knots.iter().find(|knot| knot.time >= 0)?.heading - now).abs();
        let (mut sum, mut count) = (0.0, 0);
        for pair in knots.windows(2) {
            let by = pair[1].at - pair[0].at;
            if by.norm() >= MOVING * TICK * f64::from(pair[1].time - pair[0].time) {
                // Vehicles may reverse.
                let off = wrap(heading_of(by) - middle(pair)).abs();
                (sum, count) = (sum + off.min(PI - off), count + 1);
            }
        }
        let off = sum / f64::from(count.max(1));
        let more = if self == Self::Motion { CLOSER } else { 0.0 };
        (begin <= SAME_HEADING && off <= SAME_HEADING).then_some(begin + off + more)
    }

    fn at(self, number: impl Fn(usize) -> f64) -> Option<f64> {
        match self {
            Self::Radians(column) => Some(number(column)),
            Self::Degrees(column) => Some(number(column).to_radians()),
            Self::Vector(cos, sin) => {
                let (cos, sin) = (number(cos), number(sin));
                // NaN is no length either.
                ((math::hypot(cos, sin) - 1.0).abs() < 0.2).then(|| math::atan2(sin, cos))
            }
            Self::Motion => Some(0.0),
        }
        .filter(|heading| heading.is_finite())
    }
}

/// Returns the heading between two entries.
fn middle(pair: &[Knot]) -> f64 {
    pair[0].heading + 0.5 * wrap(pair[1].heading - pair[0].heading)
}

/// Returns the entries from the current frame on, with headings without jumps.
fn knots(content: &Content, windows: &Windows, layout: &Layout, heading: Heading) -> Option<Vec<Knot>> {
    let ((table, slot), window) = (layout.find(content)?, layout.sample.of(windows)?);
    let (origin, turn) = layout.axes.place(content, window)?;
    let (ahead, aside) = (direction(turn), direction(turn + 0.5 * PI));
    let now = &window[CURRENT];
    let mut knots: Vec<Knot> = Vec::new();
    if layout.first > 0 {
        knots.push(Knot { time: 0, at: layout.point.of(now), heading: now.heading });
    }
    for row in 0..table.rows {
        let time = layout.first + row as i32 * layout.step;
        if (0..=END).contains(&time) {
            let number = |column: usize| table.at(slot, row, column);
            let at = origin + ahead * number(layout.column) + aside * number(layout.column + 1);
            let heading = heading.at(number)? + turn;
            let last = knots.last().map_or(heading, |last| last.heading + wrap(heading - last.heading));
            (at.x.is_finite() && at.y.is_finite()).then(|| knots.push(Knot { time, at, heading: last }))?;
        }
    }
    if let [.., before, last] = knots[..]
        && last.time < END
    {
        let heading = 2.0 * last.heading - before.heading;
        knots.push(Knot { time: 2 * last.time - before.time, at: last.at * 2.0 - before.at, heading });
    }
    if heading == Heading::Motion {
        let mut last = now.heading;
        for i in 0..knots.len() {
            let by = knots[(i + 1).min(knots.len() - 1)].at - knots[i.saturating_sub(1)].at;
            if by.norm() >= SHORTEST {
                let off = wrap(heading_of(by) - last);
                // Out of a stand a vehicle may reverse.
                last += if off.abs() > 0.5 * PI { wrap(off - PI) } else { off };
            }
            knots[i].heading = last;
        }
    }
    Some(knots)
}

/// Returns the states at steps 1 to 80, of the centre of the box; velocities are unknown.
pub(super) fn states(
    content: &Content,
    windows: &Windows,
    layout: &Layout,
    heading: Heading,
) -> Option<Vec<AgentState>> {
    let knots = knots(content, windows, layout, heading)?;
    let state = |step: usize| {
        let (at, heading) = between(&knots, 2 * step as i32)?;
        let center = match layout.point {
            Point::Axle => Pose { axle: at, heading }.center(),
            Point::Center => at,
        };
        let unknown = f64::NAN;
        Some(AgentState { x: center.x, y: center.y, heading: wrap(heading), vx: unknown, vy: unknown })
    };
    (1..=FUTURE).map(state).collect()
}

/// Returns the pose at a time: that of an entry, or between two of them that of a cubic with the mean slopes.
fn between(knots: &[Knot], time: i32) -> Option<(Vec2, f64)> {
    let next = knots.partition_point(|knot| knot.time < time);
    let after = knots.get(next)?;
    if after.time == time || next == 0 {
        return (after.time == time).then_some((after.at, after.heading));
    }
    let slope = |i: usize| {
        let (a, b) = (&knots[i.saturating_sub(1)], &knots[(i + 1).min(knots.len() - 1)]);
        let span = f64::from(b.time - a.time);
        ((b.at - a.at) / span, (b.heading - a.heading) / span)
    };
    let (before, (from, from_turn), (to, to_turn)) = (&knots[next - 1], slope(next - 1), slope(next));
    let span = f64::from(after.time - before.time);
    let u = f64::from(time - before.time) / span;
    let (a, b) = ((1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u), u * u * (3.0 - 2.0 * u));
    let (c, d) = (u * (1.0 - u) * (1.0 - u) * span, u * u * (u - 1.0) * span);
    let at = before.at * a + after.at * b + from * c + to * d;
    Some((at, before.heading * a + after.heading * b + from_turn * c + to_turn * d))
}
