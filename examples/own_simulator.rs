//! Evaluates a simulator that is written here next to two baselines.
//!
//! ```sh
//! cargo run --release --example own_simulator
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use reactsim::Benchmark;
use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{AgentState, DT, Start};

/// Every agent keeps its velocity until the AV is close ahead, then brakes.
struct Cautious {
    /// Distance to the AV below which an agent brakes, m.
    distance: f64,
    /// Deceleration, m/s².
    deceleration: f64,
}

impl SingleEpisode for Cautious {
    // Nothing is remembered between plans.
    type Memory = ();

    fn id(&self) -> &'static str {
        "cautious"
    }

    fn begin(&self, _start: &Start, _stream: &mut Stream) {}

    fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let av = episode.seen.state(0);
        for agent in 1..episode.plan.agents() {
            let Some(mut state) = episode.seen.state(agent) else { continue };
            let is_near = av.is_some_and(|av| {
                let to_av = av.position() - state.position();
                to_av.norm() < self.distance && to_av.dot(&state.velocity().unwrap_or_default()) > 0.0
            });
            for step in 0..episode.plan.steps() {
                let velocity = state.velocity().unwrap_or_default();
                let speed = velocity.norm();
                let lost = if is_near { self.deceleration * DT } else { 0.0 };
                let next = if speed > lost { velocity * ((speed - lost) / speed) } else { velocity * 0.0 };
                let p = state.position() + next * DT;
                state = AgentState { x: p.x, y: p.y, vx: next.x, vy: next.y, ..state };
                episode.plan.set(agent, step, Some(state));
            }
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let results = Benchmark::shipped()
        .baselines(["log-replay", "idm"])
        .simulator("cautious", Cautious { distance: 15.0, deceleration: 4.0 })
        .run()?;
    print!("{}", results.table());
    Ok(())
}
