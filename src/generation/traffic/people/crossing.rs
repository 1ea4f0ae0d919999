//! Crossing a road: what people do there, as drivers see it, and when they step off the kerb.
//!
//! Where people have priority (marked crosswalks without a light) they step off when every vehicle that comes either is past before they
//! reach its strip, or comes after they have left it by a margin, or can stop comfortably, or stands, or brakes hard enough. That a gap must
//! last for the own crossing time and a margin is the critical headway of the *Highway Capacity Manual* (2010, chapter 19: length over walking
//! speed plus 3 s of start-up and end clearance). Most observed people accept less than such design gaps (Brewer et al., *Exploration of
//! pedestrian gap-acceptance behavior at selected locations*, TRR 1982, 2006: below that of the MUTCD at all sites), and they take
//! "rolling gaps" lane by lane (same source), so here the gap counts per lane. A driver can stop comfortably from
//! `v · 1 s + v²/(2 · 2.5 m/s²)`: a reaction of 1 s and somewhat less than the deceleration that signals are timed by (3.05 m/s² and
//! 1 s, Institute of Transportation Engineers). At a light people start only if what is left is enough at their own speed (signals are
//! timed for 1.07 m/s: MUTCD 2009, 4E.06).

use crate::generation::Layout;
use crate::geometry::{Polygon, Polyline, Vec2, point_in_ring};
use crate::scene::{LaneArea, LightState};

/// Reaction of drivers whom people expect to stop, seconds.
const DRIVER_REACTION: f64 = 1.0;
/// Braking that people expect of drivers, m/s².
const COMFORTABLE: f64 = 2.5;
/// Vehicles slower than this stand, m/s.
const STANDING: f64 = 0.4;

/// A crossing, and who uses it now.
#[derive(Clone, Debug)]
pub struct Crossing {
    /// Index of the footway in the layout.
    pub footway: usize,
    /// Arc lengths along the footway's line between which it lies on the road, metres.
    pub kerbs: [f64; 2],
    /// Whether people wait for a light here.
    pub light: bool,
    /// Who is on the road or wants to be.
    pub people: Vec<Crosser>,
}

/// Somebody at a crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crosser {
    /// Who.
    pub person: u64,
    /// Where, metres.
    pub position: Vec2,
    /// How fast, m/s.
    pub velocity: Vec2,
    /// Arc length along the footway's line, metres.
    pub s: f64,
    /// +1 for those who walk along the footway's line, -1 for those who walk against it.
    pub direction: f64,
    /// What for.
    pub intent: Intent,
}

/// What somebody at a crossing is about to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intent {
    /// Walks on the road.
    OnRoad,
    /// Will step onto the road within two seconds.
    SteppingOff,
    /// Stands at the kerb of a crossing without a light, or comes to it, and would cross if drivers let them.
    Waiting,
}

/// What a light tells people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkLight {
    /// Whether they may step off now.
    pub may_go: bool,
    /// For how many seconds vehicles are still held; infinite where no light changes.
    pub seconds_left: f64,
}

impl WalkLight {
    /// People may always go.
    pub const ALWAYS: Self = Self { may_go: true, seconds_left: f64::INFINITY };

    /// What the layout's lights tell people at a footway after `time` seconds: go while every light that holds them back is red for vehicles.
    pub fn at(layout: &Layout, footway: usize, time: f64) -> Self {
        let mut told = Self::ALWAYS;
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
            // Two cycles, so that a red at the end of one goes on at the beginning of the next.
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
            told.may_go &= left.is_some();
            told.seconds_left = told.seconds_left.min(left.unwrap_or(0.0));
        }
        told
    }
}

/// A vehicle that comes to a crossing, or stands on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Index of the crossing.
    pub crossing: usize,
    /// Arc length along the footway's line at which the vehicle's way crosses it, metres.
    pub at: f64,
    /// From the front of the vehicle to the near side of the crossing, along its way, metres; negative once it is on it.
    pub distance: f64,
    /// Speed along its way, m/s.
    pub speed: f64,
    /// Acceleration along its way, m/s²; negative when it brakes.
    pub acceleration: f64,
    /// Length, metres.
    pub length: f64,
    /// Width, metres.
    pub width: f64,
}

impl Approach {
    /// Whether the driver stands, will stand before the crossing as it brakes now, or can still stop comfortably.
    pub(super) fn can_stop(&self) -> bool {
        let halt = |braking: f64| self.speed * self.speed / (2.0 * braking);
        self.distance > 0.0
            && (self.speed < STANDING
                || (self.acceleration < -0.5 && halt(-self.acceleration) < self.distance - 0.3)
                || self.speed * DRIVER_REACTION + halt(COMFORTABLE) < self.distance)
    }

    /// When the vehicle is on the crossing, which is `depth` metres wide along its way, seconds from now.
    pub(super) fn occupied(&self, depth: f64) -> (f64, f64) {
        let speed = self.speed.max(0.3);
        (self.distance / speed, (self.distance + self.length + depth) / speed)
    }

    /// Where on the crossing it will be, metres along the footway's line, with the room that people leave.
    pub(super) fn strip(&self) -> (f64, f64) {
        let half = 0.5 * self.width + 0.7;
        (self.at - half, self.at + half)
    }
}

/// Between which arc lengths a crossing lies on the road: on the lanes that it crosses, and on the drivable area.
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
