//! Plans of the AV: samples of its motion, driven within the limits of a vehicle.

use burn::tensor::{Device, Tensor};
use reactsim_geometry::{Vec2, direction, heading_of, wrap};
use reactsim_nn::perception::SceneView;
use reactsim_rollout::{Observation, Stream};
use reactsim_scene::dynamics::{MotionLimits, Pose, REAR_AXLE, Tracker, VehicleMotion, motion_through};
use reactsim_scene::{Agent, AgentState, DT, FUTURE, Frame};

use super::inputs::{AxleFrame, PlannerScene, rear_axle};
use super::policy::PlannerPolicy;
use super::units::Units;
use crate::standard_normal;

/// Speed in m/s below which a vehicle keeps its heading.
const HEADING_SPEED: f64 = 0.3;

impl PlannerPolicy {
    /// Samples plans of the AV from the present on, one per stream: its states after 1 to 80 steps of 0.1 s.
    /// `temperature` is the standard deviation of the initial noise (published: 0.5). No plans if the AV is
    /// absent.
    pub fn plans(
        &self,
        seen: &Observation<'_>,
        temperature: f64,
        streams: &mut [Stream],
        device: &Device,
    ) -> Vec<Vec<AgentState>> {
        let (start, lights) = (seen.start(), seen.lights_now());
        let Some(av_now) = seen.state(0) else { return Vec::new() };
        let view = SceneView { av_next: None, ..SceneView::of(seen, &lights) };
        let map = self.sight.map(start, &self.config);
        let Some(scene) = PlannerScene::of(&view, &map, &self.config, &self.sight) else { return Vec::new() };
        if streams.is_empty() {
            return Vec::new();
        }
        let encoded = self.network.encode(&scene.input, &self.config, device);
        let shape = [1, 1 + self.config.predicted, 4 * self.config.states];
        let noise = streams.iter_mut().map(|stream| standard_normal::<3>(stream, shape, device)).collect();
        let sampled = self.network.sample(&encoded, Tensor::cat(noise, 0) * temperature);
        let of_av = sampled.narrow(1, 0, 1).into_data().iter::<f32>().map(f64::from).collect::<Vec<_>>();
        let step = FUTURE / self.config.states;
        let (av, now) = (&start.agents[0], av_now);
        let axle = rear_axle(av, now.position(), now.heading);
        let units = Units::of(self.sight.relative, &scene.frame, axle, now.heading, view.velocity(0));
        let states = |plan: &[f64]| {
            let numbers = plan.as_chunks::<4>().0.iter().zip(1..);
            let poses: Vec<[f64; 4]> =
                numbers.map(|(pose, k)| units.read((k * step) as f64 * DT, *pose)).collect();
            let planned = av_states(&poses, step, av, now, &scene.frame);
            driven(seen.track(0), av, planned)
        };
        of_av.chunks(4 * self.config.states).map(states).collect()
    }
}

/// Returns the states of an AV that follows a plan after its history as far as a vehicle can; the plan itself
/// if it is not finite. The published planner leaves this to a controller too.
fn driven(history: &[Frame], av: &Agent, plan: Vec<AgentState>) -> Vec<AgentState> {
    let now = VehicleMotion::after(history);
    let Some(now) = now.filter(|_| plan.iter().all(AgentState::is_finite)) else { return plan };
    let poses: Vec<Pose> = plan.into_iter().map(Pose::from).collect();
    let mut motion = Vec::with_capacity(poses.len());
    Tracker::new(MotionLimits::of_vehicle(REAR_AXLE * av.length)).track(now, &poses, &mut motion);
    let from = std::iter::once(now.pose).chain(motion.iter().map(|state| state.pose));
    motion.iter().zip(from).map(|(state, before)| state.state(before.position)).collect()
}

/// Returns the states of the AV at every frame, if its rear axle has these poses, x, y, cosine and sine of the heading,
/// every `step` frames. Between them it drives along a spline, in the direction of its rear axle's motion.
fn av_states(
    poses: &[[f64; 4]],
    step: usize,
    av: &Agent,
    now: AgentState,
    frame: &AxleFrame,
) -> Vec<AgentState> {
    let axles: Vec<Vec2> = poses.iter().map(|p| Vec2::new(p[0], p[1])).collect();
    let velocity = frame.vector(now.velocity().unwrap_or_default());
    let path = motion_through(&axles, Vec2::new(velocity.x, 0.0) * DT, step);
    let (mut axle, mut center, mut heading) = (Vec2::zeros(), now.position(), now.heading);
    let mut states = Vec::with_capacity(path.len());
    for (k, at) in path.into_iter().enumerate() {
        let moved = frame.place(at) - frame.place(axle);
        if step == 1 {
            heading = frame.heading(Vec2::new(poses[k][2], poses[k][3]));
        } else if moved.norm() > HEADING_SPEED * DT && moved.dot(&direction(heading)) > 0.0 {
            heading = heading_of(moved);
        }
        let next = frame.place(at) + direction(heading) * (REAR_AXLE * av.length);
        let v = (next - center) / DT;
        states.push(AgentState { x: next.x, y: next.y, heading: wrap(heading), vx: v.x, vy: v.y });
        (axle, center) = (at, next);
    }
    states
}
