//! Rasterised frames of an animation.

use std::fmt::Write;

use font8x8::{BASIC_FONTS, LATIN_FONTS, UnicodeFonts};
use reactsim_geometry::Vec2;
use reactsim_scene::DT;
use resvg::tiny_skia::{Pixmap, PixmapPaint, Transform};
use resvg::usvg::{self, Options, Tree};

use super::Panel;
use super::camera::Camera;
use crate::birdseye::canvas::{Canvas, Window};
use crate::birdseye::{Mark, MarkKind, Scene, palette};

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
/// Largest number of steps with a gap in the time bar at every second; longer bars have one every 10 s.
const MOST_SECONDS: usize = 200;
/// Side of a letter, dots.
const LETTER_SIZE: usize = 8;

/// All panels of an animation.
pub(super) struct Stage<'a> {
    pub(super) panels: &'a [Panel<'a>],
    pub(super) scenes: Vec<Scene<'a>>,
    pub(super) camera: Camera,
    /// Side of a panel, pixels.
    pub(super) size: usize,
}

impl Stage<'_> {
    /// Returns the width in pixels.
    pub(super) fn width(&self) -> usize {
        self.panels.len().min(PANELS_PER_ROW) * (self.size + PANEL_GAP) - PANEL_GAP
    }

    /// Returns the height in pixels.
    pub(super) fn height(&self) -> usize {
        self.panels.len().div_ceil(PANELS_PER_ROW) * (TITLE_HEIGHT + self.size + TIME_HEIGHT)
    }

    /// Draws all panels at a step: pixels in row-major order (red, green, blue, alpha).
    pub(super) fn draw(&self, step: usize) -> Result<Vec<[u8; 4]>, usvg::Error> {
        let mut canvas = Canvas::new(self.width() as f64, self.height() as f64);
        let mut panels = Vec::new();
        for (number, (panel, scene)) in self.panels.iter().zip(&self.scenes).enumerate() {
            let x = number % PANELS_PER_ROW * (self.size + PANEL_GAP);
            let y = number / PANELS_PER_ROW * (TITLE_HEIGHT + self.size + TIME_HEIGHT);
            title_line(&mut canvas, &panel.title, step, [x, y], self.size);
            let bottom = y + TITLE_HEIGHT + self.size;
            time_bar(&mut canvas, &panel.marks, [step, scene.last], [x, bottom], self.size);
            // A document of its own: rounding is then the same in all panels.
            let size = self.size as f64;
            let mut inside = Canvas::new(size, size);
            let (middle, radius) = (self.camera.middle(scene, step), self.camera.radius);
            scene.draw_step(&mut inside, step, Window { middle, radius, corner: Vec2::zeros(), size });
            panels.push((x as i32, (y + TITLE_HEIGHT) as i32, render(inside)?));
        }
        let mut pixels = render(canvas)?;
        for (x, y, panel) in panels {
            pixels.draw_pixmap(x, y, panel.as_ref(), &PixmapPaint::default(), Transform::identity(), None);
        }
        Ok(pixels.data().as_chunks().0.to_vec())
    }
}

fn render(canvas: Canvas) -> Result<Pixmap, usvg::Error> {
    let tree = Tree::from_str(&canvas.finish(), &Options::default())?;
    let size = tree.size().to_int_size();
    let mut pixels = Pixmap::new(size.width(), size.height()).ok_or(usvg::Error::InvalidSize)?;
    resvg::render(&tree, Transform::identity(), &mut pixels.as_mut());
    Ok(pixels)
}

/// Draws the title and the time.
fn title_line(canvas: &mut Canvas, title: &str, step: usize, [x, y]: [usize; 2], size: usize) {
    let scale = if size < 320 { 1 } else { 2 };
    let advance = LETTER_SIZE * scale;
    let time = format!("{:.1} s", step as f64 * DT);
    let begin = size.saturating_sub(time.len() * advance + 4);
    // A long title leaves space for the time.
    let title: String = title.chars().take(begin.saturating_sub(12) / advance).collect();
    let top = y + (TITLE_HEIGHT - advance) / 2;
    write(canvas, &title, [x + 4, top], scale);
    write(canvas, &time, [x + begin, top], scale);
}

/// Writes a text with `scale` pixels per dot. Text of the renderer would need its font stack and a font in
/// the program, or fonts of the machine, with which animations would differ from machine to machine.
fn write(canvas: &mut Canvas, text: &str, [x, y]: [usize; 2], scale: usize) {
    let mut dots = String::new();
    for (i, letter) in text.chars().enumerate() {
        let rows = BASIC_FONTS.get(letter).or_else(|| LATIN_FONTS.get(letter)).or(BASIC_FONTS.get('?'));
        for (row, bits) in rows.unwrap_or_default().iter().enumerate() {
            for column in (0..LETTER_SIZE).filter(|column| bits >> column & 1 == 1) {
                let (left, top) = (x + (i * LETTER_SIZE + column) * scale, y + row * scale);
                let _ = write!(dots, "M{left} {top}h{scale}v{scale}h-{scale}z");
            }
        }
    }
    canvas.raw(&format!("<path d=\"{dots}\" fill=\"{}\"/>", palette::STOP));
}

/// Draws the time bar up to a step of `last`, with gaps at full seconds and a tick for every event.
fn time_bar(canvas: &mut Canvas, marks: &[Mark], [step, last]: [usize; 2], [x, y]: [usize; 2], size: usize) {
    let at = |step: usize| step.min(last) * (size - 2) / last;
    let mut bar = |from: usize, width: usize, height: usize, colour: &str| {
        let (left, top) = (x + from, y + (TIME_HEIGHT - height) / 2);
        canvas.raw(&format!("<path d=\"M{left} {top}h{width}v{height}h-{width}z\" fill=\"{colour}\"/>"));
    };
    bar(0, size, BAR_HEIGHT, palette::ROAD);
    bar(0, at(step) + 2, BAR_HEIGHT, palette::EDGE);
    // Gaps of seconds that are closer than a few pixels would hide the bar.
    let every = if last <= MOST_SECONDS { 10 } else { 100 };
    (every..last).step_by(every).for_each(|second| bar(at(second), 1, BAR_HEIGHT, palette::WHITE));
    let mut marks: Vec<&Mark> = marks.iter().collect();
    // The most severe events are drawn last, on top.
    marks.sort_by_key(|m| (std::cmp::Reverse(m.kind), m.step));
    for mark in marks {
        let colour = if mark.kind == MarkKind::Risky { palette::YELLOW } else { palette::EVENT };
        bar(at(mark.step), if mark.kind == MarkKind::AtFault { 4 } else { 2 }, TICK_HEIGHT, colour);
    }
}
