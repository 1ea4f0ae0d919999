//! Scatter plot of the end points of chosen candidates.

use plotters::prelude::*;
use reactsim_curation::stats::Statistics;
use reactsim_scene::Deviation;

use super::{
    Area, DrawResult, category_color, color, empty_message, layout, legend, palette, style, tick, title,
};

/// Draws a dot, a triangle or a cross per scenario: shapes distinguish the categories without colour.
pub(super) fn endpoints(area: &Area<'_>, statistics: &Statistics) -> DrawResult {
    title(
        area,
        "Where the deviated AV ends",
        "Last position (8 s) relative to the log, in the AV's frame at the current time; \
         one mark per chosen candidate",
    )?;
    let points: Vec<(Deviation, (f64, f64))> = statistics
        .endpoints
        .iter()
        .filter_map(|e| Some((Deviation::from_name(e.category)?, (e.longitudinal?, e.lateral?))))
        .collect();
    if points.is_empty() {
        return empty_message(area);
    }
    legend(area, statistics, |area, category, at| {
        mark(category, |shape| match shape {
            Shape::Dot(style) => Ok(area.draw(&Circle::new(at, 5, style))?),
            Shape::Triangle(style) => Ok(area.draw(&TriangleMarker::new(at, 6, style))?),
            Shape::Cross(style) => Ok(area.draw(&Cross::new(at, 5, style))?),
        })
    })?;
    let (x, y) = (range(points.iter().map(|p| p.1.0)), range(points.iter().map(|p| p.1.1)));
    let mut chart = layout(area).build_cartesian_2d(x.clone(), y.clone())?;
    style(
        chart
            .configure_mesh()
            .x_desc("Longitudinal offset (m, ahead positive)")
            .y_desc("Lateral offset (m, left positive)")
            .x_label_formatter(&tick)
            .y_label_formatter(&tick),
    )?;
    // The log is at the origin.
    let axis = color(palette::GHOST).stroke_width(1);
    chart.draw_series([
        PathElement::new(vec![(x.start, 0.0), (x.end, 0.0)], axis),
        PathElement::new(vec![(0.0, y.start), (0.0, y.end)], axis),
    ])?;
    for (category, at) in points {
        mark(category, |shape| {
            match shape {
                Shape::Dot(style) => chart.draw_series([Circle::new(at, 4, style)]).map(drop)?,
                Shape::Triangle(style) => chart.draw_series([TriangleMarker::new(at, 5, style)]).map(drop)?,
                Shape::Cross(style) => chart.draw_series([Cross::new(at, 4, style)]).map(drop)?,
            }
            Ok(())
        })?;
    }
    Ok(())
}

enum Shape {
    Dot(ShapeStyle),
    Triangle(ShapeStyle),
    Cross(ShapeStyle),
}

/// Draws the mark of a category. Marks are translucent to show density.
fn mark(category: Deviation, draw: impl FnOnce(Shape) -> DrawResult) -> DrawResult {
    let ink = category_color(category).mix(0.6);
    draw(match category {
        Deviation::Longitudinal => Shape::Dot(ink.filled()),
        Deviation::Lateral => Shape::Triangle(ink.filled()),
        Deviation::Directional => Shape::Cross(ink.stroke_width(2)),
    })
}

/// Returns the range of the values and the origin, with a margin.
fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values.fold((0.0, 0.0), |(a, b): (f64, f64), v| (a.min(v), b.max(v)));
    let margin = (0.06 * (high - low)).max(0.5);
    low - margin..high + margin
}
