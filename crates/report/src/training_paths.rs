//! Realism against reactions along trainings, as one picture (SVG).

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use reactsim_evaluation::StudyResults;

use super::birdseye::palette;
use super::table::Column;
use super::training_curves::{Area, ChartError, DrawResult, FONT, color, styled, svg, tick};

/// Metrics of reactions, one chart each.
const REACTIONS: [&str; 2] = ["aav-collision", "over-reaction"];
/// Aggregate of the Sim Agents challenge on the other axis.
const REALISM: &str = "realism_meta_metric";
/// Size of a chart, pixels.
const SIZE: (u32, u32) = (520, 420);
/// Height of the title, pixels.
const HEAD_HEIGHT: u32 = 60;
/// Room of a label, pixels.
const LABEL: (i32, i32) = (120, 15);

/// Networks of a training in the order of their steps, or a simulator alone.
struct Path<'a> {
    name: &'a str,
    /// Step, realism and each of [`REACTIONS`].
    points: Vec<(Option<u64>, f64, [Option<f64>; REACTIONS.len()])>,
}

/// Returns the id of a network that a training kept: the simulator that loads it, the training and the step.
pub fn network_id(simulator: &str, training: &str, step: u64) -> String {
    format!("{simulator}@{training}-{step}")
}

/// Returns training and step of such an id.
fn training_of(id: &str) -> Option<(&str, u64)> {
    let (training, step) = id.split('+').next()?.split_once('@')?.1.rsplit_once('-')?;
    Some((training, step.parse().ok()?))
}

/// Draws a study of kind `realism` with realism metrics: a point per simulator, and a line through the
/// networks of a training ([`network_id`]); `None` without networks of trainings.
///
/// # Errors
/// [`ChartError`] if the drawing library fails.
pub fn draw(results: &StudyResults) -> Result<Option<String>, ChartError> {
    let paths = paths(results);
    if !paths.iter().any(|path| path.points[0].0.is_some()) {
        return Ok(None);
    }
    let size = (SIZE.0 * REACTIONS.len() as u32, HEAD_HEIGHT + SIZE.1);
    svg(size, |area| picture(area, &paths)).map(Some)
}

fn paths(results: &StudyResults) -> Vec<Path<'_>> {
    let mut members = results.study.members.iter().zip(&results.summaries);
    let reactive = members.find(|(member, _)| member.protocol.as_deref() == Some("reactive"));
    let Some((_, summary)) = reactive else { return Vec::new() };
    let mut paths: Vec<Path<'_>> = Vec::new();
    for scored in &results.realism {
        let realism = scored.aggregates.get(REALISM).and_then(|estimate| estimate.mean);
        let (Some(realism), Some(simulator)) = (realism, summary.simulators.get(&scored.id)) else {
            continue;
        };
        let mean = |metric: &str| simulator.metrics.get(metric)?.mean;
        let (name, step) = match training_of(&scored.id) {
            Some((training, step)) => (training, Some(step)),
            None => (scored.title.as_str(), None),
        };
        let point = (step, realism, REACTIONS.map(mean));
        match paths.iter_mut().find(|path| step.is_some() && path.name == name) {
            Some(path) => path.points.push(point),
            None => paths.push(Path { name, points: vec![point] }),
        }
    }
    paths.iter_mut().for_each(|path| path.points.sort_by_key(|(step, ..)| *step));
    paths
}

fn picture(area: &Area<'_>, paths: &[Path<'_>]) -> DrawResult {
    let (head, body) = area.split_vertically(HEAD_HEIGHT);
    let title = "Realism of agents against their reactions to a deviated AV, along trainings";
    styled(&head, title, (24, 30), 19, HPos::Left, color(palette::STOP))?;
    let charts = body.split_evenly((1, REACTIONS.len()));
    for (i, (area, metric)) in charts.iter().zip(REACTIONS).enumerate() {
        chart(area, &Column::benchmark(metric).head(), i, paths)?;
    }
    Ok(())
}

fn chart(area: &Area<'_>, title: &str, i: usize, paths: &[Path<'_>]) -> DrawResult {
    let points = |path: &Path<'_>| -> Vec<(Option<u64>, (f64, f64))> {
        let points = path.points.iter();
        points.filter_map(|(step, x, values)| values[i].map(|y| (*step, (*x, y)))).collect()
    };
    let all: Vec<(f64, f64)> = paths.iter().flat_map(points).map(|(_, at)| at).collect();
    styled(area, title, (24, 16), 15, HPos::Left, color(palette::STOP))?;
    if all.is_empty() {
        return styled(area, "no values", (SIZE.0 as i32 / 2, 200), 14, HPos::Center, color(palette::GHOST));
    }
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(34).margin_right(24).margin_bottom(4).margin_left(4);
    builder.x_label_area_size(44).y_label_area_size(58);
    let mut chart =
        builder.build_cartesian_2d(range(all.iter().map(|p| p.0)), range(all.iter().map(|p| p.1)))?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(color(palette::ROAD))
        .axis_style(color(palette::GHOST))
        .label_style((FONT, 12))
        .x_labels(6)
        .y_labels(6)
        .x_desc("Realism (Sim Agents) ↑")
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .draw()?;
    let mut labels: Vec<(i32, i32)> = Vec::new();
    for (path, ink) in paths.iter().zip(palette::LINES.iter().cycle()) {
        let (points, ink) = (points(path), color(ink));
        let line: Vec<(f64, f64)> = points.iter().map(|(_, at)| *at).collect();
        chart.draw_series([PathElement::new(line.clone(), ink.stroke_width(2))])?;
        chart.draw_series(line.iter().map(|at| Circle::new(*at, 4, ink.filled())))?;
        let Some((step, at)) = points.last() else { continue };
        let label = step.map_or_else(|| path.name.to_owned(), |step| format!("{}, step {step}", path.name));
        // To the side that has room.
        let is_right = at.0 > (chart.x_range().start + chart.x_range().end) / 2.0;
        let (side, gap) = if is_right { (HPos::Right, -9) } else { (HPos::Left, 9) };
        let (x, mut y) = chart.backend_coord(at);
        let begin = if is_right { x - LABEL.0 } else { x };
        while labels.iter().any(|other| (other.0 - begin).abs() < LABEL.0 && (other.1 - y).abs() < LABEL.1) {
            y += LABEL.1;
        }
        labels.push((begin, y));
        let (left, top) = area.get_base_pixel();
        styled(area, &label, (x - left + gap, y - top - 9), 13, side, ink)?;
    }
    Ok(())
}

/// Returns the range of an axis with some room around these values, of which there is one.
fn range(values: impl Iterator<Item = f64> + Clone) -> std::ops::Range<f64> {
    let low = values.clone().fold(f64::MAX, f64::min);
    let high = values.fold(f64::MIN, f64::max);
    let room = if high > low { 0.12 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
    low - room..high + room
}
