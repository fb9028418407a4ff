//! `imf check`: a toolpath against the part, line by line and element by element.

use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Result, ensure};
use imf_core::check::{Against, CheckError, CheckReport, CheckSettings, Collision, check_toolpath};
use imf_core::occupancy::Occupancy;
use imf_core::pose::Pose;
use imf_core::scene::{Guarantee, Scene, SceneRecord};
use imf_core::toolpath::Toolpath;
use imf_fields::field::{Field, VerifiedField};
use serde_json::json;
use thiserror::Error;

use crate::arguments::check::CheckArguments;
use crate::interrupt::Interrupted;
use crate::output::answer;
use crate::session::Session;

/// The answer is "it collides": said on standard output already, left to the exit code.
#[derive(Debug, Error)]
#[error("the toolpath collides")]
pub(crate) struct CollisionFound;

pub(crate) fn run(session: &Session, arguments: &CheckArguments) -> Result<()> {
    let (scene, bodies) = arguments.scene.scene_and_bodies(session)?;
    let record = &scene.record;
    let toolpath = Toolpath::read(&arguments.toolpath, record.unit)?;
    for unknown in &toolpath.unknown {
        let times = if unknown.times > 1 { format!(" ({} times)", unknown.times) } else { String::new() };
        session.warn(&format!(
            "line {}{times}: '{}' is not understood; if it moves the tool, that is not checked",
            unknown.line, unknown.word
        ));
    }
    // Contact is accepted with the part alone, never with a fixture.
    let fixtures = (!record.fixtures.is_empty()).then_some(&bodies.fixtures);
    let settings = arguments.settings(record.grid.pitch);
    let guarded = match &arguments.field {
        Some(path) => Some(guarded(path, &scene, &bodies.part, fixtures, &settings)?),
        None => None,
    };
    let proven = AtomicU64::new(0);
    let is_free = |pose: &Pose| {
        let free = guarded.as_ref().is_some_and(|field| field.is_free(pose));
        proven.fetch_add(u64::from(free), Ordering::Relaxed);
        free
    };
    let stage = session.stage("checking", "lines", toolpath.locations.len() as u64);
    let advance = |n| stage.advance(n);
    let control = session.control(&advance);
    let tool = record.bare_tool();
    let report = check_toolpath(&bodies.part, fixtures, tool, &toolpath, &settings, is_free, control);
    let report = report.map_err(|error| match error {
        CheckError::Cancelled => Interrupted("the toolpath was not checked to its end".into()).into(),
        other => anyhow::Error::from(other),
    })?;
    stage.finish(&format!("{} poses", report.poses));
    if guarded.is_some() {
        let free = proven.into_inner();
        session.note(&format!("{free} of {} poses were proven free by the guarded field", report.poses));
    }
    let json = json!({
        "toolpath": arguments.toolpath, "part": record.part, "tool": record.tool.name, "unit": record.unit,
        "pitch": record.grid.pitch, "collides": !report.colliding.is_empty(), "report": report,
        "guarantee": guarantee(&report, record).to_string(), "unknown_words": toolpath.unknown,
    });
    answer(session, &json, &text(&report, record))?;
    if report.colliding.is_empty() { Ok(()) } else { Err(CollisionFound.into()) }
}

/// A field's guard of the very part, fixtures and tool that are checked.
fn guarded(
    path: &Path,
    scene: &Scene,
    part: &Occupancy,
    fixtures: Option<&Occupancy>,
    settings: &CheckSettings,
) -> Result<VerifiedField> {
    let model = Field::load(path)?;
    let known = model.scene();
    let name = path.display();
    ensure!(
        known.record.bare_tool() == scene.record.bare_tool(),
        "{name} is of the tool {}, not of the {} that is checked: leave out --field, or choose the same --tool",
        known.record.bare_tool().name,
        scene.record.bare_tool().name
    );
    // What is not in the field's voxels its guard would not see.
    let holds = |body: &Occupancy| {
        known
            .obstacle
            .on(&body.grid)
            .is_some_and(|seen| seen.solid.iter().zip(&body.solid).all(|(seen, body)| body & (1 - seen) == 0))
    };
    ensure!(
        holds(part) && fixtures.is_none_or(holds),
        "{name} is of other voxels than those that are checked: leave out --field, or choose the part, grid, set-up and \
         fixtures that it was made for (imf info {name})"
    );
    // Contact is the check's affair: the guard proves that nothing at all is touched.
    let mut whole = known.clone();
    whole.record.contact = None;
    whole.layer = None;
    Ok(VerifiedField::of_scene(model, &whole, settings.clearance)?)
}

/// The report for people: one line a collision, then what was checked and what was accepted.
fn text(report: &CheckReport, record: &SceneRecord) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    for line in &report.colliding {
        for collision in &line.collisions {
            let _ = writeln!(text, "line {}: {}", line.line, one(collision, line.poses, record));
        }
    }
    let settings = &report.settings;
    let unit = record.unit;
    let verdict = match report.colliding.len() {
        0 => "no collision".to_owned(),
        1 => "1 line collides".to_owned(),
        n => format!("{n} lines collide"),
    };
    let _ = writeln!(
        text,
        "{verdict}: {} lines, {} poses, no point of the tool moving more than {:.4} {unit} between them",
        report.locations, report.poses, settings.tolerance
    );
    let clearance = &settings.clearance;
    let accepted = if record.bare_tool().has_cutter() {
        format!(
            "the cutter's overlap with voxels down to {:.4} {unit} below the part's surface, by their centres",
            settings.contact
        )
    } else {
        "no overlap at all, for no element of the tool is a cutter".to_owned()
    };
    let _ = writeln!(
        text,
        "accepted: {accepted}; clearance: holder {}, shank {}, cutter {} {unit}",
        clearance.holder, clearance.shank, clearance.cutter
    );
    let guarantee = guarantee(report, record);
    let _ = writeln!(text, "{guarantee} (voxels of {:.4} {unit})", record.grid.pitch);
    text
}

/// Which guarantee holds: the cutter may touch wherever any contact is accepted.
fn guarantee(report: &CheckReport, record: &SceneRecord) -> Guarantee {
    let CheckSettings { clearance, contact, .. } = &report.settings;
    Guarantee::new(record.conservative, record.bare_tool(), clearance, *contact > 0.0, record.grid.pitch)
}

fn one(collision: &Collision, poses: u64, record: &SceneRecord) -> String {
    let against = match collision.against {
        Against::Part => "the part",
        Against::Fixtures => "a fixture",
    };
    let [x, y, z] = collision.position;
    let [i, j, k] = collision.axis;
    format!(
        "{} hits {against}: {} voxels, {:.3} {}³, at worst with the tip at {x:.3},{y:.3},{z:.3} and the axis \
         {i:.4},{j:.4},{k:.4}; {} of {poses} poses",
        collision.element, collision.voxels, collision.volume, record.unit, collision.poses
    )
}
