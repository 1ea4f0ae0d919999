//! Surroundings of several agents as the input tensors of the network.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::Vec2;
use reactsim_nn::CLOSED;
use reactsim_nn::learning::Intentions;
use reactsim_nn::perception::{Class, millionths};
use reactsim_scene::HISTORY;

use super::STATE;
use super::config::Config;
use super::guide::References;
use crate::regression::inputs::{OUTLOOK, PolylineFeatures, Surroundings, agent_numbers, point_numbers};

/// Points of histories of agents, or of map lines, as tensors.
#[derive(Clone, Debug)]
pub(crate) struct Polylines {
    /// `[count * rows, numbers]`: features of the points, all first points first.
    pub points: Tensor<2>,
    /// `[count * rows, 1]`: 1 where a point is present.
    pub there: Tensor<2>,
    /// Points per row.
    pub count: usize,
}

/// Agents or lines around predicted agents as tensors.
#[derive(Clone, Debug)]
pub(crate) struct TokenPlaces {
    /// `[rows, 1]`: 1 where a row is present.
    pub there: Tensor<2>,
    /// `[rows, 2]`: positions in the frame of the predicted agent, metres.
    pub positions: Tensor<2>,
}

/// Input of the network. A scene is the surroundings of one predicted agent.
#[derive(Clone, Debug)]
pub(crate) struct Batch {
    /// Number of scenes.
    pub scenes: usize,
    /// Motion queries per scene.
    pub queries: usize,
    /// Histories of agents.
    pub agent_points: Polylines,
    /// Lines of the map.
    pub line_points: Polylines,
    /// `[scenes, 1, tokens, tokens]`: added to scores; the nearest tokens are open.
    pub neighbours: Tensor<4>,
    /// Where agents are.
    pub agents: TokenPlaces,
    /// Where lines are.
    pub lines: TokenPlaces,
    /// `[scenes, 1, 1, agents]`: added to scores; present agents are open.
    pub agents_closed: Tensor<4>,
    /// `[scenes * queries, 1]`: 0 if the scene has no lines.
    pub lines_any: Tensor<2>,
    /// Positions of the lines of each scene, those nearest to the base point first.
    pub line_places: Vec<Vec<[f32; 2]>>,
    /// Per scene and line, whether every query attends to it.
    pub base_lines: Vec<Vec<bool>>,
    /// Class of the predicted agent of each scene.
    pub classes: Vec<usize>,
    /// `[3 * queries, 2]`: intention points of the classes.
    pub table: Tensor<2>,
    /// `[scenes * queries, 2]`: intention points of the predicted agents.
    pub goals: Vec<f32>,
    /// `[scenes * queries, states, 7]`.
    pub mode_guide: Option<Tensor<3>>,
    /// `[scenes, OUTLOOK]`: lane and conflict features of each predicted agent.
    pub outlook: Option<Tensor<2>>,
    /// `[scenes * agents, states, 7]`, relative to the position of each agent.
    pub dense_guide: Option<Tensor<3>>,
    /// `[scenes * agents, states * 4]`: the forecast of the AV; and `[scenes * agents, 1]`: 1 for the
    /// AV.
    pub av_forecast: Option<(Tensor<2>, Tensor<2>)>,
}

impl Batch {
    /// Lays out predicted agents with these surroundings.
    pub(crate) fn of(
        scenes: &[&Surroundings],
        intentions: &Intentions,
        config: &Config,
        device: &Device,
    ) -> Self {
        let queries = intentions.count();
        let table: Vec<f32> = Class::ALL.into_iter().flat_map(|c| flat(intentions.of(c))).collect();
        let classes: Vec<usize> = scenes.iter().map(|s| s.class.index()).collect();
        let goals: Vec<f32> = scenes.iter().flat_map(|s| flat(intentions.of(s.class))).collect();
        let there = |rows: usize, there: usize| (0..rows).map(move |i| i < there);
        let lines_any: Vec<f32> = scenes
            .iter()
            .flat_map(|s| std::iter::repeat_n(f32::from(!s.line_places.is_empty()), queries))
            .collect();
        let agents_closed: Vec<f32> = scenes
            .iter()
            .flat_map(|s| there(config.agents, s.agent_places.len()))
            .map(|t| if t { 0.0 } else { CLOSED })
            .collect();
        let base = |s: &&Surroundings| {
            there(s.line_places.len(), config.base_lines.min(s.line_places.len())).collect::<Vec<_>>()
        };
        let (agent_numbers, point_numbers) =
            (agent_numbers(config.attributes), point_numbers(config.attributes));
        let rows = scenes.len();
        Self {
            scenes: rows,
            queries,
            agent_points: polylines(scenes.iter().map(|s| &s.agents), HISTORY, agent_numbers, device),
            line_points: polylines(scenes.iter().map(|s| &s.lines), config.points, point_numbers, device),
            neighbours: neighbours(scenes, config, device),
            agents: places(scenes.iter().map(|s| s.agent_places.as_slice()), config.agents, device),
            lines: places(scenes.iter().map(|s| s.line_places.as_slice()), config.lines, device),
            agents_closed: tensor4(agents_closed, [rows, 1, 1, config.agents], device),
            lines_any: tensor2(lines_any, 1, device),
            line_places: scenes.iter().map(|s| s.line_places.clone()).collect(),
            base_lines: scenes.iter().map(base).collect(),
            classes,
            table: tensor2(table, 2, device),
            goals,
            mode_guide: config.guided.then(|| mode_guide(scenes, intentions, config, device)),
            outlook: config.outlook.then(|| outlook(scenes, device)),
            dense_guide: config.guided.then(|| dense_guide(scenes, config, device)),
            av_forecast: config.av_forecast.then(|| av_forecast(scenes, config, device)),
        }
    }
}

fn flat(points: &[Vec2]) -> impl Iterator<Item = f32> {
    points.iter().flat_map(|p| [p.x as f32, p.y as f32])
}

fn tensor2(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

fn tensor4(values: Vec<f32>, shape: [usize; 4], device: &Device) -> Tensor<4> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// Joins the rows of several scenes, with `count` points each, point by point.
fn polylines<'a>(
    scenes: impl Iterator<Item = &'a PolylineFeatures> + Clone,
    count: usize,
    numbers: usize,
    device: &Device,
) -> Polylines {
    let (mut points, mut there) = (Vec::new(), Vec::new());
    for k in 0..count {
        for scene in scenes.clone() {
            let rows = scene.there.len() / count;
            points.extend_from_slice(&scene.points[k * rows * numbers..(k + 1) * rows * numbers]);
            there.extend_from_slice(&scene.there[k * rows..(k + 1) * rows]);
        }
    }
    Polylines { points: tensor2(points, numbers, device), there: tensor2(there, 1, device), count }
}

/// Joins the positions of several scenes, with `rows` rows each.
fn places<'a>(scenes: impl Iterator<Item = &'a [[f32; 2]]>, rows: usize, device: &Device) -> TokenPlaces {
    let (mut there, mut positions) = (Vec::new(), Vec::new());
    for scene in scenes {
        for i in 0..rows {
            let place = scene.get(i);
            there.push(f32::from(place.is_some()));
            positions.extend(place.copied().unwrap_or_default());
        }
    }
    TokenPlaces { there: tensor2(there, 1, device), positions: tensor2(positions, 2, device) }
}

/// Returns the attention mask of the nearest tokens of each scene.
fn neighbours(scenes: &[&Surroundings], config: &Config, device: &Device) -> Tensor<4> {
    // Scenarios record no heights.
    let place = |row: usize, p: &[f32; 2]| (row, [p[0], p[1], 0.0]);
    let of = |scene: &&Surroundings| {
        let agents = scene.agent_places.iter().enumerate().map(|(i, p)| place(i, p));
        let lines = scene.line_places.iter().enumerate().map(|(i, p)| place(config.agents + i, p));
        agents.chain(lines).collect::<Vec<_>>()
    };
    nearest_tokens(&scenes.iter().map(of).collect::<Vec<_>>(), config, device)
}

/// Returns the attention mask of the nearest tokens, `[scenes, 1, tokens, tokens]`, for the rows and the
/// positions (metres) of the present tokens of each scene. An absent token attends to itself, so that no row
/// is empty, and no other token attends to it.
pub(super) fn nearest_tokens(
    scenes: &[Vec<(usize, [f32; 3])>],
    config: &Config,
    device: &Device,
) -> Tensor<4> {
    let tokens = config.tokens();
    let mut closed = vec![CLOSED; scenes.len() * tokens * tokens];
    let others = config.neighbours - 1;
    // Distances and, in the lower half, rows: single numbers are selected faster than pairs.
    let mut by_distance: Vec<u128> = Vec::with_capacity(tokens);
    for (all, block) in scenes.iter().zip(closed.chunks_exact_mut(tokens * tokens)) {
        for i in 0..tokens {
            block[i * tokens + i] = 0.0;
        }
        for &(i, a) in all {
            let squared = |b: [f32; 3]| {
                let away = |k: usize| f64::from(a[k] - b[k]);
                away(0) * away(0) + away(1) * away(1) + away(2) * away(2)
            };
            // An agent at the position of another one still counts itself first.
            by_distance.clear();
            let key = |&(j, b): &(usize, [f32; 3])| u128::from(millionths(squared(b))) << 64 | j as u128;
            by_distance.extend(all.iter().filter(|b| b.0 != i).map(key));
            if by_distance.len() > others {
                by_distance.select_nth_unstable(others);
                by_distance.truncate(others);
            }
            by_distance.iter().for_each(|&key| block[i * tokens + key as u64 as usize] = 0.0);
        }
    }
    tensor4(closed, [scenes.len(), 1, tokens, tokens], device)
}

fn reference_tensor(values: Vec<f32>, config: &Config, device: &Device) -> Tensor<3> {
    let rows = values.len() / (config.states() * STATE);
    Tensor::from_data(TensorData::new(values, [rows, config.states(), STATE]), device)
}

fn mode_guide(
    scenes: &[&Surroundings],
    intentions: &Intentions,
    config: &Config,
    device: &Device,
) -> Tensor<3> {
    let references = References::new(config);
    let mut values = Vec::new();
    for scene in scenes {
        let paths = scene.outlook.as_ref().map_or(&[][..], |o| &o.paths);
        let goals = intentions.of(scene.class);
        if config.outlook {
            references.append_towards(goals, scene.velocity(), paths, &mut values);
        } else {
            // Straight motion to a point far ahead says less about the next half second than the velocity.
            goals.iter().for_each(|_| references.append_constant(scene.velocity(), &mut values));
        }
    }
    reference_tensor(values, config, device)
}

fn outlook(scenes: &[&Surroundings], device: &Device) -> Tensor<2> {
    let mut values = Vec::with_capacity(scenes.len() * OUTLOOK);
    for scene in scenes {
        match &scene.outlook {
            Some(outlook) => values.extend_from_slice(&outlook.numbers),
            None => values.extend([0.0; OUTLOOK]),
        }
    }
    tensor2(values, OUTLOOK, device)
}

fn dense_guide(scenes: &[&Surroundings], config: &Config, device: &Device) -> Tensor<3> {
    let references = References::new(config);
    let mut values = Vec::new();
    for scene in scenes {
        for i in 0..config.agents {
            let velocity = scene.velocities.get(i).copied().unwrap_or_default();
            references.append_constant(velocity, &mut values);
        }
    }
    reference_tensor(values, config, device)
}

fn av_forecast(scenes: &[&Surroundings], config: &Config, device: &Device) -> (Tensor<2>, Tensor<2>) {
    let width = config.states() * 4;
    let mut values = vec![0.0; scenes.len() * config.agents * width];
    let mut is_av = vec![0.0; scenes.len() * config.agents];
    for (i, scene) in scenes.iter().enumerate() {
        if let Some((at, forecast)) = &scene.av {
            let row = i * config.agents + at;
            values[row * width..(row + 1) * width].copy_from_slice(forecast);
            is_av[row] = 1.0;
        }
    }
    (tensor2(values, width, device), tensor2(is_av, 1, device))
}
