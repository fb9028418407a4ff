//! What was made from scenes: datasets, and fields of every family.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use glam::DMat4;
use imf_core::scene::SceneRecord;
use imf_core::section::Quantity;
use imf_core::tool::{Element, Tool, ToolShape};
use imf_core::unit::LengthUnit;
use imf_fields::calibration::Calibration;
use imf_fields::factored::file::FactoredFile;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::model::Model;
use imf_fields::siren::SirenShape;
use imf_train::dataset::{Manifest, ShardRecord};
use serde_json::{Value, json};

use super::{Description, Line};
use crate::arguments::clearance::{clearance_text, contact_text};
use crate::commands::calibrate::{decision_rates, threshold_text};
use crate::commands::train::harmonic::validation_text;
use crate::output::short;
use crate::session::show_bytes;

pub(super) fn dataset(folder: &Path) -> Result<Description> {
    ensure!(Manifest::is_in(folder), "{} is not a dataset: a folder without manifest.json", folder.display());
    let manifest = Manifest::read(folder)?;
    let size = |shard: &ShardRecord| std::fs::metadata(folder.join(&shard.file)).ok().map(|m| m.len());
    let finished: Vec<(&ShardRecord, u64)> =
        manifest.shards.iter().flatten().filter_map(|shard| Some((shard, size(shard)?))).collect();
    let missing = manifest.shard_count() - finished.len();
    let samples: u64 = finished.iter().map(|(shard, _)| shard.samples).sum();
    let bytes: u64 = finished.iter().map(|&(_, bytes)| bytes).sum();
    let sampling = &manifest.sampling;
    // A voxel, a value and an orientation each.
    let cut = finished.iter().filter(|(shard, bytes)| *bytes < 8 * shard.samples).count();
    let rest = match (missing, cut) {
        (0, 0) => "all there; a training reads their checksums".to_owned(),
        (0, cut) => format!("{cut} cut off: remove it, and the same `imf dataset` command makes it again"),
        _ => format!("{missing} missing: the same `imf dataset` command finishes it"),
    };
    let mut lines = vec![("dataset", folder.display().to_string())];
    lines.extend(scene_lines(&manifest.scene));
    lines.extend([
        ("orientations", format!("{} ({})", manifest.orientations.len(), manifest.orientations.spec)),
        (
            "sampling",
            format!(
                "{:.1} % of the voxels of every section, up to {:.1} % of them where the tool collides, seed {}",
                100.0 * sampling.density,
                100.0 * sampling.positive_fraction,
                sampling.seed
            ),
        ),
        ("shards", format!("{} of {}, {rest}", finished.len(), manifest.shard_count())),
        ("samples", format!("{samples} in {}", show_bytes(bytes))),
    ]);
    let json = json!({
        "kind": "dataset",
        "folder": folder,
        "scene": manifest.scene,
        "orientations": { "set": manifest.orientations.spec, "count": manifest.orientations.len() },
        "sampling": sampling,
        "shards": manifest.shard_count(),
        "shards_finished": finished.len(),
        "shards_missing": missing,
        "samples": samples,
        "bytes": bytes,
    });
    Ok(Description { lines, json })
}

/// A field of any family: what it is, what it is of, how it was made, and error rates of its decisions.
pub(super) fn field(path: &Path, file: &FieldFile) -> Result<Description> {
    let bytes = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
    let size = show_bytes(bytes);
    let (what, made, own) = match file {
        FieldFile::Siren(model) => siren(model, &size),
        FieldFile::Harmonic(file) => harmonic(file, &size),
        FieldFile::Factored(file) => factored(file, &size),
    };
    let (record, quantity, calibration) = (&file.scene().record, file.quantity(), file.calibration());
    let name = if matches!(file, FieldFile::Siren(_)) { "model" } else { "field" };
    let mut lines = vec![(name, path.display().to_string())];
    lines.extend(what);
    lines.push(("values", quantity_text(quantity, record)));
    // A learnt or fitted field's own values guarantee nothing.
    lines.extend(scene_lines(record).into_iter().map(|(name, text)| match name {
        "guarantee" => (
            name,
            format!("none by its own values, which are estimates; what is counted (--exact) is {text}"),
        ),
        _ => (name, text),
    }));
    // Tells fields of two states of a part apart, whose names and grids may be the same.
    let (solid, checksum) = (file.scene().obstacle.count(), record.obstacle_crc32);
    lines.push(("solid", format!("{solid} voxels, checksum {checksum:08x}")));
    lines.extend(made);
    lines.extend(calibration_lines(calibration, quantity, record.unit));
    let mut json = json!({
        "file": path.display().to_string(),
        "bytes": bytes,
        "quantity": quantity,
        "bounds": quantity.bounds(record.grid.pitch),
        "calibration": calibration,
        "scene": record,
    });
    if let (Value::Object(all), Value::Object(own)) = (&mut json, own) {
        all.extend(own);
    }
    Ok(Description { lines, json })
}

/// Lines of what it is, lines of how it was made, and what a family alone has in JSON.
type Family = (Vec<Line>, Vec<Line>, Value);

fn siren(model: &Model, size: &str) -> Family {
    let SirenShape { width, hidden, skip_after, omega } = model.shape;
    let skip = skip_after
        .filter(|&after| after < hidden)
        .map_or_else(String::new, |after| format!(", the input again after layer {after}"));
    let (record, parameters) = (&model.record, model.shape.parameter_count());
    let (set, count) = (&record.orientations.spec, record.orientations.len());
    let what = vec![
        ("network", format!("siren5, {hidden} hidden layers of {width}{skip}, ω = {omega}")),
        ("parameters", format!("{parameters}, file of {size}")),
    ];
    let end = if record.finished { "" } else { ", not finished" };
    let mut made = vec![
        ("trained on", format!("{count} orientations ({set}), {} samples", record.samples)),
        ("training", format!("{} steps on {}{end}", record.steps, record.engine)),
    ];
    if let Some(groups) = record.groups_per_epoch {
        made.push(("order of samples", format!("{groups} groups an epoch, read while training")));
    }
    if let Some(last) = record.losses.last() {
        made.push(("loss", format!("{:.6} at step {}", last.loss, last.step)));
    }
    if let Some(origin) = &record.fine_tuned_from {
        made.push(("fine-tuned from", origin.clone()));
    }
    made.push(resumable(model.is_resumable()));
    let json = json!({
        "kind": "model",
        "network": model.shape,
        "parameters": parameters,
        "training": {
            "program": record.program,
            "plan": record.plan,
            "orientations": { "set": set, "count": count },
            "sampling": record.sampling,
            "samples": record.samples,
            "groups_per_epoch": record.groups_per_epoch,
            "steps": record.steps,
            "engine": record.engine,
            "finished": record.finished,
            "last_loss": record.losses.last(),
            "fine_tuned_from": record.fine_tuned_from,
        },
        "resumable": model.is_resumable(),
    });
    (what, made, json)
}

fn harmonic(file: &HarmonicFile, size: &str) -> Family {
    let HarmonicFile { field, settings, .. } = file;
    let (report, components) = (&field.report, field.component_count());
    let family = format!(
        "harmonic, {} basis functions of degree {}, {components} principal components, file of {size}",
        report.functions, settings.degree
    );
    let errors = format!(
        "{}; dropped components {:.1e}",
        validation_text(&report.validation, field.quantity, file.scene.record.unit),
        report.dropped
    );
    let made = vec![("fitted to", format!("{} exact sections", report.sections)), ("errors", errors)];
    let json =
        json!({ "kind": "harmonic", "components": components, "settings": settings, "report": report });
    (vec![("family", family)], made, json)
}

fn factored(file: &FactoredFile, size: &str) -> Family {
    let FactoredFile { field, fit, report, settings, state, .. } = file;
    let (shape, parameters) = (&field.shape, field.parameter_count());
    let family = format!("factored, {shape}, ω = {}, {parameters} parameters, file of {size}", shape.omega);
    let of = format!("degree {} from {} exact sections", fit.degree, report.sections);
    let errors = validation_text(&report.validation, field.quantity, file.scene.record.unit);
    let made = vec![
        ("symmetry", format!("the network is reduced by: {}", shape.symmetry)),
        ("teacher", format!("harmonic field of {of}, {errors}")),
        resumable(state.is_some()),
    ];
    let json = json!({
        "kind": "factored",
        "network": shape,
        "parameters": parameters,
        "settings": settings,
        "teacher": { "settings": fit, "report": report },
        "resumable": state.is_some(),
    });
    (vec![("family", family)], made, json)
}

fn resumable(resumable: bool) -> Line {
    let text = if resumable { "yes: it holds the optimiser's state" } else { "no: weights alone" };
    ("resumable", text.to_owned())
}

fn calibration_lines(calibration: Option<&Calibration>, quantity: Quantity, unit: LengthUnit) -> Vec<Line> {
    let Some(known) = calibration else {
        return vec![("decisions", "not calibrated: imf calibrate measures their error rates".into())];
    };
    let shown = |value: f64| threshold_text(value, quantity, unit);
    let threshold = |value: Option<f32>| value.map_or("never".into(), |v| shown(f64::from(v)));
    vec![
        (
            "decisions",
            format!(
                "free up to {}, colliding from {}, undecided between; bounds at {} % confidence",
                threshold(known.free_up_to),
                threshold(known.colliding_from),
                known.goals.confidence * 100.0
            ),
        ),
        ("  anywhere", decision_rates(&known.uniform, quantity, &shown)),
        ("  at contact", decision_rates(&known.boundary, quantity, &shown)),
        ("verdict", known.verdict().to_string()),
    ]
}

fn quantity_text(quantity: Quantity, scene: &SceneRecord) -> String {
    let unit = scene.unit;
    match quantity {
        Quantity::Overlap => "overlap: the fraction of the tool's volume that lies in the part".into(),
        Quantity::Depth => {
            let [_, most] = quantity.bounds(scene.grid.pitch);
            format!(
                "depth in {unit}: how far the tool must be moved to be free, below 0 how far it may be moved; clamped within \
                 {} pitches, {} {unit}",
                short(most / scene.grid.pitch),
                short(most)
            )
        }
    }
}

/// The largest diameter of every element; nothing of a mesh.
fn diameters(tool: &Tool) -> String {
    let ToolShape::Revolved(elements) = &tool.shape else { return String::new() };
    let of = |own: &Element| format!("{} {} ({})", short(2.0 * own.max_radius()), tool.unit, own.kind);
    format!(", largest diameters {}", elements.iter().map(of).collect::<Vec<_>>().join(", "))
}

/// What samples were made for, or a field.
fn scene_lines(scene: &SceneRecord) -> Vec<Line> {
    let (grid, unit, tool) = (&scene.grid, scene.unit, scene.bare_tool());
    let [x, y, z] = grid.dims;
    let rule = if scene.conservative { "every voxel that the surface touches" } else { "voxel centres" };
    let surface = if scene.closed { "closed" } else { "open" };
    let mut lines = vec![
        ("part", format!("{} ({surface} mesh; solid: {rule})", scene.part)),
        ("grid", format!("{x}×{y}×{z}, pitch {} {unit}, margin {}", short(grid.pitch), scene.margin)),
        (
            "tool",
            format!(
                "{}, length {} {unit}, reach {} {unit}{}",
                tool.name,
                short(tool.length()),
                short(tool.reach()),
                diameters(tool)
            ),
        ),
    ];
    if !scene.fixtures.is_empty() {
        lines.push(("fixtures", scene.fixtures.join(", ")));
    }
    if let Some(depth) = scene.contact {
        lines.push(("contact", contact_text(depth, scene.grid.pitch, unit)));
    }
    if let Some(text) = clearance_text(&scene.clearance, unit) {
        lines.push(("clearance", format!("{text}: the field is that of the offset tool")));
    }
    lines.push(("guarantee", scene.guarantee().to_string()));
    if scene.transform != DMat4::IDENTITY {
        let rows = scene.transform.transpose().to_cols_array_2d();
        let row = |r: [f64; 4]| r.map(short).join(" ");
        lines.push(("set-up", rows[..3].iter().map(|&r| row(r)).collect::<Vec<_>>().join("; ")));
    }
    lines
}
