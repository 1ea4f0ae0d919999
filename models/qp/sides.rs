//! Lateral bounds of a path: the drivable area, the lanes of others, and obstacles next to the path.

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::{LaneHit, Road};

use super::bends::{LATERAL_BOUNDS, LateralBounds, station_of_bound};
use super::mode::Reference;
use super::obstacle::{Obstacle, lateral_extent};
use super::path::Path;
use super::planned_vehicle::PlannedVehicle;
use super::settings::Settings;
use super::speed::CHECKED;

/// Largest lateral shift in metres to pass an obstacle; a vehicle waits for one that needs more.
const MAX_SHIFT: f64 = 1.5;
/// Cosine below which the direction of a lane opposes the direction of a path.
const OPPOSING_COSINE: f64 = -0.3;

/// Returns the arc length at which a path leaves the drivable area, metres.
pub(super) fn road_end(path: &Path, road: Road<'_>) -> Option<f64> {
    let mut near = None;
    let off = path.stations.iter().find(|s| road.drivable(s.centre, &mut near) == Some(false))?;
    Some((off.arc - 0.5 * path.spacing).max(0.0))
}

/// Lookup of lane directions for consecutive points.
struct Directions<'a> {
    road: Option<Road<'a>>,
    /// Lane that contains the last point and does not oppose the path: it mostly contains the next
    /// point too.
    lane: Option<usize>,
    hits: Vec<LaneHit>,
}

impl Directions<'_> {
    /// Returns whether all lanes at a point oppose this direction. False where lanes of several
    /// directions overlap, as on crossings.
    fn opposes(&mut self, p: Vec2, axis: Vec2) -> bool {
        let Some(road) = self.road else { return false };
        let agrees = |lane: usize, s: f64| {
            direction(road.lane(lane).baseline.heading_at(s)).dot(&axis) >= OPPOSING_COSINE
        };
        if let Some(lane) = self.lane
            && road.lane_at(p, lane).is_some_and(|at| agrees(lane, at.s))
        {
            return false;
        }
        road.lanes_at(p, &mut self.hits);
        self.lane = self.hits.iter().find(|h| agrees(h.lane, h.projection.s)).map(|h| h.lane);
        !self.hits.is_empty() && self.lane.is_none()
    }
}

/// Returns the lateral bounds at the stations of a path: on the drivable area, and clear of obstacles
/// next to the path.
pub(super) fn lateral_bounds(
    path: &Path,
    vehicle: &PlannedVehicle<'_>,
    reference: &Reference,
    obstacles: &[&Obstacle],
    settings: &Settings,
) -> LateralBounds {
    let mut near = None;
    let mut drivable = |p: Vec2| vehicle.road.is_none_or(|road| road.drivable(p, &mut near) != Some(false));
    let mut directions = Directions { road: vehicle.road, lane: None, hits: Vec::new() };
    let speed = vehicle.now.speed.max(2.0);
    let mut all = [(f64::NEG_INFINITY, f64::INFINITY); LATERAL_BOUNDS];
    for (side, bounds) in all.iter_mut().enumerate() {
        let j = station_of_bound(side);
        let station = &path.stations[j];
        let left = path.side(j);
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        if vehicle.road.is_some() {
            let inside = settings.inside;
            let mut fits = |o: f64, corners: bool| {
                [o - inside, o + inside, o].into_iter().all(|x| drivable(station.centre + left * x))
                    && (!corners
                        || vehicle.kept_corners(station.centre + left * o, station.axis).all(&mut drivable))
                    && !directions.opposes(station.centre + left * o, station.axis)
            };
            if !fits(0.0, true) {
                let aside = || (1..=12).flat_map(|m| [0.4 * f64::from(m), -0.4 * f64::from(m)]);
                let mut found = aside().find(|&o| fits(o, true));
                // Where the road is too narrow for the box, its centre stays on the road.
                if found.is_none() && !fits(0.0, false) {
                    found = aside().find(|&o| fits(o, false));
                }
                match found {
                    Some(o) if o > 0.0 => low = o,
                    Some(o) => high = o,
                    None => {}
                }
            }
        }
        let step = reference.step_after(station.arc);
        let time = CHECKED.partition_point(|&c| c < step).min(CHECKED.len() - 1) + 1;
        for obstacle in obstacles {
            if obstacle.leader_only && !obstacle.stands() {
                continue;
            }
            let b = &obstacle.boxes[time];
            let reach = b.radius() + vehicle.extent.length + vehicle.extent.width + 1.0;
            if (b.center - station.centre).norm_squared() > reach * reach {
                continue;
            }
            let Some((from, to)) =
                lateral_extent(b, station.centre, station.axis, vehicle.extent.length + 0.3)
            else {
                continue;
            };
            let clearance = vehicle.extent.width + obstacle.side.max(settings.side);
            if from > 0.0 && from - clearance > -MAX_SHIFT {
                high = high.min(from - clearance);
            } else if to < 0.0 && to + clearance < MAX_SHIFT {
                low = low.max(to + clearance);
            }
        }
        if low > high {
            let middle = 0.5 * (low + high);
            (low, high) = (middle, middle);
        }
        // Never demand a larger shift than the vehicle can reach with gentle steering.
        let t = station.arc / speed;
        let reachable = 1.2 * t * t;
        *bounds = (low.min(reachable), high.max(-reachable));
    }
    all
}
