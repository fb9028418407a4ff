//! Fields of every direction as Python holds them: read from files of any family, or trained.

use std::path::Path;

use glam::{DQuat, DVec3};
use imf_core::field::{Best, FieldError, Gradient, PoseField as _};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::tool::{Clearance, ClearanceError, ToolShape};
use imf_fields::field::{self, LoadError};
use imf_fields::file::FieldFile;
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::rows_of;
use crate::errors::{Raise, value_error};
use crate::poses::{Found, PoseRows, Poses};
use crate::scene::Scene;
use crate::sections::DirectionsInput;
use crate::tool::Tool;
use crate::train::with_room;
use crate::work::{Progress, detached, run};

/// A field, and its file, which it can be saved to again.
#[pyclass(frozen, module = "imf._imf")]
pub(crate) struct Field {
    field: field::Field,
    file: FieldFile,
}

/// Value, and change with the position, with the axis and with a rotation vector.
type Gradients<'py> = PyResult<(
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
)>;

/// Value, place in the list and decision of the best direction.
type BestOf<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u8>>);

impl Field {
    /// Of a file that was read or made.
    pub(crate) fn new(file: FieldFile) -> Result<Self, LoadError> {
        Ok(Self { field: field::Field::new(file.clone())?, file })
    }
}

#[pymethods]
impl Field {
    /// Reads a field of any family.
    #[staticmethod]
    fn load(py: Python<'_>, path: &str) -> PyResult<Self> {
        run(py, (&None, "", 0), |_| Self::new(FieldFile::read(Path::new(path))?))
    }

    /// Writes it whole or not at all.
    fn save(&self, py: Python<'_>, path: &str) -> PyResult<()> {
        run(py, (&None, "", 0), |_| self.file.write(Path::new(path)))
    }

    /// Its family.
    #[getter]
    fn family(&self) -> &'static str {
        self.file.family()
    }

    /// What its values are.
    #[getter]
    fn quantity(&self) -> &'static str {
        match self.field.quantity() {
            Quantity::Overlap => "overlap",
            Quantity::Depth => "depth",
        }
    }

    /// The part's name.
    #[getter]
    fn part(&self) -> &str {
        &self.field.scene().record.part
    }

    /// Unit of lengths.
    #[getter]
    fn unit(&self) -> String {
        self.field.scene().record.unit.to_string()
    }

    /// Lower corner, pitch and dims of its grid.
    #[getter]
    fn grid(&self) -> ([f64; 3], f64, [usize; 3]) {
        let grid = &self.field.scene().record.grid;
        (grid.origin.to_array(), grid.pitch, grid.dims)
    }

    /// Lower and upper corner of the box where it is defined.
    #[getter]
    fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        self.field.bounds().map(|bounds| bounds.map(DVec3::into))
    }

    /// The quality of its decisions, in a sentence; `None` where it was not measured.
    #[getter]
    fn verdict(&self) -> Option<String> {
        self.field.calibration().map(|calibration| calibration.verdict().to_string())
    }

    /// Lower and upper bound of its values.
    #[getter]
    fn range(&self) -> [f64; 2] {
        self.field.quantity().bounds(self.field.scene().record.grid.pitch)
    }

    /// The tool without clearance.
    #[getter]
    fn tool(&self) -> Tool {
        Tool(self.field.scene().record.bare_tool().clone())
    }

    /// Room around holder, shank and cutter.
    #[getter]
    fn clearance(&self) -> [f64; 3] {
        let Clearance { holder, shank, cutter } = self.field.scene().record.clearance;
        [holder, shank, cutter]
    }

    /// How deep the cutter may reach below the part's surface.
    #[getter]
    fn contact(&self) -> Option<f64> {
        self.field.scene().record.contact
    }

    /// The fixtures' names.
    #[getter]
    fn fixtures(&self) -> Vec<String> {
        self.field.scene().record.fixtures.clone()
    }

    /// Whether a training of this scene makes a field of the same values.
    fn is_of(&self, py: Python<'_>, scene: &Bound<'_, Scene>) -> PyResult<bool> {
        let (own, other) = (self.field.scene(), &scene.get().scene);
        let same = detached(py, || {
            // A training of depths gives room to a scene without clearance.
            let quantity =
                if own.record.clearance.is_zero() { Quantity::Overlap } else { self.field.quantity() };
            Ok::<_, ClearanceError>(own.differences(&with_room(other, quantity)?).is_empty())
        })?;
        same.map_err(Raise::raise)
    }

    /// Whether the roll about its axis changes nothing: values are those of the tip.
    #[getter]
    fn is_round(&self) -> bool {
        matches!(self.field.scene().record.bare_tool().shape, ToolShape::Revolved(_))
    }

    /// True where the tool's roll counts, and directions do not say it.
    fn lacks_roll(&self, py: Python<'_>, directions: DirectionsInput<'_>) -> PyResult<bool> {
        Ok(!self.is_round() && directions.lack_roll(py, OrientationSet::parse)?)
    }

    /// Root mean square error of the harmonic fit at orientations that were not fitted; none of siren5.
    #[getter]
    fn fit_error(&self) -> Option<f64> {
        let report = match &self.file {
            FieldFile::Harmonic(file) => &file.field.report,
            FieldFile::Factored(file) => &file.report,
            FieldFile::Siren(_) => return None,
        };
        Some(report.validation.mse.sqrt())
    }

    /// What its network is reduced by, in words; none of other families, and where there is no symmetry.
    #[getter]
    fn symmetry(&self) -> Option<String> {
        let FieldFile::Factored(file) = &self.file else { return None };
        let symmetry = file.field.shape.symmetry;
        (!symmetry.is_none()).then(|| symmetry.to_string())
    }

    /// By pose, the value.
    fn values<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Found<'py, f32> {
        PoseRows::new(&poses)?.array(py, &progress, |poses, values| self.field.values(poses, values))
    }

    /// By pose, the value and its derivatives.
    fn gradients<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Gradients<'py> {
        let answer = |poses: &[Pose], numbers: &mut [[f32; 10]]| {
            let mut gradients = vec![Gradient::NAN; poses.len()];
            self.field.gradients(poses, &mut gradients)?;
            for (Gradient { value, position, direction, rotation }, out) in gradients.iter().zip(numbers) {
                out[0] = *value;
                [position, direction, rotation]
                    .iter()
                    .zip(out[1..].chunks_exact_mut(3))
                    .for_each(|(vector, out)| out.copy_from_slice(&vector.to_array()));
            }
            Ok(())
        };
        let found = PoseRows::new(&poses)?.found(py, &progress, answer)?;
        let vectors = |first: usize| {
            let numbers = found.iter().flat_map(|row| row[first..first + 3].iter().copied()).collect();
            rows_of(py, numbers, 3)
        };
        let values = found.iter().map(|row| row[0]).collect();
        Ok((PyArray1::from_vec(py, values), vectors(1)?, vectors(4)?, vectors(7)?))
    }

    /// By pose, 0 free, 1 colliding, 2 undecided.
    fn classify<'py>(&self, py: Python<'py>, poses: Poses<'py>, progress: Progress<'py>) -> Found<'py, u8> {
        PoseRows::new(&poses)?
            .decisions(py, &progress, |poses, decisions| self.field.classify(poses, decisions))
    }

    /// At every point `[n, 3]` the best of directions.
    fn best<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        directions: DirectionsInput<'py>,
        progress: Progress<'py>,
    ) -> PyResult<BestOf<'py>> {
        let points = points.as_array();
        if points.ncols() != 3 {
            return Err(value_error(format!("points must have the shape (n, 3), not {:?}", points.dim())));
        }
        let point = |row: ArrayView1<'_, f64>| DVec3::new(row[0], row[1], row[2]);
        let points: Vec<DVec3> = points.rows().into_iter().map(point).collect();
        let set = directions.by(py, OrientationSet::parse)?;
        let rotations: Vec<DQuat> = set.orientations.iter().map(Orientation::quaternion).collect();
        let found = run(py, (&progress, "points", points.len() as u64), |control| {
            let mut best = vec![Best::NONE; points.len()];
            // 4,096 points at a time, on all threads.
            let chunks = best.chunks_mut(4096).zip(points.chunks(4096));
            chunks.collect::<Vec<_>>().into_par_iter().try_for_each(|(best, points)| {
                control.check()?;
                self.field.best(points, &rotations, best)?;
                (control.progress)(points.len() as u64);
                Ok::<_, FieldError>(())
            })?;
            Ok::<_, FieldError>(best)
        })?;
        let values = found.iter().map(|best| best.value).collect();
        let places = found.iter().map(|best| best.orientation).collect();
        let codes = found.iter().map(|best| best.decision as u8).collect();
        Ok((PyArray1::from_vec(py, values), PyArray1::from_vec(py, places), PyArray1::from_vec(py, codes)))
    }
}
