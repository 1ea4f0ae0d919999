//! Choice of the places that an agent attends to.

use reactsim_geometry::{Vec2, into_frame};
use reactsim_nn::perception::{Body, Nearest, Places, Role};

use super::config::Config;

/// Distance ahead beyond which stops are ignored, metres.
const MAX_STOP_DISTANCE: f64 = 70.0;

/// The places of a map, and which of them agents attend to.
pub(crate) struct Surroundings<'a> {
    /// The places.
    pub places: &'a Places,
    /// The choice.
    pub chooser: &'a mut Chooser,
}

/// Chooses the places that agents attend to.
#[derive(Debug)]
pub(crate) struct Chooser {
    near: Nearest,
    ahead: Nearest,
    stops: Nearest,
    /// The last choice of each agent, by slot. Most agents stand, and choose the same again.
    last: Vec<Choice>,
}

/// A choice and what it depends on.
#[derive(Clone, Debug, Default)]
struct Choice {
    position: Vec2,
    ahead: Vec2,
    velocity: Vec2,
    chosen: Vec<usize>,
}

impl Chooser {
    /// Builds a chooser with the numbers of places per role from `config`.
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            near: Nearest::new(config.near_pieces),
            ahead: Nearest::new(config.ahead_pieces),
            stops: Nearest::new(config.stops),
            last: Vec::new(),
        }
    }

    /// Chooses the places for the agent in a slot, always of the same map: the pieces nearest to it; other
    /// lane pieces, not against its heading, nearest to its position in 2 s (8 to 35 m ahead); and the
    /// nearest stops ahead.
    pub(crate) fn choose(&mut self, slot: usize, me: &Body, places: &Places) -> &[usize] {
        if self.last.len() <= slot {
            self.last.resize_with(slot + 1, Choice::default);
        }
        let last = &self.last[slot];
        // An agent has a heading, so that the default is none of its choices.
        if (last.position, last.ahead, last.velocity) != (me.position, me.ahead, me.velocity) {
            let chosen = self.chosen(me, places);
            let Body { position, ahead, velocity, .. } = *me;
            self.last[slot] = Choice { position, ahead, velocity, chosen };
        }
        &self.last[slot].chosen
    }

    fn chosen(&mut self, me: &Body, places: &Places) -> Vec<usize> {
        self.stops.clear();
        let (places, middles) = (&places.all, places.middles());
        let pieces = places.partition_point(|p| p.role != Role::Stop);
        middles.nearest(me.position, |i| i < pieces, &mut self.near);
        let mut chosen: Vec<usize> = self.near.found().collect();
        let lead = (2.0 * me.velocity.norm()).clamp(8.0, 35.0);
        let target = me.position + me.ahead * lead;
        let is_ahead = |i: usize| {
            let place = &places[i];
            place.role == Role::Lane && place.ahead.dot(&me.ahead) > 0.0 && !chosen.contains(&i)
        };
        middles.nearest(target, is_ahead, &mut self.ahead);
        chosen.extend(self.ahead.found());
        for (i, place) in places.iter().enumerate().skip(pieces) {
            let at = into_frame(me.ahead, place.start - me.position);
            let facing = place.ahead.dot(&me.ahead) > 0.3;
            if facing && at.x > -2.0 && at.x < MAX_STOP_DISTANCE && at.y.abs() < 6.0 + 0.3 * at.x.abs() {
                self.stops.offer(at.norm_squared(), i);
            }
        }
        chosen.extend(self.stops.found());
        chosen
    }
}
