//! Lets a planner that is written here drive the AV, among two simulators, judged by nuPlan's metrics.
//!
//! ```sh
//! cargo run --release --example own_planner
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use reactsim::Benchmark;
use reactsim::geometry::{direction, left};
use reactsim::planning::planner::{Planner, PlannerInput};
use reactsim::planning::{PlanningError, Trajectory};
use reactsim::scene::DT;

/// Keeps the heading, and brakes as soon as an object is ahead within a time headway.
struct Careful {
    /// Time headway, s.
    headway: f64,
}

impl Planner for Careful {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let (ego, center) = (input.ego(), input.ego().center(input.shape));
        let forward = direction(ego.heading);
        let range = input.shape.length + self.headway * ego.speed();
        let is_ahead = input.objects().iter().any(|object| {
            let to_object = object.center - center;
            let (ahead, aside) = (to_object.dot(&forward), to_object.dot(&left(forward)));
            (0.0..range).contains(&ahead) && aside.abs() < input.shape.width
        });
        let deceleration = if is_ahead { 4.0 } else { 0.0 };
        let (mut speed, mut s) = (ego.speed(), 0.0);
        let mut pose = || {
            speed = (speed - deceleration * DT).max(0.0);
            s += speed * DT;
            let next = center + forward * s;
            [next.x, next.y, ego.heading]
        };
        let poses: Vec<[f64; 3]> = (0..40).map(|_| pose()).collect();
        Ok(Trajectory::through_centers(&poses, ego, input.shape)?)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let results = Benchmark::shipped()
        .limit(20)
        .baselines(["log-replay", "idm"])
        .planner("careful", || Box::new(Careful { headway: 2.0 }))
        .run()?;
    print!("{}", results.table());
    Ok(())
}
