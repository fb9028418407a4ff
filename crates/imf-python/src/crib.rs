//! Which tools of a crib serve which places of a surface, and the fewest that serve all.

use imf_core::control::{Cancelled, Control};
use imf_core::set_cover::CoverProblem;
use imf_core::surface::{
    CollisionEnvironment, SurfaceError, SurfaceSamples, SurfaceTool, crib_access, default_tolerance,
};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{mesh_arrays, rows_of};
use crate::errors::{self, Failure, Raise, value_error};
use crate::scene::Scene;
use crate::sections::DirectionsInput;
use crate::surface::cover_settings;
use crate::tool::Tool;
use crate::work::{Progress, run};

/// The verdict of every tool on every sample of the surface, `[tools, n]`, with the samples.
#[pyfunction]
pub(crate) fn crib<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    tools: Vec<Py<Tool>>,
    directions: Option<DirectionsInput<'py>>,
    samples: usize,
    tolerance: Option<f64>,
    progress: Progress<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let own = scene.get();
    let record = &own.scene.record;
    if tools.is_empty() {
        return Err(value_error("a crib has at least one tool"));
    }
    let set = DirectionsInput::or_usual(directions, py, own)?;
    let tolerance = tolerance.unwrap_or_else(|| default_tolerance(record.grid.pitch, record.unit));
    let mesh = own.placed_mesh();
    // A tool that passes between the voxels' centres would be free everywhere.
    let assemblies = own.with_spec(Control::quiet(), |spec| {
        let assembly = |tool: &Py<Tool>| spec.assembly(&tool.get().0, &record.clearance, &record.grid);
        tools.iter().map(assembly).collect::<Result<Vec<_>, _>>()
    });
    let (tools, warnings): (Vec<_>, Vec<_>) = assemblies.map_err(Raise::raise)?.into_iter().unzip();
    let (environment, samples) = run(py, (&None, "", 0), |control| {
        let environment =
            own.with_spec(control, |spec| CollisionEnvironment::of_bodies(spec, &own.bodies))?;
        let samples = SurfaceSamples::new(&mesh, environment.part(), samples);
        Ok::<_, Failure>((environment, samples))
    })?;
    let verdicts = run(py, (&progress, "crib", samples.samples.len() as u64), |control| {
        let tools = tools.iter().map(|tool| SurfaceTool::new(&environment, tool, tolerance));
        let tools = tools.collect::<Result<Vec<_>, _>>()?;
        Ok::<_, Failure>(crib_access(&tools, &samples.samples, &set.orientations, control)?)
    })?;
    let (vertices, faces) = mesh_arrays(py, &samples.mesh)?;
    let found = PyDict::new(py);
    found.set_item("warnings", warnings.iter().flatten().map(errors::warning).collect::<Vec<_>>())?;
    let flat = verdicts.iter().flatten().map(|verdict| *verdict as u8).collect::<Vec<_>>();
    found.set_item("verdict", rows_of(py, flat, samples.samples.len())?)?;
    found.set_item(
        "areas",
        PyArray1::from_vec(py, samples.samples.iter().map(|own| own.area).collect::<Vec<_>>()),
    )?;
    found.set_item("vertices", vertices)?;
    found.set_item("faces", faces)?;
    Ok(found)
}

/// The fewest rows of `holds`, `[sets, n]`, that cover a fraction of the weights that all cover, the first ones where there are several
/// ways, and how many are needed at least.
#[pyfunction]
pub(crate) fn fewest_sets<'py>(
    py: Python<'py>,
    holds: PyReadonlyArray2<'py, bool>,
    weights: PyReadonlyArray1<'py, f64>,
    fraction: f64,
) -> PyResult<(Vec<usize>, usize)> {
    let settings = cover_settings(fraction)?;
    let mut problem = CoverProblem::new(weights.as_array().to_vec());
    for row in holds.as_array().rows() {
        problem.add((0..row.len()).filter(|&place| row[place]));
    }
    let cover = run(py, (&None, "", 0), |control| {
        let cover = problem.fewest(&settings, control);
        let cover = cover.and_then(|cover| problem.among_first(cover, &settings, control));
        cover.ok_or(SurfaceError::Cancelled(Cancelled))
    })?;
    Ok((cover.sets, cover.at_least))
}
