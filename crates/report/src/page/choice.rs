//! Choice of the scenes of a page that does not hold all of them.

use std::collections::BTreeMap;

use serde::Serialize;

use super::PageError;
use super::gallery::{Gallery, Subject};
use crate::{Run, table};

/// Metrics by which simulators are contrasted, most important first.
const CONTRAST_METRICS: [&str; 4] = ["aav-collision", "aav-ttc", "aa-collision", "offroad"];
/// Metric whose events are collisions with the AV.
const COLLISION: &str = CONTRAST_METRICS[0];

/// Scenario of the first screen: the AV is hit with one simulator and not with another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Lead {
    pub(super) scenario: usize,
    /// Subject that collides.
    left: usize,
    /// Subject that does not.
    right: usize,
}

impl Gallery {
    /// Returns the numbers of at most `count` scenarios with a scene, in increasing order. Prefers
    /// scenarios in which simulators differ most, taking the categories in turn.
    pub(super) fn choose(&self, count: usize) -> Vec<usize> {
        let mut queues: BTreeMap<Option<&str>, Vec<(f64, usize)>> = BTreeMap::new();
        for (index, scenario) in self.scenarios.iter().enumerate().filter(|(i, _)| self.has_scene(*i)) {
            let queue = queues.entry(scenario.category.as_deref()).or_default();
            queue.push((self.contrast(index), index));
        }
        for queue in queues.values_mut() {
            queue.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        }
        let longest = queues.values().map(Vec::len).max().unwrap_or(0);
        let in_turn = (0..longest).flat_map(|rank| queues.values().filter_map(move |q| q.get(rank)));
        let mut chosen: Vec<usize> = in_turn.take(count).map(|(_, index)| *index).collect();
        chosen.sort_unstable();
        chosen
    }

    /// Returns the scenario with the clearest difference between the first two simulators: one hits the AV, the
    /// other one does not. If they do not differ in any scenario with a scene, the first other pair that does
    /// takes their place.
    ///
    /// # Errors
    /// [`PageError`] if events cannot be read.
    pub(super) fn lead(&self) -> Result<Option<Lead>, PageError> {
        let runs: Vec<Run<'_>> =
            self.runs.iter().map(|r| Run { name: &r.name, summary: r.finished.summary() }).collect();
        // Other AVs and settings make other scenarios.
        let groups = table::groups(&runs);
        let pairs = (0..self.subjects.len()).flat_map(|second| (0..second).map(move |first| (first, second)));
        for (left, right) in pairs.flat_map(|(first, second)| [(first, second), (second, first)]) {
            let (hitting, other) = (&self.subjects[left], &self.subjects[right]);
            if groups[hitting.run] != groups[other.run] {
                continue;
            }
            let mut found: Vec<(i64, usize)> = (0..self.scenarios.len())
                .filter(|&index| self.has_scene(index))
                .filter_map(|index| Some((self.blur(index, hitting, other)?, index)))
                .collect();
            found.sort_unstable();
            for (_, scenario) in found {
                // Scenes have the first rollout only.
                if self.collides_first(scenario, hitting)? {
                    return Ok(Some(Lead { scenario, left, right }));
                }
            }
        }
        Ok(None)
    }

    /// Returns how unclear the difference is between a simulator that hits the AV and one that does not; `None`
    /// if there is no such difference, or one of them has no rollout.
    fn blur(&self, index: usize, left: &Subject, right: &Subject) -> Option<i64> {
        let count = |subject: &Subject, metric: &str| {
            let place = self.scenarios[index].places[subject.run]?;
            let finished = &self.runs[subject.run].finished;
            let done = finished.keeps_rollouts() && finished.tally().has(place, subject.simulator);
            done.then(|| i64::from(finished.counted(place, subject.simulator, metric)))
        };
        let hits = count(left, COLLISION)?;
        if hits == 0 || count(right, COLLISION)? > 0 {
            return None;
        }
        // One collision is clearer than several. Risky approaches and other faults blur the reaction.
        let faults =
            CONTRAST_METRICS[1..].iter().filter(|metric| count(right, metric).is_some_and(|n| n > 0));
        Some(10 * i64::try_from(faults.count()).ok()? + (hits - 1))
    }

    /// Returns whether the AV is hit in the first rollout of a simulator.
    fn collides_first(&self, index: usize, subject: &Subject) -> Result<bool, PageError> {
        let Some(place) = self.scenarios[index].places[subject.run] else { return Ok(false) };
        let events = self.runs[subject.run].finished.events(place, subject.simulator)?;
        Ok(events.iter().any(|event| event.rollout == 0 && event.counted && event.metric == COLLISION))
    }

    /// Returns how much the simulators other than oracles differ in a scenario.
    fn contrast(&self, index: usize) -> f64 {
        let mut weight = 1.0;
        let mut contrast = 0.0;
        for metric in CONTRAST_METRICS {
            let counts = self.subjects.iter().filter(|s| !s.marks.is_oracle()).filter_map(|subject| {
                let place = self.scenarios[index].places[subject.run]?;
                let finished = &self.runs[subject.run].finished;
                let done = finished.tally().has(place, subject.simulator);
                done.then(|| finished.counted(place, subject.simulator, metric) > 0)
            });
            let (with, all) = counts.fold((0.0, 0.0), |(with, all), hit| (with + f64::from(hit), all + 1.0));
            if all > 0.0 {
                // Largest if half of the simulators have an event.
                let share: f64 = with / all;
                contrast += weight * share * (1.0 - share);
            }
            weight *= 0.25;
        }
        contrast
    }
}
