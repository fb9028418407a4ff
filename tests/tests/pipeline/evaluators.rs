//! The same network on CPU and GPU: one section, one IMF, one choice of the best orientation.

use imf_core::control::Control;
use imf_core::section::Imf;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::{EvaluationEngine, SirenShape, over_grid};
use imf_gpu::{GpuEvaluator, MatrixKernel};

use crate::bits::trained;
use crate::scene::{SMALL, adapter, angles, bracket, orientations};

const SHAPE: SirenShape = SirenShape { width: 48, hidden: 4, skip_after: Some(2), omega: 30.0 };

/// The rounding of an angle of a few units is some 1e-7 and every layer passes the error of the one before on; the
/// sigmoid divides by four or more. Lavapipe is off by 8e-8 here; another device may add up and take `exp` otherwise.
const TOLERANCE: f32 = 2e-6;

fn sections(engine: &mut dyn EvaluationEngine, angles: &[[f32; 2]]) -> Vec<Vec<f32>> {
    let grid = bracket().record.grid;
    let mut section = |&angles: &[f32; 2]| {
        let mut values = vec![f32::NAN; SMALL.iter().product()];
        over_grid::section(engine, &grid, angles, &mut values).unwrap();
        values
    };
    angles.iter().map(&mut section).collect()
}

fn imf(engine: &mut dyn EvaluationEngine, angles: &[[f32; 2]]) -> Imf {
    over_grid::minimum(engine, &bracket().record.grid, angles, Control::quiet()).unwrap()
}

#[test]
fn the_learnt_imf_is_the_least_of_the_learnt_sections() {
    let mut engine = CpuEvaluator::new(SHAPE, &trained(SHAPE)).unwrap();
    // The second are more than one call of the engine takes, as are their values.
    for set in ["grid:5", "random:1100:3"] {
        let angles = angles(&orientations(set));
        let mut minimum = Imf::new(SMALL.iter().product());
        for (index, section) in sections(&mut engine, &angles).iter().enumerate() {
            minimum.lower_to(index, section);
        }
        assert!(angles.len() < 1025 || minimum.best.iter().any(|&best| best >= 1024));
        assert_eq!(imf(&mut engine, &angles), minimum);
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn cpu_and_gpu_give_the_same_sections_the_same_imf_and_the_same_best_orientation() {
    let parameters = trained(SHAPE);
    let angles = angles(&orientations("fibonacci:25"));
    let mut cpu = CpuEvaluator::new(SHAPE, &parameters).unwrap();
    let (expected, least) = (sections(&mut cpu, &angles), imf(&mut cpu, &angles));
    // How far the second-best orientation is behind.
    let lead = |voxel: usize| {
        let others = (0..angles.len()).filter(|&index| index != least.best[voxel] as usize);
        others.map(|index| expected[index][voxel]).fold(f32::INFINITY, f32::min) - least.value[voxel]
    };
    for kernel in MatrixKernel::ALL {
        let mut gpu = GpuEvaluator::new(&adapter().with_matrix_kernel(kernel), SHAPE, &parameters).unwrap();
        let mut worst = 0.0f32;
        for (found, expected) in sections(&mut gpu, &angles).iter().zip(&expected) {
            for (a, b) in found.iter().zip(expected) {
                assert!((a - b).abs() <= TOLERANCE, "{}: {a} {b}", kernel.name());
                worst = worst.max((a - b).abs());
            }
        }
        println!("{}: off by {worst:.1e}", kernel.name());
        let found = imf(&mut gpu, &angles);
        let mut decided = 0;
        for voxel in 0..least.value.len() {
            assert!((found.value[voxel] - least.value[voxel]).abs() <= TOLERANCE, "voxel {voxel}");
            if lead(voxel) > 2.0 * TOLERANCE {
                assert_eq!(found.best[voxel], least.best[voxel], "voxel {voxel}, {}", kernel.name());
                decided += 1;
            } else {
                let there = expected[found.best[voxel] as usize][voxel];
                assert!(there - least.value[voxel] <= 2.0 * TOLERANCE, "voxel {voxel}, {}", kernel.name());
            }
        }
        // Elsewhere the sigmoid has gone flat, and orientations tie within rounding.
        assert!(decided * 5 > least.value.len(), "only {decided} voxels have one best orientation");
    }
}
