//! Costs against closed forms, gradients against differences, and what the guide changes.

use burn::tensor::Tensor;
use reactsim_geometry::Vec2;
use reactsim_nn::device;
use reactsim_nn::perception::SceneView;
use reactsim_scene::{Agent, AgentKind, AgentState};

use super::super::network::CtgConfig;
use super::super::raster::{Ground, GroundShapes};
use super::{Motion, Other, RuleAgent, RuleGuide, RuleScene, Rules, others};
use crate::{Guide, Moment};

const ALL: Rules = Rules { collision: 1.0, road: 0.5, speed: 0.2 };
/// Changes one number of a state.
type Nudge = fn(&mut Motion, f64);

const CAR: [f64; 2] = [4.5, 2.0];

/// A road along the x axis, 8 m wide.
fn ground() -> Ground {
    Ground::of(&GroundShapes::road(Vec2::new(-80.0, -4.0), Vec2::new(80.0, 4.0)), 60.0).with_distances()
}

fn scene(ground: &Ground, rules: Rules, agents: usize, others: Vec<Other>) -> RuleScene<'_> {
    let agent = RuleAgent { size: CAR, is_vehicle: true, on_road: true };
    RuleScene { rules, agents: vec![agent; agents], others, ground, dt: 0.1 }
}

fn at(x: f64, y: f64, heading: f64, speed: f64) -> Motion {
    Motion { at: Vec2::new(x, y), heading, velocity: Vec2::new(speed, 0.3) }
}

#[test]
fn gradients_are_those_of_the_costs() {
    let ground = ground();
    let other = Other::of(CAR, &[standing(5.2, 1.3, 0.4); 2]);
    let scene = scene(&ground, ALL, 3, vec![other]);
    // Two cars that overlap askew, and one that is half off the road, all too fast.
    let motion = vec![
        vec![at(0.0, 0.0, 0.1, 9.0), at(1.0, 0.1, 0.1, 9.5)],
        vec![at(3.0, 1.1, -0.3, 12.0), at(2.9, 1.0, -0.3, 3.0)],
        vec![at(-20.0, 4.3, 0.2, 9.0), at(-19.0, -5.4, 0.25, 9.0)],
    ];
    let costs = scene.costs(&motion);
    // Pairs of agents count for both.
    let total = |motion: &[Vec<Motion>]| {
        let with = |rules: Rules, agents: std::ops::Range<usize>| {
            let scene = RuleScene { rules, agents: scene.agents[agents.clone()].to_vec(), ..scene.clone() };
            scene.costs(&motion[agents]).iter().map(|cost| cost.value).sum::<f64>()
        };
        let alone: f64 = (0..3).map(|a| with(ALL, a..a + 1)).sum();
        let pairs = with(ALL, 0..3) - alone;
        alone + 0.5 * pairs
    };
    for (a, cost) in costs.iter().enumerate() {
        assert!(cost.value > 0.0);
        for step in 0..2 {
            let gradient = cost.gradient[step];
            let nudges: [(f64, Nudge); 5] = [
                (gradient.at.x, |m, e| m.at.x += e),
                (gradient.at.y, |m, e| m.at.y += e),
                (gradient.heading, |m, e| m.heading += e),
                (gradient.velocity.x, |m, e| m.velocity.x += e),
                (gradient.velocity.y, |m, e| m.velocity.y += e),
            ];
            for (k, (found, nudge)) in nudges.into_iter().enumerate() {
                let cost_at = |e: f64| {
                    let mut motion = motion.clone();
                    nudge(&mut motion[a][step], e);
                    total(&motion)
                };
                let expected = (cost_at(1e-5) - cost_at(-1e-5)) / 2e-5;
                assert!((found - expected).abs() < 1e-4, "agent {a}, step {step}, {k}: {found} {expected}");
            }
        }
    }
}

fn standing(x: f64, y: f64, heading: f64) -> AgentState {
    AgentState { x, y, heading, vx: 0.0, vy: 0.0 }
}

#[test]
fn others_are_where_they_will_be() {
    let (known, unknown) = (AgentState { vx: 5.0, ..standing(0.0, 0.0, 0.0) }, f64::NAN);
    let along = |k: u8| AgentState { x: 0.5 * f64::from(k), ..known };
    let track = |vx: f64| (0..11).map(|k| Some(AgentState { vx, ..along(k) })).collect::<Vec<_>>();
    // The AV has no recorded velocity. Its next state is known, as it may brake.
    let tracks = [track(unknown), track(5.0), track(5.0)];
    let agents =
        vec![Agent { id: "a".to_owned(), kind: AgentKind::Vehicle, length: CAR[0], width: CAR[1] }; 3];
    let next = AgentState { x: 5.3, vx: unknown, ..along(10) };
    let view = SceneView {
        agents: &agents,
        tracks: &tracks,
        now: 10,
        first: 0,
        av_next: Some(next),
        lights: &[],
        start: None,
        heights: None,
    };
    let found = others(&view, &[1], 4);
    assert_eq!(found.len(), 2);
    let x = |other: &Other| other.discs.iter().map(|discs| discs.center.x).collect::<Vec<_>>();
    assert!((x(&found[0])[0] - 5.3).abs() < 1e-12 && x(&found[0])[1] < 5.6, "{:?}", x(&found[0]));
    assert!(x(&found[1]).iter().zip([5.5, 6.0, 6.5, 7.0]).all(|(x, wanted)| (x - wanted).abs() < 1e-9));
}

#[test]
fn agents_that_keep_to_the_rules_pay_nothing() {
    let ground = ground();
    let scene = scene(&ground, ALL, 2, Vec::new());
    let apart = vec![vec![at(0.0, 0.0, 0.0, 7.0)], vec![at(6.0, 0.0, 0.0, 7.0)]];
    assert!(scene.costs(&apart).iter().all(|cost| cost.value == 0.0));
    // Agents that stand pay nothing, even half off the road and with another one about to hit them.
    let still = Motion { velocity: Vec2::zeros(), ..at(0.0, 4.0, 0.0, 0.0) };
    let near = at(-3.0, 3.0, 0.0, 7.0);
    let costs = scene.costs(&[vec![still; 2], vec![near, Motion { velocity: Vec2::zeros(), ..near }]]);
    assert!(costs[0].value == 0.0 && costs[0].gradient.iter().all(|by| *by == Motion::default()));
    // The one that comes to rest in them pays for every step.
    assert!(costs[1].gradient.iter().all(|by| by.at.x > 0.0), "{costs:?}");
    // Two discs of 1 m that are 1.1 m apart: 1 - 1.1 / 2.2 each.
    let mut scene = scene.clone();
    scene.agents.iter_mut().for_each(|agent| agent.size = [2.0, 2.0]);
    scene.rules = Rules { road: 0.0, speed: 0.0, ..ALL };
    let costs = scene.costs(&[vec![at(0.0, 0.0, 0.0, 7.0)], vec![at(1.1, 0.0, 0.0, 7.0)]]);
    let expected = 25.0 * 0.5 * reactsim_geometry::math::pow(0.9, 0.1);
    assert!(costs.iter().all(|cost| (cost.value - expected).abs() < 1e-9), "{costs:?}");
}

#[test]
fn a_guided_follower_brakes_for_an_av_that_stands() {
    let (ground, config, device) = (ground(), CtgConfig::default(), device());
    let av = Other::of(CAR, &[standing(18.0, 0.0, 0.0); 40]);
    let scene = scene(&ground, Rules { speed: 0.0, ..ALL }, 1, vec![av]);
    let now = [AgentState { x: 0.0, y: 0.0, heading: 0.0, vx: 4.0, vy: 0.0 }];
    let mut guide = RuleGuide { scene: &scene, now: &now, hold: config.hold };
    let still = Tensor::<3>::zeros([1, config.actions, 2], &device);
    let cost = |guide: &RuleGuide<'_>, actions: &Tensor<3>| guide.costs(actions.clone())[0].value;
    let before = cost(&guide, &still);
    let mut actions = still.clone();
    for _ in 0..12 {
        let moment = Moment { step: 0, deviation: 1.0 };
        actions = guide.guide(actions.clone(), &actions, moment);
    }
    let after = cost(&guide, &actions);
    assert!(before > 1.0 && after < 0.1 * before, "{before} {after}");
    let first: Vec<f32> = actions.clone().into_data().iter::<f32>().collect();
    assert!(first[0] < -0.5 && first.iter().step_by(2).all(|a| *a <= 0.0), "brakes: {first:?}");
    // The change is limited by the deviation of the noise, and nothing changes without rules.
    let moment = Moment { step: 0, deviation: 0.05 };
    let changed = guide.guide(still.clone(), &still, moment).into_data();
    assert!(changed.iter::<f32>().all(|x| x.abs() <= 0.0501));
    let free = RuleScene { rules: Rules { collision: 0.0, road: 0.0, speed: 0.0 }, ..scene.clone() };
    let mut guide = RuleGuide { scene: &free, ..guide };
    let same = guide.guide(still.clone(), &still, moment).into_data();
    assert!(same.iter::<f32>().all(|x| x == 0.0));
}
