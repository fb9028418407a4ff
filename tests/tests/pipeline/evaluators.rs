//! A network over a whole grid: its minimum is that of its sections.

use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::Imf;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::{EvaluationEngine, SirenShape, over_grid};

use crate::scene::{SMALL, bracket, orientations};

const SHAPE: SirenShape = SirenShape { width: 48, hidden: 4, skip_after: Some(2), omega: 30.0 };

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
    let mut engine = CpuEvaluator::new(SHAPE, &SHAPE.initial_parameters(7)).unwrap();
    // The second are more than one call of the engine takes, as are their values.
    for set in ["grid:5", "random:1100:3"] {
        let angles: Vec<_> = orientations(set).orientations.iter().map(Orientation::angles).collect();
        let mut minimum = Imf::new(SMALL.iter().product());
        for (index, section) in sections(&mut engine, &angles).iter().enumerate() {
            minimum.lower_to(index, section);
        }
        assert!(angles.len() < 1025 || minimum.best.iter().any(|&best| best >= 1024));
        assert_eq!(imf(&mut engine, &angles), minimum);
    }
}
