//! Lines painted on streets.

use super::street::{End, POCKET_TAPER, Street};
use crate::maps::build::{BROKEN_WHITE, DOUBLE_YELLOW, Direction, MapBuilder, SOLID_WHITE, SOLID_YELLOW};

impl Street {
    /// Paints the lines of a direction.
    pub(super) fn paint(
        &self,
        b: &mut MapBuilder,
        direction: Direction,
        split: f64,
        (left, right): (bool, bool),
    ) {
        /// Distance before a junction within which lane lines are solid, metres.
        const SOLID_LENGTH: f64 = 15.0;
        let arrival = usize::from(direction == Direction::Forward);
        let road = &self.road;
        let before = |d: f64| if arrival == 0 { self.from + d } else { self.to - d };
        let whole = self.to - self.from;
        let mut line = |paint: u8, offset: f64, d: f64, e: f64| {
            let (p, q) = (before(d), before(e));
            b.paint(paint, road.line(direction, offset, p.min(q), p.max(q)));
        };
        let side = self.side(direction);
        let median = road.section.median;
        if median.width > 0.8 {
            let inner = 0.5 * median.width;
            line(SOLID_YELLOW, direction.sign() * inner, if left { split } else { 0.0 }, whole);
            if left {
                let width = self.pocket_width(direction);
                line(SOLID_YELLOW, direction.sign() * (inner - width), 0.0, split - POCKET_TAPER);
                line(SOLID_WHITE, direction.sign() * inner, 0.0, split - POCKET_TAPER);
            }
        } else if direction == Direction::Forward {
            line(DOUBLE_YELLOW, 0.0, 0.0, whole);
        }
        let solid = if self.ends[arrival] == End::Border { 0.0 } else { SOLID_LENGTH.min(0.5 * whole) };
        for i in 1..side.lanes {
            let offset = 0.5 * (road.lane_offset(direction, i - 1) + road.lane_offset(direction, i));
            line(BROKEN_WHITE, offset, solid, whole);
            if solid > 0.0 {
                line(SOLID_WHITE, offset, 0.0, solid);
            }
        }
        if right || side.bike.is_some() || side.parking.is_some() {
            line(SOLID_WHITE, road.lanes_edge(direction), 0.0, whole);
        }
        if side.bike.is_some() && side.parking.is_some() {
            line(SOLID_WHITE, road.parking_edge(direction), 0.0, whole);
        }
    }
}
