//! The motion of a vehicle along a path with a simple profile of acceleration.

use reactsim_geometry::{Bounds, OrientedBox, Vec2};
use reactsim_scene::dynamics::DrivenPath;

use super::actor::Actor;
use super::strip::Strip;

/// Time until a profile changes, seconds: swerve first, where there is room, then brake.
const SWITCH_TIME: f64 = 1.2;

/// An acceleration now and another one after [`SWITCH_TIME`], m/s². Only the first part is executed
/// before the next decision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Profile {
    pub(super) now: f64,
    pub(super) then: f64,
}

impl Profile {
    pub(super) const fn steady(a: f64) -> Self {
        Self { now: a, then: a }
    }

    /// Returns the distance after `t` seconds from `speed`.
    pub(super) fn distance(&self, speed: f64, t: f64) -> f64 {
        let (first, between) = travelled(speed, self.now, t.min(SWITCH_TIME));
        if t <= SWITCH_TIME { first } else { first + travelled(between, self.then, t - SWITCH_TIME).0 }
    }

    /// Returns the largest speed within `t` seconds from `speed`, m/s.
    fn top_speed(&self, speed: f64, t: f64) -> f64 {
        let (_, between) = travelled(speed, self.now, t.min(SWITCH_TIME));
        let (_, last) = travelled(between, self.then, (t - SWITCH_TIME).max(0.0));
        speed.max(between).max(last)
    }
}

/// Boxes of a vehicle along a path, one per sampling interval; each is computed when it is first asked for.
pub(super) struct OwnMotion<'a> {
    pub(super) own: &'a Actor,
    path: &'a DrivenPath,
    /// Arc length at the present time, metres.
    s: f64,
    profile: Profile,
    /// Sampling interval, seconds.
    sample: f64,
    /// Number of samples after the present time.
    pub(super) count: usize,
    /// Arc length at the first samples, metres.
    arcs: Vec<f64>,
    /// The boxes; empty if none was asked for.
    boxes: Vec<Option<OrientedBox>>,
    /// Bounds of all boxes; `None` if the motion goes beyond the end of the path.
    pub(super) bounds: Option<Bounds>,
    /// Bounds of a section of the path.
    strip: Option<Strip>,
    /// Arc length at the last sample, metres.
    end: f64,
    /// Largest speed up to the last sample, m/s.
    pub(super) top_speed: f64,
}

/// Largest distance, metres, of an arc of [`DrivenPath::STEP`] from its chord.
const BULGE: f64 = 0.2;

impl<'a> OwnMotion<'a> {
    /// Describes the motion from arc length `s` of a path, with `count` samples at an interval of `sample`
    /// seconds.
    pub(super) fn new(
        own: &'a Actor,
        path: &'a DrivenPath,
        s: f64,
        profile: Profile,
        sample: f64,
        count: usize,
    ) -> Self {
        let end = s + profile.distance(own.speed, count as f64 * sample);
        let within = s >= 0.0 && end <= path.length();
        let bounds = within.then(|| path.bounds(s, end).inflated(own.radius() + BULGE));
        Self {
            own,
            path,
            s,
            profile,
            sample,
            count,
            arcs: Vec::new(),
            boxes: Vec::new(),
            bounds,
            strip: None,
            end,
            top_speed: profile.top_speed(own.speed, count as f64 * sample),
        }
    }

    /// Adds bounds of a section of the path.
    pub(super) fn with_strip(self, strip: Option<Strip>) -> Self {
        Self { strip, ..self }
    }

    /// Returns the bounds of the section of the path, if all of the motion is in it.
    pub(super) fn strip(&self) -> Option<&Strip> {
        self.strip.as_ref().filter(|strip| strip.contains(self.s, self.end))
    }

    /// Returns the arc length at sample `k`, from 1, metres.
    fn arc(&mut self, k: usize) -> f64 {
        if self.arcs.is_empty() {
            self.arcs.reserve(self.count);
        }
        while self.arcs.len() < k {
            let t = (self.arcs.len() + 1) as f64 * self.sample;
            self.arcs.push(self.s + self.profile.distance(self.own.speed, t));
        }
        self.arcs[k - 1]
    }

    /// Returns a point of the path that is at most [`DrivenPath::STEP`] from the centre of the box at sample
    /// `k`, from 1; `None` if the motion goes beyond the end of the path.
    pub(super) fn about(&mut self, k: usize) -> Option<Vec2> {
        self.bounds?;
        let index = self.path.index(self.arc(k));
        Some(self.path.points()[index].pose.position)
    }

    /// Returns the box at sample `k`, from 1.
    pub(super) fn at(&mut self, k: usize) -> OrientedBox {
        if self.boxes.is_empty() {
            self.boxes.resize(self.count, None);
        }
        let s = self.arc(k);
        *self.boxes[k - 1].get_or_insert_with(|| {
            let point = self.path.point_at(s);
            self.own.box_at(point.pose.position, point.axis, (0.0, 0.0))
        })
    }
}

/// Returns distance and speed after `t` seconds at a constant acceleration; vehicles do not roll back.
pub(super) fn travelled(speed: f64, a: f64, t: f64) -> (f64, f64) {
    let lasting = if a < 0.0 { t.min(speed / -a) } else { t };
    (speed * lasting + 0.5 * a * lasting * lasting, (speed + a * lasting).max(0.0))
}
