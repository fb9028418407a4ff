//! The interface of whatever evaluates a network in batches, the CPU or a GPU, and networks at all voxel centres of a grid.

use super::{INPUTS, features};
use imf_core::control::Control;
use imf_core::field::{EngineError, FieldError};
use imf_core::grid::Grid;
use imf_core::section::Imf;

/// Where a trained network is evaluated in batches.
pub trait EvaluationEngine {
    /// The engine's name for people: device, driver, threads.
    fn describe(&self) -> String;

    /// Values of the network at `inputs` (`[n][5]`, any n) into `outputs` (`[n]`).
    ///
    /// # Errors
    /// Lengths that do not fit, or a device that failed.
    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError>;

    /// About how many values to compute between two checks for cancellation: some seconds' work of a large network.
    fn values_at_once(&self) -> usize {
        1 << 18
    }

    /// For each point the minimum over all directions and the index of the first direction that attains it.
    ///
    /// `points` is `[n][3]` in unit coordinates of the grid, `directions` is `[m][2]` in degrees (θ, φ); `least` and
    /// `best` are `[n]`. The minimum is taken where the network runs: memory does not grow with n·m.
    ///
    /// # Errors
    /// Lengths that do not fit, no direction, or a device that failed.
    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError>;
}

/// What [`EvaluationEngine::evaluate`] refuses.
///
/// # Errors
/// Lengths that do not fit.
pub fn check_evaluate(inputs: &[f32], outputs: &[f32]) -> Result<(), EngineError> {
    let (inputs, outputs) = (inputs.len(), outputs.len());
    if inputs == outputs * INPUTS {
        return Ok(());
    }
    Err(EngineError::Shape(format!("{inputs} inputs for {outputs} values; {INPUTS} belong to each")))
}

/// What [`EvaluationEngine::minimum`] refuses.
///
/// # Errors
/// Lengths that do not fit, or no direction.
pub fn check_minimum(
    points: &[[f32; 3]],
    directions: &[[f32; 2]],
    least: &[f32],
    best: &[u32],
) -> Result<(), EngineError> {
    let (points, directions) = (points.len(), directions.len());
    let (least, best) = (least.len(), best.len());
    if least != points || best != points {
        let what = format!("{points} points, but room for {least} minima and {best} indices");
        return Err(EngineError::Shape(what));
    }
    if directions == 0 || u32::try_from(directions).is_err() {
        let what = format!("a minimum over {directions} directions; it takes 1 to 2^32 − 1");
        return Err(EngineError::Shape(what));
    }
    Ok(())
}

/// Voxels that are made inputs at a time.
const CHUNK: usize = 1 << 16;

/// Directions that a minimum is taken over in one call of an engine, at most.
const DIRECTIONS: usize = 1024;

/// Values at all voxel centres for one angle pair in degrees, C-ordered into `values`.
///
/// # Errors
/// A device that failed.
///
/// # Panics
/// If `values` has not the grid's length.
pub fn section(
    engine: &mut dyn EvaluationEngine,
    grid: &Grid,
    angles: [f32; 2],
    values: &mut [f32],
) -> Result<(), EngineError> {
    assert_eq!(values.len(), grid.len(), "one value for each voxel");
    let mut inputs = Vec::new();
    for (chunk, out) in values.chunks_mut(CHUNK).enumerate() {
        inputs.clear();
        for index in chunk * CHUNK..chunk * CHUNK + out.len() {
            let unit = grid.unit(grid.centre(grid.voxel(index))).as_vec3().to_array();
            inputs.extend_from_slice(&features(unit, angles[0], angles[1]));
        }
        engine.evaluate(&inputs, out)?;
    }
    Ok(())
}

/// Minimum and index of the first direction that has it, at all voxel centres. One unit of progress is one value.
///
/// # Errors
/// A device that failed, or no direction; [`FieldError::Cancelled`] when the control asks to stop.
pub fn minimum(
    engine: &mut dyn EvaluationEngine,
    grid: &Grid,
    directions: &[[f32; 2]],
    control: Control<'_>,
) -> Result<Imf, FieldError> {
    minimum_at(engine, &points(grid, 0..grid.len()), directions, control)
}

/// Centres of some voxels in unit coordinates.
pub fn points(grid: &Grid, voxels: impl IntoIterator<Item = usize>) -> Vec<[f32; 3]> {
    voxels.into_iter().map(|index| grid.unit(grid.centre(grid.voxel(index))).as_vec3().to_array()).collect()
}

/// As [`minimum`], at [`points`].
///
/// # Errors
/// As [`minimum`].
pub fn minimum_at(
    engine: &mut dyn EvaluationEngine,
    points: &[[f32; 3]],
    directions: &[[f32; 2]],
    control: Control<'_>,
) -> Result<Imf, FieldError> {
    let mut found = Imf::new(points.len());
    let some = engine.values_at_once().div_ceil(directions.len().clamp(1, DIRECTIONS));
    let (mut least, mut best) = (vec![0.0; some.min(points.len())], vec![0; some.min(points.len())]);
    let parts = points.chunks(some).zip(found.value.chunks_mut(some)).zip(found.best.chunks_mut(some));
    for ((points, lowest), chosen) in parts {
        let (least, best) = (&mut least[..points.len()], &mut best[..points.len()]);
        // Without any the engine says so.
        let groups = directions.chunks(DIRECTIONS).chain(directions.is_empty().then_some(directions));
        for (first, directions) in (0..).step_by(DIRECTIONS).zip(groups) {
            control.check()?;
            engine.minimum(points, directions, least, best)?;
            for ((lowest, chosen), (least, best)) in
                lowest.iter_mut().zip(chosen.iter_mut()).zip(least.iter().zip(best.iter()))
            {
                if first == 0 || least < lowest {
                    (*lowest, *chosen) = (*least, first + best);
                }
            }
            (control.progress)((points.len() * directions.len()) as u64);
        }
    }
    Ok(found)
}
