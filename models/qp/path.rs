//! The path of a vehicle: the rear axle follows arcs, and the box centre moves with it.

use reactsim_geometry::{Vec2, direction, left};
use reactsim_scene::dynamics::Pose;

/// Number of intervals between stations.
pub(super) const STATIONS: usize = 30;

/// A point of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Station {
    /// Box centre.
    pub(super) centre: Vec2,
    /// Unit vector along the heading.
    pub(super) axis: Vec2,
    /// Curvature of the rear axle's path here, 1/m.
    pub(super) curvature: f64,
    /// Arc length of the box centre's path up to here, metres.
    pub(super) arc: f64,
}

/// Stations at equal distances along the rear axle's path; the first is the present position.
#[derive(Clone, Debug)]
pub(super) struct Path {
    pub(super) stations: [Station; STATIONS + 1],
    /// Distance along the rear axle's path between two stations, metres.
    pub(super) spacing: f64,
}

impl Path {
    /// Drives from a pose with these curvatures at the stations, linear in between. `rear` is the
    /// distance in metres from the rear axle forward to the box centre.
    pub(super) fn drive(from: Pose, rear: f64, spacing: f64, curvatures: &[f64; STATIONS + 1]) -> Self {
        let station = |axle: Vec2, heading: f64, curvature: f64| {
            let axis = direction(heading);
            Station { centre: axle + axis * rear, axis, curvature, arc: 0.0 }
        };
        let mut axle = from.position - direction(from.heading) * rear;
        let mut heading = from.heading;
        let mut stations = [station(axle, heading, curvatures[0]); STATIONS + 1];
        for j in 0..STATIONS {
            let turn = 0.5 * (curvatures[j] + curvatures[j + 1]) * spacing;
            let chord = spacing * (1.0 - turn * turn / 24.0);
            axle += direction(heading + 0.5 * turn) * chord;
            heading += turn;
            let next = station(axle, heading, curvatures[j + 1]);
            let arc = stations[j].arc + (next.centre - stations[j].centre).norm();
            stations[j + 1] = Station { arc, ..next };
        }
        Self { stations, spacing }
    }

    /// Returns the interval that contains an arc length, and the fraction of the interval there (above
    /// 1 beyond the end).
    pub(super) fn locate(&self, arc: f64) -> (usize, f64) {
        let j = self.stations.partition_point(|s| s.arc <= arc).clamp(1, STATIONS) - 1;
        let (a, b) = (self.stations[j].arc, self.stations[j + 1].arc);
        (j, (arc - a) / (b - a).max(1e-9))
    }

    /// Returns the curvature of the rear axle's path at an arc length of the box centre; 0 beyond the
    /// end.
    pub(super) fn curvature(&self, arc: f64) -> f64 {
        let (j, t) = self.locate(arc);
        if t > 1.0 {
            return 0.0;
        }
        let (a, b) = (self.stations[j].curvature, self.stations[j + 1].curvature);
        a + (b - a) * t.max(0.0)
    }

    /// Returns the arc length of the point nearest to `p`, and its interval. The search starts at
    /// interval `from` and goes on while it gets closer. Before the start and beyond the end the path
    /// is straight.
    pub(super) fn project(&self, p: Vec2, from: usize) -> (f64, usize) {
        let along = |j: usize| {
            let (a, b) = (&self.stations[j], &self.stations[j + 1]);
            let (d, length) = (b.centre - a.centre, b.arc - a.arc);
            let t = (p - a.centre).dot(&d) / (length * length).max(1e-12);
            let low = if j == 0 { f64::NEG_INFINITY } else { 0.0 };
            let high = if j + 1 == STATIONS { f64::INFINITY } else { 1.0 };
            let t = t.clamp(low, high);
            ((a.centre + d * t - p).norm_squared(), a.arc + length * t)
        };
        let mut best = (along(from), from);
        for j in from + 1..STATIONS {
            let next = along(j);
            if next.0 > best.0.0 + 4.0 {
                break;
            }
            if next.0 <= best.0.0 {
                best = (next, j);
            }
        }
        (best.0.1, best.1)
    }

    /// Returns the unit vector to the left at a station.
    pub(super) fn side(&self, station: usize) -> Vec2 {
        left(self.stations[station].axis)
    }
}
