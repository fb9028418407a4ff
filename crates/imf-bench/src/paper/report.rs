//! The report of all tables: report.json for scripts, report.md for the repository, report.html as one file to send.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use imf_cli::output::{write_json, write_text};
use serde::Serialize;

use super::table::Table;
use crate::arguments::paper::PaperScale;
use crate::machine::Machine;

const SOURCE: &str = "The paper: Harabin, Mirzendehdel, Behandish, Deep Neural Implicit Representation of Accessibility for \
                      Multi-Axis Manufacturing, arXiv 2409.02115; its times were measured on a Xeon W-2275 with a Quadro \
                      RTX 6000.";
const READING: &str = "MSE is the mean squared, MPE the largest error against the exact field, both in shares of the tool's \
                       volume. A pose is called colliding above τ, and is so exactly where the tool collides at all: shallow \
                       contact has next to no volume, so false-free says more about τ than about the field. Bracket and \
                       screw gear are our parts in the style of the paper's, not the paper's: their ratios compare \
                       different shapes.";

const ANOTHER_SIZE: &str = "At this scale the ratios compare another resolution, network and length of training than the \
                            paper's: what holds are the comparisons within a table. Times are not judged.";

/// Everything that was measured.
#[derive(Serialize)]
pub(super) struct Report {
    pub(super) machine: Machine,
    pub(super) device: String,
    pub(super) scale: PaperScale,
    /// What differs from the paper's protocol.
    pub(super) protocol: Vec<String>,
    pub(super) threshold: f64,
    pub(super) tables: Vec<Table>,
}

/// Where a text with its markup goes: both documents have the same parts.
trait Document {
    fn title(&mut self, level: usize, text: &str);
    fn paragraph(&mut self, text: &str);
    fn list(&mut self, lines: &[String]);
    fn table(&mut self, head: &[String], rows: &[Vec<String>]);
    fn figure(&mut self, file: &str, caption: &str) -> Result<()>;
}

impl Report {
    /// Writes the three files to `out`.
    pub(super) fn write(&self, out: &Path) -> Result<()> {
        write_json(&out.join("report.json"), self)?;
        let mut markdown = Markdown(String::new());
        self.compose(&mut markdown)?;
        write_text(&out.join("report.md"), &markdown.0)?;
        let mut html = Html::new(out);
        self.compose(&mut html)?;
        write_text(&out.join("report.html"), &html.whole())
    }

    /// In a line for each table how many of its rows fall short of the paper.
    pub(super) fn summary(&self) -> String {
        let line = |table: &Table| match table.standing() {
            (0, _) => format!("{}: {} rows\n", table.title, table.rows.len()),
            (all, short) => format!("{}: {short} of {all} rows fall short of the paper\n", table.title),
        };
        self.tables.iter().map(line).collect()
    }

    fn compose(&self, to: &mut dyn Document) -> Result<()> {
        to.title(1, "The paper's tables");
        to.paragraph(&format!("{} · {}", self.machine, self.device));
        to.paragraph(&format!("Scale `{}`, which differs from the paper in this:", scale_name(self.scale)));
        to.list(&self.protocol);
        to.paragraph(SOURCE);
        to.paragraph(&format!("{READING} Here τ = {}.", self.threshold));
        if self.scale != PaperScale::Full {
            to.paragraph(ANOTHER_SIZE);
        }
        for table in &self.tables {
            to.title(2, &table.title);
            table.notes.iter().for_each(|note| to.paragraph(note));
            let (head, rows) = table.cells();
            to.table(&head, &rows);
            if let Some(tried) = table.footnote() {
                to.paragraph(&tried);
            }
            for (file, caption) in &table.figures {
                to.figure(file, caption)?;
            }
        }
        Ok(())
    }
}

fn scale_name(scale: PaperScale) -> &'static str {
    match scale {
        PaperScale::Full => "full",
        PaperScale::Reduced => "reduced",
        PaperScale::Tiny => "tiny",
    }
}

struct Markdown(String);

impl Document for Markdown {
    fn title(&mut self, level: usize, text: &str) {
        let _ = writeln!(self.0, "{} {text}\n", "#".repeat(level));
    }

    fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.0, "{text}\n");
    }

    fn list(&mut self, lines: &[String]) {
        lines.iter().for_each(|line| {
            let _ = writeln!(self.0, "- {line}");
        });
        self.0.push('\n');
    }

    fn table(&mut self, head: &[String], rows: &[Vec<String>]) {
        let _ = writeln!(self.0, "| {} |", head.join(" | "));
        let _ = writeln!(self.0, "| {} |", vec!["---"; head.len()].join(" | "));
        rows.iter().for_each(|row| {
            let _ = writeln!(self.0, "| {} |", row.join(" | "));
        });
        self.0.push('\n');
    }

    fn figure(&mut self, file: &str, caption: &str) -> Result<()> {
        let _ = writeln!(self.0, "![{caption}]({file})\n\n{caption}\n");
        Ok(())
    }
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1240px;padding:0 1rem;color:#262626}\
                     table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums;font-size:13px}\
                     th,td{border:1px solid #ccc;padding:.25rem .5rem;text-align:left}th{background:#f2f2f2}\
                     tr.short td{background:#fdeee6}img{max-width:100%}figure{margin:1.5rem 0}figcaption{color:#606060}";

struct Html<'a> {
    folder: &'a Path,
    body: String,
}

impl<'a> Html<'a> {
    fn new(folder: &'a Path) -> Self {
        Self { folder, body: String::new() }
    }

    fn whole(&self) -> String {
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>The paper's tables</title>\n\
             <style>{STYLE}</style>\n{}</html>\n",
            self.body
        )
    }
}

/// Text as HTML; pairs of `**` become bold, of backquotes code.
fn html(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let paired = |text: &str, mark: &str, tag: &str| {
        let mut pieces = text.split(mark);
        let mut whole = pieces.next().unwrap_or_default().to_owned();
        let mut open = false;
        for piece in pieces {
            open = !open;
            let _ = write!(whole, "<{}{tag}>{piece}", if open { "" } else { "/" });
        }
        whole
    };
    paired(&paired(&text, "**", "b"), "`", "code")
}

impl Document for Html<'_> {
    fn title(&mut self, level: usize, text: &str) {
        let _ = writeln!(self.body, "<h{level}>{}</h{level}>", html(text));
    }

    fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", html(text));
    }

    fn list(&mut self, lines: &[String]) {
        let items: String = lines.iter().map(|line| format!("<li>{}</li>", html(line))).collect();
        let _ = writeln!(self.body, "<ul>{items}</ul>");
    }

    fn table(&mut self, head: &[String], rows: &[Vec<String>]) {
        let cells = |cells: &[String], tag: &str| -> String {
            cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", html(cell))).collect()
        };
        let _ = writeln!(self.body, "<table>\n<tr>{}</tr>", cells(head, "th"));
        for row in rows {
            let short = row.last().is_some_and(|cell| cell.contains("short"));
            let class = if short { " class=\"short\"" } else { "" };
            let _ = writeln!(self.body, "<tr{class}>{}</tr>", cells(row, "td"));
        }
        self.body.push_str("</table>\n");
    }

    fn figure(&mut self, file: &str, caption: &str) -> Result<()> {
        let path = self.folder.join(file);
        let bytes =
            std::fs::read(&path).with_context(|| format!("cannot read the picture {}", path.display()))?;
        let caption = html(caption);
        let _ = writeln!(
            self.body,
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption></figure>",
            STANDARD.encode(bytes)
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn html_escapes_and_marks() {
        assert_eq!(html("a < b & **c** `d`"), "a &lt; b &amp; <b>c</b> <code>d</code>");
    }

    #[test]
    fn the_page_holds_its_pictures() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("one.png"), [1, 2, 3]).unwrap();
        let mut page = Html::new(folder.path());
        page.figure("one.png", "a \"picture\"").unwrap();
        assert!(page.whole().contains("src=\"data:image/png;base64,AQID\""), "{}", page.whole());
        assert!(page.whole().contains("a &quot;picture&quot;"));
        assert!(page.figure("none.png", "").unwrap_err().to_string().contains("none.png"));
    }
}
