//! Choice of the scenes of a page that does not hold all of them.

use std::collections::BTreeMap;

use reactsim_evaluation::PlannedAv;
use serde::Serialize;

use super::PageError;
use super::gallery::{Gallery, Subject};
use crate::{Run, table};

/// Metrics by which simulators are contrasted, most important first.
const CONTRAST_METRICS: [&str; 4] = ["aav-collision", "aav-ttc", "aa-collision", "offroad"];
/// Metric whose events are collisions with the AV.
const COLLISION: &str = CONTRAST_METRICS[0];

/// Scores of the AV, in the order of preference.
const SCORES: [&str; 2] = ["av-score", "av-score-partial"];
/// Metric of collisions that are the fault of the AV: 1 without one.
const FAULT: &str = "av-at-fault-collisions";
/// Least change of a score that is shown on the first screen.
const LEAST_CHANGE: f64 = 0.05;

/// Baselines whose agents take no notice of the AV.
const UNREACTIVE: [&str; 3] = ["constant-velocity", "stop", "log-replay"];

/// Returns whether agents of the simulator with this id can react to the AV: a stage behind a baseline keeps
/// them clear of it.
pub(super) fn reacts(id: &str) -> bool {
    id.contains('+') || !UNREACTIVE.contains(&id.split('@').next().unwrap_or(id))
}

/// Scenario of the first screen: the AV is hit with one simulator and not with another one, which can react,
/// or the verdict on a planner depends on the simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Lead {
    pub(super) scenario: usize,
    /// Subject that collides, or with which the planner is worse.
    left: usize,
    /// The other subject.
    right: usize,
    /// Whether it is about a planner.
    judged: bool,
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

    /// Returns the scenario in which the simulator changes the verdict on a planner most. Without one,
    /// returns the scenario with the clearest difference between the first two simulators: one hits the AV,
    /// the other one, which can react, does not. If they do not differ in any scenario with a scene, the
    /// first other pair that does takes their place.
    ///
    /// # Errors
    /// [`PageError`] if events cannot be read.
    pub(super) fn lead(&self) -> Result<Option<Lead>, PageError> {
        if let Some(lead) = self.planner_lead()? {
            return Ok(Some(lead));
        }
        let runs: Vec<Run<'_>> =
            self.runs.iter().map(|r| Run { name: &r.name, summary: r.finished.summary() }).collect();
        // Other AVs and settings make other scenarios.
        let groups = table::groups(&runs);
        let pairs = (0..self.subjects.len()).flat_map(|second| (0..second).map(move |first| (first, second)));
        for (left, right) in pairs.flat_map(|(first, second)| [(first, second), (second, first)]) {
            let (hitting, other) = (&self.subjects[left], &self.subjects[right]);
            if groups[hitting.run] != groups[other.run] || !reacts(&other.id) {
                continue;
            }
            let mut found: Vec<(i64, usize)> = (0..self.scenarios.len())
                .filter(|&index| self.has_scene(index))
                .filter_map(|index| Some((self.blur(index, hitting, other)?, index)))
                .collect();
            found.sort_unstable();
            for (_, scenario) in found {
                // Scenes have the first rollout only.
                if self.is_first(scenario, hitting, COLLISION)? {
                    return Ok(Some(Lead { scenario, left, right, judged: false }));
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

    /// Returns the scenario in which the verdict on a planner other than the log depends most on the
    /// simulator; external planners, which are the user's own, and collisions for which the AV is at fault
    /// come first.
    fn planner_lead(&self) -> Result<Option<Lead>, PageError> {
        let is_judged = |subject: &Subject| {
            let finished = &self.runs[subject.run].finished;
            finished.keeps_rollouts() && self.planner(subject).is_some_and(|planner| planner != "log")
        };
        let judged: Vec<usize> = (0..self.subjects.len()).filter(|&i| is_judged(&self.subjects[i])).collect();
        let mut found: Vec<((bool, bool), f64, Lead)> = Vec::new();
        for scenario in (0..self.scenarios.len()).filter(|&index| self.has_scene(index)) {
            for (&left, &right) in
                judged.iter().flat_map(|left| judged.iter().map(move |right| (left, right)))
            {
                let [worse, better] = [left, right].map(|i| &self.subjects[i]);
                if worse.run != better.run {
                    continue;
                }
                if let Some((is_fault, change)) = self.verdict(scenario, worse, better)
                    && change >= LEAST_CHANGE
                {
                    let is_own = self.planner(worse).is_some_and(PlannedAv::is_external);
                    found.push(((is_own, is_fault), change, Lead { scenario, left, right, judged: true }));
                }
            }
        }
        found.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)));
        for ((_, is_fault), _, lead) in found {
            // Scenes have the first rollout only.
            if !is_fault || self.is_first(lead.scenario, &self.subjects[lead.left], FAULT)? {
                return Ok(Some(lead));
            }
        }
        Ok(None)
    }

    /// Returns the planner that drives the AV of a subject.
    fn planner(&self, subject: &Subject) -> Option<&str> {
        self.runs[subject.run].finished.summary().provenance.run.settings.planner()
    }

    /// Returns whether the AV is at fault for a collision with the first simulator only, and by how much its
    /// score is larger with the second one; `None` without the scores.
    fn verdict(&self, index: usize, worse: &Subject, better: &Subject) -> Option<(bool, f64)> {
        let is_fault = |subject: &Subject| self.value(index, subject, FAULT).is_some_and(|value| value < 1.0);
        let of = |score: &&str| Some(self.value(index, better, score)? - self.value(index, worse, score)?);
        Some((is_fault(worse) && !is_fault(better), SCORES.iter().find_map(of)?))
    }

    /// Returns the largest difference of the scores of one planner between simulators in a scenario; 0
    /// without planners.
    fn spread(&self, index: usize) -> f64 {
        let mut ranges: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        for subject in self.subjects.iter().filter(|subject| self.planner(subject).is_some()) {
            let score = SCORES.iter().find_map(|score| self.value(index, subject, score));
            let Some(score) = score else { continue };
            let range = ranges.entry(subject.run).or_insert((score, score));
            *range = (range.0.min(score), range.1.max(score));
        }
        ranges.values().map(|(low, high)| high - low).fold(0.0, f64::max)
    }

    fn value(&self, index: usize, subject: &Subject, metric: &str) -> Option<f64> {
        let place = self.scenarios[index].places[subject.run]?;
        let tally = self.runs[subject.run].finished.tally();
        let cell = tally.entries.get(&place)?.cells.get(subject.simulator)?.as_ref()?;
        cell.values[tally.metric(metric)?]
    }

    /// Returns whether the first rollout of a simulator has a counted event of a metric.
    fn is_first(&self, index: usize, subject: &Subject, metric: &str) -> Result<bool, PageError> {
        let Some(place) = self.scenarios[index].places[subject.run] else { return Ok(false) };
        let events = self.runs[subject.run].finished.events(place, subject.simulator)?;
        Ok(events.iter().any(|event| event.rollout == 0 && event.counted && event.metric == metric))
    }

    /// Returns how much the simulators other than oracles differ in a scenario; first of all in the scores of
    /// planners.
    fn contrast(&self, index: usize) -> f64 {
        let mut weight = 1.0;
        let mut contrast = self.spread(index);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agents_that_follow_a_fixed_path_do_not_react() {
        for id in ["constant-velocity", "stop", "log-replay", "stop@mine"] {
            assert!(!reacts(id), "{id}");
        }
        for id in ["idm", "idm@styles", "constant-velocity+qp", "mix:idm=1+ntp-guarded=1", "stopping"] {
            assert!(reacts(id), "{id}");
        }
    }
}
