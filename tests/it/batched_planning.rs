//! Networks plan the episodes of a batch in common forward passes: each as if it were alone, but for
//! rounding.

use burn::tensor::Device;
use reactsim::models::nn::{Backend, check_backend, device, device_of};
use reactsim::models::ntp::reactive::ReactiveSimulator;
use reactsim::models::ntp::smart::{SmartParameters, SmartSimulator};
use reactsim::models::ntp::{Driving, Sampling};
use reactsim::rollout::{
    Beginning, Controller, Episode, Memory, PlanError, Rollout, RolloutError, Settings, Simulator, roll_out,
};
use reactsim::scene::Scenario;

use crate::ntp_reactive::scenarios;
use crate::scenes::{coasting, request};

const SAMPLING: Sampling = Sampling { top_k: 5, temperature: 1.0 };

/// Distance in metres below which positions count as equal: sums of other order differ by far less, another
/// token by far more.
const SAME_POSITION: f64 = 1e-3;

/// Returns the simulators on this device, with random weights.
fn simulators(device: &Device) -> [(&'static str, Box<dyn Simulator>); 2] {
    let driving = Driving { projection: true, keep_clear: true, sampling: SAMPLING };
    let parameters = SmartParameters { projection: true, map_radius: 60.0, height: 1.8, sampling: SAMPLING };
    let reactive = ReactiveSimulator::new(crate::ntp_reactive::policy(device), driving, device.clone());
    let smart = SmartSimulator::new("smart", crate::smart_simulator::policy(device), parameters);
    [("reactive", Box::new(reactive)), ("smart", Box::new(smart))]
}

/// Returns devices on which networks are operations of a backend, not the code of this crate for processors:
/// a graphics processor if there is one, and others with gradients.
#[cfg_attr(feature = "ndarray", expect(deprecated, reason = "burn-ndarray is kept for comparison"))]
fn devices() -> Vec<Device> {
    let mut devices = vec![
        device().autodiff(),
        #[cfg(feature = "ndarray")]
        Device::ndarray().autodiff(),
    ];
    for backend in Backend::ALL.iter().copied().filter(|backend| backend.is_gpu()) {
        match check_backend(backend) {
            Ok(()) => devices.push(device_of(backend)),
            Err(error) => crate::skipped(&format!("no graphics processor: {error}")),
        }
    }
    devices
}

fn run(simulator: &Controller, batch: &[Scenario]) -> Vec<Result<Rollout, RolloutError>> {
    let requests = batch.iter().map(|s| request(s, coasting(s), 0)).collect();
    roll_out(requests, simulator, &Settings::default())
}

/// Returns the share of equal positions of two rollouts.
fn agreement(a: &Rollout, b: &Rollout) -> f64 {
    let (mut equal, mut all) = (0, 0);
    for (a, b) in a.tracks.iter().flatten().zip(b.tracks.iter().flatten()) {
        assert_eq!(a.is_some(), b.is_some());
        if let (Some(a), Some(b)) = (a, b) {
            all += 1;
            equal += usize::from((a.position() - b.position()).norm() < SAME_POSITION);
        }
    }
    f64::from(equal as u32) / f64::from(all)
}

#[test]
fn a_batch_is_planned_as_its_scenarios_are_alone() {
    let scenarios = scenarios(4);
    for device in devices() {
        for (name, simulator) in simulators(&device) {
            let controller = Controller::Fair(simulator);
            let together = run(&controller, &scenarios);
            for (scenario, together) in scenarios.iter().zip(together) {
                let alone = run(&controller, std::slice::from_ref(scenario)).remove(0).unwrap();
                let share = agreement(&together.unwrap(), &alone);
                assert!(share > 0.99, "{name} {}: {share}", scenario.id);
            }
        }
    }
}

#[test]
fn operations_of_a_backend_plan_as_the_code_for_processors_does() {
    let scenarios = scenarios(4);
    let wanted: Vec<_> = simulators(&device())
        .into_iter()
        .map(|(_, simulator)| run(&Controller::Fair(simulator), &scenarios))
        .collect();
    for device in devices() {
        for ((name, simulator), wanted) in simulators(&device).into_iter().zip(&wanted) {
            let found = run(&Controller::Fair(simulator), &scenarios);
            for ((scenario, found), wanted) in scenarios.iter().zip(found).zip(wanted) {
                let share = agreement(&found.unwrap(), wanted.as_ref().unwrap());
                assert!(share > 0.99, "{name} {}: {share}", scenario.id);
            }
        }
    }
}

/// Loses the memory of one episode of the batch before the third plan.
struct Forgetful {
    inner: Box<dyn Simulator>,
    /// Position of the episode in the batch.
    victim: usize,
}

impl Simulator for Forgetful {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        self.inner.begin_batch(batch)
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        if batch[0].seen.step() == 10 {
            *batch[self.victim].memory = Memory::NONE;
        }
        self.inner.plan(batch)
    }
}

#[test]
fn a_failed_episode_does_not_disturb_the_others() {
    let scenarios = scenarios(3);
    let device = device().autodiff();
    for (name, inner) in simulators(&device) {
        let together = run(&Controller::Fair(Box::new(Forgetful { inner, victim: 1 })), &scenarios);
        let (_, alone) = simulators(&device).into_iter().find(|(n, _)| *n == name).unwrap();
        let alone = Controller::Fair(alone);
        for (i, (scenario, rollout)) in scenarios.iter().zip(together).enumerate() {
            match rollout {
                Err(error) => {
                    assert_eq!(i, 1);
                    assert!(error.to_string().contains("no plan at step 10"), "{error}");
                }
                Ok(rollout) => {
                    assert_ne!(i, 1);
                    let alone = run(&alone, std::slice::from_ref(scenario)).remove(0).unwrap();
                    let share = agreement(&rollout, &alone);
                    assert!(share > 0.99, "{name} {}: {share}", scenario.id);
                }
            }
        }
    }
}
