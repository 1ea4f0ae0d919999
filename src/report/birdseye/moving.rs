//! Moments of an animation: like stills, but without text, and so that little changes from one to the next.
//!
//! A still tells of all that has been and what comes. In an animation time itself does: agents draw a short tail behind them, only the
//! ways of the AV (driven and logged) are shown as a whole, and only who is elsewhere than in the log at this moment has a ghost.

use super::agents::{self, apart, body, figure, ghost_box, ghostly, marks, paint, stretch};
use super::canvas::{Canvas, PathData, Window};
use super::{Scene, View, ground, palette};
use crate::geometry::Vec2;
use crate::scene::{AgentKind, CURRENT, FRAMES, FUTURE, Frame, Scenario};

/// Frames of one stretch of a tail, and stretches of it.
const TAIL_STRETCH: usize = 5;
const TAIL: usize = 4;

/// A scenario or a rollout of it, from which moments are drawn.
pub(in crate::report) struct Moving<'a> {
    scene: Scene<'a>,
}

impl<'a> Moving<'a> {
    /// `view`: its rollout, marks, radius (metres) and size (pixels) count.
    pub(in crate::report) fn new(scenario: &'a Scenario, view: &'a View<'a>) -> Self {
        Self { scene: Scene::new(scenario, view) }
    }

    /// The AV's state at a step, 0 to 80.
    pub(in crate::report) fn av(&self, step: usize) -> Frame {
        self.scene.state(0, step)
    }

    /// Where the events happened that are pointed out.
    pub(in crate::report) fn marked(&self) -> impl Iterator<Item = Vec2> {
        self.scene.view.marks.iter().filter_map(|mark| agents::place(&self.scene, mark))
    }

    /// What lies below all that moves, an SVG document: the map with the lights of this step, and the ways of the AV. `middle`: metres.
    pub(in crate::report) fn below(&self, step: usize, middle: Vec2) -> String {
        let mut canvas = self.canvas(middle);
        canvas.background();
        ground::draw(&mut canvas, self.scene.scenario, CURRENT + step.min(FUTURE));
        ways(&mut canvas, &self.scene);
        canvas.finish()
    }

    /// What moves, and the events so far: an SVG document of the same size without a ground.
    pub(in crate::report) fn above(&self, step: usize, middle: Vec2) -> String {
        let mut canvas = self.canvas(middle);
        moment(&mut canvas, &self.scene, step.min(FUTURE));
        canvas.finish()
    }

    fn canvas(&self, middle: Vec2) -> Canvas {
        let View { radius, size, .. } = *self.scene.view;
        Canvas::bare(Window { middle, radius, corner: Vec2::zeros(), size })
    }
}

/// What of agents is the same throughout an animation: static context, and the AV's ways.
fn ways(canvas: &mut Canvas, scene: &Scene<'_>) {
    canvas.raw("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">");
    for obstacle in &scene.scenario.start.obstacles {
        body(canvas, obstacle, palette::of(AgentKind::Other), 1.0);
    }
    if scene.view.rollout.is_some() && (0..=FUTURE).any(|k| apart(scene, 0, k)) {
        let mut path = PathData::new(canvas.window());
        stretch(&mut path, &scene.logged[0], CURRENT, FRAMES - 1);
        canvas.path(&path, &ghostly());
    }
    if let Some(track) = scene.tracks().first() {
        let mut path = PathData::new(canvas.window());
        stretch(&mut path, track, CURRENT, FRAMES - 1);
        let colour = palette::AV.line;
        canvas.path(
            &path,
            &format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" stroke-opacity=\"0.5\""),
        );
    }
    canvas.raw("</g>");
}

/// All agents at one step of an animation, with tails, ghosts and the events so far.
fn moment(canvas: &mut Canvas, scene: &Scene<'_>, step: usize) {
    let order: Vec<usize> = (0..scene.scenario.start.agents.len()).rev().collect();
    canvas.raw("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">");
    let mut ghosts = PathData::new(canvas.window());
    for &agent in &order {
        tail(canvas, scene, agent, step);
        if scene.view.rollout.is_some() && apart(scene, agent, step) {
            ghost_box(&mut ghosts, scene, agent, step);
        }
    }
    canvas.path(&ghosts, &ghostly());
    for &agent in &order {
        if let Some(state) = scene.state(agent, step) {
            figure(canvas, &scene.scenario.start.agents[agent], &state, paint(scene, agent), 1.0);
        }
    }
    canvas.raw("</g>");
    marks(canvas, scene, step, false);
}

/// The way of the last moments, growing paler with age. Stretches lie on a fixed grid of frames, so that they stay as they are drawn.
fn tail(canvas: &mut Canvas, scene: &Scene<'_>, agent: usize, step: usize) {
    let Some(track) = scene.tracks().get(agent) else { return };
    let now = CURRENT + step;
    if scene.state(agent, step).is_none() {
        return;
    }
    let width = if agent == 0 { 2.4 } else { 1.6 };
    let last = now / TAIL_STRETCH;
    for k in last.saturating_sub(TAIL - 1)..=last {
        let mut path = PathData::new(canvas.window());
        stretch(&mut path, track, k * TAIL_STRETCH, now.min((k + 1) * TAIL_STRETCH));
        let opacity = 0.75 * (k + TAIL - last) as f64 / TAIL as f64;
        let colour = paint(scene, agent).line;
        canvas.path(
            &path,
            &format!(
                "fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-opacity=\"{opacity:.2}\" stroke-linecap=\"butt\""
            ),
        );
    }
}
