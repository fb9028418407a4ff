//! Random voxels, at which a wide network is evaluated where whole grids would take hours.

use imf_core::control::Control;
use imf_core::field::FieldError;
use imf_core::grid::Grid;
use imf_fields::metrics::{ErrorReport, Errors};
use imf_fields::siren::EvaluationEngine;
use imf_fields::siren::over_grid;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

/// Some voxels of a grid, each once, the same ones every time.
pub(super) struct VoxelSample {
    voxels: Vec<usize>,
    points: Vec<[f32; 3]>,
    /// Of the grid's voxels.
    share: f64,
}

impl VoxelSample {
    pub(super) fn of(grid: &Grid, share: f64) -> Self {
        let count = ((grid.len() as f64 * share).round() as usize).clamp(1, grid.len());
        let mut all: Vec<usize> = (0..grid.len()).collect();
        let mut voxels = all.partial_shuffle(&mut ChaCha8Rng::seed_from_u64(0), count).0.to_vec();
        voxels.sort_unstable();
        let points = over_grid::points(grid, voxels.iter().copied());
        Self { voxels, points, share: count as f64 / grid.len() as f64 }
    }

    pub(super) fn len(&self) -> usize {
        self.voxels.len()
    }

    /// The minimum of a network over some directions at each of them.
    pub(super) fn minimum(
        &self,
        engine: &mut dyn EvaluationEngine,
        directions: &[[f32; 2]],
        control: Control<'_>,
    ) -> Result<Vec<f32>, FieldError> {
        Ok(over_grid::minimum_at(engine, &self.points, directions, control)?.value)
    }

    /// A whole section's values at these voxels.
    pub(super) fn of_section(&self, section: &[f32]) -> Vec<f32> {
        self.voxels.iter().map(|&voxel| section[voxel]).collect()
    }

    /// Errors of `learnt`, and the standard error of the mean squared one as an estimate of the whole grid's.
    pub(super) fn errors(&self, exact: &[f32], learnt: &[f32], threshold: f64) -> (ErrorReport, f64) {
        let exact = self.of_section(exact);
        let mut errors = Errors::default();
        errors.add(&exact, learnt, threshold);
        let report = errors.report(threshold);
        let squares = exact.iter().zip(learnt).map(|(e, l)| (f64::from(*e) - f64::from(*l)).powi(2));
        let n = self.voxels.len() as f64;
        let variance = squares.map(|square| (square - report.mse).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        // Drawn without putting back: the whole grid leaves no error.
        (report, (variance / n * (1.0 - self.share)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::glam::DVec3;

    #[test]
    fn a_share_of_the_voxels_estimates_the_whole_grid_within_its_standard_error() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [20, 30, 40] };
        let exact = vec![0.25; grid.len()];
        let learnt: Vec<f32> = (0..grid.len()).map(|i| 0.25 + (i * 37 % 101) as f32 * 1e-4).collect();
        let whole = VoxelSample::of(&grid, 1.0);
        let (all, none) = whole.errors(&exact, &learnt, 0.0);
        assert_eq!((whole.len(), none), (grid.len(), 0.0));
        let some = VoxelSample::of(&grid, 0.1);
        assert_eq!(some.len(), 2400);
        assert!(some.voxels.windows(2).all(|pair| pair[0] < pair[1]));
        let (report, error) = some.errors(&exact, &some.of_section(&learnt), 0.0);
        assert_eq!(report.count, 2400);
        assert!(
            error > 0.0 && (report.mse - all.mse).abs() < 4.0 * error,
            "{} {} {error}",
            report.mse,
            all.mse
        );
        // Of a uniform error the squares deviate by 0.3 of the largest: the estimate is that good.
        assert!(error < 0.02 * all.mse);
    }
}
