//! The page as one file.

use std::collections::BTreeSet;
use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};

use super::PageError;
use super::gallery::Gallery;
use crate::web::{Asset, PALETTE, SHARED, bundle};

const PAGE: &str = include_str!("assets/page.html");
const STYLE: &str = include_str!("assets/style.css");

macro_rules! script {
    ($name:literal) => {
        script!("", $name)
    };
    ($folder:literal, $name:literal) => {
        crate::web::Asset { name: $name, text: include_str!(concat!("assets/", $folder, $name)) }
    };
}
pub(super) use script;

/// The scripts of the page, each after those that it imports.
const SCRIPTS: &[Asset] = &[
    script!("dom.js"),
    script!("data.js"),
    script!("format.js"),
    script!("results.js"),
    script!("charts.js"),
    script!("figures.js"),
    script!("studies.js"),
    script!("scenes.js"),
    script!("list.js"),
    script!("vector.js"),
    script!("painter.js"),
    script!("pane.js"),
    script!("panel.js"),
    script!("strip.js"),
    script!("viewer.js"),
    script!("lead.js"),
    script!("main.js"),
];

/// A page and its content security policy, which allows only its own script, by its digest.
pub(super) struct Document {
    pub(super) text: String,
    pub(super) policy: String,
}

impl Gallery {
    /// Writes the page as one self-contained file, with the scenes of the scenarios in `cases` and of
    /// `count` further ones (or `all`), chosen by how much simulators differ.
    ///
    /// # Errors
    /// [`PageError`] if a scenario is unknown, a file cannot be read, or `out` cannot be written.
    pub fn write(
        &self,
        cases: &[String],
        count: usize,
        all: bool,
        out: &mut dyn Write,
    ) -> Result<(), PageError> {
        let mut scenes: BTreeSet<usize> =
            self.choose(if all { usize::MAX } else { count }).into_iter().collect();
        if let Some(lead) = self.lead()? {
            scenes.insert(lead.scenario);
        }
        for id in cases {
            let unknown =
                || format!("no run has a scenario `{id}`; `rows.jsonl` of a run folder lists its scenarios");
            scenes.insert(self.find(id).ok_or_else(|| PageError::Refused(unknown()))?);
        }
        let mut texts = String::new();
        let mut drawn = BTreeSet::new();
        for index in scenes {
            if let Some(json) = self.scene(index)? {
                texts.push_str(&packed(index, &json)?);
                drawn.insert(index);
            }
        }
        let document = self.document(&drawn, false, &texts)?;
        Ok(out.write_all(document.text.as_bytes())?)
    }

    pub(super) fn document(
        &self,
        drawn: &BTreeSet<usize>,
        live: bool,
        scenes: &str,
    ) -> Result<Document, PageError> {
        let data = serde_json::to_string(&self.data(drawn, live)?)?;
        let connect = if live { "'self'" } else { "'none'" };
        Ok(assemble((PAGE, STYLE), SCRIPTS, &data, scenes, connect))
    }
}

/// Joins a page, its style, its scripts, its data as JSON and its scenes. The page can connect to `connect`.
pub(super) fn assemble(
    (page, style): (&str, &str),
    scripts: &[Asset],
    data: &str,
    scenes: &str,
    connect: &str,
) -> Document {
    let data = escape_json(data);
    let script = bundle(SHARED.iter().chain(scripts));
    let policy = format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'unsafe-inline'; img-src data: blob:; \
             connect-src {connect}; base-uri 'none'; form-action 'none'",
        STANDARD.encode(Sha256::digest(script.as_bytes()))
    );
    let mut text = String::with_capacity(page.len() + data.len() + script.len() + scenes.len());
    let mut rest = page;
    for (mark, part) in [
        ("<!--policy-->", policy.as_str()),
        ("/*palette*/", PALETTE),
        ("/*style*/", style),
        ("<!--data-->", data.as_str()),
        ("<!--scenes-->", scenes),
        ("/*script*/", script.as_str()),
    ] {
        let (before, after) = rest.split_once(mark).unwrap_or((rest, ""));
        text.push_str(before);
        text.push_str(part);
        rest = after;
    }
    text.push_str(rest);
    Document { text, policy }
}

/// Escapes JSON so that no name in it can end an HTML element.
fn escape_json(json: &str) -> String {
    json.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

/// Returns the element of a scene: its JSON, compressed with gzip and encoded in Base64.
pub(super) fn packed(index: usize, json: &str) -> io::Result<String> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(json.as_bytes())?;
    let text = STANDARD.encode(gzip.finish()?);
    Ok(format!("<script type=\"application/gzip\" id=\"scene-{index}\">{text}</script>\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::review;

    #[test]
    fn nothing_in_the_data_ends_its_element() {
        let text = escape_json("{\"id\":\"</script><!--&\"}");
        assert!(!text.contains(['<', '>', '&']));
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["id"], "</script><!--&");
    }

    #[test]
    fn scripts_can_be_embedded_in_a_page() {
        for (page, scripts) in [(PAGE, SCRIPTS), (review::PAGE, review::SCRIPTS)] {
            let script = bundle(SHARED.iter().chain(scripts));
            assert!(!script.contains("</script") && !script.contains("<!--"));
            // Module syntax left by the bundler would not run in a page.
            assert!(!script.contains("\nimport ") && !script.contains("\nexport "));
            for mark in
                ["<!--policy-->", "/*palette*/", "/*style*/", "<!--data-->", "<!--scenes-->", "/*script*/"]
            {
                assert_eq!(page.matches(mark).count(), 1, "{mark}");
            }
        }
    }
}
