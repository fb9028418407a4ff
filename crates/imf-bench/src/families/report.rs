//! The comparison as a document, as JSON and as bars.

use std::path::Path;

use anyhow::Result;
use imf_cli::picture::{Bar, BarChart};
use imf_cli::progress::show_seconds;
use imf_cli::session::{Session, show_bytes};
use imf_fields::metrics::ErrorReport;
use serde::Serialize;

use super::truth::{ALLOWED, Verdict};
use crate::arguments::families::FamiliesArguments;
use crate::document::Document;
use crate::measurement::Machine;

const HEAD: [&str; 11] = [
    "family",
    "made in",
    "memory",
    "MSE",
    "MPE",
    "false-free",
    "false-colliding",
    "IoU",
    "colliding if safe",
    "225 sections",
    "their IMF",
];

/// One family.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub(super) name: &'static str,
    /// What it is made of.
    pub(super) how: String,
    /// Seconds to make it.
    pub(super) made: f64,
    /// Bytes that are kept.
    pub(super) bytes: u64,
    #[serde(flatten)]
    pub(super) verdict: Verdict,
    /// Seconds for the sections of `fibonacci:225`.
    pub(super) sections: f64,
    /// Seconds for their minimum.
    pub(super) minimum: f64,
    /// Errors of that minimum.
    pub(super) imf: ErrorReport,
}

/// All families of a part.
#[derive(Debug, Serialize)]
pub(super) struct Comparison {
    pub(super) part: &'static str,
    pub(super) dims: [usize; 3],
    /// Exact sections that every family is made from, but coarse tables.
    pub(super) sections: usize,
    pub(super) rows: Vec<Row>,
}

/// Everything that was measured.
#[derive(Serialize)]
pub(super) struct Report {
    machine: Machine,
    random: u64,
    seed: u64,
    threshold: f64,
    near_voxels: usize,
    comparisons: Vec<Comparison>,
}

impl Report {
    pub(super) fn new(machine: Machine, arguments: &FamiliesArguments, comparisons: Vec<Comparison>) -> Self {
        Self {
            machine,
            random: arguments.random,
            seed: arguments.seed,
            threshold: arguments.threshold,
            near_voxels: arguments.near,
            comparisons,
        }
    }

    /// Writes `families.json`, `families.md` and a picture for each part, and shows what it wrote.
    pub(super) fn write(&self, session: &Session, out: &Path) -> Result<()> {
        let mut document = Document::new("Families of fields");
        document.paragraph(self.machine.to_string());
        document.paragraph(self.reading());
        for comparison in &self.comparisons {
            let picture = format!("{}.png", comparison.part);
            comparison.bars(self.random).save(&out.join(&picture))?;
            document.section(&comparison.title());
            document.table(&HEAD, comparison.cells());
            document.list(comparison.rows.iter().map(|row| format!("{}: {}", row.name, row.how)).collect());
            document.picture(&picture, &format!("Errors of {}", comparison.part));
        }
        document.write(out, "families", self)?;
        document.show(session, self)
    }

    fn reading(&self) -> String {
        format!(
            "MSE and MPE (largest error), in fractions of the tool's volume, over all positions and {} random directions that \
             nothing was made from. Wrong decisions are of the poses within {} voxel(s) of where free turns to colliding, \
             with everything above {} called colliding: colliding poses called free, free ones called colliding, and the \
             overlap of both obstacles (IoU). Colliding if safe: free poses there that are called colliding once the threshold \
             is so low that at most {} % of the colliding ones pass. Times on {} threads.",
            self.random,
            self.near_voxels,
            self.threshold,
            ALLOWED * 100.0,
            rayon::current_num_threads()
        )
    }
}

impl Comparison {
    fn title(&self) -> String {
        let [x, y, z] = self.dims;
        let ours = if self.part == "teapot" { "" } else { " (our part)" };
        format!("{}{ours}, {x}×{y}×{z} voxels, made from {} exact sections", self.part, self.sections)
    }

    fn cells(&self) -> Vec<Vec<String>> {
        let error = |value: f64| if value == 0.0 { "0".into() } else { format!("{value:.1e}") };
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let seconds = |s: f64| if s < 10.0 { format!("{s:.2} s") } else { show_seconds(s) };
        self.rows
            .iter()
            .map(|row| {
                let Verdict { everywhere, near, colliding_when_safe } = &row.verdict;
                vec![
                    row.name.into(),
                    seconds(row.made),
                    show_bytes(row.bytes),
                    error(everywhere.mse),
                    format!("{:.3}", everywhere.mpe),
                    percent(near.false_free),
                    percent(near.false_colliding),
                    format!("{:.3}", near.iou),
                    percent(*colliding_when_safe),
                    seconds(row.sections),
                    seconds(row.minimum),
                ]
            })
            .collect()
    }

    /// The families that err, by their error.
    fn bars(&self, random: u64) -> BarChart {
        let rows = self.rows.iter().filter(|row| row.name != "exact");
        BarChart {
            title: format!("{}: error at {random} random directions", self.part),
            value_name: "mean squared error".into(),
            bars: rows
                .map(|row| Bar {
                    name: format!("{} ({})", row.name, show_bytes(row.bytes)),
                    value: row.verdict.everywhere.mse,
                    marked: matches!(row.name, "harmonic" | "factored" | "siren5"),
                })
                .collect(),
        }
    }
}
