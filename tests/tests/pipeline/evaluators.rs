//! A network over a whole grid: its minimum is that of its sections.

use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::Imf;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::{SirenShape, over_grid};

use crate::scene::{bracket, orientations};

const SHAPE: SirenShape = SirenShape { width: 48, hidden: 4, skip_after: Some(2), omega: 30.0 };

#[test]
fn the_learnt_imf_is_the_least_of_the_learnt_sections() {
    let grid = bracket().record.grid;
    let mut engine = CpuEvaluator::new(SHAPE, &SHAPE.initial_parameters(7)).unwrap();
    // The second are more than one call of the engine takes, as are their values.
    for set in ["grid:5", "random:1100:3"] {
        let angles: Vec<_> = orientations(set).orientations.iter().map(Orientation::angles).collect();
        let mut minimum = Imf::new(grid.len());
        for (index, &angles) in angles.iter().enumerate() {
            let mut section = vec![f32::NAN; grid.len()];
            over_grid::section(&mut engine, &grid, angles, &mut section).unwrap();
            minimum.lower_to(index, &section);
        }
        assert!(angles.len() < 1025 || minimum.best.iter().any(|&best| best >= 1024));
        let found = over_grid::minimum(&mut engine, &grid, &angles, Control::quiet()).unwrap();
        assert_eq!(found, minimum);
    }
}
