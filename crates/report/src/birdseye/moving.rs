//! Frames of an animation: like stills, but without text, and with small changes between frames.
//!
//! A still shows the whole past and future. An animation shows them over time: agents have a short tail,
//! only the paths of the AV (driven and logged) are shown completely, and only agents that currently
//! deviate from the log have a ghost.

use reactsim_geometry::Vec2;
use reactsim_scene::AgentKind;

use super::agents::{self, body, figures, ghost_box, ghost_style, is_displaced, marks, paint, stretch};
use super::canvas::{Canvas, PathData, Window};
use super::{Scene, ground, palette};

/// Number of frames per stretch of a tail.
const TAIL_STRETCH_FRAMES: usize = 5;
/// Number of stretches of a tail.
const TAIL_STRETCHES: usize = 4;

impl Scene<'_> {
    /// Returns the positions of the marked events.
    pub(crate) fn mark_positions(&self) -> impl Iterator<Item = Vec2> {
        self.view.marks.iter().filter_map(|mark| agents::place(self, mark))
    }

    /// Draws a step in a window of a picture, with the rollout and the marks of the view: the map with its
    /// lights, the paths of the AV, the agents, and the events so far.
    pub(crate) fn draw_step(&self, canvas: &mut Canvas, step: usize, window: Window) {
        canvas.open_window(window, 0);
        let step = step.min(self.last);
        ground::draw(canvas, self.scenario, self.current + step);
        av_paths(canvas, self);
        draw_agents(canvas, self, step);
        canvas.close_window();
    }
}

/// Draws static obstacles and the AV's paths, which are the same throughout an animation.
fn av_paths(canvas: &mut Canvas, scene: &Scene<'_>) {
    canvas.raw("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">");
    for obstacle in &scene.scenario.start.obstacles {
        body(canvas, obstacle, palette::of(AgentKind::Other));
    }
    let (now, end) = (scene.current, scene.current + scene.last);
    if scene.view.rollout.is_some() && (0..=scene.last).any(|k| is_displaced(scene, 0, k)) {
        canvas.draw(&ghost_style(), |path| stretch(path, &scene.logged[0], now, end));
    }
    if let Some(track) = scene.tracks().first() {
        let colour = palette::AV.line;
        let stroke = format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" stroke-opacity=\"0.5\"");
        canvas.draw(&stroke, |path| stretch(path, track, now, end));
    }
    canvas.raw("</g>");
}

/// Draws all agents at one step, with tails, ghosts and the events so far.
fn draw_agents(canvas: &mut Canvas, scene: &Scene<'_>, step: usize) {
    let order: Vec<usize> = (0..scene.scenario.start.agents.len()).rev().collect();
    canvas.raw("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">");
    let mut ghosts = PathData::new(canvas.window());
    for &agent in &order {
        tail(canvas, scene, agent, step);
        if scene.view.rollout.is_some() && is_displaced(scene, agent, step) {
            ghost_box(&mut ghosts, scene, agent, step);
        }
    }
    canvas.path(&ghosts, &ghost_style());
    figures(canvas, scene, &order, step);
    canvas.raw("</g>");
    marks(canvas, scene, step, false);
}

/// Draws the track of the last frames, paler with age. Stretches begin at fixed frames, so that their
/// pixels stay the same between steps.
fn tail(canvas: &mut Canvas, scene: &Scene<'_>, agent: usize, step: usize) {
    let Some(track) = scene.tracks().get(agent) else { return };
    let now = scene.current + step;
    if scene.state(agent, step).is_none() {
        return;
    }
    let width = if agent == 0 { 2.4 } else { 1.6 };
    let last = now / TAIL_STRETCH_FRAMES;
    for k in last.saturating_sub(TAIL_STRETCHES - 1)..=last {
        let opacity = 0.75 * (k + TAIL_STRETCHES - last) as f64 / TAIL_STRETCHES as f64;
        let colour = paint(scene, agent).line;
        let stroke = format!(
            "fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" \
             stroke-opacity=\"{opacity:.2}\" stroke-linecap=\"butt\""
        );
        let (first, end) = (k * TAIL_STRETCH_FRAMES, now.min((k + 1) * TAIL_STRETCH_FRAMES));
        canvas.draw(&stroke, |path| stretch(path, track, first, end));
    }
}
