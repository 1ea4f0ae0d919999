//! Offsets and widths that change smoothly along a road.

use reactsim_geometry::smooth_step;

/// A value along a path: constant except for smooth transitions, which have neither a kink nor a jump of
/// curvature.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    start: f64,
    changes: Vec<(f64, f64, f64)>,
}

impl Profile {
    /// Creates a constant profile.
    pub const fn flat(value: f64) -> Self {
        Self { start: value, changes: Vec::new() }
    }

    /// Adds a transition to another value from `from` to `to` metres along the path. Transitions must
    /// follow one another.
    #[must_use]
    pub fn then(mut self, from: f64, to: f64, value: f64) -> Self {
        self.changes.push((from, to, value));
        self
    }

    /// Returns the value at `s`.
    pub fn at(&self, s: f64) -> f64 {
        let mut value = self.start;
        for &(from, to, next) in &self.changes {
            value += (next - value) * smooth_step((s - from) / (to - from));
        }
        value
    }

    /// Whether the value changes somewhere between the two arc lengths.
    pub fn changes_within(&self, from: f64, to: f64) -> bool {
        self.changes.iter().any(|&(a, b, _)| a < to && b > from)
    }
}

impl From<f64> for Profile {
    fn from(value: f64) -> Self {
        Self::flat(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goes_from_value_to_value() {
        let p = Profile::flat(1.0).then(10.0, 20.0, 3.0).then(30.0, 40.0, 0.0);
        assert_eq!([p.at(0.0), p.at(10.0), p.at(15.0), p.at(25.0), p.at(50.0)], [1.0, 1.0, 2.0, 3.0, 0.0]);
        assert!(p.changes_within(5.0, 12.0) && !p.changes_within(20.0, 30.0));
    }
}
