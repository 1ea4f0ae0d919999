//! Lines of the map, cut into polylines of a few points.

use std::sync::OnceLock;

use reactsim_geometry::{Bounds, Polyline, Vec2};
use reactsim_nn::learning::LearningMap;
use reactsim_nn::perception::{MAX_LINE_LENGTH, Nearest, PointIndex, closed, edge_rings};
use reactsim_scene::{LaneClass, LaneKind, LightState, RoadEdgeKind, RoadMap, Start, StopKind};

use super::frame::{LocalFrame, PolylineFeatures};
use crate::regression::network::{Attributes, Config};

/// Returns the number of features of a point of a line.
pub(crate) const fn point_numbers(attributes: Attributes) -> usize {
    match attributes {
        // Point and direction in space, kind, the point before.
        Attributes::Published => 3 + 3 + 1 + 2,
        // Point, direction, the point before, kind, state of the light, speed limit and whether it is
        // known.
        Attributes::Own => 2 + 2 + 2 + KINDS + LIGHT_FEATURES + 2,
    }
}

/// Kind of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Freeway,
    Street,
    BikeLane,
    /// A connector through a junction, in maps that distinguish connectors from lanes.
    Junction,
    Boundary,
    Median,
    LightStop,
    SignStop,
    Yield,
    Crosswalk,
    /// A painted line, with its code.
    Paint(u8),
    Bump,
}

/// Number of kinds in our own attributes.
const KINDS: usize = 10;

impl Kind {
    /// Returns the index in our own attributes; painted lines and bumps are not in the input.
    const fn own(self) -> Option<usize> {
        Some(match self {
            Self::Freeway => 0,
            Self::Street => 1,
            Self::BikeLane => 2,
            Self::Junction => 3,
            Self::Boundary => 4,
            Self::Median => 5,
            Self::LightStop => 6,
            Self::SignStop => 7,
            Self::Yield => 8,
            Self::Crosswalk => 9,
            Self::Paint(_) | Self::Bump => return None,
        })
    }

    /// Returns the code in the public code; stop lines of lights and give-way lines have none.
    const fn published(self) -> Option<f32> {
        Some(match self {
            Self::Freeway => 1.0,
            Self::Street | Self::Junction => 2.0,
            Self::BikeLane => 3.0,
            // Kinds of paint are numbered from 6 on, in the order of the Waymo messages from 1 on.
            Self::Paint(0) => -1.0,
            Self::Paint(code) => 5.0 + code as f32,
            Self::Boundary => 15.0,
            Self::Median => 16.0,
            Self::SignStop => 17.0,
            Self::Crosswalk => 18.0,
            Self::Bump => 19.0,
            Self::LightStop | Self::Yield => return None,
        })
    }

    fn is_edge(self) -> bool {
        matches!(self, Self::Boundary | Self::Median)
    }
}

/// A piece of a line.
#[derive(Clone, Debug)]
struct Line {
    /// At most [`Config::points`] points, at equal distances except for the last.
    points: Vec<Vec2>,
    kind: Kind,
    /// Index of the light of its lane.
    light: Option<usize>,
    /// Speed limit of its lane, m/s.
    speed_limit: Option<f64>,
    /// Mean of the points.
    middle: Vec2,
}

/// Known lines of a map.
#[derive(Clone, Debug, Default)]
pub(super) struct Lines {
    all: Vec<Line>,
    /// Index of their middles, made when it is first asked for.
    middles: OnceLock<PointIndex>,
}

impl Lines {
    /// Extracts the lines of a scenario within the radius around the AV's position at the current
    /// frame.
    pub(super) fn of(start: &Start, config: &Config) -> Self {
        let mut cutter = LineCutter { about: start.now(0).position(), config, lines: Self::default() };
        let light_of = |lane: usize| start.lights.iter().position(|l| l.lane == lane);
        cutter.cut_map(&start.map, light_of);
        cutter.lines
    }

    /// Returns the lines of these rows as features in the frame of an agent, with the states of lights.
    pub(super) fn features(
        &self,
        rows: &[usize],
        frame: &LocalFrame,
        lights: &[Option<LightState>],
        config: &Config,
    ) -> PolylineFeatures {
        let numbers = point_numbers(config.attributes);
        let mut features = PolylineFeatures::absent(config.points, config.lines, numbers);
        for (row, &i) in rows.iter().enumerate() {
            let line = &self.all[i];
            let light = line.state(lights);
            for k in 0..line.points.len() {
                let at = k * config.lines + row;
                features.there[at] = 1.0;
                let out = &mut features.points[at * numbers..(at + 1) * numbers];
                line.write(k, frame, light, config.attributes, out);
            }
        }
        features
    }

    /// Returns the rows of the lines nearest to a point, at most `count`, nearest first.
    pub(super) fn nearest(&self, to: Vec2, count: usize) -> Vec<usize> {
        let mut nearest = Nearest::new(count);
        let index = || PointIndex::new(self.all.iter().map(|line| line.middle).collect());
        self.middles.get_or_init(index).nearest(to, |_| true, &mut nearest);
        nearest.found().collect()
    }

    /// Returns the position of a line in the frame of an agent, metres.
    pub(super) fn place(&self, row: usize, frame: &LocalFrame) -> [f32; 2] {
        let at = frame.point(self.all[row].middle);
        [at.x as f32, at.y as f32]
    }
}

/// Number of features of the state of a light.
const LIGHT_FEATURES: usize = 4;

/// Returns whether a light is red, yellow, green, or shows something else.
fn light_features(light: Option<LightState>) -> [f64; LIGHT_FEATURES] {
    let shown = |f: fn(LightState) -> bool| f64::from(light.is_some_and(f));
    [
        shown(LightState::is_red),
        shown(LightState::is_yellow),
        shown(|l| matches!(l, LightState::Go | LightState::ArrowGo)),
        shown(|l| matches!(l, LightState::Unknown | LightState::FlashingStop | LightState::FlashingCaution)),
    ]
}

impl LearningMap for Lines {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        self.middles.take();
        for line in &mut self.all {
            line.points.iter_mut().for_each(|p| *p = flip(*p));
            line.middle = flip(line.middle);
            // Edges have the road on their left.
            if line.kind.is_edge() {
                line.points.reverse();
            }
        }
    }

    fn stretch(&mut self, factor: f64) {
        self.middles.take();
        for line in &mut self.all {
            line.points.iter_mut().for_each(|p| *p *= factor);
            line.middle *= factor;
            line.speed_limit = line.speed_limit.map(|v| v * factor);
        }
    }
}

impl Line {
    fn state(&self, lights: &[Option<LightState>]) -> Option<LightState> {
        self.light.and_then(|light| lights.get(light).copied().flatten())
    }

    /// Writes the features of its `k`-th point.
    fn write(
        &self,
        k: usize,
        frame: &LocalFrame,
        light: Option<LightState>,
        attributes: Attributes,
        out: &mut [f32],
    ) {
        let point = frame.point(self.points[k]);
        let before = frame.point(self.points[k.saturating_sub(1)]);
        let chord = match (k, self.points.get(1)) {
            (0, Some(second)) => frame.point(*second) - point,
            _ => point - before,
        };
        let ahead = if chord.norm() > 1e-6 { chord.normalize() } else { Vec2::zeros() };
        match attributes {
            Attributes::Published => {
                let kind = f64::from(self.kind.published().unwrap_or(-1.0));
                put(out, &[point.x, point.y, 0.0, ahead.x, ahead.y, 0.0, kind, before.x, before.y]);
            }
            Attributes::Own => {
                let step = point - before;
                put(out, &[point.x / 20.0, point.y / 20.0, ahead.x, ahead.y, step.x / 2.0, step.y / 2.0]);
                if let Some(kind) = self.kind.own() {
                    out[6 + kind] = 1.0;
                }
                let limit = self.speed_limit.map_or([0.0, 0.0], |v| [v / 20.0, 1.0]);
                put(&mut out[6 + KINDS..], &light_features(light));
                put(&mut out[6 + KINDS + LIGHT_FEATURES..], &limit);
            }
        }
    }
}

fn put(out: &mut [f32], values: &[f64]) {
    for (slot, value) in out.iter_mut().zip(values) {
        *slot = *value as f32;
    }
}

/// Cutter of lines near a point.
struct LineCutter<'a> {
    about: Vec2,
    config: &'a Config,
    lines: Lines,
}

impl LineCutter<'_> {
    fn cut_map(&mut self, map: &RoadMap, light_of: impl Fn(usize) -> Option<usize>) {
        let has_connectors = map.lanes.iter().any(|l| l.kind == LaneKind::Lane);
        for (i, lane) in map.lanes.iter().enumerate() {
            let kind = match (lane.kind, lane.class) {
                (_, LaneClass::Bike) => Kind::BikeLane,
                (LaneKind::Connector, _) if has_connectors => Kind::Junction,
                (_, LaneClass::Freeway) => Kind::Freeway,
                _ => Kind::Street,
            };
            self.cut(&lane.baseline, kind, light_of(i), lane.speed_limit);
        }
        for edge in &map.road_edges {
            let kind = if edge.kind == RoadEdgeKind::Median { Kind::Median } else { Kind::Boundary };
            self.cut_points(&edge.points, kind, None);
        }
        if map.road_edges.is_empty() {
            for (ring, is_hole) in edge_rings(map) {
                self.cut_points(&ring, if is_hole { Kind::Median } else { Kind::Boundary }, None);
            }
        }
        for line in &map.stop_lines {
            let kind = match line.kind {
                StopKind::Light => Kind::LightStop,
                StopKind::Sign => Kind::SignStop,
                StopKind::Yield => Kind::Yield,
            };
            self.cut_points(&line.ends, kind, light_of(line.lane));
        }
        for crosswalk in &map.crosswalks {
            self.cut_points(&closed(&crosswalk.outline), Kind::Crosswalk, None);
        }
        for line in &map.road_lines {
            self.cut_points(&line.points, Kind::Paint(line.paint), None);
        }
        for bump in &map.speed_bumps {
            self.cut_points(&closed(&bump.outline), Kind::Bump, None);
        }
    }

    fn cut_points(&mut self, points: &[Vec2], kind: Kind, light: Option<usize>) {
        if let Ok(line) = Polyline::new(points) {
            self.cut(&line, kind, light, None);
        }
    }

    /// Cuts a line into pieces; where it is cut does not depend on the position of the AV.
    fn cut(&mut self, line: &Polyline, kind: Kind, light: Option<usize>, speed_limit: Option<f64>) {
        let shown = match self.config.attributes {
            Attributes::Published => kind.published().is_some(),
            Attributes::Own => kind.own().is_some(),
        };
        let near = Bounds::around(self.about, self.config.radius);
        let bounds = Bounds::of(line.points().iter().copied());
        if !shown || !bounds.intersects(&near) || !(line.length() <= MAX_LINE_LENGTH) {
            return;
        }
        let (length, spacing) = (line.length(), self.config.spacing);
        let steps = (length / spacing).ceil() as usize;
        let mut segment = 0;
        let mut at = |k: usize| {
            let s = (k as f64 * spacing).min(length);
            segment = line.segment_from(s, segment);
            line.on_segment(s, segment)
        };
        let mut first = 0;
        // Pieces share their ends, which shows where lines go on.
        while first < steps {
            let last = (first + self.config.points.max(2) - 1).min(steps);
            let mut points: Vec<Vec2> = (first..=last).map(&mut at).collect();
            points.truncate(self.config.points);
            let reach = self.config.radius * self.config.radius;
            if points.iter().any(|p| (p - self.about).norm_squared() <= reach) {
                let middle = points.iter().sum::<Vec2>() / points.len() as f64;
                self.lines.all.push(Line { points, kind, light, speed_limit, middle });
            }
            first = last;
        }
    }
}
