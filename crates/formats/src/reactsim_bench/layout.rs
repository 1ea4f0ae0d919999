//! Layouts: what the numbers of a file may mean, and how well the AV then continues its log.

use std::fmt;

use reactsim_geometry::{Vec2, direction, left, wrap};
use reactsim_scene::CURRENT;

use super::content::{Content, Table};
use crate::nuplan::Pose;

/// Times are counted in ticks of 0.05 s; a frame has two.
pub(super) const TICK: f64 = 0.05;
/// Last time of a scenario, ticks.
pub(super) const END: i32 = 160;
/// Steps between entries, ticks.
const STEPS: [i32; 4] = [1, 2, 4, 10];
/// Times of the first entry before the current frame, ticks; otherwise it is one step after it.
const FIRSTS: [i32; 3] = [-40, -20, 0];
/// Largest distance from the log at frames that are recorded, metres.
const SAME: f64 = 0.5;
/// Largest acceleration with which an entry continues the log, m/s².
const MAX_ACCELERATION: f64 = 8.0;
/// Distance from the log up to which a trajectory is the log itself, metres.
const LOGGED: f64 = 0.1;
/// Costs of a layout that ends one step before and anywhere after the scenario, metres.
const OTHER_END: [f64; 2] = [0.1, 0.5];

/// Point of the AV.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Point {
    /// Rear axle.
    Axle,
    /// Centre of the box.
    Center,
}

/// Frame of coordinates.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Axes {
    /// That of the map.
    Global,
    /// The origin is the AV at the current or the first frame; `turned` if x points ahead of it.
    Av {
        /// At the first frame of the scenario, not at the current one.
        first: bool,
        /// x points ahead.
        turned: bool,
        /// Point of the AV.
        point: Point,
    },
    /// The origin is in the file.
    Stated {
        /// Key of x, y and, last, the heading.
        key: String,
        /// The axes have this heading.
        turned: bool,
    },
}

/// Frame that the second token of a file name names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sample {
    /// The current frame.
    Current,
    /// The first frame.
    First,
}

/// Trajectory of an array of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// This one.
    At(usize),
    /// The one that the file states as the index of the AV.
    Av,
}

/// Meaning of the numbers of a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Layout {
    /// Key of the array.
    pub key: String,
    /// Number of trajectories in it, 0 if it differs from file to file.
    pub slot: Slot,
    /// Column of x; y follows.
    pub column: usize,
    /// Frame of coordinates.
    pub axes: Axes,
    /// Point of the AV.
    pub point: Point,
    /// Time of the first entry after the current frame, ticks of 0.05 s.
    pub first: i32,
    /// Time between entries, ticks.
    pub step: i32,
    /// Frame that the file name names.
    pub sample: Sample,
}

/// How well the AV continues its log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Sum of distances, metres.
    pub(super) cost: f64,
    /// Whether the trajectory is the log.
    pub(super) is_log: bool,
    /// Entries and columns of the array.
    pub(super) shape: [usize; 2],
}

/// What the user states; the rest is found.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Key of the array, with `[N]` for one of several trajectories.
    pub array: Option<String>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Name of the frame of coordinates.
    pub frame: Option<String>,
    /// Point of the AV.
    pub point: Option<Point>,
    /// Frame that the file names name.
    pub sample: Option<Sample>,
}

/// Poses of the logged AV in the 91 frames, if the file name names the current and if it names the first one.
pub type Windows = [Option<Vec<Pose>>; 2];

impl Sample {
    /// Both, in the order of [`Windows`].
    pub const ALL: [Self; 2] = [Self::Current, Self::First];

    pub(super) fn of(self, windows: &Windows) -> Option<&[Pose]> {
        windows[self as usize].as_deref()
    }
}

impl Point {
    pub(super) fn of(self, pose: &Pose) -> Vec2 {
        if self == Self::Axle { pose.axle } else { pose.center() }
    }
}

impl Axes {
    /// Names for the command line.
    pub const NAMES: [&str; 6] = ["global", "av", "av-offset", "first", "first-offset", "stated"];

    fn name(&self) -> &'static str {
        match self {
            Self::Global => "global",
            Self::Av { first: false, turned: true, .. } => "av",
            Self::Av { first: false, turned: false, .. } => "av-offset",
            Self::Av { first: true, turned: true, .. } => "first",
            Self::Av { first: true, turned: false, .. } => "first-offset",
            Self::Stated { .. } => "stated",
        }
    }

    fn all(content: &Content) -> Vec<Self> {
        let mut all = vec![Self::Global];
        for (first, turned) in [(false, true), (false, false), (true, true), (true, false)] {
            all.extend([Point::Axle, Point::Center].map(|point| Self::Av { first, turned, point }));
        }
        for (key, numbers) in &content.origins {
            let turned = [false, true].into_iter().take(if numbers.len() > 2 { 2 } else { 1 });
            all.extend(turned.map(|turned| Self::Stated { key: key.clone(), turned }));
        }
        all
    }

    /// Returns origin and heading of the axes.
    pub(super) fn place(&self, content: &Content, window: &[Pose]) -> Option<(Vec2, f64)> {
        Some(match self {
            Self::Global => (Vec2::zeros(), 0.0),
            Self::Av { first, turned, point } => {
                let pose = &window[if *first { 0 } else { CURRENT }];
                (point.of(pose), if *turned { pose.heading } else { 0.0 })
            }
            Self::Stated { key, turned } => {
                let (_, numbers) = content.origins.iter().find(|(k, _)| k == key)?;
                let heading = if *turned { *numbers.last()? } else { 0.0 };
                (Vec2::new(numbers[0], numbers[1]), heading)
            }
        })
    }
}

impl Layout {
    /// Returns the table of a file and the trajectory in it.
    pub(super) fn find<'a>(&self, content: &'a Content) -> Option<(&'a Table, usize)> {
        let table = content.tables.iter().find(|table| table.key == self.key)?;
        let slot = match self.slot {
            Slot::At(slot) => slot,
            Slot::Av => content.av?,
        };
        (slot < table.slots).then_some((table, slot))
    }

    /// Returns all layouts of a file in which the AV continues its log.
    pub(super) fn fitting(content: &Content, windows: &Windows, choice: &Choice) -> Vec<(Self, Fit)> {
        let axes = Axes::all(content);
        let mut found = Vec::new();
        for table in &content.tables {
            let stated = content.av.map(|_| Slot::Av);
            for slot in (0..table.slots).map(Slot::At).chain(stated) {
                for (sample, column, first, step) in starts(table, choice) {
                    for (axes, point) in
                        axes.iter().flat_map(|a| [Point::Axle, Point::Center].map(|p| (a, p)))
                    {
                        if choice.refuses(axes, point, table, slot) {
                            continue;
                        }
                        let (key, axes) = (table.key.clone(), axes.clone());
                        let layout = Self { key, slot, column, axes, point, first, step, sample };
                        found.extend(layout.fit(content, windows).map(|fit| (layout, fit)));
                    }
                }
            }
        }
        found
    }

    /// Returns how well the AV continues its log; `None` if it does not.
    pub(super) fn fit(&self, content: &Content, windows: &Windows) -> Option<Fit> {
        let ((table, slot), window) = (self.find(content)?, self.sample.of(windows)?);
        let (origin, heading) = self.axes.place(content, window)?;
        let (ahead, logged) = (direction(heading), |frame: usize| self.point.of(&window[frame]));
        let entry = |row: usize| {
            let at = |column: usize| table.at(slot, row, column);
            origin + ahead * at(self.column) + left(ahead) * at(self.column + 1)
        };
        let frame_of = |time: i32| usize::try_from(time / 2 + CURRENT as i32).ok();
        let (mut distance, mut known, mut row) = (0.0, 0.0, 0);
        let mut time = self.first;
        while time <= 0 {
            if let Some(frame) = frame_of(time).filter(|_| time % 2 == 0 && time >= -2 * CURRENT as i32) {
                let by = (entry(row) - logged(frame)).norm();
                if !(by <= SAME) {
                    return None;
                }
                (distance, known) = (distance + by, known + 1.0);
            }
            (time, row) = (time + self.step, row + 1);
        }
        // The log continues along its bend.
        let velocity = (logged(CURRENT) - logged(CURRENT - 1)) / 0.1;
        let turn = wrap(window[CURRENT].heading - window[CURRENT - 1].heading) / 0.1;
        let (after, step) = (f64::from(time) * TICK, f64::from(self.step) * TICK);
        let driven = |from: f64, by: f64| {
            let ahead = direction(turn * (0.05 + from + 0.5 * by));
            (ahead * velocity.x + left(ahead) * velocity.y) * by
        };
        let jump = (entry(row) - logged(CURRENT) - driven(0.0, after)).norm();
        let change = (entry(row + 1) - entry(row) - driven(after, step)).norm();
        let bound = |base: f64, time: f64, share: f64| base + share * MAX_ACCELERATION * time * time;
        if !(jump <= bound(SAME, after, 0.5) && change <= bound(0.6 * SAME, step, 1.0)) {
            return None;
        }
        let end = self.first + (table.rows as i32 - 1) * self.step;
        let other_end = if end == END { 0.0 } else { OTHER_END[usize::from(end > END)] };
        let is_log = (row..table.rows).all(|row| {
            let time = self.first + row as i32 * self.step;
            let frame = frame_of(time).filter(|frame| *frame < window.len() && time % 2 == 0);
            frame.is_none_or(|frame| (entry(row) - logged(frame)).norm() <= LOGGED)
        });
        let cost = distance / f64::max(known, 1.0) + jump + change + other_end;
        Some(Fit { cost, is_log, shape: [table.rows, table.names.len()] })
    }
}

/// Returns the possible times of the entries of a table and its columns of x.
fn starts(table: &Table, choice: &Choice) -> Vec<(Sample, usize, i32, i32)> {
    let stated = choice.columns.iter().position(|name| name == "x");
    let columns = (1..table.names.len()).map(|next| next - 1);
    let columns = columns.filter(|column| stated.map_or(*column < 2, |stated| stated == *column));
    let mut found = Vec::new();
    for (sample, column) in Sample::ALL.into_iter().flat_map(|s| columns.clone().map(move |c| (s, c))) {
        for step in STEPS {
            for first in FIRSTS.into_iter().chain([step]) {
                let end = first + (table.rows as i32 - 1) * step;
                // One missing step is continued.
                let is_long = end >= END - 2 && (first == step || first % step == 0);
                if is_long && choice.sample.is_none_or(|s| s == sample) {
                    found.push((sample, column, first, step));
                }
            }
        }
    }
    found
}

impl Choice {
    fn refuses(&self, axes: &Axes, point: Point, table: &Table, slot: Slot) -> bool {
        let named = |array: &String| {
            let is_slot = matches!(slot, Slot::At(n) if *array == format!("{}[{n}]", table.key));
            *array == table.key || is_slot
        };
        self.point.is_some_and(|stated| stated != point)
            || self.frame.as_ref().is_some_and(|stated| stated != axes.name())
            || self.array.as_ref().is_some_and(|array| !named(array))
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let key = if self.key.is_empty() { "the array" } else { &self.key };
        write!(f, "`{key}`")?;
        match self.slot {
            Slot::At(0) => {}
            Slot::At(slot) => write!(f, "[{slot}]")?,
            Slot::Av => f.write_str("[index of the AV]")?,
        }
        if self.column > 0 {
            write!(f, ", x in column {}", self.column)?;
        }
        match &self.axes {
            Axes::Stated { key, turned } => {
                write!(f, ", origin{} in `{key}`", if *turned { " and heading" } else { "" })?;
            }
            Axes::Global => f.write_str(", global")?,
            axes => write!(f, ", frame {}", axes.name())?,
        }
        f.write_str(if self.point == Point::Axle { ", rear axle" } else { ", box centre" })?;
        let (frame, step) = (CURRENT as f64 + 0.5 * f64::from(self.first), f64::from(self.step) * TICK);
        write!(f, ", first entry is frame {frame}, {step:.2} s apart")?;
        f.write_str(match self.sample {
            Sample::Current => ", file names name the current frame",
            Sample::First => ", file names name the first frame",
        })
    }
}
