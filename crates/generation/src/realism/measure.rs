//! Measurement of one scenario: from its log to histograms.

use Quantity as Q;
use reactsim_scene::{AgentKind, CURRENT, LaneHit, Road, Scenario};

use super::motion::{self, CURRENT_SAMPLE, Motion, SAMPLES};
use super::{Histogram, Quantity, lane_changes, lanes, leader};

/// Speed, m/s, above which a vehicle is moving.
const MOVING_SPEED: f64 = 0.5;
/// Speed, m/s, above which yaw rates and lateral accelerations are measured: headings of slow vehicles are
/// unsteady.
const YAW_RATE_SPEED: f64 = 1.0;
/// Speed, m/s, above which curvatures, time gaps and lane offsets are measured.
const CURVATURE_SPEED: f64 = 2.0;
/// Displacement, metres, below which a vehicle counts as never moving.
const STATIONARY_EXTENT: f64 = 1.0;
/// Minimum number of frames in which a vehicle must be present to count as never moving.
const MIN_FRAMES: usize = 30;
/// Minimum displacement of a vehicle that can turn, metres.
const MIN_TURN_EXTENT: f64 = 5.0;
/// Heading change above which a vehicle turns, radians (30°).
const TURN_ANGLE: f64 = std::f64::consts::FRAC_PI_6;
/// Distance from the AV, metres, within which agents are near it.
const NEAR_DISTANCE: f64 = 50.0;
/// Upper bound of times to collision, seconds: larger ones do not matter.
const MAX_TTC: f64 = 10.0;
/// Maximum gap, metres, between standing vehicles of the same queue.
const MAX_QUEUE_GAP: f64 = 20.0;
/// Minimum distance, metres, driven by all vehicles together, from which on lane changes are measured.
const MIN_DRIVEN: f64 = 200.0;
/// Time gap to the leader, seconds, above which the road is free.
const FREE_TIME_GAP: f64 = 4.0;
/// Yaw rate, rad/s, below which a vehicle drives straight on.
const STRAIGHT_YAW_RATE: f64 = 0.05;

/// Histograms of a set of scenarios.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    /// Number of scenarios.
    pub scenarios: u64,
    histograms: Vec<Histogram>,
}

impl Default for Tally {
    fn default() -> Self {
        Self { scenarios: 0, histograms: Q::ALL.into_iter().map(|q| Histogram::new(q.spec().bins)).collect() }
    }
}

impl Tally {
    /// Returns the histogram of a quantity.
    pub fn of(&self, quantity: Quantity) -> &Histogram {
        &self.histograms[quantity.index()]
    }

    /// Adds another set. Sums are floating-point: only the same order of additions gives the same bits.
    pub fn merge(&mut self, other: &Self) {
        self.scenarios += other.scenarios;
        self.histograms.iter_mut().zip(&other.histograms).for_each(|(a, b)| a.merge(b));
    }

    fn add(&mut self, quantity: Quantity, value: f64) {
        self.histograms[quantity.index()].add(value);
    }
}

/// Measures one scenario over its whole log.
pub fn measure(scenario: &Scenario) -> Tally {
    let mut tally = Tally { scenarios: 1, ..Tally::default() };
    let agents = &scenario.start.agents;
    let motions: Vec<_> = (0..agents.len()).map(|i| motion::motions(scenario, i)).collect();
    let mut measurement = Measurement {
        scenario,
        road: scenario.start.road(),
        motions: &motions,
        hits: Vec::new(),
        tally: &mut tally,
    };
    for (i, agent) in agents.iter().enumerate() {
        match agent.kind {
            AgentKind::Vehicle => {
                measurement.movement(i);
                measurement.following(i);
                if i > 0 {
                    measurement.tally.add(Q::VehicleLength, agent.length);
                    measurement.tally.add(Q::VehicleWidth, agent.width);
                }
            }
            AgentKind::Pedestrian => measurement.pace(i, Q::PedestrianSpeed),
            AgentKind::Cyclist => measurement.pace(i, Q::CyclistSpeed),
            AgentKind::Other => {}
        }
    }
    measurement.shares();
    measurement.surroundings();
    tally
}

/// A scenario while it is being measured.
struct Measurement<'a> {
    scenario: &'a Scenario,
    road: Road<'a>,
    motions: &'a [[Option<Motion>; SAMPLES]],
    hits: Vec<LaneHit>,
    tally: &'a mut Tally,
}

impl Measurement<'_> {
    /// Measures the motion of a vehicle by itself.
    fn movement(&mut self, agent: usize) {
        let motions = &self.motions[agent];
        for (sample, motion) in motions.iter().enumerate() {
            let Some(m) = motion.filter(|m| m.speed.abs() > MOVING_SPEED) else { continue };
            self.tally.add(Q::Speed, m.speed.abs());
            self.tally.add(Q::Acceleration, m.acceleration);
            if let (Some(before), Some(after)) =
                (sample.checked_sub(1).and_then(|s| motions[s]), motions.get(sample + 1).copied().flatten())
            {
                // Two consecutive fits share only their middle frame.
                self.tally.add(Q::Jerk, after.acceleration - before.acceleration);
            }
            if m.speed > YAW_RATE_SPEED {
                self.tally.add(Q::YawRate, m.yaw_rate);
                self.tally.add(Q::LateralAcceleration, m.yaw_rate * m.speed);
            }
            if m.speed > CURVATURE_SPEED {
                self.tally.add(Q::Curvature, m.yaw_rate / m.speed);
                let state = self.scenario.logged_at(agent, motion::frame_of(sample));
                let offset = state.and_then(|s| lanes::clear_offset(&self.road, &s, &mut self.hits));
                self.tally.add(Q::LaneOffset, offset.unwrap_or(f64::NAN));
            }
        }
    }

    /// Measures how a vehicle follows others.
    fn following(&mut self, agent: usize) {
        let mut least_ttc = None;
        for (sample, m) in self.motions[agent].iter().enumerate().filter_map(|(k, m)| Some((k, (*m)?))) {
            let frame = motion::frame_of(sample);
            let moves = m.speed > MOVING_SPEED;
            if !(moves || sample == CURRENT_SAMPLE && m.speed.abs() <= MOVING_SPEED) {
                continue;
            }
            let leader = leader::leader(self.scenario, &self.road, agent, frame, &mut self.hits);
            let led = leader.and_then(|l| Some((l.gap, self.motions[l.agent][sample]?)));
            if !moves {
                let queue =
                    led.filter(|(gap, ahead)| ahead.speed.abs() <= MOVING_SPEED && *gap < MAX_QUEUE_GAP);
                self.tally.add(Q::StandstillGap, queue.map_or(f64::NAN, |l| l.0));
                continue;
            }
            if let Some((gap, ahead)) = led {
                self.tally.add(Q::Headway, gap);
                let closing = m.speed - ahead.speed;
                let ttc = if closing > 0.0 { (gap / closing).min(MAX_TTC) } else { MAX_TTC };
                least_ttc = Some(f64::min(ttc, least_ttc.unwrap_or(MAX_TTC)));
            }
            if m.speed > CURVATURE_SPEED {
                if let Some((gap, _)) = led {
                    self.tally.add(Q::TimeGap, gap / m.speed);
                }
                let free = leader.is_none_or(|l| l.gap > FREE_TIME_GAP * m.speed)
                    && m.yaw_rate.abs() < STRAIGHT_YAW_RATE;
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

    /// Measures the speed of a pedestrian or cyclist.
    fn pace(&mut self, agent: usize, quantity: Quantity) {
        for motion in self.motions[agent].iter().flatten() {
            self.tally.add(quantity, motion.pace);
        }
    }

    /// Measures the shares of vehicles that are stopped, parked, never moving or turning, and lane changes.
    fn shares(&mut self) {
        let (mut stopped, mut parked, mut never, mut turning) =
            (Share::default(), Share::default(), Share::default(), Share::default());
        let mut driven = lane_changes::LaneUse::default();
        for (i, agent) in self.scenario.start.agents.iter().enumerate() {
            if agent.kind != AgentKind::Vehicle {
                continue;
            }
            if let Some(now) = self.motions[i][CURRENT_SAMPLE] {
                stopped.count(now.speed.abs() <= MOVING_SPEED);
            }
            let (extent, seen) = motion::extent(self.scenario, i);
            if seen >= MIN_FRAMES || extent >= STATIONARY_EXTENT {
                never.count(extent < STATIONARY_EXTENT);
                let state = self.scenario.start.now(i);
                let in_lane = lanes::lane_of(&self.road, &state, &mut self.hits)
                    .is_some_and(|h| h.projection.distance < lanes::MIN_ADJACENT_SPACING / 2.0);
                parked.count(extent < STATIONARY_EXTENT && !in_lane);
            }
            if extent < STATIONARY_EXTENT {
                continue;
            }
            if let Some(turn) = motion::turn(self.scenario, i).filter(|_| extent >= MIN_TURN_EXTENT) {
                turning.count(turn > TURN_ANGLE);
            }
            let own = lane_changes::lane_use(self.scenario, &self.road, i, &mut self.hits);
            driven.changes += own.changes;
            driven.metres += own.metres;
        }
        self.tally.add(Q::Stopped, stopped.value());
        self.tally.add(Q::Parked, parked.value());
        self.tally.add(Q::NeverMoving, never.value());
        self.tally.add(Q::Turning, turning.value());
        if driven.metres >= MIN_DRIVEN {
            self.tally.add(Q::LaneChanges, 1000.0 * f64::from(driven.changes) / driven.metres);
        }
    }

    /// Measures the surroundings of the AV, and its own motion.
    fn surroundings(&mut self) {
        let start = &self.scenario.start;
        let av = start.now(0).position();
        let near = |kind: Option<AgentKind>| {
            let others = (1..start.agents.len()).filter(|&i| kind.is_none_or(|k| start.agents[i].kind == k));
            others.filter(|&i| (start.now(i).position() - av).norm() <= NEAR_DISTANCE).count() as f64
        };
        self.tally.add(Q::AgentsNear, near(None));
        self.tally.add(Q::VehiclesNear, near(Some(AgentKind::Vehicle)));
        self.tally.add(Q::PedestriansNear, near(Some(AgentKind::Pedestrian)));
        self.tally.add(Q::CyclistsNear, near(Some(AgentKind::Cyclist)));
        self.tally.add(Q::Agents, start.agents.len() as f64 - 1.0);
        self.tally.add(Q::AvDistance, motion::path_length(self.scenario, 0, CURRENT));
        self.tally.add(Q::AvSpeed, self.motions[0][CURRENT_SAMPLE].map_or(f64::NAN, |m| m.speed.abs()));
    }
}

/// Number of positives among all tested.
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

    /// Returns the share; NaN, which no histogram counts, if nothing was tested.
    fn value(&self) -> f64 {
        f64::from(self.yes) / f64::from(self.all)
    }
}
