//! The map and its lights.

use std::collections::BTreeMap;
use std::fmt::Write;

use reactsim_geometry::{Vec2, direction, left};
use reactsim_scene::{LaneArea, LaneClass, RoadEdgeKind, RoadMap, Scenario, StopKind};

use super::canvas::{Canvas, PathData};
use super::{clip, palette};

/// Distance between two arrows on a lane, metres.
const ARROW_SPACING: f64 = 24.0;
/// Distance between two stripes of a crosswalk, metres.
const STRIPE_SPACING: f64 = 1.2;
/// Distance from a centre line to the edge of the pale margin around it, metres.
const SHOULDER_HALF_WIDTH: f64 = 2.9;

/// Draws the map, with the lights at `frame`.
pub(super) fn draw(canvas: &mut Canvas, scenario: &Scenario, frame: usize) {
    let map = &scenario.start.map;
    canvas.raw("<g stroke-linejoin=\"round\">");
    for layer in map.layers() {
        surfaces(canvas, &layer);
        crosswalks(canvas, &layer);
        painted_lines(canvas, &layer);
        center_lines(canvas, &layer);
        edges(canvas, &layer);
    }
    stop_lines(canvas, map);
    lights(canvas, scenario, frame);
    canvas.raw("</g>");
}

/// Draws drivable area, lanes, junctions, driveways and speed bumps.
fn surfaces(canvas: &mut Canvas, map: &RoadMap) {
    let window = canvas.window();
    canvas.draw("fill=\"#e6e7ea\" fill-rule=\"evenodd\"", |area| {
        for polygon in map.drivable_area.iter().flatten() {
            area.ring(&polygon.exterior);
            polygon.holes.iter().for_each(|hole| area.ring(hole));
        }
    });
    canvas.draw("fill=\"#e9e9ea\"", |path| map.driveways.iter().for_each(|d| path.ring(&d.outline)));
    let road = format!("fill=\"{}\"", palette::ROAD);
    canvas.draw(&road, |path| map.intersections.iter().for_each(|ring| path.ring(ring)));
    if map.drivable_area.is_none() {
        shoulders(canvas, map);
    }
    for bike in [false, true] {
        let colour = if bike { palette::BIKE_LANE } else { palette::ROAD };
        let mut outlines = PathData::new(window);
        // Corridors of equal width, in centimetres, share one path.
        let mut corridors: BTreeMap<u64, PathData> = BTreeMap::new();
        for lane in map.lanes.iter().filter(|l| (l.class == LaneClass::Bike) == bike) {
            match &lane.area {
                LaneArea::Polygon(ring) => outlines.ring(ring),
                LaneArea::Corridor { half_width } => corridors
                    .entry((half_width * 200.0).round() as u64)
                    .or_insert_with(|| PathData::new(window))
                    .line(lane.baseline.points()),
            }
        }
        canvas.path(&outlines, &format!("fill=\"{colour}\""));
        for (width, path) in &corridors {
            // Without a recorded width, bicycle lanes have that of car lanes: draw half of it.
            let width = *width as f64 / 100.0 * window.scale() * if bike { 0.5 } else { 1.0 };
            canvas.path(path, &format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width:.1}\""));
        }
    }
    canvas.draw("fill=\"#c9c3b2\"", |path| map.speed_bumps.iter().for_each(|b| path.ring(&b.outline)));
}

/// Draws a pale margin around lanes, for maps without drivable polygons, which have gaps between lanes
/// and road edges.
fn shoulders(canvas: &mut Canvas, map: &RoadMap) {
    let width = 2.0 * SHOULDER_HALF_WIDTH * canvas.window().scale();
    let stroke =
        format!("fill=\"none\" stroke=\"#e9eaec\" stroke-width=\"{width:.1}\" stroke-linecap=\"round\"");
    canvas.draw(&stroke, |path| map.lanes.iter().for_each(|lane| path.line(lane.baseline.points())));
}

/// Draws crosswalks with zebra stripes in driving direction, across the longest side of the outline.
fn crosswalks(canvas: &mut Canvas, map: &RoadMap) {
    let window = canvas.window();
    let (mut grounds, mut stripes) = (PathData::new(window), PathData::new(window));
    for crosswalk in &map.crosswalks {
        let ring = match crosswalk.outline.as_slice() {
            [first, rest @ ..] if rest.last() == Some(first) => rest,
            ring => ring,
        };
        grounds.ring(ring);
        let sides = ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| b - a);
        let Some(along) = sides.max_by(|a, b| a.norm().total_cmp(&b.norm())).filter(|d| d.norm() > 0.5)
        else {
            continue;
        };
        let along = along.normalize();
        let across = left(along);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in ring {
            (low, high) = (low.min(p.dot(&along)), high.max(p.dot(&along)));
        }
        let middle = ring.iter().sum::<Vec2>().dot(&across) / ring.len() as f64;
        // Bounds the number of stripes of a damaged outline.
        let count = ((high - low) / STRIPE_SPACING).min(200.0) as usize;
        for k in 0..count {
            let base = along * (low + (k as f64 + 0.5) * (high - low) / count as f64) + across * middle;
            for (a, b) in clip::inside(base - across * 20.0, base + across * 20.0, ring) {
                stripes.line(&[a, b]);
            }
        }
    }
    let width = 0.5 * window.scale();
    canvas.path(&grounds, &format!("fill=\"{}\"", palette::ROAD));
    canvas.path(&stripes, &format!("stroke=\"{}\" stroke-width=\"{width:.1}\"", palette::WHITE));
}

/// Draws road lines: white and yellow, solid and broken.
fn painted_lines(canvas: &mut Canvas, map: &RoadMap) {
    let scale = canvas.window().scale();
    for (paints, colour, broken) in [
        (&[0, 2, 3][..], palette::WHITE, false),
        (&[1], palette::WHITE, true),
        (&[6, 7, 8], palette::YELLOW, false),
        (&[4, 5], palette::YELLOW, true),
    ] {
        let dashes = if broken {
            format!(" stroke-dasharray=\"{:.1} {:.1}\"", 3.0 * scale, 4.5 * scale)
        } else {
            String::new()
        };
        let width = (0.15 * scale).max(1.0);
        let stroke = format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width:.1}\"{dashes}");
        let lines = map.road_lines.iter().filter(|l| paints.contains(&l.paint));
        canvas.draw(&stroke, |path| lines.for_each(|l| path.line(&l.points)));
    }
}

/// Draws centre lines with arrows in driving direction.
fn center_lines(canvas: &mut Canvas, map: &RoadMap) {
    let window = canvas.window();
    let (mut lines, mut arrows) = (PathData::new(window), PathData::new(window));
    for lane in &map.lanes {
        lines.line(lane.baseline.points());
        let count = (lane.baseline.length() / ARROW_SPACING).ceil().min(500.0);
        for k in 0..count as usize {
            let s = (k as f64 + 0.5) * lane.baseline.length() / count;
            let tip = lane.baseline.at(s);
            let ahead = direction(lane.baseline.heading_at(s));
            let aside = left(ahead);
            if window.bounds().contains(tip) {
                arrows.line(&[tip - ahead * 0.9 + aside * 0.55, tip, tip - ahead * 0.9 - aside * 0.55]);
            }
        }
    }
    let colour = palette::CENTER;
    canvas.path(&lines, &format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"0.7\""));
    canvas.path(&arrows, &format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\""));
}

/// Draws road edges; medians are thinner.
fn edges(canvas: &mut Canvas, map: &RoadMap) {
    for (median, width) in [(true, 1.1), (false, 1.8)] {
        let of_kind = map.road_edges.iter().filter(|e| (e.kind == RoadEdgeKind::Median) == median);
        let stroke = format!("fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"", palette::EDGE);
        canvas.draw(&stroke, |path| of_kind.for_each(|e| path.line(&e.points)));
    }
}

/// Draws stop lines of signs (solid) and give-way lines (broken). [`lights`] draws those of lights.
fn stop_lines(canvas: &mut Canvas, map: &RoadMap) {
    let width = (0.4 * canvas.window().scale()).max(1.5);
    for (kind, dashes) in [(StopKind::Sign, ""), (StopKind::Yield, " stroke-dasharray=\"3 2\"")] {
        let of_kind = map.stop_lines.iter().filter(|l| l.kind == kind);
        let stroke = format!("stroke=\"{}\" stroke-width=\"{width:.1}\"{dashes}", palette::STOP);
        canvas.draw(&stroke, |path| of_kind.for_each(|l| path.line(&l.ends)));
    }
}

/// Draws lights: a bar across the lane in the light's colour, and a sign whose shape shows the state.
fn lights(canvas: &mut Canvas, scenario: &Scenario, frame: usize) {
    let window = canvas.window();
    let mut signs = String::new();
    for (i, light) in scenario.start.lights.iter().enumerate() {
        let state = scenario.light_states(i).get(frame).copied().flatten();
        let colour = palette::light(state);
        let line = scenario
            .start
            .map
            .stop_lines
            .iter()
            .filter(|l| l.kind == StopKind::Light && l.lane == light.lane)
            .min_by(|a, b| {
                let far =
                    |l: &reactsim_scene::StopLine| (0.5 * (l.ends[0] + l.ends[1]) - light.stop_point).norm();
                far(a).total_cmp(&far(b))
            });
        if let Some(line) = line {
            let width = (0.5 * window.scale()).max(2.0);
            let stroke = format!("stroke=\"{colour}\" stroke-width=\"{width:.1}\"");
            canvas.draw(&stroke, |bar| bar.line(&line.ends));
        }
        if !window.bounds().contains(light.stop_point) {
            continue;
        }
        let p = window.pixel(light.stop_point);
        let shape = match state {
            Some(s) if s.is_red() => "<rect x=\"-4\" y=\"-4\" width=\"8\" height=\"8\"/>",
            Some(s) if s.is_yellow() => "<path d=\"M0 -5L5 4H-5Z\"/>",
            _ => "<circle r=\"4.2\"/>",
        };
        let _ = writeln!(
            signs,
            "<g transform=\"translate({:.1} {:.1})\" fill=\"{colour}\" stroke=\"#ffffff\" stroke-width=\"1\">\
             {shape}</g>",
            p.x, p.y
        );
    }
    canvas.raw(&signs);
}
