//! Letting people cross.

use super::super::following::time_for;
use super::super::vehicle::Vehicle;
use super::{GOING, Sight};
use crate::geometry::{direction, left};

/// How far before a crossing drivers stop, and what room they leave beside people, metres.
const BEFORE_CROSSING: f64 = 0.8;
const ROOM: f64 = 1.0;
/// People who stand within this distance of a driver's way wait at its kerb, metres.
const KERB: f64 = 9.0;
/// Drivers whose politeness is less do not stop for those who wait; the others do if this braking is enough, m/s².
const IMPOLITE: f64 = 0.15;
const AT_EASE: f64 = 1.8;
/// Time that is left between a vehicle and somebody who walks across its way, s.
const MARGIN: f64 = 1.2;

impl Sight<'_> {
    /// People on crossings of a way, or about to step there: how far ahead of the front bumper to stop, and whether they
    /// are in the way already.
    pub(super) fn people(&self, v: &Vehicle, w: usize, start: f64) -> Option<(f64, bool)> {
        let way = &self.network.ways[w];
        for &(footway, [from, to]) in &way.crossings {
            let distance = start + from - v.front() - BEFORE_CROSSING;
            if distance < -0.5 && start + to > v.front() {
                // On it already: for those who are right ahead.
                let (nose, along) = (way.line.at(v.front() - start), direction(way.line.heading_at(from)));
                let ahead = |p: &&super::Walker| {
                    let to = p.position - nose;
                    let (before, beside) = (to.dot(&along), to.perp(&along).abs());
                    (0.0..3.0).contains(&before) && beside < 0.5 * v.body.width + 0.5
                };
                if self.walkers.iter().filter(|p| p.footway == footway).any(|p| ahead(&p)) {
                    return Some((0.3, true));
                }
            }
            if distance < -0.5 || !self.walkers.iter().any(|p| p.footway == footway) {
                continue;
            }
            let arrives = time_for(distance, v.speed, GOING, way.limit);
            let leaves =
                time_for(distance + to - from + v.body.length + ROOM, v.speed.max(1.0), GOING, way.limit);
            let point = way.line.at(0.5 * (from + to));
            let side = left(direction(way.line.heading_at(from)));
            let near = 0.5 * v.body.width + ROOM;
            let mut meets = None;
            for p in self.walkers.iter().filter(|p| p.footway == footway) {
                let (at, speed) = ((p.position - point).dot(&side), p.velocity.dot(&side));
                if at.abs() < near + 0.4 {
                    return Some((distance, true));
                }
                let hinders = || {
                    if p.waits {
                        // Those who wait at the kerb are let go by drivers who are polite and not too fast to stop at ease.
                        return at.abs() < KERB
                            && v.driver.politeness > IMPOLITE
                            && v.speed * v.speed < 2.0 * AT_EASE * distance;
                    }
                    // Towards the vehicle's path: when do they reach it and leave it?
                    let towards = -speed * at.signum();
                    if towards < 0.2 {
                        return false;
                    }
                    let (enter, leave) = ((at.abs() - near) / towards, (at.abs() + near) / towards);
                    enter < leaves + MARGIN && leave > arrives - MARGIN
                };
                if hinders() {
                    meets = Some((distance, false));
                }
            }
            if meets.is_some() {
                return meets;
            }
        }
        None
    }
}
