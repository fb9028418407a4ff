//! What a command found, as a document that is written once: Markdown for files, columns for a terminal, and one HTML page with
//! its pictures inside.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use imf_cli::output::{print, print_json, table, write_json, write_text};
use imf_cli::session::Session;
use serde::Serialize;

enum Block {
    Title(usize, String),
    Paragraph(String),
    List(Vec<String>),
    Table(Vec<String>, Vec<Vec<String>>),
    /// File in the document's folder, and caption.
    Picture(String, String),
}

/// Titles, paragraphs, tables and pictures in order.
#[derive(Default)]
pub(crate) struct Document(Vec<Block>);

impl Document {
    pub(crate) fn new(title: &str) -> Self {
        Self(vec![Block::Title(1, title.into())])
    }

    pub(crate) fn section(&mut self, title: &str) {
        self.0.push(Block::Title(2, title.into()));
    }

    pub(crate) fn paragraph(&mut self, text: impl Into<String>) {
        self.0.push(Block::Paragraph(text.into()));
    }

    pub(crate) fn list(&mut self, lines: Vec<String>) {
        self.0.push(Block::List(lines));
    }

    pub(crate) fn table<S: ToString>(&mut self, head: &[S], rows: Vec<Vec<String>>) {
        self.0.push(Block::Table(head.iter().map(S::to_string).collect(), rows));
    }

    pub(crate) fn picture(&mut self, file: &str, caption: &str) {
        self.0.push(Block::Picture(file.into(), caption.into()));
    }

    pub(crate) fn append(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    pub(crate) fn markdown(&self) -> String {
        self.text(|head, rows| {
            let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
            let rule = format!("|{}\n", " --- |".repeat(head.len()));
            line(head) + &rule + &rows.iter().map(|row| line(row)).collect::<String>()
        })
    }

    /// For a terminal: tables in columns.
    pub(crate) fn columns(&self) -> String {
        self.text(|head, rows| table(&head.iter().map(String::as_str).collect::<Vec<_>>(), rows))
    }

    fn text(&self, table: impl Fn(&[String], &[Vec<String>]) -> String) -> String {
        let blocks = self.0.iter().map(|block| match block {
            Block::Title(level, text) => format!("{} {text}\n", "#".repeat(*level)),
            Block::Paragraph(text) => format!("{text}\n"),
            Block::List(lines) => lines.iter().map(|line| format!("- {line}\n")).collect(),
            Block::Table(head, rows) => table(head, rows),
            Block::Picture(file, caption) => format!("![{caption}]({file})\n"),
        });
        blocks.collect::<Vec<_>>().join("\n")
    }

    /// One page that holds the pictures of `folder`.
    pub(crate) fn html(&self, folder: &Path) -> Result<String> {
        let mut body = String::new();
        let items = |texts: &[String], tag: &str| -> String {
            texts.iter().map(|text| format!("<{tag}>{}</{tag}>", html(text))).collect()
        };
        for block in &self.0 {
            let _ = match block {
                Block::Title(level, text) => writeln!(body, "<h{level}>{}</h{level}>", html(text)),
                Block::Paragraph(text) => writeln!(body, "<p>{}</p>", html(text)),
                Block::List(lines) => writeln!(body, "<ul>{}</ul>", items(lines, "li")),
                Block::Table(head, rows) => {
                    let row = |row: &Vec<String>| {
                        let short = row.last().is_some_and(|cell| cell.contains("short"));
                        let class = if short { " class=\"short\"" } else { "" };
                        format!("<tr{class}>{}</tr>\n", items(row, "td"))
                    };
                    let rows: String = rows.iter().map(row).collect();
                    writeln!(body, "<table>\n<tr>{}</tr>\n{rows}</table>", items(head, "th"))
                }
                Block::Picture(file, caption) => {
                    let path = folder.join(file);
                    let bytes = std::fs::read(&path)
                        .with_context(|| format!("cannot read the picture {}", path.display()))?;
                    let (bytes, caption) = (STANDARD.encode(bytes), html(caption));
                    writeln!(
                        body,
                        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{bytes}\"><figcaption>{caption}</figcaption></figure>"
                    )
                }
            };
        }
        Ok(format!(
            "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>imf-bench</title>\n<style>{STYLE}</style>\n{body}</html>\n"
        ))
    }

    /// Writes `name.md`, and `value` as `name.json`.
    pub(crate) fn write(&self, folder: &Path, name: &str, value: &impl Serialize) -> Result<&Self> {
        write_json(&folder.join(format!("{name}.json")), value)?;
        write_text(&folder.join(format!("{name}.md")), &self.markdown())?;
        Ok(self)
    }

    /// Prints it, or `value` where JSON is requested.
    pub(crate) fn show(&self, session: &Session, value: &impl Serialize) -> Result<()> {
        if session.json { print_json(value) } else { print(&self.columns()) }
    }
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1240px;padding:0 1rem;color:#262626}\
                     table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums;font-size:13px}\
                     th,td{border:1px solid #ccc;padding:.25rem .5rem;text-align:left}th{background:#f2f2f2}\
                     tr.short td{background:#fdeee6}img{max-width:100%}figure{margin:1.5rem 0}figcaption{color:#606060}";

/// Text as HTML; pairs of `**` become bold, of backquotes code.
fn html(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let paired = |text: &str, mark: &str, tag: &str| {
        let mut pieces = text.split(mark);
        let mut whole = pieces.next().unwrap_or_default().to_owned();
        for (index, piece) in pieces.enumerate() {
            let _ = write!(whole, "<{}{tag}>{piece}", if index % 2 == 0 { "" } else { "/" });
        }
        whole
    };
    paired(&paired(&text, "**", "b"), "`", "code")
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
        let mut page = Document::new("Pictures");
        page.picture("one.png", "a \"picture\"");
        let text = page.html(folder.path()).unwrap();
        assert!(text.contains("src=\"data:image/png;base64,AQID\""), "{text}");
        assert!(text.contains("a &quot;picture&quot;"));
        page.picture("none.png", "");
        assert!(page.html(folder.path()).unwrap_err().to_string().contains("none.png"));
    }
}
