//! Curves of a training as one picture of small charts (SVG).

use std::collections::BTreeMap;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use reactsim_nn::training::Row;

use super::birdseye::palette;

type Points = Vec<(f64, f64)>;
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type DrawResult = Result<(), Box<dyn std::error::Error>>;

pub(super) const FONT: &str = "sans-serif";

/// Charts per row.
const COLUMNS: usize = 3;
/// Size of a chart, pixels.
const SIZE: (u32, u32) = (380, 230);
/// Height of title and legend, pixels.
const HEAD_HEIGHT: u32 = 92;
/// Maximum number of points of a line; further steps are averaged.
const MAX_POINTS: usize = 240;

/// Data of one chart: training and validation values over steps.
#[derive(Default)]
struct Panel {
    learned: Points,
    held_out: Points,
}

/// Draws the rows of a log: loss, metrics, closed-loop metrics, gradient norm and learning rate. The same
/// rows give the same bytes, whatever their wall times.
///
/// # Errors
/// [`ChartError`] if the drawing library fails, which it does only without space to draw.
pub fn draw(rows: &[Row]) -> Result<String, ChartError> {
    let panels = panels(rows);
    let lines = panels.len().div_ceil(COLUMNS);
    let size = (SIZE.0 * COLUMNS as u32, HEAD_HEIGHT + SIZE.1 * lines as u32);
    svg(size, |area| picture(area, &panels, rows))
}

/// Draws on a white area of this size, pixels.
pub(super) fn svg(
    size: (u32, u32),
    picture: impl FnOnce(&Area<'_>) -> DrawResult,
) -> Result<String, ChartError> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    let draw = || -> DrawResult {
        area.fill(&WHITE)?;
        picture(&area)?;
        Ok(area.present()?)
    };
    let drawn = draw().map_err(|error| ChartError(error.to_string()));
    drop(area);
    drawn.map(|()| svg)
}

/// Error of the drawing library.
#[derive(Debug, thiserror::Error)]
#[error("could not draw the chart: {0}")]
pub struct ChartError(pub(super) String);

/// Returns the charts with their titles, in order.
fn panels(rows: &[Row]) -> Vec<(String, Panel)> {
    let (mut loss, mut gradient, mut rate) = (Panel::default(), Panel::default(), Panel::default());
    let (mut metrics, mut closed) = (BTreeMap::new(), BTreeMap::new());
    for row in rows {
        let x = row.step() as f64;
        match row {
            Row::Step(row) => {
                loss.learned.extend(row.loss.map(|y| (x, y)));
                gradient.learned.push((x, row.gradient_norm));
                rate.learned.push((x, row.learning_rate));
                for (name, y) in &row.metrics {
                    metrics.entry(title(name)).or_insert_with(Panel::default).learned.push((x, *y));
                }
            }
            Row::Validation(row) => {
                loss.held_out.push((x, row.loss));
                for (name, y) in &row.metrics {
                    metrics.entry(title(name)).or_insert_with(Panel::default).held_out.push((x, *y));
                }
                for (name, y) in &row.closed_loop {
                    let name = format!("Closed loop: {}", title(name).to_lowercase());
                    closed.entry(name).or_insert_with(Panel::default).held_out.push((x, *y));
                }
            }
        }
    }
    let mut panels = vec![("Loss".to_owned(), loss)];
    panels.extend(metrics);
    panels.extend(closed);
    panels.extend([("Gradient norm".to_owned(), gradient), ("Learning rate".to_owned(), rate)]);
    panels
}

/// Returns the title of a metric.
fn title(name: &str) -> String {
    super::markdown::capital(&name.replace('_', " "))
}

fn picture(area: &Area<'_>, panels: &[(String, Panel)], rows: &[Row]) -> DrawResult {
    let (head, body) = area.split_vertically(HEAD_HEIGHT);
    let best = rows.iter().rev().find_map(|row| match row {
        Row::Validation(row) if row.best => {
            Some(format!("; best network after step {} (validation loss {:.4})", row.step, row.loss))
        }
        _ => None,
    });
    let steps = rows.last().map_or(0, Row::step);
    let about = format!("{}{}", super::table::count(steps as usize, "step"), best.unwrap_or_default());
    styled(&head, "Training", (24, 26), 21, HPos::Left, color(palette::STOP))?;
    styled(&head, &about, (24, 50), 14, HPos::Left, color(palette::GHOST))?;
    for (x, name, ink) in [(24, "training", LEARNED), (180, "validation", HELD_OUT)] {
        head.draw(&PathElement::new(vec![(x, 74), (x + 20, 74)], color(ink).stroke_width(3)))?;
        styled(&head, name, (x + 28, 74), 15, HPos::Left, color(palette::STOP))?;
    }
    let lines = panels.len().div_ceil(COLUMNS);
    for (area, (title, panel)) in body.split_evenly((lines, COLUMNS)).iter().zip(panels) {
        chart(area, title, panel)?;
    }
    Ok(())
}

/// Colour of training curves.
const LEARNED: &str = palette::REFERENCE;
/// Colour of validation curves.
const HELD_OUT: &str = palette::GENERATED;

fn chart(area: &Area<'_>, title: &str, panel: &Panel) -> DrawResult {
    styled(area, title, (24, 18), 15, HPos::Left, color(palette::STOP))?;
    let learned = thin(&panel.learned);
    let all = || learned.iter().chain(&panel.held_out).filter(|(_, y)| y.is_finite());
    let (low, high) = all().fold((f64::MAX, f64::MIN), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
    if low > high {
        return styled(area, "no values", (SIZE.0 as i32 / 2, 110), 14, HPos::Center, color(palette::GHOST));
    }
    // A constant line needs some height too.
    let room = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
    let end = all().fold(1.0_f64, |end, (x, _)| end.max(*x));
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(34).margin_right(18).margin_bottom(4).margin_left(4);
    builder.x_label_area_size(24).y_label_area_size(58);
    let mut chart = builder.build_cartesian_2d(0.0..end, low - room..high + room)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(color(palette::ROAD))
        .axis_style(color(palette::GHOST))
        .label_style((FONT, 12))
        .x_labels(5)
        .y_labels(5)
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .draw()?;
    chart.draw_series([PathElement::new(learned, color(LEARNED).stroke_width(2))])?;
    if !panel.held_out.is_empty() {
        chart.draw_series([PathElement::new(panel.held_out.clone(), color(HELD_OUT).stroke_width(2))])?;
    }
    if panel.held_out.len() <= 40 {
        chart.draw_series(panel.held_out.iter().map(|p| Circle::new(*p, 2, color(HELD_OUT).filled())))?;
    }
    Ok(())
}

/// Converts a colour of the palette.
pub(super) fn color(hex: &str) -> RGBColor {
    let part = |i: usize| hex.get(i..i + 2).and_then(|t| u8::from_str_radix(t, 16).ok()).unwrap_or(0);
    RGBColor(part(1), part(3), part(5))
}

/// Draws text; `at` is its left or centre (by `side`), at half its height.
pub(super) fn styled(
    area: &Area<'_>,
    what: &str,
    at: (i32, i32),
    size: u32,
    side: HPos,
    ink: RGBColor,
) -> DrawResult {
    let style = (FONT, size).into_font().color(&ink).pos(Pos::new(side, VPos::Center));
    area.draw_text(what, &style, at)?;
    Ok(())
}

/// Formats a number on an axis, without trailing zeros.
pub(super) fn tick(value: &f64) -> String {
    // The library accumulates rounding errors in the last bits.
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".to_owned() } else { rounded.to_string().replace('-', "−") }
}

/// Averages neighbouring points, down to at most [`MAX_POINTS`].
fn thin(points: &Points) -> Points {
    let size = points.len().div_ceil(MAX_POINTS).max(1);
    let mean = |chunk: &[(f64, f64)]| {
        let n = chunk.len() as f64;
        (chunk.iter().map(|p| p.0).sum::<f64>() / n, chunk.iter().map(|p| p.1).sum::<f64>() / n)
    };
    points.chunks(size).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_nn::training::{StepRow, ValidationRow, Wall};

    use super::*;

    #[test]
    fn there_is_a_chart_for_everything_that_was_logged() {
        let metrics = |v| BTreeMap::from([("token_accuracy".to_owned(), v)]);
        let mut rows = Vec::new();
        for step in 1..=1000u64 {
            let x = step as f64 / 1000.0;
            rows.push(Row::Step(StepRow {
                step,
                epoch: x,
                loss: (step % 7 != 0).then_some(3.0 - x),
                learning_rate: 1e-3,
                gradient_norm: x,
                items: 1.0,
                samples: 1,
                metrics: metrics(x),
                wall: Wall::default(),
            }));
            if step % 100 == 0 {
                rows.push(Row::Validation(ValidationRow {
                    step,
                    epoch: x,
                    loss: 3.1 - x,
                    best: true,
                    items: 1.0,
                    samples: 1,
                    metrics: metrics(0.9 * x),
                    closed_loop: BTreeMap::from([("collisions".to_owned(), 0.2)]),
                    wall: Wall { seconds: x, per_second: 1.0, memory: 0 },
                }));
            }
        }
        let svg = draw(&rows).unwrap();
        for text in [
            "1000 steps; best network after step 1000 (validation loss 2.1000)",
            "Token accuracy",
            "Closed loop: collisions",
            "Learning rate",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(svg.len() < 100_000, "{}", svg.len());
        assert!(draw(&[]).unwrap().contains("no values"));
        assert_eq!(thin(&(0..1000).map(|i| (f64::from(i), 1.0)).collect()).len(), 200);
    }
}
