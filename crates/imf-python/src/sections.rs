//! Exact sections, and their minimum over directions.

use std::sync::{Mutex, PoisonError};

use glam::{DQuat, DVec3};
use imf_core::orientation::{Orientation, OrientationSet, OrientationSetError};
use imf_core::scene;
use imf_core::section::{SectionError, SectionPlan, ToolPoints, imf, stream_sections};
use numpy::{
    IntoPyArray as _, PyArray1, PyArray3, PyArray4, PyArrayMethods as _, PyReadonlyArray2,
    PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;

use crate::arrays::{OrientationArrays, orientation_arrays};
use crate::errors::{Raise, value_error};
use crate::memory;
use crate::scene::Scene;
use crate::work::{Progress, detached, run, threads};

/// Directions as Python gives them: the text of a set, directions `[n, 3]`, or quaternions x, y, z, w `[n, 4]`.
#[derive(FromPyObject)]
pub(crate) enum DirectionsInput<'py> {
    /// See [`OrientationSet::FORMS`].
    Text(String),
    /// Rows.
    Rows(PyReadonlyArray2<'py, f64>),
}

impl DirectionsInput<'_> {
    /// Those that are given, or the usual ones of a scene's tool.
    pub(crate) fn or_usual(given: Option<Self>, py: Python<'_>, scene: &Scene) -> PyResult<OrientationSet> {
        given.unwrap_or_else(|| Self::Text(scene.usual_directions().into())).of(py, scene)
    }

    /// True where none says how the tool is rolled about its axis, as quaternions do.
    pub(crate) fn lack_roll(
        &self,
        py: Python<'_>,
        read: impl FnOnce(&str) -> Result<OrientationSet, OrientationSetError> + Send,
    ) -> PyResult<bool> {
        if matches!(self, Self::Rows(rows) if rows.shape()[1] == 4) {
            return Ok(false);
        }
        Ok(self.by(py, read)?.orientations.iter().all(|own| own.roll == 0.0))
    }

    /// The orientations, for a scene's part.
    pub(crate) fn of(&self, py: Python<'_>, scene: &Scene) -> PyResult<OrientationSet> {
        self.by(py, |text| scene.set(text))
    }

    /// The orientations, texts by a reader of sets.
    pub(crate) fn by(
        &self,
        py: Python<'_>,
        read: impl FnOnce(&str) -> Result<OrientationSet, OrientationSetError> + Send,
    ) -> PyResult<OrientationSet> {
        match self {
            Self::Text(text) => detached(py, || read(text))?.map_err(Raise::raise),
            Self::Rows(rows) => {
                let rows = rows.as_array();
                let orientation = |row: numpy::ndarray::ArrayView1<'_, f64>| match row.len() {
                    3 => Orientation::from_direction(DVec3::new(row[0], row[1], row[2])),
                    _ => rotation_of(DQuat::from_xyzw(row[0], row[1], row[2], row[3])),
                };
                if !matches!(rows.ncols(), 3 | 4) || rows.nrows() == 0 {
                    return Err(value_error(format!(
                        "directions must be a text, or have the shape (n, 3), vectors from tip to holder, or (n, 4), quaternions x, y, \
                         z, w; not {:?}",
                        rows.dim()
                    )));
                }
                let all = rows.rows().into_iter().enumerate().map(|(place, row)| {
                    let fault = || {
                        value_error(format!(
                            "direction {place} has no length, or a number that is not finite"
                        ))
                    };
                    orientation(row).ok_or_else(fault)
                });
                Ok(OrientationSet { spec: "given".into(), orientations: all.collect::<PyResult<_>>()? })
            }
        }
    }
}

fn rotation_of(rotation: DQuat) -> Option<Orientation> {
    let pose = imf_core::pose::Pose::new(DVec3::ZERO, rotation);
    pose.is_valid().then(|| pose.orientation())
}

/// Values and best orientation `[x, y, z]` of every voxel, and the orientations that are counted.
type Minimum<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray3<u32>>, OrientationArrays<'py>);

/// Values `[n, x, y, z]`, and the orientations.
type Sections<'py> = (Bound<'py, PyArray4<f32>>, OrientationArrays<'py>);

/// Bytes of counting sections.
fn counting_memory(scene: &scene::Scene) -> u64 {
    // Contact counts shank and holder apart.
    let passes = if scene.layer.is_some() { 2 } else { 1 };
    passes * SectionPlan::memory_estimate(&scene.record.grid, &scene.record.tool, threads())
}

/// The collision measure at every voxel, of each direction.
#[pyfunction]
pub(crate) fn sections<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    directions: DirectionsInput<'py>,
    progress: Progress<'py>,
) -> PyResult<Sections<'py>> {
    let set = directions.of(py, scene.get())?;
    let (count, scene) = (set.len(), &*scene.get().scene);
    let (dims, voxels) = (scene.record.grid.dims, scene.record.grid.len());
    let room = 4 * (count as u64).saturating_mul(voxels as u64);
    memory::require(counting_memory(scene).saturating_add(room), || {
        format!("{count} sections of {voxels} voxels; ask for fewer at once, or for their minimum")
    })?;
    let values = run(py, (&progress, "sections", count as u64), |control| {
        let plan = SectionPlan::of_scene(scene, ToolPoints::SharpPoints)?;
        let mut values = vec![0.0; count * voxels];
        let places: Vec<_> = values.chunks_exact_mut(voxels).map(Mutex::new).collect();
        stream_sections(
            &plan,
            &set.orientations,
            control,
            || (),
            |(), index, cmf| {
                places[index].lock().unwrap_or_else(PoisonError::into_inner).copy_from_slice(cmf);
            },
        )?;
        drop(places);
        Ok::<_, SectionError>(values)
    })?;
    let shape = [count, dims[0], dims[1], dims[2]];
    Ok((PyArray1::from_vec(py, values).reshape(shape)?, orientation_arrays(py, &set.orientations)?))
}

/// The minimum of the collision measure over directions at every voxel, and the first direction that has it.
#[pyfunction]
pub(crate) fn minimum<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    directions: DirectionsInput<'py>,
    progress: Progress<'py>,
) -> PyResult<Minimum<'py>> {
    let set = directions.of(py, scene.get())?;
    let scene = &*scene.get().scene;
    let (dims, voxels) = (scene.record.grid.dims, scene.record.grid.len() as u64);
    memory::require(counting_memory(scene) + 12 * voxels * (1 + threads() as u64), || {
        format!("sections of {voxels} voxels; use a larger pitch, or fewer threads")
    })?;
    let found = run(py, (&progress, "sections", set.len() as u64), |control| {
        let plan = SectionPlan::of_scene(scene, ToolPoints::SharpPoints)?;
        imf(&plan, &set.orientations, control)
    })?;
    let value = found.value.into_pyarray(py).reshape(dims)?;
    Ok((value, found.best.into_pyarray(py).reshape(dims)?, orientation_arrays(py, &set.orientations)?))
}
