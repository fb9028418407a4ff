//! A toolpath against a scene.

use std::path::Path;

use glam::DMat4;
use imf_core::check::{
    CheckBodies, CheckSettings, MachineBodies, check_stock, check_toolpath, cutters_not_compared,
    machine_remarks, never_near, shortest_stick_outs,
};
use imf_core::control::Control;
use imf_core::machine::Machine;
use imf_core::scene::Bodies;
use imf_core::tool;
use imf_core::toolpath::{PathReading, Toolpath};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;

use crate::errors::{self, Raise, value_error};
use crate::poses::PoseRows;
use crate::scene::{Scene, clearance_of};
use crate::stock::{self, StockInput};
use crate::tool::Tool;
use crate::work::{Progress, detached, run};

/// A path as Python gives it.
#[derive(FromPyObject)]
pub(crate) enum PathInput<'py> {
    /// Rows of poses; of those with a quaternion the roll counts.
    Poses(PyReadonlyArray2<'py, f64>),
    /// Its file.
    File(String),
}

/// The report of a check as JSON text, remarks for people, and what is left of the stock, where one is given.
#[pyfunction]
pub(crate) fn check<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    path: PathInput<'py>,
    tools: Vec<(Option<u32>, Py<Tool>)>,
    machine: Option<&str>,
    clearance: Option<[f64; 3]>,
    contact: Option<f64>,
    step: Option<f64>,
    in_world: Option<bool>,
    stick_out: bool,
    stock: Option<StockInput<'py>>,
    progress: Progress<'py>,
) -> PyResult<(String, Vec<String>, Option<Bound<'py, PyDict>>)> {
    let own = scene.get();
    let record = &own.scene.record;
    let mut tools: Vec<(Option<u32>, tool::Tool)> =
        tools.iter().map(|(number, tool)| (*number, tool.get().0.in_unit(record.unit))).collect();
    if tools.is_empty() {
        tools.push((None, record.bare_tool().clone()));
    }
    let machine = machine.map(|path| Machine::read(Path::new(path))).transpose().map_err(Raise::raise)?;
    let machine = machine.map(|machine| machine.in_unit(record.unit));
    let lengths: Vec<_> = tools.iter().map(|(number, tool)| (*number, tool.length())).collect();
    let reading = PathReading { unit: record.unit, machine: machine.as_ref(), lengths: &lengths };
    let path = match &path {
        PathInput::File(file) => detached(py, || Toolpath::read(Path::new(file), reading))?,
        PathInput::Poses(poses) => {
            let rows = PoseRows::new(poses)?;
            detached(py, || {
                Toolpath::of_poses((0..rows.len()).map(|row| rows.pose(row)), rows.say_roll(), reading)
            })?
        }
    };
    // A machine stands where the part is set up.
    let by_machine = machine.is_some() && record.transform != DMat4::IDENTITY;
    if by_machine && in_world == Some(false) {
        return Err(value_error(
            "with a machine a path has the coordinates of G54, the frame into which the scene's transform sets the part up: give frame='world' \
             or none",
        ));
    }
    let set_up = if in_world.unwrap_or(by_machine) { DMat4::IDENTITY } else { record.transform };
    let path = path.map_err(Raise::raise)?.placed(&set_up);
    let settings = CheckSettings::of_scene(record, contact, step);
    let settings = CheckSettings { clearance: clearance.map_or(record.clearance, clearance_of), ..settings };
    let numbered: Vec<(Option<u32>, &tool::Tool)> =
        tools.iter().map(|(number, tool)| (*number, tool)).collect();
    let bodies = &own.bodies;
    let machine = match machine {
        Some(machine) => {
            Some(run(py, (&None, "", 0), |control| MachineBodies::new(machine, record.grid.pitch, control))?)
        }
        None => None,
    };
    let mut remarks = path.remarks.clone();
    for (_, tool) in &tools {
        // A tool that passes between the voxels' centres would be free everywhere.
        let found = own
            .with_spec(Control::quiet(), |spec| spec.assembly(tool, &settings.clearance, &record.grid))
            .map_err(Raise::raise)?;
        remarks.extend(found.1.iter().map(errors::warning));
    }
    remarks.extend(cutters_not_compared(&path, &numbered));
    remarks.extend(never_near(&path, &numbered, &bodies.part));
    let lines = path.locations.len() as u64;
    let placed = own.with_spec(Control::quiet(), |spec| Ok(spec.placed())).map_err(Raise::raise)?;
    let surfaces: Vec<_> = placed.iter().collect();
    let bare: Option<Bodies> = match record.conservative {
        true => Some(run(py, (&None, "", 0), |control| {
            own.with_spec(control, |spec| bodies.by_centres(&spec.placed(), control))
        })?),
        false => None,
    };
    let bare = bare.as_ref().unwrap_or(bodies);
    let around = CheckBodies {
        part: &bodies.part,
        by_centres: record.conservative.then_some(&bare.part),
        fixtures: &bodies.fixtures,
        surfaces: &surfaces,
        machine: machine.as_ref(),
    };
    remarks.extend(machine_remarks(around, &numbered, &path.set_up));
    let mut report = run(py, (&progress, "checking", lines), |control| {
        check_toolpath(around, &numbered, &path, &settings, control)
    })?;
    let mut stock_left = None;
    if let Some(stock) = stock {
        let voxels = stock.voxels(py, own)?;
        let around = CheckBodies { part: &bare.part, fixtures: &bare.fixtures, ..around };
        let mut found = run(py, (&progress, "cutting the stock", lines), |control| {
            check_stock(around, &voxels, &numbered, &path, &settings, control)
        })?;
        report.add(std::mem::take(&mut found.colliding));
        remarks.extend(found.overlaps(record.unit));
        stock_left = Some(stock::report_dict(py, found, &bare.part)?);
    }
    report.place(&set_up.inverse());
    let mut stick_outs = Vec::new();
    if stick_out {
        stick_outs = run(py, (&progress, "stick-out", lines), |control| {
            let by = machine.as_ref().map(MachineBodies::machine);
            shortest_stick_outs(
                &bodies.obstacle().into(),
                &surfaces,
                &numbered,
                &path,
                &settings,
                by,
                control,
            )
        })?;
    }
    let weakest = settings.guarantee(tools.iter().map(|(_, tool)| tool), record);
    let guarantee = weakest.map_or_else(String::new, |guarantee| guarantee.to_string());
    let found = json!({ "report": report, "stick_outs": stick_outs, "guarantee": guarantee });
    let text = serde_json::to_string(&found);
    let text = text.map_err(|error| value_error(error.to_string()))?;
    Ok((text, remarks, stock_left))
}
