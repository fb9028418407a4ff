//! What is kept and carried over: files, folded networks, the network of another part.

use super::*;

fn targets(harmonic: &HarmonicField) -> Targets<'_> {
    Targets::new(harmonic, Symmetry::default()).unwrap()
}

#[test]
fn a_folded_network_is_the_same_field_of_fewer_numbers() {
    let harmonic = harmonic();
    let plain = field(&harmonic, 40);
    let folded = plain.clone().folded();
    // 21 axes of 36 functions: 40·36 numbers in place of 21·(40 + 36), and 21 biases.
    assert_eq!(plain.parameter_count() - folded.parameter_count(), 21 * 76 + 21 - 40 * 36);
    assert_eq!(folded.clone().folded(), folded);
    let wide = field(&harmonic, 60);
    assert_eq!(wide.clone().folded(), wide, "where it takes more it is left alone");

    let set = OrientationSet::parse("random:20:4").unwrap().orientations;
    let sections = |field: &FactoredField| {
        let mut sections = vec![0.0; field.grid.len() * set.len()];
        field.evaluator().sections(&field.direction_weights(&set), &mut sections);
        sections
    };
    let expected = sections(&plain);
    assert!(expected.iter().any(|&v| v > 0.1));
    // Sums of some hundred products in f32.
    assert!(apart(&sections(&folded), &expected) < 1e-5);
    let unfolded = folded.unfolded().into_owned();
    assert!(!unfolded.shape.folded);
    assert!(apart(&sections(&unfolded), &expected) < 1e-5);
}

#[test]
fn a_folded_network_is_not_trained() {
    let folded = field(&harmonic(), 40).fold();
    let (stack, state) = (folded.shape.stack(), TrainingState::from_parameters(folded.parameters));
    let Err(error) = CpuTrainer::new(stack, AdamConfig::default(), Loss::L2, 8, state) else { panic!() };
    assert!(error.to_string().contains("evaluated, not trained"), "{error}");
}

#[test]
fn weights_turned_to_another_teacher_answer_as_before() {
    let harmonic = harmonic();
    let own = field(&harmonic, 40);
    // Another grid, all axes, a higher degree: nothing is left out.
    let mesh = ReferencePart::Teapot.mesh();
    let tool = Tool::paper();
    let spec =
        SceneSpec { margin: 1, ..SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [16, 22, 29], &tool) };
    let other = spec.scene().unwrap();
    let richer = FitSettings { degree: 6, components: usize::MAX, ..FIT };
    let richer = fit(&plan(&other), Domain::Directions, &richer, Control::quiet()).unwrap();
    let shape = FactoredShape { components: richer.component_count(), ..own.shape };
    let parameters = parameters_for(&own, &richer, &targets(&richer)).unwrap();
    let turned = FactoredField::new(&richer, shape, parameters).unwrap();
    let folded = parameters_for(&own.clone().fold(), &richer, &targets(&richer)).unwrap();
    let worst = apart(&folded, &turned.parameters);
    assert!(worst < 1e-5, "a folded network is turned as it was: {worst}");
    assert_ne!((turned.grid, turned.scale), (own.grid, own.scale));
    let (before, after) = (own.evaluator(), turned.evaluator());
    let mut scratch = PointScratch::default();
    let mut spread = 0.0f32;
    for (index, orientation) in OrientationSet::parse("random:30:8").unwrap().orientations.iter().enumerate()
    {
        let fraction = DVec3::new(0.618, 0.755, 0.57) * (index as f64 + 0.5);
        let position = own.grid.origin + own.grid.size() * (0.15 + 0.7 * fraction.fract());
        let mut at = |evaluator: &FactoredEvaluator<'_>| {
            let direction = orientation.direction();
            evaluator.overlap_with_gradient(position, direction, &mut scratch).unwrap().value
        };
        let (expected, found) = (at(&before), at(&after));
        // Sums of some hundred products in f32, through sines of a frequency of 8.
        assert!((found - expected).abs() < 5e-5, "{position}: {found}, not {expected}");
        spread = spread.max(expected.abs());
    }
    assert!(spread > 0.01, "a field that is not zero everywhere");
    let start = start_from(&own, &richer, &other.obstacle).unwrap();
    let solved = FactoredField::new(&richer, shape, start.training.parameters).unwrap();
    let [solved, turned] = [&solved, &turned].map(|field| error(field, &richer));
    assert!(solved < 0.5 * turned, "with its best last layer {solved}, as it was {turned}");
    // With fewer axes it is what these leave of it: still closer than nothing.
    let worst = apart(&parameters_for(&own, &harmonic, &targets(&harmonic)).unwrap(), &own.parameters);
    assert!(worst < 1e-4, "to its own harmonic nothing changes: {worst}");
}
