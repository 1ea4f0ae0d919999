//! Rewards of the agents in a rollout.

use reactsim_geometry::{OrientedBox, direction, math};
use reactsim_scene::dynamics::Pose;

use super::super::closed_loop::{AV, RecordedAgent};
use super::Rewards;

/// Speed up to which an agent stands, m/s: whoever stands brings no contact about.
const STANDING: f64 = 0.05;

/// An object is behind an agent if the angle to it is larger, degrees: the contact is the other's doing.
const BEHIND: f64 = 150.0;

/// Poses between steps and at their ends, by agent, then frame. Frame 0 is the end of the history.
pub(super) type Paths = Vec<Vec<Option<Pose>>>;

/// Result of a rollout.
#[derive(Debug, Default)]
pub(super) struct Outcome {
    /// Discounted reward from every step on, by agent, then step. The token of step 0 leads away from the
    /// history.
    pub(super) returns: Vec<Vec<f64>>,
    /// Number of agents that brought about a contact with the AV.
    pub(super) av_contacts: usize,
    /// Number of agents that brought about a contact with another agent.
    pub(super) contacts: usize,
}

/// Judges a rollout of `steps` steps with `frames` frames each, which last `dt` seconds.
pub(super) fn judge(
    agents: &[RecordedAgent],
    paths: &Paths,
    steps: usize,
    frames: usize,
    dt: f64,
    rewards: &Rewards,
) -> Outcome {
    let mut fines = vec![vec![0.0; steps]; agents.len()];
    let mut outcome = Outcome::default();
    for (a, own) in fines.iter_mut().enumerate() {
        for (step, fine) in own.iter_mut().enumerate() {
            if let (Some(pose), Some(goal)) = (paths[a][(step + 1) * frames], agents[a].record[step]) {
                let distance = (pose.position - goal.position).norm();
                *fine += rewards.distance * distance.min(rewards.most_distance);
            }
        }
        let [with_av, with_others] = first_contacts(agents, paths, a, dt);
        let kinds = [
            (with_av, rewards.av_contact, &mut outcome.av_contacts),
            (with_others, rewards.contact, &mut outcome.contacts),
        ];
        for (frame, fine, count) in kinds {
            if let Some(frame) = frame {
                own[(frame - 1) / frames] += fine;
                *count += 1;
            }
        }
    }
    outcome.returns = fines.iter().map(|own| returns(own, rewards.discount)).collect();
    outcome
}

/// Returns the discounted sums of all later fines, negated.
fn returns(fines: &[f64], discount: f64) -> Vec<f64> {
    let mut later = 0.0;
    let mut sums: Vec<f64> = fines
        .iter()
        .rev()
        .map(|fine| {
            later = discount * later - fine;
            later
        })
        .collect();
    sums.reverse();
    sums
}

/// Returns the frames of the first contacts of an agent, with the AV and with others, if it brings them
/// about: it moves, and the other is not behind it. Contacts that exist at frame 0 do not count.
fn first_contacts(agents: &[RecordedAgent], paths: &Paths, a: usize, dt: f64) -> [Option<usize>; 2] {
    let mut first = [None; 2];
    if a == AV {
        return first;
    }
    for b in (0..agents.len()).filter(|b| *b != a) {
        let kind = usize::from(b != AV);
        let Some(frame) = contact(agents, paths, a, b) else { continue };
        if first[kind].is_none_or(|earlier| frame < earlier) && brings_about(paths, a, b, frame, dt) {
            first[kind] = Some(frame);
        }
    }
    first
}

/// Returns the first frame at which the boxes of two agents overlap, unless they do at frame 0.
fn contact(agents: &[RecordedAgent], paths: &Paths, a: usize, b: usize) -> Option<usize> {
    let extent = |i: usize| agents[i].extent;
    let reach = 0.5 * (math::hypot(extent(a)[0], extent(a)[1]) + math::hypot(extent(b)[0], extent(b)[1]));
    let hull =
        |i: usize, pose: Pose| OrientedBox::new(pose.position, pose.heading, extent(i)[0], extent(i)[1]);
    let overlap = |frame: &usize| {
        let (Some(p), Some(q)) = (paths[a][*frame], paths[b][*frame]) else { return false };
        (p.position - q.position).norm() < reach && hull(a, p).separation(&hull(b, q)) < 0.0
    };
    (0..paths[a].len()).find(overlap).filter(|frame| *frame > 0)
}

fn brings_about(paths: &Paths, a: usize, b: usize, frame: usize, dt: f64) -> bool {
    let (Some(before), Some(pose), Some(other)) = (paths[a][frame - 1], paths[a][frame], paths[b][frame])
    else {
        return false;
    };
    let moves = (pose.position - before.position).norm() > STANDING * dt;
    let to_other = other.position - pose.position;
    let ahead = direction(pose.heading).dot(&to_other);
    moves && ahead >= to_other.norm() * math::cos(BEHIND.to_radians())
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_nn::perception::Class;

    use super::*;

    const REWARDS: Rewards =
        Rewards { av_contact: 1.0, contact: 0.5, distance: 0.1, most_distance: 4.0, discount: 0.5 };

    fn at(x: f64) -> Option<Pose> {
        Some(Pose { position: Vec2::new(x, 0.0), heading: 0.0 })
    }

    fn agent(record: [f64; 2]) -> RecordedAgent {
        RecordedAgent {
            class: Class::Vehicle,
            extent: [4.0, 2.0],
            pose: at(0.0),
            record: record.into_iter().map(at).collect(),
            weight: 1.0,
        }
    }

    /// Judges two agents in a row; there is one frame per step.
    fn outcome(av: [f64; 3], follower: [f64; 3], record: [f64; 2]) -> Outcome {
        let agents = [agent([av[1], av[2]]), agent(record)];
        let path = |xs: [f64; 3]| xs.into_iter().map(at).collect();
        judge(&agents, &vec![path(av), path(follower)], 2, 1, 0.5, &REWARDS)
    }

    #[test]
    fn a_rear_end_collision_is_the_doing_of_the_follower() {
        let hit = outcome([10.0, 10.0, 10.0], [0.0, 5.0, 7.0], [5.0, 7.0]);
        assert_eq!((hit.av_contacts, hit.contacts), (1, 0));
        assert_eq!(hit.returns, [[0.0, 0.0], [-0.5, -1.0]]);
        // The AV runs into an agent ahead of it, or into one that stands.
        for victim in [[10.0, 11.0, 12.0], [10.0, 10.0, 10.0]] {
            let struck = outcome([0.0, 5.0, 9.0], victim, [victim[1], victim[2]]);
            assert_eq!((struck.av_contacts, struck.contacts), (0, 0));
        }
    }

    #[test]
    fn an_overlap_from_the_start_is_nobodys_doing() {
        let outcome = outcome([3.0, 3.0, 3.0], [0.0, 1.0, 2.0], [1.0, 2.0]);
        assert_eq!(outcome.av_contacts, 0);
    }

    #[test]
    fn distance_from_the_record_is_fined_up_to_a_limit() {
        let outcome = outcome([100.0; 3], [0.0, 1.0, 10.0], [2.0, 4.0]);
        assert_eq!(outcome.returns[1], [-0.1 - 0.5 * 0.4, -0.4]);
    }
}
