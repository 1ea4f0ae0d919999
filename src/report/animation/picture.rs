//! Moments as pixels.

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{self, Options, Tree};

use super::Panel;
use super::camera::Camera;
use super::letters;
use super::palette::{Colour, rgb};
use crate::geometry::Vec2;
use crate::report::birdseye::{Mark, MarkKind, moving::Moving, palette};
use crate::scene::{DT, FUTURE};

/// Panels in a row.
const ROW: usize = 4;
/// Space between panels, pixels.
const GAP: usize = 8;
/// Height of the line above a panel and of the bar below it, pixels.
const HEAD: usize = 26;
const FOOT: usize = 20;
/// Height of the bar of time and of a tick, pixels.
const BAR: usize = 6;
const TICK: usize = 14;
/// Around everything.
const PAPER: Colour = [255; 3];

/// A picture without transparency.
#[derive(Clone)]
pub(super) struct Picture {
    /// Row by row.
    pub(super) pixels: Vec<Colour>,
    width: usize,
}

impl Picture {
    fn new(width: usize, height: usize) -> Self {
        Self { pixels: vec![PAPER; width * height], width }
    }

    /// Fills a rectangle; what lies outside is cut off.
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

/// Draws an SVG document over a picture.
fn paint(svg: &str, onto: &mut Pixmap) -> Result<(), usvg::Error> {
    let tree = Tree::from_str(svg, &Options::default())?;
    resvg::render(&tree, Transform::identity(), &mut onto.as_mut());
    Ok(())
}

/// What does not move in a panel, drawn once for as long as it is the same.
struct Below {
    svg: String,
    pixels: Pixmap,
}

/// All panels of an animation.
pub(super) struct Stage<'a> {
    panels: &'a [Panel<'a>],
    moving: Vec<Moving<'a>>,
    below: Vec<Option<Below>>,
    camera: Camera,
    size: usize,
}

impl<'a> Stage<'a> {
    /// `size`: pixels of the side of a panel.
    pub(super) fn new(panels: &'a [Panel<'a>], moving: Vec<Moving<'a>>, camera: Camera, size: usize) -> Self {
        let below = panels.iter().map(|_| None).collect();
        Self { panels, moving, below, camera, size }
    }

    /// Pixels from left to right.
    pub(super) fn width(&self) -> usize {
        let columns = self.panels.len().min(ROW);
        columns * (self.size + GAP) - GAP
    }

    /// Pixels from top to bottom.
    pub(super) fn height(&self) -> usize {
        self.panels.len().div_ceil(ROW) * (HEAD + self.size + FOOT)
    }

    /// All panels at a step.
    pub(super) fn moment(&mut self, step: usize) -> Result<Picture, usvg::Error> {
        let mut picture = Picture::new(self.width(), self.height());
        for number in 0..self.panels.len() {
            let x = number % ROW * (self.size + GAP);
            let y = number / ROW * (HEAD + self.size + FOOT);
            head(&mut picture, &self.panels[number].title, step, [x, y], self.size);
            picture.put(&self.panel(number, step)?, x, y + HEAD);
            frame(&mut picture, [x, y + HEAD], self.size);
            bar(&mut picture, &self.panels[number].marks, step, [x, y + HEAD + self.size], self.size);
        }
        Ok(picture)
    }

    fn panel(&mut self, number: usize, step: usize) -> Result<Pixmap, usvg::Error> {
        let moving = &self.moving[number];
        let middle: Vec2 = self.camera.middle(moving, step);
        let svg = moving.below(step, middle);
        let below = &mut self.below[number];
        if below.as_ref().is_none_or(|b| b.svg != svg) {
            let side = self.size as u32;
            let mut pixels = Pixmap::new(side, side).ok_or(usvg::Error::InvalidSize)?;
            paint(&svg, &mut pixels)?;
            *below = Some(Below { svg, pixels });
        }
        let mut pixels = below.as_ref().map(|b| b.pixels.clone()).ok_or(usvg::Error::InvalidSize)?;
        paint(&moving.above(step, middle), &mut pixels)?;
        Ok(pixels)
    }
}

/// The title and the time.
fn head(picture: &mut Picture, title: &str, step: usize, [x, y]: [usize; 2], size: usize) {
    let scale = if size < 320 { 1 } else { 2 };
    let ink = rgb(palette::STOP);
    let time = format!("{:.1} s", step as f64 * DT);
    let begin = size.saturating_sub(letters::width(&time, scale) + 4);
    let top = y + (HEAD - letters::HEIGHT * scale) / 2;
    // A long title makes room for the time.
    let mut fits = title;
    while letters::width(fits, scale) + 12 > begin {
        let Some((last, _)) = fits.char_indices().next_back() else { break };
        fits = &fits[..last];
    }
    letters::write(fits, scale, |dx, dy, side| picture.fill(x + 4 + dx, top + dy, side, side, ink));
    letters::write(&time, scale, |dx, dy, side| picture.fill(x + begin + dx, top + dy, side, side, ink));
}

/// A thin line around a panel.
fn frame(picture: &mut Picture, [x, y]: [usize; 2], size: usize) {
    let line = rgb(palette::FRAME);
    picture.fill(x, y, size, 1, line);
    picture.fill(x, y + size - 1, size, 1, line);
    picture.fill(x, y, 1, size, line);
    picture.fill(x + size - 1, y, 1, size, line);
}

/// How far time is, seconds by gaps, and a tick for every event.
fn bar(picture: &mut Picture, marks: &[Mark], step: usize, [x, y]: [usize; 2], size: usize) {
    let at = |step: usize| step.min(FUTURE) * (size - 2) / FUTURE;
    let top = y + (FOOT - BAR) / 2;
    picture.fill(x, top, size, BAR, rgb(palette::ROAD));
    picture.fill(x, top, at(step) + 2, BAR, rgb(palette::EDGE));
    for second in (10..FUTURE).step_by(10) {
        picture.fill(x + at(second), top, 1, BAR, PAPER);
    }
    let mut marks: Vec<&Mark> = marks.iter().collect();
    // What weighs most comes last, on top.
    marks.sort_by_key(|m| (std::cmp::Reverse(m.kind), m.step));
    for mark in marks {
        let colour = match mark.kind {
            MarkKind::Risky => palette::YELLOW,
            _ => palette::EVENT,
        };
        let wide = if mark.kind == MarkKind::AtFault { 4 } else { 2 };
        picture.fill(x + at(mark.step), y + (FOOT - TICK) / 2, wide, TICK, rgb(colour));
    }
}
