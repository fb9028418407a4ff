//! Results as arrays.

use imf_core::glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::orientation::Orientation;
use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;

/// Vertices `[n, 3]` and triangles `[m, 3]`.
pub(crate) type MeshArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// A mesh as arrays.
pub(crate) fn mesh_arrays<'py>(py: Python<'py>, mesh: &Mesh) -> PyResult<MeshArrays<'py>> {
    let vertices: Vec<f64> = mesh.vertices.iter().flat_map(DVec3::to_array).collect();
    let triangles: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    Ok((rows_of(py, vertices, 3)?, rows_of(py, triangles, 3)?))
}

/// Directions `[n, 3]`, from tip to holder, and rotations `[n, 4]`, quaternions x, y, z, w, which say the roll too.
pub(crate) type OrientationArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Orientations as arrays.
pub(crate) fn orientation_arrays<'py>(
    py: Python<'py>,
    orientations: &[Orientation],
) -> PyResult<OrientationArrays<'py>> {
    let directions = orientations.iter().flat_map(|own| own.direction().to_array()).collect();
    let rotations = orientations.iter().flat_map(|own| own.quaternion().to_array()).collect();
    Ok((rows_of(py, directions, 3)?, rows_of(py, rotations, 4)?))
}

/// Numbers as rows of a width.
pub(crate) fn rows_of<T: numpy::Element>(
    py: Python<'_>,
    numbers: Vec<T>,
    width: usize,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows = numbers.len() / width;
    PyArray1::from_vec(py, numbers).reshape([rows, width])
}
