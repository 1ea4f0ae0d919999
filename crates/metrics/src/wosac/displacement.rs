//! Displacement of simulated objects from the log.

use reactsim_scene::FUTURE;

use super::objects::Motion;

/// Returns the mean distance of an evaluated object in a rollout to its log, in metres, in three dimensions
/// over all frames at which the log is valid. As in the official code, these include the frames of the
/// history, where the distance is 0.
pub(super) fn average_displacement(log: &Motion, rollout: &Motion, object: usize) -> f64 {
    let (logged, simulated) = (&log.futures[object], &rollout.futures[object]);
    let history = log.tracks[object].valid.len() - FUTURE;
    let mut count = log.tracks[object].valid[..history].iter().filter(|valid| **valid).count();
    let mut sum = 0.0;
    for k in 0..FUTURE {
        if log.is_valid(object, k) {
            let d = [(logged.x, simulated.x), (logged.y, simulated.y), (logged.z, simulated.z)]
                .map(|(logged, simulated)| f64::from(simulated[k]) - f64::from(logged[k]));
            sum += (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            count += 1;
        }
    }
    // Every simulated object is valid at the current frame.
    sum / count as f64
}
