//! Deviation of the evaluated AV from the logged AV (ReactSim-Bench, "Deviation Statistics").

use reactsim_geometry::{Vec2, math};
use reactsim_scene::DT;

use super::Case;

/// Difference between the evaluated AV and the logged AV over the scored steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviationStats {
    /// Offset of the last position along the AV's current heading, metres; `None` if either is absent.
    pub endpoint_longitudinal: Option<f64>,
    /// Offset of the last position to the left of the AV's current heading, metres.
    pub endpoint_lateral: Option<f64>,
    /// Mean distance over the steps at which both are valid, metres.
    pub ade: Option<f64>,
    /// Mean step length over 0.1 s of the logged AV, m/s.
    pub mean_speed_log: Option<f64>,
    /// Mean step length over 0.1 s of the evaluated AV, m/s.
    pub mean_speed_deviated: Option<f64>,
    /// Evaluated minus logged mean speed, m/s.
    pub mean_speed_difference: Option<f64>,
}

impl Case<'_> {
    /// Returns the deviation of the evaluated AV from the logged AV; `None` without a log or an AV.
    pub fn deviation(&self) -> Option<DeviationStats> {
        let log = self.log.as_ref()?;
        if !self.present(self.av) {
            return None;
        }
        let log = &log[self.av];
        let logged = |f: usize| log.at(f).filter(|s| s.is_finite()).map(|s| s.position());
        let judged = |f: usize| self.motion.valid(self.av, f).then(|| self.motion.position(self.av, f));
        let (mut sum, mut n) = (0.0, 0_u32);
        for f in self.future() {
            if let (Some(a), Some(b)) = (judged(f), logged(f)) {
                sum += math::hypot(a.x - b.x, a.y - b.y);
                n += 1;
            }
        }
        let last = self.frames() - 1;
        let ahead = self.motion.axis[self.motion.at(self.av, self.current)];
        let end = judged(last).zip(logged(last)).map(|(a, b)| a - b);
        let speeds = (mean_speed(self, logged), mean_speed(self, judged));
        Some(DeviationStats {
            endpoint_longitudinal: end.map(|d| d.dot(&ahead)),
            endpoint_lateral: end.map(|d| ahead.perp(&d)),
            ade: (n > 0).then(|| sum / f64::from(n)),
            mean_speed_log: speeds.0,
            mean_speed_deviated: speeds.1,
            mean_speed_difference: speeds.0.zip(speeds.1).map(|(log, judged)| judged - log),
        })
    }
}

/// Returns the mean length of the steps between consecutive valid frames, divided by 0.1 s, m/s. The first
/// step begins at the current frame.
fn mean_speed(case: &Case<'_>, at: impl Fn(usize) -> Option<Vec2>) -> Option<f64> {
    let (mut sum, mut n) = (0.0, 0_u32);
    for f in case.future() {
        if let (Some(a), Some(b)) = (at(f - 1), at(f)) {
            sum += math::hypot(b.x - a.x, b.y - a.y) / DT;
            n += 1;
        }
    }
    (n > 0).then(|| sum / f64::from(n))
}
