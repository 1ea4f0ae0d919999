//! Selection of the lines that a query attends to (dynamic map collection).

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::CLOSED;

use super::batch::Batch;
use super::config::Config;

/// Returns the attention mask of queries to lines, `[scenes, 1, queries, lines]`, which is added to
/// scores. Open are the lines around the base point and those nearest to any of the query's trajectory
/// points. `trajectories` are these points, `[scenes, queries, points, 2]`.
pub(crate) fn collected(
    batch: &Batch,
    trajectories: &[f32],
    points: usize,
    config: &Config,
    device: &Device,
) -> Tensor<4> {
    let (lines, queries) = (config.lines, batch.queries);
    let mut closed = vec![CLOSED; batch.scenes * queries * lines];
    // Squares of distances are not negative, so that their bits are in the same order. Lines at the same
    // distance come in their order.
    let mut distances: Vec<f32> = Vec::with_capacity(lines);
    let mut order: Vec<u64> = Vec::with_capacity(lines);
    for (row, trajectory) in trajectories.chunks_exact(points * 2).enumerate() {
        let scene = row / queries;
        let out = &mut closed[row * lines..(row + 1) * lines];
        let places = &batch.line_places[scene];
        for (open, base) in out.iter_mut().zip(&batch.base_lines[scene]) {
            if *base {
                *open = 0.0;
            }
        }
        distances.clear();
        distances.resize(places.len(), f32::INFINITY);
        for point in trajectory.as_chunks::<2>().0 {
            for (distance, place) in distances.iter_mut().zip(places) {
                let (x, y) = (point[0] - place[0], point[1] - place[1]);
                *distance = distance.min(x * x + y * y);
            }
        }
        order.clear();
        order.extend((0..).zip(&distances).map(|(i, d)| u64::from(d.to_bits()) << 32 | i));
        if order.len() > config.way_lines {
            order.select_nth_unstable(config.way_lines - 1);
            order.truncate(config.way_lines);
        }
        order.iter().for_each(|line| out[(line & u64::from(u32::MAX)) as usize] = 0.0);
    }
    Tensor::from_data(TensorData::new(closed, [batch.scenes, 1, queries, lines]), device)
}
