//! `imf check`: a toolpath against the part, line by line and element by element.

mod files;
mod listed;
mod picture;
mod stick_out;
mod stock;
mod text;
mod view;

use std::borrow::Cow;
use std::sync::Arc;

use anyhow::Result;
use glam::DMat4;
use imf_core::check::{
    CheckBodies, CheckError, CheckReport, MachineBodies, PathStickOut, check_stock, check_toolpath,
    cutters_not_compared, machine_remarks, never_near, path_memory_estimate, shortest_stick_outs,
};
use imf_core::machine::Machine;
use imf_core::mesh::Mesh;
use imf_core::scene::SceneRecord;
use imf_core::tool::{Tool, ToolShape};
use imf_core::toolpath::{PathReading, Toolpath, ToolpathError};
use imf_core::unit::LengthUnit;
use serde_json::json;
use thiserror::Error;

use crate::arguments::check::{CheckArguments, Frame};
use crate::arguments::fixture::StockArgument;
use crate::arguments::scene::SceneArguments;
use crate::output::{OutputFile, OutputFolder, print_written};
use crate::session::Session;
use stock::{StockInput, StockResult};

/// The result is "it collides" or "it leaves the travel": printed on standard output already, and left to the exit
/// code.
#[derive(Debug, Error)]
#[error("the toolpath collides")]
pub(crate) struct CollisionFound;

/// What was checked, beside what was found.
struct CheckRun<'a> {
    arguments: &'a CheckArguments,
    frame: Frame,
    record: &'a SceneRecord,
    toolpath: &'a Toolpath,
    /// In the part's unit.
    tools: Vec<(Option<u32>, Tool)>,
    machine: Option<&'a MachineBodies>,
    /// In the frame of the toolpath.
    report: CheckReport,
    /// What text and JSON list of it.
    listed: CheckReport,
    stock: Option<StockResult>,
    /// By tool, where requested.
    stick_outs: Vec<PathStickOut>,
}

pub(crate) fn run(session: &Session, arguments: &CheckArguments) -> Result<()> {
    let given = arguments.tools()?;
    let out = arguments.out.as_deref().map(OutputFolder::check).transpose()?;
    let page = arguments.html.as_deref().map(OutputFile::check).transpose()?;
    // The scene of one tool, the thinnest: voxels that detect it detect every other one.
    let thinnest = given.iter().min_by(|a, b| thickness(&a.tool).total_cmp(&thickness(&b.tool)));
    let tool = thinnest.map(|given| given.text.clone()).into_iter().collect();
    let scene = SceneArguments { tool, ..arguments.scene.clone() };
    let (scene, bodies, meshes) = scene.scene_and_bodies(session, given.iter().map(|given| &given.tool))?;
    let record = &scene.record;
    let mut tools: Vec<(Option<u32>, Tool)> =
        given.iter().map(|given| (given.number, given.tool.in_unit(record.unit))).collect();
    if tools.is_empty() {
        tools.push((None, record.bare_tool().clone()));
    }
    let frame = arguments.frame(record.transform != DMat4::IDENTITY)?;
    let set_up = match frame {
        Frame::Part => record.transform,
        Frame::World => DMat4::IDENTITY,
    };
    let machine = arguments.machine.as_deref().map(Machine::read).transpose()?;
    let machine = machine.map(|machine| machine.in_unit(record.unit));
    let lengths: Vec<_> = tools.iter().map(|(number, tool)| (*number, tool.length())).collect();
    let inputs = PathReading { unit: record.unit, machine: machine.as_ref(), lengths: &lengths };
    let toolpath = Toolpath::read(&arguments.toolpath, inputs);
    let toolpath = toolpath.map_err(with_remedy)?.placed(&set_up);
    let lines = toolpath.locations.len() as u64;
    session.require_memory(path_memory_estimate(toolpath.locations.len()), || {
        format!("a path of {lines} lines and chords of arcs; divide it")
    })?;
    toolpath.remarks.iter().for_each(|remark| session.choose(remark));
    if let ([(None, tool)], [Some(number)]) = (tools.as_slice(), toolpath.tools().as_slice()) {
        session.choose(&format!(
            "the toolpath calls its only tool {number}: it is checked with '{}'",
            tool.name
        ));
    }
    let numbered: Vec<(Option<u32>, &Tool)> = tools.iter().map(|(number, tool)| (*number, tool)).collect();
    let settings = arguments.settings(record);
    let bare = match record.conservative {
        true => {
            let placed = meshes.iter().map(|(_, mesh)| mesh);
            Cow::Owned(bodies.by_centres(placed, session.control(&|_| {}))?)
        }
        false => Cow::Borrowed(&bodies),
    };
    let read_stock =
        |stock: &StockArgument| StockInput::read(session, stock, record, &bare.part, &meshes[0].1);
    let stock = arguments.stock.as_ref().map(read_stock).transpose()?;
    let moving = |machine| MachineBodies::new(machine, record.grid.pitch, session.control(&|_| {}));
    let machine = machine.map(moving).transpose()?;
    cutters_not_compared(&toolpath, &numbered).iter().for_each(|remark| session.choose(remark));
    never_near(&toolpath, &numbered, &bodies.part).iter().for_each(|remark| session.warn(remark));
    let stage = session.stage("checking", "lines", lines);
    let advance = |n| stage.advance(n);
    let control = session.control(&advance);
    let surfaces: Vec<&Mesh> = meshes.iter().map(|(_, mesh)| mesh).collect();
    let around = CheckBodies {
        part: &bodies.part,
        by_centres: record.conservative.then_some(&bare.part),
        fixtures: &bodies.fixtures,
        surfaces: &surfaces,
        machine: machine.as_ref(),
    };
    machine_remarks(around, &numbered, &toolpath.set_up).iter().for_each(|remark| session.warn(remark));
    let report = check_toolpath(around, &numbered, &toolpath, &settings, control);
    let with_name = |error| in_toolpath(error, arguments);
    let mut report = report.map_err(with_name)?;
    stage.finish(&format!("{} poses", report.poses));
    let mut stick_outs = Vec::new();
    if arguments.stickout {
        let by = machine.as_ref().map(MachineBodies::machine);
        let found = session.staged("stick-out", "lines", lines, |control| {
            let obstacle = Arc::new(bodies.obstacle());
            shortest_stick_outs(&obstacle, &surfaces, &numbered, &toolpath, &settings, by, control)
        });
        stick_outs = found.map_err(with_name)?;
    }
    let mut stock = match stock {
        None => None,
        Some(stock) => {
            let around = CheckBodies { part: &bare.part, fixtures: &bare.fixtures, ..around };
            let found = session.staged("cutting the stock", "lines", lines, |control| {
                check_stock(around, &stock.voxels, &numbered, &toolpath, &settings, control)
            });
            let found = found.map_err(with_name)?;
            found.overlaps(record.unit).iter().for_each(|overlap| session.warn(overlap));
            Some(StockResult::new(stock, found, &mut report, &bare.part, settings, &toolpath, record))
        }
    };
    // In the toolpath's frame, as long as places are in it.
    let pictured = out.as_ref().map_or(Ok(false), |folder| {
        folder.begin(session)?;
        let name = (record.transform != DMat4::IDENTITY).then_some(match frame {
            Frame::Part => "part's frame",
            Frame::World => "world",
        });
        let drawn = picture::PictureFrame { set_up, name, unit: record.unit };
        picture::draw(&report, &numbered, around, stock.as_ref(), &drawn, &folder.file(files::WORST))
    });
    let back = set_up.inverse();
    report.place(&back);
    stock.iter_mut().for_each(|stock| stock.place(&back));
    let checked = CheckRun {
        arguments,
        frame,
        record,
        toolpath: &toolpath,
        tools,
        machine: machine.as_ref(),
        listed: listed::listed(&report),
        report,
        stock,
        stick_outs,
    };
    let mut json = checked.json();
    let write = |pictured: bool| -> Result<()> {
        if let Some(page) = &page {
            let shown = view::CheckScene::new(&checked, &meshes, &bare.part, &back, &set_up);
            let path = page.begin()?;
            view::view(&checked, &shown, &toolpath, &back).write_page(path)?;
            session.note(&format!("wrote {}: open it in a browser", path.display()));
        }
        let Some(folder) = &out else { return Ok(()) };
        files::write(&checked, &mut json, pictured, &bare.part, folder, session)
    };
    let written = pictured.and_then(write);
    print_written(session, &json, &text::text(&checked), written)?;
    if checked.fails() { Err(CollisionFound.into()) } else { Ok(()) }
}

/// The error, with what a path for a machine lacks.
fn with_remedy(error: ToolpathError) -> anyhow::Error {
    match error {
        ToolpathError::Line { needs_machine: true, .. } => anyhow::Error::from(error)
            .context("the path is for a machine: describe it in a file, and name that (--machine FILE)"),
        _ => error.into(),
    }
}

/// The error, with the toolpath's name where it is about a line.
fn in_toolpath(error: CheckError, arguments: &CheckArguments) -> anyhow::Error {
    match error {
        CheckError::Line { .. } => {
            anyhow::Error::from(error).context(arguments.toolpath.display().to_string())
        }
        _ => error.into(),
    }
}

/// Of a tool's thinnest element, or of its tip where that is more slender, in mm.
fn thickness(tool: &Tool) -> f64 {
    let tool = tool.in_unit(LengthUnit::Mm);
    let ToolShape::Revolved(_) = &tool.shape else { return f64::INFINITY };
    tool.slender_tip().unwrap_or_else(|| tool.thinnest().1)
}

impl CheckRun<'_> {
    fn fails(&self) -> bool {
        !(self.report.colliding.is_empty() && self.report.out_of_travel.is_empty())
    }

    /// The weakest of all tools: the cutter may touch wherever any contact is accepted.
    fn guarantee(&self) -> String {
        let tools = self.tools.iter().map(|(_, tool)| tool);
        let weakest = self.report.settings.guarantee(tools, self.record);
        weakest.map_or_else(String::new, |guarantee| guarantee.to_string())
    }

    fn json(&self) -> serde_json::Value {
        let tools: Vec<_> =
            self.tools.iter().map(|(number, tool)| json!({ "number": number, "name": tool.name })).collect();
        let worst = self.report.worst().first().copied().map(listed::brief);
        json!({
            "toolpath": self.arguments.toolpath.display().to_string(), "frame": self.frame, "transform": self.record.transform, "part": self.record.part, "tools": tools,
            "unit": self.record.unit, "pitch": self.record.grid.pitch, "conservative": self.record.conservative,
            "passes": !self.fails(), "collides": !self.report.colliding.is_empty(), "machine": self.machine.map(|bodies| &bodies.machine().name),
            "lines_that_collide": self.report.colliding.len(), "collisions": listed::collisions(&self.report), "worst": worst,
            "travel_faults": self.report.out_of_travel.len(),
            "report": self.listed, "guarantee": self.guarantee(), "stick_outs": self.stick_outs, "stick_outs_among": ["part", "fixtures"],
            "remarks": self.toolpath.remarks, "unchecked_lines": self.toolpath.unchecked,
            "stock": self.stock.as_ref().map(|stock| stock.json(&self.report)),
        })
    }
}
