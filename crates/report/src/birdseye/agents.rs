//! Agents: boxes, trails, ghosts of the log, and marks.

use std::fmt::Write;

use reactsim_geometry::{Bounds, OrientedBox, Vec2, direction};
use reactsim_scene::levels::{LEVEL_GAP, RoadHeights};
use reactsim_scene::{Agent, AgentKind, AgentState};

use super::canvas::{Canvas, PathData};
use super::palette::{self, Paint};
use super::{Mark, MarkKind, Scene};

/// Number of frames per stretch of a fading trail.
const STRETCH_FRAMES: usize = 8;
/// Distance in metres between realised and logged position above which the log is drawn as a ghost.
const GHOST_DISTANCE: f64 = 0.5;

/// Draws all agents at a step.
pub(super) fn draw(canvas: &mut Canvas, scene: &Scene<'_>, step: usize) {
    canvas.raw("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">");
    for obstacle in scene.scenario.obstacles_at(scene.current + step) {
        body(canvas, &obstacle, palette::of(AgentKind::Other));
    }
    // The AV is drawn last, on top; what is on a higher level covers it.
    let mut order: Vec<usize> = (0..scene.scenario.start.agents.len()).rev().collect();
    let frames = scene.current + step + 1;
    let tracks = scene.tracks().iter().map(|track| &track[..frames.min(track.len())]);
    let heights = RoadHeights::default().at_end(&scene.scenario.start, &tracks.collect::<Vec<_>>());
    let level = |agent: usize| heights.get(agent).map_or(0, |height| (height / LEVEL_GAP).round() as i64);
    order.sort_by_key(|&agent| level(agent));
    for &agent in &order {
        if scene.view.rollout.is_some() {
            ghost(canvas, scene, agent, step);
        }
        trail(canvas, scene, agent, step);
    }
    deviation(canvas, scene);
    figures(canvas, scene, &order, step);
    canvas.raw("</g>");
    marks(canvas, scene, step, true);
    ids(canvas, scene, step);
}

/// Draws the bodies of agents that are present at a step, in this order.
pub(super) fn figures(canvas: &mut Canvas, scene: &Scene<'_>, order: &[usize], step: usize) {
    for &agent in order {
        if let Some(state) = scene.state(agent, step) {
            figure(canvas, &scene.scenario.start.agents[agent], &state, paint(scene, agent));
        }
    }
}

/// Returns the colours of an agent.
pub(super) fn paint(scene: &Scene<'_>, agent: usize) -> &'static Paint {
    if agent == 0 { &palette::AV } else { palette::of(scene.scenario.start.agents[agent].kind) }
}

/// Draws the past track, paler with age, and the future track as a thin line.
fn trail(canvas: &mut Canvas, scene: &Scene<'_>, agent: usize, step: usize) {
    let Some(track) = scene.tracks().get(agent) else { return };
    let colour = paint(scene, agent).line;
    let now = scene.current + step;
    // The trail of a standing agent would be a blot.
    let places = track.iter().flatten().filter(|s| s.is_finite()).map(AgentState::position);
    let size = Bounds::of(places);
    if (size.max - size.min).norm() < 1.0 {
        return;
    }
    let width = if agent == 0 { 2.4 } else { 1.6 };
    let mut first = 0;
    while first < now {
        let end = (first + STRETCH_FRAMES).min(now);
        let opacity = 0.15 + 0.6 * end as f64 / now as f64;
        let stroke = format!(
            "fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-opacity=\"{opacity:.2}\""
        );
        canvas.draw(&stroke, |path| stretch(path, track, first, end));
        first = end;
    }
    let width = 0.55 * width;
    let stroke =
        format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width:.1}\" stroke-opacity=\"0.4\"");
    canvas.draw(&stroke, |path| stretch(path, track, now, scene.current + scene.last));
}

/// Adds the positions of the frames `first..=last` to a path; gaps break the line.
pub(super) fn stretch(path: &mut PathData, track: &[Option<AgentState>], first: usize, last: usize) {
    let mut points: Vec<Vec2> = Vec::new();
    for frame in first..=last {
        match track.get(frame).copied().flatten().filter(AgentState::is_finite) {
            Some(state) => points.push(state.position()),
            None => {
                path.line(&points);
                points.clear();
            }
        }
    }
    path.line(&points);
}

/// Draws the logged track of an agent that deviates from it, and its logged box at the drawn step.
fn ghost(canvas: &mut Canvas, scene: &Scene<'_>, agent: usize, step: usize) {
    if !(0..=scene.last).any(|k| is_displaced(scene, agent, k)) {
        return;
    }
    canvas.draw(&ghost_style(), |path| {
        stretch(path, &scene.logged[agent], scene.current, scene.current + scene.last);
        ghost_box(path, scene, agent, step);
    });
}

/// Returns whether the position of an agent at a step differs from the log.
pub(super) fn is_displaced(scene: &Scene<'_>, agent: usize, step: usize) -> bool {
    match (scene.state(agent, step), scene.logged[agent][scene.current + step]) {
        (Some(a), Some(b)) => (a.position() - b.position()).norm() > GHOST_DISTANCE,
        _ => false,
    }
}

/// Adds the logged box of an agent.
pub(super) fn ghost_box(path: &mut PathData, scene: &Scene<'_>, agent: usize, step: usize) {
    if let Some(state) = scene.logged[agent][scene.current + step].filter(AgentState::is_finite) {
        path.ring(&state.footprint(&scene.scenario.start.agents[agent]).corners());
    }
}

/// Returns the SVG attributes of ghosts.
pub(super) fn ghost_style() -> String {
    format!(
        "fill=\"none\" stroke=\"{}\" stroke-width=\"0.9\" stroke-dasharray=\"4 3\" stroke-opacity=\"0.8\"",
        palette::GHOST
    )
}

/// Draws the deviated AV of the scenario, if the log is drawn.
fn deviation(canvas: &mut Canvas, scene: &Scene<'_>) {
    let (None, Some(deviation)) = (scene.view.rollout, &scene.scenario.deviation) else { return };
    let mut points = vec![scene.scenario.start.now(0).position()];
    points.extend(deviation.track.iter().filter(|s| s.is_finite()).map(AgentState::position));
    let colour = palette::AV.line;
    let stroke = format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\" stroke-dasharray=\"5 4\"");
    canvas.draw(&stroke, |path| {
        path.line(&points);
        if let Some(last) = deviation.track.last().filter(|s| s.is_finite()) {
            path.ring(&last.footprint(&scene.scenario.start.agents[0]).corners());
        }
    });
}

/// Draws an agent: pedestrians as discs with a tick, others as boxes with a pale wedge at the front.
fn figure(canvas: &mut Canvas, agent: &Agent, state: &AgentState, paint: &Paint) {
    let shape = state.footprint(agent);
    if agent.kind != AgentKind::Pedestrian {
        body(canvas, &shape, paint);
        return;
    }
    let window = canvas.window();
    if !window.bounds().inflated(shape.radius()).contains(shape.center) {
        return;
    }
    let p = window.pixel(shape.center);
    let radius = (shape.half_length.max(shape.half_width) * window.scale()).max(3.2);
    let tip = direction(state.heading) * (radius + 3.0);
    canvas.raw(&format!(
        "<g stroke=\"{}\" opacity=\"1.00\">\
         <path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke-width=\"1.4\"/>\
         <circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"{}\"/></g>",
        paint.line,
        p.x,
        p.y,
        p.x + tip.x,
        p.y - tip.y,
        p.x,
        p.y,
        paint.fill
    ));
}

/// Draws a box with a pale wedge that points ahead.
pub(super) fn body(canvas: &mut Canvas, shape: &OrientedBox, paint: &Paint) {
    let Paint { fill, line } = paint;
    canvas
        .draw(&format!("fill=\"{fill}\" stroke=\"{line}\" stroke-width=\"1\" opacity=\"1.00\""), |outline| {
            outline.ring(&shape.corners())
        });
    let (ahead, aside) = (shape.axis * shape.half_length, shape.left() * (0.62 * shape.half_width));
    let (tip, base) = (shape.center + ahead * 0.88, shape.center + ahead * 0.38);
    canvas.draw("fill=\"#ffffff\" fill-opacity=\"0.85\"", |wedge| {
        wedge.ring(&[tip, base + aside, base - aside]);
    });
}

/// Draws the events up to a step at the agent's position at that time, optionally with their steps.
pub(super) fn marks(canvas: &mut Canvas, scene: &Scene<'_>, last: usize, numbered: bool) {
    let window = canvas.window();
    let mut marks: Vec<_> = scene.view.marks.iter().filter(|m| m.step <= last).collect();
    marks.sort_by_key(|m| (m.step, m.kind));
    for mark in marks {
        let Some(place) = place(scene, mark).filter(|p| window.bounds().contains(*p)) else { continue };
        let p = window.pixel(place);
        let radius = match mark.kind {
            MarkKind::AtFault | MarkKind::Contact => (3.4 * window.scale()).max(9.0),
            MarkKind::Risky => 7.0,
            MarkKind::OffRoad => 5.0,
        };
        canvas.raw(&format!(
            "<g transform=\"translate({:.1} {:.1})\">{}</g>",
            p.x,
            p.y,
            sign(mark.kind, radius)
        ));
        if numbered {
            let position = p + Vec2::new(0.75 * radius + 2.0, 0.75 * radius + 9.0);
            let attributes = format!("font-size=\"10\" fill=\"{}\"", palette::EVENT);
            canvas.text(position, &format!("step {}", mark.step), &attributes);
        }
    }
}

/// Returns the position of the agent at its event; `None` for unknown and absent agents.
pub(super) fn place(scene: &Scene<'_>, mark: &Mark) -> Option<Vec2> {
    let agent = scene.scenario.start.agents.iter().position(|a| a.id == mark.agent)?;
    scene.state(agent, mark.step).map(|s| s.position())
}

/// Returns the SVG sign of an event with radius `r` in pixels, around the origin.
pub(super) fn sign(kind: MarkKind, r: f64) -> String {
    let colour = palette::EVENT;
    match kind {
        MarkKind::AtFault => format!(
            "<circle r=\"{r:.1}\" fill=\"{colour}\" fill-opacity=\"0.10\" stroke=\"{colour}\" \
             stroke-width=\"2.6\"/>"
        ),
        MarkKind::Contact => format!(
            "<circle r=\"{r:.1}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" \
             stroke-dasharray=\"4 3\"/>"
        ),
        MarkKind::Risky => format!(
            "<path d=\"M0 {:.1}L{:.1} {:.1}H{:.1}Z\" fill=\"#ffd34d\" stroke=\"#22252b\" \
             stroke-width=\"1.2\"/>",
            -r,
            0.95 * r,
            0.7 * r,
            -0.95 * r
        ),
        MarkKind::OffRoad => format!(
            "<path d=\"M{0:.1} {0:.1}L{r:.1} {r:.1}M{0:.1} {r:.1}L{r:.1} {0:.1}\" stroke=\"{colour}\" \
             stroke-width=\"2.4\"/>",
            -r
        ),
    }
}

/// Writes the ids of the agents in the picture next to them.
fn ids(canvas: &mut Canvas, scene: &Scene<'_>, step: usize) {
    let window = canvas.window();
    let mut halos = String::new();
    let mut texts = String::new();
    for (agent, about) in scene.scenario.start.agents.iter().enumerate() {
        let Some(state) = scene.state(agent, step) else { continue };
        if !window.bounds().contains(state.position()) {
            continue;
        }
        let shape = state.footprint(about);
        // To the right of the box and above its centre, for any heading.
        let reach = shape.corners().iter().map(|c| c.x - shape.center.x).fold(0.0, f64::max);
        let p = window.pixel(state.position()) + Vec2::new(reach.min(3.0) * window.scale() + 2.0, -3.0);
        let name = if agent == 0 { "AV" } else { about.id.as_str() };
        let id = super::canvas::escape(name);
        let _ = writeln!(halos, "<text x=\"{:.1}\" y=\"{:.1}\">{id}</text>", p.x, p.y);
        let bold = if agent == 0 { " font-weight=\"700\" font-size=\"12\"" } else { "" };
        let _ = writeln!(
            texts,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{}\"{bold}>{id}</text>",
            p.x,
            p.y,
            paint(scene, agent).line
        );
    }
    canvas.raw(&format!(
        "<g font-size=\"9\">\n\
         <g stroke=\"#ffffff\" stroke-width=\"2.5\" stroke-opacity=\"0.8\" stroke-linejoin=\"round\">\n\
         {halos}</g>\n{texts}</g>"
    ));
}
