//! From a scenario to its histograms.

use super::motion::{self, Motion, NOW, SAMPLES};
use super::{Histogram, Quantity, lane_changes, lanes, leader};
use crate::scene::{AgentKind, CURRENT, LaneHit, Road, Scenario};

use Quantity as Q;

/// A vehicle faster than this moves, m/s.
const MOVING: f64 = 0.5;
/// Yaw rates are told above this speed, and lateral accelerations, m/s: the headings of slow vehicles are not steady.
const STEERS: f64 = 1.0;
/// Curvatures, time gaps and offsets are told above this speed, m/s.
const DRIVES: f64 = 2.0;
/// A vehicle that stays within this never moves, metres ...
const STAYS: f64 = 1.0;
/// ... if it was seen in so many frames.
const SEEN: usize = 30;
/// A vehicle that drives this far can turn, metres, and turns by more than this, radians (30°).
const TURN: (f64, f64) = (5.0, std::f64::consts::FRAC_PI_6);
/// Who is this close to the AV is near, metres.
const NEAR: f64 = 50.0;
/// Times to collision beyond this do not matter, seconds.
const NO_RISK: f64 = 10.0;
/// Who stands farther behind another does not wait behind it, metres.
const QUEUE: f64 = 20.0;
/// Lane changes are told where vehicles drove so far together, metres.
const DRIVEN: f64 = 200.0;
/// Nobody ahead for this long is a free road, seconds; a yaw rate below this is straight on, rad/s.
const FREE: (f64, f64) = (4.0, 0.05);

/// The histograms of a set of scenarios.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    /// Scenarios.
    pub scenarios: u64,
    histograms: Vec<Histogram>,
}

impl Default for Tally {
    fn default() -> Self {
        Self { scenarios: 0, histograms: Q::ALL.into_iter().map(|q| Histogram::new(q.spec().bins)).collect() }
    }
}

impl Tally {
    /// The histogram of a quantity.
    pub fn of(&self, quantity: Quantity) -> &Histogram {
        &self.histograms[quantity.index()]
    }

    /// Adds another set. Sums are floating-point: sets that are added in the same order have the same bits.
    pub fn merge(&mut self, other: &Self) {
        self.scenarios += other.scenarios;
        self.histograms.iter_mut().zip(&other.histograms).for_each(|(a, b)| a.merge(b));
    }

    fn add(&mut self, quantity: Quantity, value: f64) {
        self.histograms[quantity.index()].add(value);
    }
}

/// Measures one scenario: its log, all of it.
pub fn measure(scenario: &Scenario) -> Tally {
    let mut tally = Tally { scenarios: 1, ..Tally::default() };
    let agents = &scenario.start.agents;
    let motions: Vec<_> = (0..agents.len()).map(|i| motion::motions(scenario, i)).collect();
    let mut sheet = Sheet {
        scenario,
        road: scenario.start.road(),
        motions: &motions,
        hits: Vec::new(),
        tally: &mut tally,
    };
    for (i, agent) in agents.iter().enumerate() {
        match agent.kind {
            AgentKind::Vehicle => {
                sheet.movement(i);
                sheet.following(i);
                if i > 0 {
                    sheet.tally.add(Q::VehicleLength, agent.length);
                    sheet.tally.add(Q::VehicleWidth, agent.width);
                }
            }
            AgentKind::Pedestrian => sheet.pace(i, Q::PedestrianSpeed),
            AgentKind::Cyclist => sheet.pace(i, Q::CyclistSpeed),
            AgentKind::Other => {}
        }
    }
    sheet.shares();
    sheet.surroundings();
    tally
}

/// A scenario in the course of being measured.
struct Sheet<'a> {
    scenario: &'a Scenario,
    road: Road<'a>,
    motions: &'a [[Option<Motion>; SAMPLES]],
    hits: Vec<LaneHit>,
    tally: &'a mut Tally,
}

impl Sheet<'_> {
    /// How a vehicle moves by itself.
    fn movement(&mut self, agent: usize) {
        let motions = &self.motions[agent];
        for (sample, motion) in motions.iter().enumerate() {
            let Some(m) = motion.filter(|m| m.speed.abs() > MOVING) else { continue };
            self.tally.add(Q::Speed, m.speed.abs());
            self.tally.add(Q::Acceleration, m.acceleration);
            if let (Some(before), Some(after)) =
                (sample.checked_sub(1).and_then(|s| motions[s]), motions.get(sample + 1).copied().flatten())
            {
                // Two fits that follow each other share no frame but the middle one.
                self.tally.add(Q::Jerk, after.acceleration - before.acceleration);
            }
            if m.speed > STEERS {
                self.tally.add(Q::YawRate, m.yaw_rate);
                self.tally.add(Q::LateralAcceleration, m.yaw_rate * m.speed);
            }
            if m.speed > DRIVES {
                self.tally.add(Q::Curvature, m.yaw_rate / m.speed);
                let state = self.scenario.logged_at(agent, motion::frame_of(sample));
                let offset = state.and_then(|s| lanes::clear_offset(&self.road, &s, &mut self.hits));
                self.tally.add(Q::LaneOffset, offset.unwrap_or(f64::NAN));
            }
        }
    }

    /// How a vehicle follows others.
    fn following(&mut self, agent: usize) {
        let mut least_ttc = None;
        for (sample, m) in self.motions[agent].iter().enumerate().filter_map(|(k, m)| Some((k, (*m)?))) {
            let frame = motion::frame_of(sample);
            let moves = m.speed > MOVING;
            if !(moves || sample == NOW && m.speed.abs() <= MOVING) {
                continue;
            }
            let leader = leader::leader(self.scenario, &self.road, agent, frame, &mut self.hits);
            let led = leader.and_then(|l| Some((l.gap, self.motions[l.agent][sample]?)));
            if !moves {
                let queue = led.filter(|(gap, ahead)| ahead.speed.abs() <= MOVING && *gap < QUEUE);
                self.tally.add(Q::StandstillGap, queue.map_or(f64::NAN, |l| l.0));
                continue;
            }
            if let Some((gap, ahead)) = led {
                self.tally.add(Q::Headway, gap);
                let closing = m.speed - ahead.speed;
                let ttc = if closing > 0.0 { (gap / closing).min(NO_RISK) } else { NO_RISK };
                least_ttc = Some(f64::min(ttc, least_ttc.unwrap_or(NO_RISK)));
            }
            if m.speed > DRIVES {
                if let Some((gap, _)) = led {
                    self.tally.add(Q::TimeGap, gap / m.speed);
                }
                let free = leader.is_none_or(|l| l.gap > FREE.0 * m.speed) && m.yaw_rate.abs() < FREE.1;
                if free {
                    let state = self.scenario.logged_at(agent, frame);
                    let lane = state.and_then(|s| lanes::lane_of(&self.road, &s, &mut self.hits));
                    let limit = lane.and_then(|h| self.road.lane(h.lane).speed_limit);
                    self.tally.add(Q::FreeSpeed, limit.map_or(f64::NAN, |l| m.speed / l));
                }
            }
        }
        self.tally.add(Q::MinTtc, least_ttc.unwrap_or(f64::NAN));
    }

    /// How fast a person goes.
    fn pace(&mut self, agent: usize, quantity: Quantity) {
        for motion in self.motions[agent].iter().flatten() {
            self.tally.add(quantity, motion.pace);
        }
    }

    /// Shares of the vehicles that do something.
    fn shares(&mut self) {
        let (mut stopped, mut parked, mut never, mut turning) =
            (Share::default(), Share::default(), Share::default(), Share::default());
        let mut driven = lane_changes::InLanes::default();
        for (i, agent) in self.scenario.start.agents.iter().enumerate() {
            if agent.kind != AgentKind::Vehicle {
                continue;
            }
            if let Some(now) = self.motions[i][NOW] {
                stopped.count(now.speed.abs() <= MOVING);
            }
            let (extent, seen) = motion::extent(self.scenario, i);
            if seen >= SEEN || extent >= STAYS {
                never.count(extent < STAYS);
                let state = self.scenario.start.now(i);
                let in_lane = lanes::lane_of(&self.road, &state, &mut self.hits)
                    .is_some_and(|h| h.projection.distance < lanes::BESIDE / 2.0);
                parked.count(extent < STAYS && !in_lane);
            }
            if extent < STAYS {
                continue;
            }
            if let Some(turn) = motion::turn(self.scenario, i).filter(|_| extent >= TURN.0) {
                turning.count(turn > TURN.1);
            }
            let own = lane_changes::in_lanes(self.scenario, &self.road, i, &mut self.hits);
            driven.changes += own.changes;
            driven.metres += own.metres;
        }
        self.tally.add(Q::Stopped, stopped.value());
        self.tally.add(Q::Parked, parked.value());
        self.tally.add(Q::NeverMoving, never.value());
        self.tally.add(Q::Turning, turning.value());
        if driven.metres >= DRIVEN {
            self.tally.add(Q::LaneChanges, 1000.0 * f64::from(driven.changes) / driven.metres);
        }
    }

    /// What is around the AV, and how it goes itself.
    fn surroundings(&mut self) {
        let start = &self.scenario.start;
        let av = start.now(0).position();
        let near = |kind: Option<AgentKind>| {
            let others = (1..start.agents.len()).filter(|&i| kind.is_none_or(|k| start.agents[i].kind == k));
            others.filter(|&i| (start.now(i).position() - av).norm() <= NEAR).count() as f64
        };
        self.tally.add(Q::AgentsNear, near(None));
        self.tally.add(Q::VehiclesNear, near(Some(AgentKind::Vehicle)));
        self.tally.add(Q::PedestriansNear, near(Some(AgentKind::Pedestrian)));
        self.tally.add(Q::CyclistsNear, near(Some(AgentKind::Cyclist)));
        self.tally.add(Q::Agents, start.agents.len() as f64 - 1.0);
        self.tally.add(Q::AvDistance, motion::way(self.scenario, 0, CURRENT));
        self.tally.add(Q::AvSpeed, self.motions[0][NOW].map_or(f64::NAN, |m| m.speed.abs()));
    }
}

/// How many of those asked.
#[derive(Default)]
struct Share {
    yes: u32,
    all: u32,
}

impl Share {
    fn count(&mut self, yes: bool) {
        self.yes += u32::from(yes);
        self.all += 1;
    }

    /// NaN, which no histogram counts, where nobody was asked.
    fn value(&self) -> f64 {
        f64::from(self.yes) / f64::from(self.all)
    }
}
