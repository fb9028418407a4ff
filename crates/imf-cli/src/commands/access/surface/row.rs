//! The surface in the summary, for files and for people.

use std::fmt::Write as _;

use imf_core::surface::Verdict;
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::words;
use crate::output::{length, show_measure};

/// One direction, and the share of the surface that it reaches.
#[derive(Debug, Serialize)]
pub(in crate::commands::access) struct DirectionRow {
    pub(super) direction: [f64; 3],
    pub(super) share: f64,
}

/// What of a tool hits what, and how much of the surface is not reached where it does.
#[derive(Debug, Serialize)]
pub(super) struct ObstructedRow {
    pub(super) element: String,
    /// `part`, or a fixture's name.
    pub(super) body: String,
    pub(super) share: f64,
}

/// The surface in the summary; shares are of its area.
#[derive(Debug, Serialize)]
pub(in crate::commands::access) struct SurfaceRow {
    pub(super) area: f64,
    pub(super) samples: usize,
    /// Inside other bodies of the part's mesh, and left out of all shares.
    pub(super) hidden_area: f64,
    pub(super) tolerance: f64,
    pub(super) reached: f64,
    pub(super) reached_at_twice_the_pitch: f64,
    pub(super) difference: f64,
    /// The cutter fits, and something else of the tool collides.
    pub(super) obstructed: f64,
    /// What collides; several may at once.
    pub(super) obstructed_by: Vec<ObstructedRow>,
    /// The cutter does not fit.
    pub(super) gouged: f64,
    pub(super) not_faced: f64,
    pub(super) best_directions: Vec<DirectionRow>,
}

impl SurfaceRow {
    /// The report's lines.
    pub(in crate::commands::access) fn lines(&self, unit: LengthUnit) -> String {
        let mut text = format!(
            "surface, {} {unit}² (the cutter may cut {} {unit} below it)\n",
            show_measure(self.area),
            length::finer(self.tolerance, unit, 2)
        );
        let mut row = |name: &str, share: f64, rest: &str| {
            let _ = writeln!(text, "  {name:34}{:>8.1} %   {rest}", 100.0 * share);
        };
        let coarse = format!(
            "{:.1} % at twice the pitch ({:+.1})",
            100.0 * self.reached_at_twice_the_pitch,
            100.0 * self.difference
        );
        row(words(Verdict::Reached), self.reached, &coarse);
        let by = self.obstructed_by.iter().map(|row| {
            let the = if row.body == "part" { "the " } else { "" };
            format!("{} at {the}{} {:.1} %", row.element, row.body, 100.0 * row.share)
        });
        row(words(Verdict::Obstructed), self.obstructed, &by.collect::<Vec<_>>().join(", "));
        row(words(Verdict::Gouged), self.gouged, "");
        row(words(Verdict::NotFaced), self.not_faced, "");
        for DirectionRow { direction: [i, j, k], share } in &self.best_directions {
            row(&format!("from ({i:.3}, {j:.3}, {k:.3})"), *share, "");
        }
        if self.hidden_area > 0.0 {
            let _ = writeln!(
                text,
                "  left out: {} {unit}² inside other bodies of the part",
                show_measure(self.hidden_area)
            );
        }
        text
    }
}
