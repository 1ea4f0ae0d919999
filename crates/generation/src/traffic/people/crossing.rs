//! Crossing a road: the behaviour of people there, as drivers see it, and when they step off the kerb.
//!
//! If people have priority (marked crosswalks without a light), they step off when every approaching
//! vehicle either has passed before they reach its strip, or arrives after they have left it by a margin,
//! or can stop comfortably, or stands, or brakes hard enough. A gap must cover the own crossing time and a
//! margin: the critical headway of the *Highway Capacity Manual* (2010, chapter 19: length over walking
//! speed plus 3 s of start-up and end clearance). Most observed people accept less than such design gaps
//! (Brewer et al., *Exploration of pedestrian gap-acceptance behavior at selected locations*, TRR 1982,
//! 2006: below that of the MUTCD at all sites), and they use "rolling gaps" lane by lane (same source), so
//! here gaps are evaluated per lane. A driver can stop comfortably from `v · 1 s + v²/(2 · 2.5 m/s²)`: a
//! reaction time of 1 s and somewhat less than the deceleration of signal timing (3.05 m/s² and 1 s,
//! Institute of Transportation Engineers). At a light people start only if the remaining time suffices at
//! their own speed (signals are timed for 1.07 m/s: MUTCD 2009, 4E.06).

use reactsim_geometry::{Polygon, Polyline, Vec2, point_in_ring};
use reactsim_scene::{LaneArea, LightState};

use crate::Layout;

/// Reaction time that people expect of drivers, seconds.
const DRIVER_REACTION: f64 = 1.0;
/// Braking that people expect of drivers, m/s².
const COMFORTABLE_BRAKING: f64 = 2.5;
/// Speed, m/s, below which a vehicle is standing.
const STANDSTILL_SPEED: f64 = 0.4;

/// A crossing, and the people who use it now.
#[derive(Clone, Debug)]
pub struct Crossing {
    /// Index of the footway in the layout.
    pub footway: usize,
    /// Arc lengths along the footway's line between which it is on the road, metres.
    pub kerbs: [f64; 2],
    /// Whether people wait for a light here.
    pub light: bool,
    /// People who are on the road or want to be.
    pub people: Vec<Crosser>,
}

/// A person at a crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crosser {
    /// Position, metres.
    pub position: Vec2,
    /// Velocity, m/s.
    pub velocity: Vec2,
    /// Intention.
    pub intent: Intent,
}

/// Intention of a person at a crossing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intent {
    /// Walking on the road.
    OnRoad,
    /// Stepping onto the road within two seconds.
    SteppingOff,
    /// Standing at the kerb of a crossing without a light, or approaching it, and crossing as soon as
    /// drivers allow it.
    Waiting,
}

/// State of a pedestrian light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkLight {
    /// Whether people may step off now.
    pub may_go: bool,
    /// Seconds for which vehicles are still held; infinite if no light changes.
    pub seconds_left: f64,
}

impl WalkLight {
    /// A crossing where people may always walk.
    pub const ALWAYS: Self = Self { may_go: true, seconds_left: f64::INFINITY };

    /// Returns the state at a footway after `time` seconds: people may walk while all lights that hold them
    /// back are red for vehicles.
    pub fn at(layout: &Layout, footway: usize, time: f64) -> Self {
        let mut walk = Self::ALWAYS;
        for plan in &layout.signals {
            if !layout.footways[footway].waits_for.contains(&plan.lane) {
                continue;
            }
            let cycle: f64 = plan.phases.iter().map(|p| p.1).sum();
            let red = |s: LightState| {
                matches!(s, LightState::Stop | LightState::ArrowStop | LightState::FlashingStop)
            };
            if !(cycle > 0.0) || plan.phases.iter().all(|p| red(p.0)) {
                continue;
            }
            // Two cycles, so that a red at the end of one continues at the beginning of the next.
            let (now, mut end, mut left) = (time.rem_euclid(cycle), 0.0, None);
            for &(state, seconds) in plan.phases.iter().chain(&plan.phases) {
                end += seconds;
                if end > now {
                    if !red(state) {
                        break;
                    }
                    left = Some(end - now);
                }
            }
            walk.may_go &= left.is_some();
            walk.seconds_left = walk.seconds_left.min(left.unwrap_or(0.0));
        }
        walk
    }
}

/// A vehicle that approaches a crossing or stands on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Index of the crossing.
    pub crossing: usize,
    /// Arc length along the footway's line at which the vehicle's path crosses it, metres.
    pub at: f64,
    /// Distance along the path from the front of the vehicle to the near side of the crossing, metres;
    /// negative once it is on the crossing.
    pub distance: f64,
    /// Speed along the path, m/s.
    pub speed: f64,
    /// Acceleration along the path, m/s²; negative when braking.
    pub acceleration: f64,
    /// Length, metres.
    pub length: f64,
    /// Width, metres.
    pub width: f64,
}

impl Approach {
    /// Whether the vehicle stands, will stop before the crossing with its current braking, or can still
    /// stop comfortably.
    pub(super) fn can_stop(&self) -> bool {
        let halt = |braking: f64| self.speed * self.speed / (2.0 * braking);
        self.distance > 0.0
            && (self.speed < STANDSTILL_SPEED
                || (self.acceleration < -0.5 && halt(-self.acceleration) < self.distance - 0.3)
                || self.speed * DRIVER_REACTION + halt(COMFORTABLE_BRAKING) < self.distance)
    }

    /// Returns the times, seconds from now, between which the vehicle is on the crossing, which is `depth`
    /// metres wide along its path.
    pub(super) fn occupied(&self, depth: f64) -> (f64, f64) {
        let speed = self.speed.max(0.3);
        (self.distance / speed, (self.distance + self.length + depth) / speed)
    }

    /// Returns the strip of the crossing that the vehicle will occupy, metres along the footway's line,
    /// including the clearance that people leave.
    pub(super) fn strip(&self) -> (f64, f64) {
        let half = 0.5 * self.width + 0.7;
        (self.at - half, self.at + half)
    }
}

/// Returns the arc lengths between which a crossing is on the road: on the crossed lanes or on the drivable
/// area.
pub(super) fn kerbs(layout: &Layout, footway: usize) -> [f64; 2] {
    let (line, crosses) = (&layout.footways[footway].line, &layout.footways[footway].crosses);
    let lanes: Vec<_> = layout.map.lanes.iter().filter(|l| crosses.contains(&l.id)).collect();
    let baselines: Vec<Option<Polyline>> = lanes.iter().map(|l| Polyline::new(&l.points).ok()).collect();
    let grounds: Vec<&Polygon> = layout.map.drivable_area.iter().flatten().collect();
    let on_road = |p: Vec2| {
        grounds.iter().any(|g| g.bounds().contains(p) && g.contains(p))
            || lanes.iter().zip(&baselines).any(|(lane, baseline)| match &lane.area {
                LaneArea::Polygon(ring) => point_in_ring(p, ring) == Some(true),
                LaneArea::Corridor { half_width } => {
                    baseline.as_ref().is_some_and(|b| b.project(p).distance < *half_width)
                }
            })
    };
    let steps = (line.length() / 0.1) as usize;
    let mut on = (0..=steps).map(|k| k as f64 * 0.1).filter(|&s| on_road(line.at(s)));
    let Some(first) = on.next() else { return [0.0, line.length()] };
    [first, on.next_back().unwrap_or(first).max(first)]
}
