//! The stock around a scene's part: its voxels, what a cutter removes, and what a toolpath leaves.

use glam::{DMat4, DVec3};
use imf_core::access::removable;
use imf_core::check::StockReport;
use imf_core::control::Control;
use imf_core::mesh::Mesh;
use imf_core::obstacle::Obstacle;
use imf_core::occupancy::Occupancy;
use imf_core::scene::{SceneError, solid_voxels};
use numpy::{IntoPyArray as _, PyArray3, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::value_error;
use crate::memory;
use crate::scene::{Body, MeshInput, Scene};
use crate::sections::DirectionsInput;
use crate::work::{Progress, run};

/// A stock as Python gives it: room around the part's box, or a mesh in the part's frame.
#[derive(FromPyObject)]
pub(crate) enum StockInput<'py> {
    Margin(f64),
    Mesh(MeshInput<'py>),
}

/// Bytes a voxel: stock, part, what is left, the line that took each, bits, distances.
const BYTES: u64 = 24;

impl StockInput<'_> {
    /// Its voxels, those of the part's grid.
    pub(crate) fn voxels(&self, py: Python<'_>, scene: &Scene) -> PyResult<Occupancy> {
        let record = &scene.scene.record;
        let Some(part) = scene.placed_mesh().bounds() else {
            return Err(value_error("the part has no triangle"));
        };
        let (name, mesh) = match self {
            Self::Margin(margin) if margin.is_finite() && *margin >= 0.0 => {
                ("stock".to_owned(), Mesh::cuboid(part.0 - *margin, part.1 + *margin))
            }
            Self::Margin(margin) => {
                return Err(value_error(format!(
                    "the room around the part must be a length of at least 0, not {margin}"
                )));
            }
            Self::Mesh(mesh) => {
                let Body { name, mesh, unit, .. } = mesh.read(py, false)?;
                let factor = unit.map_or(1.0, |unit| unit.in_mm() / record.unit.in_mm());
                let scaled = DMat4::from_scale(DVec3::splat(factor));
                (name, mesh.with_consistent_faces().0.transformed(&(record.transform * scaled)))
            }
        };
        let Some((lower, upper)) = mesh.bounds() else {
            return Err(value_error("the stock has no triangle"));
        };
        let grid = record.grid.covering(lower.min(part.0), upper.max(part.1), 0);
        let grid = grid.map_err(|error| value_error(error.to_string()))?;
        memory::require(BYTES * grid.len() as u64, || {
            let [x, y, z] = grid.dims;
            format!("{x}×{y}×{z} voxels of stock; check its unit, or use a larger pitch")
        })?;
        let solid = run(py, (&None, "", 0), |control| {
            Ok::<_, SceneError>(solid_voxels(&name, &mesh, &grid, false, control)?.solid)
        })?;
        if solid.count() == 0 {
            return Err(value_error(format!("the stock '{name}' holds no voxel's centre")));
        }
        Ok(solid)
    }
}

/// Stock (beside part and fixtures) that the scene's cutter removes at free poses: covered, possible and stock
/// `[x, y, z]`, and the grid.
#[pyfunction]
pub(crate) fn removable_stock<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    stock: StockInput<'py>,
    directions: Option<DirectionsInput<'py>>,
    progress: Progress<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let own = scene.get();
    let record = &own.scene.record;
    let set = DirectionsInput::or_usual(directions, py, own)?;
    if !record.bare_tool().has_cutter() {
        return Err(value_error(format!("the tool '{}' has no cutter", record.bare_tool().name)));
    }
    let mut stock = stock.voxels(py, own)?;
    let whole = own.bodies.obstacle();
    let held = whole.on(&stock.grid).ok_or_else(|| value_error("the grids of part and stock do not meet"))?;
    stock.solid.iter_mut().zip(&held.solid).for_each(|(stock, &held)| *stock &= 1 - held);
    let assembly = record.assembly().map_err(|error| value_error(error.to_string()))?;
    // With contact the cutter may enter the part's layer, as in the scene's sections.
    let obstacle = Obstacle::from(&*own.scene);
    let found = run(py, (&progress, "removable", 2 * set.len() as u64), |control: Control<'_>| {
        removable(obstacle, &assembly, &stock, &set.orientations, 0.0, control)
    })?;
    let grid = stock.grid;
    let dict = PyDict::new(py);
    let add = |name: &str, voxels: Vec<u8>| dict.set_item(name, voxels.into_pyarray(py).reshape(grid.dims)?);
    add("covered", found.covered)?;
    add("possible", found.possible)?;
    add("stock", stock.solid)?;
    dict.set_item("grid", (grid.origin.to_array(), grid.pitch, grid.dims))?;
    Ok(dict)
}

/// What a toolpath left of the stock.
pub(crate) fn report_dict<'py>(
    py: Python<'py>,
    found: StockReport,
    part: &Occupancy,
) -> PyResult<Bound<'py, PyDict>> {
    let left = found.left_beside(part);
    let grid = found.remaining.grid;
    let volume = |voxels: u64| voxels as f64 * grid.voxel_volume();
    let dict = PyDict::new(py);
    let lines = &found.removed;
    dict.set_item("lines", lines.iter().map(|own| own.line).collect::<Vec<_>>())?;
    dict.set_item(
        "kinds",
        lines.iter().map(|own| format!("{:?}", own.kind).to_lowercase()).collect::<Vec<_>>(),
    )?;
    dict.set_item("removed", lines.iter().map(|own| volume(own.voxels)).collect::<Vec<_>>())?;
    dict.set_item("removed_of_part", lines.iter().map(|own| volume(own.of_part)).collect::<Vec<_>>())?;
    dict.set_item("volume", volume(found.voxels))?;
    dict.set_item("left_beside_part", volume(left.voxels))?;
    dict.set_item("farthest_from_part", left.farthest)?;
    dict.set_item("grid", (grid.origin.to_array(), grid.pitch, grid.dims))?;
    let remaining: Bound<'py, PyArray3<u8>> = found.remaining.solid.into_pyarray(py).reshape(grid.dims)?;
    dict.set_item("remaining", remaining)?;
    let by_line: Bound<'py, PyArray3<u32>> = found.removed_by.into_pyarray(py).reshape(grid.dims)?;
    dict.set_item("removed_by_line", by_line)?;
    Ok(dict)
}
