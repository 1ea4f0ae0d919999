//! The map for CATK's network: pieces of 5 m that are matched to the curves of a vocabulary.

use reactsim_geometry::{Polyline, Vec2, direction, heading_of, into_frame};
use reactsim_nn::perception::{MAX_LINE_LENGTH, edge_rings};
use reactsim_scene::{LaneClass, LightState, RoadEdgeKind, RoadMap, Start, StopKind};

/// Spacing of points along a piece, metres.
const SPACING: f64 = 0.5;
/// Number of spacings in a whole piece, which is 5 m long.
const STEPS: usize = 10;
/// Number of points of a piece's curve.
pub const CURVE_POINTS: usize = STEPS + 1;
/// Distance between two points above which a line is split, metres.
const MAX_POINT_GAP: f64 = 3.0;
/// Largest fraction of the length of lanes with such gaps in a map that counts as sampled.
const MAX_GAP_FRACTION: f64 = 0.1;
/// Smallest number of remaining points that form a piece of their own.
const MIN_REMAINING_POINTS: usize = 3;
/// Spacing of points along the sides of crosswalks, metres.
const CROSSWALK_SPACING: f64 = 1.0;

/// A piece of a line of the map, about 5 m long.
#[derive(Clone, Debug, PartialEq)]
pub struct CurvePiece {
    /// Points 0.5 m apart, scenario frame: 11 of them, or 3 to 10 for the rest of a line.
    pub points: Vec<Vec2>,
    /// Kind of line that it is part of.
    pub kind: CurveKind,
    /// Current state of the light of its lane.
    pub light: LightCode,
}

/// Kind of a piece (the point types of CATK, in the order of their codes).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveKind {
    /// A lane of a motorway.
    Freeway,
    /// Any other lane.
    SurfaceStreet,
    /// A lane with a stop sign.
    StopSign,
    /// A lane for bicycles.
    BikeLane,
    /// The outer edge of the road.
    EdgeBoundary,
    /// A median.
    EdgeMedian,
    /// A broken line.
    BrokenLine,
    /// A solid line.
    SolidLine,
    /// A double line.
    DoubleLine,
    /// A crosswalk, speed bump or driveway.
    Crosswalk,
}

/// Light state in CATK's terms, in the order of its codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightCode {
    /// There is no light.
    None,
    /// Observed, colour unknown.
    Unknown,
    /// Red, flashing or not, arrow or not.
    Stop,
    /// Green, arrow or not.
    Go,
    /// Yellow, flashing or not, arrow or not.
    Caution,
}

impl CurveKind {
    /// Returns the code, 0 to 9.
    pub const fn code(self) -> usize {
        self as usize
    }

    /// Returns the code of the type of line: 0 lane, 1 road edge, 2 road line, 3 crosswalk.
    pub const fn line_code(self) -> usize {
        match self {
            Self::Freeway | Self::SurfaceStreet | Self::StopSign | Self::BikeLane => 0,
            Self::EdgeBoundary | Self::EdgeMedian => 1,
            Self::BrokenLine | Self::SolidLine | Self::DoubleLine => 2,
            Self::Crosswalk => 3,
        }
    }
}

impl LightCode {
    /// Returns the code, 0 to 4.
    pub const fn code(self) -> usize {
        self as usize
    }
}

impl From<LightState> for LightCode {
    fn from(state: LightState) -> Self {
        match state {
            LightState::Unknown => Self::Unknown,
            LightState::ArrowStop | LightState::Stop | LightState::FlashingStop => Self::Stop,
            LightState::ArrowCaution | LightState::Caution | LightState::FlashingCaution => Self::Caution,
            LightState::ArrowGo | LightState::Go => Self::Go,
        }
    }
}

impl CurvePiece {
    /// Returns its first point.
    pub fn start(&self) -> Vec2 {
        self.points[0]
    }

    /// Returns the heading of its first half metre, radians.
    pub fn heading(&self) -> f64 {
        heading_of(self.points[1] - self.points[0])
    }

    /// Returns its first, middle and last point, by which it is matched.
    pub fn samples(&self) -> [Vec2; 3] {
        let last = self.points.len() - 1;
        [self.points[0], self.points[last / 2], self.points[last]]
    }

    /// Returns eleven evenly spaced points in the frame of its start: the first point is 0, 0, and the
    /// first chord is along x.
    pub fn curve(&self) -> [Vec2; CURVE_POINTS] {
        let ahead = direction(self.heading());
        let last = (self.points.len() - 1) as f64;
        std::array::from_fn(|i| {
            let at = last * i as f64 / STEPS as f64;
            let k = (at.floor() as usize).min(self.points.len() - 2);
            let point = self.points[k] + (self.points[k + 1] - self.points[k]) * (at - k as f64);
            into_frame(ahead, point - self.points[0])
        })
    }
}

/// Returns all pieces of a map, in its order: lanes, road edges, road lines, crosswalks, speed bumps,
/// driveways. Maps without road edges get pieces along the edge of their drivable area.
///
/// Maps with sparse points are resampled first. In sampled maps, such as Waymo's, wide gaps end a line.
pub fn curve_pieces(start: &Start) -> Vec<CurvePiece> {
    let map = &start.map;
    let mut lights = vec![LightCode::None; map.lanes.len()];
    for (light, states) in start.lights.iter().zip(&start.light_history) {
        if let Some(state) = states[start.current()] {
            lights[light.lane] = state.into();
        }
    }
    let mut pieces = Pieces { sampled: is_sampled(map), pieces: Vec::new() };
    for (i, lane) in map.lanes.iter().enumerate() {
        pieces.cut(lane.baseline.points(), lane_kind(map, i), lights[i]);
    }
    for edge in &map.road_edges {
        let kind =
            if edge.kind == RoadEdgeKind::Median { CurveKind::EdgeMedian } else { CurveKind::EdgeBoundary };
        pieces.cut(&edge.points, kind, LightCode::None);
    }
    if map.road_edges.is_empty() {
        for (ring, is_hole) in edge_rings(map) {
            let kind = if is_hole { CurveKind::EdgeMedian } else { CurveKind::EdgeBoundary };
            pieces.cut(&ring, kind, LightCode::None);
        }
    }
    for line in &map.road_lines {
        let kind = match line.paint {
            1 | 4 | 5 => CurveKind::BrokenLine,
            2 | 6 => CurveKind::SolidLine,
            _ => CurveKind::DoubleLine,
        };
        pieces.cut(&line.points, kind, LightCode::None);
    }
    let surfaces = map.speed_bumps.iter().chain(&map.driveways).map(|s| &s.outline);
    for outline in map.crosswalks.iter().map(|c| &c.outline).chain(surfaces) {
        pieces.cut(&crossing_line(outline), CurveKind::Crosswalk, LightCode::None);
    }
    pieces.pieces
}

fn lane_kind(map: &RoadMap, lane: usize) -> CurveKind {
    let has_sign = || map.stop_lines.iter().any(|s| s.kind == StopKind::Sign && s.lane == lane);
    match map.lanes[lane].class {
        LaneClass::Bike => CurveKind::BikeLane,
        _ if has_sign() => CurveKind::StopSign,
        LaneClass::Freeway => CurveKind::Freeway,
        LaneClass::Undefined | LaneClass::SurfaceStreet => CurveKind::SurfaceStreet,
    }
}

/// Returns the two long sides of a crossing, each back and forth, as one line.
fn crossing_line(outline: &[Vec2]) -> Vec<Vec2> {
    let n = outline.len();
    if n < 4 {
        return Vec::new();
    }
    let corner = |i: usize| outline[n * i / 4];
    let length = |a: usize, b: usize| (corner(b) - corner(a)).norm();
    let sides = if length(0, 1) > length(1, 2) { [(0, 1), (2, 3)] } else { [(0, 3), (2, 1)] };
    let mut line = Vec::new();
    for (a, b) in sides {
        let (from, chord) = (corner(a), corner(b) - corner(a));
        let length = chord.norm();
        if !(length > 0.0 && length <= MAX_LINE_LENGTH) {
            continue;
        }
        let steps = (length / CROSSWALK_SPACING).floor() as usize;
        let mut side: Vec<Vec2> =
            (0..=steps).map(|i| from + chord * (i as f64 * CROSSWALK_SPACING / length)).collect();
        side.push(corner(b));
        line.extend(side.iter().copied());
        line.extend(side.into_iter().rev());
    }
    line
}

/// Returns whether the lines of a map are sampled so densely that a gap separates two lines. In maps
/// with sparse points it does not.
fn is_sampled(map: &RoadMap) -> bool {
    let (mut all, mut wide) = (0.0, 0.0);
    for line in map.lanes.iter().map(|l| &l.baseline) {
        all += line.length();
        wide += line.arc().windows(2).map(|w| w[1] - w[0]).filter(|step| *step > MAX_POINT_GAP).sum::<f64>();
    }
    wide <= MAX_GAP_FRACTION * all
}

/// Pieces that are cut so far.
struct Pieces {
    sampled: bool,
    pieces: Vec<CurvePiece>,
}

impl Pieces {
    /// Cuts a line. Its last point is dropped and lines of two points are skipped, as in the published
    /// data preparation.
    fn cut(&mut self, line: &[Vec2], kind: CurveKind, light: LightCode) {
        let dense;
        let line = if self.sampled {
            line
        } else {
            dense = resampled(line);
            &dense
        };
        if line.len() <= 2 {
            return;
        }
        let line = &line[..line.len() - 1];
        let mut first = 0;
        for i in 1..=line.len() {
            if i == line.len() || (line[i] - line[i - 1]).norm() > MAX_POINT_GAP {
                self.cut_whole(&line[first..i], kind, light);
                first = i;
            }
        }
    }

    /// Cuts a line without gaps.
    fn cut_whole(&mut self, line: &[Vec2], kind: CurveKind, light: LightCode) {
        let points = resampled(line);
        let mut first = 0;
        while first + STEPS < points.len() {
            self.pieces.push(CurvePiece { points: points[first..=first + STEPS].to_vec(), kind, light });
            first += STEPS;
        }
        // The end point of the last whole piece does not count as remaining, but begins the rest.
        let left = points.len() - if first == 0 { 0 } else { first + 1 };
        if left >= MIN_REMAINING_POINTS {
            self.pieces.push(CurvePiece { points: points[first..].to_vec(), kind, light });
        }
    }
}

/// Returns points every half metre along a line, and its last one; none if the line has no length.
fn resampled(line: &[Vec2]) -> Vec<Vec2> {
    let Some(line) = Polyline::new(line).ok().filter(|l| l.length() <= MAX_LINE_LENGTH) else {
        return Vec::new();
    };
    let (mut points, mut segment) = (Vec::new(), 0);
    let mut step = 0_u32;
    loop {
        let s = SPACING * f64::from(step);
        if s >= line.length() {
            break;
        }
        segment = line.segment_from(s, segment);
        points.push(line.on_segment(s, segment));
        step += 1;
    }
    points.push(line.points()[line.segments()]);
    points
}
