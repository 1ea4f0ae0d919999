//! Histograms by category.

use plotters::prelude::*;
use reactsim_curation::stats::{Bins, Distribution, Part, Statistics};
use reactsim_scene::Deviation;

use super::{
    Area, DrawResult, category_color, color, empty_message, layout, legend, palette, style, tick, title,
};

pub(super) fn ade(area: &Area<'_>, statistics: &Statistics) -> DrawResult {
    title(area, "Distance to the log", &about(&statistics.overall.ade, "m"))?;
    stacked(area, statistics, &statistics.bins.ade, "ADE over 8 s (m)", |p| &p.ade)
}

pub(super) fn mean_speed_difference(area: &Area<'_>, statistics: &Statistics) -> DrawResult {
    let Statistics { overall, bins, .. } = statistics;
    title(area, "Speed against the log", &about(&overall.mean_speed_difference, "m/s"))?;
    let label = "Mean speed minus the log's (m/s)";
    stacked(area, statistics, &bins.mean_speed_difference, label, |p| &p.mean_speed_difference)
}

/// Summarises a distribution in one line.
fn about(d: &Distribution, unit: &str) -> String {
    match (d.mean, d.lower_quartile, d.median, d.upper_quartile) {
        (Some(mean), Some(low), Some(median), Some(high)) => format!(
            "{} chosen candidates: mean {mean:.2} {unit}, median {median:.2} {unit}, \
             half of them from {low:.2} to {high:.2} {unit}",
            d.n
        )
        .replace(" -", " −"),
        _ => String::new(),
    }
}

/// Draws stacked bars of the categories.
fn stacked(
    area: &Area<'_>,
    statistics: &Statistics,
    bins: &Bins,
    label: &str,
    of: fn(&Part) -> &Distribution,
) -> DrawResult {
    if bins.count == 0 {
        return empty_message(area);
    }
    legend(area, statistics, |area, category, (x, y)| {
        let box_ = [(x - 7, y - 7), (x + 7, y + 7)];
        Ok(area.draw(&Rectangle::new(box_, category_color(category).filled()))?)
    })?;
    let highest = of(&statistics.overall).histogram.iter().copied().max().unwrap_or(0).max(1);
    let (left, right) = (bins.edge(0), bins.edge(bins.count));
    let mut chart = layout(area).build_cartesian_2d(left..right, 0.0..1.06 * highest as f64)?;
    style(
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_desc(label)
            .y_desc("Chosen candidates")
            .y_label_formatter(&|n| if n.fract() == 0.0 { format!("{n:.0}") } else { String::new() })
            .x_label_formatter(&tick),
    )?;
    let gap = 0.04 * bins.width;
    let mut below = vec![0; bins.count];
    for category in Deviation::ALL {
        let Some(part) = statistics.categories.get(category.name()) else { continue };
        for (i, n) in of(part).histogram.iter().enumerate().filter(|(_, n)| **n > 0) {
            let (x, y) = (bins.edge(i), below[i]);
            let corners = [(x + gap, y as f64), (x + bins.width - gap, (y + n) as f64)];
            chart.draw_series([Rectangle::new(corners, category_color(category).filled())])?;
            below[i] += n;
        }
    }
    if left < 0.0 && right > 0.0 {
        let line = PathElement::new(vec![(0.0, 0.0), (0.0, 1.06 * highest as f64)], color(palette::STOP));
        chart.draw_series([line])?;
    }
    Ok(())
}
