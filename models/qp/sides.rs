//! How far aside a path may go: the ground, the lanes of others, what stands or drives beside.

use reactsim::geometry::{Vec2, direction};
use reactsim::scene::{LaneHit, Road};

use super::bends::{SIDES, Sides, station_of_side};
use super::mode::Wish;
use super::obstacle::{Obstacle, beside};
use super::settings::Settings;
use super::speed::CHECKED;
use super::vehicle::Subject;
use super::way::Way;

/// How far a vehicle makes way aside for what is beside it, metres; what asks for more is waited for.
const MOST_ASIDE: f64 = 1.5;
/// Lanes whose direction has at most this part along a path's lead against it.
const AGAINST: f64 = -0.3;

/// Where a path leaves the drivable ground, metres of the centre's way.
pub(super) fn road_end(way: &Way, road: Road<'_>) -> Option<f64> {
    let mut near = None;
    let off = way.stations.iter().find(|s| road.drivable(s.centre, &mut near) == Some(false))?;
    Some((off.arc - 0.5 * way.spacing).max(0.0))
}

/// Where lanes lead, asked at points that follow one another.
struct Directions<'a> {
    road: Option<Road<'a>>,
    /// The lane that held the last point and leads on: it mostly holds the next one too.
    with: Option<usize>,
    hits: Vec<LaneHit>,
}

impl Directions<'_> {
    /// Whether a point lies on lanes against this direction alone. Where directions share the ground, as on crossings, nothing is said.
    fn oppose(&mut self, p: Vec2, axis: Vec2) -> bool {
        let Some(road) = self.road else { return false };
        let leads_on =
            |lane: usize, s: f64| direction(road.lane(lane).baseline.heading_at(s)).dot(&axis) >= AGAINST;
        if let Some(lane) = self.with
            && road.lane_at(p, lane).is_some_and(|at| leads_on(lane, at.s))
        {
            return false;
        }
        road.lanes_at(p, &mut self.hits);
        self.with = self.hits.iter().find(|h| leads_on(h.lane, h.projection.s)).map(|h| h.lane);
        !self.hits.is_empty() && self.with.is_none()
    }
}

/// How far aside of the stations a path may go: on the ground, and clear of what is beside it.
pub(super) fn sides(
    way: &Way,
    subject: &Subject<'_>,
    wish: &Wish,
    obstacles: &[&Obstacle],
    settings: &Settings,
) -> Sides {
    let mut near = None;
    let mut drivable = |p: Vec2| subject.road.is_none_or(|road| road.drivable(p, &mut near) != Some(false));
    let mut directions = Directions { road: subject.road, with: None, hits: Vec::new() };
    let speed = subject.now.speed.max(2.0);
    let mut all = [(f64::NEG_INFINITY, f64::INFINITY); SIDES];
    for (side, bounds) in all.iter_mut().enumerate() {
        let j = station_of_side(side);
        let station = &way.stations[j];
        let left = way.side(j);
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        if subject.road.is_some() {
            let inside = settings.inside;
            let mut fits = |o: f64| {
                [o - inside, o + inside, o].into_iter().all(|x| drivable(station.centre + left * x))
                    && !directions.oppose(station.centre + left * o, station.axis)
            };
            if !fits(0.0) {
                let aside = (1..=12).flat_map(|m| [0.4 * f64::from(m), -0.4 * f64::from(m)]);
                match aside.into_iter().find(|&o| fits(o)) {
                    Some(o) if o > 0.0 => low = o,
                    Some(o) => high = o,
                    None => {}
                }
            }
        }
        let step = wish.step_after(station.arc);
        let time = CHECKED.partition_point(|&c| c < step).min(CHECKED.len() - 1) + 1;
        for obstacle in obstacles {
            if obstacle.leader_only && !obstacle.stands() {
                continue;
            }
            let b = &obstacle.boxes[time];
            let reach = b.radius() + subject.extent.length + subject.extent.width + 1.0;
            if (b.center - station.centre).norm_squared() > reach * reach {
                continue;
            }
            let Some((from, to)) = beside(b, station.centre, station.axis, subject.extent.length + 0.3)
            else {
                continue;
            };
            let apart = subject.extent.width + obstacle.side.max(settings.side);
            if from > 0.0 && from - apart > -MOST_ASIDE {
                high = high.min(from - apart);
            } else if to < 0.0 && to + apart < MOST_ASIDE {
                low = low.max(to + apart);
            }
        }
        if low > high {
            let middle = 0.5 * (low + high);
            (low, high) = (middle, middle);
        }
        // No more than what can be reached without haste.
        let t = station.arc / speed;
        let reachable = 1.2 * t * t;
        *bounds = (low.min(reachable), high.max(-reachable));
    }
    all
}
