//! Which elements of a scene each element sees.

use reactsim_geometry::Vec2;

/// Time over which elements are taken to keep their velocities, seconds. Who will meet is seen by each other,
/// even if many others are nearer now.
const HORIZON: f64 = 3.0;

/// Where an element is and how it moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Position, metres.
    pub(super) at: Vec2,
    /// Velocity, m/s.
    pub(super) velocity: Vec2,
    /// Whether the element is there.
    pub(super) present: bool,
}

impl Motion {
    /// Returns when this element comes nearest to another within the horizon, seconds, and how near, metres.
    pub(super) fn meeting(&self, other: &Self) -> (f64, f64) {
        let (apart, apace) = (other.at - self.at, other.velocity - self.velocity);
        let pace = apace.dot(&apace);
        let when = if pace > 0.0 { (-apart.dot(&apace) / pace).clamp(0.0, HORIZON) } else { 0.0 };
        (when, (apart + apace * when).norm())
    }
}

/// For each of the first elements of a scene those that it sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pairs {
    /// Number of elements that see.
    pub(super) own: usize,
    /// Number of elements that each of them sees.
    pub(super) each: usize,
    /// Those elements, `[own, each]`; `None` if they are the first ones for all.
    pub(super) others: Option<Vec<u32>>,
}

impl Pairs {
    /// Lets each of the first `own` elements see those of the first `among` that come nearest to it, at most
    /// `limit`, itself included. Elements that are not there count as farthest.
    pub(super) fn nearest(motions: &[Motion], own: usize, among: usize, limit: usize) -> Self {
        if among <= limit {
            return Self { own, each: among, others: None };
        }
        let mut others = Vec::with_capacity(own * limit);
        for from in &motions[..own] {
            let mut found: Vec<(bool, f64, u32)> = (0..among as u32)
                .zip(motions)
                .map(|(i, motion)| (!motion.present, from.meeting(motion).1, i))
                .collect();
            found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
            others.extend(found[..limit].iter().map(|(_, _, i)| i));
        }
        Self { own, each: limit, others: Some(others) }
    }

    /// Returns the elements that an element sees.
    pub(super) fn of(&self, own: usize) -> impl Iterator<Item = usize> {
        let listed = self.others.as_ref().map(|others| &others[own * self.each..]);
        (0..self.each).map(move |k| listed.map_or(k, |others| others[k] as usize))
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::{Motion, Pairs};

    fn standing(x: f64) -> Motion {
        Motion { at: Vec2::new(x, 0.0), velocity: Vec2::new(0.0, 0.0), present: true }
    }

    #[test]
    fn elements_see_themselves_and_the_nearest() {
        let places = [0.0, 3.0, 1.0, 0.5].map(standing);
        let pairs = Pairs::nearest(&places, 2, 4, 2);
        assert_eq!(pairs.of(0).collect::<Vec<_>>(), [0, 3]);
        assert_eq!(pairs.of(1).collect::<Vec<_>>(), [1, 2]);
        let among_three = Pairs::nearest(&places, 1, 3, 2);
        assert_eq!(among_three.of(0).collect::<Vec<_>>(), [0, 2]);
    }

    #[test]
    fn elements_see_those_whom_they_will_meet() {
        let mut motions = [0.0, 3.0, 1.0, 40.0].map(standing);
        motions[3].velocity = Vec2::new(-20.0, 0.0);
        let pairs = Pairs::nearest(&motions, 1, 4, 2);
        assert_eq!(pairs.of(0).collect::<Vec<_>>(), [0, 3]);
        // After the horizon is too late, and what moves away is as far as it is.
        for velocity in [-12.0, 20.0] {
            motions[3].velocity = Vec2::new(velocity, 0.0);
            assert_eq!(Pairs::nearest(&motions, 1, 4, 2).of(0).collect::<Vec<_>>(), [0, 2]);
        }
    }

    #[test]
    fn absent_elements_come_last_and_no_more_than_there_are_are_seen() {
        let mut places = [0.0, 3.0, 1.0, 0.5].map(standing);
        places[3].present = false;
        let pairs = Pairs::nearest(&places, 1, 4, 2);
        assert_eq!(pairs.of(0).collect::<Vec<_>>(), [0, 2]);
        let all = Pairs::nearest(&places, 3, 4, 9);
        assert_eq!((all.others.as_ref(), all.of(2).collect()), (None, vec![0, 1, 2, 3]));
    }
}
