//! From arguments to a scene: part, fixtures, unit, set-up, grid and tool, checked in one step.

use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use glam::{DMat4, DVec3};
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::mesh::read::{MeshFile, read_mesh_file};
use imf_core::mesh::topology::MeshReport;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Around, Bodies, Fixture, Resolution, Scene, SceneSpec, SceneWarning};
use imf_core::section::{ElementPlans, SectionPlan};
use imf_core::tool::Tool;
use imf_core::unit::{LengthUnit, unit_check};

use super::clearance::{ClearanceArguments, ContactArguments, clearance_text};
use super::fixture::FixtureMesh;
use super::transform::parse_transform;
use crate::session::{Session, show_bytes};

/// Voxels along the longest side where neither pitch nor dims are given.
const DEFAULT_LONGEST: f64 = 96.0;

/// Heading of these options.
const HEADING: &str = "Part, voxels and tool";

/// Which part, on which grid, against which tool.
#[derive(Args, Clone)]
pub struct SceneArguments {
    /// An OBJ, STL, PLY or 3MF file, or a built-in part: teapot, bracket, bracket-raw, screw-gear
    pub part: String,
    /// Unit of the part: mm, cm, m or inch; STL files need it, 3MF files state theirs, others are in mm by
    /// default
    #[arg(help_heading = HEADING, long, value_name = "UNIT")]
    pub unit: Option<String>,
    /// Edge of a voxel in the part's unit
    #[arg(help_heading = HEADING, long, value_name = "LENGTH", conflicts_with = "dims", value_parser = parse_pitch)]
    pub pitch: Option<f64>,
    /// Voxels along x, y and z, the part fitted between them; built-in parts have their own by default
    #[arg(help_heading = HEADING, long, value_name = "NX,NY,NZ", value_parser = parse_dims)]
    pub dims: Option<Dims>,
    /// Empty voxels on each side of the part
    #[arg(help_heading = HEADING, long, default_value_t = 0, value_name = "VOXELS")]
    pub margin: usize,
    /// Set-up of the part, steps applied in order: 'rotate:X,Y,Z:ANGLE; translate:X,Y,Z; matrix:…'
    #[arg(help_heading = HEADING, long, value_name = "STEPS")]
    pub transform: Option<String>,
    /// Every voxel that the surface touches is solid, not only those whose centre is inside
    #[arg(help_heading = HEADING, long)]
    pub conservative: bool,
    /// A tool file (TOML), a tool of FreeCAD (.fctb) or of Fusion (LIBRARY.json#NAME or #NUMBER), or paper, the built-in
    /// ball-end mill; imf access takes several
    #[arg(help_heading = HEADING, long, default_value = "paper", value_name = "TOOL")]
    pub tool: Vec<String>,
    /// What holds the part: an OBJ, STL, PLY or 3MF file in the part's unit (3MF: in its own), with its set-up after an @; may be repeated
    #[arg(help_heading = HEADING, long, value_name = "FILE[@STEPS]")]
    pub fixture: Vec<String>,
    /// What the grid is chosen around
    #[arg(help_heading = HEADING, long, value_enum, default_value = "part")]
    pub around: AroundKind,
    /// Room that the tool must keep.
    #[command(flatten)]
    pub clearance: ClearanceArguments,
}

/// What the grid is chosen around.
#[derive(Clone, Copy, ValueEnum)]
pub enum AroundKind {
    /// The part (and the margin)
    Part,
    /// Part and fixtures
    All,
}

/// Voxels along the three axes.
#[derive(Clone, Copy, Debug)]
pub struct Dims(pub(crate) [usize; 3]);

fn parse_pitch(text: &str) -> Result<f64, String> {
    if text.contains(',') {
        return Err(
            "one length: voxels are cubes, because a tool that turns would change its shape on a grid with \
                    other pitches along x, y and z; give the finest of them"
                .into(),
        );
    }
    match text.parse::<f64>() {
        Ok(pitch) if pitch.is_finite() && pitch > 0.0 => Ok(pitch),
        _ => Err("a positive length such as 0.5".into()),
    }
}

fn parse_dims(text: &str) -> Result<Dims, String> {
    let values: Vec<usize> = text.split(',').filter_map(|t| t.trim().parse().ok()).collect();
    match values.as_slice() {
        &[x, y, z] if text.split(',').count() == 3 => Ok(Dims([x, y, z])),
        _ => Err("three whole numbers such as 58,76,121".into()),
    }
}

/// A part as read, before it is voxelised.
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    pub(crate) unit: LengthUnit,
    pub(crate) reference: Option<ReferencePart>,
    /// True where the unit is neither given nor assumed, but the file's own.
    pub(crate) unit_is_its_own: bool,
    /// The file's own unit, where another one was given.
    pub(crate) overruled: Option<LengthUnit>,
}

impl Part {
    /// Reads a file or makes a built-in part. A file of that name wins over a built-in part, a folder does not.
    pub(crate) fn read(part: &str, unit: Option<&str>) -> Result<Self> {
        let given = unit.map(LengthUnit::from_str).transpose()?;
        let path = Path::new(part);
        if !path.is_file()
            && let Ok(reference) = ReferencePart::from_str(part)
        {
            let unit = LengthUnit::Mm;
            return Ok(Self {
                name: reference.name().into(),
                mesh: reference.mesh(),
                unit,
                reference: Some(reference),
                unit_is_its_own: true,
                overruled: None,
            });
        }
        let is_stl = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"));
        if is_stl && given.is_none() && path.exists() {
            bail!("{part}: an STL file does not say its unit; add --unit mm (or cm, m, inch)");
        }
        let MeshFile { mesh, unit: stated } = read_mesh_file(path)?;
        let name = path.file_name().map_or_else(|| part.to_owned(), |n| n.to_string_lossy().into_owned());
        Ok(Self {
            name,
            mesh,
            unit: given.or(stated).unwrap_or_default(),
            reference: None,
            unit_is_its_own: given.is_none() && stated.is_some(),
            overruled: stated.filter(|stated| given.is_some_and(|given| given != *stated)),
        })
    }

    /// What stands around a part in `unit`: scaled where its own unit is known to be another.
    pub(crate) fn around_part_in(mut self, unit: LengthUnit) -> Self {
        if self.unit_is_its_own && self.unit != unit {
            let factor = self.unit.in_mm() / unit.in_mm();
            self.mesh = self.mesh.transformed(&DMat4::from_scale(DVec3::splat(factor)));
            self.unit = unit;
        }
        self
    }
}

/// Part, fixtures, tools and set-up as read and checked, before anything is voxelised.
pub(crate) struct Reading {
    pub(crate) part: Part,
    pub(crate) report: MeshReport,
    pub(crate) tools: Vec<Tool>,
    pub(crate) transform: DMat4,
    fixtures: Vec<FixtureMesh>,
}

impl Reading {
    /// The tool, where the command takes one.
    fn only_tool(&self) -> Result<&Tool> {
        match self.tools.as_slice() {
            [tool] => Ok(tool),
            _ => bail!("one --tool at a time (imf access takes several)"),
        }
    }

    /// The fixtures as a scene takes them.
    pub(crate) fn fixtures(&self) -> Vec<Fixture<'_>> {
        self.fixtures.iter().map(FixtureMesh::as_fixture).collect()
    }
}

impl SceneArguments {
    /// Reads part, fixtures and tool, checks them, estimates the memory, and voxelises, with the layer that the cutter
    /// may enter where it may enter one. Fixtures must lie within the grid: the scene is all that is kept. Remarks go to
    /// the session.
    pub fn scene_with(&self, session: &Session, contact: &ContactArguments) -> Result<Scene> {
        let reading = self.read(session)?;
        let tool = reading.only_tool()?;
        let fixtures = reading.fixtures();
        let spec = self.spec(&reading, &fixtures, tool);
        let grid = spec.grid()?;
        let depth = contact.depth([tool])?;
        let tool_here = tool.in_unit(reading.part.unit).inflated(&self.clearance.clearance())?;
        require_memory_for_sections(session, &grid, &grid, &tool_here, depth.is_some(), false)?;
        let scene = self.announced(session, spec.scene()?)?;
        Ok(match depth {
            Some(depth) => scene.with_contact(&spec.bodies(&grid)?, depth),
            None => scene,
        })
    }

    /// As [`Self::scene_with`] for sections alone: fixtures may stick out of the scene's grid, and the bodies are all that
    /// the tool can meet from its voxels. `elements` keeps room for sections of every element too.
    pub(crate) fn scene_among(
        &self,
        session: &Session,
        contact: &ContactArguments,
        elements: bool,
    ) -> Result<(Scene, Bodies)> {
        let reading = self.read(session)?;
        let tool = reading.only_tool()?;
        let fixtures = reading.fixtures();
        let spec = self.spec(&reading, &fixtures, tool);
        let grid = spec.grid()?;
        let depth = contact.depth([tool])?;
        let tool_here = tool.in_unit(reading.part.unit).inflated(&self.clearance.clearance())?;
        let reach = tool_here.reach_from_sharp_points(grid.pitch);
        let wide = spec.wide_grid(&grid, reach)?;
        require_memory_for_sections(session, &wide, &grid, &tool_here, depth.is_some(), elements)?;
        warn_of_fixtures_out_of_reach(session, &spec, &wide)?;
        let (scene, bodies) = spec.scene_and_bodies(reach)?;
        let scene = self.announced(session, scene)?;
        Ok(match depth {
            Some(depth) => (scene.with_contact(&bodies, depth), bodies),
            None => (scene, bodies),
        })
    }

    /// A scene that is read and voxelised, with no room kept for sections: the tool is only written down. Also gives what
    /// is known of the mesh.
    pub(crate) fn scene_without_sections(&self, session: &Session) -> Result<(Scene, MeshReport)> {
        let reading = self.read(session)?;
        let fixtures = reading.fixtures();
        let spec = self.spec(&reading, &fixtures, reading.only_tool()?);
        require_memory_for_voxels(session, &spec.grid()?)?;
        Ok((self.announced(session, spec.scene()?)?, reading.report))
    }

    /// The scene as [`Self::scene_without_sections`] makes it, and part and fixtures apart on a grid that holds them all.
    pub(crate) fn scene_and_bodies(&self, session: &Session) -> Result<(Scene, Bodies)> {
        let reading = self.read(session)?;
        let fixtures = reading.fixtures();
        let spec = self.spec(&reading, &fixtures, reading.only_tool()?);
        require_memory_for_voxels(session, &spec.wide_grid(&spec.grid()?, f64::INFINITY)?)?;
        let (scene, bodies) = spec.scene_and_bodies(f64::INFINITY)?;
        Ok((self.announced(session, scene)?, bodies))
    }

    /// The same scene on a grid of `scale` times as many voxels along each axis.
    pub fn scaled(&self, session: &Session, scale: f64) -> Result<Self> {
        if scale == 1.0 {
            return Ok(self.clone());
        }
        let reading = self.read(session)?;
        let fixtures = reading.fixtures();
        let grid = self.spec(&reading, &fixtures, reading.only_tool()?).grid()?;
        let margin = (self.margin as f64 * scale).ceil() as usize;
        Ok(Self { pitch: Some(grid.pitch / scale), dims: None, margin, ..self.clone() })
    }

    /// Grows the tool and says what the scene is.
    fn announced(&self, session: &Session, scene: Scene) -> Result<Scene> {
        let clearance = self.clearance.clearance();
        let scene = scene.with_clearance(&clearance)?;
        let grid = scene.record.grid;
        let [x, y, z] = grid.dims;
        let grown = clearance_text(&clearance, scene.record.unit);
        session.note(&format!(
            "{}: {x}×{y}×{z} voxels of {:.4} {}, {} solid; tool {}{}; {}",
            scene.record.part,
            grid.pitch,
            scene.record.unit,
            scene.obstacle.count(),
            scene.record.tool.name,
            grown.map_or_else(String::new, |grown| format!(" grown by a clearance ({grown})")),
            if self.conservative {
                "every voxel that the surface touches is solid"
            } else {
                "solid by voxel centres: exact for the voxels, not for the mesh (see --conservative)"
            }
        ));
        Ok(scene)
    }

    /// Reads part, fixtures and tools and checks them; remarks go to the session.
    pub(crate) fn read(&self, session: &Session) -> Result<Reading> {
        let part = Part::read(&self.part, self.unit.as_deref())?;
        let tools = self.tool.iter().map(|tool| read_tool(tool)).collect::<Result<Vec<_>>>()?;
        tools.iter().try_for_each(Tool::check)?;
        let transform = self.transform.as_deref().map_or(Ok(DMat4::IDENTITY), parse_transform)?;
        if let Some(stated) = part.overruled {
            session.warn(&format!(
                "{} says that it is in {stated}; --unit {} overrules it",
                part.name, part.unit
            ));
        }
        for warning in tools.iter().filter_map(SceneWarning::of_tool) {
            session.note(&warning.to_string());
        }
        let given = self.unit.as_deref();
        let fixtures = self.fixture.iter().map(|text| FixtureMesh::read(text, given, part.unit));
        let fixtures = fixtures.collect::<Result<_>>()?;
        let report = MeshReport::new(&part.mesh);
        if let Some(implausible) = unit_check(report.extents, part.unit) {
            bail!("{}: {implausible}", part.name);
        }
        if part.reference.is_none() {
            SceneWarning::of_mesh(&part.name, &report)
                .iter()
                .for_each(|warning| session.warn(&warning.to_string()));
        }
        Ok(Reading { part, report, tools, transform, fixtures })
    }

    /// What a scene of one tool is made from.
    pub(crate) fn spec<'a>(
        &self,
        reading: &'a Reading,
        fixtures: &'a [Fixture<'a>],
        tool: &'a Tool,
    ) -> SceneSpec<'a> {
        SceneSpec {
            part: &reading.part.name,
            mesh: &reading.part.mesh,
            unit: reading.part.unit,
            transform: reading.transform,
            resolution: self.resolution(&reading.part, &reading.report),
            margin: self.margin,
            conservative: self.conservative,
            tool,
            fixtures,
            around: match self.around {
                AroundKind::Part => Around::Part,
                AroundKind::All => Around::All,
            },
        }
    }

    fn resolution(&self, part: &Part, report: &MeshReport) -> Resolution {
        match (self.pitch, self.dims, part.reference) {
            (Some(pitch), _, _) => Resolution::Pitch(pitch),
            (None, Some(Dims(dims)), _) => Resolution::Dims(dims),
            (None, None, Some(reference)) => Resolution::Dims(reference.dims()),
            (None, None, None) => Resolution::Pitch(report.extents.max_element() / DEFAULT_LONGEST),
        }
    }
}

/// A fixture that nothing can touch changes no result, and was hardly meant to stand where it does.
pub(crate) fn warn_of_fixtures_out_of_reach(
    session: &Session,
    spec: &SceneSpec<'_>,
    wide: &Grid,
) -> Result<()> {
    for name in spec.fixtures_out_of(wide)? {
        session.warn(&format!(
            "the fixture {name} is beyond the tool's reach from every voxel of the grid: it changes nothing; check \
             where it stands (FILE@STEPS) and its unit"
        ));
    }
    Ok(())
}

/// Refuses sections over `query` that would take more memory than there is; `elements` asks for those of every element
/// too.
fn require_memory_for_sections(
    session: &Session,
    obstacle: &Grid,
    query: &Grid,
    tool: &Tool,
    contact: bool,
    elements: bool,
) -> Result<()> {
    let threads = session.threads();
    let mut needed = SectionPlan::memory_estimate_with_query(obstacle, query, tool, threads);
    if contact {
        // A second section is added, of shank and holder, and part and layer are kept apart.
        needed = 2 * (needed + obstacle.len() as u64);
    }
    if elements {
        needed += ElementPlans::memory_estimate(obstacle, query, tool, threads);
    }
    session.require_memory(needed, || {
        let [x, y, z] = query.dims;
        format!(
            "sections of {x}×{y}×{z} voxels with a tool that reaches {:.0} voxels, on {threads} threads; use a larger \
             --pitch or fewer --threads",
            tool.reach() / query.pitch,
        )
    })?;
    session.detail(&format!("sections need about {}", show_bytes(needed)));
    Ok(())
}

/// Refuses grids whose voxels would take more memory than there is.
fn require_memory_for_voxels(session: &Session, grid: &Grid) -> Result<()> {
    // The voxels of part, fixtures and both, the voxeliser's, and a copy to write.
    session.require_memory(6 * grid.len() as u64, || {
        let [x, y, z] = grid.dims;
        format!("{x}×{y}×{z} voxels; use a larger --pitch")
    })
}

fn read_tool(text: &str) -> Result<Tool> {
    if text == "paper" && !Path::new(text).exists() {
        return Ok(Tool::paper());
    }
    Tool::find(text).with_context(|| format!("the tool {text} cannot be used"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pitch_is_one_length_and_the_reason_is_said() {
        assert_eq!(parse_pitch("0.5"), Ok(0.5));
        let refusal = parse_pitch("1,1,2").unwrap_err();
        assert!(refusal.contains("cubes") && refusal.contains("finest"), "{refusal}");
        assert!(parse_pitch("-1").is_err() && parse_pitch("NaN").is_err());
    }
}
