//! Choice of the scenes of a page that does not hold all of them.

use std::collections::BTreeMap;

use super::gallery::Gallery;

/// Metrics by which simulators are contrasted, most important first.
const CONTRAST_METRICS: [&str; 4] = ["aav-collision", "aav-ttc", "aa-collision", "offroad"];

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

    /// Returns how much the simulators other than oracles differ in a scenario.
    fn contrast(&self, index: usize) -> f64 {
        let mut weight = 1.0;
        let mut contrast = 0.0;
        for metric in CONTRAST_METRICS {
            let counts = self.subjects.iter().filter(|s| !s.standing.is_oracle()).filter_map(|subject| {
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
