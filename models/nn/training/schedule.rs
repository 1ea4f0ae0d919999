//! Learning-rate schedule.

use reactsim_geometry::math::cos;

use super::Settings;

/// Returns the learning rate of a step, counted from 0, of `steps`: linear warm-up, then half a cosine
/// down to the floor (Loshchilov and Hutter, "SGDR", <https://arxiv.org/abs/1608.03983>, without
/// restarts).
pub(super) fn learning_rate(settings: &Settings, step: u64, steps: u64) -> f64 {
    let warm_up = settings.warm_up.min(steps);
    if step < warm_up {
        return settings.learning_rate * (step + 1) as f64 / warm_up as f64;
    }
    let span = (steps - warm_up).saturating_sub(1).max(1);
    let done = ((step - warm_up) as f64 / span as f64).min(1.0);
    let height = 0.5 * (1.0 + cos(std::f64::consts::PI * done));
    settings.learning_rate * (settings.floor + (1.0 - settings.floor) * height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_grows_falls_and_ends_at_its_floor() {
        let settings = Settings { learning_rate: 2.0, floor: 0.1, warm_up: 4, ..Settings::default() };
        let rate = |step| learning_rate(&settings, step, 104);
        assert_eq!([rate(0), rate(1), rate(3), rate(4)], [0.5, 1.0, 2.0, 2.0]);
        assert!((rate(103) - 0.2).abs() < 1e-12);
        assert!((5..104).all(|s| rate(s) < rate(s - 1)));
        assert!((learning_rate(&settings, 0, 1) - 2.0).abs() < 1e-12);
    }
}
