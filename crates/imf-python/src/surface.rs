//! What a scene's tool reaches of its part's surface: accessibility, the fewest set-ups, the minimum stick-outs.

use glam::DMat3;
use imf_core::control::Cancelled;
use imf_core::mesh::MachiningDirection;
use imf_core::orientation::{Limits, Orientation, OrientationSet};
use imf_core::set_cover::{Cover, CoverProblem, CoverSettings};
use imf_core::surface::{
    CollisionEnvironment, ObstructedAreas, PartSetup, SampleReach, SetupTool, StickOut, StickOutTool,
    SurfaceAccess, SurfaceError, SurfaceSamples, SurfaceTool, candidate_setups, default_tolerance,
    fewest_setups, reached_in_setups, shortest_stick_outs, surface_access, surface_memory_estimate, ways_up,
    with_ways_up,
};
use imf_core::tool::Assembly;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{mesh_arrays, orientation_arrays, rows_of};
use crate::errors::{Failure, Raise, value_error};
use crate::memory;
use crate::scene::Scene;
use crate::sections::DirectionsInput;
use crate::work::{Progress, detached, run};

/// A surface, cut into samples, and what the tool reaches of it.
#[pyclass(frozen, module = "imf._imf")]
pub(crate) struct Surface {
    scene: Py<Scene>,
    set: OrientationSet,
    suggested: Vec<MachiningDirection>,
    environment: CollisionEnvironment,
    assembly: Assembly,
    tolerance: f64,
    samples: SurfaceSamples,
    tool: SurfaceTool,
    access: SurfaceAccess,
    /// The fraction of the area that is reached at twice the pitch.
    coarse: f64,
}

/// Which samples of a surface the scene's tool reaches, and from which directions.
#[pyfunction]
pub(crate) fn access<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    directions: Option<DirectionsInput<'py>>,
    samples: usize,
    tolerance: Option<f64>,
    progress: Progress<'py>,
) -> PyResult<Surface> {
    let own = scene.get();
    let (mesh, suggested) = detached(py, || {
        let mesh = own.placed_mesh();
        let suggested = mesh.machining_directions();
        (mesh, suggested)
    })?;
    let directions = match directions {
        Some(directions) => directions,
        // A way up is a direction that the tool may come from.
        None => DirectionsInput::Text(with_ways_up(own.usual_directions(), &suggested)),
    };
    let set = directions.of(py, own)?;
    let record = &own.scene.record;
    let (voxels, directions) = (record.grid.len() as u64, set.len());
    // Voxels, counts and distances of every body; of every sample which directions are free, once in bits and once in bytes.
    let bodies = 2 + own.fixture_names().len() as u64;
    let most = SurfaceSamples::most(&mesh, samples);
    let of_samples = surface_memory_estimate(most, directions)
        .saturating_add((most as u64).saturating_mul(directions as u64));
    memory::require(of_samples.saturating_add((26 * bodies + 10) * voxels), || {
        format!(
            "{most} samples, {directions} directions, {voxels} voxels; ask for fewer, use a larger pitch, or a coarser mesh"
        )
    })?;
    let [tolerance, coarse_tolerance] = [1.0, 2.0]
        .map(|by| tolerance.unwrap_or_else(|| default_tolerance(by * record.grid.pitch, record.unit)));
    let (environment, assembly, samples) = run(py, (&None, "", 0), |control| {
        let environment =
            own.with_spec(control, |spec| CollisionEnvironment::of_bodies(spec, &own.bodies))?;
        let samples = SurfaceSamples::new(&mesh, environment.part(), samples);
        Ok::<_, Failure>((environment, record.assembly()?, samples))
    })?;
    let count = samples.samples.len() as u64;
    let (tool, access) = run(py, (&progress, "surface", count), |control| {
        let tool = SurfaceTool::new(&environment, &assembly, tolerance)?;
        let access = surface_access(&tool, &samples.samples, &set.orientations, control)?;
        Ok::<_, Failure>((tool, access))
    })?;
    let coarse = run(py, (&progress, "surface at twice the pitch", count), |control| {
        let environment = own.with_spec(control, |spec| {
            CollisionEnvironment::at_twice_the_pitch(spec, &own.bodies.part.grid)
        })?;
        let tool = SurfaceTool::new(&environment, &assembly, coarse_tolerance)?;
        let access = surface_access(&tool, &samples.samples, &set.orientations, control)?;
        let reached = |at: usize| matches!(access.reach[at], SampleReach::Reached { .. });
        Ok::<_, Failure>(samples.fraction(reached))
    })?;
    let scene = scene.clone().unbind();
    Ok(Surface { scene, set, suggested, environment, assembly, tolerance, samples, tool, access, coarse })
}

#[pymethods]
impl Surface {
    /// Everything as arrays, by name.
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let samples = &self.samples.samples;
        let of = |vector: &dyn Fn(usize) -> [f64; 3]| {
            rows_of(py, (0..samples.len()).flat_map(vector).collect::<Vec<f64>>(), 3)
        };
        let verdicts: Vec<u8> = self.access.reach.iter().map(|reach| reach.verdict() as u8).collect();
        let (vertices, faces) = mesh_arrays(py, &self.samples.mesh)?;
        let columns = self.set.len();
        let free = |at: usize| self.access.is_free(at / columns, at % columns);
        let free: Vec<bool> = detached(py, || (0..samples.len() * columns).map(free).collect())?;
        let found = PyDict::new(py);
        found.set_item("vertices", vertices)?;
        found.set_item("faces", faces)?;
        found.set_item("points", of(&|at| samples[at].point.to_array())?)?;
        found.set_item("normals", of(&|at| samples[at].normal.to_array())?)?;
        let areas: Vec<f64> = samples.iter().map(|sample| sample.area).collect();
        found.set_item("areas", PyArray1::from_vec(py, areas))?;
        found.set_item("verdict", PyArray1::from_vec(py, verdicts))?;
        found.set_item("free", rows_of(py, free, columns)?)?;
        let (directions, rotations) = orientation_arrays(py, &self.set.orientations)?;
        found.set_item("directions", directions)?;
        found.set_item("rotations", rotations)?;
        Ok(found)
    }

    /// What hits what, with the fraction of the area that this obstructs; several may obstruct one place.
    fn obstructed_by(&self, py: Python<'_>) -> Vec<(String, String, f64)> {
        let scene = self.scene.bind(py).get();
        let fixtures = scene.fixture_names();
        let reach = self.access.reach.iter().zip(&self.samples.samples);
        let found = ObstructedAreas::new(reach.map(|(reach, sample)| (&self.tool, *reach, sample.area)));
        let area = self.samples.area();
        let rows = found.hits.into_iter().map(|(kind, body, own)| {
            let against = match body {
                0 => "part".to_owned(),
                fixture => fixtures.get(fixture - 1).cloned().unwrap_or_default(),
            };
            (kind.to_string(), against, own / area)
        });
        rows.collect()
    }

    /// How deep the cutter may cut.
    #[getter]
    fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Area inside the part or flush, where bodies of the mesh cross or touch each other.
    #[getter]
    fn hidden_area(&self) -> f64 {
        self.samples.hidden_area
    }

    /// The fraction that is reached at twice the pitch.
    #[getter]
    fn reached_at_twice_the_pitch(&self) -> f64 {
        self.coarse
    }

    /// The fewest set-ups of a machine within limits; every direction is a way up, or those of axes and part alone.
    fn setups<'py>(
        &self,
        py: Python<'py>,
        limits: &str,
        fraction: f64,
        every_direction: bool,
        progress: Progress<'py>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let scene = self.scene.bind(py).get();
        if !scene.fixture_names().is_empty() {
            return Err(value_error(
                "a fixture belongs to one set-up, and here it would go with the part into every one: make the scene without fixtures, or \
                 give it the directions of one set-up",
            ));
        }
        let settings = cover_settings(fraction)?;
        let limits = Limits::parse(limits).map_err(Raise::raise)?;
        let (mesh, orientations) = (scene.placed_mesh(), &self.set.orientations);
        let ways = match every_direction {
            true => orientations.iter().map(Orientation::direction).collect(),
            false => ways_up(&self.suggested),
        };
        let candidates =
            run(py, (&None, "", 0), |_| candidate_setups(&mesh, &ways, orientations, &limits, false))?;
        let (chosen, reached) = run(py, (&progress, "set-ups", candidates.len() as u64), |control| {
            let tools = [SetupTool { access: &self.access, brought: None }];
            let samples = &self.samples.samples;
            let reached = reached_in_setups(&tools, samples, orientations, &candidates, control);
            let reached = reached.ok_or(Cancelled)?;
            let chosen = fewest_setups(&candidates, &reached, &settings, control);
            Ok::<_, SurfaceError>((chosen.ok_or(Cancelled)?, reached))
        })?;
        self.plan_dict(py, &chosen, &reached, &candidates)
    }

    /// By sample, the minimum stick-out (infinite where there is none) and the direction that allows it, and the
    /// verdict; given, shortest and longest of the tool.
    fn stick_outs<'py>(&self, py: Python<'py>, progress: Progress<'py>) -> PyResult<StickOuts<'py>> {
        let (tool, found) = run(py, (&progress, "stick-out", self.set.len() as u64), |control| {
            let tool = StickOutTool::new(&self.environment, &self.assembly, self.tolerance)?;
            let found = shortest_stick_outs(&tool, &self.samples.samples, &self.set.orientations, control)?;
            Ok::<_, Failure>((tool, found))
        })?;
        let direction = |found: &StickOut| match found {
            StickOut::Reached { direction, .. } => i64::from(*direction),
            _ => -1,
        };
        let lengths = found.iter().map(StickOut::length).collect();
        let directions = found.iter().map(direction).collect();
        let verdicts = found.iter().map(|found| found.verdict() as u8).collect();
        Ok((
            PyArray1::from_vec(py, lengths),
            PyArray1::from_vec(py, directions),
            PyArray1::from_vec(py, verdicts),
            [tool.given(), tool.shortest(), tool.longest()],
        ))
    }
}

/// Covers of a fraction.
pub(crate) fn cover_settings(fraction: f64) -> PyResult<CoverSettings> {
    if !(fraction > 0.0 && fraction <= 1.0) {
        return Err(value_error(format!(
            "the fraction to cover must be above 0 and at most 1, not {fraction}"
        )));
    }
    Ok(CoverSettings { fraction, ..CoverSettings::default() })
}

/// Lengths, directions, verdicts; given, shortest and longest.
type StickOuts<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<u8>>, [f64; 3]);

impl Surface {
    fn plan_dict<'py>(
        &self,
        py: Python<'py>,
        chosen: &Cover,
        reached: &CoverProblem,
        candidates: &[PartSetup],
    ) -> PyResult<Bound<'py, PyDict>> {
        let area = self.samples.area();
        let alone = reached.covered_alone(&chosen.sets);
        let setups = chosen.sets.iter().zip(alone).map(|(&set, alone)| {
            let candidate = &candidates[set];
            let setup = PyDict::new(py);
            setup.set_item("up", candidate.up.to_array())?;
            let rotation = DMat3::from_quat(candidate.rotation()).transpose();
            let rotation: Bound<'py, PyArray2<f64>> = rows_of(py, rotation.to_cols_array().to_vec(), 3)?;
            setup.set_item("rotation", rotation)?;
            setup.set_item("rests", candidate.rests)?;
            setup.set_item("floor_area", candidate.floor_area)?;
            setup.set_item("directions", candidate.directions.clone())?;
            setup.set_item("reached", reached.covered(&[set]) / area)?;
            setup.set_item("alone", alone / area)?;
            Ok(setup)
        });
        let setups = setups.collect::<PyResult<Vec<_>>>()?;
        // By sample the first chosen set-up that reaches it, counted from 0; −1 for none.
        let first = |sample: usize| {
            let reaches = |&set: &usize| reached.contains(set, sample);
            chosen.sets.iter().position(reaches).map_or(-1, |at| at as i64)
        };
        let by_sample = (0..self.samples.samples.len()).map(first).collect();
        let found = PyDict::new(py);
        found.set_item("setups", setups)?;
        found.set_item("by_sample", PyArray1::from_vec(py, by_sample))?;
        found.set_item("candidates", candidates.len())?;
        found.set_item("at_least", chosen.at_least)?;
        found.set_item("reached", reached.covered(&chosen.sets) / area)?;
        let all: Vec<usize> = (0..candidates.len()).collect();
        found.set_item("reachable", reached.covered(&all) / area)?;
        Ok(found)
    }
}
