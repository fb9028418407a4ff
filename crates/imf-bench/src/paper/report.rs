//! The report of all tables: report.json for scripts, report.md for the repository, report.html as one file to send.

use std::path::Path;

use anyhow::Result;
use imf_cli::output::write_text;
use serde::Serialize;

use super::PaperScale;
use super::table::{Standing, Table};
use crate::document::Document;
use crate::measurement::Machine;

const SOURCE: &str = "The paper: Harabin, Mirzendehdel, Behandish, Deep Neural Implicit Representation of Accessibility for \
                      Multi-Axis Manufacturing, arXiv 2409.02115; its times were measured on a Xeon W-2275 with a Quadro \
                      RTX 6000.";
const READING: &str = "MSE is the mean squared, MPE the largest error against the exact field, both in fractions of the tool's \
                       volume. Bracket and screw gear are our parts in the style of the paper's, not the paper's: their \
                       ratios compare different shapes. Where a standard error is given, minima and random sections were compared \
                       at a share of the voxels, drawn at random, of which MPE is the largest error then: that of all voxels may \
                       be larger (0.0074 for 0.0056 of the bracket at a quarter of the resolution).";
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
    /// What was tried for cells that fall short of the paper.
    pub(super) tried: String,
    pub(super) tables: Vec<Table>,
}

impl Report {
    /// Writes the three files to `out`.
    pub(super) fn write(&self, out: &Path) -> Result<()> {
        let document = self.document();
        document.write(out, "report", self)?;
        write_text(&out.join("report.html"), &document.html(out)?)
    }

    /// In a line for each table how many of its cells are at or below the paper's.
    pub(super) fn summary(&self) -> String {
        let line = |table: &Table| match table.standing() {
            Standing { all: 0, .. } => format!("{}: {} rows\n", table.title, table.rows.len()),
            Standing { all, met, missing, .. } => {
                let rest = if missing > 0 { format!(", {missing} without a result") } else { String::new() };
                format!("{}: {met} of {all} cells at or below the paper's{rest}\n", table.title)
            }
        };
        self.tables.iter().map(line).collect()
    }

    /// The same as a table's rows, and their sum.
    fn standing(&self) -> Vec<Vec<String>> {
        let judged = self.tables.iter().map(|table| (table.title.as_str(), table.standing()));
        let judged: Vec<_> = judged.filter(|(_, own)| own.all > 0).collect();
        let sum = judged.iter().map(|(_, own)| *own).sum();
        let row = |(title, own): &(&str, Standing)| {
            let counts = [own.met, own.all, own.missing, own.met_at_drawn].map(|count| count.to_string());
            [vec![(*title).to_owned()], counts.to_vec()].concat()
        };
        judged.iter().chain([&("all", sum)]).map(row).collect()
    }

    fn document(&self) -> Document {
        let mut document = Document::new("The paper's tables");
        document.paragraph(format!("{} · {}", self.machine, self.device));
        document.paragraph(SOURCE);
        document.paragraph(READING);
        if self.scale != PaperScale::Full {
            document.paragraph(ANOTHER_SIZE);
        }
        document.table(
            &["table", "cells met", "of", "without a result", "of those met, MPEs at drawn voxels"],
            self.standing(),
        );
        let short = |standing: Standing| standing.met < standing.all && standing.missing < standing.all;
        if self.tables.iter().any(|table| short(table.standing())) {
            document.paragraph(format!("Where a cell falls short, this was tried: {}", self.tried));
        }
        let scale = format!("{:?}", self.scale).to_lowercase();
        document.paragraph(format!("Scale `{scale}`, which differs from the paper in this:"));
        document.list(self.protocol.clone());
        for table in &self.tables {
            document.section(&table.title);
            table.notes.iter().for_each(|note| document.paragraph(note));
            for (head, rows) in [table.cells(), table.cells_of_made()] {
                if !rows.is_empty() {
                    document.table(&head, rows);
                }
            }
            table.figures.iter().for_each(|(file, caption)| document.picture(file, caption));
        }
        document
    }
}
