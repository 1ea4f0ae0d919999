//! Statistics of a set of deviations as charts (SVG).

mod funnel;
mod histogram;
mod scatter;

use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use reactsim_curation::stats::Statistics;
use reactsim_scene::Deviation;

use super::birdseye::palette;
use super::markdown::capital;

/// Size of a chart, pixels.
const SIZE: (u32, u32) = (800, 500);
pub(super) const FONT: &str = "sans-serif";

/// A chart as a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chart {
    /// Name of the file.
    pub name: &'static str,
    /// Its content. The same statistics give the same bytes.
    pub svg: String,
}

/// Error of the drawing library.
#[derive(Debug, thiserror::Error)]
#[error("could not draw {chart}: {cause}")]
pub struct ChartError {
    /// Name of the file.
    pub chart: &'static str,
    /// Message of the library.
    pub cause: String,
}

pub(super) type DrawResult = Result<(), Box<dyn std::error::Error>>;
type Draw = fn(&Area<'_>, &Statistics) -> DrawResult;
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Reserves space for the axes and the plot, below title and legend.
fn layout<'a, 'b>(area: &'a Area<'b>) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(98).margin_right(28).margin_bottom(12).margin_left(12);
    builder.x_label_area_size(48).y_label_area_size(62);
    builder
}

/// Styles axes, labels and grid lines.
fn style(mesh: &mut MeshStyle<'_, '_, RangedCoordf64, RangedCoordf64, SVGBackend<'_>>) -> DrawResult {
    mesh.label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(color(palette::ROAD))
        .axis_style(color(palette::GHOST))
        .draw()?;
    Ok(())
}

/// Draws all charts.
///
/// # Errors
/// [`ChartError`] if the drawing library fails, which it does only without space to draw.
pub fn charts(statistics: &Statistics) -> Result<Vec<Chart>, ChartError> {
    let draw: [(&'static str, Draw); 4] = [
        ("endpoints.svg", scatter::endpoints),
        ("ade.svg", histogram::ade),
        ("mean-speed-difference.svg", histogram::mean_speed_difference),
        ("funnel.svg", funnel::funnel),
    ];
    draw.into_iter().map(|(name, draw)| chart(name, |area| draw(area, statistics))).collect()
}

fn chart(name: &'static str, draw: impl FnOnce(&Area<'_>) -> DrawResult) -> Result<Chart, ChartError> {
    Ok(Chart { name, svg: picture(name, SIZE, draw)? })
}

/// Draws a picture on white, and returns it as SVG; `chart` names it in errors.
pub(super) fn picture(
    chart: &'static str,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> DrawResult,
) -> Result<String, ChartError> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    let drawn = area
        .fill(&WHITE)
        .map_err(|e| e.to_string())
        .and_then(|()| draw(&area).map_err(|e| e.to_string()))
        .and_then(|()| area.present().map_err(|e| e.to_string()));
    drop(area);
    drawn.map_err(|cause| ChartError { chart, cause })?;
    Ok(svg)
}

/// Draws the axes of a small chart, with about these numbers of labels.
pub(super) fn small_axes(
    chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    labels: (usize, usize),
    y_label: &dyn Fn(&f64) -> String,
) -> DrawResult {
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(color(palette::ROAD))
        .axis_style(color(palette::GHOST))
        .label_style((FONT, 12))
        .x_labels(labels.0)
        .y_labels(labels.1)
        .x_label_formatter(&tick)
        .y_label_formatter(y_label)
        .draw()?;
    Ok(())
}

/// Converts a colour of the palette.
pub(super) fn color(hex: &str) -> RGBColor {
    let part = |i: usize| hex.get(i..i + 2).and_then(|t| u8::from_str_radix(t, 16).ok()).unwrap_or(0);
    RGBColor(part(1), part(3), part(5))
}

fn category_color(category: Deviation) -> RGBColor {
    color(palette::category(category))
}

/// Draws text; `at` is its left, centre or right (by `side`), at half its height.
fn text(area: &Area<'_>, what: &str, at: (i32, i32), size: u32, side: HPos) -> DrawResult {
    styled(area, what, at, size, side, color(palette::STOP))
}

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

/// Draws a title with a line of small text below it.
pub(super) fn title(area: &Area<'_>, what: &str, about: &str) -> DrawResult {
    text(area, what, (24, 26), 21, HPos::Left)?;
    styled(area, about, (24, 50), 14, HPos::Left, color(palette::GHOST))
}

/// Formats a number on an axis, without trailing zeros.
pub(super) fn tick(value: &f64) -> String {
    // The library accumulates rounding errors in the last bits.
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".to_owned() } else { rounded.to_string().replace('-', "−") }
}

/// Draws the categories in one row, each with its mark and its number of candidates.
fn legend(
    area: &Area<'_>,
    statistics: &Statistics,
    mark: impl Fn(&Area<'_>, Deviation, (i32, i32)) -> DrawResult,
) -> DrawResult {
    for (i, category) in Deviation::ALL.into_iter().enumerate() {
        let (x, y) = (90 + 190 * i as i32, 78);
        mark(area, category, (x, y))?;
        let n = statistics.categories.get(category.name()).map_or(0, |p| p.count);
        text(area, &format!("{} ({n})", capital(category.name())), (x + 14, y), 15, HPos::Left)?;
    }
    Ok(())
}

/// Draws the message for an empty set.
fn empty_message(area: &Area<'_>) -> DrawResult {
    text(area, "No candidate is chosen.", (400, 270), 18, HPos::Center)
}
