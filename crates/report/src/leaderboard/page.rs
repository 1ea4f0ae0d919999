//! The leaderboard as one self-contained HTML page.

use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use reactsim_evaluation::reference::Entry;
use sha2::{Digest, Sha256};

use super::super::birdseye::escape;
use super::super::markdown::cell;
use super::super::table::Column;
use super::{Line, Lines, about, columns, rank_text};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("sort.js");

/// Writes the page: a table that a click on a column head sorts. The policy allows only its style and
/// script, by their digests.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_page(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let digest = |text: &str| STANDARD.encode(Sha256::digest(text.as_bytes()));
    let policy = format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; img-src data:; \
         base-uri 'none'; form-action 'none'",
        digest(SCRIPT),
        digest(STYLE)
    );
    let (columns, lines) = (columns(entries), Lines::of(entries));
    let benchmark = entries.first().map(|e| e.benchmark.to_string()).unwrap_or_default();
    let title = escape(&format!("Leaderboard: {benchmark}"));
    writeln!(
        out,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"referrer\" content=\"no-referrer\">\n<title>{title}</title>\n\
         <link rel=\"icon\" href=\"data:,\">\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n\
         <div class=\"wide\"><table>\n<thead><tr>"
    )?;
    let texts = ["Rank", "Entry", "Method", "Status"].map(str::to_owned);
    for head in texts.into_iter().chain(columns.iter().map(Column::head)) {
        write!(out, "<th scope=\"col\" aria-sort=\"none\"><button>{}</button></th>", escape(&head))?;
    }
    writeln!(out, "</tr></thead>\n<tbody>")?;
    for line in &lines.shown {
        row(out, &columns, line)?;
    }
    writeln!(out, "</tbody>\n</table></div>")?;
    for text in lines.legend() {
        writeln!(out, "<p>{text}.</p>")?;
    }
    writeln!(out, "<p>{}.</p>\n<script>{SCRIPT}</script>\n</body>\n</html>", escape(&about(entries)))
}

fn row(out: &mut dyn Write, columns: &[Column], line: &Line<'_>) -> io::Result<()> {
    let mark = format!(" {}", line.marks.signs());
    let mark = mark.trim_end();
    let status = line.entry.status.name();
    write!(
        out,
        "<tr><td data-value=\"{}\">{}</td><td>{}</td><td>{}{mark}</td><td class=\"{status}\">{status}</td>",
        line.rank.map(|rank| rank.to_string()).unwrap_or_default(),
        rank_text(line.rank),
        escape(&line.entry.name),
        escape(line.title)
    )?;
    for column in columns {
        let value = line.mean(column.metric).map(|v| v.to_string()).unwrap_or_default();
        let text = escape(&cell(column, line.metrics.get(column.metric)));
        write!(out, "<td data-value=\"{value}\">{text}</td>")?;
    }
    writeln!(out, "</tr>")
}

#[cfg(test)]
mod tests {
    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(super::escape("<a b=\"c\">&'"), "&lt;a b=&quot;c&quot;&gt;&amp;&apos;");
        assert!(!super::SCRIPT.contains("</script") && !super::STYLE.contains("</style"));
    }
}
