//! How future poses are written as numbers of the network.

use reactsim_geometry::{Vec2, direction};

use super::inputs::{AHEAD, AxleFrame, UNIT};

/// Unit of differences from constant velocity now, metres.
const RELATIVE_UNIT: f64 = 0.5;
/// Acceleration, m/s², by which this unit grows: what vehicles usually do differently.
const USUAL_ACCELERATION: f64 = 1.0;

/// Numbers of the future poses of one agent.
#[derive(Clone, Copy, Debug)]
pub(super) enum Units {
    /// Positions in units of 20 m from a point ahead of the AV, cosine and sine of the heading (published).
    Absolute,
    /// Differences from constant velocity, in units that grow with time, and of cosine and sine from those of
    /// the present heading.
    Relative {
        /// Present position in the frame of the AV, metres.
        at: Vec2,
        /// Velocity in this frame, m/s.
        velocity: Vec2,
        /// Direction of the present heading in this frame.
        ahead: Vec2,
    },
}

impl Units {
    /// Returns the units of an agent at this position (the rear axle of the AV), with this heading and
    /// velocity.
    pub(super) fn of(relative: bool, frame: &AxleFrame, at: Vec2, heading: f64, velocity: Vec2) -> Self {
        if !relative {
            return Self::Absolute;
        }
        let ahead = frame.vector(direction(heading));
        Self::Relative { at: frame.point(at), velocity: frame.vector(velocity), ahead }
    }

    /// Writes a pose at a time from now, s, in the frame of the AV.
    pub(super) fn write(&self, time: f64, at: Vec2, ahead: Vec2) -> [f32; 4] {
        let (from, unit, heading) = self.origin(time);
        let (at, ahead) = ((at - from) / unit, ahead - heading);
        [at.x, at.y, ahead.x, ahead.y].map(|v| v as f32)
    }

    /// Reads a pose at a time from now, s: x, y (m), cosine and sine of the heading in the frame of the AV.
    pub(super) fn read(&self, time: f64, numbers: [f64; 4]) -> [f64; 4] {
        let (from, unit, heading) = self.origin(time);
        let [x, y, cos, sin] = numbers;
        [from.x + unit * x, from.y + unit * y, heading.x + cos, heading.y + sin]
    }

    /// Returns the position that is 0, the unit, metres, and the direction that is 0.
    fn origin(&self, time: f64) -> (Vec2, f64, Vec2) {
        match self {
            Self::Absolute => (Vec2::new(AHEAD, 0.0), UNIT, Vec2::zeros()),
            Self::Relative { at, velocity, ahead } => {
                let unit = (RELATIVE_UNIT + 0.5 * USUAL_ACCELERATION * time * time).min(UNIT);
                (at + velocity * time, unit, *ahead)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_read_as_they_were_written() {
        let at = Vec2::new(3.0, -2.0);
        let relative = Units::Relative { at, velocity: Vec2::new(8.0, 1.0), ahead: Vec2::new(0.6, 0.8) };
        for units in [Units::Absolute, relative] {
            for time in [0.5, 8.0] {
                let numbers = units.write(time, Vec2::new(20.0, 4.0), Vec2::new(0.8, 0.6));
                let pose = units.read(time, numbers.map(f64::from));
                for (read, wanted) in pose.into_iter().zip([20.0, 4.0, 0.8, 0.6]) {
                    assert!((read - wanted).abs() < 1e-5, "{units:?} {pose:?}");
                }
            }
        }
        // An agent that keeps its velocity and heading is written as zeros.
        assert_eq!(relative.write(2.0, Vec2::new(19.0, 0.0), Vec2::new(0.6, 0.8)), [0.0; 4]);
    }
}
