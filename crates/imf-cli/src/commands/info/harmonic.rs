//! Harmonic fields: functions, size, and the errors that making them told.

use std::path::Path;

use anyhow::{Context as _, Result};
use imf_fields::harmonic::file::HarmonicFile;
use serde_json::json;

use super::{Description, calibration_lines, field_lines, quantity_text};
use crate::session::show_bytes;

pub(super) fn describe(path: &Path, file: &HarmonicFile) -> Result<Description> {
    let bytes = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
    let HarmonicFile { field, scene, settings, .. } = file;
    let report = &field.report;
    let mut lines = vec![
        ("field", path.display().to_string()),
        (
            "family",
            format!(
                "harmonic, {} functions of degree {} along {} axes, file of {}",
                report.functions,
                settings.degree,
                field.axis_count(),
                show_bytes(bytes)
            ),
        ),
    ];
    lines.push(("values", quantity_text(field.quantity, &scene.record)));
    lines.extend(field_lines(&scene.record));
    lines.push(("fitted to", format!("{} exact sections", report.sections)));
    lines.push((
        "errors",
        format!(
            "MSE {:.1e}, at most {:.3}, at {} orientations that were not fitted; dropped axes {:.1e}",
            report.held_out_mse, report.held_out_mpe, settings.held_out, report.dropped
        ),
    ));
    lines.extend(calibration_lines(file.calibration.as_ref()));
    let json = json!({
        "kind": "harmonic",
        "quantity": field.quantity,
        "bounds": field.quantity.bounds(scene.record.grid.pitch),
        "calibration": file.calibration,
        "file": path,
        "bytes": bytes,
        "axes": field.axis_count(),
        "settings": settings,
        "report": report,
        "scene": scene.record,
    });
    Ok(Description { lines, json })
}
