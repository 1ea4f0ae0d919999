//! The simulated objects of a scenario, evaluated ones first, and their motion in the log or in a rollout.

use reactsim_scene::{
    CURRENT, FRAMES, FUTURE, HISTORY,
    wosac::{ObjectTrajectory, WosacLog, WosacTrack},
};

use super::error::WosacError;

/// The simulated objects in the order of the metrics: the evaluated ones by id, then the others in file
/// order.
pub(super) struct Objects {
    /// Index of each object in [`WosacLog::tracks`].
    tracks: Vec<usize>,
    /// Number of evaluated objects, which are the first ones.
    pub(super) evaluated: usize,
    /// Position of each object in [`WosacLog::simulated`].
    order: Vec<usize>,
}

impl Objects {
    pub(super) fn new(log: &WosacLog) -> Result<Self, WosacError> {
        let tracks = 0..log.tracks.len();
        let simulated: Vec<usize> = tracks.filter(|&i| log.tracks[i].is_simulated()).collect();
        let mut order = Vec::with_capacity(simulated.len());
        for id in log.evaluated() {
            let found = simulated.iter().position(|&i| log.tracks[i].id == id);
            order.push(found.ok_or_else(|| {
                WosacError(format!(
                    "scenario `{}`: object {id} of tracks_to_predict or the AV is invalid at frame 10, expected \
                     a simulated object",
                    log.scenario_id
                ))
            })?);
        }
        let evaluated = order.len();
        let others: Vec<usize> = (0..simulated.len()).filter(|i| !order.contains(i)).collect();
        order.extend(others);
        Ok(Self { tracks: order.iter().map(|&i| simulated[i]).collect(), evaluated, order })
    }

    /// Returns the tracks of all objects in the log, which must be that of the objects.
    pub(super) fn tracks<'l>(&self, log: &'l WosacLog) -> impl Iterator<Item = &'l WosacTrack> {
        self.tracks.iter().map(|&i| &log.tracks[i])
    }

    /// Returns the track of an object in the log.
    pub(super) fn track<'l>(&self, log: &'l WosacLog, object: usize) -> &'l WosacTrack {
        &log.tracks[self.tracks[object]]
    }

    /// Returns the logged motion.
    pub(super) fn logged<'l>(&self, log: &'l WosacLog) -> Motion<'l> {
        let future = |track: &'l WosacTrack| Future {
            x: future(&track.x[HISTORY..]),
            y: future(&track.y[HISTORY..]),
            z: future(&track.z[HISTORY..]),
            heading: future(&track.heading[HISTORY..]),
        };
        Motion {
            tracks: self.tracks(log).collect(),
            futures: self.tracks(log).map(future).collect(),
            valid: Some(self.tracks(log).map(|track| &track.valid[HISTORY..]).collect()),
            evaluated: self.evaluated,
        }
    }

    /// Returns the motion in a rollout, whose trajectories are in the order of [`WosacLog::simulated`].
    pub(super) fn simulated<'b>(&self, log: &'b WosacLog, rollout: &[&'b ObjectTrajectory]) -> Motion<'b> {
        let future = |&i: &usize| Future {
            x: future(&rollout[i].x),
            y: future(&rollout[i].y),
            z: future(&rollout[i].z),
            heading: future(&rollout[i].heading),
        };
        Motion {
            tracks: self.tracks(log).collect(),
            futures: self.order.iter().map(future).collect(),
            valid: None,
            evaluated: self.evaluated,
        }
    }
}

fn future(values: &[f32]) -> &[f32; FUTURE] {
    values.try_into().expect("lengths were checked")
}

/// The motion of all simulated objects: in the log, or in a rollout that continues its history.
pub(super) struct Motion<'a> {
    pub(super) tracks: Vec<&'a WosacTrack>,
    /// States at the frames 11 to 90, by object.
    pub(super) futures: Vec<Future<'a>>,
    /// Validity at the frames 11 to 90, by object; `None` if all are valid (rollouts).
    valid: Option<Vec<&'a [bool]>>,
    /// Number of evaluated objects, which are the first ones.
    pub(super) evaluated: usize,
}

/// The states of an object at the frames 11 to 90.
#[derive(Clone, Copy)]
pub(super) struct Future<'a> {
    pub(super) x: &'a [f32; FUTURE],
    pub(super) y: &'a [f32; FUTURE],
    pub(super) z: &'a [f32; FUTURE],
    pub(super) heading: &'a [f32; FUTURE],
}

impl<'a> Motion<'a> {
    /// Returns whether an object is valid at a future step (counted from 0).
    pub(super) fn is_valid(&self, object: usize, step: usize) -> bool {
        self.valid.as_ref().is_none_or(|valid| valid[object][step])
    }

    /// Returns whether all objects are valid at all steps.
    pub(super) fn is_all_valid(&self) -> bool {
        self.valid.is_none()
    }

    /// Returns the values of a column over all 91 frames.
    pub(super) fn frames(history: &[f32], future: &[f32; FUTURE]) -> [f32; FRAMES] {
        let mut frames = [0.0; FRAMES];
        frames[..HISTORY].copy_from_slice(&history[..HISTORY]);
        frames[HISTORY..].copy_from_slice(future);
        frames
    }

    /// Returns the position of an object at the frame before a future step (counted from 0).
    pub(super) fn before(&self, object: usize, step: usize) -> [f32; 2] {
        match step.checked_sub(1) {
            Some(step) => [self.futures[object].x[step], self.futures[object].y[step]],
            None => [self.tracks[object].x[CURRENT], self.tracks[object].y[CURRENT]],
        }
    }
}
