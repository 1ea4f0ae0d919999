//! Lines painted on streets.

use super::street::{End, Street, TAPER, sign};
use crate::generation::maps::build::{MapBuilder, Way};

impl Street {
    /// Lines of a direction.
    pub(super) fn paint(&self, b: &mut MapBuilder, way: Way, split: f64, (left, right): (bool, bool)) {
        const BROKEN_WHITE: u8 = 1;
        const SOLID_WHITE: u8 = 2;
        const SOLID_YELLOW: u8 = 6;
        const DOUBLE_YELLOW: u8 = 7;
        /// Lane lines are solid so far before a junction, metres.
        const SOLID: f64 = 15.0;
        let arrival = usize::from(way == Way::Forward);
        let road = &self.road;
        let before = |d: f64| if arrival == 0 { self.from + d } else { self.to - d };
        let whole = self.to - self.from;
        let mut line = |paint: u8, offset: f64, d: f64, e: f64| {
            let (p, q) = (before(d), before(e));
            b.paint(paint, road.line(way, offset, p.min(q), p.max(q)));
        };
        let side = self.side(way);
        let median = road.section.median;
        if median.width > 0.8 {
            let inner = 0.5 * median.width;
            line(SOLID_YELLOW, sign(way) * inner, if left { split } else { 0.0 }, whole);
            if left {
                let width = self.pocket_width(way);
                line(SOLID_YELLOW, sign(way) * (inner - width), 0.0, split - TAPER);
                line(SOLID_WHITE, sign(way) * inner, 0.0, split - TAPER);
            }
        } else if way == Way::Forward {
            line(DOUBLE_YELLOW, 0.0, 0.0, whole);
        }
        let solid = if self.ends[arrival] == End::Border { 0.0 } else { SOLID.min(0.5 * whole) };
        for i in 1..side.lanes {
            let offset = 0.5 * (road.lane_offset(way, i - 1) + road.lane_offset(way, i));
            line(BROKEN_WHITE, offset, solid, whole);
            if solid > 0.0 {
                line(SOLID_WHITE, offset, 0.0, solid);
            }
        }
        if right || side.bike.is_some() || side.parking.is_some() {
            line(SOLID_WHITE, road.lanes_edge(way), 0.0, whole);
        }
        if side.bike.is_some() && side.parking.is_some() {
            line(SOLID_WHITE, road.parking_edge(way), 0.0, whole);
        }
    }
}
