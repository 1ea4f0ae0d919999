//! Heights of the road under agents and along paths, in scenarios with several levels.

use std::collections::VecDeque;

use reactsim_geometry::Vec2;
use reactsim_scene::dynamics::DrivenPath;
use reactsim_scene::{Road, levels};

use super::actor::Actor;
use super::forecast::Forecast;

/// Heights along the path of a vehicle; none in scenarios of one level, where nothing is apart.
#[derive(Clone, Debug, Default)]
pub(super) struct PathHeights {
    /// Index of the first of these points on the path.
    first: usize,
    /// Points of the path with their heights, metres.
    places: VecDeque<(Vec2, f64)>,
}

impl PathHeights {
    /// Follows the road under a path between two arc lengths, metres, from the height of the vehicle on it.
    /// Heights that are known from the last call for this path are kept.
    pub(super) fn follow(&mut self, road: &Road<'_>, own: &Actor, path: &DrivenPath, from: f64, to: f64) {
        let (from, to) = (path.index(from), path.index(to));
        let passed = from.saturating_sub(self.first).min(self.places.len());
        self.places.drain(..passed);
        let is_known = self.first <= from
            && self.places.front().is_some_and(|p| !p.1.is_nan() && !levels::apart(p.1, own.height, 0.0));
        if !is_known {
            self.places.clear();
        }
        self.first = from;
        let mut height = self.places.back().map_or(own.height, |last| last.1);
        for point in path.points().get(from + self.places.len()..=to).unwrap_or_default() {
            height = road.ground_height(point.pose.position, height);
            self.places.push_back((point.pose.position, height));
        }
    }

    /// Returns whether an agent at `p` with a height in metres is above or below the path at a point, by
    /// index.
    #[inline]
    pub(super) fn is_apart(&self, road: &Road<'_>, index: usize, p: Vec2, height: f64) -> bool {
        // Nearly all scenarios have one level.
        if self.places.is_empty() {
            return false;
        }
        let here = self.places.get(index.saturating_sub(self.first)).or(self.places.back());
        here.is_some_and(|&(at, own)| road.on_level(at, own).is_off_level(p, height, 0.0))
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
