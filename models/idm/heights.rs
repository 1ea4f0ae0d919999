//! Heights of the road under agents and along paths, in scenarios with several levels.

use reactsim_dynamics::DrivenPath;
use reactsim_geometry::Vec2;
use reactsim_scene::{Road, levels};

use super::actor::Actor;
use super::forecast::Forecast;

/// Heights along the path of a vehicle; none in scenarios of one level, where nothing is apart.
#[derive(Clone, Debug, Default)]
pub(super) struct PathHeights {
    /// Index of the first of these points on the path.
    first: usize,
    /// Points of the path with their heights, metres.
    places: Vec<(Vec2, f64)>,
}

impl PathHeights {
    /// Follows the road under a path between two arc lengths, metres, from the height of the vehicle on it.
    pub(super) fn along(road: &Road<'_>, own: &Actor, path: &DrivenPath, from: f64, to: f64) -> Self {
        let mut height = own.height;
        let first = path.index(from);
        let place = |point: &reactsim_dynamics::PathPoint| {
            height = road.ground_height(point.pose.position, height);
            (point.pose.position, height)
        };
        Self { first, places: path.points()[first..=path.index(to)].iter().map(place).collect() }
    }

    /// Returns whether an agent at `height` metres is above or below the path at a point, by index.
    #[inline]
    pub(super) fn is_apart(&self, index: usize, height: f64) -> bool {
        // Nearly all scenarios have one level.
        if self.places.is_empty() {
            return false;
        }
        let here = self.places.get(index.saturating_sub(self.first)).or(self.places.last());
        here.is_some_and(|&(_, own)| levels::apart(own, height, 0.0))
    }

    /// Returns whether an agent at `height` metres is above or below the path at its point nearest to `p`.
    pub(super) fn is_apart_at(&self, p: Vec2, height: f64) -> bool {
        let from = |place: &(Vec2, f64)| (place.0 - p).norm_squared();
        let here = self.places.iter().min_by(|a, b| from(a).total_cmp(&from(b)));
        here.is_some_and(|&(_, own)| levels::apart(own, height, 0.0))
    }
}

/// Follows the road under all actors to their present positions.
pub(super) fn follow(road: &Road<'_>, actors: &mut [Actor]) {
    for actor in actors {
        actor.height = road.ground_height(actor.pose.position, actor.height);
    }
}

/// Follows the road under the samples of forecasts.
pub(super) fn forecast(road: &Road<'_>, actors: &[Actor], forecasts: &mut [Forecast]) {
    for forecast in forecasts {
        let mut height = actors[forecast.actor].height;
        // Half of all agents stand: the same question has the same answer.
        let mut last: Option<(Vec2, f64)> = None;
        for sample in &mut forecast.samples {
            if last != Some((sample.center, height)) {
                last = Some((sample.center, height));
                height = road.ground_height(sample.center, height);
            }
            sample.height = height;
        }
    }
}
