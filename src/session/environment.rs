//! Rollouts whose AV a program moves, one action at a time.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;

use super::action::{ActionKind, Mover};
use super::arrays::{Arrays, Kept, SceneArrays, Sizes};
use super::traffic::{Traffic, is_broken_off, reason};
use super::wire::{RequestError, missing, refused};
use crate::evaluation::{DeviationLabels, Row, judge_in_memory};
use crate::metrics::{Event, Options};
use crate::planning::from_scene::{ObjectIds, ego_shape, ego_state_now, ego_states_until_now, planning_map};
use crate::planning::metrics::{Reach, SampleJudge};
use crate::planning::{EgoShape, PlanningMap};
use crate::rollout::{AvError, AvPolicy, Entering, Lockstep, Observation, Rollout, RolloutBeginning};
use crate::scene::{AgentState, FUTURE, Frame, Scenario};

/// Slot of the AV among the agents.
const AV: usize = 0;

/// Names of the measures of a step.
pub const MEASURES: [&str; 7] =
    ["progress", "contact", "at_fault_contact", "ttc", "off_road", "uncomfortable", "speed"];

/// A condition that ends an episode before its last step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndCondition {
    /// The AV touches an object for the first time.
    Contact,
    /// The same, if it is the fault of the AV.
    AtFaultContact,
    /// A corner of the AV is off the road.
    OffRoad,
}

/// Settings of an environment.
pub struct EnvironmentSettings {
    /// The simulator that moves the agents.
    pub traffic: Traffic,
    /// Kind of the actions.
    pub action: ActionKind,
    /// Number of steps of 0.1 s per action.
    pub every: usize,
    /// Sizes of the observations.
    pub sizes: Sizes,
    /// Conditions that end an episode before its last step.
    pub end_at: Vec<EndCondition>,
    /// Variants of the metrics with which finished episodes are scored; `None` if they are not.
    pub scores: Option<Options>,
}

/// An episode to begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpisodeBeginning {
    /// The slot, which may have an episode that has not ended.
    pub slot: usize,
    /// Index of the scenario.
    pub scenario: usize,
    /// Index among the rollouts of the scenario: part of the names of random streams.
    pub rollout: u32,
}

/// Scenarios with the parts of each that episodes share.
pub struct Environment {
    settings: EnvironmentSettings,
    scenarios: Vec<Arc<Scenario>>,
    prepared: Vec<Option<Rc<Prepared>>>,
    lockstep: Lockstep<'static, Arc<Scenario>>,
    slots: Vec<Slot>,
}

/// The parts of a scenario that episodes share.
struct Prepared {
    shape: EgoShape,
    map: Arc<PlanningMap>,
    objects: ObjectIds,
    arrays: SceneArrays,
}

/// An episode.
struct Slot {
    scenario: Arc<Scenario>,
    prepared: Rc<Prepared>,
    /// The next state of the AV, taken by its policy.
    next: Rc<Cell<Option<AgentState>>>,
    mover: Mover,
    judge: SampleJudge,
    kept: Kept,
    /// Length of the route up to the AV, metres.
    progress: f64,
    end: Option<End>,
}

/// The end of an episode.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// A condition of the environment is met.
    Condition,
    /// All steps of the scenario are over.
    LastStep,
    /// The rollout failed, with the reason.
    Failed(String),
}

/// The result of one action for one slot.
#[derive(Clone, Debug)]
pub struct Stepped {
    /// Values of [`MEASURES`] over the steps of the action: the sums of progress, flags that are 1 if they
    /// are at any step, the smallest time to collision, and the last speed. NaN where unknown.
    pub measures: [f64; MEASURES.len()],
    /// The end of the episode, if it ended with this action.
    pub end: Option<End>,
}

/// Policy whose next state the environment sets.
struct SlotPolicy(Rc<Cell<Option<AgentState>>>);

impl AvPolicy for SlotPolicy {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        self.0.take().ok_or_else(|| AvError::planner(seen.step() + 1, "there is no action for it"))
    }
}

impl Environment {
    /// Creates an environment without episodes.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(scenarios: Vec<Arc<Scenario>>, settings: EnvironmentSettings) -> Result<Self, RequestError> {
        if let Some(fault) = settings.sizes.fault() {
            return refused(fault);
        }
        let longest = scenarios.iter().map(|scenario| scenario.length().future).max().unwrap_or(FUTURE);
        match (settings.action, settings.every) {
            (_, every) if !(1..=longest).contains(&every) => {
                return refused(format_args!("`every` is {every}, expected 1 to {longest} steps"));
            }
            (ActionKind::State, 2..) => {
                return refused(format_args!(
                    "`every` is {}, expected 1: an action of the kind `state` is one step",
                    settings.every
                ));
            }
            (ActionKind::Plan { poses }, every) if !(every..=longest).contains(&poses) => {
                return refused(format_args!(
                    "a plan has {poses} poses, expected {every} to {longest}: at least `every`"
                ));
            }
            _ => {}
        }
        let lockstep = Lockstep::begin([], &settings.traffic.controller, &settings.traffic.settings);
        let prepared = scenarios.iter().map(|_| None).collect();
        Ok(Self { settings, scenarios, prepared, lockstep, slots: Vec::new() })
    }

    /// Returns the scenarios.
    pub fn scenarios(&self) -> &[Arc<Scenario>] {
        &self.scenarios
    }

    /// Returns the number of slots.
    pub fn slots(&self) -> usize {
        self.slots.len()
    }

    /// Returns the settings.
    pub fn settings(&self) -> &EnvironmentSettings {
        &self.settings
    }

    /// Begins episodes in place of all that there are, one per slot, in their order.
    ///
    /// # Errors
    /// If a scenario cannot be used.
    pub fn reset(&mut self, episodes: &[EpisodeBeginning]) -> Result<(), RequestError> {
        let slots = self.new_slots(episodes)?;
        let beginnings = slots.iter().zip(episodes).map(|(slot, episode)| slot.beginning(episode.rollout));
        let Traffic { controller, settings, .. } = &self.settings.traffic;
        // A simulator ends its episodes before it begins others.
        let none = Lockstep::begin([], controller, settings);
        std::mem::replace(&mut self.lockstep, none).finish(controller);
        self.lockstep = Lockstep::begin(beginnings, controller, settings);
        self.slots = slots;
        let failure = (0..self.slots.len()).find_map(|i| self.lockstep.failure(i));
        failure.map_or(Ok(()), |error| refused(reason(&self.settings.traffic.id, error)))
    }

    /// Moves the AVs of the episodes by their actions, `values` numbers per slot, and then begins the
    /// `restarted` episodes, whose actions are ignored.
    ///
    /// # Errors
    /// If an action cannot be executed, an episode is over, or a scenario cannot be used; no episode has
    /// changed then. Or if the simulator fails as a program; all episodes are over then.
    pub fn step(
        &mut self,
        actions: &[f64],
        restarted: &[EpisodeBeginning],
    ) -> Result<Vec<Stepped>, RequestError> {
        let values = self.settings.action.values();
        self.check_slots(restarted)?;
        let is_restarted = |slot: usize| restarted.iter().any(|episode| episode.slot == slot);
        let name = |slot: usize| (!is_restarted(slot)).then(|| format!("slot {slot}"));
        self.settings.action.check(actions, &(0..self.slots.len()).map(name).collect::<Vec<_>>())?;
        if let Some(slot) = (0..self.slots.len()).find(|&i| self.slots[i].end.is_some() && !is_restarted(i)) {
            return refused(format_args!("the episode in slot {slot} is over: reset it"));
        }
        // Everything that can be refused is computed before anything moves.
        let begun = self.new_slots(restarted)?;
        let mut moved = Vec::with_capacity(self.slots.len());
        for i in (0..self.slots.len()).filter(|i| !is_restarted(*i)) {
            moved.push((i, self.motion(i, &actions[i * values..(i + 1) * values])?));
        }
        let mut stepped: Vec<Stepped> = self.slots.iter().map(|_| Stepped::new()).collect();
        for k in 0..self.settings.every {
            moved.retain(|(i, _)| self.slots[*i].end.is_none());
            for (i, motion) in &moved {
                if let Some((mover, next)) = motion.get(k) {
                    self.slots[*i].mover = mover.clone();
                    self.slots[*i].next.set(Some(*next));
                }
            }
            self.lockstep.step(&self.settings.traffic.controller, &self.settings.traffic.settings);
            for (i, _) in &moved {
                let end = match self.failure(*i)? {
                    Some(end) => Some(end),
                    None => {
                        let seen = self.lockstep.seen(*i);
                        self.slots[*i].measure(&seen, &self.settings.end_at, &mut stepped[*i])
                    }
                };
                if end == Some(End::Condition) {
                    self.lockstep.stop(*i);
                }
                self.slots[*i].end.clone_from(&end);
                stepped[*i].end = end;
            }
        }
        self.restart(restarted, begun, &mut stepped)?;
        Ok(stepped)
    }

    /// Begins episodes in place of those in the same slots; no other one takes a step.
    ///
    /// # Errors
    /// If a scenario cannot be used; no episode has changed then. Or if the simulator cannot begin.
    pub fn begin(&mut self, episodes: &[EpisodeBeginning]) -> Result<(), RequestError> {
        self.check_slots(episodes)?;
        let begun = self.new_slots(episodes)?;
        let mut stepped: Vec<Stepped> = self.slots.iter().map(|_| Stepped::new()).collect();
        self.restart(episodes, begun, &mut stepped)?;
        match stepped.into_iter().find_map(|one| one.end) {
            Some(End::Failed(reason)) => refused(reason),
            _ => Ok(()),
        }
    }

    fn check_slots(&self, episodes: &[EpisodeBeginning]) -> Result<(), RequestError> {
        let missing_slot = episodes.iter().find(|episode| episode.slot >= self.slots.len());
        missing_slot.map_or(Ok(()), |episode| Err(missing("slot", episode.slot, self.slots.len())))
    }

    fn new_slots(&mut self, episodes: &[EpisodeBeginning]) -> Result<Vec<Slot>, RequestError> {
        episodes.iter().map(|episode| self.slot(episode)).collect()
    }

    /// Begins episodes in place of those in the same slots.
    fn restart(
        &mut self,
        restarted: &[EpisodeBeginning],
        begun: Vec<Slot>,
        stepped: &mut [Stepped],
    ) -> Result<(), RequestError> {
        let beginning =
            |(episode, slot): (&EpisodeBeginning, &Slot)| (episode.slot, slot.beginning(episode.rollout));
        let Traffic { controller, settings, .. } = &self.settings.traffic;
        self.lockstep.restart(restarted.iter().zip(&begun).map(beginning), controller, settings);
        for (episode, slot) in restarted.iter().zip(begun) {
            self.slots[episode.slot] = slot;
            let failure = self.failure(episode.slot)?;
            self.slots[episode.slot].end.clone_from(&failure);
            stepped[episode.slot].end = failure;
        }
        Ok(())
    }

    /// Returns the end of an episode that failed. All end if the simulator failed as a program.
    fn failure(&mut self, slot: usize) -> Result<Option<End>, RequestError> {
        let Some(error) = self.lockstep.failure(slot) else { return Ok(None) };
        let (reason, is_broken_off) = (reason(&self.settings.traffic.id, error), is_broken_off(error));
        let end = End::Failed(reason.clone());
        if is_broken_off {
            self.slots.iter_mut().for_each(|slot| slot.end = Some(end.clone()));
            return refused(reason);
        }
        Ok(Some(end))
    }

    /// Returns the next states of the AV of a slot under an action, with its motion after each.
    fn motion(&self, slot: usize, action: &[f64]) -> Result<Vec<(Mover, AgentState)>, RequestError> {
        let track = &self.lockstep.tracks(slot)[AV];
        let Some(mut now) = track.last().copied().flatten() else { return Ok(Vec::new()) };
        let mut mover = self.slots[slot].mover.clone();
        let frames = self.slots[slot].scenario.length().frames();
        let steps = self.settings.every.min(frames.saturating_sub(track.len()));
        let step = |k| {
            // The AV is where its policy says: the next state begins there.
            now = mover.advance(&now, action, k == 0)?;
            Ok((mover.clone(), now))
        };
        let named = |error: RequestError| RequestError::new(format_args!("slot {slot}: {error}"));
        (0..steps).map(step).collect::<Result<_, _>>().map_err(named)
    }

    /// Returns the observations of slots.
    pub fn observe(&mut self, slots: impl ExactSizeIterator<Item = usize>) -> Arrays {
        let sizes = &self.settings.sizes;
        let mut arrays = Arrays::with_capacity(sizes, slots.len());
        for i in slots {
            let (Slot { prepared, kept, .. }, seen) = (&mut self.slots[i], self.lockstep.seen(i));
            kept.follow(&seen);
            prepared.arrays.write(&seen, kept, AV, sizes, &mut arrays);
        }
        arrays
    }

    /// Returns the frames of each agent of a slot so far.
    ///
    /// # Errors
    /// If there is no such slot.
    pub fn tracks(&self, slot: usize) -> Result<(&Scenario, &[Vec<Frame>]), RequestError> {
        let of = self.slots.get(slot).ok_or_else(|| missing("slot", slot, self.slots()))?;
        Ok((&of.scenario, self.lockstep.tracks(slot)))
    }

    /// Scores an episode that is over, as a run with a judged AV does. Nobody is present after the end of an
    /// episode that a condition ended, so that its steps count and the others do not. `None` if episodes are
    /// not scored.
    pub fn scores(&self, slot: usize) -> Option<(Vec<Row>, Vec<Vec<Event>>)> {
        let options = self.settings.scores?;
        let (Slot { scenario, prepared, .. }, simulator) = (&self.slots[slot], &self.settings.traffic.id);
        let map = Some(Arc::clone(&prepared.map));
        let mut tracks = self.lockstep.tracks(slot).to_vec();
        tracks.iter_mut().for_each(|track| track.resize(scenario.length().frames(), None));
        let rollout = Rollout {
            tracks,
            entering: Entering::Off,
            entered: Vec::new(),
            outcomes: self.lockstep.outcomes(slot).clone(),
        };
        Some(judge_in_memory(scenario, simulator, rollout, &DeviationLabels::default(), options, map))
    }

    /// Creates an episode at its start.
    fn slot(&mut self, episode: &EpisodeBeginning) -> Result<Slot, RequestError> {
        let count = self.scenarios.len();
        let Some(scenario) = self.scenarios.get(episode.scenario) else {
            return Err(missing("scenario", episode.scenario, count));
        };
        let scenario = Arc::clone(scenario);
        let prepared = match &self.prepared[episode.scenario] {
            Some(prepared) => Rc::clone(prepared),
            None => {
                let points = self.settings.sizes.points;
                let prepared = Rc::new(Prepared::new(&scenario, points)?);
                self.prepared[episode.scenario] = Some(Rc::clone(&prepared));
                prepared
            }
        };
        let track = &scenario.start.history[AV];
        let mover = Mover::new(self.settings.action, track, &prepared.shape);
        let absent =
            || RequestError::new(format_args!("scenario `{}`: the AV has no finite state", scenario.id));
        let judge = SampleJudge::new(ego_states_until_now(track, &prepared.shape));
        let progress = prepared.arrays.progress(scenario.start.now(AV).position());
        let (mover, next) = (mover.ok_or_else(absent)?, Rc::new(Cell::new(None)));
        let kept = Kept::default();
        Ok(Slot { scenario, prepared, next, mover, judge, kept, progress, end: None })
    }
}

impl Prepared {
    fn new(scenario: &Scenario, points: usize) -> Result<Self, RequestError> {
        Ok(Self {
            shape: ego_shape(scenario).map_err(RequestError::new)?,
            map: Arc::new(planning_map(scenario).map_err(RequestError::new)?),
            objects: ObjectIds::new(&scenario.start),
            arrays: SceneArrays::new(scenario, points),
        })
    }
}

impl Stepped {
    fn new() -> Self {
        Self { measures: [0.0, 0.0, 0.0, f64::INFINITY, 0.0, 0.0, f64::NAN], end: None }
    }
}

impl Slot {
    fn beginning(&self, rollout: u32) -> RolloutBeginning<'static, Arc<Scenario>> {
        let av: Box<dyn AvPolicy> = Box::new(SlotPolicy(Rc::clone(&self.next)));
        RolloutBeginning { scenario: Arc::clone(&self.scenario), av: Some(av), rollout }
    }

    /// Adds the measures of the step that was just realised. Returns the end of the episode, if it is over.
    fn measure(
        &mut self,
        seen: &Observation<'_>,
        end_at: &[EndCondition],
        stepped: &mut Stepped,
    ) -> Option<End> {
        let (prepared, current) = (&self.prepared, self.scenario.start.current());
        let no_state = || End::Failed(format!("scenario `{}`: the AV has no finite state", self.scenario.id));
        let Some(ego) = ego_state_now(seen.track(AV), current, &prepared.shape) else {
            return Some(no_state());
        };
        let objects = prepared.objects.objects_near(seen, &Reach::of(&ego, &prepared.shape));
        let scores = self.judge.judge(&prepared.map, prepared.shape, ego, objects);
        let progress = prepared.arrays.progress(ego.center(&prepared.shape));
        let is_contact = !scores.contacts.is_empty();
        let is_at_fault = scores.contacts.iter().any(|contact| contact.at_fault == Some(true));
        let is_off_road = scores.is_off_road == Some(true);
        let [sum, contact, at_fault, ttc, off_road, uncomfortable, speed] = &mut stepped.measures;
        *sum += progress - self.progress;
        self.progress = progress;
        raise(contact, Some(is_contact));
        raise(at_fault, Some(is_at_fault));
        *ttc = ttc.min(scores.ttc);
        raise(off_road, scores.is_off_road);
        raise(uncomfortable, scores.is_comfortable.map(|is_comfortable| !is_comfortable));
        *speed = ego.speed();
        let is_met = |condition: &EndCondition| match condition {
            EndCondition::Contact => is_contact,
            EndCondition::AtFaultContact => is_at_fault,
            EndCondition::OffRoad => is_off_road,
        };
        if end_at.iter().any(is_met) {
            return Some(End::Condition);
        }
        (seen.step() == self.scenario.length().future).then_some(End::LastStep)
    }
}

/// Sets a flag that is 1 if it is at any step; unknown flags are NaN.
fn raise(flag: &mut f64, value: Option<bool>) {
    match value {
        Some(true) => *flag = 1.0,
        Some(false) => {}
        None => *flag = f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenarios::of_length;
    use crate::evaluation::Source;
    use crate::rollout::Settings;

    use super::*;

    fn environment(scenarios: Vec<Arc<Scenario>>, every: usize) -> Result<Environment, RequestError> {
        let id = "constant-velocity".to_owned();
        let controller = crate::models::find(&id).unwrap().simulator().unwrap();
        let sizes = Sizes { agents: 1, frames: 30, lanes: 1, points: 2, lights: 0, route: 0 };
        let settings = EnvironmentSettings {
            traffic: Traffic { id, controller, settings: Settings::default() },
            action: ActionKind::Bicycle,
            every,
            sizes,
            end_at: Vec::new(),
            scores: Some(Options::default()),
        };
        Environment::new(scenarios, settings)
    }

    fn begin(slot: usize) -> EpisodeBeginning {
        EpisodeBeginning { slot, scenario: slot, rollout: 0 }
    }

    #[test]
    fn episodes_have_the_steps_of_their_scenario() {
        let shipped = Source::shipped(1).scenarios().unwrap().next().unwrap().unwrap();
        let lengths = [60, 80, 150];
        let scenarios: Vec<_> = lengths.map(|steps| Arc::new(of_length(&shipped, steps))).to_vec();
        let mut environment = environment(scenarios.clone(), 7).unwrap();
        environment.reset(&[begin(0), begin(1), begin(2)]).unwrap();
        // Frames before the first one are absent: 30 are observed, and 11 are there.
        let observed = environment.observe(0..3);
        let numbers: Vec<f32> = observed.0[0].iter().map(|number| f32::from_le_bytes(*number)).collect();
        let rows: Vec<&[f32]> = numbers.chunks(7).collect();
        assert!(rows[..19].iter().all(|row| row.iter().all(|value| *value == 0.0)));
        assert!(rows[19..30].iter().all(|row| row[6] == 1.0));
        let mut ends = [None; 3];
        for action in 1..=150_usize.div_ceil(7) {
            // Slots that are over begin again.
            let over: Vec<_> =
                (0..3).filter(|&slot| environment.slots[slot].end.is_some()).map(begin).collect();
            let stepped = environment.step(&[-1.0, 0.0, -1.0, 0.0, -1.0, 0.0], &over).unwrap();
            for (slot, one) in stepped.iter().enumerate().filter(|(_, one)| one.end.is_some()) {
                assert_eq!(one.end, Some(End::LastStep));
                if ends[slot].is_none() {
                    ends[slot] = Some(action);
                    let (_, tracks) = environment.tracks(slot).unwrap();
                    assert_eq!(tracks[0].len(), 11 + lengths[slot]);
                    let (rows, _) = environment.scores(slot).unwrap();
                    let stated = rows[0].length.map(|length| length.steps);
                    assert_eq!(stated, (lengths[slot] != 80).then_some(lengths[slot]));
                }
            }
        }
        assert_eq!(ends, [60, 80, 150].map(|steps: usize| Some(steps.div_ceil(7))));
        let refused = self::environment(scenarios, 151).err().unwrap().to_string();
        assert_eq!(refused, "`every` is 151, expected 1 to 150 steps");
    }
}
