//! The reactive network as a simulator.

use burn::tensor::{Device, Tensor};
use reactsim::rollout::{Episode, Memory, NOT_FINITE, PlanError, Simulator, Stream};
use reactsim::scene::{Frame, Start};

use super::super::clearance::Traffic;
use super::super::execute::Executor;
use super::super::haste::Haste;
use super::super::sampling::Driving;
use super::super::tokens::{ORIGIN, TOKEN_FRAMES, TOKEN_POSES};
use super::batch::{NodeTensors, SceneRows, map_tensors, node_tensors};
use super::config::Config;
use super::linked_places::LinkedPlaces;
use super::network::{Encoding, PastNodes};
use super::policy::Policy;
use super::step::{EarlierNode, Step};
use super::window::{StepMemory, earlier_frames, observed_steps, step_at};
use crate::models::perception::Class;

/// Simulator that moves agents by tokens drawn from the reactive network.
#[derive(Debug)]
pub struct ReactiveSimulator {
    policy: Policy,
    driving: Driving,
    haste: Option<Haste>,
    device: Device,
}

impl ReactiveSimulator {
    /// Builds a simulator of this policy, whose weights are on this device.
    pub fn new(policy: Policy, driving: Driving, device: Device) -> Self {
        Self { policy, driving, haste: None, device }
    }

    /// Makes faster tokens of vehicles likelier.
    #[must_use]
    pub fn with_haste(self, haste: Haste) -> Self {
        Self { haste: Some(haste), ..self }
    }
}

/// Memory of an episode between plans.
struct EpisodeMemory {
    linked: LinkedPlaces,
    /// Encoded places, `[p, hidden]`.
    map: Tensor<2>,
    /// Latest steps, oldest first.
    remembered: Vec<StepMemory>,
    /// Frame at which the next plan can continue from the remembered steps.
    next_frame: usize,
}

/// An episode whose plan is being made.
struct PendingPlan<'e, 'a> {
    episode: &'e mut Episode<'a>,
    memory: EpisodeMemory,
    /// Realized frames, then planned ones.
    tracks: Vec<Vec<Frame>>,
    steps: Vec<Step>,
    /// Remembered nodes, if the newest step continues from them.
    earlier: Vec<EarlierNode>,
    /// Steps up to the present one. Later ones are merely planned: others may move otherwise.
    observed: Vec<StepMemory>,
}

impl Simulator for ReactiveSimulator {
    fn begin(&self, start: &Start, _stream: &mut Stream) -> Memory {
        let linked = LinkedPlaces::known(start, &self.policy.config);
        let map = self.policy.network.encode_map(&map_tensors(&[&linked], &self.policy.config, &self.device));
        Memory::new(Some(EpisodeMemory { linked, map, remembered: Vec::new(), next_frame: usize::MAX }))
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut planned = Vec::with_capacity(batch.len());
        for episode in batch.iter_mut() {
            // Taken out of the episode until the plan is made.
            let Some(memory) = episode.memory.get::<Option<EpisodeMemory>>().and_then(Option::take) else {
                episode.error = Some(PlanError::ForeignMemory("ntp-reactive"));
                continue;
            };
            let agents = episode.seen.start().agents.len();
            let tracks = (0..agents).map(|a| episode.seen.track(a).to_vec()).collect();
            planned.push(PendingPlan {
                episode,
                memory,
                tracks,
                steps: Vec::new(),
                earlier: Vec::new(),
                observed: Vec::new(),
            });
        }
        let mut executor = Executor::new(self.driving.projection);
        let longest = planned.iter().map(|p| p.episode.plan.steps()).max().unwrap_or(0);
        for token in 0..longest.div_ceil(TOKEN_FRAMES) {
            let mut active: Vec<&mut PendingPlan<'_, '_>> =
                planned.iter_mut().filter(|p| p.episode.plan.steps() > token * TOKEN_FRAMES).collect();
            self.next_tokens(&mut active, token, &mut executor);
        }
        for mut p in planned {
            let now = p.episode.seen.frame();
            (p.memory.remembered, p.memory.next_frame) = (p.observed, now + TOKEN_FRAMES);
            for (slot, track) in p.tracks.iter().enumerate() {
                for k in 0..p.episode.plan.steps() {
                    p.episode.plan.set(slot, k, track.get(now + 1 + k).copied().flatten());
                }
            }
            if let Some(memory) = p.episode.memory.get::<Option<EpisodeMemory>>() {
                *memory = Some(p.memory);
            }
        }
        Ok(())
    }
}

impl ReactiveSimulator {
    /// Plans the `token`-th half second of every episode.
    fn next_tokens(&self, active: &mut [&mut PendingPlan<'_, '_>], token: usize, executor: &mut Executor) {
        for p in active.iter_mut() {
            p.prepare_steps(token, &self.policy.config);
        }
        // Episodes that continue from remembered steps and those that recompute them need two passes:
        // the former have a single step, whose past is cached; the latter have their past among their
        // own nodes.
        let (mut continued, mut recomputed): (Vec<_>, Vec<_>) =
            active.iter_mut().partition(|p| p.steps.len() == 1);
        for (group, cached) in [(&mut continued, true), (&mut recomputed, false)] {
            if group.is_empty() {
                continue;
            }
            let (nodes, encoded) = self.encode(group, cached);
            let tokens = self.policy.network.all_logits(&nodes, &encoded);
            let mut row = 0;
            for p in group.iter_mut() {
                let rows: usize = p.steps.iter().map(|s| s.slots.len()).sum();
                let newest = p.steps.last().map_or(0, |s| s.slots.len());
                p.move_agents(self, &tokens[row + rows - newest..row + rows], token, executor);
                p.remember(&encoded.entering, row, token, &self.policy.config);
                row += rows;
            }
        }
    }

    /// Returns the logits of a vehicle with the bonus of each token.
    fn hasten(&self, haste: Haste, logits: &[f32], speed: f64) -> Vec<f32> {
        let ahead = |token| self.policy.vocabulary.poses(Class::Vehicle, token)[TOKEN_FRAMES].position.x;
        logits.iter().enumerate().map(|(token, l)| l + haste.bonus(ahead(token), speed) as f32).collect()
    }

    /// Encodes the steps of some episodes.
    fn encode(&self, group: &[&mut &mut PendingPlan<'_, '_>], cached: bool) -> (NodeTensors, Encoding) {
        let (mut scenes, mut maps) = (Vec::new(), Vec::new());
        let mut at = SceneRows::default();
        let mut past: Vec<Vec<Tensor<2>>> = vec![Vec::new(); self.policy.config.agent_layers];
        for p in group {
            scenes.push((p.steps.as_slice(), at));
            maps.push(p.memory.map.clone());
            at.places += p.memory.linked.places.all.len();
            if cached {
                at.earlier += p.earlier.len();
                for remembered in &p.memory.remembered {
                    for (all, own) in past.iter_mut().zip(&remembered.entering) {
                        all.push(own.clone());
                    }
                }
            } else {
                at.earlier += p.steps.iter().map(|s| s.slots.len()).sum::<usize>();
            }
        }
        let nodes = node_tensors(&scenes, &self.policy.config, &self.device);
        let empty = || Tensor::zeros([0, self.policy.config.hidden], &self.device);
        let join = |parts: Vec<Tensor<2>>| if parts.is_empty() { empty() } else { Tensor::cat(parts, 0) };
        let past: Vec<Tensor<2>> = past.into_iter().map(join).collect();
        let past = if cached { PastNodes::Cached(&past) } else { PastNodes::Here };
        let encoded = self.policy.network.encode(&nodes, join(maps), &past);
        (nodes, encoded)
    }
}

impl PendingPlan<'_, '_> {
    /// Prepares the network input for the `token`-th half second: the newest step alone if the earlier
    /// ones are remembered, else all steps.
    fn prepare_steps(&mut self, token: usize, config: &Config) {
        let now = self.episode.seen.frame() + token * TOKEN_FRAMES;
        let frames = earlier_frames(now, config.past);
        let known: Vec<usize> = self.memory.remembered.iter().map(|r| r.frame).collect();
        let fresh = token > 0 || self.memory.next_frame == now;
        if fresh && known == frames {
            self.earlier = self.memory.remembered.iter().flat_map(|r| r.nodes.iter().copied()).collect();
            let step = step_at(
                &self.episode.seen,
                &self.tracks,
                now,
                &self.memory.linked.places,
                &self.earlier,
                config,
            );
            self.steps = vec![step];
        } else {
            self.memory.remembered.clear();
            self.earlier.clear();
            let all: Vec<usize> = frames.into_iter().chain([now]).collect();
            self.steps =
                observed_steps(&self.episode.seen, &self.tracks, &all, &self.memory.linked.places, config);
        }
    }

    /// Draws a token for every agent of the newest step and executes it.
    fn move_agents(
        &mut self,
        simulator: &ReactiveSimulator,
        logits: &[Vec<f32>],
        token: usize,
        executor: &mut Executor,
    ) {
        let from = self.episode.seen.frame() + token * TOKEN_FRAMES;
        let Some(newest) = self.steps.last() else { return };
        let agents = &self.episode.seen.start().agents;
        let av_next = self.episode.seen.av_next().filter(|_| token == 0);
        let traffic = simulator.driving.keep_clear.then(|| Traffic::at(agents, &self.tracks, from, av_next));
        for ((&slot, &class), logits) in newest.slots.iter().zip(&newest.classes).zip(logits) {
            let agent = &agents[slot];
            let track = &mut self.tracks[slot];
            let hasty = simulator.haste.filter(|_| class == Class::Vehicle).map(|haste| {
                let speed = track.last().copied().flatten().map_or(0.0, |s| s.forward_speed());
                simulator.hasten(haste, logits, speed)
            });
            let logits = hasty.as_deref().unwrap_or(logits);
            match simulator.driving.sampling.draw_first(logits, self.episode.stream) {
                Some(order) => {
                    let tokens = order.into_iter().map(|t| simulator.policy.vocabulary.poses(class, t));
                    executor.execute_clear(agent, slot, class, tokens, traffic.as_ref(), track);
                }
                None => {
                    *self.episode.outcomes.entry(NOT_FINITE).or_default() += 1;
                    executor.execute(agent, class, &straight_token(track), track);
                }
            }
        }
        // Absent agents stay absent.
        for track in &mut self.tracks {
            track.resize(from + 1 + TOKEN_FRAMES, None);
        }
    }

    /// Remembers the features that later steps attend to; `row` is the first row of this episode's
    /// nodes.
    fn remember(&mut self, entering: &[Tensor<2>], row: usize, token: usize, config: &Config) {
        let mut row = row;
        for step in &self.steps {
            let rows = step.slots.len();
            let own = entering.iter().map(|x| x.clone().narrow(0, row, rows)).collect();
            let frame = step.frame;
            self.memory.remembered.push(StepMemory { frame, nodes: step.here.clone(), entering: own });
            row += rows;
        }
        let surplus = self.memory.remembered.len().saturating_sub(config.past);
        self.memory.remembered.drain(..surplus);
        if token == 0 {
            self.observed.clone_from(&self.memory.remembered);
        }
    }
}

/// Returns the token that keeps speed and heading of the last state for half a second.
fn straight_token(track: &[Frame]) -> super::super::tokens::TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    if let Some(Some(state)) = track.last() {
        let speed = state.forward_speed();
        for (k, pose) in poses.iter_mut().enumerate() {
            pose.position.x = speed * reactsim::scene::DT * k as f64;
        }
    }
    poses
}
