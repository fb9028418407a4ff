//! Part, fixtures and tools as they are read, before anything is voxelised, and the pitch that follows from them.

use std::path::Path;

use anyhow::{Context, Result, bail};
use glam::DMat4;
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::mesh::topology::MeshReport;
use imf_core::scene::{ChosenPitch, Fixture, Resolution, SceneError, SceneSpec, SceneWarning};
use imf_core::section::SectionPlan;
use imf_core::tool::Tool;
use imf_core::unit::{DisplayLength, ImplausibleProportion, unit_check};

use super::fixture::{FixtureMesh, Part};
use super::scene::{SceneArguments, warn_of};
use crate::exit::WrongArgument;
use crate::session::Session;

/// What a part's longest side is to the thickness of its thinnest tool, and to a fixture's longest side, that are plausible.
/// A part in inches or metres that is taken for one in millimetres is mostly shorter than two cutters are thick; a cutter of a
/// thousandth of the part would need a path of years; and a vise is some ten times as long as a small part.
const MIN_TO_TOOL: f64 = 2.0;
const MAX_TO_TOOL: f64 = 1000.0;
const MAX_TO_FIXTURE: f64 = 50.0;
/// Tools without a holder that are named one by one.
const MOST_NOTES: usize = 3;

/// Part, fixtures, tools and set-up as read and checked, before anything is voxelised.
pub(crate) struct SceneInputs {
    pub(crate) part: Part,
    pub(crate) report: MeshReport,
    pub(crate) tools: Vec<Tool>,
    pub(crate) transform: DMat4,
    fixtures: Vec<FixtureMesh>,
}

impl SceneInputs {
    /// The fixtures as a scene takes them.
    pub(crate) fn fixtures(&self) -> Vec<Fixture<'_>> {
        let fixtures = self.fixtures.iter().map(|FixtureMesh { body, transform }| Fixture {
            name: &body.name,
            mesh: &body.mesh,
            transform: *transform,
        });
        fixtures.collect()
    }
}

impl SceneArguments {
    /// Reads part, fixtures and tools and checks them; remarks go to the session. With `needs_tool` a tool is required where none is
    /// given and the part is not built in.
    pub(crate) fn read(&self, session: &Session, needs_tool: bool) -> Result<SceneInputs> {
        let tools = self.tool.iter().map(|tool| read_tool(tool)).collect::<Result<Vec<_>>>()?;
        self.read_with(session, tools, needs_tool)
    }

    /// As [`Self::read`], with tools that were read before.
    pub(crate) fn read_with(
        &self,
        session: &Session,
        mut tools: Vec<Tool>,
        needs_tool: bool,
    ) -> Result<SceneInputs> {
        let part = Part::read(&self.part, self.unit, None)?.scaled(self.scale);
        if part.reference.is_some() && self.unit.is_some_and(|unit| unit != part.unit) {
            let why = format!(
                "the built-in part {} is in {}: leave --unit out (--scale makes it larger)",
                part.name, part.unit
            );
            return Err(WrongArgument(why).into());
        }
        if tools.is_empty() && part.reference.is_some() {
            tools.push(Tool::paper());
        }
        tools.iter().try_for_each(Tool::check)?;
        if let Some(stated) = part.overruled {
            session.warn(&format!(
                "{} says that it is in {stated}; --unit {} overrules it",
                part.name, part.unit
            ));
        }
        let bare: Vec<_> = tools.iter().filter_map(SceneWarning::of_tool).collect();
        if bare.len() <= MOST_NOTES {
            bare.iter().for_each(|warning| session.note(&warning.to_string()));
        } else {
            let first = tools.iter().find(|tool| !tool.has_holder()).map_or("", |tool| &tool.name);
            let (bare, all) = (bare.len(), tools.len());
            session.note(&format!(
                "{bare} of {all} tools have no holder, such as {first}: what holds them is not seen"
            ));
        }
        let fixtures = self.fixture.iter().map(|fixture| FixtureMesh::read(fixture, part.unit));
        let fixtures: Vec<FixtureMesh> = fixtures.collect::<Result<_>>()?;
        let report = MeshReport::new(&part.mesh);
        if let Some(implausible) = unit_check(report.extents, part.unit) {
            bail!("{}: {implausible}", part.name);
        }
        if tools.is_empty() && needs_tool {
            return Err(SceneError::NoTool(part.name).into());
        }
        warn_of(session, &SceneWarning::of_repair(&part.name, &part.repair, report.triangles));
        for Part { name, mesh, repair, .. } in fixtures.iter().map(|fixture| &fixture.body) {
            warn_of(session, &SceneWarning::of_repair(name, repair, mesh.triangles.len()));
        }
        self.require_units(&part, &tools, &fixtures)?;
        let transform = self.transform.unwrap_or(DMat4::IDENTITY);
        Ok(SceneInputs { part, report, tools, transform, fixtures })
    }

    /// Refuses sizes that hardly belong together where a unit was assumed, which is the likely reason; not where it is known.
    fn require_units(&self, part: &Part, tools: &[Tool], fixtures: &[FixtureMesh]) -> Result<()> {
        let longest = |mesh: &Mesh| mesh.bounds().map_or(0.0, |(lower, upper)| (upper - lower).max_element());
        let (name, unit, part_long) = (&part.name, part.unit, longest(&part.mesh));
        let thickness = tools.iter().map(|tool| tool.in_unit(unit).thinnest().1);
        let plausible = |thickness: &f64| (MIN_TO_TOOL..=MAX_TO_TOOL).contains(&(part_long / thickness));
        // Of many tools some may be for other parts.
        let thinnest =
            thickness.clone().reduce(f64::min).filter(|_| !thickness.clone().any(|t| plausible(&t)));
        if let Some(thickness) = thinnest.filter(|_| !part.unit_is_known) {
            let proportion = ImplausibleProportion { longest: part_long, thickness, unit };
            bail!(
                "{name} does not say its unit, and was taken to be in {unit}: {proportion}; name its unit by --unit"
            );
        }
        for (given, fixture) in
            self.fixture.iter().zip(fixtures).filter(|(_, fixture)| !fixture.body.unit_is_known)
        {
            let long = longest(&fixture.body.mesh.transformed(&fixture.transform));
            if !(1.0 / MAX_TO_FIXTURE..=MAX_TO_FIXTURE).contains(&(long / part_long)) {
                bail!(
                    "the fixture {} does not say its unit, and was taken to be in {unit} as the part is: its longest side would be {} \
                     {unit} long, and that of the part {} {unit}; name its unit, as in --fixture {}@unit:inch",
                    fixture.body.name,
                    DisplayLength(long),
                    DisplayLength(part_long),
                    given.file
                );
            }
        }
        Ok(())
    }

    /// What a scene of one tool is made from; a pitch that is chosen follows from all of them, and is said.
    pub(crate) fn spec<'a>(
        &self,
        session: &Session,
        inputs: &'a SceneInputs,
        fixtures: &'a [Fixture<'a>],
        tool: &'a Tool,
    ) -> SceneSpec<'a> {
        let spec = SceneSpec {
            part: &inputs.part.name,
            mesh: &inputs.part.mesh,
            unit: inputs.part.unit,
            transform: inputs.transform,
            resolution: Resolution::Dims([1; 3]),
            margin: self.margin,
            conservative: self.conservative,
            allow_coarse: self.allow_coarse,
            tool,
            fixtures,
            around: self.around,
            control: session.control(&|_| {}),
        };
        let resolution = match (self.pitch, self.dims, inputs.part.reference) {
            (Some(pitch), ..) => Resolution::Pitch(pitch),
            (None, Some(dims), _) => Resolution::Dims(dims),
            (None, None, Some(reference)) => Resolution::Dims(reference.dims()),
            (None, None, None) => {
                let chosen = chosen(session, &spec, inputs);
                session.choose(&chosen.to_string());
                Resolution::Pitch(chosen.pitch)
            }
        };
        SceneSpec { resolution, ..spec }
    }
}

/// Bytes of a triangle with its share of the vertices, as read and placed, and of its edges while they are sorted: measured.
const TRIANGLE_BYTES: u64 = 180;

/// Bytes that the meshes of part and fixtures take.
pub(crate) fn mesh_memory_estimate(spec: &SceneSpec<'_>) -> u64 {
    TRIANGLE_BYTES * triangles(spec) as u64
}

/// Of part and fixtures.
pub(super) fn triangles(spec: &SceneSpec<'_>) -> usize {
    let fixtures = spec.fixtures.iter().map(|fixture| fixture.mesh.triangles.len());
    spec.mesh.triangles.len() + fixtures.sum::<usize>()
}

/// The pitch that follows from part and tools, within the memory.
fn chosen(session: &Session, spec: &SceneSpec<'_>, inputs: &SceneInputs) -> ChosenPitch {
    let tools: Vec<Tool> = inputs.tools.iter().map(|tool| tool.in_unit(spec.unit)).collect();
    let fits = |pitch: f64| {
        let grid = SceneSpec { resolution: Resolution::Pitch(pitch), ..spec.clone() }.grid();
        let needed = |grid: Grid| {
            let sections =
                tools.iter().map(|tool| SectionPlan::memory_estimate(&grid, tool, session.threads()));
            // Contact takes twice that, elements and results no more.
            4 * sections.max().unwrap_or_default() + 16 * grid.len() as u64 + mesh_memory_estimate(spec)
        };
        grid.is_ok_and(|grid| needed(grid) <= session.memory_limit)
    };
    // As the part is set up, which may scale it.
    let extents = spec.part_bounds().map_or(inputs.report.extents, |(lower, upper)| upper - lower);
    ChosenPitch::new(extents, spec.unit, &tools, &fits)
}

pub(crate) fn read_tool(text: &str) -> Result<Tool> {
    if text == "paper" && !Path::new(text).is_file() {
        return Ok(Tool::paper());
    }
    Tool::find(text).context("the tool cannot be used")
}
