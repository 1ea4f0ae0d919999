//! Chart of the scenarios and candidates that remain after each step.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use reactsim_curation::stats::Statistics;

use super::{Area, DrawResult, FONT, color, palette, text, title};
use crate::curation_tables::{dropped, rejections};

/// A bar of the funnel.
struct Line {
    name: String,
    /// Number left after this step.
    left: u64,
    /// Number rejected at this step.
    fell: u64,
}

/// Draws bars of the remaining numbers, with the rejected ones in a paler colour at their ends.
pub(super) fn funnel(area: &Area<'_>, statistics: &Statistics) -> DrawResult {
    title(
        area,
        "What is left of scenarios and candidates",
        "Steps 1 to 4 of the pipeline; pale: what fell at this rule",
    )?;
    let (scenarios, candidates) = (scenarios(statistics), candidates(statistics));
    // Both parts share the height: the more filters, the thinner the bars.
    let lines = (scenarios.len() + candidates.len()) as i32;
    let pitch = ((HEIGHT - 2 * HEADING_HEIGHT) / lines.max(1)).min(26);
    let next = part(area, "Scenarios", &scenarios, TOP, pitch)?;
    part(area, "Candidates", &candidates, next, pitch)?;
    Ok(())
}

/// Top edge of the bars, pixels.
const TOP: i32 = 68;
/// Height of both parts together, pixels.
const HEIGHT: i32 = 420;
/// Height of the heading of a part, pixels.
const HEADING_HEIGHT: i32 = 30;
/// Left edge of the bars, pixels.
const LEFT: i32 = 300;
/// Length of the longest bar, pixels.
const MAX_LENGTH: i32 = 360;

fn scenarios(statistics: &Statistics) -> Vec<Line> {
    let mut left = statistics.funnel.scenarios;
    let mut lines = vec![Line { name: "read".into(), left, fell: 0 }];
    for (rule, n) in dropped(statistics) {
        left = left.saturating_sub(n);
        lines.push(Line { name: format!("1: {rule}"), left, fell: n });
    }
    for (name, n) in [("3: with a survivor", statistics.with_survivor), ("4: chosen", statistics.chosen)] {
        let fell = left.saturating_sub(n as u64);
        left = n as u64;
        lines.push(Line { name: name.into(), left, fell });
    }
    lines
}

fn candidates(statistics: &Statistics) -> Vec<Line> {
    let funnel = &statistics.funnel;
    let mut left = funnel.candidates;
    let unproposed = funnel.unproposed.values().sum();
    let mut lines = vec![Line { name: "2: proposed".into(), left, fell: unproposed }];
    for (filter, n) in rejections(statistics) {
        left = left.saturating_sub(n);
        lines.push(Line { name: format!("3: {filter}"), left, fell: n });
    }
    lines
}

/// Draws lines under a heading. Returns the top of the next part.
fn part(
    area: &Area<'_>,
    heading: &str,
    lines: &[Line],
    top: i32,
    pitch: i32,
) -> Result<i32, Box<dyn std::error::Error>> {
    let strong = (FONT, 16).into_font().style(FontStyle::Bold).color(&color(palette::STOP));
    area.draw_text(heading, &strong, (24, top))?;
    let most = lines.iter().map(|l| l.left + l.fell).max().unwrap_or(0).max(1);
    let length = |n: u64| (f64::from(MAX_LENGTH) * n as f64 / most as f64).round() as i32;
    let size = (pitch * 3 / 5).clamp(8, 14) as u32;
    for (i, line) in lines.iter().enumerate() {
        let middle = top + HEADING_HEIGHT + pitch * i as i32 + pitch / 2 - 4;
        let half = (pitch * 2 / 5).max(2);
        text(area, &shortened(&line.name), (LEFT - 10, middle), size, HPos::Right)?;
        let (left, all) = (LEFT + length(line.left), LEFT + length(line.left + line.fell));
        let bar = |from: i32, to: i32| [(from, middle - half), (to, middle + half)];
        area.draw(&Rectangle::new(bar(left, all), color(palette::ROAD).filled()))?;
        area.draw(&Rectangle::new(bar(LEFT, left), color("#00568c").filled()))?;
        let fell = if line.fell > 0 { format!("  (−{})", line.fell) } else { String::new() };
        text(area, &format!("{}{fell}", line.left), (all + 8, middle), size, HPos::Left)?;
    }
    Ok(top + HEADING_HEIGHT + pitch * lines.len() as i32 + 8)
}

/// Truncates names that are too long for the picture.
fn shortened(name: &str) -> String {
    const MAX_CHARS: usize = 42;
    if name.chars().count() <= MAX_CHARS {
        return name.to_owned();
    }
    name.chars().take(MAX_CHARS - 1).chain(['…']).collect()
}
