//! Poses as NumPy has them: one row each, of a tip and an axis, or of a tip and a quaternion; and batches of them on all threads.

use glam::{DQuat, DVec3};
use imf_core::control::Control;
use imf_core::field::{Decision, FieldError};
use imf_core::pose::Pose;
use numpy::{Element, PyArray1, PyReadonlyArray2, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::errors::value_error;
use crate::work::{Progress, run};

/// An array of poses.
pub(crate) type Poses<'py> = PyReadonlyArray2<'py, f64>;

/// What was found, one by pose.
pub(crate) type Found<'py, T> = PyResult<Bound<'py, PyArray1<T>>>;

/// Poses that a thread converts and evaluates at a time.
const CHUNK: usize = 256;

/// Rows of poses where they lie.
#[derive(Clone, Copy)]
pub(crate) struct PoseRows<'a> {
    numbers: &'a [f64],
    width: usize,
    /// The roll about the tool's axis does not matter.
    round: bool,
}

impl<'a> PoseRows<'a> {
    /// Of an array `[n, 6]` (x, y, z and the axis from tip to holder) or `[n, 7]` (x, y, z and a quaternion x, y, z, w).
    ///
    /// # Errors
    /// Another shape, or an array that is not contiguous.
    pub(crate) fn new(array: &'a Poses<'_>) -> PyResult<Self> {
        let [count, width] = [array.shape()[0], array.shape()[1]];
        if width != 6 && width != 7 {
            return Err(value_error(format!(
                "poses must have the shape (n, 6), x, y, z and the axis from tip to holder, or (n, 7), x, y, z and a quaternion \
                 x, y, z, w; not ({count}, {width})"
            )));
        }
        let numbers = array.as_slice().map_err(|error| value_error(format!("poses: {error}")))?;
        Ok(Self { numbers, width, round: false })
    }

    /// For a tool of revolution: an axis is reached by any turn, which is found faster than the one without roll.
    pub(crate) fn of_round_tool(self, round: bool) -> Self {
        Self { round, ..self }
    }

    /// Quaternions say how the tool is rolled about its axis.
    pub(crate) fn say_roll(&self) -> bool {
        self.width == 7
    }

    pub(crate) fn len(&self) -> usize {
        self.numbers.len() / self.width
    }

    /// One pose.
    pub(crate) fn pose(&self, row: usize) -> Pose {
        let numbers = &self.numbers[row * self.width..][..self.width];
        let tip = DVec3::from_slice(numbers);
        match numbers[3..] {
            [x, y, z, w] => Pose::new(tip, DQuat::from_xyzw(x, y, z, w)),
            _ if self.round => Pose::new(tip, turn_to(DVec3::from_slice(&numbers[3..]))),
            _ => Pose::along(tip, DVec3::from_slice(&numbers[3..])),
        }
    }

    /// Results for all poses, `answer` for some at a time, on all threads of the current pool. One unit of progress
    /// is one pose.
    fn answers<T: Copy + Default + Send>(
        self,
        control: Control<'_>,
        answer: impl Fn(&[Pose], &mut [T]) -> Result<(), FieldError> + Sync,
    ) -> Result<Vec<T>, FieldError> {
        let mut answers = vec![T::default(); self.len()];
        let chunks = answers.par_chunks_mut(CHUNK).enumerate();
        chunks.try_for_each_init(Vec::new, |poses, (chunk, answers)| -> Result<(), FieldError> {
            control.check()?;
            let first = chunk * CHUNK;
            poses.clear();
            poses.extend((first..first + answers.len()).map(|row| self.pose(row)));
            answer(poses, answers)?;
            (control.progress)(answers.len() as u64);
            Ok(())
        })?;
        Ok(answers)
    }

    /// [`PoseRows::answers`] without the interpreter's lock.
    pub(crate) fn found<T: Copy + Default + Send>(
        self,
        py: Python<'_>,
        progress: &Progress<'_>,
        answer: impl Fn(&[Pose], &mut [T]) -> Result<(), FieldError> + Sync + Send,
    ) -> PyResult<Vec<T>> {
        run(py, (progress, "poses", self.len() as u64), |control| self.answers(control, answer))
    }

    /// The same, pose by pose, of what takes so long that each may be cancelled.
    pub(crate) fn each<T: Copy + Default + Send>(
        self,
        py: Python<'_>,
        progress: &Progress<'_>,
        answer: impl Fn(&Pose) -> T + Sync + Send,
    ) -> PyResult<Vec<T>> {
        run(py, (progress, "poses", self.len() as u64), |control| {
            self.answers(control, |poses, found| {
                poses.iter().zip(found).try_for_each(|(pose, found)| {
                    control.check()?;
                    *found = answer(pose);
                    Ok(())
                })
            })
        })
    }

    /// [`PoseRows::found`] as an array.
    pub(crate) fn array<'py, T: Copy + Default + Send + Element>(
        self,
        py: Python<'py>,
        progress: &Progress<'py>,
        answer: impl Fn(&[Pose], &mut [T]) -> Result<(), FieldError> + Sync + Send,
    ) -> Found<'py, T> {
        Ok(PyArray1::from_vec(py, self.found(py, progress, answer)?))
    }

    /// The same of decisions, as numbers.
    pub(crate) fn decisions<'py>(
        self,
        py: Python<'py>,
        progress: &Progress<'py>,
        classify: impl Fn(&[Pose], &mut [Decision]) -> Result<(), FieldError> + Sync + Send,
    ) -> Found<'py, u8> {
        self.array(py, progress, |poses, codes| {
            let mut decisions = [Decision::Undecided; CHUNK];
            let decisions = &mut decisions[..poses.len()];
            classify(poses, decisions)?;
            decisions.iter().zip(codes).for_each(|(decision, out)| *out = *decision as u8);
            Ok(())
        })
    }
}

/// A quaternion of length 1, as batches take it, that brings +z to an axis; NaN for one of no length: about the middle of the two, or of −z and the axis after half a turn about x,
/// whichever is farther from opposite.
fn turn_to(axis: DVec3) -> DQuat {
    let DVec3 { x, y, z } = axis;
    let across = x * x + y * y;
    let most = (across + z * z).sqrt() + z.abs();
    let scale = 1.0 / (across + most * most).sqrt();
    // Chosen number by number: a branch would be guessed wrongly every other time.
    let up = z >= 0.0;
    let (first, last) = if up { (-y, most) } else { (most, -y) };
    let (second, third) = if up { (x, 0.0) } else { (0.0, x) };
    DQuat::from_xyzw(first * scale, second * scale, third * scale, last * scale)
}
