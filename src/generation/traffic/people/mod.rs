//! Pedestrians: people who walk along footways, wait at kerbs, cross roads, stand and talk.
//!
//! **Model.** The social force model (Helbing & Molnár, *Social force model for pedestrian dynamics*, Phys. Rev. E 51, 1995) with the
//! interaction and the parameters that Moussaïd et al. measured (*Experimental study of the behavioural mechanisms underlying
//! self-organization in human crowds*, Proc. R. Soc. B 276, 2009: A = 4.5 m/s², γ = 0.35, n = 2, n' = 3, λ = 2, ε = 0.005, relaxation
//! time 0.54 s). Desired speeds are normal with mean 1.34 m/s and deviation 0.26 m/s (Weidmann, *Transporttechnik der Fussgänger*, ETH
//! Zürich, 1993), less for the old and for groups, whose sizes follow Coleman & James (1961) and who walk abreast (Moussaïd et al.,
//! *The walking behaviour of pedestrian social groups and its impact on crowd dynamics*, PLoS ONE 5, 2010). What decides at kerbs is told,
//! with its sources, in `crossing`.
//!
//! **What differs.** Walls have no force: everybody aims at a place beside the line of the footway and never leaves its ground. Bodies are
//! discs around their boxes, which never touch: nobody walks into the room that another takes, and steps that would are not made.
//! Recorded boxes overlap now and then (5 % of the people have somebody within 0.53 m); generated ones may not.
//!
//! **Measured** in the Waymo Open Motion Dataset (the train split beside this repository, 196 scenarios, 1057 people): boxes of
//! 0.87 m by 0.84 m (deviations 0.08 m and 0.07 m), 9 % stand, the mean speeds of the others have quantiles 0.51, 0.82, 1.12, 1.34
//! and 1.55 m/s at 10, 25, 50, 75 and 90 %; changes of speed over 0.5 s lie within ±0.8 m/s² for nine in ten; within 80 m of the AV
//! there are on average 1.8 people, none in more than half of the scenes, 8 or more in one of twenty.

mod aim;
mod crossing;
mod forces;
mod network;
mod populate;
mod walker;

#[cfg(test)]
mod tests;

pub use crossing::{Approach, Crosser, Crossing, Intent, WalkLight, straight_approaches};

use self::aim::Aim;
use self::network::Network;
use self::walker::{Activity, Walker};
use crate::generation::Layout;
use crate::geometry::{OrientedBox, Vec2, direction, left, signed_angle_between};
use crate::rollout::Stream;

/// Time in which people reach the velocity that they want, seconds (Moussaïd et al. 2009).
const RELAXATION: f64 = 0.54;
/// Largest acceleration by which people follow what they want, m/s².
const AGILITY: f64 = 2.0;
/// Nobody goes faster than this multiple of the desired speed (Helbing & Molnár 1995).
const MOST: f64 = 1.3;
/// Bodies keep at least this distance, metres.
const CLEARANCE: f64 = 0.03;
/// Neighbours nearer than this hold one another up, metres.
const NEAR: f64 = 2.4;

/// A person, as others see them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Number, never used twice.
    pub id: u64,
    /// Box centre, metres.
    pub position: Vec2,
    /// Velocity over the last step, m/s.
    pub velocity: Vec2,
    /// Heading, radians; who stands keeps it.
    pub heading: f64,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
}

/// A vehicle or a bicycle near footways.
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

/// What people see of traffic at one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surroundings<'a> {
    /// Vehicles that may be met: those on crossings and before them; others do no harm.
    pub vehicles: &'a [Vehicle],
    /// Vehicles that come to crossings, by their ways. See [`straight_approaches`] for a guess.
    pub approaches: &'a [Approach],
    /// What the lights tell people, per entry of [`Crowd::crossings`]; crossings beyond the end are free.
    pub lights: &'a [WalkLight],
}

/// Everybody on foot.
#[derive(Clone, Debug)]
pub struct Crowd {
    network: Network,
    crossings: Vec<Crossing>,
    /// How far vehicles drive on each crossing, metres.
    depths: Vec<f64>,
    /// The stretch of each crossing.
    at: Vec<usize>,
    walkers: Vec<Walker>,
    /// Who is still to come of groups that come into the map, as there is room.
    pending: Vec<Vec<Walker>>,
    /// About so many people are kept on the map.
    wanted: usize,
    next_id: u64,
    rng: Stream,
    room: Room,
}

/// What is worked out at every step, kept for its memory.
#[derive(Clone, Debug, Default)]
struct Room {
    order: Vec<usize>,
    /// Pairs of people within reach of each other: indices, and the distance.
    pairs: Vec<(usize, usize, f64)>,
    aims: Vec<Aim>,
    forces: Vec<Vec2>,
    old: Vec<Vec2>,
}

impl Crowd {
    /// Draws who is there and where, for a density of 1 as on an ordinary day, and more or less in proportion.
    ///
    /// How busy a map is varies much, from nobody to a crowd; never more than 60 people.
    pub fn new(layout: &Layout, density: f64, rng: &mut Stream) -> Self {
        populate::crowd(layout, density, rng)
    }

    /// Everybody who is there.
    pub fn people(&self) -> impl Iterator<Item = Person> {
        self.walkers.iter().map(|w| Person {
            id: w.id,
            position: w.position,
            velocity: w.velocity,
            heading: signed_angle_between(Vec2::x(), w.facing),
            length: w.length,
            width: w.width,
        })
    }

    /// The crossings in the order of the layout's footways, each with who is on the road or wants to cross.
    pub fn crossings(&self) -> &[Crossing] {
        &self.crossings
    }

    /// Lets `dt` seconds go by: 0.1 s or less.
    pub fn step(&mut self, dt: f64, surroundings: &Surroundings<'_>) {
        self.arrive(dt);
        let mut room = std::mem::take(&mut self.room);
        room.old.clear();
        room.old.extend(self.walkers.iter().map(|w| w.position));
        room.pair(&self.walkers);
        room.aims.clear();
        room.aims.extend(self.walkers.iter().map(|w| self.aim(w, surroundings)));
        self.push(&mut room);
        self.walk(&room, surroundings, dt);
        self.part(&room);
        self.settle(&room, surroundings, dt);
        self.room = room;
        self.leave();
        self.report();
    }

    /// Social forces.
    fn push(&self, room: &mut Room) {
        room.forces.clear();
        room.forces.resize(self.walkers.len(), Vec2::zeros());
        for &(i, j, _) in &room.pairs {
            let (a, b) = (&self.walkers[i], &self.walkers[j]);
            if a.group == b.group {
                continue;
            }
            let d = b.position - a.position;
            for (me, d, own, other) in [(i, d, a.velocity, b.velocity), (j, -d, b.velocity, a.velocity)] {
                // Who stands, or has it behind, does not mind.
                if room.aims[me].speed > 0.0 && own.dot(&d) > -0.2 {
                    room.forces[me] += forces::interaction(d, own, other);
                }
            }
        }
    }

    /// New velocities and positions, each on its own ground.
    fn walk(&mut self, room: &Room, surroundings: &Surroundings<'_>, dt: f64) {
        for (i, w) in self.walkers.iter_mut().enumerate() {
            let aim = &room.aims[i];
            w.live(dt);
            w.looked = if aim.clear { w.looked + dt } else { 0.0 };
            if let Activity::Standing(left) = &mut w.activity {
                *left -= dt;
                if *left <= 0.0 {
                    w.activity = Activity::Walking;
                }
            }
            if aim.speed <= 0.0 && w.velocity.norm_squared() < 0.01 {
                w.velocity = Vec2::zeros();
                continue;
            }
            let wish = (aim.towards * aim.speed - w.velocity) / RELAXATION;
            let change = capped(wish + room.forces[i], AGILITY);
            w.velocity = capped(w.velocity + change * dt, MOST * w.desired_speed);
        }
        // Nobody walks into somebody.
        let before: Vec<Vec2> = self.walkers.iter().map(|w| w.velocity).collect();
        for &(i, j, distance) in room.pairs.iter().filter(|p| p.2 < NEAR) {
            let d = room.old[j] - room.old[i];
            let gap = distance - self.walkers[i].radius - self.walkers[j].radius - CLEARANCE;
            self.walkers[i].velocity = forces::held(self.walkers[i].velocity, d, gap, before[j]);
            self.walkers[j].velocity = forces::held(self.walkers[j].velocity, -d, gap, before[i]);
        }
        for (w, aim) in self.walkers.iter_mut().zip(&room.aims) {
            if aim.crossing.is_some() {
                for vehicle in surroundings.vehicles {
                    if let Some((d, gap)) = beside(w, vehicle) {
                        let moving = direction(vehicle.heading) * vehicle.speed;
                        w.velocity = forces::held(w.velocity, d, gap, moving);
                    }
                }
            }
            w.position += w.velocity * dt;
            w.stuck = if aim.speed > 0.5 && w.velocity.norm() < 0.15 { w.stuck + dt } else { 0.0 };
        }
        self.hold(room);
    }

    /// Keeps everybody who has moved on footways, and off the road who waits.
    fn hold(&mut self, room: &Room) {
        for i in 0..self.walkers.len() {
            if self.walkers[i].position != room.old[i] {
                let p = self.on_ground(&self.walkers[i]);
                self.walkers[i].position = room.aims[i].held_back(p, room.old[i]);
            }
        }
    }

    /// Pushes apart who came too near.
    fn part(&mut self, room: &Room) {
        for &(i, j, distance) in &room.pairs {
            if distance > 1.8 {
                continue;
            }
            let (a, b) = (&self.walkers[i], &self.walkers[j]);
            let d = b.position - a.position;
            let short = a.radius + b.radius + CLEARANCE - d.norm();
            if short <= 0.0 || d.norm() < 1e-6 {
                continue;
            }
            let still = |k: usize| room.aims[k].speed <= 0.0;
            let push = d / d.norm() * short * if still(i) || still(j) { 1.0 } else { 0.5 };
            if !still(i) {
                self.walkers[i].position -= push;
            }
            if !still(j) {
                self.walkers[j].position += push;
            }
        }
        self.hold(room);
    }

    /// Takes back the steps after which somebody would touch somebody, or a vehicle; then keeps book of where everybody is.
    fn settle(&mut self, room: &Room, surroundings: &Surroundings<'_>, dt: f64) {
        for (i, w) in self.walkers.iter_mut().enumerate() {
            if room.aims[i].crossing.is_none() || w.position == room.old[i] {
                continue;
            }
            let hit = |v: &Vehicle| beside(w, v).is_some_and(|(_, gap)| gap <= 0.0);
            if surroundings.vehicles.iter().any(hit) {
                w.position = room.old[i];
            }
        }
        // Every step that is taken back may be in somebody's way; in the end nobody has moved, and nobody touched anybody before.
        loop {
            let mut changed = false;
            for &(i, j, distance) in &room.pairs {
                if distance > 1.8 {
                    continue;
                }
                let (a, b) = (&self.walkers[i], &self.walkers[j]);
                if (b.position - a.position).norm() < a.radius + b.radius + 0.5 * CLEARANCE {
                    for k in [i, j] {
                        changed |= self.walkers[k].position != room.old[k];
                        self.walkers[k].position = room.old[k];
                    }
                }
            }
            if !changed {
                break;
            }
        }
        for (i, w) in self.walkers.iter_mut().enumerate() {
            w.velocity = (w.position - room.old[i]) / dt;
            let speed = w.velocity.norm();
            if speed > 0.25 {
                let ahead = w.velocity / speed;
                // Who turns round does so over the left shoulder.
                let turn = if ahead.dot(&w.facing) < -0.9 { left(w.facing) } else { ahead };
                let facing = w.facing + turn * (4.0 * dt).min(1.0);
                w.facing = facing / facing.norm();
            }
        }
        for i in 0..self.walkers.len() {
            if self.walkers[i].position != room.old[i] {
                self.locate(i);
            }
        }
    }

    /// Lists who is on crossings.
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
            self.crossings[place.which].people.push(Crosser {
                person: w.id,
                position: w.position,
                velocity: w.velocity,
                s: place.s,
                direction: if place.forward { 1.0 } else { -1.0 },
                intent,
            });
        }
    }
}

impl Room {
    /// Finds the pairs within reach, by sweeping over x.
    fn pair(&mut self, walkers: &[Walker]) {
        self.order.clear();
        self.order.extend(0..walkers.len());
        self.order.sort_by(|&a, &b| walkers[a].position.x.total_cmp(&walkers[b].position.x));
        self.pairs.clear();
        for (k, &i) in self.order.iter().enumerate() {
            let here = walkers[i].position;
            for &j in &self.order[k + 1..] {
                let d = walkers[j].position - here;
                if d.x > forces::REACH {
                    break;
                }
                let square = d.norm_squared();
                if square < forces::REACH * forces::REACH {
                    self.pairs.push((i, j, square.sqrt()));
                }
            }
        }
    }
}

/// `v`, no longer than this.
fn capped(v: Vec2, most: f64) -> Vec2 {
    let square = v.norm_squared();
    if square > most * most { v * (most / square.sqrt()) } else { v }
}

/// From somebody to the nearest point of a vehicle near by, and what is left between body and box; a negative gap inside it.
fn beside(w: &Walker, vehicle: &Vehicle) -> Option<(Vec2, f64)> {
    let reach = 0.5 * (vehicle.length + vehicle.width) + 2.0;
    if (vehicle.position - w.position).norm_squared() > reach * reach {
        return None;
    }
    let local = OrientedBox::new(vehicle.position, vehicle.heading, vehicle.length, vehicle.width);
    let p = local.to_local(w.position);
    let nearest = Vec2::new(
        p.x.clamp(-local.half_length, local.half_length),
        p.y.clamp(-local.half_width, local.half_width),
    );
    let d = local.center + local.axis * nearest.x + local.left() * nearest.y - w.position;
    Some((d, d.norm() - w.radius - CLEARANCE))
}
