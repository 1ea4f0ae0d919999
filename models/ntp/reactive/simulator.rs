//! The reactive network as a simulator.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use reactsim_nn::perception::{Body, Class};
use reactsim_nn::{RowCollector, SharedRows, is_host};
use reactsim_rollout::{Beginning, Episode, JointPlan, Memory, NOT_FINITE, PlanError, Simulator};
use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{FUTURE, Frame};

use super::super::beginnings::different_starts;
use super::super::clearance::{Reversals, Traffic};
use super::super::execute::Executor;
use super::super::haste::Haste;
use super::super::sampling::Driving;
use super::super::tokens::{ORIGIN, TOKEN_FRAMES, TOKEN_POSES};
use super::batch::{NodeRows, NodeTensors, SceneRows, map_tensors};
use super::choice::{Chooser, Surroundings};
use super::config::Config;
use super::linked_places::LinkedPlaces;
use super::network::{Encoding, Network, PastNodes, Sources};
use super::notes::{Drawn, Notes, Pass};
use super::policy::Policy;
use super::standing::{Standing, sets_off, stands};
use super::step::{EarlierNode, StepGraph};
use super::window::{ObservedEpisode, RecentTracks, StepMemory, earlier_frames};

/// Simulator that moves agents by tokens drawn from the reactive network. The episodes of a batch go through
/// the network together; their features stay in tensors that they share, so that the number of operations per
/// plan does not grow with the batch.
#[derive(Debug)]
pub struct ReactiveSimulator {
    policy: Policy,
    driving: Driving,
    haste: Option<Haste>,
    rests: bool,
    notes: Option<Notes>,
    device: Device,
}

impl ReactiveSimulator {
    /// Builds a simulator of this policy, whose weights are on this device.
    pub fn new(policy: Policy, driving: Driving, device: Device) -> Self {
        Self { policy, driving, haste: None, rests: true, notes: None, device }
    }

    /// Asks the network about every agent at every plan. Otherwise an agent that stands, and almost surely
    /// does not set off, stands in the next plan as well.
    #[must_use]
    pub fn without_rests(self) -> Self {
        Self { rests: false, ..self }
    }

    /// Notes what is drawn. The reference network of the notes must be of the same configuration.
    #[must_use]
    pub(crate) fn with_notes(self, notes: Notes) -> Self {
        Self { notes: Some(notes), ..self }
    }

    /// Makes faster tokens of vehicles likelier.
    #[must_use]
    pub fn with_haste(self, haste: Haste) -> Self {
        Self { haste: Some(haste), ..self }
    }
}

/// Memory of an episode between plans. Features are those of all blocks of the network, then of the reference
/// network if there are notes.
struct EpisodeMemory {
    /// Place of the episode in its batch.
    number: usize,
    linked: Arc<LinkedPlaces>,
    chooser: Chooser,
    /// Encoded places, as each block attends to them.
    map: SharedRows,
    /// Latest steps, oldest first.
    remembered: Vec<StepMemory>,
    /// Agents that stand in the executed part of the next plan as well. Longer rests cost reactions
    /// (docs/decisions.md, "The guard").
    resting: Standing,
    /// Frame at which the next plan can continue from the remembered steps.
    next_frame: usize,
    /// Heights of the road under agents.
    heights: RoadHeights,
    /// Whether the AV has reversed.
    reversals: Reversals,
}

/// State of the decoding of one episode, whose plan is being made.
struct DecodingState<'e, 'a> {
    episode: &'e mut Episode<'a>,
    memory: EpisodeMemory,
    recent: RecentTracks,
    steps: Vec<StepGraph>,
    /// Bodies of the nodes of the newest step.
    bodies: Vec<Body>,
    /// Agents that stand from here on, and are no nodes.
    standing: Standing,
    /// Remembered nodes, if the newest step continues from them.
    earlier: Vec<EarlierNode>,
    /// Steps up to the present one. Later ones are merely planned: others may move otherwise.
    observed: Vec<StepMemory>,
}

impl Simulator for ReactiveSimulator {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let config = &self.policy.config;
        let (starts, of) = different_starts(batch);
        let linked: Vec<_> =
            starts.iter().map(|start| Arc::new(LinkedPlaces::known(start, config))).collect();
        let places: Vec<&LinkedPlaces> = linked.iter().map(Arc::as_ref).collect();
        // Last bits of small products on processors depend on the number of rows.
        let together = if is_host(&self.device) { 1 } else { places.len().max(1) };
        let maps = places.chunks(together).flat_map(|places| {
            let map = map_tensors(places, config, &self.device);
            let maps = self.networks().flat_map(|network| network.encode_map(&map)).collect();
            SharedRows::divide(maps, places.iter().map(|l| l.places.all.len()))
        });
        let maps: Vec<SharedRows> = maps.collect();
        for (number, (episode, of)) in batch.iter_mut().zip(of).enumerate() {
            let (chooser, remembered) = (Chooser::new(config), Vec::new());
            let memory = EpisodeMemory {
                number,
                linked: Arc::clone(&linked[of]),
                chooser,
                map: maps[of].clone(),
                remembered,
                resting: Standing::default(),
                next_frame: usize::MAX,
                heights: RoadHeights::default(),
                reversals: Reversals::default(),
            };
            episode.memory = Memory::new(Some(memory));
        }
        Ok(())
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut planned = Vec::with_capacity(batch.len());
        for episode in batch.iter_mut() {
            // Taken out of the episode until the plan is made.
            let memory = episode.memory.get::<Option<EpisodeMemory>>().and_then(Option::take);
            let Some(mut memory) = memory else {
                episode.error = Some(PlanError::ForeignMemory("ntp-reactive"));
                continue;
            };
            let recent = RecentTracks::of(&episode.seen, self.policy.config.past);
            memory.heights.follow(episode.seen.start(), episode.seen.tracks(), recent.first);
            memory.reversals.follow(episode.seen.track(0));
            planned.push(DecodingState {
                episode,
                memory,
                recent,
                steps: Vec::new(),
                bodies: Vec::new(),
                standing: Standing::default(),
                earlier: Vec::new(),
                observed: Vec::new(),
            });
        }
        let mut executor = Executor::new(self.driving.projection);
        let longest = planned.iter().map(|p| p.episode.plan.steps()).max().unwrap_or(0);
        for token in 0..longest.div_ceil(TOKEN_FRAMES) {
            let mut active: Vec<&mut DecodingState<'_, '_>> =
                planned.iter_mut().filter(|p| p.episode.plan.steps() > token * TOKEN_FRAMES).collect();
            self.next_tokens(&mut active, token, &mut executor);
        }
        for mut p in planned {
            let now = p.episode.seen.frame();
            (p.memory.remembered, p.memory.next_frame) = (p.observed, now + TOKEN_FRAMES);
            let next = now + 1 - p.recent.first;
            for (slot, track) in p.recent.all.iter().enumerate() {
                for k in 0..p.episode.plan.steps() {
                    p.episode.plan.set(slot, k, track.get(next + k).copied().flatten());
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
    fn next_tokens(&self, active: &mut [&mut DecodingState<'_, '_>], token: usize, executor: &mut Executor) {
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
            let Encoded { nodes, encoding, noted } = self.encode(group, cached);
            let tokens = self.policy.network.all_logits(&nodes, &encoding.nodes);
            let steps = || group.iter().flat_map(|p| p.steps.iter().map(|s| s.slots.len()));
            let mut entering = SharedRows::divide(encoding.entering, steps()).into_iter();
            let (mut row, mut drawn) = (0, Vec::new());
            for p in group.iter_mut() {
                let rows: usize = p.steps.iter().map(|s| s.slots.len()).sum();
                let newest = p.steps.last().map_or(0, |s| s.slots.len());
                let first = row + rows - newest;
                let moved = p.move_agents(self, &tokens[first..first + newest], token, executor);
                p.stand(&moved.stood, &encoding.meeting, first, self.rests);
                p.remember(&mut entering, token, &self.policy.config);
                if noted.is_some() {
                    drawn.extend(moved.drawn.into_iter().map(|(row, drawn)| (first + row, drawn)));
                }
                row += rows;
            }
            if let (Some(notes), Some((rows, sources, reference))) = (&self.notes, noted) {
                let pass = Pass { rows, nodes: &nodes, sources, logits: &tokens, reference };
                notes.add(pass, &drawn, self.driving.sampling.temperature, &self.policy.config);
            }
        }
    }

    /// Returns the network, then the reference network of the notes if there are any.
    fn networks(&self) -> impl Iterator<Item = &Network> {
        let reference = self.notes.as_ref().map(|notes| &notes.reference);
        std::iter::once(&self.policy.network).chain(reference)
    }

    /// Returns the logits of a vehicle with the bonus of each token.
    fn hasten(&self, haste: Haste, logits: &[f32], speed: f64) -> Vec<f32> {
        let ahead = |token| self.policy.vocabulary.poses(Class::Vehicle, token)[TOKEN_FRAMES].position.x;
        logits.iter().enumerate().map(|(token, l)| l + haste.bonus(ahead(token), speed) as f32).collect()
    }

    /// Encodes the steps of some episodes.
    fn encode(&self, group: &mut [&mut &mut DecodingState<'_, '_>], cached: bool) -> Encoded {
        let config = &self.policy.config;
        let layers = config.agent_layers;
        let blocks = self.networks().count() * layers;
        let (mut maps, mut past) = (RowCollector::default(), RowCollector::default());
        let (mut scenes, mut rows) = (Vec::new(), 0);
        let nodes: usize = group.iter().flat_map(|p| p.steps.iter().map(|s| s.slots.len())).sum();
        let mut standing: Vec<Vec<Tensor<2>>> = vec![Vec::new(); blocks];
        let mut stand = nodes;
        for p in group {
            let places = maps.add(&p.memory.map);
            if cached {
                p.renumber_past(&mut past);
            }
            let earlier = if cached { 0 } else { rows };
            rows += p.steps.iter().map(|s| s.slots.len()).sum::<usize>();
            scenes.push((p.steps.as_slice(), SceneRows { places, earlier, standing: stand }));
            stand += p.standing.bodies.len();
            for (all, own) in standing.iter_mut().zip(&p.standing.features) {
                all.push(own.clone());
            }
        }
        let standing: Option<Vec<Tensor<2>>> =
            (stand > nodes).then(|| standing.into_iter().map(|all| Tensor::cat(all, 0)).collect());
        let rows = NodeRows::of(&scenes, config);
        let noted = self.notes.is_some().then(|| rows.clone());
        let nodes = rows.tensors(config, &self.device);
        let empty = || Tensor::zeros([0, config.hidden], &self.device);
        let none = || vec![empty(); blocks];
        let maps = maps.joined().unwrap_or_else(none);
        let past = past.joined().unwrap_or_else(none);
        let encode = |number: usize, network: &Network| {
            let own = number * layers..(number + 1) * layers;
            let past = if cached { PastNodes::Cached(&past[own.clone()]) } else { PastNodes::Here };
            let standing = standing.as_ref().map(|standing| &standing[own.clone()]);
            network.encode(&nodes, &maps[own], &past, standing)
        };
        let mut encoding = encode(0, &self.policy.network);
        let noted = self.notes.as_ref().zip(noted).map(|(notes, rows)| {
            let sources = Sources {
                past: if cached { past[..layers].to_vec() } else { encoding.entering.clone() },
                places: maps[..layers].to_vec(),
                agents: encoding.agents.clone(),
            };
            let reference = encode(1, &notes.reference);
            encoding.entering.extend(reference.entering);
            encoding.meeting.extend(reference.meeting);
            (rows, sources, reference.nodes)
        });
        Encoded { nodes, encoding, noted }
    }
}

/// A forward pass of some episodes.
struct Encoded {
    nodes: NodeTensors,
    /// Of the network; what is remembered is that of all networks.
    encoding: Encoding,
    /// If there are notes: the nodes, what they attend to, and their features in the reference network.
    noted: Option<(NodeRows, Sources, Tensor<2>)>,
}

/// Motion of the agents of an episode in half a second.
#[derive(Default)]
struct Moved {
    /// Rows of the newest step whose agents stand from here on; none unless this is the last executed half
    /// second.
    stood: Vec<usize>,
    /// The tokens that were drawn, with the rows of the newest step.
    drawn: Vec<(usize, Drawn)>,
}

impl DecodingState<'_, '_> {
    /// Prepares the network input for the `token`-th half second: the newest step alone if the earlier
    /// ones are remembered, else all steps.
    fn prepare_steps(&mut self, token: usize, config: &Config) {
        let now = self.episode.seen.frame() + token * TOKEN_FRAMES;
        let frames = earlier_frames(now, config.past);
        let EpisodeMemory { linked, chooser, remembered, resting, next_frame, heights, .. } =
            &mut self.memory;
        let observed = ObservedEpisode { seen: &self.episode.seen, recent: &self.recent, heights };
        let around = &mut Surroundings { places: &linked.places, chooser };
        let known: Vec<usize> = remembered.iter().map(|r| r.frame).collect();
        let fresh = token > 0 || *next_frame == now;
        if fresh && known == frames {
            if token == 0 {
                self.standing = std::mem::take(resting);
                self.standing.retain_standing(&self.recent.all);
            }
            self.earlier = remembered.iter().flat_map(|r| r.nodes.iter().copied()).collect();
            let (step, bodies) = observed.step(&self.standing.bodies, now, around, &self.earlier, config);
            (self.steps, self.bodies) = (vec![step], bodies);
        } else {
            *resting = Standing::default();
            remembered.clear();
            self.earlier.clear();
            let all: Vec<usize> = frames.into_iter().chain([now]).collect();
            self.standing = Standing::default();
            (self.steps, self.bodies) = observed.steps(&all, around, config);
        }
    }

    /// Adds the remembered steps to those of other episodes, and links the newest step to their rows there.
    fn renumber_past(&mut self, past: &mut RowCollector) {
        let mut rows = Vec::with_capacity(self.earlier.len());
        for remembered in &self.memory.remembered {
            let first = past.add(&remembered.entering) as u32;
            rows.extend(first..first + remembered.nodes.len() as u32);
        }
        self.steps.iter_mut().for_each(|step| step.past.renumber(&rows));
    }

    /// Draws a token for every agent of the newest step and executes it.
    fn move_agents(
        &mut self,
        simulator: &ReactiveSimulator,
        logits: &[Vec<f32>],
        token: usize,
        executor: &mut Executor,
    ) -> Moved {
        let mut moved = Moved::default();
        let (from, episode) = (self.episode.seen.frame() + token * TOKEN_FRAMES, self.memory.number);
        let Some(newest) = self.steps.last() else { return moved };
        let agents = &self.episode.seen.start().agents;
        let av_next = self.episode.seen.av_next().filter(|_| token == 0);
        let RecentTracks { first, all, shown } = &mut self.recent;
        let at = from - *first;
        let backed = self.memory.reversals;
        let traffic = simulator.driving.keep_clear.then(|| Traffic::at(agents, all, at, av_next, backed));
        let last_executed = is_last_executed(&self.episode.plan, token);
        for (row, ((&slot, &class), logits)) in
            newest.slots.iter().zip(&newest.classes).zip(logits).enumerate()
        {
            let agent = &agents[slot];
            let track = &mut all[slot];
            let hasty = simulator.haste.filter(|_| class == Class::Vehicle).map(|haste| {
                let speed = track.last().copied().flatten().map_or(0.0, |s| s.forward_speed());
                simulator.hasten(haste, logits, speed)
            });
            let logits = hasty.as_deref().unwrap_or(logits);
            match simulator.driving.sampling.draw_first(logits, self.episode.stream) {
                Some(order) => {
                    let drawn = Drawn { episode, slot, frame: from, class, token: order[0] };
                    moved.drawn.push((row, drawn));
                    let poses = |token: usize| simulator.policy.vocabulary.poses(class, token);
                    let tokens = order.iter().map(|&token| poses(token));
                    executor.execute_clear(agent, slot, class, tokens, traffic.as_ref(), track);
                    let departs = |token| sets_off(poses(token)[TOKEN_FRAMES].position.norm());
                    let departure = || simulator.driving.sampling.probability(logits, &order, departs);
                    // The AV keeps its tokens: others react to them.
                    if last_executed && slot != 0 && stands(track, departure) {
                        moved.stood.push(row);
                    }
                }
                None => {
                    *self.episode.outcomes.entry(NOT_FINITE).or_default() += 1;
                    executor.execute(agent, class, &straight_token(track), track);
                }
            }
        }
        self.standing.stay(all);
        // Absent agents stay absent.
        for (track, shown) in all.iter_mut().zip(shown) {
            track.resize(at + 1 + TOKEN_FRAMES, None);
            shown.extend_from_slice(&track[shown.len()..]);
        }
        moved
    }

    /// Takes agents to stand from here on, and in the next plan if they rest, given by rows of the newest
    /// step, which begins at row `first` of the features `meeting`.
    fn stand(&mut self, stood: &[usize], meeting: &[Tensor<2>], first: usize, rest: bool) {
        if let Some(newest) = self.steps.last().filter(|_| !stood.is_empty()) {
            let stands = Standing::of(stood, &newest.slots, &self.bodies, meeting, first);
            self.standing.extend(&stands);
            if rest {
                self.memory.resting = stands;
            }
        }
    }

    /// Remembers the features that later steps attend to: the next of `entering`, one per step.
    fn remember(&mut self, entering: &mut impl Iterator<Item = SharedRows>, token: usize, config: &Config) {
        for (step, entering) in self.steps.iter().zip(entering) {
            let (frame, nodes) = (step.frame, step.here.clone());
            self.memory.remembered.push(StepMemory { frame, nodes, entering });
        }
        let surplus = self.memory.remembered.len().saturating_sub(config.past);
        self.memory.remembered.drain(..surplus);
        if token == 0 {
            self.observed.clone_from(&self.memory.remembered);
        }
    }
}

/// Returns whether a plan is executed up to the end of its `token`-th half second.
fn is_last_executed(plan: &JointPlan, token: usize) -> bool {
    let executed = plan.executed();
    (executed..executed + TOKEN_FRAMES).contains(&((token + 1) * TOKEN_FRAMES))
}

/// Returns the token that keeps speed and heading of the last state for half a second.
fn straight_token(track: &[Frame]) -> super::super::tokens::TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    if let Some(Some(state)) = track.last() {
        let speed = state.forward_speed();
        for (k, pose) in poses.iter_mut().enumerate() {
            pose.position.x = speed * reactsim_scene::DT * k as f64;
        }
    }
    poses
}
