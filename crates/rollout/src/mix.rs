//! Mixed traffic: several simulators that each move a part of the agents.

use rand_chacha::rand_core::Rng;
use reactsim_scene::{Agent, AgentKind, Start};

use super::episode::{Beginning, Continuation, Episode, JointPlan, Memory, PlanError, Simulator};
use super::stream::Stream;

/// A simulator of a [`Mix`].
pub struct MixMember {
    /// The simulator.
    pub simulator: Box<dyn Simulator>,
    /// Share of the agents that it moves, relative to the shares of the other members.
    pub share: f64,
    /// Classes of which it moves all agents; shares do not apply to them.
    pub kinds: Vec<AgentKind>,
}

/// A simulator of mixed traffic: each agent is drawn to one of several simulators for the whole rollout.
///
/// Every member plans all agents from the realised states of all agents; an agent executes the plan of the
/// member to which it is drawn. A member that moves no agent of an episode does not plan in it. Each member
/// has its own copy of the random streams of the rollout, so that a mix of one simulator makes exactly the
/// rollouts of that simulator. The outcomes of the plans of all members are added up.
pub struct Mix {
    members: Vec<MixMember>,
    /// Sum of the shares.
    total: f64,
}

/// Id in messages.
const ID: &str = "mix";

/// Memory of an episode.
struct EpisodeMemory {
    /// Index of the member that moves each agent.
    movers: Vec<usize>,
    members: Vec<MemberMemory>,
}

/// Memory of a member in an episode.
struct MemberMemory {
    memory: Memory,
    /// Its copy of the stream for planning; `None` before its first plan.
    stream: Option<Stream>,
}

impl Mix {
    /// Creates a mix; `None` unless all shares are at least 0, and their sum is finite and above 0.
    pub fn new(members: Vec<MixMember>) -> Option<Self> {
        let total: f64 = members.iter().map(|member| member.share).sum();
        let are_shares = members.iter().all(|member| member.share >= 0.0);
        (are_shares && total.is_finite() && total > 0.0).then_some(Self { members, total })
    }

    /// Returns the member that moves each agent.
    fn draw(&self, start: &Start, stream: &Stream) -> Vec<usize> {
        let mut stream = stream.clone();
        // Simulators draw from number n itself; no two numbers 2n + 1 are equal, or numbers of changes.
        stream.set_stream(2 * stream.get_stream() + 1);
        let draw = |agent: &Agent| {
            // Every agent draws a number, so that the class of one does not shift the draws of others.
            let drawn = (stream.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            let of_kind = self.members.iter().position(|member| member.kinds.contains(&agent.kind));
            of_kind.unwrap_or_else(|| self.member_at(drawn))
        };
        start.agents.iter().map(draw).collect()
    }

    /// Returns the member at a number from 0 to 1 in the row of shares.
    fn member_at(&self, drawn: f64) -> usize {
        let mut left = drawn * self.total;
        let mut last = 0;
        for (index, member) in self.members.iter().enumerate().filter(|(_, member)| member.share > 0.0) {
            last = index;
            if left < member.share {
                break;
            }
            left -= member.share;
        }
        last
    }
}

/// Returns the beginning of an episode for a member.
fn again<'a>(beginning: &Beginning<'a>, simulator: &dyn Simulator) -> Beginning<'a> {
    let identity = beginning.identity.filter(|_| simulator.wants_identity());
    Beginning { identity, ..beginning.again() }
}

impl Simulator for Mix {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let memory = |episode: &Beginning<'_>| {
            let movers = self.draw(episode.start, &episode.stream);
            EpisodeMemory { movers, members: Vec::with_capacity(self.members.len()) }
        };
        let mut memories: Vec<EpisodeMemory> = batch.iter().map(memory).collect();
        let mut begun = Ok(());
        for MixMember { simulator, .. } in &self.members {
            let mut own: Vec<Beginning<'_>> =
                batch.iter().map(|episode| again(episode, simulator.as_ref())).collect();
            // Memories are given back to all members, even if one cannot begin.
            begun = begun.and(simulator.begin_batch(&mut own));
            for (all, own) in memories.iter_mut().zip(own) {
                all.members.push(MemberMemory { memory: own.memory, stream: None });
            }
        }
        for (episode, memory) in batch.iter_mut().zip(memories) {
            episode.memory = Memory::new(memory);
        }
        begun
    }

    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        let mut memories: Vec<EpisodeMemory> = Vec::with_capacity(batch.len());
        let mut before: Vec<Vec<Memory>> = self.members.iter().map(|_| Vec::new()).collect();
        for episode in batch.iter_mut() {
            let Some(old) = episode.before.take::<EpisodeMemory>() else {
                return Err(PlanError::ForeignMemory(ID));
            };
            let drawn = self.draw(episode.beginning.start, &episode.beginning.stream);
            let movers = episode.kept.iter().zip(drawn);
            let movers = movers.map(|(kept, drawn)| kept.map_or(drawn, |slot| old.movers[slot])).collect();
            let mut members = Vec::with_capacity(self.members.len());
            for (before, MemberMemory { memory, stream }) in before.iter_mut().zip(old.members) {
                before.push(memory);
                members.push(MemberMemory { memory: Memory::NONE, stream });
            }
            memories.push(EpisodeMemory { movers, members });
        }
        let mut continued = Ok(());
        for (index, (MixMember { simulator, .. }, before)) in self.members.iter().zip(before).enumerate() {
            let parts = batch.iter().zip(before);
            let mut own: Vec<Continuation<'_>> = parts
                .map(|(episode, before)| Continuation {
                    before,
                    kept: episode.kept,
                    beginning: again(&episode.beginning, simulator.as_ref()),
                })
                .collect();
            continued = continued.and(simulator.continue_batch(&mut own));
            for (all, own) in memories.iter_mut().zip(own) {
                all.members[index].memory = own.beginning.memory;
            }
        }
        for (episode, memory) in batch.iter_mut().zip(memories) {
            episode.beginning.memory = Memory::new(memory);
        }
        continued
    }

    fn horizon(&self) -> Option<usize> {
        self.members.iter().filter_map(|member| member.simulator.horizon()).min()
    }

    fn wants_identity(&self) -> bool {
        self.members.iter().any(|member| member.simulator.wants_identity())
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        let mut of_members: Vec<Vec<Memory>> = self.members.iter().map(|_| Vec::new()).collect();
        for memory in memories.into_iter().filter_map(|mut memory| memory.take::<EpisodeMemory>()) {
            of_members.iter_mut().zip(memory.members).for_each(|(all, own)| all.push(own.memory));
        }
        for (member, memories) in self.members.iter().zip(of_members) {
            member.simulator.end_batch(memories);
        }
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for (index, MixMember { simulator, .. }) in self.members.iter().enumerate() {
            let (mut inner, mut outer) = (Vec::with_capacity(batch.len()), Vec::with_capacity(batch.len()));
            for Episode { seen, memory, stream, moves_av, shares_traffic, plan, outcomes, error } in
                batch.iter_mut()
            {
                let Some(EpisodeMemory { movers, members }) = memory.get::<EpisodeMemory>() else {
                    *error = Some(PlanError::ForeignMemory(ID));
                    continue;
                };
                let moves = movers.iter().skip(usize::from(!*moves_av)).any(|mover| *mover == index);
                if !moves || error.is_some() {
                    continue;
                }
                let MemberMemory { memory, stream: own } = &mut members[index];
                inner.push(Episode {
                    seen: *seen,
                    memory,
                    stream: own.get_or_insert_with(|| stream.clone()),
                    moves_av: *moves_av,
                    shares_traffic: *shares_traffic || self.members.len() > 1,
                    plan: JointPlan::with_outlook(plan.agents(), plan.steps(), plan.executed()),
                    outcomes: Default::default(),
                    error: None,
                });
                outer.push((&*movers, plan, outcomes, error));
            }
            if inner.is_empty() {
                continue;
            }
            simulator.plan(&mut inner)?;
            for (own, (movers, plan, outcomes, error)) in inner.into_iter().zip(outer) {
                *error = own.error;
                for (outcome, count) in own.outcomes {
                    *outcomes.entry(outcome).or_default() += count;
                }
                for agent in (0..plan.agents()).filter(|agent| movers[*agent] == index) {
                    (0..plan.steps()).for_each(|step| plan.set(agent, step, own.plan.get(agent, step)));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
