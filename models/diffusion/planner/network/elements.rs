//! Encoders of agents, lanes and static objects.

use burn::module::{Module, Param};
use burn::nn::{LayerNorm, Linear};
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::math;
use reactsim_nn::{Initializer, Perceptron, Rows, linear};

use super::PlannerConfig;
use super::input::{AGENT, POINT, PlannerInput, STATIC};
use super::mixer::Mixer;
use super::perceptron::{GELU, map_middle};

/// Numbers of a step of a neighbour or a point of a lane that mixers read; the rest are flags.
const MIXED: usize = 8;
/// Channels and tokens of mixers.
const CHANNELS: usize = 128;
const TOKENS: usize = 64;
/// Numbers of a place: x, y, cosine, sine, and whether it is that of an agent, a static object, a lane.
pub(super) const PLACE: usize = 7;

/// Encodes neighbours.
#[derive(Module, Debug)]
pub(super) struct AgentEncoder {
    channel_pre_project: Perceptron,
    token_pre_project: Perceptron,
    blocks: Vec<Mixer>,
    type_emb: Linear,
    norm: LayerNorm,
    emb_project: Perceptron,
}

/// Encodes lanes.
#[derive(Module, Debug)]
pub(super) struct LaneEncoder {
    channel_pre_project: Perceptron,
    token_pre_project: Perceptron,
    blocks: Vec<Mixer>,
    speed_limit_emb: Linear,
    unknown_speed_emb: SpeedEmbedding,
    traffic_emb: Linear,
    norm: LayerNorm,
    emb_project: Perceptron,
}

/// Vector of a lane without a speed limit.
#[derive(Module, Debug)]
pub(super) struct SpeedEmbedding {
    weight: Param<Tensor<2>>,
}

/// Encodes static objects.
#[derive(Module, Debug)]
pub(super) struct StaticEncoder {
    projection: Perceptron,
}

/// Elements of a kind.
pub(super) struct Elements {
    /// `[count, width]`, zeros where absent.
    pub(super) tokens: Tensor<2>,
    /// Whether each is there.
    pub(super) present: Vec<bool>,
    /// `[count * 7]`.
    pub(super) places: Vec<f32>,
}

/// Makes a matrix of rows of `columns` numbers.
pub(super) fn matrix(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

/// Returns 1 and 0, `[n, 1]`.
pub(super) fn column(flags: &[bool], device: &Device) -> Tensor<2> {
    matrix(flags.iter().map(|flag| f32::from(*flag)).collect(), 1, device)
}

/// Returns by element whether any of its mixed numbers is not 0.
fn present(rows: &[f32], numbers: usize, steps: usize) -> Vec<bool> {
    rows.chunks(numbers * steps)
        .map(|e| e.chunks(numbers).any(|s| s[..MIXED].iter().any(|v| *v != 0.0)))
        .collect()
}

/// Mixes steps or points, `[n * steps, inputs]`, to `[n, 128]`.
fn mixed(
    channels: &Perceptron,
    tokens: &Perceptron,
    blocks: &[Mixer],
    x: Tensor<2>,
    steps: usize,
) -> Tensor<2> {
    let n = x.dims()[0] / steps;
    let x = channels.forward(x).reshape([n, steps, CHANNELS]);
    let x = blocks.iter().fold(map_middle(tokens, x), |x, mixer| mixer.forward(x));
    x.mean_dim(1).squeeze_dim(1)
}

impl AgentEncoder {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        Self {
            channel_pre_project: GELU.init(&[MIXED + 1, CHANNELS, CHANNELS], init),
            token_pre_project: GELU.init(&[config.history, TOKENS, TOKENS], init),
            blocks: (0..config.encoder_depth).map(|_| Mixer::init(TOKENS, CHANNELS, init)).collect(),
            type_emb: init.linear(AGENT - MIXED, CHANNELS, true),
            norm: init.norm(CHANNELS),
            emb_project: GELU.init(&[CHANNELS, d, d], init),
        }
    }

    pub(super) fn forward(&self, input: &PlannerInput, config: &PlannerConfig, device: &Device) -> Elements {
        let present = present(&input.agents, AGENT, config.history);
        let with_flag = |step: &[f32]| {
            let there = step[..MIXED].iter().any(|v| *v != 0.0);
            step[..MIXED].iter().copied().chain([f32::from(there)]).collect::<Vec<_>>()
        };
        let steps: Vec<f32> = input.agents.chunks(AGENT).flat_map(with_flag).collect();
        let steps = matrix(steps, MIXED + 1, device);
        let x =
            mixed(&self.channel_pre_project, &self.token_pre_project, &self.blocks, steps, config.history);
        let last = || input.agents.chunks(AGENT * config.history).map(|a| &a[AGENT * (config.history - 1)..]);
        let kinds = last().flat_map(|a| a[MIXED..].iter().copied()).collect();
        let x = x + linear(&self.type_emb, matrix(kinds, AGENT - MIXED, device));
        let x = self.emb_project.forward(Rows::of(x).norm(&self.norm).done());
        let places = last().flat_map(|a| [a[0], a[1], a[2], a[3], 1.0, 0.0, 0.0]).collect();
        Elements { tokens: x * column(&present, device), present, places }
    }
}

impl LaneEncoder {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        Self {
            channel_pre_project: GELU.init(&[MIXED, CHANNELS, CHANNELS], init),
            token_pre_project: GELU.init(&[config.points, TOKENS, TOKENS], init),
            blocks: (0..config.encoder_depth).map(|_| Mixer::init(TOKENS, CHANNELS, init)).collect(),
            speed_limit_emb: init.linear(1, CHANNELS, true),
            unknown_speed_emb: SpeedEmbedding { weight: init.normal([1, CHANNELS], 0.02) },
            traffic_emb: init.linear(POINT - MIXED, CHANNELS, true),
            norm: init.norm(CHANNELS),
            emb_project: GELU.init(&[CHANNELS, d, d], init),
        }
    }

    pub(super) fn forward(&self, input: &PlannerInput, config: &PlannerConfig, device: &Device) -> Elements {
        let present = present(&input.lanes, POINT, config.points);
        let points = input.lanes.chunks(POINT).flat_map(|p| p[..MIXED].iter().copied()).collect();
        let points = matrix(points, MIXED, device);
        let x =
            mixed(&self.channel_pre_project, &self.token_pre_project, &self.blocks, points, config.points);
        let known: Vec<bool> = input.limits.iter().map(Option::is_some).collect();
        let limits = input.limits.iter().map(|limit| limit.unwrap_or(0.0)).collect();
        let limits = linear(&self.speed_limit_emb, matrix(limits, 1, device));
        let unknown = self.unknown_speed_emb.weight.val();
        let speeds = unknown.clone() + (limits - unknown) * column(&known, device);
        let lane =
            |k: usize| input.lanes.chunks(POINT * config.points).map(move |l| &l[POINT * k..POINT * (k + 1)]);
        let lights = lane(0).flat_map(|p| p[MIXED..].iter().copied()).collect();
        let x = x + speeds + linear(&self.traffic_emb, matrix(lights, POINT - MIXED, device));
        let x = self.emb_project.forward(Rows::of(x).norm(&self.norm).done());
        let place = |p: &[f32]| {
            // A point without a way to the next has heading 0.
            let way = math::hypot(f64::from(p[2]), f64::from(p[3]));
            let towards = |d: f32| (f64::from(d) / way) as f32;
            let (cos, sin) = if way > 0.0 { (towards(p[2]), towards(p[3])) } else { (1.0, 0.0) };
            [p[0], p[1], cos, sin, 0.0, 0.0, 1.0]
        };
        let places = lane(config.points / 2).flat_map(place).collect();
        Elements { tokens: x * column(&present, device), present, places }
    }
}

impl StaticEncoder {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        Self { projection: GELU.init(&[STATIC, config.width, config.width], init) }
    }

    pub(super) fn forward(&self, input: &PlannerInput, device: &Device) -> Elements {
        let present: Vec<bool> = input.statics.chunks(STATIC).map(|s| s.iter().any(|v| *v != 0.0)).collect();
        let x = self.projection.forward(matrix(input.statics.clone(), STATIC, device));
        let places =
            input.statics.chunks(STATIC).flat_map(|s| [s[0], s[1], s[2], s[3], 0.0, 1.0, 0.0]).collect();
        Elements { tokens: x * column(&present, device), present, places }
    }
}
