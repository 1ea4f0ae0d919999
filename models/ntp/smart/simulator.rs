//! The network as a simulator.

use burn::tensor::Device;
use reactsim_nn::is_host;
use reactsim_rollout::{Beginning, Episode, Memory, PlanError, Simulator};
use reactsim_scene::{FUTURE, Start};
use serde::{Deserialize, Serialize};

use super::super::beginnings::different_starts;
use super::super::execute::Executor;
use super::super::sampling::Sampling;
use super::observed::{Participant, identities, map_tokens};
use super::pending::{BegunMemory, EpisodeMemory, PendingPlan};
use super::{Agents, CachedScene, InputError, MapTokens, SmartPolicy, Step};

/// Parameters on the cards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmartParameters {
    /// Whether vehicles drive tokens within the limits of the benchmark; otherwise tokens are executed
    /// exactly.
    pub projection: bool,
    /// Radius of the known map around the AV's position at the current frame, metres.
    pub map_radius: f64,
    /// Height of all agents, metres; scenarios do not record it.
    pub height: f64,
    /// Settings for drawing tokens.
    pub sampling: Sampling,
}

/// Rows per forward pass on a graphics processor, agents or pieces of maps. A row of the published network of
/// 7 million parameters attends to up to 300 map tokens of 128 numbers, so that the largest tensor has 0.6
/// GB.
const MOST_ROWS: usize = 4096;

/// Simulator that moves agents by tokens drawn from the published network.
///
/// Every 0.5 s, the realized motion of agents and the AV is matched to tokens again, and the network
/// computes one more step on top of the cached earlier ones. If plans are not 0.5 s apart, there is one
/// chain of steps, 0.5 s apart, for each of the five frames at which it can begin: every plan sees steps
/// that end at the current frame, and no step is computed twice.
///
/// On a graphics processor the episodes of a batch go through the network together, up to 4096 agents at a
/// time. On processors they go one after the other: there it would save nothing, and last bits would depend
/// on the batch.
#[derive(Debug)]
pub struct SmartSimulator {
    id: &'static str,
    policy: SmartPolicy,
    parameters: SmartParameters,
    /// Rows per forward pass; a single episode may have more.
    most_rows: usize,
}

/// An episode that begins: its participants, and what the network reads of them and of the map.
struct Begun {
    participants: Vec<Participant>,
    agents: Agents,
    map: MapTokens,
}

impl SmartSimulator {
    /// Builds a simulator of this policy, under the id of its baseline.
    pub fn new(id: &'static str, policy: SmartPolicy, parameters: SmartParameters) -> Self {
        let device: Device = policy.tables.device();
        let most_rows = if is_host(&device) { 0 } else { MOST_ROWS };
        Self { id, policy, parameters, most_rows }
    }

    /// Returns the input of the network that does not change during an episode.
    fn begun(&self, start: &Start) -> Result<Begun, InputError> {
        let SmartPolicy { network, vocabulary, map_vocabulary, .. } = &self.policy;
        let participants = Participant::all(start, vocabulary);
        let map = map_tokens(start, map_vocabulary, self.parameters.map_radius);
        map.check(network.config())?;
        let agents = identities(start, &participants, self.parameters.height);
        agents.check()?;
        Ok(Begun { participants, agents, map })
    }

    /// Encodes the maps of episodes and starts their scenes, one memory per episode.
    fn start_scenes(&self, begun: Vec<Begun>) -> Vec<EpisodeMemory> {
        let SmartPolicy { network, tables, .. } = &self.policy;
        let mut memories = Vec::with_capacity(begun.len());
        for pass in passes(begun, self.most_rows, |b| b.map.len()) {
            let maps: Vec<&MapTokens> = pass.iter().map(|b| &b.map).collect();
            let maps = network.encode_maps(tables, &maps);
            let (participants, agents): (Vec<_>, Vec<_>) =
                pass.into_iter().map(|b| (b.participants, b.agents)).unzip();
            let scenes = network.begin_all(tables, maps.into_iter().zip(agents).collect());
            memories.extend(participants.into_iter().zip(scenes).map(|(p, s)| EpisodeMemory::new(p, s)));
        }
        memories
    }

    /// Returns the next steps of episodes, divided into forward passes. Episodes that the network cannot read
    /// fail and are left out.
    fn next_steps<'p, 'e>(
        &self,
        group: impl Iterator<Item = &'p mut PendingPlan<'e>>,
    ) -> Vec<Vec<(&'p mut PendingPlan<'e>, Step)>> {
        let stepped = group.filter_map(|p| p.next_step(&self.policy).map(|step| (p, step)));
        passes(stepped.collect(), self.most_rows, |(p, _)| p.agents())
    }

    /// Shows the network the next steps of episodes.
    fn advance<'p, 'e: 'p>(&self, group: impl Iterator<Item = &'p mut PendingPlan<'e>>) {
        for mut pass in self.next_steps(group) {
            self.policy.network.advance_all(&self.policy.tables, scenes(&mut pass));
        }
    }

    /// Plans the `token`-th half second of episodes.
    fn next_tokens<'p, 'e: 'p>(
        &self,
        group: impl Iterator<Item = &'p mut PendingPlan<'e>>,
        token: usize,
        executor: &mut Executor,
    ) {
        for mut pass in self.next_steps(group) {
            let scores = self.policy.network.step_all(&self.policy.tables, scenes(&mut pass));
            let width = scores.dims()[1];
            let scores: Vec<f32> = scores.into_data().iter::<f32>().collect();
            let mut row = 0;
            for (p, _) in pass {
                if token == 0 {
                    p.remember();
                }
                let own = &scores[row * width..];
                p.move_participants(own, width, &self.policy, &self.parameters.sampling, executor);
                row += p.agents();
            }
        }
    }
}

/// Returns the scenes of a forward pass with their steps.
fn scenes<'s>(pass: &'s mut [(&mut PendingPlan<'_>, Step)]) -> Vec<(&'s mut CachedScene, Step)> {
    pass.iter_mut().map(|(p, step)| (&mut p.scene, std::mem::take(step))).collect()
}

/// Divides items, in order, into groups of at most `most` rows together. An item with more rows is a group of
/// its own.
fn passes<T>(items: Vec<T>, most: usize, rows: impl Fn(&T) -> usize) -> Vec<Vec<T>> {
    let (mut groups, mut filled): (Vec<Vec<T>>, usize) = (Vec::new(), 0);
    for item in items {
        let own = rows(&item).max(1);
        match groups.last_mut().filter(|_| filled + own <= most) {
            Some(group) => group.push(item),
            None => {
                groups.push(vec![item]);
                filled = 0;
            }
        }
        filled += own;
    }
    groups
}

impl Simulator for SmartSimulator {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let (starts, of) = different_starts(batch);
        let begun: Vec<_> = starts.into_iter().map(|start| self.begun(start)).collect();
        let refused: Vec<Option<InputError>> = begun.iter().map(|b| b.as_ref().err().cloned()).collect();
        let mut memories = self.start_scenes(begun.into_iter().flatten().collect()).into_iter();
        let memory = |refused| match refused {
            Some(cause) => Some(Err(cause)),
            None => memories.next().map(Ok),
        };
        let memories: Vec<Option<BegunMemory>> = refused.into_iter().map(memory).collect();
        for (episode, of) in batch.iter_mut().zip(of) {
            episode.memory = memories[of].clone().map_or(Memory::NONE, Memory::new::<BegunMemory>);
        }
        Ok(())
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut pending: Vec<PendingPlan<'_>> =
            batch.iter_mut().filter_map(|episode| PendingPlan::of(self.id, episode)).collect();
        while pending.iter().any(PendingPlan::is_behind) {
            self.advance(pending.iter_mut().filter(|p| p.is_behind()));
        }
        let mut executor = Executor::new(self.parameters.projection);
        let mut token = 0;
        while pending.iter().any(|p| p.has(token)) {
            self.next_tokens(pending.iter_mut().filter(|p| p.has(token)), token, &mut executor);
            token += 1;
        }
        pending.into_iter().for_each(PendingPlan::finish);
        Ok(())
    }
}
