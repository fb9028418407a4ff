//! Models: the network, what it was made for, and how it was trained.

use std::path::Path;

use anyhow::{Context as _, Result};
use imf_core::section::Quantity;
use imf_fields::model::Model;
use imf_fields::siren::SirenShape;
use serde_json::json;

use super::{Description, calibration_lines, field_lines, quantity_text};
use crate::progress::show_seconds;
use crate::session::show_bytes;

pub(super) fn describe(path: &Path, model: &Model) -> Result<Description> {
    let bytes = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
    let SirenShape { width, hidden, skip_after, omega } = model.shape;
    let skip = skip_after
        .filter(|&after| after < hidden)
        .map_or_else(String::new, |after| format!(", the input again after layer {after}"));
    let record = &model.record;
    let resumable = model.is_resumable();
    let mut lines = vec![
        ("model", path.display().to_string()),
        ("network", format!("siren5, {hidden} hidden layers of {width}{skip}, ω = {omega}")),
        ("parameters", format!("{}, file of {}", model.shape.parameter_count(), show_bytes(bytes))),
    ];
    lines.push(("values", quantity_text(Quantity::Overlap, &model.scene.record)));
    lines.extend(field_lines(&model.scene.record));
    lines.extend([
        (
            "trained on",
            format!(
                "{} orientations ({}), {} samples",
                record.orientations.len(),
                record.orientations.spec,
                record.samples
            ),
        ),
        (
            "training",
            format!(
                "{} steps in {} on {}{}",
                record.steps,
                show_seconds(record.seconds),
                record.engine,
                if record.finished { "" } else { ", not finished" }
            ),
        ),
    ]);
    if let Some(groups) = record.groups_per_epoch {
        lines.push(("order of samples", format!("{groups} groups an epoch, read while training")));
    }
    if let Some(last) = record.losses.last() {
        lines.push(("loss", format!("{:.6} at step {}", last.loss, last.step)));
    }
    if let Some(origin) = &record.fine_tuned_from {
        lines.push(("fine-tuned from", origin.clone()));
    }
    lines.extend(calibration_lines(model.calibration.as_ref()));
    lines.push((
        "resumable",
        if resumable { "yes: it holds the optimiser's state" } else { "no: weights alone" }.to_owned(),
    ));
    let json = json!({
        "kind": "model",
        "file": path,
        "network": model.shape,
        "parameters": model.shape.parameter_count(),
        "bytes": bytes,
        "quantity": Quantity::Overlap,
        "calibration": model.calibration,
        "scene": model.scene.record,
        "training": {
            "program": record.program,
            "plan": record.plan,
            "orientations": { "set": record.orientations.spec, "count": record.orientations.len() },
            "sampling": record.sampling,
            "samples": record.samples,
            "groups_per_epoch": record.groups_per_epoch,
            "steps": record.steps,
            "seconds": record.seconds,
            "engine": record.engine,
            "finished": record.finished,
            "last_loss": record.losses.last(),
            "fine_tuned_from": record.fine_tuned_from,
        },
        "resumable": resumable,
    });
    Ok(Description { lines, json })
}
