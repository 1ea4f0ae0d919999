//! The SVG document: windows that show parts of the scene, paths, texts.

use std::fmt::Write;

use reactsim_geometry::{Bounds, Vec2};

use super::clip;

/// A square of the scene and the square of the picture that shows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Centre, metres.
    pub(crate) middle: Vec2,
    /// Half of the side, metres.
    pub(crate) radius: f64,
    /// Upper left corner, pixels.
    pub(crate) corner: Vec2,
    /// Side, pixels.
    pub(crate) size: f64,
}

impl Window {
    /// Returns the scale in pixels per metre.
    pub(super) fn scale(&self) -> f64 {
        self.size / (2.0 * self.radius)
    }

    /// Converts a point of the scene (y up) to pixels (y down).
    pub(super) fn pixel(&self, p: Vec2) -> Vec2 {
        let d = (p - self.middle) * self.scale();
        self.corner + Vec2::new(0.5 * self.size + d.x, 0.5 * self.size - d.y)
    }

    /// Returns the visible area in metres, with a margin so that cut ends are outside.
    pub(super) fn bounds(&self) -> Bounds {
        Bounds::around(self.middle, self.radius + 2.0)
    }
}

/// Builder of an SVG document.
pub(crate) struct Canvas {
    out: String,
    window: Option<Window>,
}

impl Canvas {
    /// Creates an empty document of this size in pixels.
    pub(crate) fn new(width: f64, height: f64) -> Self {
        let mut out = String::with_capacity(1 << 16);
        let _ = write!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" \
             font-family=\"Helvetica, Arial, 'Liberation Sans', sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
        );
        Self { out, window: None }
    }

    /// Returns the document.
    pub(crate) fn finish(mut self) -> String {
        self.out.push_str("</svg>\n");
        self.out
    }

    /// Opens a window; everything drawn until it is closed is clipped to it.
    pub(super) fn open_window(&mut self, window: Window, number: usize) {
        let Window { corner: c, size, .. } = window;
        let area = format!("x=\"{:.1}\" y=\"{:.1}\" width=\"{size:.1}\" height=\"{size:.1}\"", c.x, c.y);
        let _ = writeln!(
            self.out,
            "<clipPath id=\"w{number}\"><rect {area}/></clipPath>\n<g clip-path=\"url(#w{number})\">\n\
             <rect {area} fill=\"{}\"/>",
            super::palette::GROUND
        );
        self.window = Some(window);
    }

    /// Closes the window and draws its frame.
    pub(super) fn close_window(&mut self) {
        self.out.push_str("</g>\n");
        if let Some(Window { corner: c, size, .. }) = self.window.take() {
            let _ = writeln!(
                self.out,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{size:.1}\" height=\"{size:.1}\" fill=\"none\" \
                 stroke=\"{}\"/>",
                c.x,
                c.y,
                super::palette::FRAME
            );
        }
    }

    /// Returns the open window.
    pub(super) fn window(&self) -> Window {
        self.window.unwrap_or(Window { middle: Vec2::zeros(), radius: 1.0, corner: Vec2::zeros(), size: 1.0 })
    }

    /// Adds markup unchanged.
    pub(crate) fn raw(&mut self, markup: &str) {
        self.out.push_str(markup);
        self.out.push('\n');
    }

    /// Adds a path with these attributes, unless it is empty.
    pub(super) fn path(&mut self, data: &PathData, attributes: &str) {
        if !data.d.is_empty() {
            let _ = writeln!(self.out, "<path d=\"{}\" {attributes}/>", data.d);
        }
    }

    /// Adds the path that `put` fills, with these attributes, unless it is empty.
    pub(super) fn draw(&mut self, attributes: &str, put: impl FnOnce(&mut PathData)) {
        let mut path = PathData::new(self.window());
        put(&mut path);
        self.path(&path, attributes);
    }

    /// Adds an escaped text at a pixel.
    pub(super) fn text(&mut self, at: Vec2, text: &str, attributes: &str) {
        let _ = writeln!(
            self.out,
            "<text x=\"{:.1}\" y=\"{:.1}\" {attributes}>{}</text>",
            at.x,
            at.y,
            escape(text)
        );
    }

    /// Adds a text with a pale outline, legible on any background.
    pub(super) fn label(&mut self, at: Vec2, text: &str) {
        self.text(
            at,
            text,
            "font-size=\"13\" fill=\"none\" stroke=\"#ffffff\" stroke-opacity=\"0.85\" stroke-width=\"3\" \
             stroke-linejoin=\"round\"",
        );
        self.text(at, text, "font-size=\"13\" fill=\"#22252b\"");
    }
}

/// The `d` attribute of a path.
pub(super) struct PathData {
    window: Window,
    d: String,
}

impl PathData {
    /// Creates an empty path in a window.
    pub(super) fn new(window: Window) -> Self {
        Self { window, d: String::new() }
    }

    /// Adds the parts of a line inside the window.
    pub(super) fn line(&mut self, points: &[Vec2]) {
        for part in clip::line(points, &self.window.bounds()) {
            self.put(&clip::thin(&part, 0.25 / self.window.scale()), false);
        }
    }

    /// Adds the part of a ring inside the window.
    pub(super) fn ring(&mut self, points: &[Vec2]) {
        let open = match points {
            [first, rest @ ..] if rest.last() == Some(first) => rest,
            _ => points,
        };
        let part = clip::ring(open, &self.window.bounds());
        self.put(&clip::thin(&part, 0.25 / self.window.scale()), true);
    }

    fn put(&mut self, points: &[Vec2], closed: bool) {
        if points.len() < 2 {
            return;
        }
        for (i, p) in points.iter().enumerate() {
            let p = self.window.pixel(*p);
            let _ = write!(self.d, "{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, p.x, p.y);
        }
        if closed {
            self.d.push('Z');
        }
    }
}

/// Escapes text for XML or HTML: markup becomes entities, and characters that XML forbids become `�`.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            '\t' | '\n' | '\r' => out.push(' '),
            c if crate::terminal::is_unsafe(c) || ('\u{fffe}'..='\u{ffff}').contains(&c) => {
                out.push('\u{fffd}')
            }
            c => out.push(c),
        }
    }
    out
}
