//! Step 3: the filter interface, and the data that filters judge.

use std::cell::OnceCell;

use reactsim_geometry::Polyline;
use reactsim_metrics::{Case, DeviationStats, Object, Options};
use reactsim_rollout::{AvError, LoggedDrive};
use reactsim_scene::{AgentState, DT, Frame, Scenario};

use super::avoidance::{AvoidanceSettings, Unavoidable, certify_case};
use super::ground::Ground;
use super::replay::{LogReplay, Touch};
use super::signals::Signals;
use super::taxonomy::Conflict;
use super::{Candidate, Certificate, Offsets, Pressure};

/// A filter that judges one candidate at a time.
pub struct CandidateFilter {
    /// Name used in files, such as `log-distance`.
    pub id: &'static str,
    /// Requirement in one sentence, with its numbers.
    pub rule: fn(&FilterSettings) -> String,
    /// Verdict, with the figure that decided.
    pub judge: fn(&Trial<'_>) -> Verdict,
}

/// Verdict of a filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The figure that decided, in the filter's unit; `None` if there is nothing to measure.
    pub figure: Option<f64>,
    /// Reason for the rejection; `None` for a candidate that passes.
    pub rejected: Option<String>,
}

impl Verdict {
    /// Creates a verdict: a pass if `passes`, else a rejection with `reason`.
    pub fn new(figure: Option<f64>, passes: bool, reason: impl FnOnce() -> String) -> Self {
        Self { figure, rejected: (!passes).then(reason) }
    }
}

/// Limits of the filters. Defaults are those of section 10.4 of the metrics' definition where it gives
/// any.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FilterSettings {
    /// Smallest accepted ADE to the log, metres.
    pub min_ade: f64,
    /// Largest distance by which a corner of the AV may leave the drivable area, metres.
    pub drivable_tolerance: f64,
    /// Whether nuPlan's comfort bounds are enforced too.
    pub comfort: bool,
    /// Time to collision below which a vehicle is under pressure, seconds.
    pub pressing_ttc: f64,
    /// Speed threshold, m/s: hitting a vehicle slower than this, and slower than the AV, is the AV's
    /// fault.
    pub slow: f64,
    /// Largest lateral acceleration of the AV, m/s² (nuPlan's comfort bound).
    pub max_lateral_acceleration: f64,
    /// Earliest accepted time of a contact, seconds.
    pub earliest_contact: f64,
    /// Limits of the agents' responses.
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

/// Precomputed data of a scenario, shared by the trials of its candidates.
pub struct FilterContext<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) replay: LogReplay<'a>,
    pub(super) ground: Ground<'a>,
    pub(super) signals: Signals<'a>,
    /// Logged path of the AV's centre, extended beyond the end of the log.
    pub(super) logged_path: Polyline,
    /// States of the logged AV from step 0 on.
    pub(super) log: Vec<AgentState>,
}

impl<'a> FilterContext<'a> {
    /// Prepares a scenario for the filters.
    ///
    /// # Errors
    /// [`AvError`] when the logged AV is absent at a step, or jumps.
    pub fn new(scenario: &'a Scenario) -> Result<Self, AvError> {
        let drive = LoggedDrive::new(scenario)?;
        let travel = drive.speeds().iter().sum::<f64>() * DT;
        let path = drive.path(scenario, None, None, 1.5 * travel + PATH_EXTENSION);
        Ok(Self {
            logged_path: path.centre_line(),
            log: drive.states().to_vec(),
            scenario,
            replay: LogReplay::new(scenario),
            ground: Ground::new(scenario),
            signals: Signals::new(scenario),
        })
    }
}

/// Length by which the logged path is extended beyond the end of the log, in addition to half of its own
/// length, metres.
const PATH_EXTENSION: f64 = 50.0;

/// A candidate with the data by which the filters judge it.
pub struct Trial<'a> {
    pub(super) context: &'a FilterContext<'a>,
    /// The limits.
    pub settings: &'a FilterSettings,
    /// The candidate.
    pub candidate: &'a Candidate,
    /// Log replay around the candidate, as judged by the metrics.
    pub replayed: Case<'a>,
    /// The candidate alone, judged by the metrics like any vehicle.
    pub own: Case<'a>,
    /// First contacts under log replay.
    pub(super) touches: Vec<Touch>,
    certificate: OnceCell<Result<Certificate, Unavoidable>>,
}

impl<'a> Trial<'a> {
    /// Prepares a candidate for the filters.
    pub fn new(
        context: &'a FilterContext<'a>,
        candidate: &'a Candidate,
        settings: &'a FilterSettings,
    ) -> Self {
        let scenario = context.scenario;
        let options = Options::default();
        let mut tracks: Vec<Vec<Frame>> =
            (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
        let states = candidate.future().iter().map(|s| Some(*s));
        tracks[0].truncate(scenario.length().history);
        tracks[0].extend(states);
        let av = Object { agent: &scenario.start.agents[0], track: tracks[0].clone().into() };
        // With an AV index beyond the objects the AV is absent, and the candidate is a vehicle like any
        // other.
        let own =
            Case::new(scenario.start.road(), vec![av], usize::MAX, options).with_heights(&scenario.start);
        Self {
            context,
            settings,
            candidate,
            replayed: Case::of_rollout(scenario, tracks, options),
            own,
            touches: context.replay.touches(candidate.future()),
            certificate: OnceCell::new(),
        }
    }

    /// Returns the pressure that the candidate puts on others under log replay.
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

    /// Returns the smallest time to collision of any vehicle with the AV under log replay, seconds;
    /// `None` without vehicles.
    pub fn smallest_ttc(&self) -> Option<f64> {
        self.replayed.approaches().iter().flatten().map(|a| a.min_ttc).reduce(f64::min)
    }

    /// Returns the first conflict: a vehicle touches the AV by its own fault or, failing that, touches
    /// it or is risky.
    pub fn conflict(&self) -> Option<Conflict> {
        let contacts = || self.replayed.contacts().iter().enumerate().filter_map(|(i, c)| Some((i, (*c)?)));
        let at_fault = contacts().filter(|(_, c)| c.fault.at_fault()).map(|(i, c)| (c.step, i)).min();
        let risky = || {
            let each = self.replayed.approaches().iter().enumerate();
            each.filter_map(|(i, a)| Some(((*a)?.risky?.0, i))).min()
        };
        let (step, agent) = at_fault.or_else(risky)?;
        let (objects, now) = (&self.replayed.objects, self.context.scenario.start.current());
        let footprint = |i: usize| Some(objects[i].track[now + step]?.footprint(objects[i].agent));
        let touches = self.replayed.contacts()[agent].is_some_and(|c| c.step == step);
        Some(Conflict { step, touched: if touches { footprint(agent) } else { None } })
    }

    /// Returns the distances between the candidate and the log.
    pub fn offsets(&self) -> Offsets {
        // Neither track has gaps: the context rejects such logs, and candidates have none.
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

    /// Returns responses with which every agent in conflict can avoid it, or the reason why one cannot.
    /// Computed at the first call.
    ///
    /// # Errors
    /// [`Unavoidable`] names the agent.
    pub fn certificate(&self) -> &Result<Certificate, Unavoidable> {
        let find = || {
            let (scenario, candidate) = (self.context.scenario, &self.candidate.track);
            certify_case(scenario, candidate, &self.replayed, &self.settings.avoidance)
        };
        self.certificate.get_or_init(find)
    }
}
