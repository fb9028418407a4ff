//! The scene as Python holds it: the library's, and what it was made of, since surfaces and toolpaths need the meshes again.

use std::path::Path;
use std::str::FromStr as _;
use std::sync::Arc;

use glam::{DMat4, DVec3};
use imf_core::control::Control;
use imf_core::mesh::Mesh;
use imf_core::mesh::read::{MeshFile, read_mesh_file};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::{self, Bodies, Fixture, GridExtent, Guarantee, Resolution, SceneError, SceneSpec};
use imf_core::tool::{self, Clearance};
use imf_core::unit::LengthUnit;
use numpy::{IntoPyArray as _, PyArray3, PyArrayMethods as _, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{MeshArrays, OrientationArrays, mesh_arrays, orientation_arrays};
use crate::errors::{self, Raise, value_error};
use crate::memory;
use crate::sections::DirectionsInput;
use crate::tool::Tool;
use crate::work::{Progress, detached, run};

/// A mesh as Python gives it: a path (or, of a part, a built-in part's name), or vertices `[n, 3]` and triangles `[m, 3]` with a name.
#[derive(FromPyObject)]
pub(crate) enum MeshInput<'py> {
    /// A file.
    Path(String),
    /// Arrays.
    Arrays(PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, i64>, String),
}

/// A mesh as it was read.
pub(crate) struct Body {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    /// The file's own.
    pub(crate) unit: Option<LengthUnit>,
    reference: Option<ReferencePart>,
}

impl MeshInput<'_> {
    pub(crate) fn read(&self, py: Python<'_>, built_in: bool) -> PyResult<Body> {
        match self {
            Self::Path(text) => {
                let path = Path::new(text);
                if let Ok(part) = ReferencePart::from_str(text)
                    && built_in
                    && !path.is_file()
                {
                    let (name, mesh) = (part.name().to_owned(), part.mesh());
                    return Ok(Body { name, mesh, unit: Some(LengthUnit::Mm), reference: Some(part) });
                }
                let MeshFile { mesh, unit } = detached(py, || read_mesh_file(path))?.map_err(Raise::raise)?;
                let name =
                    path.file_name().map_or_else(|| text.clone(), |name| name.to_string_lossy().into());
                Ok(Body { name, mesh, unit, reference: None })
            }
            Self::Arrays(vertices, faces, name) => {
                Ok(Body { name: name.clone(), mesh: mesh_of(vertices, faces)?, unit: None, reference: None })
            }
        }
    }
}

/// A mesh from its arrays.
fn mesh_of(vertices: &PyReadonlyArray2<'_, f64>, faces: &PyReadonlyArray2<'_, i64>) -> PyResult<Mesh> {
    let (vertices, faces) = (vertices.as_array(), faces.as_array());
    for (name, width) in [("vertices", vertices.ncols()), ("faces", faces.ncols())] {
        if width != 3 {
            return Err(value_error(format!("{name} must have the shape (n, 3), not (n, {width})")));
        }
    }
    let count = vertices.nrows();
    let corner = |index: &i64| {
        let known = u32::try_from(*index).ok().filter(|&index| (index as usize) < count);
        known.ok_or_else(|| value_error(format!("a face names the vertex {index}, and there are {count}")))
    };
    let triangle = |face: numpy::ndarray::ArrayView1<'_, i64>| {
        Ok([corner(&face[0])?, corner(&face[1])?, corner(&face[2])?])
    };
    if let Some(place) = vertices.rows().into_iter().position(|row| row.iter().any(|v| !v.is_finite())) {
        return Err(value_error(format!("vertex {place} has a coordinate that is not a finite number")));
    }
    Ok(Mesh {
        vertices: vertices.rows().into_iter().map(|row| DVec3::new(row[0], row[1], row[2])).collect(),
        triangles: faces.rows().into_iter().map(triangle).collect::<PyResult<_>>()?,
    })
}

/// A matrix as NumPy has it, `[4, 4]`, that is to be multiplied by columns.
pub(crate) fn matrix_of(array: &PyReadonlyArray2<'_, f64>) -> PyResult<DMat4> {
    let array = array.as_array();
    if array.dim() != (4, 4) {
        return Err(value_error(format!("a transform is a matrix of 4 × 4, not of {:?}", array.dim())));
    }
    let rows: Vec<f64> = array.iter().copied().collect();
    Ok(DMat4::from_cols_slice(&rows).transpose())
}

/// Room around holder, shank and cutter.
pub(crate) fn clearance_of([holder, shank, cutter]: [f64; 3]) -> Clearance {
    Clearance { holder, shank, cutter }
}

/// A part on its grid, and the tool that is to reach it.
#[pyclass(frozen, module = "imf._imf")]
pub(crate) struct Scene {
    pub(crate) scene: Arc<scene::Scene>,
    pub(crate) mesh: Mesh,
    pub(crate) reference: Option<ReferencePart>,
    pub(crate) warnings: Vec<String>,
    tool: tool::Tool,
    fixtures: Vec<(String, Mesh, DMat4)>,
    allow_coarse: bool,
    /// Part and fixtures apart, on the scene's grid.
    pub(crate) bodies: Bodies,
}

impl Scene {
    /// What the scene is made from, once more.
    pub(crate) fn with_spec<T>(
        &self,
        control: Control<'_>,
        make: impl FnOnce(&SceneSpec<'_>) -> Result<T, SceneError>,
    ) -> Result<T, SceneError> {
        let record = &self.scene.record;
        let fixtures: Vec<Fixture<'_>> = self
            .fixtures
            .iter()
            .map(|(name, mesh, transform)| Fixture { name, mesh, transform: *transform })
            .collect();
        make(&SceneSpec {
            part: &record.part,
            mesh: &self.mesh,
            unit: record.unit,
            transform: record.transform,
            resolution: Resolution::Pitch(record.grid.pitch),
            margin: record.margin,
            conservative: record.conservative,
            allow_coarse: self.allow_coarse,
            tool: &self.tool,
            fixtures: &fixtures,
            around: GridExtent::Part,
            control,
        })
    }

    /// The part's mesh in the world.
    pub(crate) fn placed_mesh(&self) -> Mesh {
        self.mesh.transformed(&self.scene.record.transform)
    }

    /// The fixtures' names.
    pub(crate) fn fixture_names(&self) -> &[String] {
        &self.scene.record.fixtures
    }

    /// The set of a text, for this part.
    pub(crate) fn set(
        &self,
        text: &str,
    ) -> Result<OrientationSet, imf_core::orientation::OrientationSetError> {
        OrientationSet::parse_for(text, || {
            let found = self.placed_mesh().machining_directions();
            found.into_iter().map(|suggested| suggested.direction).collect()
        })
    }
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (part, tool, *, unit, pitch, dims, margin, transform, fixtures, clearance, contact, conservative, allow_coarse, around_all, progress))]
    fn new(
        py: Python<'_>,
        part: MeshInput<'_>,
        tool: Option<&Bound<'_, Tool>>,
        unit: Option<&str>,
        pitch: Option<f64>,
        dims: Option<[usize; 3]>,
        margin: usize,
        transform: PyReadonlyArray2<'_, f64>,
        fixtures: Vec<(MeshInput<'_>, PyReadonlyArray2<'_, f64>)>,
        clearance: [f64; 3],
        contact: Option<f64>,
        conservative: bool,
        allow_coarse: bool,
        around_all: bool,
        progress: Progress<'_>,
    ) -> PyResult<Self> {
        let given = unit.map(LengthUnit::from_str).transpose().map_err(Raise::raise)?;
        let Body { name, mesh, unit: stated, reference } = part.read(py, true)?;
        let is_stl = Path::new(&name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("stl"));
        if is_stl && given.is_none() && matches!(part, MeshInput::Path(_)) {
            return Err(value_error(format!(
                "{name}: an STL file does not say its unit; give unit='mm' (or cm, m, inch)"
            )));
        }
        let unit = given.or(stated).unwrap_or_default();
        if reference.is_some() && unit != LengthUnit::Mm {
            return Err(value_error(format!("the built-in part {name} is in mm: leave unit out")));
        }
        let overruled = stated.filter(|stated| *stated != unit);
        let transform = matrix_of(&transform)?;
        let tool = match (tool, reference) {
            (Some(tool), _) => Some(tool.get().0.clone()),
            (None, Some(_)) => Some(tool::Tool::paper()),
            (None, None) => None,
        };
        let mut builder = match reference {
            Some(part) => scene::Scene::builder().reference(part),
            None => scene::Scene::builder().part(&name, mesh.clone(), unit),
        };
        builder = builder.transform(transform).margin(margin).conservative(conservative);
        builder = builder.allow_coarse(allow_coarse).clearance(clearance_of(clearance));
        if let Some(tool) = &tool {
            builder = builder.tool(tool);
        }
        if let Some(pitch) = pitch {
            builder = builder.pitch(pitch);
        }
        if let Some(dims) = dims {
            builder = builder.dims(dims);
        }
        if let Some(depth) = contact {
            builder = builder.contact(depth);
        }
        if around_all {
            builder = builder.around(GridExtent::All);
        }
        let mut held = Vec::new();
        for (fixture, at) in &fixtures {
            let Body { name, mesh, unit: stated, .. } = fixture.read(py, false)?;
            let factor = stated.map_or(1.0, |stated| stated.in_mm() / unit.in_mm());
            let mesh = mesh.transformed(&DMat4::from_scale(DVec3::splat(factor)));
            held.push((name, mesh, matrix_of(at)?));
        }
        for (name, mesh, at) in &held {
            builder = builder.fixture(name, mesh.clone(), *at);
        }
        let fixtures = held.iter().filter(|_| around_all).map(|(_, mesh, at)| mesh.transformed(at).bounds());
        let boxes = std::iter::once(mesh.transformed(&transform).bounds()).chain(fixtures);
        memory::require_for_voxels(dims, pitch, margin, boxes.flatten(), 6 * (1 + held.len() as u64))?;
        let rows = if let Some([x, y, _]) = dims { x * y * (1 + held.len()) } else { 0 };
        let built =
            run(py, (&progress, "voxelising", rows as u64), |control| builder.control(control).build())?;
        let scene::BuiltScene { scene, mesh, fixtures, bodies, warnings, chosen_pitch, .. } = built;
        let mut warnings: Vec<String> = warnings.iter().map(errors::warning).collect();
        warnings.extend(chosen_pitch.map(|chosen| chosen.to_string()));
        warnings.extend(
            overruled.map(|stated| format!("{name} says that it is in {stated}; unit='{unit}' overrules it")),
        );
        Ok(Self {
            tool: tool.unwrap_or_else(tool::Tool::paper),
            mesh,
            fixtures,
            scene: Arc::new(scene),
            reference,
            warnings,
            allow_coarse,
            bodies,
        })
    }

    /// The part's name.
    #[getter]
    fn part(&self) -> &str {
        &self.scene.record.part
    }

    /// Unit of every length.
    #[getter]
    fn unit(&self) -> String {
        self.scene.record.unit.to_string()
    }

    /// Lower corner, pitch and dims of the grid.
    #[getter]
    fn grid(&self) -> ([f64; 3], f64, [usize; 3]) {
        let grid = &self.scene.record.grid;
        (grid.origin.to_array(), grid.pitch, grid.dims)
    }

    /// What should be known of the scene.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The tool without clearance, in the scene's unit.
    #[getter]
    fn tool(&self) -> Tool {
        Tool(self.scene.record.bare_tool().clone())
    }

    /// Room around holder, shank and cutter.
    #[getter]
    fn clearance(&self) -> [f64; 3] {
        let Clearance { holder, shank, cutter } = self.scene.record.clearance;
        [holder, shank, cutter]
    }

    /// How deep the cutter may reach below the part's surface.
    #[getter]
    fn contact(&self) -> Option<f64> {
        self.scene.record.contact
    }

    /// What exact results guarantee, in a sentence.
    #[getter]
    fn guarantee(&self) -> String {
        let record = &self.scene.record;
        let (tool, touches) = (record.bare_tool(), record.contact.is_some());
        Guarantee::new(record.conservative, tool, &record.clearance, touches, record.grid.pitch).to_string()
    }

    /// Solid voxels of part and fixtures, `[x, y, z]`.
    #[getter]
    fn solid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.scene.obstacle.solid.clone().into_pyarray(py).reshape(self.scene.record.grid.dims)
    }

    /// Vertices and triangles of the part's mesh in the world.
    #[getter]
    fn mesh<'py>(&self, py: Python<'py>) -> PyResult<MeshArrays<'py>> {
        mesh_arrays(py, &detached(py, || self.placed_mesh())?)
    }

    /// The text of the directions that are meant where none are named.
    #[getter]
    pub(crate) fn usual_directions(&self) -> &'static str {
        OrientationSet::usual(self.scene.record.bare_tool().is_axisymmetric(), true)
    }

    /// Of a set.
    fn orientations<'py>(
        &self,
        py: Python<'py>,
        directions: DirectionsInput<'py>,
    ) -> PyResult<OrientationArrays<'py>> {
        orientation_arrays(py, &directions.of(py, self)?.orientations)
    }

    /// True where the tool's roll counts, and directions do not say it.
    fn lacks_roll(&self, py: Python<'_>, directions: DirectionsInput<'_>) -> PyResult<bool> {
        let is_round = self.scene.record.bare_tool().is_axisymmetric();
        Ok(!is_round && directions.lack_roll(py, |text| self.set(text))?)
    }
}
