//! Trains a small network on generated scenarios, and evaluates it next to two baselines.
//!
//! The network sets the speeds of agents; they keep their headings. Its input is what a driver needs to
//! follow another: the own speed, and gap and speed of the nearest agent ahead, which may be the AV.
//!
//! ```sh
//! cargo run --release --example train_small
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::{relu, tanh};
use burn::tensor::{Device, Tensor, TensorData};
use reactsim::Benchmark;
use reactsim::dynamics::{MAX_ACCELERATION, STANDSTILL_SPEED};
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::models::nn::device;
use reactsim::rollout::{self, PlanError, Planning, SingleEpisode};
use reactsim::scene::{AgentState, CURRENT, DT, FRAMES, Frame, Scenario, Start};
use reactsim::training::{Execution, Learner, Output, Settings, Source, Stream, Sums, Task, draw_parameters};

/// Largest gap that an agent reacts to, metres.
const RANGE: f64 = 50.0;
/// Half width of the strip in which agents are ahead, metres: half a lane.
const STRIP_HALF_WIDTH: f64 = 1.75;
/// Speed in m/s that is 1 in the features: inputs of a network should be of the order of 1.
const SPEED_UNIT: f64 = 15.0;
/// Number of frames over which the acceleration to learn is measured: one second, longer than noise.
const AHEAD: usize = 10;

/// The network: features of agents in, their accelerations out.
#[derive(Module, Debug)]
struct Follower {
    hidden: Linear,
    output: Linear,
}

impl Follower {
    /// Returns the accelerations [agents, 1] in m/s², which are always feasible.
    fn forward(&self, features: &[[f32; 3]]) -> Tensor<2> {
        let hidden = relu(self.hidden.forward(self.tensor(features)));
        tanh(self.output.forward(hidden)) * MAX_ACCELERATION
    }

    /// Returns rows of numbers as a tensor on the device of the network.
    fn tensor<const N: usize>(&self, rows: &[[f32; N]]) -> Tensor<2> {
        Tensor::from_data(TensorData::new(rows.concat(), [rows.len(), N]), &self.hidden.weight.device())
    }
}

/// Returns the features of an agent: own speed, gap and speed of the nearest agent ahead. A free road is one
/// with a fast agent far ahead. `None` if the agent is absent, or stood until the current frame: it is
/// parked, or waits for something that is not among the features.
fn features(start: &Start, states: &[Frame], agent: usize) -> Option<[f32; 3]> {
    let state = states[agent]?;
    start.history[agent].iter().flatten().find(|state| state.speed() > STANDSTILL_SPEED)?;
    let own = state.footprint(&start.agents[agent]);
    let (mut gap, mut speed) = (RANGE, SPEED_UNIT);
    for (other, there) in states.iter().enumerate().filter(|(other, _)| *other != agent) {
        let Some(there) = there else { continue };
        let place = own.to_local(there.position());
        let between = (place.x - own.half_length - 0.5 * start.agents[other].length).max(0.0);
        if place.x > 0.0 && place.y.abs() < STRIP_HALF_WIDTH && between < gap {
            (gap, speed) = (between, there.velocity().unwrap_or_default().dot(&own.axis));
        }
    }
    Some([state.forward_speed() / SPEED_UNIT, gap / RANGE, speed / SPEED_UNIT].map(|v| v as f32))
}

/// Training data: scenarios of the generator, shared by reference in every epoch.
struct Generated(Vec<Arc<Scenario>>);

impl Source for Generated {
    type Example = Arc<Scenario>;

    fn len(&self) -> usize {
        self.0.len()
    }

    fn id(&self, number: usize) -> &str {
        &self.0[number].id
    }

    fn read(&self, number: usize) -> Result<Arc<Scenario>, String> {
        Ok(Arc::clone(&self.0[number]))
    }

    fn digest(&self) -> String {
        self.0.iter().map(|scenario| scenario.digest()).collect()
    }
}

/// The task: predict the accelerations of all drivers in the log.
struct Imitation(Device);

impl Task for Imitation {
    type Example = Arc<Scenario>;
    /// Features and acceleration of every driver at every second.
    type Sample = Vec<([f32; 3], [f32; 1])>;
    type Model = Follower;

    fn init(&self, seed: u64) -> Follower {
        let device = self.0.clone().autodiff();
        let linear = |inputs, outputs| LinearConfig::new(inputs, outputs).init(&device);
        // Burn draws from random numbers that all threads share; these depend on the seed only.
        draw_parameters(Follower { hidden: linear(3, 32), output: linear(32, 1) }, seed, 1.0)
    }

    fn prepare(&self, scenario: &Arc<Scenario>, _: Option<&mut Stream>) -> Option<Self::Sample> {
        let logs: Vec<_> = (0..scenario.start.agents.len()).map(|agent| scenario.logged(agent)).collect();
        let mut sample = Vec::new();
        for frame in (CURRENT..FRAMES - AHEAD).step_by(AHEAD) {
            let states: Vec<Frame> = logs.iter().map(|log| log[frame]).collect();
            for (agent, log) in logs.iter().enumerate() {
                let Some(features) = features(&scenario.start, &states, agent) else { continue };
                let (Some(now), Some(later)) = (log[frame], log[frame + AHEAD]) else { continue };
                let acceleration = (later.forward_speed() - now.forward_speed()) / (AHEAD as f64 * DT);
                sample.push((features, [acceleration as f32]));
            }
        }
        (!sample.is_empty()).then_some(sample)
    }

    fn loss(&self, model: &Follower, samples: &[Self::Sample], _: Option<&mut Stream>) -> Output {
        let (inputs, targets): (Vec<_>, Vec<_>) = samples.iter().flatten().copied().unzip();
        let error = model.forward(&inputs) - model.tensor(&targets);
        Output::new(error.square().sum(), inputs.len() as f64, Sums::new())
    }
}

/// The simulator: agents accelerate as the network predicts.
struct Learned(Follower);

impl SingleEpisode for Learned {
    type Memory = ();

    fn id(&self) -> &'static str {
        "learned"
    }

    fn begin(&self, _: &Start, _: &mut rollout::Stream) {}

    fn plan_one(&self, _: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let start = episode.seen.start();
        let states: Vec<Frame> = (0..start.agents.len()).map(|agent| episode.seen.state(agent)).collect();
        let rows: Vec<_> = (0..states.len()).map(|agent| features(start, &states, agent)).collect();
        // All agents in one pass; agents without features have zeros.
        let inputs: Vec<[f32; 3]> = rows.iter().map(|row| row.unwrap_or_default()).collect();
        let accelerations = self.0.forward(&inputs).into_data_as::<f32>();
        for (agent, acceleration) in accelerations.iter::<f32>().enumerate() {
            let Some(mut state) = states[agent] else { continue };
            let gain = rows[agent].map_or(0.0, |_| f64::from(acceleration) * DT);
            let ahead = state.footprint(&start.agents[agent]).axis;
            let mut speed = state.forward_speed();
            for step in 0..episode.plan.steps() {
                speed = (speed + gain).max(0.0);
                let next = state.position() + ahead * (speed * DT);
                // The engine derives the velocity from the positions.
                state = AgentState { x: next.x, y: next.y, ..state };
                episode.plan.set(agent, step, Some(state));
            }
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let generator =
        Generator::new(GenerationSettings { preset: Preset::Train, ..GenerationSettings::default() })?;
    let scenarios = (0..24).map(|number| generator.scenario(number).map(Arc::new));
    let learner = Learner {
        task: &Imitation(device()),
        source: &Generated(scenarios.collect::<Result<_, _>>()?),
        settings: Settings {
            // 240 steps of 4 scenarios each.
            epochs: 40.0,
            batch: 4,
            together: 4,
            learning_rate: 0.01,
            held_out: 0.0,
            ..Settings::default()
        },
        execution: Execution { jobs: 1, checkpoint_every: Duration::MAX, keep_every: 0 },
        about: serde_json::Map::new(),
        closed_loop: None,
        observer: &(),
    };
    // Log, checkpoints and weights; choose a permanent folder to keep or resume a training.
    let folder = tempfile::tempdir()?;
    let outcome = learner.learn(folder.path(), false, &AtomicBool::new(false))?;
    println!("{} steps\n", outcome.steps);

    let results = Benchmark::shipped()
        .limit(10)
        .baselines(["idm", "constant-velocity"])
        // `valid` removes what only training needs.
        .simulator("learned", Learned(outcome.model.valid()))
        .run()?;
    print!("{}", results.table());
    Ok(())
}
