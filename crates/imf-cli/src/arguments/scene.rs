//! From arguments to a scene: part, fixtures, unit, set-up, grid and tool, checked in one step.

use anyhow::{Result, bail};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DMat4;
use imf_core::grid::Grid;
use imf_core::mesh::topology::MeshReport;
use imf_core::mesh::{Mesh, points_memory_estimate};
use imf_core::scene::{Bodies, GridExtent, Scene, SceneRecord, SceneSpec, SceneWarning};
use imf_core::section::{DEPTH_CAP, ElementPlans, Quantity, SectionPlan};
use imf_core::tool::Tool;
use imf_core::unit::LengthUnit;

use super::clearance::{ClearanceArguments, ContactArguments, clearance_text};
use super::fixture::{FixtureArgument, parse_fixture};
use super::inputs::{SceneInputs, mesh_memory_estimate, triangles};
use super::numbers::{number, three};
use super::transform::parse_transform;
use crate::output::{short, show_measure};
use crate::session::{Session, show_bytes};

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
    pub unit: Option<LengthUnit>,
    /// Multiplies the part's coordinates, before the set-up: 25.4 for a file in inch that is to be in mm
    #[arg(help_heading = HEADING, long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_scale)]
    pub scale: f64,
    /// Edge of a voxel in the part's unit; by default it follows from tool and part, and is printed with the reason
    #[arg(help_heading = HEADING, long, value_name = "LENGTH", conflicts_with = "dims", value_parser = parse_pitch)]
    pub pitch: Option<f64>,
    /// Voxels along x, y and z, the part fitted between them; built-in parts have their own by default
    #[arg(help_heading = HEADING, long, value_name = "NX,NY,NZ", value_parser = parse_dims)]
    pub dims: Option<[usize; 3]>,
    /// Empty voxels on each side of the part
    #[arg(help_heading = HEADING, long, default_value_t = 0, value_name = "VOXELS")]
    pub margin: usize,
    /// Set-up of the part, steps applied in order: 'rotate:X,Y,Z:ANGLE; translate:X,Y,Z; matrix:…' (12 or 16 numbers, by
    /// rows, that turn, move and scale alike in all directions)
    #[arg(help_heading = HEADING, long, value_name = "STEPS", value_parser = parse_transform)]
    pub transform: Option<DMat4>,
    /// Every voxel that the surface touches is solid, not only those whose centre is inside
    #[arg(help_heading = HEADING, long)]
    pub conservative: bool,
    /// Go on with a tool that is thinner than √2 voxels and passes between their centres, where that is refused
    #[arg(help_heading = HEADING, long)]
    pub allow_coarse: bool,
    /// A tool file (TOML), a tool of FreeCAD (.fctb) or of Fusion (LIBRARY.json#NAME or #NUMBER), or paper, the built-in
    /// ball-end mill, which built-in parts have by default; imf access takes --tool several times, imf check too as NUMBER=TOOL
    #[arg(help_heading = HEADING, long, value_name = "TOOL")]
    pub tool: Vec<String>,
    /// What holds the part: an OBJ, STL, PLY or 3MF file in the part's unit (3MF: in its own), with its set-up after an @, which may
    /// name another unit (vise.stl@unit:inch); may be repeated
    #[arg(help_heading = HEADING, long, value_name = "FILE[@STEPS]", value_parser = parse_fixture)]
    pub fixture: Vec<FixtureArgument>,
    /// What the grid is chosen around: the part (and the margin), or part and fixtures
    #[arg(help_heading = HEADING, long, default_value = "part", value_parser = around())]
    pub around: GridExtent,
    /// Room that the tool must keep.
    #[command(flatten)]
    pub clearance: ClearanceArguments,
}

fn around() -> impl TypedValueParser<Value = GridExtent> {
    PossibleValuesParser::new(["part", "all"])
        .map(|name| if name == "all" { GridExtent::All } else { GridExtent::Part })
}

fn parse_pitch(text: &str) -> Result<f64, String> {
    if text.contains(',') {
        return Err(
            "one length: voxels are cubes, because a tool that turns would change its shape on a grid with \
                    other pitches along x, y and z; give the finest of them"
                .into(),
        );
    }
    number(text, |&pitch| pitch > 0.0 && pitch < f64::INFINITY, "a positive length such as 0.5")
}

fn parse_scale(text: &str) -> Result<f64, String> {
    number(text, |&scale| scale > 0.0 && scale < f64::INFINITY, "a factor above 0, such as 25.4")
}

fn parse_dims(text: &str) -> Result<[usize; 3], String> {
    three(text, |_| true, "three whole numbers such as 58,76,121")
}

/// Meshes by the names of their bodies.
pub(crate) type NamedMeshes = Vec<(String, Mesh)>;

impl SceneArguments {
    /// Reads part, fixtures and tool, checks them, estimates the memory, and voxelises, with the layer that the cutter
    /// may enter where it may enter one. Fixtures must lie within the grid: the scene is all that is kept. Remarks go to
    /// the session.
    pub fn scene_with(&self, session: &Session, contact: &ContactArguments) -> Result<Scene> {
        let inputs = self.read(session, true)?;
        let (scene, _) =
            self.with_spec(session, &inputs, |spec| self.for_sections(session, spec, contact, None))?;
        Ok(scene)
    }

    /// As [`Self::scene_with`] of what was read, for sections alone: fixtures may stick out of the scene's grid, and the bodies are all that
    /// the tool can meet from its voxels. `elements` keeps room for sections of every element too.
    pub(crate) fn scene_among(
        &self,
        session: &Session,
        inputs: &SceneInputs,
        contact: &ContactArguments,
        elements: bool,
        quantity: Quantity,
    ) -> Result<(Scene, Bodies)> {
        self.with_spec(session, inputs, |spec| {
            self.for_sections(session, spec, contact, Some((elements, quantity)))
        })
    }

    /// The scene and its bodies with room for sections; `among` of a scene out of whose grid fixtures may stick.
    fn for_sections(
        &self,
        session: &Session,
        spec: &SceneSpec<'_>,
        contact: &ContactArguments,
        among: Option<(bool, Quantity)>,
    ) -> Result<(Scene, Bodies)> {
        let grid = spec.grid()?;
        let clearance = self.clearance.at(grid.pitch, spec.tool);
        let tool = spec.tool.in_unit(spec.unit).with_clearance(&clearance)?;
        let depth = contact.depth([spec.tool])?;
        // Depths know poses around the grid as well.
        let is_depth = among.is_some_and(|(_, quantity)| !quantity.is_overlap());
        let around = if is_depth { DEPTH_CAP as i64 } else { 0 };
        let reach = tool.reach_from_sharp_points(grid.pitch) + around as f64 * grid.pitch;
        let wide = if among.is_some() { spec.wide_grid(&grid, reach)? } else { grid };
        let query = grid.padded([around; 3], [around; 3])?;
        let elements = among.is_some_and(|(elements, _)| elements);
        require_memory_for_sections(session, spec, (&wide, &query), &tool, depth.is_some(), elements)?;
        let make = |spec: &SceneSpec<'_>| match among {
            Some(_) => spec.scene_and_bodies(reach),
            None => spec.scene_alone(),
        };
        if among.is_some() {
            warn_of_fixtures_out_of_reach(session, spec, &wide)?;
        }
        let (scene, bodies) = voxelise_with_progress(session, spec, &wide, make)?;
        let scene = self.announce(session, spec, scene, &bodies)?;
        Ok(match depth {
            Some(depth) => (scene.with_contact(&bodies, depth), bodies),
            None => (scene, bodies),
        })
    }

    /// Part and fixtures on the grid, the mesh's report, and the unit: no tool is needed.
    pub(crate) fn voxels(&self, session: &Session) -> Result<(Bodies, MeshReport, LengthUnit, String)> {
        let inputs = self.read(session, false)?;
        let bodies = self.with_spec(session, &inputs, |spec| {
            let grid = spec.grid()?;
            require_memory_for_voxels(session, spec, &grid, (0, 0))?;
            let bodies = voxelise_with_progress(session, spec, &grid, |spec| spec.bodies_within(&grid))?;
            warn_of(session, &spec.warnings(&bodies)?);
            Ok(bodies)
        })?;
        Ok((bodies, inputs.report, inputs.part.unit, inputs.part.name))
    }

    /// The scene as [`Self::scene_with`] makes it, with no room kept for sections and without contact, and part and fixtures apart on a
    /// grid that holds them all, with their meshes in the world by name, the part's first. Other tools are checked as the scene's is.
    pub(crate) fn scene_and_bodies<'a>(
        &self,
        session: &Session,
        others: impl IntoIterator<Item = &'a Tool>,
    ) -> Result<(Scene, Bodies, NamedMeshes)> {
        self.with_spec(session, &self.read(session, true)?, |spec| {
            let wide = spec.wide_grid(&spec.grid()?, f64::INFINITY)?;
            // Beside the voxels, counts and distances of the part and of the fixtures, and points of their surfaces.
            let placed = spec.placed();
            let points = placed.iter().map(|mesh| points_memory_estimate(mesh, wide.pitch)).sum();
            let bytes = if spec.conservative { 32 } else { 16 };
            require_memory_for_voxels(session, spec, &wide, (bytes, points))?;
            let (scene, bodies) =
                voxelise_with_progress(session, spec, &wide, |spec| spec.scene_and_bodies(f64::INFINITY))?;
            let fixtures = bodies.fixtures.iter().map(|(name, _)| name.clone());
            let meshes = std::iter::once(spec.part.to_owned()).chain(fixtures).zip(placed).collect();
            let scene = self.announce(session, spec, scene, &bodies)?;
            for tool in others {
                let clearance = self.clearance.at(scene.record.grid.pitch, tool);
                warn_of(session, &spec.assembly(tool, &clearance, &scene.record.grid)?.1);
            }
            Ok((scene, bodies, meshes))
        })
    }

    /// The same scene on a grid of `scale` times as many voxels along each axis.
    pub fn scaled(&self, session: &Session, scale: f64) -> Result<Self> {
        if scale == 1.0 {
            return Ok(self.clone());
        }
        let grid = self.with_spec(session, &self.read(session, true)?, |spec| Ok(spec.grid()?))?;
        let margin = (self.margin as f64 * scale).ceil() as usize;
        Ok(Self { pitch: Some(grid.pitch / scale), dims: None, margin, ..self.clone() })
    }

    /// Makes something of what a scene of the one tool, or of none, is made from.
    fn with_spec<T>(
        &self,
        session: &Session,
        inputs: &SceneInputs,
        make: impl FnOnce(&SceneSpec<'_>) -> Result<T>,
    ) -> Result<T> {
        let unused = Tool::paper();
        let tool = match inputs.tools.as_slice() {
            [tool] => tool,
            [] => &unused,
            _ => bail!(
                "one --tool at a time: imf access takes several, each behind a --tool of its own, and imf check several by their numbers"
            ),
        };
        make(&self.spec(session, inputs, &inputs.fixtures(), tool))
    }

    /// Offsets the tool and describes the scene.
    fn announce(
        &self,
        session: &Session,
        spec: &SceneSpec<'_>,
        scene: Scene,
        bodies: &Bodies,
    ) -> Result<Scene> {
        let clearance = self.clearance.at(scene.record.grid.pitch, spec.tool);
        warn_of(session, &spec.assembly(spec.tool, &clearance, &scene.record.grid)?.1);
        warn_of(session, &spec.warnings(bodies)?);
        let scene = scene.with_clearance(&clearance)?;
        let SceneRecord { part, unit, grid, tool, .. } = &scene.record;
        let [x, y, z] = grid.dims;
        let clearance = clearance_text(&clearance, unit);
        session.note(&format!(
            "{part}: {x}×{y}×{z} voxels of {} {unit}, {} solid; tool {}{}; {}",
            short(grid.pitch),
            scene.obstacle.count(),
            tool.name,
            clearance.map_or_else(String::new, |clearance| format!(" offset by a clearance ({clearance})")),
            if self.conservative {
                "every voxel that the surface touches is solid"
            } else {
                "solid by voxel centres: exact for the voxels, not for the mesh (see --conservative)"
            }
        ));
        Ok(scene)
    }
}

/// Says what should be known of a scene.
pub(crate) fn warn_of(session: &Session, warnings: &[SceneWarning]) {
    warnings.iter().for_each(|warning| session.warn(&warning.to_string()));
}

/// Voxelises with progress where it takes its time; `grid` is the largest that there will be.
pub(crate) fn voxelise_with_progress<T, E: Into<anyhow::Error>>(
    session: &Session,
    spec: &SceneSpec<'_>,
    grid: &Grid,
    make: impl FnOnce(&SceneSpec<'_>) -> Result<T, E>,
) -> Result<T> {
    let rows = grid.dims[0] * grid.dims[1] * (1 + spec.fixtures.len());
    let stage = session.brief_stage("voxelising", "rows of voxels", rows as u64);
    let advance = |n| stage.advance(n);
    let made = make(&SceneSpec { control: session.control(&advance), ..spec.clone() }).map_err(Into::into)?;
    stage.finish("");
    Ok(made)
}

/// Warns of empty voxels that are closed off on all sides, of this volume.
pub(crate) fn warn_of_cavities(session: &Session, volume: f64, pitch: f64, unit: LengthUnit) {
    if volume > 0.0 {
        session.warn(&format!(
            "part and fixtures close off cavities of {} {unit}³, by voxels of {} {unit}: no tool gets in",
            show_measure(volume),
            short(pitch)
        ));
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
    spec: &SceneSpec<'_>,
    (obstacle, query): (&Grid, &Grid),
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
    needed += mesh_memory_estimate(spec);
    session.require_memory(needed, || {
        let [x, y, z] = query.dims;
        format!(
            "sections of {x}×{y}×{z} voxels with a tool that reaches {:.0} voxels, on {threads} threads, of meshes of {} \
             triangles; use a larger --pitch, fewer --threads or a coarser mesh",
            tool.reach() / query.pitch,
            triangles(spec),
        )
    })?;
    session.detail(&format!("sections need about {}", show_bytes(needed)));
    Ok(())
}

/// Refuses grids whose voxels, and so many bytes more for each and in all, would take more memory than there is.
fn require_memory_for_voxels(
    session: &Session,
    spec: &SceneSpec<'_>,
    grid: &Grid,
    (more, in_all): (u64, u64),
) -> Result<()> {
    // The voxels of the part, of all fixtures and of both, the voxeliser's, and a copy to write; those of each fixture.
    let fixtures = (1 + more) * spec.fixture_voxels(grid)?;
    let needed = (6 + more) * grid.len() as u64 + fixtures + in_all + mesh_memory_estimate(spec);
    session.require_memory(needed, || {
        let [x, y, z] = grid.dims;
        let triangles = triangles(spec);
        format!(
            "{x}×{y}×{z} voxels around part and fixtures, of {triangles} triangles; check their units, or use a larger --pitch or a coarser \
             mesh"
        )
    })
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
