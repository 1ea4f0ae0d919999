//! Comparison of two sets of scenarios as one picture of small charts (SVG).

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use reactsim_generation::realism::{Comparison, Row, Spread};

use super::birdseye::palette;
use super::curation_charts::{self, Area, ChartError, DrawResult, FONT, color, styled};

/// Charts per row.
const COLUMNS: usize = 4;
/// Size of a chart, pixels.
const SIZE: (u32, u32) = (330, 210);
/// Height of title and legend, pixels.
const HEAD_HEIGHT: u32 = 92;

/// Draws the histograms of both sets over each other, a small chart for each statistic. The same
/// comparison gives the same bytes.
///
/// # Errors
/// [`ChartError`] if the drawing library fails, which it does only without space to draw.
pub fn draw(comparison: &Comparison) -> Result<String, ChartError> {
    let lines = comparison.rows.len().div_ceil(COLUMNS);
    let size = (SIZE.0 * COLUMNS as u32, HEAD_HEIGHT + SIZE.1 * lines as u32);
    curation_charts::picture("the comparison", size, |area| picture(area, comparison, lines))
}

fn picture(area: &Area<'_>, comparison: &Comparison, lines: usize) -> DrawResult {
    let (head, body) = area.split_vertically(HEAD_HEIGHT);
    let ink = color(palette::STOP);
    let about = "Shares of the values in each bin, and the Jensen-Shannon divergence \
                 (0: identical, 1: disjoint).";
    curation_charts::title(&head, "Realism", about)?;
    let side = |s: &reactsim_generation::realism::Side| {
        format!("{}: {}", s.name, super::table::count(s.scenarios as usize, "scenario"))
    };
    let (generated, reference) = (side(&comparison.generated), side(&comparison.reference));
    head.draw(&Rectangle::new([(24, 68), (44, 80)], color(palette::REFERENCE).filled()))?;
    styled(&head, &reference, (52, 74), 15, HPos::Left, ink)?;
    let second = 90 + 8 * reference.chars().count() as i32;
    let line = vec![(second, 74), (second + 20, 74)];
    head.draw(&PathElement::new(line, color(palette::GENERATED).stroke_width(3)))?;
    styled(&head, &generated, (second + 28, 74), 15, HPos::Left, ink)?;
    for (panel, row) in body.split_evenly((lines, COLUMNS)).iter().zip(&comparison.rows) {
        chart(panel, row)?;
    }
    Ok(())
}

/// Draws the chart of one statistic.
fn chart(area: &Area<'_>, row: &Row) -> DrawResult {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" ({})", row.unit) };
    let ink = color(palette::STOP);
    let name = format!("{}{unit}", row.title);
    if row.decides {
        let strong = (FONT, 15).into_font().style(FontStyle::Bold).color(&ink);
        area.draw_text(&name, &strong, (24, 10))?;
    } else {
        styled(area, &name, (24, 18), 15, HPos::Left, ink)?;
    }
    let divergence = row.divergence.map_or_else(|| "–".to_owned(), |d| format!("{d:.3}"));
    styled(area, &divergence, (SIZE.0 as i32 - 14, 18), 15, HPos::Right, color(palette::GHOST))?;
    let (reference, generated) = (shares(&row.reference), shares(&row.generated));
    let highest = reference.iter().chain(&generated).fold(0.0_f64, |a, &b| a.max(b));
    if highest == 0.0 {
        return styled(area, "no values", (SIZE.0 as i32 / 2, 110), 14, HPos::Center, color(palette::GHOST));
    }
    let (left, right) = (row.bins.edge(0), row.bins.edge(row.bins.count));
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(34).margin_right(14).margin_bottom(4).margin_left(4);
    builder.x_label_area_size(24).y_label_area_size(44);
    let mut chart = builder.build_cartesian_2d(left..right, 0.0..1.05 * highest)?;
    curation_charts::small_axes(&mut chart, (6, 4), &|share| format!("{:.0} %", 100.0 * share))?;
    let gap = 0.06 * row.bins.width;
    let bars = reference.iter().enumerate().filter(|(_, share)| **share > 0.0).map(|(i, &share)| {
        let corners = [(row.bins.edge(i) + gap, 0.0), (row.bins.edge(i + 1) - gap, share)];
        Rectangle::new(corners, color(palette::REFERENCE).filled())
    });
    chart.draw_series(bars)?;
    let mut steps = vec![(left, 0.0)];
    for (i, &share) in generated.iter().enumerate() {
        steps.extend([(row.bins.edge(i), share), (row.bins.edge(i + 1), share)]);
    }
    steps.push((right, 0.0));
    if row.generated.n > 0 {
        chart.draw_series([PathElement::new(steps, color(palette::GENERATED).stroke_width(2))])?;
    }
    Ok(())
}

/// Returns the share of each bin; zeros without values.
fn shares(spread: &Spread) -> Vec<f64> {
    let n = spread.n.max(1) as f64;
    spread.histogram.iter().map(|&count| count as f64 / n).collect()
}
