//! Step 3: what a filter is, and what it judges.

use std::cell::OnceCell;

use super::avoidance::{AvoidanceSettings, Unavoidable, certify_case};
use super::ground::Ground;
use super::replay::{LogReplay, Touch};
use super::signals::Signals;
use super::taxonomy::Conflict;
use super::{Candidate, Certificate, Offsets, Pressure};
use crate::geometry::Polyline;
use crate::metrics::{Case, DeviationStats, Object, Options};
use crate::rollout::{AvError, LoggedDrive};
use crate::scene::{AgentState, CURRENT, DT, Frame, HISTORY, Scenario};

/// Judges candidates, one at a time.
pub trait CandidateFilter: Sync {
    /// Name in files, such as `log-distance`.
    fn id(&self) -> &'static str;

    /// What it asks for, in one sentence with its numbers.
    fn rule(&self, settings: &FilterSettings) -> String;

    /// The verdict, with the figure that decided.
    fn judge(&self, trial: &Trial<'_>) -> Verdict;

    /// Whether it costs so much that it is asked only of candidates that pass all others.
    fn is_dear(&self) -> bool {
        false
    }
}

/// What a filter says.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The figure that decided, in the filter's unit; `None` where there is nothing to measure.
    pub figure: Option<f64>,
    /// Why the candidate is rejected; `None` for one that passes.
    pub rejected: Option<String>,
}

impl Verdict {
    /// Passes where `passes`, else is rejected for `reason`.
    pub fn new(figure: Option<f64>, passes: bool, reason: impl FnOnce() -> String) -> Self {
        Self { figure, rejected: (!passes).then(reason) }
    }
}

/// Limits of the filters (defaults: 10.4 of the metrics' definition, where it gives any).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FilterSettings {
    /// Least ADE to the log, metres.
    pub min_ade: f64,
    /// How far a corner of the AV may leave the drivable ground, metres.
    pub drivable_tolerance: f64,
    /// Whether nuPlan's comfort bounds hold too.
    pub comfort: bool,
    /// Time to collision below which a vehicle is pressed, seconds.
    pub pressing_ttc: f64,
    /// Driving into a vehicle that is slower than this, and than the AV, is the AV's doing, m/s.
    pub slow: f64,
    /// Largest lateral acceleration of the AV, m/s² (nuPlan's comfort bound).
    pub max_lateral_acceleration: f64,
    /// No contact before this time, seconds.
    pub earliest_contact: f64,
    /// What agents can do to avoid the AV.
    pub avoidance: AvoidanceSettings,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self {
            min_ade: 2.0,
            drivable_tolerance: 0.3,
            comfort: false,
            pressing_ttc: 0.5,
            slow: 2.0,
            max_lateral_acceleration: 4.89,
            earliest_contact: 0.8,
            avoidance: AvoidanceSettings::default(),
        }
    }
}

/// What is known of a scenario before any candidate is judged.
pub struct Bench<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) replay: LogReplay<'a>,
    pub(super) ground: Ground<'a>,
    pub(super) signals: Signals<'a>,
    /// The logged way of the AV's centre, gone on with beyond the log's end.
    pub(super) way: Polyline,
    /// The logged AV at the steps 0 to 80.
    pub(super) log: Vec<AgentState>,
}

impl<'a> Bench<'a> {
    /// Prepares a scenario.
    ///
    /// # Errors
    /// [`AvError`] when the logged AV is absent at a step, or jumps.
    pub fn new(scenario: &'a Scenario) -> Result<Self, AvError> {
        let drive = LoggedDrive::new(scenario)?;
        let travel = drive.speeds().iter().sum::<f64>() * DT;
        let path = drive.path(scenario, None, None, 1.5 * travel + BEYOND);
        Ok(Self {
            way: path.centre_line(),
            log: drive.states().to_vec(),
            scenario,
            replay: LogReplay::new(scenario),
            ground: Ground::new(scenario),
            signals: Signals::new(scenario),
        })
    }
}

/// How far beyond the log's end the logged way is gone on with, metres, beside half of its length.
const BEYOND: f64 = 50.0;

/// One candidate with what the filters measure it by.
pub struct Trial<'a> {
    pub(super) bench: &'a Bench<'a>,
    /// The limits.
    pub settings: &'a FilterSettings,
    /// The candidate.
    pub candidate: &'a Candidate,
    /// Log replay around the candidate, as the metrics judge it.
    pub replayed: Case<'a>,
    /// The candidate alone, judged as the metrics judge a vehicle.
    pub own: Case<'a>,
    /// First contacts under log replay.
    pub(super) touches: Vec<Touch>,
    certificate: OnceCell<Result<Certificate, Unavoidable>>,
}

impl<'a> Trial<'a> {
    /// Holds a candidate against its scenario.
    pub fn new(bench: &'a Bench<'a>, candidate: &'a Candidate, settings: &'a FilterSettings) -> Self {
        let scenario = bench.scenario;
        let options = Options::default();
        let mut tracks: Vec<Vec<Frame>> =
            (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
        let states = candidate.future().iter().map(|s| Some(*s));
        tracks[0].truncate(HISTORY);
        tracks[0].extend(states);
        let av = Object { agent: &scenario.start.agents[0], track: tracks[0].clone() };
        // An AV beyond the objects is absent, and so the candidate is a vehicle like any other.
        let own = Case::new(scenario.start.road(), vec![av], usize::MAX, options);
        Self {
            bench,
            settings,
            candidate,
            replayed: Case::of_rollout(scenario, tracks, options),
            own,
            touches: bench.replay.touches(candidate.future()),
            certificate: OnceCell::new(),
        }
    }

    /// What the candidate does to others under log replay.
    pub fn pressure(&self) -> Pressure {
        let contacts = || self.replayed.contacts().iter().flatten();
        let approaches = self.replayed.approaches().iter().flatten();
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Pressure {
            at_fault: count(contacts().filter(|c| c.fault.at_fault()).count()),
            overlaps: count(contacts().count()),
            risky: count(approaches.filter(|a| a.risky.is_some()).count()),
        }
    }

    /// The smallest time to collision of a vehicle with the AV under log replay, seconds; `None` without vehicles.
    pub fn smallest_ttc(&self) -> Option<f64> {
        self.replayed.approaches().iter().flatten().map(|a| a.min_ttc).reduce(f64::min)
    }

    /// The first conflict: a vehicle touches the AV by its own fault or, if none does, touches it or is risky.
    pub fn conflict(&self) -> Option<Conflict> {
        let contacts = || self.replayed.contacts().iter().enumerate().filter_map(|(i, c)| Some((i, (*c)?)));
        let at_fault = contacts().filter(|(_, c)| c.fault.at_fault()).map(|(i, c)| (c.step, i)).min();
        let risky = || {
            let each = self.replayed.approaches().iter().enumerate();
            each.filter_map(|(i, a)| Some(((*a)?.risky?.0, i))).min()
        };
        let (step, agent) = at_fault.or_else(risky)?;
        let objects = &self.replayed.objects;
        let footprint = |i: usize| Some(objects[i].track[CURRENT + step]?.footprint(objects[i].agent));
        let touches = self.replayed.contacts()[agent].is_some_and(|c| c.step == step);
        Some(Conflict { step, touched: if touches { footprint(agent) } else { None } })
    }

    /// How far the candidate leaves the log.
    pub fn offsets(&self) -> Offsets {
        // Neither track has gaps: the bench refuses such logs, and candidates have none.
        let stats = self.replayed.deviation();
        let of =
            |value: fn(&DeviationStats) -> Option<f64>| stats.as_ref().and_then(value).unwrap_or(f64::NAN);
        Offsets {
            endpoint_longitudinal: of(|s| s.endpoint_longitudinal),
            endpoint_lateral: of(|s| s.endpoint_lateral),
            ade: of(|s| s.ade),
            mean_speed_difference: of(|s| s.mean_speed_difference),
        }
    }

    /// How everybody who is in conflict can avoid it, or why somebody can not. Found at the first call.
    ///
    /// # Errors
    /// [`Unavoidable`] names the agent.
    pub fn certificate(&self) -> &Result<Certificate, Unavoidable> {
        let find = || {
            let (scenario, candidate) = (self.bench.scenario, &self.candidate.track);
            certify_case(scenario, candidate, &self.replayed, &self.settings.avoidance)
        };
        self.certificate.get_or_init(find)
    }
}
