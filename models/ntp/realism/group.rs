//! Groups of rollouts of one scenario, with the advantages of agents.

use std::sync::Arc;

use reactsim_metrics::wosac::{Scorer, WosacMetrics};
use reactsim_rollout::{Av, Controller, DeviatedAv, LogAv, NOT_FINITE, Request, Rollout, Settings, roll_out};
use reactsim_scene::wosac::{JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog, WosacTrack};
use reactsim_scene::{AgentKind, CURRENT, FUTURE, Frame, Length, Scenario};

use super::super::tokens::TOKEN_FRAMES;
use super::RealismRecipe;
use super::advantage::{Fines, STEPS, Steps, compared, of_shares};
use super::recipe::CONFIG;

/// Tracks of the agents in a rollout, 91 frames each.
type Tracks = Vec<Vec<Frame>>;

/// A scenario to drive in.
pub(super) struct Prepared {
    pub(super) scenario: Scenario,
    scorer: Scorer<'static>,
    /// The logged AV.
    logged: Arc<dyn Av>,
    /// The AV that leaves its log, if there is one.
    deviated: Option<Arc<dyn Av>>,
}

/// The rollouts of a group, with the advantage of every agent at every step.
pub(crate) struct Group {
    /// Tracks of the agents by rollout.
    pub(crate) rollouts: Vec<Tracks>,
    /// By rollout, agent and step.
    advantages: Vec<Vec<Steps>>,
}

impl Group {
    /// Returns the advantage of the token with which an agent leads on from a frame of a rollout.
    pub(crate) fn advantage(&self, rollout: usize, slot: usize, frame: usize) -> f32 {
        self.advantages[rollout][slot][(frame - CURRENT) / TOKEN_FRAMES] as f32
    }
}

/// Refuses a scenario of which the realism metrics are not defined, or whose deviated AV is invalid. The
/// error names it.
pub(super) fn check(scenario: &Scenario) -> Result<(), String> {
    if scenario.length() != Length::BENCHMARK {
        WosacLog::of_scenario(scenario).map_err(|error| error.to_string())?;
    }
    if let Some(deviation) = &scenario.deviation {
        let av = DeviatedAv::new(scenario, deviation.track.clone());
        av.map_err(|error| format!("scenario `{}`: {error}", scenario.id))?;
    }
    Ok(())
}

impl Prepared {
    /// Prepares a scenario; `None` if its rollouts cannot be judged: without road edges, for example.
    pub(super) fn new(scenario: &Scenario) -> Option<Self> {
        let mut log = WosacLog::of_scenario(scenario).ok()?;
        // All agents learn, not only those that the recording marks for prediction.
        let is_judged = |track: &WosacTrack| track.is_simulated() && track.kind != AgentKind::Other;
        log.tracks_to_predict = (0..log.tracks.len()).filter(|&i| is_judged(&log.tracks[i])).collect();
        let scorer = Scorer::owning(log).ok()?;
        let logged = Arc::new(LogAv::new(scenario).ok()?);
        let deviated = scenario.deviation.as_ref();
        let deviated = deviated.map(|d| DeviatedAv::new(scenario, d.track.clone())).transpose().ok()?;
        let deviated = deviated.map(|av| Arc::new(av) as Arc<dyn Av>);
        Some(Self { scenario: scenario.clone(), scorer, logged, deviated })
    }

    /// Drives with the logged AV. Returns the rollouts, with their realism.
    ///
    /// # Errors
    /// A message if the simulator has no plan, as one of a network whose scores are no numbers.
    pub(super) fn realism(
        &self,
        controller: &Controller,
        recipe: &RealismRecipe,
        seed: u64,
    ) -> Result<(Group, WosacMetrics), String> {
        let rollouts = self.drive(&self.logged, controller, recipe.rollouts, seed)?;
        let scored = ScenarioRollouts {
            scenario_id: self.scorer.log().scenario_id.clone(),
            joint_scenes: rollouts.iter().map(|tracks| self.joint_scene(tracks)).collect::<Result<_, _>>()?,
        };
        let scored = self.scorer.score_with_object_shares(&scored, &CONFIG);
        let (metrics, shares) = scored.map_err(|error| error.to_string())?;
        let slots: Vec<Option<usize>> = self.scorer.evaluated().iter().map(|id| self.slot(*id)).collect();
        let agents = self.scorer.log().tracks.len();
        let values = of_shares(&shares, recipe.features).into_iter().map(|of_objects| {
            let mut own = vec![[0.0; STEPS]; agents];
            for (slot, advantage) in slots.iter().zip(of_objects) {
                if let Some(slot) = slot {
                    own[*slot] = [recipe.weights.realism * advantage; STEPS];
                }
            }
            own
        });
        // Shares have a positive mean, which says nothing about one of them.
        let advantages = compared(&values.collect::<Vec<_>>());
        Ok((Group { rollouts, advantages }, metrics))
    }

    /// Drives with the AV that leaves its log. Returns the rollouts, with what agents did wrong; `None` if
    /// there is no such AV.
    ///
    /// # Errors
    /// As [`Self::realism`].
    pub(super) fn reactions(
        &self,
        controller: &Controller,
        recipe: &RealismRecipe,
        seed: u64,
    ) -> Result<Option<(Group, Vec<Fines>)>, String> {
        let Some(av) = &self.deviated else { return Ok(None) };
        let rollouts = self.drive(av, controller, recipe.rollouts, seed)?;
        let fines: Vec<Fines> = rollouts.iter().map(|tracks| Fines::of(&self.scenario, tracks)).collect();
        let agents = self.scenario.start.agents.len();
        let values: Vec<Vec<Steps>> = fines.iter().map(|fines| fines.values(agents)).collect();
        let mut advantages = compared(&values);
        let all = advantages.iter_mut().flatten().flatten();
        all.for_each(|advantage| *advantage *= recipe.weights.reactions);
        Ok(Some((Group { rollouts, advantages }, fines)))
    }

    fn drive(
        &self,
        av: &Arc<dyn Av>,
        controller: &Controller,
        rollouts: usize,
        seed: u64,
    ) -> Result<Vec<Tracks>, String> {
        let request = |rollout| Request { scenario: &self.scenario, av: Some(av.clone()), rollout };
        let settings = Settings { seed, ..Settings::default() };
        let results = roll_out((0..rollouts as u32).map(request).collect(), controller, &settings);
        let tracks = |rollout: Rollout| match rollout.outcomes.contains_key(NOT_FINITE) {
            true => Err(format!("scenario `{}`: scores of the network are not finite", self.scenario.id)),
            false => Ok(rollout.tracks),
        };
        results.into_iter().map(|r| r.map_err(|error| error.to_string()).and_then(tracks)).collect()
    }

    fn slot(&self, id: i32) -> Option<usize> {
        self.scorer.log().tracks.iter().position(|track| track.id == id)
    }

    /// Returns a rollout as the metrics read it: world coordinates, heights 0 as in logs of scenarios.
    fn joint_scene(&self, tracks: &Tracks) -> Result<JointScene, String> {
        let origin = self.scenario.origin;
        let trajectory = |(track, frames): (&WosacTrack, &Vec<Frame>)| {
            let states: Vec<_> = frames[CURRENT + 1..].iter().flatten().collect();
            if states.len() != FUTURE {
                return Err(format!("scenario `{}`: object {} disappears", self.scenario.id, track.id));
            }
            Ok(ObjectTrajectory {
                object_id: track.id,
                x: states.iter().map(|state| (state.x + origin.x) as f32).collect(),
                y: states.iter().map(|state| (state.y + origin.y) as f32).collect(),
                z: vec![0.0; FUTURE],
                heading: states.iter().map(|state| state.heading as f32).collect(),
            })
        };
        let simulated = self.scorer.log().tracks.iter().zip(tracks).filter(|(track, _)| track.is_simulated());
        Ok(JointScene { trajectories: simulated.map(trajectory).collect::<Result<_, _>>()? })
    }
}
