//! Collisions of vehicles with the AV, and their fault (ReactSim-Bench, "Metric Computation Details").

use reactsim_geometry::signed_angle_between;
use reactsim_scene::named_enum;

use super::boxes::av_overlaps;
use super::options::FaultOrder;
use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Speed in m/s up to which an agent or the AV is stopped (nuPlan's stopped-speed threshold; the comparison
/// is `<=`).
pub const STOPPED_SPEED: f64 = 0.05;
/// Angle between an agent's heading and the direction to the AV, in degrees, above which the AV is behind the
/// agent.
pub const BEHIND_DEGREES: f64 = 150.0;

named_enum! {
    name;

    /// The circumstances of a collision, which decide whether the agent is at fault.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Fault {
        /// The agent is stopped: not its fault.
        AgentStopped = "agent_stopped",
        /// The AV is behind the agent: not the agent's fault.
        AvBehind = "av_behind",
        /// The AV is stopped: the agent's fault.
        AvStopped = "av_stopped",
        /// The agent's front bumper intersects the AV: the agent's fault.
        FrontBumper = "front_bumper",
        /// The agent is off the road: its fault.
        AgentOffroad = "agent_offroad",
        /// Any other contact: not the agent's fault.
        Lateral = "lateral",
    }
}

impl Fault {
    /// Returns whether the agent is at fault.
    pub const fn at_fault(self) -> bool {
        matches!(self, Self::AvStopped | Self::FrontBumper | Self::AgentOffroad)
    }
}

/// The first contact of a vehicle with the AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Step, from 1.
    pub step: usize,
    /// Last step of the same overlap.
    pub last_step: usize,
    /// Circumstances, which decide whether the contact counts.
    pub fault: Fault,
}

impl Judgement for Vec<Option<Contact>> {
    fn compute(case: &Case<'_>) -> Self {
        let overlaps = av_overlaps(case);
        case.of_vehicles(|i| first_contact(case, i, overlaps))
    }
}

impl Case<'_> {
    /// Returns the first contact of every object with the AV; `None` for objects without a contact or that
    /// are not evaluated vehicles.
    pub fn contacts(&self) -> &[Option<Contact>] {
        self.judgement::<Vec<Option<Contact>>>()
    }
}

/// Returns the distance of a vehicle from its logged position at the step of a contact, metres; `None`
/// without a log or if the logged state is absent.
pub(super) fn log_distance(case: &Case<'_>, agent: usize, contact: &Contact) -> Option<f64> {
    let frame = case.current + contact.step;
    let logged = case.log.as_ref()?[agent].at(frame)?;
    let distance = (case.motion.position(agent, frame) - logged.position()).norm();
    distance.is_finite().then_some(distance)
}

fn first_contact(case: &Case<'_>, agent: usize, overlaps: &[bool]) -> Option<Contact> {
    let hits = &overlaps[case.motion.at(agent, 0)..][..case.frames()];
    let first = case.future().find(|&f| hits[f])?;
    let last = (first..case.frames()).take_while(|&f| hits[f]).last().unwrap_or(first);
    Some(Contact {
        step: first - case.current,
        last_step: last - case.current,
        fault: fault_at(case, agent, first),
    })
}

fn fault_at(case: &Case<'_>, agent: usize, frame: usize) -> Fault {
    let motion = &case.motion;
    let (me, av) = (motion.at(agent, frame), motion.at(case.av, frame));
    let p = motion.position(agent, frame);
    // Unknown speeds are NaN and therefore never "stopped".
    if motion.speed[me] <= STOPPED_SPEED {
        return Fault::AgentStopped;
    }
    let to_av = motion.position(case.av, frame) - p;
    let behind = signed_angle_between(motion.axis[me], to_av).abs() > BEHIND_DEGREES.to_radians();
    let av_stopped = motion.speed[av] <= STOPPED_SPEED;
    match case.options.fault_order {
        FaultOrder::Paper if behind => return Fault::AvBehind,
        _ if av_stopped => return Fault::AvStopped,
        FaultOrder::Nuplan if behind => return Fault::AvBehind,
        _ => {}
    }
    let [front_left, front_right, ..] = motion.footprint(agent, frame).corners();
    if motion.footprint(case.av, frame).intersects_segment(front_left, front_right) {
        return Fault::FrontBumper;
    }
    let drivable = case.road_under(agent, frame).drivable(p, &mut None);
    if drivable == Some(false) { Fault::AgentOffroad } else { Fault::Lateral }
}

/// Number of vehicles that collide with the AV and are at fault.
pub(super) const AT_FAULT: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "aav-collision",
        title: "A-AV Coll.",
        unit: Unit::Count,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: agent-AV collision count",
    },
    has_events: true,
    score: at_fault,
};

fn at_fault(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let mut count = 0;
    for (i, contact) in case.contacts().iter().enumerate() {
        let Some(contact) = contact else { continue };
        count += u64::from(contact.fault.at_fault());
        let k = case.motion.at(i, case.current + contact.step);
        let av = case.motion.at(case.av, case.current + contact.step);
        let mut values = vec![("speed", case.motion.speed[k]), ("av_speed", case.motion.speed[av])];
        values.extend(log_distance(case, i, contact).map(|d| ("log_distance", d)));
        events.push(Event {
            partner: Some(case.id(case.av)),
            reason: Some(contact.fault.name()),
            counted: contact.fault.at_fault(),
            values,
            ..Event::of(case, i, contact.step, contact.last_step)
        });
    }
    Some(Score::Count(count))
}

/// Number of vehicles that overlap the AV, regardless of fault.
pub(super) const ANY_OVERLAP: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "aav-overlap",
        title: "A-AV Overlap",
        unit: Unit::Count,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "beside A-AV Coll.: the same first contacts, without the test of fault",
    },
    has_events: false,
    score: |case, _| Some(Score::Count(case.contacts().iter().flatten().count() as u64)),
};
