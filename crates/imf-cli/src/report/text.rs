//! A report in words: the closing table, and the page with its pictures.

use std::fmt::Write as _;

use imf_core::section::Quantity;
use imf_fields::metrics::Validation;

use super::{PAPER_THRESHOLD, Report, Row, ThresholdOf};
use crate::arguments::clearance::clearance_text;
use crate::commands::calibrate::threshold_text;
use crate::output::{short, table};

impl Report {
    /// The closing table.
    pub(crate) fn table(&self) -> String {
        let cells = |row: &Row| {
            let e = &row.errors;
            vec![
                row.name.clone(),
                format!("{:.2e}", e.mse),
                format!("{:.2e}", e.mae),
                format!("{:.4}", e.mpe),
                format!("{:.2} %", 100.0 * e.false_free),
                format!("{:.2} %", 100.0 * e.false_colliding),
                format!("{:.4}", e.iou),
            ]
        };
        let head = ["", "MSE", "MAE", "MPE", "false-free", "false-colliding", "IoU"];
        let rows: Vec<Vec<String>> = self.rows.iter().map(cells).collect();
        let Validation { orientations, mse, standard_error, .. } = self.validation;
        let spread = match orientations {
            1 => String::new(),
            _ => format!(" ± {standard_error:.1e}"),
        };
        let Self { guarantee, mse_over_variance, mse_over_nearest, verdict_text, .. } = self;
        format!(
            "{}{}; {}; {guarantee}.\nMSE at {orientations} random orientations {mse:.2e}{spread}, {mse_over_variance:.4} of the \
             exact field's variance and {mse_over_nearest:.4} of the nearest {} section's.\n{verdict_text}",
            table(&head, &rows),
            self.units_text(),
            self.threshold_text(),
            self.made.participle
        )
    }

    fn units_text(&self) -> String {
        let of = match self.quantity {
            Quantity::Overlap => "MSE and MPE of the overlap, against the exact field".to_owned(),
            Quantity::Depth => {
                format!("errors of the depth in {0} (MSE in {0}²), against exact depths", self.unit)
            }
        };
        let clearance = clearance_text(&self.clearance, &self.unit);
        let offset = clearance.map_or_else(String::new, |text| format!(" of the tool offset by {text}"));
        let tip = if self.tip_alone {
            ", all with its tip at the voxel: its other sharp points are left out"
        } else {
            ""
        };
        format!("{of}{offset}{tip}")
    }

    /// What counts as colliding, and of which tool.
    fn threshold_text(&self) -> String {
        let tau = threshold_text(self.threshold, self.quantity, &self.unit);
        let calls = format!("a pose is called colliding above τ = {tau}");
        let calls = match self.threshold_of {
            ThresholdOf::Question if self.quantity.is_overlap() && self.threshold == PAPER_THRESHOLD => {
                format!("{calls}, the paper's threshold and not the field's calibrated one")
            }
            ThresholdOf::Question | ThresholdOf::Nothing => format!("{calls}, which is not calibrated"),
            ThresholdOf::Calibration => format!("{calls}, its calibrated threshold"),
            ThresholdOf::CollidingAlone => format!(
                "the field calls no pose free: no value is low enough. In the table {calls}, as its calibration does; the poses below, which \
                 it leaves undecided, are counted as if they were called free"
            ),
        };
        match self.clearance.is_zero() {
            true => calls,
            false => format!(
                "{calls}; false-free of the tool as it is, false-colliding of the tool offset by its clearance"
            ),
        }
    }

    /// The table, with what it is of, and the pictures.
    pub(super) fn markdown(&self, pictures: &[(&str, &str)]) -> String {
        let Self { part, tool, program, dims: [x, y, z], pitch, unit, .. } = self;
        let mut text = format!(
            "# {part}, tool {tool}\n\n{program} · {x}×{y}×{z} voxels of {} {unit} · {}\n\n```text\n{}\n```\n\n",
            short(*pitch),
            self.made.describe(self.training_sections),
            self.table()
        );
        for (file, caption) in pictures {
            let _ = writeln!(text, "![{caption}]({file})\n\n{caption}\n");
        }
        text
    }
}
