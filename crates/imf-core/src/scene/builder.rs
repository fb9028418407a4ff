//! A builder of scenes, which returns its warnings as values.

use std::path::Path;

use glam::DMat4;

use super::{
    Bodies, ChosenPitch, Fixture, GridExtent, Resolution, Scene, SceneError, SceneSpec, SceneWarning,
};
use crate::control::Control;
use crate::mesh::Mesh;
use crate::mesh::read::{MeshFile, read_mesh_file};
use crate::mesh::topology::MeshReport;
use crate::parts::ReferencePart;
use crate::tool::{Clearance, Tool};
use crate::unit::{LengthUnit, unit_check};

/// A scene, what it was made of, and its warnings.
#[derive(Clone, Debug)]
pub struct BuiltScene {
    /// The scene.
    pub scene: Scene,
    /// The part's mesh in its own coordinates, its triangles facing consistently.
    pub mesh: Mesh,
    /// Name, such a mesh and place of every fixture.
    pub fixtures: Vec<(String, Mesh, DMat4)>,
    /// Part and fixtures apart, on the scene's grid.
    #[doc(hidden)]
    pub bodies: Bodies,
    /// Warnings; the scene can be used all the same.
    pub warnings: Vec<SceneWarning>,
    /// Fraction of the voxel centres in or near the part that its mesh leaves undecided (inside or outside)
    /// ([`VoxelizeResult::undecided`](crate::voxelize::VoxelizeResult)); 0 for a closed mesh.
    pub undecided: f64,
    /// The pitch that was chosen where neither pitch nor dims were given, and why.
    pub chosen_pitch: Option<ChosenPitch>,
}

struct Part {
    name: String,
    mesh: Mesh,
    unit: LengthUnit,
    reference: Option<ReferencePart>,
}

/// Part, tool, grid and set-up of a [`Scene`], made by [`Scene::builder`]. Lengths are in the part's unit.
///
/// # Example
/// ```
/// use imf_core::parts::ReferencePart;
/// use imf_core::scene::Scene;
///
/// let built = Scene::builder().reference(ReferencePart::Bracket).dims([12, 36, 22]).build()?;
/// // Its walls are two voxels thick here, which is said.
/// assert!(built.warnings.iter().all(|warning| warning.to_string().contains("thick")));
/// assert!(built.scene.obstacle.count() > 0);
/// # Ok::<(), imf_core::scene::SceneError>(())
/// ```
#[must_use]
pub struct SceneBuilder<'a> {
    part: Result<Part, SceneError>,
    transform: DMat4,
    resolution: Option<Resolution>,
    margin: usize,
    conservative: bool,
    allow_coarse: bool,
    tool: Option<Tool>,
    clearance: Clearance,
    contact: Option<f64>,
    fixtures: Vec<(String, Mesh, DMat4)>,
    around: GridExtent,
    control: Control<'a>,
}

impl Scene {
    /// A scene of a part, by default alone, as it lies, at a pitch that follows from tool and part; a built-in part on its own
    /// dims, against the paper's tool.
    pub fn builder() -> SceneBuilder<'static> {
        SceneBuilder {
            part: Err(SceneError::NoPart),
            transform: DMat4::IDENTITY,
            resolution: None,
            margin: 0,
            conservative: false,
            allow_coarse: false,
            tool: None,
            clearance: Clearance::default(),
            contact: None,
            fixtures: Vec::new(),
            around: GridExtent::Part,
            control: Control::quiet(),
        }
    }
}

impl<'a> SceneBuilder<'a> {
    /// A part by its mesh.
    pub fn part(self, name: &str, mesh: Mesh, unit: LengthUnit) -> Self {
        Self { part: Ok(Part { name: name.to_owned(), mesh, unit, reference: None }), ..self }
    }

    /// A part from a file ([`read_mesh_file`]); `unit` is that of files which state none. Where the file states another, pitch, clearance
    /// and all other lengths are in that: see [`SceneRecord::unit`](super::SceneRecord::unit).
    pub fn part_file(self, path: impl AsRef<Path>, unit: LengthUnit) -> Self {
        let path = path.as_ref();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match read_mesh_file(path) {
            Ok(MeshFile { mesh, unit: stated }) => self.part(&name, mesh, stated.unwrap_or(unit)),
            Err(error) => Self { part: Err(error.into()), ..self },
        }
    }

    /// A built-in part, on its own dims where none are given.
    pub fn reference(self, part: ReferencePart) -> Self {
        let (name, mesh) = (part.name().to_owned(), part.mesh());
        Self { part: Ok(Part { name, mesh, unit: LengthUnit::Mm, reference: Some(part) }), ..self }
    }

    /// Set-up of the part: where its own coordinates stand in the world.
    pub fn transform(self, transform: DMat4) -> Self {
        Self { transform, ..self }
    }

    /// The edge of a voxel.
    pub fn pitch(self, pitch: f64) -> Self {
        Self { resolution: Some(Resolution::Pitch(pitch)), ..self }
    }

    /// Voxels along x, y and z.
    pub fn dims(self, dims: [usize; 3]) -> Self {
        Self { resolution: Some(Resolution::Dims(dims)), ..self }
    }

    /// Empty voxels on each side.
    pub fn margin(self, margin: usize) -> Self {
        Self { margin, ..self }
    }

    /// Whether every voxel that the surface touches is solid, or those alone whose centre is inside.
    pub fn conservative(self, conservative: bool) -> Self {
        Self { conservative, ..self }
    }

    /// The tool, in any unit; every part but a built-in one needs one.
    pub fn tool(self, tool: &Tool) -> Self {
        Self { tool: Some(tool.clone()), ..self }
    }

    /// Whether a tool that passes between the voxels' centres is a warning, not an error.
    pub fn allow_coarse(self, allow_coarse: bool) -> Self {
        Self { allow_coarse, ..self }
    }

    /// Receives progress, one unit a row of voxels, and may cancel.
    pub fn control<'b>(self, control: Control<'b>) -> SceneBuilder<'b>
    where
        'a: 'b,
    {
        SceneBuilder { control, ..self }
    }

    /// The tool's clearance, in the part's unit.
    pub fn clearance(self, clearance: Clearance) -> Self {
        Self { clearance, ..self }
    }

    /// How deep below the part's surface the cutter may reach: it may hold voxels whose centres lie no deeper, but for those in the
    /// middle of a wall of even thickness. Below half a pitch that is none.
    pub fn contact(self, depth: f64) -> Self {
        Self { contact: Some(depth), ..self }
    }

    /// What holds the part, in the part's unit; may be called again.
    pub fn fixture(mut self, name: &str, mesh: Mesh, transform: DMat4) -> Self {
        self.fixtures.push((name.to_owned(), mesh, transform));
        self
    }

    /// What the grid is chosen around.
    pub fn around(self, around: GridExtent) -> Self {
        Self { around, ..self }
    }

    /// Makes the triangles of part and fixtures face consistently, and voxelises.
    ///
    /// # Errors
    /// No part, or one that cannot be read, is of an implausible size, or of which no voxel is left; a mesh whose triangles name no
    /// vertices; a depth of contact that is not a length, or of a tool without a cutter; no tool, or one that is too
    /// thin for the grid; a mesh that does not say what is inside; a grid that cannot be made; a fixture that
    /// sticks out of it; a clearance that is not a length; [`SceneError::Cancelled`].
    pub fn build(self) -> Result<BuiltScene, SceneError> {
        let Part { name, mesh, unit, reference } = self.part?;
        let tool = self.tool.or_else(|| reference.map(|_| Tool::paper()));
        let tool = tool.ok_or_else(|| SceneError::NoTool(name.clone()))?;
        match self.contact {
            Some(depth) if !(depth.is_finite() && depth >= 0.0) => return Err(SceneError::Contact(depth)),
            Some(_) if !tool.has_cutter() => return Err(SceneError::NoCutter(tool.name)),
            _ => {}
        }
        for (name, mesh) in self.fixtures.iter().map(|(name, mesh, _)| (name, mesh)).chain([(&name, &mesh)]) {
            if !mesh.is_sound() {
                return Err(SceneError::Unsound(name.clone()));
            }
        }
        if mesh.triangles.is_empty() {
            return Err(SceneError::NoTriangles(name));
        }
        let mut warnings = Vec::new();
        let (mesh, repair) = mesh.with_consistent_faces();
        let report = MeshReport::new(&mesh);
        if let Some(size) = unit_check(report.extents, unit) {
            return Err(SceneError::Size { part: name, size });
        }
        if reference.is_none() {
            warnings.extend(SceneWarning::of_repair(&name, &repair, report.triangles));
        }
        warnings.extend(SceneWarning::of_tool(&tool));
        let mut fixtures = Vec::new();
        for (name, mesh, transform) in self.fixtures {
            let (mesh, repair) = mesh.with_consistent_faces();
            warnings.extend(SceneWarning::of_repair(&name, &repair, mesh.triangles.len()));
            fixtures.push((name, mesh, transform));
        }
        let held: Vec<Fixture<'_>> = fixtures
            .iter()
            .map(|(name, mesh, transform)| Fixture { name, mesh, transform: *transform })
            .collect();
        let (resolution, chosen_pitch) = match (self.resolution, reference) {
            (Some(resolution), _) => (resolution, None),
            (None, Some(reference)) => (Resolution::Dims(reference.dims()), None),
            (None, None) => {
                let chosen = ChosenPitch::new(report.extents, unit, &[tool.in_unit(unit)], &|_| true);
                (Resolution::Pitch(chosen.pitch), Some(chosen))
            }
        };
        let spec = SceneSpec {
            part: &name,
            mesh: &mesh,
            unit,
            transform: self.transform,
            resolution,
            margin: self.margin,
            conservative: self.conservative,
            allow_coarse: self.allow_coarse,
            tool: &tool,
            fixtures: &held,
            around: self.around,
            control: self.control,
        };
        let (scene, bodies) = spec.scene_alone()?;
        let mut scene = scene.with_clearance(&self.clearance)?;
        if let Some(depth) = self.contact {
            scene = scene.with_contact(&bodies, depth);
        }
        warnings.extend(spec.warnings(&bodies)?);
        warnings.extend(spec.assembly(&tool, &self.clearance, &scene.record.grid)?.1);
        let undecided = bodies.undecided;
        Ok(BuiltScene { scene, mesh, fixtures, bodies, warnings, undecided, chosen_pitch })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::tests::unit_cube;
    use crate::section::test_shapes::cylinder;

    #[test]
    fn it_is_the_scene_of_its_spec() {
        let (part, tool) = (ReferencePart::Bracket, Tool::paper());
        let clearance = Clearance::around_holder_and_shank(2.0);
        let built = Scene::builder()
            .reference(part)
            .dims([9, 27, 16])
            .margin(1)
            .tool(&tool)
            .clearance(clearance)
            .contact(3.0)
            .build()
            .unwrap();
        let mesh = part.mesh();
        let spec = SceneSpec { margin: 1, ..SceneSpec::of_reference(part, &mesh, [9, 27, 16], &tool) };
        let scene = spec.scene().unwrap().with_clearance(&clearance).unwrap();
        let bodies = spec.bodies(&scene.record.grid).unwrap();
        assert_eq!(built.bodies, bodies);
        assert_eq!((built.scene, built.chosen_pitch), (scene.with_contact(&bodies, 3.0), None));
        assert_eq!(built.undecided, 0.0);
    }

    #[test]
    fn what_should_be_known_comes_as_values_and_what_cannot_be_is_refused() {
        // A tetrahedron without its bottom, and a tool that is all cutter.
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|corner| corner * 9.0);
        let open = Mesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3]] };
        let tool = cylinder(2.0, 9.0);
        let build = |mesh: Mesh| Scene::builder().part("wedge", mesh, LengthUnit::Mm).tool(&tool).build();
        let built = build(open.clone()).unwrap();
        // A 48th of the part's 9 mm, to two digits.
        assert_eq!(built.scene.record.grid.pitch, 0.18);
        assert_eq!(built.chosen_pitch.map(|chosen| chosen.pitch), Some(built.scene.record.grid.pitch));
        assert!(built.undecided > 0.5 && built.undecided < 0.9, "{}", built.undecided);
        let said: Vec<String> = built.warnings.iter().map(ToString::to_string).collect();
        assert!(
            said[0].contains("no holder") && said[1].contains("wedge is open (3 boundary edges)"),
            "{said:?}"
        );
        let far = build(open.transformed(&DMat4::from_scale(DVec3::splat(1e6)))).unwrap_err().to_string();
        assert!(far.contains("wedge") && far.contains("mm"), "{far}");
        assert!(Scene::builder().build().unwrap_err().to_string().contains("no part"));
        let none =
            Scene::builder().part("wedge", unit_cube(), LengthUnit::Mm).build().unwrap_err().to_string();
        assert!(none.contains("wedge") && none.contains("tool"), "{none}");
        let missing = Scene::builder().part_file("no/such.obj", LengthUnit::Mm).build().unwrap_err();
        assert!(missing.to_string().contains("no/such.obj"), "{missing}");
    }
}
