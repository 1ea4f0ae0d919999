//! The network against values of the public code, with random weights at a small size.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_golden::{Golden, GoldenFile, assert_close, values};
use reactsim_nn::learning::Intentions;
use reactsim_nn::perception::Class;
use reactsim_nn::{CLOSED, Initializer, device};

use super::batch::{Polylines, TokenPlaces, nearest_tokens};
use super::{Batch, Config, Network, STATE};
use crate::regression::predict::kept_modes;

/// The configuration of the golden data.
const CONFIG: Config = Config {
    agents: 11,
    lines: 40,
    width: 64,
    agent_hidden: 48,
    line_hidden: 32,
    encoder_layers: 2,
    heads: 4,
    decoder_width: 96,
    map_width: 64,
    decoder_layers: 2,
    base_lines: 12,
    way_lines: 8,
    ..Config::mtr()
};
/// Point around which the base lines lie, metres.
const BASE: [f32; 2] = [30.0, 0.0];

fn load(golden: &Golden, device: &Device) -> (Network, Intentions) {
    let weights = golden.file("weights");
    let mut tensors = weights.tensors().without(|name| name.ends_with(".num_batches_tracked"));
    let intentions = Intentions::from_tables(&tensors.split_off("intention_points.")).unwrap();
    (tensors.load(Network::init(&CONFIG, &mut Initializer::new(0, device))).unwrap(), intentions)
}

/// Features of points, whether points are there, and positions, of the rows of all scenes; the rows of a
/// scene in the order `order`.
fn polylines(
    features: &[f32],
    there: &[bool],
    places: &[[f32; 3]],
    order: &[usize],
    count: usize,
    with_mask: bool,
    device: &Device,
) -> (Polylines, TokenPlaces) {
    let numbers = features.len() / there.len();
    let width = numbers + usize::from(with_mask);
    let (mut points, mut points_there) = (Vec::new(), Vec::new());
    for k in 0..count {
        for &row in order {
            let at = row * count + k;
            let is_there = f32::from(there[at]);
            points.extend_from_slice(&features[at * numbers..(at + 1) * numbers]);
            points.extend(with_mask.then_some(is_there));
            points_there.push(is_there);
        }
    }
    let any = |row: usize| there[row * count..(row + 1) * count].iter().any(|t| *t);
    let rows_there: Vec<f32> = order.iter().map(|&row| f32::from(any(row))).collect();
    let positions: Vec<f32> = order.iter().flat_map(|&row| [places[row][0], places[row][1]]).collect();
    let matrix = |values: Vec<f32>, columns: usize| {
        let rows = values.len() / columns;
        Tensor::<2>::from_data(TensorData::new(values, [rows, columns]), device)
    };
    let points = Polylines { points: matrix(points, width), there: matrix(points_there, 1), count };
    (points, TokenPlaces { there: matrix(rows_there, 1), positions: matrix(positions, 2) })
}

/// Input of a scene, and the order of the golden agents in it: the predicted one is first.
fn batch(file: &GoldenFile, intentions: &Intentions, device: &Device) -> (Batch, Vec<usize>) {
    let targets = file.integers("input.track_index_to_predict");
    let (scenes, agents, lines) = (targets.len(), CONFIG.agents, CONFIG.lines);
    let first = |(scene, target): (usize, &usize)| {
        let others = (0..agents).filter(move |row| row != target);
        std::iter::once(*target).chain(others).map(move |row| scene * agents + row).collect::<Vec<_>>()
    };
    let order: Vec<usize> = targets.iter().enumerate().flat_map(first).collect();
    let triples = |name: &str| file.floats(name).as_chunks::<3>().0.to_vec();
    let (agents_at, lines_at) = (triples("input.obj_trajs_last_pos"), triples("input.map_polylines_center"));
    let (agents_valid, lines_valid) =
        (file.flags("input.obj_trajs_mask"), file.flags("input.map_polylines_mask"));
    let is_agent = |row: usize| agents_valid[row * 11..(row + 1) * 11].iter().any(|v| *v);
    let is_line = |row: usize| lines_valid[row * 20..(row + 1) * 20].iter().any(|v| *v);
    let tokens = |scene: usize| {
        let of_agents = order[scene * agents..(scene + 1) * agents].iter().enumerate();
        let of_agents = of_agents.filter(|(_, row)| is_agent(**row)).map(|(i, row)| (i, agents_at[*row]));
        let of_lines = (0..lines).map(|i| (i, scene * lines + i)).filter(|(_, row)| is_line(*row));
        of_agents.chain(of_lines.map(|(i, row)| (agents + i, lines_at[row]))).collect::<Vec<_>>()
    };
    let tokens: Vec<_> = (0..scenes).map(tokens).collect();
    let mut batch_lines = (Vec::new(), Vec::new());
    for scene in 0..scenes {
        let present = (0..lines).take_while(|i| is_line(scene * lines + i)).count();
        assert_eq!(present, (0..lines).filter(|i| is_line(scene * lines + i)).count(), "gaps among lines");
        let places: Vec<[f32; 2]> =
            lines_at[scene * lines..][..present].iter().map(|p| [p[0], p[1]]).collect();
        let away = |i: &usize| (places[*i][0] - BASE[0]).hypot(places[*i][1] - BASE[1]);
        let mut nearest: Vec<usize> = (0..present).collect();
        nearest.sort_by(|a, b| away(a).total_cmp(&away(b)));
        let mut base = vec![false; present];
        nearest.iter().take(CONFIG.base_lines).for_each(|i| base[*i] = true);
        batch_lines.0.push(places);
        batch_lines.1.push(base);
    }
    let classes = file.integers("input.center_objects_type");
    let queries = intentions.count();
    let points =
        |class: usize| intentions.of(Class::ALL[class]).iter().flat_map(|p| [p.x as f32, p.y as f32]);
    let vector =
        |values: Vec<f32>, shape: [usize; 2]| Tensor::<2>::from_data(TensorData::new(values, shape), device);
    let table: Vec<f32> = (0..3).flat_map(points).collect();
    let closed: Vec<f32> = order.iter().map(|&row| if is_agent(row) { 0.0 } else { CLOSED }).collect();
    let closed = Tensor::<4>::from_data(TensorData::new(closed, [scenes, 1, 1, agents]), device);
    let all_lines: Vec<usize> = (0..scenes * lines).collect();
    let features = |name: &str| file.floats(name);
    let (agent_points, agents) =
        polylines(&features("input.obj_trajs"), &agents_valid, &agents_at, &order, 11, true, device);
    let (line_points, lines) =
        polylines(&features("input.map_polylines"), &lines_valid, &lines_at, &all_lines, 20, false, device);
    let batch = Batch {
        scenes,
        queries,
        agent_points,
        line_points,
        neighbours: nearest_tokens(&tokens, &CONFIG, device),
        agents,
        lines,
        agents_closed: closed,
        lines_any: Tensor::ones([scenes * queries, 1], device),
        line_places: batch_lines.0,
        base_lines: batch_lines.1,
        goals: classes.iter().flat_map(|&class| points(class)).collect(),
        classes,
        table: vector(table, [3 * queries, 2]),
        mode_guide: None,
        outlook: None,
        dense_guide: None,
        av_forecast: None,
    };
    (batch, order)
}

#[test]
fn neighbours_encoding_and_modes_equal_those_of_the_public_code() {
    let Some(golden) = Golden::open("mtr_golden") else { return };
    for device in [device(), device().autodiff()] {
        let (network, intentions) = load(&golden, &device);
        // Sines of positions in metres: in scene 2 these are 173 m.
        for (scene, limit) in [("scene_0", 1e-4), ("scene_1", 1e-4), ("scene_2", 2e-4)] {
            let file = golden.file(scene);
            let (batch, order) = batch(&file, &intentions, &device);
            check(&network, &batch, &order, &file, limit, scene);
        }
    }
}

fn check(network: &Network, batch: &Batch, order: &[usize], file: &GoldenFile, limit: f64, scene: &str) {
    let tokens = network.context_encoder.forward(batch, &CONFIG, &mut None);
    let output = network.forward(batch, &CONFIG, false);
    // Rows that are absent are not looked at: there ours are arbitrary.
    let (agents, lines) = (file.flags("output.obj_mask"), file.flags("output.map_mask"));
    let all_lines: Vec<usize> = (0..lines.len()).collect();
    for (found, name, order, there) in [
        (values(&tokens.agents), "output.obj_feature", order, &agents),
        (values(&tokens.lines), "output.map_feature", &all_lines[..], &lines),
        (values(&output.dense), "output.pred_dense_trajs", order, &agents),
    ] {
        let (golden, width) = (file.floats(name), found.len() / order.len());
        for (found, &row) in found.chunks_exact(width).zip(order).filter(|(_, row)| there[**row]) {
            assert_close(
                found,
                &golden[row * width..(row + 1) * width],
                limit,
                &format!("{scene}, {name}, row {row}"),
            );
        }
    }
    for (i, layer) in output.layers.iter().enumerate() {
        let golden = |part: &str| file.floats(&format!("output.layer_{i}_pred_{part}"));
        assert_close(
            &values(&layer.scores),
            &golden("scores"),
            limit,
            &format!("{scene}, scores of layer {i}"),
        );
        assert_close(&values(&layer.modes), &golden("trajs"), limit, &format!("{scene}, modes of layer {i}"));
    }

    let width = CONFIG.states() * STATE;
    let last = output.layers.last().unwrap();
    let (scores, modes) = (values(&last.scores), values(&last.modes));
    let (kept, probabilities) =
        (file.integers("output.final_mode_idxs"), file.floats("output.final_pred_scores"));
    let queries = batch.queries;
    for i in 0..batch.scenes {
        let modes = &modes[i * queries * width..(i + 1) * queries * width];
        let (found, all) = kept_modes(&scores[i * queries..(i + 1) * queries], modes, &CONFIG);
        assert_eq!(found, kept[i * 6..(i + 1) * 6], "{scene}, modes that remain");
        let found: Vec<f32> = found.iter().map(|&mode| all[mode] as f32).collect();
        assert_close(&found, &probabilities[i * 6..(i + 1) * 6], limit, &format!("{scene}, probabilities"));
    }
}
