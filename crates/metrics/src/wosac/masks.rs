//! Masks of the logged steps that are judged.

use reactsim_scene::FUTURE;

/// The steps of an evaluated object at which logged features are judged, by order of differences.
#[derive(Clone, Debug)]
pub(super) struct Masks {
    /// The state is valid.
    pub(super) states: [bool; FUTURE],
    /// The states before and after are valid, as speeds need; never the first and the last step.
    pub(super) speeds: [bool; FUTURE],
    /// The speeds before and after are valid, as accelerations need.
    pub(super) accelerations: [bool; FUTURE],
}

impl Masks {
    /// Derives the masks from the validity of the steps 1 to 80.
    pub(super) fn new(states: [bool; FUTURE]) -> Self {
        let speeds = between(&states);
        Self { accelerations: between(&speeds), speeds, states }
    }
}

/// Returns where both neighbours are valid.
fn between(valid: &[bool; FUTURE]) -> [bool; FUTURE] {
    let mut both = [false; FUTURE];
    for k in 1..FUTURE - 1 {
        both[k] = valid[k - 1] && valid[k + 1];
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_itself_need_not_be_valid() {
        let mut states = [true; FUTURE];
        states[10] = false;
        let masks = Masks::new(states);
        let invalid = |mask: &[bool; FUTURE]| (0..FUTURE).filter(|&k| !mask[k]).collect::<Vec<_>>();
        assert_eq!(invalid(&masks.speeds), [0, 9, 11, 79]);
        assert_eq!(invalid(&masks.accelerations), [0, 1, 8, 10, 12, 78, 79]);
    }
}
