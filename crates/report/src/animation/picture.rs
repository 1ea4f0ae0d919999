//! Rasterised frames of an animation.

use reactsim_geometry::Vec2;
use reactsim_scene::{DT, FUTURE};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{self, Options, Tree};

use super::Panel;
use super::camera::Camera;
use super::letters;
use super::palette::{Colour, rgb};
use crate::birdseye::{Mark, MarkKind, moving::StepRenderer, palette};

/// Panels per row.
const PANELS_PER_ROW: usize = 4;
/// Space between panels, pixels.
const PANEL_GAP: usize = 8;
/// Height of the title line above a panel, pixels.
const TITLE_HEIGHT: usize = 26;
/// Height of the area of the time bar below a panel, pixels.
const TIME_HEIGHT: usize = 20;
/// Height of the time bar, pixels.
const BAR_HEIGHT: usize = 6;
/// Height of the tick of an event, pixels.
const TICK_HEIGHT: usize = 14;
/// Background colour.
const PAPER: Colour = [255; 3];

/// A picture without transparency.
#[derive(Clone)]
pub(super) struct Picture {
    /// Pixels in row-major order.
    pub(super) pixels: Vec<Colour>,
    width: usize,
}

impl Picture {
    fn new(width: usize, height: usize) -> Self {
        Self { pixels: vec![PAPER; width * height], width }
    }

    /// Fills a rectangle, clipped to the picture.
    pub(super) fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Colour) {
        let right = (x + width).min(self.width);
        for row in self.pixels.chunks_exact_mut(self.width).skip(y).take(height) {
            if let Some(row) = row.get_mut(x..right) {
                row.fill(colour);
            }
        }
    }

    /// Copies opaque pixels.
    fn put(&mut self, pixmap: &Pixmap, x: usize, y: usize) {
        let wide = pixmap.width() as usize;
        for (row, from) in
            self.pixels.chunks_exact_mut(self.width).skip(y).zip(pixmap.data().chunks_exact(4 * wide))
        {
            for (to, from) in row.iter_mut().skip(x).zip(from.chunks_exact(4)) {
                *to = [from[0], from[1], from[2]];
            }
        }
    }
}

/// Draws an SVG document onto a picture.
fn paint(svg: &str, onto: &mut Pixmap) -> Result<(), usvg::Error> {
    let tree = Tree::from_str(svg, &Options::default())?;
    resvg::render(&tree, Transform::identity(), &mut onto.as_mut());
    Ok(())
}

/// Static content of a panel, redrawn only when it changes.
struct Background {
    svg: String,
    pixels: Pixmap,
}

/// All panels of an animation.
pub(super) struct Stage<'a> {
    panels: &'a [Panel<'a>],
    renderers: Vec<StepRenderer<'a>>,
    backgrounds: Vec<Option<Background>>,
    camera: Camera,
    size: usize,
}

impl<'a> Stage<'a> {
    /// `size`: side of a panel, pixels.
    pub(super) fn new(
        panels: &'a [Panel<'a>],
        renderers: Vec<StepRenderer<'a>>,
        camera: Camera,
        size: usize,
    ) -> Self {
        let backgrounds = panels.iter().map(|_| None).collect();
        Self { panels, renderers, backgrounds, camera, size }
    }

    /// Returns the width in pixels.
    pub(super) fn width(&self) -> usize {
        let columns = self.panels.len().min(PANELS_PER_ROW);
        columns * (self.size + PANEL_GAP) - PANEL_GAP
    }

    /// Returns the height in pixels.
    pub(super) fn height(&self) -> usize {
        self.panels.len().div_ceil(PANELS_PER_ROW) * (TITLE_HEIGHT + self.size + TIME_HEIGHT)
    }

    /// Draws all panels at a step.
    pub(super) fn draw(&mut self, step: usize) -> Result<Picture, usvg::Error> {
        let mut picture = Picture::new(self.width(), self.height());
        for number in 0..self.panels.len() {
            let x = number % PANELS_PER_ROW * (self.size + PANEL_GAP);
            let y = number / PANELS_PER_ROW * (TITLE_HEIGHT + self.size + TIME_HEIGHT);
            title_line(&mut picture, &self.panels[number].title, step, [x, y], self.size);
            picture.put(&self.panel(number, step)?, x, y + TITLE_HEIGHT);
            frame(&mut picture, [x, y + TITLE_HEIGHT], self.size);
            let bottom = y + TITLE_HEIGHT + self.size;
            time_bar(&mut picture, &self.panels[number].marks, step, [x, bottom], self.size);
        }
        Ok(picture)
    }

    fn panel(&mut self, number: usize, step: usize) -> Result<Pixmap, usvg::Error> {
        let renderer = &self.renderers[number];
        let middle: Vec2 = self.camera.middle(renderer, step);
        let svg = renderer.background(step, middle);
        let background = &mut self.backgrounds[number];
        if background.as_ref().is_none_or(|b| b.svg != svg) {
            let side = self.size as u32;
            let mut pixels = Pixmap::new(side, side).ok_or(usvg::Error::InvalidSize)?;
            paint(&svg, &mut pixels)?;
            *background = Some(Background { svg, pixels });
        }
        let mut pixels = background.as_ref().map(|b| b.pixels.clone()).ok_or(usvg::Error::InvalidSize)?;
        paint(&renderer.foreground(step, middle), &mut pixels)?;
        Ok(pixels)
    }
}

/// Draws the title and the time.
fn title_line(picture: &mut Picture, title: &str, step: usize, [x, y]: [usize; 2], size: usize) {
    let scale = if size < 320 { 1 } else { 2 };
    let ink = rgb(palette::STOP);
    let time = format!("{:.1} s", step as f64 * DT);
    let begin = size.saturating_sub(letters::width(&time, scale) + 4);
    let top = y + (TITLE_HEIGHT - letters::HEIGHT * scale) / 2;
    // Truncate a long title to leave space for the time.
    let mut fits = title;
    while letters::width(fits, scale) + 12 > begin {
        let Some((last, _)) = fits.char_indices().next_back() else { break };
        fits = &fits[..last];
    }
    letters::write(fits, scale, |dx, dy, side| picture.fill(x + 4 + dx, top + dy, side, side, ink));
    letters::write(&time, scale, |dx, dy, side| picture.fill(x + begin + dx, top + dy, side, side, ink));
}

/// Draws a thin line around a panel.
fn frame(picture: &mut Picture, [x, y]: [usize; 2], size: usize) {
    let line = rgb(palette::FRAME);
    picture.fill(x, y, size, 1, line);
    picture.fill(x, y + size - 1, size, 1, line);
    picture.fill(x, y, 1, size, line);
    picture.fill(x + size - 1, y, 1, size, line);
}

/// Draws the time bar, with gaps at full seconds and a tick for every event.
fn time_bar(picture: &mut Picture, marks: &[Mark], step: usize, [x, y]: [usize; 2], size: usize) {
    let at = |step: usize| step.min(FUTURE) * (size - 2) / FUTURE;
    let top = y + (TIME_HEIGHT - BAR_HEIGHT) / 2;
    picture.fill(x, top, size, BAR_HEIGHT, rgb(palette::ROAD));
    picture.fill(x, top, at(step) + 2, BAR_HEIGHT, rgb(palette::EDGE));
    for second in (10..FUTURE).step_by(10) {
        picture.fill(x + at(second), top, 1, BAR_HEIGHT, PAPER);
    }
    let mut marks: Vec<&Mark> = marks.iter().collect();
    // The most severe events are drawn last, on top.
    marks.sort_by_key(|m| (std::cmp::Reverse(m.kind), m.step));
    for mark in marks {
        let colour = match mark.kind {
            MarkKind::Risky => palette::YELLOW,
            _ => palette::EVENT,
        };
        let wide = if mark.kind == MarkKind::AtFault { 4 } else { 2 };
        picture.fill(x + at(mark.step), y + (TIME_HEIGHT - TICK_HEIGHT) / 2, wide, TICK_HEIGHT, rgb(colour));
    }
}
