//! Pedestrians: people who walk along footways, wait at kerbs, cross roads, stand and talk.
//!
//! **Model.** The social force model (Helbing & Molnár, *Social force model for pedestrian dynamics*, Phys.
//! Rev. E 51, 1995) with the interaction and the parameters that Moussaïd et al. measured (*Experimental
//! study of the behavioural mechanisms underlying self-organization in human crowds*, Proc. R. Soc. B 276,
//! 2009: A = 4.5 m/s², γ = 0.35, n = 2, n' = 3, λ = 2, ε = 0.005, relaxation time 0.54 s). Desired speeds
//! are normal with mean 1.34 m/s and standard deviation 0.26 m/s (Weidmann, *Transporttechnik der
//! Fussgänger*, ETH Zürich, 1993), lower for old people and for groups, whose sizes follow Coleman & James
//! (1961) and which walk abreast (Moussaïd et al., *The walking behaviour of pedestrian social groups and
//! its impact on crowd dynamics*, PLoS ONE 5, 2010). The module `crossing` documents behaviour at kerbs,
//! with its sources.
//!
//! **Differences.** Walls exert no force: everybody aims at a lateral position on the footway and never
//! leaves its ground. Bodies are discs around their boxes, which never touch: nobody walks into occupied
//! space, and steps that would do so are not taken. Recorded boxes overlap now and then (5 % of the people
//! have somebody within 0.53 m); generated ones must not.
//!
//! **Measured** in the Waymo Open Motion Dataset (the train split kept outside this repository, 196
//! scenarios, 1057 people): boxes of 0.87 m by 0.84 m (standard deviations 0.08 m and 0.07 m); 9 % stand;
//! the mean speeds of the others have quantiles 0.51, 0.82, 1.12, 1.34 and 1.55 m/s at 10, 25, 50, 75 and
//! 90 %; nine in ten changes of speed over 0.5 s are within ±0.8 m/s²; within 80 m of the AV there are on
//! average 1.8 people, none in more than half of the scenes, 8 or more in one of twenty.

mod aim;
mod crossing;
mod forces;
mod ground;
mod motion;
mod network;
mod populate;
mod walker;

#[cfg(test)]
mod tests;

pub use crossing::{Approach, Crosser, Crossing, Intent, WalkLight};

use self::motion::StepBuffers;
use self::network::Network;
use self::walker::{Activity, Walker};
use crate::Layout;
use crate::heights::on_different_levels;
use reactsim_geometry::{Vec2, signed_angle_between};
use reactsim_rollout::Stream;

/// A person as others see them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Unique number.
    pub id: u64,
    /// Box centre, metres.
    pub position: Vec2,
    /// Height, metres; `None` on maps without heights.
    pub height: Option<f64>,
    /// Velocity over the last step, m/s.
    pub velocity: Vec2,
    /// Heading, radians; standing people keep it.
    pub heading: f64,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
}

/// A vehicle or bicycle near footways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    /// Box centre, metres.
    pub position: Vec2,
    /// Heading, radians.
    pub heading: f64,
    /// Speed along the heading, m/s.
    pub speed: f64,
    /// Acceleration along the heading, m/s²; negative when it brakes.
    pub acceleration: f64,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
}

/// Traffic that people see at one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surroundings<'a> {
    /// Vehicles that people may meet: those on crossings and before them; others are harmless.
    pub vehicles: &'a [Vehicle],
    /// Vehicles that approach crossings.
    pub approaches: &'a [Approach],
    /// Pedestrian lights, per entry of [`Crowd::crossings`]; crossings beyond the end of the list have no
    /// light.
    pub lights: &'a [WalkLight],
}

/// All pedestrians.
#[derive(Clone, Debug)]
pub struct Crowd {
    network: Network,
    crossings: Vec<Crossing>,
    /// Width of each crossing along the vehicles' path, metres.
    depths: Vec<f64>,
    /// Index of the stretch of each crossing.
    at: Vec<usize>,
    walkers: Vec<Walker>,
    /// Members of arriving groups who still wait for room to enter the map.
    pending: Vec<Vec<Walker>>,
    /// Approximate number of people to keep on the map.
    wanted: usize,
    next_id: u64,
    rng: Stream,
    buffers: StepBuffers,
}

impl Crowd {
    /// Draws the initial people and their positions. A density of 1 is an ordinary day; the number of
    /// people is proportional to it.
    ///
    /// Maps vary widely, from empty to crowded; there are at most 60 people.
    pub fn new(layout: &Layout, density: f64, rng: &mut Stream) -> Self {
        populate::crowd(layout, density, rng)
    }

    /// Returns all people.
    pub fn people(&self) -> impl Iterator<Item = Person> {
        self.walkers.iter().map(|w| Person {
            id: w.id,
            position: w.position,
            height: self.height(w),
            velocity: w.velocity,
            heading: signed_angle_between(Vec2::x(), w.facing),
            length: w.length,
            width: w.width,
        })
    }

    /// Returns the crossings in the order of the layout's footways, each with the people who are on the
    /// road or want to cross.
    pub fn crossings(&self) -> &[Crossing] {
        &self.crossings
    }

    /// Advances by `dt` seconds, 0.1 s or less.
    pub fn step(&mut self, dt: f64, surroundings: &Surroundings<'_>) {
        self.arrive(dt);
        let mut buffers = std::mem::take(&mut self.buffers);
        buffers.old.clear();
        buffers.old.extend(self.walkers.iter().map(|w| w.position));
        buffers.heights.clear();
        buffers.heights.extend(self.walkers.iter().map(|w| self.height(w)));
        buffers.pair(&self.walkers);
        buffers.aims.clear();
        buffers.aims.extend(self.walkers.iter().map(|w| self.aim(w, surroundings)));
        self.push(&mut buffers);
        self.walk(&buffers, surroundings, dt);
        self.part(&buffers);
        self.settle(&buffers, surroundings, dt);
        self.buffers = buffers;
        self.leave();
        self.report();
    }

    /// Returns the height of a pedestrian, metres, if known.
    fn height(&self, w: &Walker) -> Option<f64> {
        self.network.stretches[w.stretch].height_at(w.s)
    }

    /// Whether two pedestrians who are near each other in the plane are on different levels.
    fn are_apart(&self, a: &Walker, b: &Walker) -> bool {
        on_different_levels(self.height(a), self.height(b), (b.position - a.position).norm())
    }

    /// Lists the people on crossings.
    fn report(&mut self) {
        for crossing in &mut self.crossings {
            crossing.people.clear();
        }
        for w in &self.walkers {
            let Some(place) = self.at_crossing(w) else { continue };
            let light = self.crossings[place.which].light;
            let intent = if place.to_kerb <= 0.0 {
                Intent::OnRoad
            } else if w.looked > 0.0 && place.to_kerb < 2.0 * w.desired_speed {
                Intent::SteppingOff
            } else if !light && place.to_kerb < 3.0 && w.activity == Activity::Walking {
                Intent::Waiting
            } else {
                continue;
            };
            let (position, velocity) = (w.position, w.velocity);
            self.crossings[place.which].people.push(Crosser { position, velocity, intent });
        }
    }
}
