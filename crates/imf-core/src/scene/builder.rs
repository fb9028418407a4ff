//! A scene step by step, with what should be known of it as values.

use std::fmt;
use std::path::Path;

use glam::DMat4;

use super::{Around, Fixture, Resolution, Scene, SceneError, SceneSpec};
use crate::mesh::Mesh;
use crate::mesh::read::{MeshFile, read_mesh_file};
use crate::mesh::topology::MeshReport;
use crate::parts::ReferencePart;
use crate::tool::{Clearance, Tool};
use crate::unit::{LengthUnit, unit_check};

/// Voxels along the longest side where neither pitch nor dims are given.
const USUAL_LONGEST: f64 = 96.0;

/// A scene that was built, and what should be known of it.
#[derive(Clone, Debug)]
pub struct BuiltScene {
    /// The scene.
    pub scene: Scene,
    /// Nothing that keeps it from being used.
    pub warnings: Vec<SceneWarning>,
}

/// What should be known of a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SceneWarning {
    /// A mesh that is not closed.
    Open {
        /// The part.
        part: String,
        /// Edges of its boundary.
        boundary_edges: usize,
    },
    /// A mesh whose triangles face inwards.
    InsideOut {
        /// The part.
        part: String,
    },
    /// A tool of which nothing holds the cutter.
    NoHolder {
        /// The tool.
        tool: String,
    },
}

impl SceneWarning {
    /// Those of a part's mesh.
    #[must_use]
    pub fn of_mesh(part: &str, report: &MeshReport) -> Vec<Self> {
        let open = (!report.closed)
            .then(|| Self::Open { part: part.to_owned(), boundary_edges: report.boundary_edges });
        let turned = (report.signed_volume < 0.0).then(|| Self::InsideOut { part: part.to_owned() });
        open.into_iter().chain(turned).collect()
    }

    /// Those of a tool.
    #[must_use]
    pub fn of_tool(tool: &Tool) -> Option<Self> {
        (!tool.has_holder()).then(|| Self::NoHolder { tool: tool.name.clone() })
    }
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open { part, boundary_edges } => write!(
                f,
                "{part} is open ({boundary_edges} boundary edges): inside is where the winding number exceeds one half"
            ),
            Self::InsideOut { part } => {
                write!(f, "{part} is inside out (negative volume); it is taken as solid all the same")
            }
            Self::NoHolder { tool } => write!(f, "the tool {tool} has no holder: what holds it is not seen"),
        }
    }
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
/// assert!(built.warnings.is_empty());
/// assert!(built.scene.obstacle.count() > 0);
/// # Ok::<(), imf_core::scene::SceneError>(())
/// ```
#[must_use]
pub struct SceneBuilder {
    part: Result<Part, SceneError>,
    transform: DMat4,
    resolution: Option<Resolution>,
    margin: usize,
    conservative: bool,
    tool: Tool,
    clearance: Clearance,
    contact: Option<f64>,
    fixtures: Vec<(String, Mesh, DMat4)>,
    around: Around,
}

impl Scene {
    /// A scene of a part, by default against the paper's tool, alone, as it lies, on 96 voxels along its longest side.
    pub fn builder() -> SceneBuilder {
        SceneBuilder {
            part: Err(SceneError::NoPart),
            transform: DMat4::IDENTITY,
            resolution: None,
            margin: 0,
            conservative: false,
            tool: Tool::paper(),
            clearance: Clearance::default(),
            contact: None,
            fixtures: Vec::new(),
            around: Around::Part,
        }
    }
}

impl SceneBuilder {
    /// A part by its mesh.
    pub fn part(self, name: &str, mesh: Mesh, unit: LengthUnit) -> Self {
        Self { part: Ok(Part { name: name.to_owned(), mesh, unit, reference: None }), ..self }
    }

    /// A part from a file ([`read_mesh_file`]); `unit` is that of files which state none.
    pub fn part_file(self, path: impl AsRef<Path>, unit: LengthUnit) -> Self {
        let path = path.as_ref();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let part = read_mesh_file(path).map(|MeshFile { mesh, unit: stated }| Part {
            name,
            mesh,
            unit: stated.unwrap_or(unit),
            reference: None,
        });
        Self { part: part.map_err(SceneError::from), ..self }
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

    /// The tool, in any unit.
    pub fn tool(self, tool: &Tool) -> Self {
        Self { tool: tool.clone(), ..self }
    }

    /// Room that the tool keeps.
    pub fn clearance(self, clearance: Clearance) -> Self {
        Self { clearance, ..self }
    }

    /// How deep below the part's surface the cutter may reach.
    pub fn contact(self, depth: f64) -> Self {
        Self { contact: Some(depth), ..self }
    }

    /// What holds the part, in the part's unit; may be called again.
    pub fn fixture(mut self, name: &str, mesh: Mesh, transform: DMat4) -> Self {
        self.fixtures.push((name.to_owned(), mesh, transform));
        self
    }

    /// What the grid is chosen around.
    pub fn around(self, around: Around) -> Self {
        Self { around, ..self }
    }

    /// Voxelises.
    ///
    /// # Errors
    /// No part, or one that cannot be read, is of an implausible size, or of which no voxel is left; a grid that cannot be made; a
    /// fixture that sticks out of it; a clearance that is no length.
    pub fn build(self) -> Result<BuiltScene, SceneError> {
        let part = self.part?;
        let report = MeshReport::new(&part.mesh);
        if let Some(size) = unit_check(report.extents, part.unit) {
            return Err(SceneError::Size { part: part.name, size });
        }
        let fixtures: Vec<Fixture<'_>> = self
            .fixtures
            .iter()
            .map(|(name, mesh, transform)| Fixture { name, mesh, transform: *transform })
            .collect();
        let resolution = self.resolution.unwrap_or_else(|| match part.reference {
            Some(reference) => Resolution::Dims(reference.dims()),
            None => Resolution::Pitch(report.extents.max_element() / USUAL_LONGEST),
        });
        let spec = SceneSpec {
            part: &part.name,
            mesh: &part.mesh,
            unit: part.unit,
            transform: self.transform,
            resolution,
            margin: self.margin,
            conservative: self.conservative,
            tool: &self.tool,
            fixtures: &fixtures,
            around: self.around,
        };
        let mut scene = spec.scene()?.with_clearance(&self.clearance)?;
        if let Some(depth) = self.contact {
            let bodies = spec.bodies(&scene.record.grid)?;
            scene = scene.with_contact(&bodies, depth);
        }
        let mut warnings = match part.reference {
            Some(_) => Vec::new(),
            None => SceneWarning::of_mesh(&part.name, &report),
        };
        warnings.extend(SceneWarning::of_tool(&self.tool));
        Ok(BuiltScene { scene, warnings })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::tool::{Element, ElementKind, Segment, ToolShape};

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
        assert_eq!((built.scene, built.warnings), (scene.with_contact(&bodies, 3.0), vec![]));
    }

    #[test]
    fn what_should_be_known_comes_as_values_and_what_cannot_be_is_refused() {
        // A tetrahedron without its bottom, and a tool that is all cutter.
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|corner| corner * 9.0);
        let open = Mesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3]] };
        let line = Segment::Line { from: 0.0, to: 9.0, radius_from: 2.0, radius_to: 2.0 };
        let cutter = Element { kind: ElementKind::Cutter, profile: vec![line] };
        let tool = Tool { shape: ToolShape::Revolved(vec![cutter]), ..Tool::paper() };
        let build = |mesh: Mesh| Scene::builder().part("wedge", mesh, LengthUnit::Mm).tool(&tool).build();
        let built = build(open.clone()).unwrap();
        assert_eq!(built.scene.record.grid.dims.into_iter().max(), Some(96));
        let said: Vec<String> = built.warnings.iter().map(ToString::to_string).collect();
        assert!(
            said[0].contains("wedge is open (3 boundary edges)") && said[1].contains("no holder"),
            "{said:?}"
        );
        let far = build(open.transformed(&DMat4::from_scale(DVec3::splat(1e6)))).unwrap_err().to_string();
        assert!(far.contains("wedge") && far.contains("mm"), "{far}");
        assert!(Scene::builder().build().unwrap_err().to_string().contains("no part"));
        let missing = Scene::builder().part_file("no/such.obj", LengthUnit::Mm).build().unwrap_err();
        assert!(missing.to_string().contains("no/such.obj"), "{missing}");
    }
}
