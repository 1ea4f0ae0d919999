//! Positions, boxes and velocities of all objects over all frames, computed once per case.

use reactsim_geometry::{OrientedBox, Vec2, direction, math};
use reactsim_scene::DT;

use super::object::Object;
use super::options::{Options, VelocitySource};

/// Motion of all objects over all frames. Arrays over objects × frames (`object * frames + frame`). NaN
/// means absent or unknown.
#[derive(Debug)]
pub struct Motion {
    pub(super) frames: usize,
    /// Whether each object takes part; the entries of others are NaN.
    pub(super) present: Vec<bool>,
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) heading: Vec<f64>,
    pub(super) axis: Vec<Vec2>,
    pub(super) velocity: Vec<Vec2>,
    pub(super) speed: Vec<f64>,
    /// Height of the road under each object, metres; empty in scenarios of one level.
    pub(super) height: Vec<f64>,
    /// Half-length and half-width per object, metres.
    half: Vec<(f64, f64)>,
    /// Radius of the circumscribed circle of the box per object, metres.
    pub(super) radius: Vec<f64>,
}

impl Motion {
    pub(super) fn new(objects: &[Object<'_>], current: usize, frames: usize, options: &Options) -> Self {
        let n = objects.len() * frames;
        let unknown = Vec2::new(f64::NAN, f64::NAN);
        let mut m = Self {
            frames,
            present: Vec::with_capacity(objects.len()),
            x: vec![f64::NAN; n],
            y: vec![f64::NAN; n],
            heading: vec![f64::NAN; n],
            axis: vec![unknown; n],
            velocity: vec![unknown; n],
            speed: vec![f64::NAN; n],
            height: Vec::new(),
            half: Vec::with_capacity(objects.len()),
            radius: Vec::with_capacity(objects.len()),
        };
        for (i, object) in objects.iter().enumerate() {
            let (length, width) = (object.agent.length, object.agent.width);
            m.half.push((0.5 * length, 0.5 * width));
            m.radius.push(math::hypot(0.5 * length, 0.5 * width));
            let now = object.track.get(current).copied().flatten();
            let present = now.is_some_and(|s| s.is_finite()) && object.agent.has_extent();
            m.present.push(present);
            if present {
                m.fill(i * frames, object, options);
            }
        }
        m
    }

    /// Lets an object that is absent at the current frame take part from its first frame on.
    pub(super) fn enter(&mut self, index: usize, object: &Object<'_>, options: &Options) {
        self.present[index] = object.agent.has_extent();
        if self.present[index] {
            self.fill(index * self.frames, object, options);
        }
    }

    fn fill(&mut self, base: usize, object: &Object<'_>, options: &Options) {
        let states = object.track.iter().take(self.frames);
        for (f, state) in states.enumerate().filter_map(|(f, s)| Some((f, s.filter(|s| s.is_finite())?))) {
            let k = base + f;
            (self.x[k], self.y[k], self.heading[k]) = (state.x, state.y, state.heading);
            // Half of all agents stand.
            let is_kept = f > 0 && self.heading[k - 1].to_bits() == state.heading.to_bits();
            self.axis[k] = if is_kept { self.axis[k - 1] } else { direction(state.heading) };
            if let (VelocitySource::State, Some(v)) = (options.velocity_source, state.velocity()) {
                self.velocity[k] = v;
            }
        }
        for f in 0..self.frames {
            let k = base + f;
            if self.x[k].is_nan() {
                continue;
            }
            if self.velocity[k].x.is_nan() {
                self.velocity[k] = self.difference(base, f);
            }
            self.speed[k] = math::hypot(self.velocity[k].x, self.velocity[k].y);
        }
    }

    /// Returns the backward difference of the positions, else the forward difference, else NaN.
    fn difference(&self, base: usize, f: usize) -> Vec2 {
        let between = |from: usize, to: usize| {
            let d = Vec2::new(self.x[to] - self.x[from], self.y[to] - self.y[from]);
            d / DT
        };
        let k = base + f;
        if f > 0 && !self.x[k - 1].is_nan() {
            between(k - 1, k)
        } else if f + 1 < self.frames && !self.x[k + 1].is_nan() {
            between(k, k + 1)
        } else {
            Vec2::new(f64::NAN, f64::NAN)
        }
    }

    pub(super) fn at(&self, object: usize, frame: usize) -> usize {
        object * self.frames + frame
    }

    /// Returns the height of an object at a frame, metres; NaN if unknown, and in scenarios of one level.
    pub fn height(&self, object: usize, frame: usize) -> f64 {
        self.height.get(self.at(object, frame)).copied().unwrap_or(f64::NAN)
    }

    /// Returns whether an object is present at a frame.
    pub fn valid(&self, object: usize, frame: usize) -> bool {
        !self.x[self.at(object, frame)].is_nan()
    }

    /// Returns the position of an object at a frame, metres; NaN if absent.
    pub fn position(&self, object: usize, frame: usize) -> Vec2 {
        let k = self.at(object, frame);
        Vec2::new(self.x[k], self.y[k])
    }

    /// Returns whether an object is present at a frame in the pose, and on the level, of the frame before.
    pub(super) fn rests(&self, object: usize, frame: usize) -> bool {
        let k = self.at(object, frame);
        let is_equal = |values: &[f64]| values[k] == values[k - 1];
        let has_pose = frame > 0 && [&self.x, &self.y, &self.heading].into_iter().all(|v| is_equal(v));
        has_pose && (self.height.is_empty() || is_equal(&self.height))
    }

    /// Returns the speed of an object at a frame, m/s; NaN if absent or unknown.
    pub fn speed(&self, object: usize, frame: usize) -> f64 {
        self.speed[self.at(object, frame)]
    }

    /// Returns the path length of an object from a frame on, metres: the sum of its displacements between
    /// successive valid frames. Nothing is counted while it is absent, nor between disappearing and
    /// reappearing.
    pub fn path_length(&self, object: usize, from: usize) -> f64 {
        let driven = (from + 1..self.frames).filter(|&f| self.valid(object, f - 1) && self.valid(object, f));
        driven.map(|f| (self.position(object, f) - self.position(object, f - 1)).norm()).sum()
    }

    /// Returns the sharp box of an object that is valid at the frame.
    pub fn footprint(&self, object: usize, frame: usize) -> OrientedBox {
        let k = self.at(object, frame);
        let (half_length, half_width) = self.half[object];
        OrientedBox { center: Vec2::new(self.x[k], self.y[k]), axis: self.axis[k], half_length, half_width }
    }

    /// Returns the squared centre distance above which two objects cannot touch; the slack covers rounding.
    pub(super) fn reach2(&self, a: usize, b: usize) -> f64 {
        let reach = self.radius[a] + self.radius[b];
        reach * reach * (1.0 + 1e-9) + 1e-9
    }

    /// Returns the frames from `first` on at which two objects may touch, in order.
    pub(super) fn close_frames(&self, a: usize, b: usize, first: usize) -> impl Iterator<Item = usize> {
        /// Frames that are examined together, without a branch in between.
        const CHUNK: usize = 8;
        let reach2 = self.reach2(a, b);
        let track = |object: usize| self.at(object, first)..self.at(object, self.frames - 1) + 1;
        let (a, b) = (track(a), track(b));
        let (ax, bx) = (&self.x[a.clone()], &self.x[b.clone()]);
        let (ay, by) = (&self.y[a], &self.y[b]);
        (0..ax.len()).step_by(CHUNK).flat_map(move |from| {
            let to = (from + CHUNK).min(ax.len());
            let mut close = [false; CHUNK];
            for (k, close) in (from..to).zip(&mut close) {
                let (dx, dy) = (ax[k] - bx[k], ay[k] - by[k]);
                // NaN distances of absent objects fail the comparison.
                *close = dx * dx + dy * dy <= reach2;
            }
            close.into_iter().enumerate().filter_map(move |(k, close)| close.then_some(first + from + k))
        })
    }

    /// Returns the squared centre distance; NaN if either is absent.
    pub(super) fn distance2(&self, a: usize, b: usize, frame: usize) -> f64 {
        let (i, j) = (self.at(a, frame), self.at(b, frame));
        let (dx, dy) = (self.x[i] - self.x[j], self.y[i] - self.y[j]);
        dx * dx + dy * dy
    }
}
