//! Factored fields: the network, its teacher, and how it was taught.

use std::path::Path;

use anyhow::{Context as _, Result};
use imf_fields::factored::file::FactoredFile;
use serde_json::json;

use super::{Description, calibration_lines, field_lines, quantity_text};
use crate::session::show_bytes;

pub(super) fn describe(path: &Path, file: &FactoredFile) -> Result<Description> {
    let bytes = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
    let FactoredFile { field, scene, fit, report, settings, state, .. } = file;
    let mut lines = vec![
        ("field", path.display().to_string()),
        (
            "family",
            format!(
                "factored, {}, ω = {}, {} parameters, file of {}",
                field.shape,
                field.shape.omega,
                field.parameter_count(),
                show_bytes(bytes)
            ),
        ),
    ];
    lines.push(("values", quantity_text(field.quantity, &scene.record)));
    lines.extend(field_lines(&scene.record));
    lines.push(("symmetry", format!("the network is told of {}", field.shape.symmetry)));
    let made = format!("degree {} from {} exact sections", fit.degree, report.sections);
    let errors = format!(
        "MSE {:.1e}, at most {:.3}, at orientations that were not fitted",
        report.held_out_mse, report.held_out_mpe
    );
    lines.push((
        "teacher",
        match settings.online {
            None => format!("harmonic field of {made}, {errors}"),
            Some(online) => format!(
                "fresh exact sections, {} at a time, along functions of {made} of a sample of voxels, a fit of which has {errors}",
                online.pool
            ),
        },
    ));
    lines.push((
        "resumable",
        if state.is_some() { "yes: it holds the optimiser's state" } else { "no: weights alone" }.to_owned(),
    ));
    lines.extend(calibration_lines(file.calibration.as_ref()));
    let json = json!({
        "kind": "factored",
        "quantity": field.quantity,
        "bounds": field.quantity.bounds(scene.record.grid.pitch),
        "calibration": file.calibration,
        "file": path,
        "bytes": bytes,
        "network": field.shape,
        "parameters": field.parameter_count(),
        "settings": settings,
        "teacher": { "settings": fit, "report": report },
        "scene": scene.record,
        "resumable": state.is_some(),
    });
    Ok(Description { lines, json })
}
