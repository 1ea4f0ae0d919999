//! Choice of the places that an agent attends to.

use reactsim_geometry::into_frame;
use reactsim_perception::{Body, Nearest, Places, Role};

use super::config::Config;

/// Distance ahead beyond which stops are ignored, metres.
const MAX_STOP_DISTANCE: f64 = 70.0;

/// Chooses the places that agents attend to.
#[derive(Debug)]
pub(crate) struct Chooser {
    near: Nearest,
    ahead: Nearest,
    stops: Nearest,
}

impl Chooser {
    /// Builds a chooser with the numbers of places per role from `config`.
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            near: Nearest::new(config.near_pieces),
            ahead: Nearest::new(config.ahead_pieces),
            stops: Nearest::new(config.stops),
        }
    }

    /// Chooses the places for one agent: the pieces nearest to it; other lane pieces, not against its
    /// heading, nearest to its position in 2 s (8 to 35 m ahead); and the nearest stops ahead.
    pub(crate) fn choose(&mut self, me: &Body, places: &Places, chosen: &mut Vec<usize>) {
        self.stops.clear();
        chosen.clear();
        let (places, middles) = (&places.all, places.middles());
        let pieces = places.partition_point(|p| p.role != Role::Stop);
        middles.nearest(me.position, |i| i < pieces, &mut self.near);
        chosen.extend(self.near.found());
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
    }
}
