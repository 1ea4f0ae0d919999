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
    let mut distances: Vec<(f32, usize)> = Vec::with_capacity(lines);
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
        distances.extend(places.iter().enumerate().map(|(i, place)| {
            let d2 = |p: &[f32]| {
                let (x, y) = (p[0] - place[0], p[1] - place[1]);
                x * x + y * y
            };
            (trajectory.as_chunks::<2>().0.iter().map(|p| d2(p)).fold(f32::INFINITY, f32::min), i)
        }));
        if distances.len() > config.way_lines {
            distances
                .select_nth_unstable_by(config.way_lines - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            distances.truncate(config.way_lines);
        }
        distances.iter().for_each(|d| out[d.1] = 0.0);
    }
    Tensor::from_data(TensorData::new(closed, [batch.scenes, 1, queries, lines]), device)
}
