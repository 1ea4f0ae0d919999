//! The reactive network as a simulator.

use burn::tensor::{Device, Tensor};
use reactsim::rollout::{Episode, Memory, PlanError, Simulator, Stream};
use reactsim::scene::{Frame, Start};

use super::super::clearance::Traffic;
use super::super::execute::Executor;
use super::super::sampling::Driving;
use super::super::tokens::{ORIGIN, TOKEN_FRAMES, TOKEN_POSES};
use super::batch::{NodeTensors, SceneRows, map_tensors, node_tensors};
use super::config::Config;
use super::network::{Encoded, PastNodes};
use super::places::Places;
use super::policy::Policy;
use super::step::{Earlier, Step};
use super::window::{Remembered, earlier_frames, observed_steps, step_at};

/// Agents that move by tokens that the reactive network thinks probable.
#[derive(Debug)]
pub struct ReactiveSimulator {
    policy: Policy,
    driving: Driving,
    device: Device,
}

impl ReactiveSimulator {
    /// A simulator of this policy, whose weights are on this device.
    pub fn new(policy: Policy, driving: Driving, device: Device) -> Self {
        Self { policy, driving, device }
    }
}

/// What is kept of an episode.
struct Mind {
    places: Places,
    /// `[p, hidden]`: the encoded places.
    map: Tensor<2>,
    /// The latest steps, oldest first.
    remembered: Vec<Remembered>,
    /// Frame at which the next plan can go on from what is remembered.
    due: usize,
}

/// An episode while its plan is made.
struct Planned<'e, 'a> {
    episode: &'e mut Episode<'a>,
    mind: Mind,
    /// Realised frames, then planned ones.
    tracks: Vec<Vec<Frame>>,
    steps: Vec<Step>,
    /// The remembered nodes, where the newest step goes on from them.
    earlier: Vec<Earlier>,
}

impl Simulator for ReactiveSimulator {
    fn begin(&self, start: &Start, _stream: &mut Stream) -> Memory {
        let places = Places::known(start, &self.policy.config);
        let map = self.policy.network.encode_map(&map_tensors(&[&places], &self.policy.config, &self.device));
        Memory::new(Some(Mind { places, map, remembered: Vec::new(), due: usize::MAX }))
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut planned = Vec::with_capacity(batch.len());
        for episode in batch.iter_mut() {
            // Taken out, to be put back when the plan is made.
            let Some(mind) = episode.memory.get::<Option<Mind>>().and_then(Option::take) else {
                episode.error = Some(PlanError::ForeignMemory("ntp-reactive"));
                continue;
            };
            let agents = episode.seen.start().agents.len();
            let tracks = (0..agents).map(|a| episode.seen.track(a).to_vec()).collect();
            planned.push(Planned { episode, mind, tracks, steps: Vec::new(), earlier: Vec::new() });
        }
        let mut executor = Executor::new(self.driving.projection);
        let longest = planned.iter().map(|p| p.episode.plan.steps()).max().unwrap_or(0);
        for token in 0..longest.div_ceil(TOKEN_FRAMES) {
            let mut going: Vec<&mut Planned<'_, '_>> =
                planned.iter_mut().filter(|p| p.episode.plan.steps() > token * TOKEN_FRAMES).collect();
            self.next_tokens(&mut going, token, &mut executor);
        }
        for p in planned {
            let now = p.episode.seen.frame();
            for (slot, track) in p.tracks.iter().enumerate() {
                for k in 0..p.episode.plan.steps() {
                    p.episode.plan.set(slot, k, track.get(now + 1 + k).copied().flatten());
                }
            }
            if let Some(mind) = p.episode.memory.get::<Option<Mind>>() {
                *mind = Some(p.mind);
            }
        }
        Ok(())
    }
}

impl ReactiveSimulator {
    /// Plans the `token`-th half second of every episode.
    fn next_tokens(&self, going: &mut [&mut Planned<'_, '_>], token: usize, executor: &mut Executor) {
        for p in going.iter_mut() {
            p.look(token, &self.policy.config);
        }
        // What can go on from remembered steps and what has to compute them anew are two passes: the first ones have one step, whose past
        // is elsewhere; the others have their past among their own nodes.
        let (mut on, mut anew): (Vec<_>, Vec<_>) = going.iter_mut().partition(|p| p.steps.len() == 1);
        for (group, kept) in [(&mut on, true), (&mut anew, false)] {
            if group.is_empty() {
                continue;
            }
            let (nodes, encoded) = self.encode(group, kept);
            let tokens = self.policy.network.all_logits(&nodes, &encoded);
            let mut row = 0;
            for p in group.iter_mut() {
                let rows: usize = p.steps.iter().map(|s| s.slots.len()).sum();
                let newest = p.steps.last().map_or(0, |s| s.slots.len());
                p.act(self, &tokens[row + rows - newest..row + rows], token, executor);
                p.remember(&encoded.entering, row, &self.policy.config);
                row += rows;
            }
        }
    }

    /// Runs the blocks over the steps of some episodes.
    fn encode(&self, group: &[&mut &mut Planned<'_, '_>], kept: bool) -> (NodeTensors, Encoded) {
        let (mut scenes, mut maps) = (Vec::new(), Vec::new());
        let mut at = SceneRows::default();
        let mut past: Vec<Vec<Tensor<2>>> = vec![Vec::new(); self.policy.config.agent_layers];
        for p in group {
            scenes.push((p.steps.as_slice(), at));
            maps.push(p.mind.map.clone());
            at.places += p.mind.places.all.len();
            if kept {
                at.earlier += p.earlier.len();
                for remembered in &p.mind.remembered {
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
        let past = if kept { PastNodes::Kept(&past) } else { PastNodes::Here };
        let encoded = self.policy.network.encode(&nodes, join(maps), &past);
        (nodes, encoded)
    }
}

impl Planned<'_, '_> {
    /// Lays out what the network is to look at for the `token`-th half second: the newest step alone where the earlier ones are
    /// remembered, else all of them.
    fn look(&mut self, token: usize, config: &Config) {
        let now = self.episode.seen.frame() + token * TOKEN_FRAMES;
        let frames = earlier_frames(now, config.past);
        let known: Vec<usize> = self.mind.remembered.iter().map(|r| r.frame).collect();
        let fresh = token > 0 || self.mind.due == now;
        if fresh && known == frames {
            self.earlier = self.mind.remembered.iter().flat_map(|r| r.nodes.iter().copied()).collect();
            let step =
                step_at(&self.episode.seen, &self.tracks, now, &self.mind.places, &self.earlier, config);
            self.steps = vec![step];
        } else {
            self.mind.remembered.clear();
            self.earlier.clear();
            let all: Vec<usize> = frames.into_iter().chain([now]).collect();
            self.steps = observed_steps(&self.episode.seen, &self.tracks, &all, &self.mind.places, config);
        }
    }

    /// Draws a token for every agent of the newest step and moves it so.
    fn act(&mut self, by: &ReactiveSimulator, logits: &[Vec<f32>], token: usize, executor: &mut Executor) {
        let from = self.episode.seen.frame() + token * TOKEN_FRAMES;
        let Some(newest) = self.steps.last() else { return };
        let agents = &self.episode.seen.start().agents;
        let av_next = self.episode.seen.av_next().filter(|_| token == 0);
        let traffic = by.driving.keep_clear.then(|| Traffic::at(agents, &self.tracks, from, av_next));
        for ((&slot, &class), logits) in newest.slots.iter().zip(&newest.classes).zip(logits) {
            let agent = &agents[slot];
            let track = &mut self.tracks[slot];
            match by.driving.sampling.draw_first(logits, self.episode.stream) {
                Some(order) => {
                    let tokens = order.into_iter().map(|t| by.policy.vocabulary.poses(class, t));
                    executor.execute_clear(agent, slot, class, tokens, traffic.as_ref(), track);
                }
                None => {
                    *self
                        .episode
                        .outcomes
                        .entry("tokens that are no numbers: went on as before")
                        .or_default() += 1;
                    executor.execute(agent, class, &onward(track), track);
                }
            }
        }
        // Who is absent stays so.
        for track in &mut self.tracks {
            track.resize(from + 1 + TOKEN_FRAMES, None);
        }
    }

    /// Keeps what later steps attend to; `row` is where the nodes of this episode begin.
    fn remember(&mut self, entering: &[Tensor<2>], row: usize, config: &Config) {
        let mut row = row;
        for step in &self.steps {
            let rows = step.slots.len();
            let own = entering.iter().map(|x| x.clone().narrow(0, row, rows)).collect();
            let frame = step.frame;
            self.mind.remembered.push(Remembered { frame, nodes: step.here.clone(), entering: own });
            row += rows;
        }
        let surplus = self.mind.remembered.len().saturating_sub(config.past);
        self.mind.remembered.drain(..surplus);
        let steps = self.episode.plan.steps();
        // Steps that were only planned are not what will have happened.
        self.mind.due =
            if steps == TOKEN_FRAMES { self.episode.seen.frame() + TOKEN_FRAMES } else { usize::MAX };
    }
}

/// Goes on for half a second as the last step went.
fn onward(track: &[Frame]) -> super::super::tokens::TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    if let Some(Some(state)) = track.last() {
        let speed = state.forward_speed();
        for (k, pose) in poses.iter_mut().enumerate() {
            pose.position.x = speed * reactsim::scene::DT * k as f64;
        }
    }
    poses
}
