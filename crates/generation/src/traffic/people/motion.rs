//! One step of all pedestrians: forces, velocities, positions, and contact avoidance.

use reactsim_geometry::{OrientedBox, Vec2, direction, left};

use super::aim::Aim;
use super::walker::{Activity, Walker};
use super::{Crowd, Surroundings, Vehicle, forces};
use crate::heights::on_different_levels;

/// Time in which people reach their desired velocity, seconds (Moussaïd et al. 2009).
const RELAXATION_TIME: f64 = 0.54;
/// Maximum acceleration towards the desired velocity, m/s².
const MAX_ACCELERATION: f64 = 2.0;
/// Maximum speed as a multiple of the desired speed (Helbing & Molnár 1995).
const MAX_SPEED_FACTOR: f64 = 1.3;
/// Maximum turning rate, rad/s (chosen).
const MAX_TURN_RATE: f64 = 2.5;
/// Minimum clearance between bodies, metres.
pub(super) const BODY_CLEARANCE: f64 = 0.03;
/// Distance, metres, within which neighbours can hold each other up.
const NEAR_DISTANCE: f64 = 2.4;

/// Intermediate results of a step, kept to reuse their memory.
#[derive(Clone, Debug, Default)]
pub(super) struct StepBuffers {
    order: Vec<usize>,
    /// Height of each pedestrian, metres, if known.
    pub(super) heights: Vec<Option<f64>>,
    /// Pairs of people on one level within interaction range: indices and distance.
    pub(super) pairs: Vec<(usize, usize, f64)>,
    /// Pairs that may touch or hold each other up in this step.
    pub(super) near: Vec<(usize, usize, f64)>,
    pub(super) aims: Vec<Aim>,
    pub(super) forces: Vec<Vec2>,
    pub(super) old: Vec<Vec2>,
}

impl Crowd {
    /// Computes the social forces.
    pub(super) fn push(&self, buffers: &mut StepBuffers) {
        buffers.forces.clear();
        buffers.forces.resize(self.walkers.len(), Vec2::zeros());
        for &(i, j, _) in &buffers.pairs {
            let (a, b) = (&self.walkers[i], &self.walkers[j]);
            if a.group == b.group {
                continue;
            }
            let d = b.position - a.position;
            for (me, d, own, other) in [(i, d, a.velocity, b.velocity), (j, -d, b.velocity, a.velocity)] {
                // Standing people, and people with the other behind them, feel no force.
                if buffers.aims[me].speed > 0.0 && own.dot(&d) > -0.2 {
                    buffers.forces[me] += forces::interaction(d, own, other);
                }
            }
        }
    }

    /// Updates velocities and positions, each pedestrian on their own ground.
    pub(super) fn walk(&mut self, buffers: &StepBuffers, surroundings: &Surroundings<'_>, dt: f64) {
        for (i, w) in self.walkers.iter_mut().enumerate() {
            let aim = &buffers.aims[i];
            w.update_wander(dt);
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
            let wish = (aim.towards * aim.speed - w.velocity) / RELAXATION_TIME;
            let change = capped(wish + buffers.forces[i], MAX_ACCELERATION);
            w.velocity = capped(w.velocity + change * dt, MAX_SPEED_FACTOR * w.desired_speed);
        }
        // Nobody walks into somebody else.
        let before: Vec<Vec2> = self.walkers.iter().map(|w| w.velocity).collect();
        for &(i, j, distance) in &buffers.near {
            let d = buffers.old[j] - buffers.old[i];
            let gap = distance - self.walkers[i].radius - self.walkers[j].radius - BODY_CLEARANCE;
            self.walkers[i].velocity = forces::limited_velocity(self.walkers[i].velocity, d, gap, before[j]);
            self.walkers[j].velocity = forces::limited_velocity(self.walkers[j].velocity, -d, gap, before[i]);
        }
        for (w, aim) in self.walkers.iter_mut().zip(&buffers.aims) {
            if aim.crossing.is_some() {
                for vehicle in surroundings.vehicles {
                    if let Some((d, gap)) = beside(w, vehicle) {
                        let moving = direction(vehicle.heading) * vehicle.speed;
                        w.velocity = forces::limited_velocity(w.velocity, d, gap, moving);
                    }
                }
            }
            w.position += w.velocity * dt;
            w.update_progress(aim.speed > 0.3, dt);
        }
        self.hold(buffers);
    }

    /// Keeps everybody who has moved on footways, and waiting people off the road.
    fn hold(&mut self, buffers: &StepBuffers) {
        for i in 0..self.walkers.len() {
            if self.walkers[i].position != buffers.old[i] {
                let p = self.on_ground(&self.walkers[i]);
                self.walkers[i].position = buffers.aims[i].held_back(p, buffers.old[i]);
            }
        }
    }

    /// Pushes apart people who came too close.
    pub(super) fn part(&mut self, buffers: &StepBuffers) {
        for &(i, j, _) in &buffers.near {
            let (a, b) = (&self.walkers[i], &self.walkers[j]);
            let d = b.position - a.position;
            let short = a.radius + b.radius + BODY_CLEARANCE - d.norm();
            if short <= 0.0 || d.norm() < 1e-6 {
                continue;
            }
            let still = |k: usize| buffers.aims[k].speed <= 0.0;
            let push = d / d.norm() * short * if still(i) || still(j) { 1.0 } else { 0.5 };
            if !still(i) {
                self.walkers[i].position -= push;
            }
            if !still(j) {
                self.walkers[j].position += push;
            }
        }
        self.hold(buffers);
    }

    /// Reverts steps after which people would touch each other or a vehicle, then updates positions on the
    /// network.
    pub(super) fn settle(&mut self, buffers: &StepBuffers, surroundings: &Surroundings<'_>, dt: f64) {
        for (i, w) in self.walkers.iter_mut().enumerate() {
            if buffers.aims[i].crossing.is_none() || w.position == buffers.old[i] {
                continue;
            }
            let hit = |v: &Vehicle| beside(w, v).is_some_and(|(_, gap)| gap <= 0.0);
            if surroundings.vehicles.iter().any(hit) {
                w.position = buffers.old[i];
            }
        }
        // Every reverted step may block another person. The loop ends at the latest when nobody has moved,
        // and nobody touched anybody before.
        loop {
            let mut changed = false;
            for &(i, j, _) in &buffers.near {
                let (a, b) = (&self.walkers[i], &self.walkers[j]);
                if (b.position - a.position).norm() < a.radius + b.radius + 0.5 * BODY_CLEARANCE {
                    for k in [i, j] {
                        changed |= self.walkers[k].position != buffers.old[k];
                        self.walkers[k].position = buffers.old[k];
                    }
                }
            }
            if !changed {
                break;
            }
        }
        for (i, w) in self.walkers.iter_mut().enumerate() {
            w.velocity = (w.position - buffers.old[i]) / dt;
            let speed = w.velocity.norm();
            if speed > 0.25 {
                let ahead = w.velocity / speed;
                // People who turn round do so over the left shoulder.
                let turn = if ahead.dot(&w.facing) < -0.9 { left(w.facing) } else { ahead };
                let facing = w.facing + turn * (4.0 * dt).min(1.0);
                w.facing = turned(w.facing, facing / facing.norm(), MAX_TURN_RATE * dt);
            }
        }
        for i in 0..self.walkers.len() {
            if self.walkers[i].position != buffers.old[i] {
                self.locate(i);
            }
        }
    }
}

impl StepBuffers {
    /// Finds the pairs within reach by a sweep over x; `heights` must be up to date.
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
                if d.x > forces::INTERACTION_RANGE {
                    break;
                }
                let square = d.norm_squared();
                if square < forces::INTERACTION_RANGE * forces::INTERACTION_RANGE {
                    let distance = square.sqrt();
                    if on_different_levels(self.heights[i], self.heights[j], distance) {
                        continue;
                    }
                    self.pairs.push((i, j, distance));
                    if distance < NEAR_DISTANCE {
                        self.near.push((i, j, distance));
                    }
                }
            }
        }
    }
}

/// Returns the unit vector `to`, or `from` rotated towards it by `most` radians if `to` is farther away.
fn turned(from: Vec2, to: Vec2, most: f64) -> Vec2 {
    let limit = direction(most);
    if from.dot(&to) >= limit.x {
        return to;
    }
    from * limit.x + left(from) * if from.perp(&to) < 0.0 { -limit.y } else { limit.y }
}

/// Returns `v`, shortened to length `most` if it is longer.
fn capped(v: Vec2, most: f64) -> Vec2 {
    let square = v.norm_squared();
    if square > most * most { v * (most / square.sqrt()) } else { v }
}

/// Returns the vector from a pedestrian to the nearest point of a nearby vehicle, and the gap between body
/// and box, negative inside it.
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
    Some((d, d.norm() - w.radius - BODY_CLEARANCE))
}
