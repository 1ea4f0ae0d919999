//! Outlines of the ground.

use reactsim_geometry::{Polyline, Vec2, left};
use reactsim_nn::learning::LearningMap;
use reactsim_scene::{LaneArea, RoadMap, Start};

/// Half-width of a drawn centre line, metres.
const LINE_HALF_WIDTH: f64 = 0.5;
/// Length by which the rectangle of a segment exceeds it at each end, metres.
const OVERLAP: f64 = 0.25;

/// Outlines of what can be driven on, of the centre lines of lanes, and of crosswalks.
#[derive(Clone, Debug, Default)]
pub(crate) struct GroundShapes {
    /// Position of the AV at the current frame, metres.
    pub(super) center: Vec2,
    /// Drivable area, by the polygons of the map or else by lanes.
    pub(super) drivable: Vec<Shape>,
    /// Centre lines of lanes.
    pub(super) lines: Vec<Shape>,
    /// Crosswalks.
    pub(super) crosswalks: Vec<Shape>,
    /// Areas of lanes with a speed limit, m/s.
    pub(super) limits: Vec<(Shape, f64)>,
}

/// Rings that are filled by the even-odd rule, metres.
pub(super) type Shape = Vec<Vec<Vec2>>;

impl GroundShapes {
    /// Collects the outlines of a scenario.
    pub(crate) fn of(start: &Start) -> Self {
        let map: &RoadMap = &start.map;
        let mut shapes = Self {
            center: start.now(0).position(),
            crosswalks: map.crosswalks.iter().map(|c| vec![c.outline.clone()]).collect(),
            ..Self::default()
        };
        for lane in &map.lanes {
            let area = match &lane.area {
                LaneArea::Polygon(ring) => vec![vec![ring.clone()]],
                LaneArea::Corridor { half_width } => strips(&lane.baseline, *half_width),
            };
            if let Some(limit) = lane.speed_limit {
                shapes.limits.extend(area.iter().map(|shape| (shape.clone(), limit)));
            }
            if map.drivable_area.is_none() {
                shapes.drivable.extend(area);
            }
            shapes.lines.extend(strips(&lane.baseline, LINE_HALF_WIDTH));
        }
        for polygon in map.drivable_area.iter().flatten() {
            let rings = std::iter::once(&polygon.exterior).chain(&polygon.holes);
            shapes.drivable.push(rings.cloned().collect());
        }
        shapes
    }

    /// Returns a rectangle of drivable area around the origin, between two corners, with a limit of 8 m/s.
    #[cfg(test)]
    pub(crate) fn road(from: Vec2, to: Vec2) -> Self {
        let ring = vec![from, Vec2::new(to.x, from.y), to, Vec2::new(from.x, to.y)];
        let (drivable, limits) = (vec![vec![ring.clone()]], vec![(vec![ring], 8.0)]);
        Self { drivable, limits, ..Self::default() }
    }

    /// Applies a function to every point.
    fn transform(&mut self, change: impl Fn(Vec2) -> Vec2) {
        let all = self.drivable.iter_mut().chain(&mut self.lines).chain(&mut self.crosswalks);
        let all = all.chain(self.limits.iter_mut().map(|(shape, _)| shape));
        all.flatten().flatten().for_each(|p| *p = change(*p));
        self.center = change(self.center);
    }
}

impl LearningMap for GroundShapes {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        self.transform(flip);
    }

    fn stretch(&mut self, factor: f64) {
        self.transform(|p| p * factor);
        self.limits.iter_mut().for_each(|(_, limit)| *limit *= factor);
    }
}

/// Returns the ground within this distance of a line: one rectangle per segment, a little longer than it, so
/// that there are no gaps in bends.
fn strips(line: &Polyline, half_width: f64) -> Vec<Shape> {
    let rectangle = |k: usize| {
        let (a, b) = line.segment(k);
        let along = (b - a) / (b - a).norm();
        let (over, aside) = (along * OVERLAP, left(along) * half_width);
        let (a, b) = (a - over, b + over);
        vec![vec![a + aside, a - aside, b - aside, b + aside]]
    };
    (0..line.segments()).map(rectangle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_become_rectangles() {
        let line = Polyline::new(&[Vec2::zeros(), Vec2::new(10.0, 0.0), Vec2::new(10.0, 5.0)]).unwrap();
        let all = strips(&line, 2.0);
        assert_eq!(all.len(), 2);
        let corners = [(-0.25, 2.0), (-0.25, -2.0), (10.25, -2.0), (10.25, 2.0)];
        assert_eq!(all[0], [corners.map(|(x, y)| Vec2::new(x, y)).to_vec()]);
    }
}
