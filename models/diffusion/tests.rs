//! Samplers against distributions that are known in closed form, and against values of the public code.

use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use reactsim_golden::{Golden, GoldenFile, assert_close};
use reactsim_nn::device;
use reactsim_scene::{AgentState, Frame};

use super::*;

/// Number of samples of a distribution.
const SAMPLES: usize = 20_000;
/// Mean and standard deviation of the distribution.
const WANTED: (f64, f64) = (0.7, 0.4);
/// A limit that limits nothing.
const FAR: f64 = 1e9;

fn normal(rng: &mut ChaCha8Rng, shape: [usize; 2]) -> Tensor<2> {
    standard_normal(rng, shape, &device())
}

/// Returns the expected clean value of a noisy one if clean values are normally distributed: what a perfect
/// network answers. `signal` and `noise` are the factors of both.
fn perfect(x: Tensor<2>, signal: f64, noise: f64) -> Tensor<2> {
    let (mean, deviation) = WANTED;
    let variance = deviation * deviation;
    let gain = signal * variance / (signal * signal * variance + noise * noise);
    (x - mean * signal) * gain + mean
}

fn values<const D: usize>(x: &Tensor<D>) -> Vec<f64> {
    x.clone().into_data().iter::<f32>().map(f64::from).collect()
}

fn mean_and_deviation(x: &Tensor<2>) -> (f64, f64) {
    let all = values(x);
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / all.len() as f64;
    (mean, variance.sqrt())
}

/// Returns the standard deviation that samples have: every step is linear, so that a normal distribution
/// stays one.
fn expected_deviation(schedule: &Schedule, sampling: &Sampling) -> f64 {
    let answer = |share: f64| {
        let variance = WANTED.1 * WANTED.1;
        share.sqrt() * variance / (share * variance + 1.0 - share)
    };
    let steps = schedule.spaced(sampling.steps);
    let mut variance: f64 = 1.0;
    for pair in steps.windows(2) {
        let (share, next) = (schedule.share(pair[0]), schedule.share(pair[1]));
        let (slope, added) = match sampling.sampler {
            Sampler::Ddpm => {
                let weights = sampler::Posterior::between(share, next);
                (weights.clean * answer(share) + weights.noisy, weights.variance)
            }
            Sampler::Ddim => {
                let noise = (1.0 - answer(share) * share.sqrt()) / (1.0 - share).sqrt();
                (answer(share) * next.sqrt() + noise * (1.0 - next).sqrt(), 0.0)
            }
        };
        variance = variance * slope * slope + added;
    }
    variance.sqrt() * answer(schedule.share(steps[steps.len() - 1]))
}

#[test]
fn with_many_steps_samplers_recover_a_normal_distribution() {
    let schedule = Schedule::cosine(4000).unwrap();
    for sampler in [Sampler::Ddpm, Sampler::Ddim] {
        let found = expected_deviation(&schedule, &Sampling { sampler, steps: 4000, limit: FAR });
        assert!((found / WANTED.1 - 1.0).abs() < 0.005, "{sampler:?}: {found}");
    }
}

#[test]
fn samples_have_the_expected_distribution() {
    let schedule = Schedule::cosine(50).unwrap();
    for (sampler, steps) in [
        (Sampler::Ddpm, 50),
        (Sampler::Ddpm, 10),
        (Sampler::Ddim, 50),
        (Sampler::Ddim, 10),
        (Sampler::Ddim, 5),
    ] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let start = normal(&mut rng, [SAMPLES, 1]);
        let denoise = |x: Tensor<2>, t: usize| {
            let share = schedule.share(t);
            perfect(x, share.sqrt(), (1.0 - share).sqrt())
        };
        let sampling = Sampling { sampler, steps, limit: FAR };
        let (mean, deviation) = mean_and_deviation(&sampling.sample(
            &schedule,
            start,
            denoise,
            || normal(&mut rng, [SAMPLES, 1]),
            &mut (),
        ));
        let wanted = expected_deviation(&schedule, &sampling);
        // 4 standard errors of the mean, and of the deviation.
        let close = (mean - WANTED.0).abs() < 0.012 && (deviation / wanted - 1.0).abs() < 0.02;
        assert!(close, "{sampler:?} {steps}: {mean} {deviation}, expected {wanted}");
    }
}

#[test]
fn the_solver_is_of_second_order_and_carries_quantiles() {
    let process = VariancePreserving::default();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let start = normal(&mut rng, [100, 1]);
    // Without noise on the way, a normal distribution is scaled: sample k is at the quantile of its start.
    // The last answer is the expected clean value there.
    let end: f64 = 1e-3;
    let exact = |x: f64| {
        let total = |t: f64| {
            let (signal, noise) = (process.signal(t), process.deviation(t));
            (signal * signal * WANTED.1 * WANTED.1 + noise * noise).sqrt()
        };
        let at_end =
            (x - process.signal(1.0) * WANTED.0) / total(1.0) * total(end) + process.signal(end) * WANTED.0;
        let (signal, noise) = (process.signal(end), process.deviation(end));
        let variance = WANTED.1 * WANTED.1;
        (at_end - WANTED.0 * signal) * signal * variance / (signal * signal * variance + noise * noise)
            + WANTED.0
    };
    let error = |steps: usize| {
        let denoise = |x: Tensor<2>, t: f64| perfect(x, process.signal(t), process.deviation(t));
        let found = values(&solve(&process, steps, end, start.clone(), denoise, &mut ()));
        let each = found.iter().zip(values(&start)).map(|(found, x)| (found - exact(x)).abs());
        each.fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(10), error(40));
    assert!(coarse < 0.1 && fine < coarse / 8.0, "{coarse} {fine}");
    for t in [1e-3, 0.01, 0.3, 1.0] {
        assert!((process.time(process.log_ratio(t)) / t - 1.0).abs() < 1e-9);
        let (signal, deviation) = (process.signal(t), process.deviation(t));
        assert!((signal * signal + deviation * deviation - 1.0).abs() < 1e-12);
    }
}

#[test]
fn guides_see_every_step_and_known_values_stay() {
    /// Keeps the first column at a value, and records what it sees.
    struct Known(Vec<Moment>);
    impl Guide<2> for Known {
        fn guide(&mut self, mean: Tensor<2>, clean: &Tensor<2>, moment: Moment) -> Tensor<2> {
            self.0.push(moment);
            Tensor::cat(vec![clean.clone().narrow(1, 0, 1) * 0.0 + 3.0, mean.narrow(1, 1, 1)], 1)
        }
    }
    let schedule = Schedule::cosine(20).unwrap();
    let mut guide = Known(Vec::new());
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let sampling = Sampling { sampler: Sampler::Ddim, steps: 4, limit: FAR };
    let start = normal(&mut rng, [5, 2]);
    let out = sampling.sample(&schedule, start, |x, _| x, || unreachable!("no noise"), &mut guide);
    assert!(values(&out.narrow(1, 0, 1)).iter().all(|v| *v == 3.0));
    assert_eq!(guide.0.iter().map(|m| m.step).collect::<Vec<_>>(), [19, 14, 9]);
}

#[test]
fn schedules_that_can_not_be_used_are_refused() {
    assert!(Schedule::cosine(0).unwrap_err().to_string().contains("0 steps"));
    for shares in [vec![0.5, 0.6], vec![1.0], vec![0.5, 0.0], vec![f64::NAN], vec![0.5, 0.5]] {
        assert!(Schedule::new(shares).is_err());
    }
    let schedule = Schedule::cosine(50).unwrap();
    assert_eq!(schedule.spaced(5), [49, 39, 29, 19, 9]);
    assert_eq!((schedule.spaced(0), schedule.spaced(1000).len()), (vec![49], 50));
}

#[test]
fn actions_of_a_motion_drive_it_again() {
    let device = device().autodiff();
    let start = Tensor::<2>::from_data([[3.0f32, -2.0, 0.4, 4.0, 0.0]], &device);
    let given: Vec<f32> = (0..20).flat_map(|k| [1.5 - 0.1 * k as f32, 0.2 - 0.02 * k as f32]).collect();
    let actions_of =
        Tensor::<3>::from_data(TensorData::new(given.clone(), [1, 20, 2]), &device).require_grad();
    let states = roll_out(&start, actions_of.clone(), 2);
    let track: Vec<Frame> = std::iter::once(Some([3.0, -2.0, 0.4, 4.0, 0.0]))
        .chain(values(&states).as_chunks::<5>().0.iter().map(|s| Some(*s)))
        .map(|s| s.map(|[x, y, heading, vx, vy]| AgentState { x, y, heading, vx, vy }))
        .collect();
    let found = actions(&track, 2);
    assert!(found.known.iter().all(|known| *known));
    for (found, given) in found.values.iter().zip(given.as_chunks::<2>().0) {
        assert!(
            (found[0] - f64::from(given[0])).abs() < 1e-3 && (found[1] - f64::from(given[1])).abs() < 1e-3
        );
    }
    // An action moves everything after it: the gradient of the last x with respect to accelerations.
    let gradients = states.narrow(1, 39, 1).narrow(2, 0, 1).sum().backward();
    let of = values(&actions_of.grad(&gradients).unwrap());
    assert!(of[0] > of[36] && of[36] > 0.0);
    // Unknown frames make unknown steps, and a bin of them is unknown.
    let mut gap = track.clone();
    gap[3] = None;
    let found = actions(&gap, 2);
    assert_eq!(found.known[..3], [true, false, true]);
    assert_eq!(found.values[1], [0.0, 0.0]);
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

#[test]
fn schedule_and_steps_equal_those_of_vbd() {
    let Some(golden) = Golden::open("vbd_golden") else { return };
    let file = golden.file("schedule");
    let numbers = |name: &str| file.floats(name);
    let schedule = Schedule::cosine(50).unwrap();
    let shares: Vec<f64> = (0..50).map(|t| schedule.share(t)).collect();
    assert_close(&shares, &numbers("alphas_cumprod"), 1e-7, "shares of the signal");
    let posteriors: Vec<_> =
        (1..50).map(|t| sampler::Posterior::between(schedule.share(t), schedule.share(t - 1))).collect();
    let of = |part: fn(&sampler::Posterior) -> f64| posteriors.iter().map(part).collect::<Vec<f64>>();
    assert_close(&of(|p| p.clean), &numbers("ddpm_coef_x0")[1..], 5e-6, "weights of the clean value");
    assert_close(&of(|p| p.noisy), &numbers("ddpm_coef_xt")[1..], 5e-6, "weights of the noisy value");
    assert_close(&of(|p| p.variance), &numbers("ddpm_variance")[1..], 2e-6, "variances");
    // One step, with clean values beyond the limit.
    let device = device();
    let of = |name: &str| tensor::<2>(numbers(name), [40, 2], &device);
    for (sampler, name) in [(Sampler::Ddim, "ddim"), (Sampler::Ddpm, "ddpm_mean")] {
        let sampling = Sampling { sampler, steps: 50, limit: 5.0 };
        let (mean, _) =
            sampling.mean(of("clamp_xt"), &of("clamp_x0"), schedule.share(25), schedule.share(24));
        assert_close(&values(&mean), &numbers(&format!("clamp_t25_{name}")), 1e-5, name);
    }
}

#[test]
fn samples_and_motion_equal_those_of_vbd() {
    let device = device();
    let Some(golden) = Golden::open("vbd_golden") else { return };
    for scene in ["scene_0", "scene_1"] {
        let file = golden.file(scene);
        let numbers = |name: &str| file.floats(name);
        let of = |name: &str, shape: [usize; 3]| tensor::<3>(numbers(name), shape, &device);
        let (width, shape) = (5 * 40 * 2, [5, 40, 2]);
        let row = |name: &str, k: usize| {
            tensor::<3>(numbers(name)[k * width..(k + 1) * width].to_vec(), shape, &device)
        };
        let schedule = Schedule::cosine(50).unwrap();
        for (sampler, name) in [(Sampler::Ddim, "ddim"), (Sampler::Ddpm, "ddpm")] {
            // The answers of the network are given: what is tested are the samples between them.
            let mut asked = 0;
            let denoise = |x: Tensor<3>, step: usize| {
                assert_eq!(step, 49 - asked);
                if asked > 0 {
                    let before = values(&row(&format!("{name}_x_history"), asked - 1));
                    let before: Vec<f32> = before.iter().map(|v| *v as f32).collect();
                    assert_close(&values(&x), &before, 1e-4, &format!("{scene}, {name}, sample {asked}"));
                }
                asked += 1;
                row(&format!("{name}_x0_history"), asked - 1)
            };
            let mut drawn = 0;
            let noise = || {
                drawn += 1;
                row("nz_ddpm", drawn - 1)
            };
            let sampling = Sampling { sampler, steps: 50, limit: 5.0 };
            let last = sampling.sample(&schedule, of("nz_x_T", shape), denoise, noise, &mut ());
            let scale = tensor::<3>(vec![1.0, 0.15], [1, 1, 2], &device);
            assert_close(&values(&(last * scale)), &numbers(&format!("{name}_final_actions")), 1e-5, name);
        }
        let start: Vec<f32> = (0..5)
            .flat_map(|agent| numbers("in_agents_history")[(agent * 11 + 10) * 8..][..5].to_vec())
            .collect();
        let start = tensor::<2>(start, [5, 5], &device);
        let states = roll_out(&start, of("nz_act", shape), 2);
        assert_close(&values(&states), &numbers("roll_global"), 1e-4, &format!("{scene}, motion"));
        inverse_equals_the_variant(&file, scene);
    }
}

/// Compares actions of recorded motion with those of the golden data that test consecutive frames.
fn inverse_equals_the_variant(file: &GoldenFile, scene: &str) {
    let future = file.floats("in_agents_future");
    let wanted = file.floats("variant_ik_actions");
    for agent in 0..5 {
        let frame = |k: usize| {
            let s = &future[(agent * 81 + k) * 5..][..5];
            let [x, y, heading, vx, vy] = std::array::from_fn(|i| f64::from(s[i]));
            (s.iter().any(|v| *v != 0.0)).then_some(AgentState { x, y, heading, vx, vy })
        };
        let track: Vec<Frame> = (0..81).map(frame).collect();
        let found: Vec<f64> = actions(&track, 2).values.into_iter().flatten().collect();
        assert_close(
            &found,
            &wanted[agent * 80..(agent + 1) * 80],
            1e-4,
            &format!("{scene}, actions of agent {agent}"),
        );
    }
}
