//! The scenarios on which the laws are tested, and the report of breaches.

use std::sync::LazyLock;

use rayon::prelude::*;
use reactsim::generation::maps::{MAP_TYPES, ON_REQUEST};
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::scene::{AgentKind, DT, FRAMES, LoggedAgent, Scenario};

/// Number of scenarios per map type in the sample, for benchmarks and for training sets. More scenarios show
/// rarer breaches.
const EACH: [u64; 2] = [12, 3];
/// The same number for map types that no preset contains.
const EACH_ON_REQUEST: u64 = 12;

static SAMPLE: LazyLock<Vec<Generated>> = LazyLock::new(|| {
    let types = MAP_TYPES.len() as u64;
    let bench = (0..EACH[0] * types).map(|number| (Preset::Bench, Vec::new(), number));
    // Training sets draw the type by weight; here each type is requested.
    let train = (0..EACH[1] * types)
        .map(|number| (Preset::Train, vec![MAP_TYPES[(number % types) as usize].id.to_owned()], number));
    let on_request = ON_REQUEST.iter().zip(1..).flat_map(|(kind, block)| {
        let numbers = 1000 * block..1000 * block + EACH_ON_REQUEST;
        numbers.map(|number| (Preset::Train, vec![kind.id.to_owned()], number))
    });
    let all: Vec<_> = bench.chain(train).chain(on_request).collect();
    all.into_par_iter()
        .map(|(preset, maps, number)| {
            let settings = GenerationSettings { preset, maps, ..GenerationSettings::default() };
            Generated::new(Generator::new(settings).unwrap().scenario(number).unwrap())
        })
        .collect()
});

pub(super) struct Generated {
    pub(super) scenario: Scenario,
    /// All agents with their whole tracks: the AV, the world agents, and those that come later or are too
    /// many.
    pub(super) everybody: Vec<LoggedAgent>,
}

impl Generated {
    fn new(scenario: Scenario) -> Self {
        let chosen = scenario.start.agents.iter().enumerate();
        let chosen = chosen.map(|(i, agent)| LoggedAgent {
            agent: agent.clone(),
            track: scenario.logged(i),
            heights: logged_heights(&scenario, i),
        });
        let everybody: Vec<LoggedAgent> = chosen.chain(scenario.unselected.iter().cloned()).collect();
        assert!(everybody.iter().all(|a| a.track.len() == FRAMES));
        Self { scenario, everybody }
    }

    /// Returns vehicles and cyclists.
    pub(super) fn on_wheels(&self) -> impl Iterator<Item = &LoggedAgent> {
        self.everybody.iter().filter(|a| matches!(a.agent.kind, AgentKind::Vehicle | AgentKind::Cyclist))
    }
}

/// Returns the height of an agent of the start at each frame, metres; empty in scenarios of one level.
pub(super) fn logged_heights(scenario: &Scenario, agent: usize) -> Vec<Option<f64>> {
    if !scenario.start.has_levels() {
        return Vec::new();
    }
    [scenario.start.heights[agent].as_slice(), &scenario.log_future.heights[agent]].concat()
}

/// Returns whether an agent never drives.
pub(super) fn parked(agent: &LoggedAgent) -> bool {
    agent.agent.id.starts_with("parked-")
}

/// Largest number of breaches in a report.
const TOLD: usize = 60;

pub(super) fn sample() -> &'static [Generated] {
    &SAMPLE
}

/// Breaches of a law in one scenario.
pub(super) struct Breaches {
    scenario: String,
    found: Vec<String>,
    judged: usize,
}

impl Breaches {
    /// Counts an agent that was in a position to break the law.
    pub(super) fn judge(&mut self) {
        self.judged += 1;
    }

    /// Notes the agent that broke the law, and the time.
    pub(super) fn note(&mut self, who: &str, frame: usize, what: impl std::fmt::Display) {
        self.found.push(format!("{}: {who} at {:.1} s: {what}", self.scenario, frame as f64 * DT));
    }
}

/// Requires that every scenario of the sample obeys a law; otherwise reports all breaches, at most [`TOLD`].
/// Returns how often an agent was in a position to break it.
#[track_caller]
pub(super) fn obeyed(law: impl Fn(&Generated, &mut Breaches) + Sync) -> usize {
    let judge = |generated: &Generated| {
        let scenario = format!("{} ({})", generated.scenario.id, generated.scenario.source);
        let mut breaches = Breaches { scenario, found: Vec::new(), judged: 0 };
        law(generated, &mut breaches);
        breaches
    };
    let all: Vec<Breaches> = sample().par_iter().map(judge).collect();
    let found: Vec<&str> = all.iter().flat_map(|b| b.found.iter().map(String::as_str)).collect();
    let told = &found[..found.len().min(TOLD)];
    assert!(found.is_empty(), "{} breaches:\n{}", found.len(), told.join("\n"));
    all.iter().map(|b| b.judged).sum()
}
