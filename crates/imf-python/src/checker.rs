//! Exact results for planners: poses and motions of a scene's tool, by [`ExactField`] and
//! [`world::Checker`](imf_core::world::Checker).

use std::sync::Arc;

use imf_core::field::{Decision, ExactField, PoseField as _};
use imf_core::glam::DVec3;
use imf_core::pose::Pose;
use imf_core::tool::{ClearanceError, ElementKind, ToolShape};
use imf_core::world::{self, MotionOptions, MotionResult};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::rows_of;
use crate::errors::{Failure, value_error};
use crate::memory;
use crate::poses::{Found, PoseRows, Poses};
use crate::scene::{Scene, clearance_of};
use crate::work::{Progress, run};

/// The tool of a scene around its part.
#[pyclass(frozen, module = "imf._imf")]
pub(crate) struct Checker {
    field: ExactField,
    checker: world::Checker,
}

/// By motion: its code, until when it is free, when it collides.
type Motions<'py> = (Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// By pose: lower and upper bound of the distance, the element's name, the nearest points of tool and obstacle.
type Distances<'py> = PyResult<(
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<String>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
)>;

/// One of these; the default is that of an invalid pose.
#[derive(Clone, Copy)]
struct Nearest {
    bounds: [f64; 2],
    element: Option<ElementKind>,
    points: [DVec3; 2],
}

impl Default for Nearest {
    fn default() -> Self {
        Self { bounds: [f64::NAN; 2], element: None, points: [DVec3::NAN; 2] }
    }
}

impl Checker {
    /// Poses of this tool.
    fn rows<'a>(&self, poses: &'a Poses<'_>) -> PyResult<PoseRows<'a>> {
        Ok(PoseRows::new(poses)?.of_round_tool(self.is_round()))
    }

    /// Lengths are those of tools of revolution.
    fn check_revolved(&self) -> PyResult<()> {
        if self.is_round() {
            return Ok(());
        }
        Err(value_error(
            "distances are of tools of revolution: describe the tool by cutter, shank and holder",
        ))
    }
}

#[pymethods]
impl Checker {
    #[new]
    fn new(py: Python<'_>, scene: &Bound<'_, Scene>, clearance: Option<[f64; 3]>) -> PyResult<Self> {
        let scene = Arc::clone(&scene.get().scene);
        let clearance = clearance.map_or(scene.record.clearance, clearance_of);
        let voxels = scene.record.grid.len() as u64;
        memory::require(26 * voxels, || {
            format!("decisions among {voxels} voxels; use a scene of a larger pitch")
        })?;
        let field = run(py, (&None, "", 0), |_| {
            let field = ExactField::of_scene(&scene, &clearance)?;
            // What decisions are made by is made at the first of them.
            let _ = field.collides(&Pose::along(scene.record.grid.origin, DVec3::Z));
            Ok::<_, ClearanceError>(field)
        })?;
        let checker = world::Checker::of_field(&field, scene.record.unit);
        Ok(Self { field, checker })
    }

    /// True where the roll about the tool's axis does not matter.
    #[getter]
    fn is_round(&self) -> bool {
        matches!(self.field.assembly().tool().shape, ToolShape::Revolved(_))
    }

    /// By pose, 0 free and 1 colliding; an invalid pose collides.
    fn classify<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Found<'py, u8> {
        self.rows(&poses)?
            .decisions(py, &progress, |poses, decisions| self.checker.classify(poses, decisions))
    }

    /// Whether one pose is free, without any of what batches need.
    fn is_free(&self, poses: Poses<'_>) -> PyResult<bool> {
        let rows = self.rows(&poses)?;
        if rows.len() != 1 {
            return Err(value_error("one pose at a time"));
        }
        Ok(self.checker.is_free(&rows.pose(0)))
    }

    /// By pose, the overlap in [0, 1].
    fn values<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Found<'py, f32> {
        self.rows(&poses)?.array(py, &progress, |poses, values| self.field.values(poses, values))
    }

    /// By pose, the signed clearance as far as it is proven.
    fn clearance<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Found<'py, f64> {
        let rows = self.rows(&poses)?;
        let field = &self.field;
        self.check_revolved()?;
        let clearance = |pose: &Pose| field.signed_clearance(pose).filter(|_| pose.is_valid());
        let found = rows.each(py, &progress, |pose| clearance(pose).unwrap_or(f64::NAN))?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// By pose, how far the tool is from the nearest solid voxel's centre, or how deep in the part.
    fn distance<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Distances<'py> {
        self.check_revolved()?;
        let (rows, checker) = (self.rows(&poses)?, &self.checker);
        let nothing = Nearest { bounds: [f64::INFINITY; 2], ..Nearest::default() };
        let found = rows.each(py, &progress, |pose| match checker.distance(pose) {
            Ok(Some(found)) => Nearest {
                bounds: [found.lower, found.upper],
                element: Some(found.element),
                points: [found.tool_point, found.obstacle_point],
            },
            Ok(None) => nothing,
            Err(_) => Nearest::default(),
        })?;
        let bound = |side: usize| PyArray1::from_iter(py, found.iter().map(|nearest| nearest.bounds[side]));
        let points = |side: usize| {
            rows_of(py, found.iter().flat_map(|nearest| nearest.points[side].to_array()).collect(), 3)
        };
        let name = |nearest: &Nearest| nearest.element.map_or_else(String::new, |kind| kind.to_string());
        let names = found.iter().map(name).collect();
        Ok((bound(0), bound(1), names, points(0)?, points(1)?))
    }

    /// By motion from a pose of `from` to that of `to`, the same rule as of a toolpath: 0 free, 1 colliding, 2 undecided.
    fn check_motion<'py>(
        &self,
        py: Python<'py>,
        from: Poses<'py>,
        to: Poses<'py>,
        progress: Progress<'py>,
    ) -> PyResult<Motions<'py>> {
        let (from, to) = (self.rows(&from)?, self.rows(&to)?);
        if from.len() != to.len() {
            return Err(value_error(format!(
                "motions need as many ends as beginnings, not {} and {}",
                to.len(),
                from.len()
            )));
        }
        let checker = &self.checker;
        let options = MotionOptions::default();
        let found = run(py, (&progress, "motions", from.len() as u64), |control| {
            let each = (0..from.len()).into_par_iter().map(|row| {
                control.check()?;
                let result = checker.check_motion(&from.pose(row), &to.pose(row), &options);
                let result =
                    result.map_err(|error| Failure(value_error(format!("motion {row}: {error}"))))?;
                (control.progress)(1);
                Ok::<_, Failure>(result)
            });
            each.collect::<Result<Vec<MotionResult>, _>>()
        })?;
        let numbers = found.into_iter().map(|result| {
            let decision = match result.first_colliding {
                Some(_) => Decision::Colliding,
                None if result.is_proven() => Decision::Free,
                None => Decision::Undecided,
            };
            let at = result.first_colliding.map_or(f64::NAN, |hit| hit.time);
            (decision as u8, (result.proven_until.min(1.0), at))
        });
        let (codes, (free_until, at)): (Vec<u8>, (Vec<f64>, Vec<f64>)) = numbers.unzip();
        Ok((PyArray1::from_vec(py, codes), PyArray1::from_vec(py, free_until), PyArray1::from_vec(py, at)))
    }
}
