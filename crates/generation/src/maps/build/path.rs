//! Reference lines: sequences of straights, arcs and clothoids.

use reactsim_geometry::{Vec2, direction, left};

/// A point on a curve, with its direction and curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Arc length from the start of the path, metres.
    pub s: f64,
    /// Position, metres.
    pub position: Vec2,
    /// Direction of the curve, radians.
    pub heading: f64,
    /// Curvature, 1/m, left positive.
    pub curvature: f64,
}

impl Station {
    /// Returns the point `offset` metres to the left of the curve.
    pub fn aside(&self, offset: f64) -> Vec2 {
        self.position + left(direction(self.heading)) * offset
    }
}

/// A piece of a path whose curvature changes linearly: a straight, an arc or a clothoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Length, metres, above 0.
    pub length: f64,
    /// Curvature at its start, 1/m, left positive.
    pub from: f64,
    /// Curvature at its end, 1/m.
    pub to: f64,
}

impl Piece {
    /// Creates a straight.
    pub const fn straight(length: f64) -> Self {
        Self { length, from: 0.0, to: 0.0 }
    }

    /// Creates an arc.
    pub const fn arc(length: f64, curvature: f64) -> Self {
        Self { length, from: curvature, to: curvature }
    }

    /// Creates a bend by `angle` radians (left positive) with this radius in its middle: clothoid, arc,
    /// clothoid. The clothoids turn a share of `easing` (above 0, up to 1) of the angle.
    pub fn bend(angle: f64, radius: f64, easing: f64) -> [Self; 3] {
        let k = angle.signum() / radius;
        // A clothoid of length l turns by l k / 2.
        let clothoid = angle.abs() * easing * radius;
        let arc = (angle.abs() * (1.0 - easing) * radius).max(0.01);
        [
            Self { length: clothoid, from: 0.0, to: k },
            Self::arc(arc, k),
            Self { length: clothoid, from: k, to: 0.0 },
        ]
    }
}

/// Curvature, 1/m, below which a line counts as straight.
const STRAIGHT_CURVATURE: f64 = 1e-4;
/// Curvature, 1/m, above which points are 1 m apart: lanes next to the reference line have radii down to 25
/// m.
const TIGHT_CURVATURE: f64 = 1.0 / 45.0;

/// Returns the distance between the points that represent a curve, metres.
pub fn sampling_step(curvature: f64) -> f64 {
    let k = curvature.abs();
    if k < STRAIGHT_CURVATURE {
        5.0
    } else if k < TIGHT_CURVATURE {
        2.0
    } else {
        1.0
    }
}

/// A curve with continuous tangent and, where its pieces agree, continuous curvature.
#[derive(Clone, Debug)]
pub struct Path {
    stations: Vec<Station>,
    /// Per interval between stations: curvature at its start, and change of curvature per metre.
    bends: Vec<(f64, f64)>,
}

impl Path {
    /// Joins the pieces, from (0, 0) along the x axis. At least one piece.
    pub fn new(pieces: &[Piece]) -> Self {
        let first = pieces.first().map_or(0.0, |p| p.from);
        let mut last = Station { s: 0.0, position: Vec2::zeros(), heading: 0.0, curvature: first };
        let (mut stations, mut bends) = (vec![last], Vec::new());
        for piece in pieces {
            let sharpest = piece.from.abs().max(piece.to.abs());
            let count = (piece.length / sampling_step(sharpest)).ceil().max(1.0);
            let (step, rate) = (piece.length / count, (piece.to - piece.from) / piece.length);
            for i in 0..count as usize {
                let curvature = piece.from + rate * step * i as f64;
                last = advanced(&last, step, curvature, rate);
                stations.push(last);
                bends.push((curvature, rate));
            }
        }
        Self { stations, bends }
    }

    /// Creates a straight of this length.
    pub fn straight(length: f64) -> Self {
        Self::new(&[Piece::straight(length)])
    }

    /// Rotates and moves the path so that it passes `position` with `heading` at arc length `s`.
    pub fn placed(mut self, s: f64, position: Vec2, heading: f64) -> Self {
        let at = self.at(s);
        let turn = heading - at.heading;
        let axis = direction(turn);
        for station in &mut self.stations {
            let d = station.position - at.position;
            station.position = position + axis * d.x + left(axis) * d.y;
            station.heading += turn;
        }
        self
    }

    /// Returns the length, metres.
    pub fn length(&self) -> f64 {
        self.stations[self.stations.len() - 1].s
    }

    /// Returns the station at arc length `s`; the path is extended straight beyond its ends.
    pub fn at(&self, s: f64) -> Station {
        let last = self.stations.len() - 1;
        if s <= 0.0 || s >= self.length() {
            let end = self.stations[if s <= 0.0 { 0 } else { last }];
            let curvature = if s == end.s { end.curvature } else { 0.0 };
            let position = end.position + direction(end.heading) * (s - end.s);
            return Station { s, position, heading: end.heading, curvature };
        }
        let i = self.stations.partition_point(|p| p.s <= s).clamp(1, last);
        let (a, (curvature, rate)) = (&self.stations[i - 1], self.bends[i - 1]);
        if s == a.s { *a } else { advanced(a, s - a.s, curvature, rate) }
    }

    /// Returns the stations that represent the path from `from` to `to`, both included, at most `longest`
    /// metres apart.
    pub fn stations(&self, from: f64, to: f64, longest: f64) -> Vec<Station> {
        let inner = self.stations.iter().filter(|p| p.s > from + 0.3 && p.s < to - 0.3);
        let mut out: Vec<Station> = vec![self.at(from)];
        for next in inner.copied().chain([self.at(to)]) {
            let start = out[out.len() - 1].s;
            let count = ((next.s - start) / longest - 1e-9).ceil().max(1.0);
            for i in 1..count as usize {
                out.push(self.at(start + (next.s - start) * i as f64 / count));
            }
            out.push(next);
        }
        out
    }

    /// Returns the arc length of the point on the path nearest to `p`, metres.
    pub fn nearest(&self, p: Vec2) -> f64 {
        let mut best = (f64::INFINITY, 0.0);
        for pair in self.stations.windows(2) {
            let (d, t) = reactsim_geometry::point_segment(p, pair[0].position, pair[1].position);
            if d < best.0 {
                best = (d, pair[0].s + t * (pair[1].s - pair[0].s));
            }
        }
        best.1
    }
}

/// Returns the station `ds` metres further, where the curvature starts at the given value and changes by
/// `rate` per metre: integration with three Gauss points, whose error over the steps of a path is far below
/// the grid of maps.
fn advanced(from: &Station, ds: f64, curvature: f64, rate: f64) -> Station {
    const NODE: f64 = 0.774_596_669_241_483_4;
    let heading = |u: f64| from.heading + u * (curvature + 0.5 * rate * u);
    let at = |u: f64| direction(heading(u * ds));
    let chord = if curvature == 0.0 && rate == 0.0 {
        direction(from.heading)
    } else {
        (at(0.5 - 0.5 * NODE) + at(0.5 + 0.5 * NODE)) * (5.0 / 18.0) + at(0.5) * (8.0 / 18.0)
    };
    Station {
        s: from.s + ds,
        position: from.position + chord * ds,
        heading: heading(ds),
        curvature: curvature + rate * ds,
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn an_arc_is_a_circle() {
        let path = Path::new(&[Piece::arc(20.0 * FRAC_PI_2, 0.05)]);
        let end = path.at(path.length());
        assert!((end.position - Vec2::new(20.0, 20.0)).norm() < 1e-6, "{end:?}");
        assert!((end.heading - FRAC_PI_2).abs() < 1e-9);
        let between = path.at(7.3);
        assert!(((between.position - Vec2::new(0.0, 20.0)).norm() - 20.0).abs() < 1e-6);
    }

    #[test]
    fn a_bend_turns_by_its_angle_without_a_jump() {
        let bend = Piece::bend(-0.8, 60.0, 0.6);
        let path = Path::new(&[&[Piece::straight(30.0)], &bend[..], &[Piece::straight(30.0)]].concat());
        let end = path.at(path.length());
        assert!((end.heading + 0.8).abs() < 1e-9, "{}", end.heading);
        let all = path.stations(0.0, path.length(), 5.0);
        for pair in all.windows(2) {
            assert!((pair[1].curvature - pair[0].curvature).abs() < 0.01);
            let gap = (pair[1].position - pair[0].position).norm();
            assert!(gap <= 5.0 + 1e-9 && (gap <= 2.0 || pair[1].curvature.abs() < 1e-4));
        }
    }

    #[test]
    fn placing_keeps_the_form() {
        let path = Path::new(&[Piece::straight(10.0), Piece::arc(10.0, 0.02)]);
        let placed = path.clone().placed(10.0, Vec2::new(5.0, -3.0), 1.0);
        let at = placed.at(10.0);
        assert!((at.position - Vec2::new(5.0, -3.0)).norm() < 1e-12 && (at.heading - 1.0).abs() < 1e-12);
        assert!((placed.at(-4.0).position - placed.at(0.0).position).norm() - 4.0 < 1e-12);
        let turned = placed.at(15.0).heading - path.at(15.0).heading - (at.heading - path.at(10.0).heading);
        assert!(turned.abs() < 1e-12 && (path.at(15.0).heading - 0.1).abs() < 1e-12);
        assert!((placed.nearest(placed.at(6.5).aside(2.0)) - 6.5).abs() < 1e-9);
    }
}
