//! Scenes and rollouts from above, as SVG.
//!
//! A picture shows the map, the agents as boxes with their headings and trails, the AV in its own
//! colour, and the lights at the drawn step. With a rollout, realised tracks are solid and logged ones
//! thin dashed ghosts. North is up; nothing outside the view is written. Colours are those of Okabe and
//! Ito, which most colour-blind people can distinguish; important elements also differ in shape.

mod agents;
pub(crate) mod canvas;
mod clip;
mod ground;
mod moving;
pub(super) mod palette;

use reactsim_geometry::Vec2;
use reactsim_metrics::{Case, Event, Options, score_case};
use reactsim_scene::{DT, Frame, Scenario};

pub(crate) use self::canvas::escape;
use self::canvas::{Canvas, Window};

/// An event to mark in a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Id of the agent; marks of unknown agents are ignored.
    pub agent: String,
    /// Step of the event, from 1.
    pub step: usize,
    /// Kind of event.
    pub kind: MarkKind,
}

/// Kind of event that a [`Mark`] shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MarkKind {
    /// A collision at fault: a thick ring.
    AtFault,
    /// A collision without fault or among agents: a dashed ring.
    Contact,
    /// A risky time to collision: a triangle.
    Risky,
    /// Off the road: a cross.
    OffRoad,
}

impl MarkKind {
    /// Returns the mark for events of a metric; `None` if pictures show none.
    pub fn of_event(metric: &str, counted: bool) -> Option<Self> {
        match metric {
            "aav-collision" if counted => Some(Self::AtFault),
            "aav-collision" | "aa-collision" => Some(Self::Contact),
            "aav-ttc" => Some(Self::Risky),
            "offroad" => Some(Self::OffRoad),
            _ => None,
        }
    }
}

/// Computes the events of a rollout and returns the marks of those that pictures show. `tracks`: the frames
/// of each agent, in the order of the scenario.
pub fn marks_of(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Vec<Mark> {
    let scores = score_case(&Case::of_rollout(scenario, tracks, Options::default()));
    let mark = |event: Event| {
        let kind = MarkKind::of_event(event.metric, event.counted)?;
        Some(Mark { step: event.step, kind, agent: event.agent })
    };
    scores.events.into_iter().filter_map(mark).collect()
}

/// Settings of a picture, with the AV in the middle of each panel.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// Half of the side of a panel, metres; at least 5.
    pub radius: f64,
    /// Steps to draw, one per panel, four panels to a row. 0 is the current frame; larger ones than the last
    /// step mean the last. If empty, step 0.
    pub steps: Vec<usize>,
    /// Side of a panel, pixels; at least 100.
    pub size: f64,
    /// Title; by default the id of the scenario.
    pub title: Option<String>,
    /// Realised tracks: the frames of each agent, in the order of the scenario; the log without them.
    pub rollout: Option<&'a [Vec<Frame>]>,
    /// Events of the rollout.
    pub marks: Vec<Mark>,
}

impl Default for View<'_> {
    fn default() -> Self {
        Self { radius: 60.0, steps: vec![0], size: 720.0, title: None, rollout: None, marks: Vec::new() }
    }
}

/// Panels per row.
const PANELS_PER_ROW: usize = 4;
/// Height of the title, pixels.
const TITLE_HEIGHT: f64 = 40.0;
/// Height of the legend, pixels.
const LEGEND_HEIGHT: f64 = 34.0;
/// Space around panels, pixels.
const PANEL_GAP: f64 = 12.0;

/// Input of the drawing functions.
pub(crate) struct Scene<'a> {
    scenario: &'a Scenario,
    view: &'a View<'a>,
    /// The logged frames of each agent.
    logged: Vec<Vec<Frame>>,
    /// The current frame.
    current: usize,
    /// The last step.
    pub(crate) last: usize,
}

impl<'a> Scene<'a> {
    pub(crate) fn new(scenario: &'a Scenario, view: &'a View<'a>) -> Self {
        let agents = scenario.start.agents.len();
        let length = scenario.length();
        Self {
            scenario,
            view,
            logged: (0..agents).map(|i| scenario.logged(i)).collect(),
            current: length.current(),
            last: length.future,
        }
    }

    /// Returns the tracks that are drawn solid.
    fn tracks(&self) -> &[Vec<Frame>] {
        self.view.rollout.unwrap_or(&self.logged)
    }

    /// Returns a state of a drawn track; `None` if it is absent or the track is too short.
    pub(crate) fn state(&self, agent: usize, step: usize) -> Frame {
        let frame = self.tracks().get(agent)?.get(self.current + step).copied().flatten();
        frame.filter(|s| s.is_finite())
    }
}

/// Draws a scenario, or a rollout of it, as an SVG document.
pub fn draw(scenario: &Scenario, view: &View<'_>) -> String {
    let scene = Scene::new(scenario, view);
    let mut steps: Vec<usize> = view.steps.iter().map(|s| (*s).min(scene.last)).collect();
    if steps.is_empty() {
        steps.push(0);
    }
    let size = if view.size.is_finite() { view.size.max(100.0) } else { 720.0 };
    let (columns, rows) = (steps.len().min(PANELS_PER_ROW), steps.len().div_ceil(PANELS_PER_ROW));
    let width = PANEL_GAP + columns as f64 * (size + PANEL_GAP);
    let height = TITLE_HEIGHT + rows as f64 * (size + PANEL_GAP) + LEGEND_HEIGHT;
    let mut canvas = Canvas::new(width, height);
    let title = view.title.as_deref().unwrap_or(&scenario.id);
    canvas.text(Vec2::new(PANEL_GAP, 26.0), title, "font-size=\"17\" font-weight=\"600\" fill=\"#22252b\"");
    for (i, &step) in steps.iter().enumerate() {
        let (column, row) = (i % PANELS_PER_ROW, i / PANELS_PER_ROW);
        let corner = Vec2::new(
            PANEL_GAP + column as f64 * (size + PANEL_GAP),
            TITLE_HEIGHT + row as f64 * (size + PANEL_GAP),
        );
        panel(&mut canvas, &scene, step, corner, size, i);
    }
    legend(&mut canvas, &scene, height - LEGEND_HEIGHT + 12.0, width);
    canvas.finish()
}

/// Draws one panel: the map, and the agents at a step.
fn panel(canvas: &mut Canvas, scene: &Scene<'_>, step: usize, corner: Vec2, size: f64, number: usize) {
    let middle = scene.state(0, step).unwrap_or_else(|| scene.scenario.start.now(0)).position();
    let radius = if scene.view.radius.is_finite() { scene.view.radius.max(5.0) } else { 60.0 };
    canvas.open_window(Window { middle, radius, corner, size }, number);
    ground::draw(canvas, scene.scenario, scene.current + step);
    agents::draw(canvas, scene, step);
    scale_bar(canvas, corner, size, radius);
    canvas.label(corner + Vec2::new(10.0, 22.0), &format!("step {step} · {:.1} s", step as f64 * DT));
    canvas.close_window();
}

/// Draws a scale bar of a round length at the bottom left.
fn scale_bar(canvas: &mut Canvas, corner: Vec2, size: f64, radius: f64) {
    let lengths = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];
    let metres = lengths.into_iter().rfind(|l| *l <= radius / 2.0).unwrap_or(1.0);
    let pixels = metres * size / (2.0 * radius);
    let (x, y) = (corner.x + 12.0, corner.y + size - 14.0);
    canvas.raw(&format!(
        "<path d=\"M{x:.1} {:.1}v6h{pixels:.1}v-6\" fill=\"none\" stroke=\"#22252b\" stroke-width=\"1.5\"/>",
        y - 6.0
    ));
    canvas.label(Vec2::new(x + pixels + 6.0, y), &format!("{metres} m"));
}

/// Draws the legend of the colours and signs that can occur in the picture.
fn legend(canvas: &mut Canvas, scene: &Scene<'_>, y: f64, width: f64) {
    let mut x = PANEL_GAP;
    let mut entry = |canvas: &mut Canvas, sign: &str, text: &str| {
        let space = 30.0 + 6.6 * text.chars().count() as f64;
        if x + space > width {
            return;
        }
        canvas.raw(&format!("<g transform=\"translate({:.1} {y:.1})\">{sign}</g>", x + 8.0));
        canvas.text(Vec2::new(x + 21.0, y + 4.0), text, "font-size=\"12\" fill=\"#22252b\"");
        x += space;
    };
    let square = |c: &palette::Paint| {
        let (fill, line) = (c.fill, c.line);
        format!("<rect x=\"-7\" y=\"-4\" width=\"14\" height=\"8\" fill=\"{fill}\" stroke=\"{line}\"/>")
    };
    entry(canvas, &square(&palette::AV), "AV");
    for kind in reactsim_scene::AgentKind::ALL {
        let has = scene.scenario.start.agents.iter().skip(1).any(|a| a.kind == kind);
        let context = kind == reactsim_scene::AgentKind::Other && !scene.scenario.start.obstacles.is_empty();
        if has || context {
            entry(canvas, &square(palette::of(kind)), kind.name());
        }
    }
    if scene.view.rollout.is_some() || scene.scenario.deviation.is_some() {
        let what = if scene.view.rollout.is_some() { "in the log" } else { "deviated AV" };
        let line = if scene.view.rollout.is_some() { palette::GHOST } else { palette::AV.line };
        let sign =
            format!("<path d=\"M-8 0h16\" stroke=\"{line}\" stroke-width=\"1.5\" stroke-dasharray=\"4 3\"/>");
        entry(canvas, &sign, what);
    }
    for (kind, text) in [
        (MarkKind::AtFault, "collision at fault"),
        (MarkKind::Contact, "other collision"),
        (MarkKind::Risky, "risky"),
        (MarkKind::OffRoad, "off-road"),
    ] {
        if scene.view.marks.iter().any(|m| m.kind == kind) {
            entry(canvas, &agents::sign(kind, 7.0), text);
        }
    }
}

#[cfg(test)]
mod tests;
