//! One step of everybody: forces, velocities, positions, and that nobody touches anybody.

use super::aim::Aim;
use super::walker::{Activity, Walker};
use super::{Crowd, Surroundings, Vehicle, forces};
use crate::geometry::{OrientedBox, Vec2, direction, left};

/// Time in which people reach the velocity that they want, seconds (Moussaïd et al. 2009).
const RELAXATION: f64 = 0.54;
/// Largest acceleration by which people follow what they want, m/s².
const AGILITY: f64 = 2.0;
/// Nobody goes faster than this multiple of the desired speed (Helbing & Molnár 1995).
const MOST: f64 = 1.3;
/// Nobody turns faster than this, rad/s (chosen).
const TURN: f64 = 2.5;
/// Bodies keep at least this distance, metres.
pub(super) const CLEARANCE: f64 = 0.03;
/// Neighbours nearer than this hold one another up, metres.
const NEAR: f64 = 2.4;

/// What is worked out at every step, kept for its memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Room {
    order: Vec<usize>,
    /// Pairs of people within reach of each other: indices, and the distance.
    pub(super) pairs: Vec<(usize, usize, f64)>,
    /// Those of them who may touch in this step or hold each other up.
    pub(super) near: Vec<(usize, usize, f64)>,
    pub(super) aims: Vec<Aim>,
    pub(super) forces: Vec<Vec2>,
    pub(super) old: Vec<Vec2>,
}

impl Crowd {
    /// Social forces.
    pub(super) fn push(&self, room: &mut Room) {
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
    pub(super) fn walk(&mut self, room: &Room, surroundings: &Surroundings<'_>, dt: f64) {
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
        for &(i, j, distance) in &room.near {
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
            w.gets_on(aim.speed > 0.3, dt);
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
    pub(super) fn part(&mut self, room: &Room) {
        for &(i, j, _) in &room.near {
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
    pub(super) fn settle(&mut self, room: &Room, surroundings: &Surroundings<'_>, dt: f64) {
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
            for &(i, j, _) in &room.near {
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
                w.facing = turned(w.facing, facing / facing.norm(), TURN * dt);
            }
        }
        for i in 0..self.walkers.len() {
            if self.walkers[i].position != room.old[i] {
                self.locate(i);
            }
        }
    }
}

impl Room {
    /// Finds the pairs within reach, by sweeping over x.
    pub(super) fn pair(&mut self, walkers: &[Walker]) {
        self.order.clear();
        self.order.extend(0..walkers.len());
        self.order.sort_by(|&a, &b| walkers[a].position.x.total_cmp(&walkers[b].position.x));
        self.pairs.clear();
        self.near.clear();
        for (k, &i) in self.order.iter().enumerate() {
            let here = walkers[i].position;
            for &j in &self.order[k + 1..] {
                let d = walkers[j].position - here;
                if d.x > forces::REACH {
                    break;
                }
                let square = d.norm_squared();
                if square < forces::REACH * forces::REACH {
                    let distance = square.sqrt();
                    self.pairs.push((i, j, distance));
                    if distance < NEAR {
                        self.near.push((i, j, distance));
                    }
                }
            }
        }
    }
}

/// The unit vector `to`, or as far towards it from the unit vector `from` as so many radians lead.
fn turned(from: Vec2, to: Vec2, most: f64) -> Vec2 {
    let limit = direction(most);
    if from.dot(&to) >= limit.x {
        return to;
    }
    from * limit.x + left(from) * if from.perp(&to) < 0.0 { -limit.y } else { limit.y }
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
