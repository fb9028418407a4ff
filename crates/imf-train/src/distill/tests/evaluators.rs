//! Evaluators that take over other weights, and those of weights in f16.

use super::*;
use imf_core::orientation::Orientation;

#[test]
fn an_evaluator_that_takes_over_other_weights_is_one_of_these() {
    let teacher = teacher(&scene());
    let shape = settings(1).shape(teacher.axis_count());
    let field = |seed| FactoredField::new(&teacher, shape, shape.initial_parameters(seed)).unwrap();
    let rounded = {
        let parameters = field(7).parameters.iter().map(|&w| half::f16::from_f32(w).to_f32()).collect();
        FactoredField { parameters, ..field(7) }
    };
    let mut evaluator = field(3).into_evaluator();
    let inputs = numbers(200 * INPUTS, 4);
    let point = scene().record.grid.centre([4, 9, 20]);
    let orientation = Orientation::new(40.0, 70.0);
    // Weights that are halves, and so kept twice, before and after others that are not.
    for field in [rounded.clone(), field(5), rounded] {
        evaluator.set_parameters(field.parameters.clone());
        let fresh = field.evaluator();
        let answers = |evaluator: &FactoredEvaluator<'_>| {
            let mut out = vec![f32::NAN; 200 * shape.axes];
            evaluator.outputs(&inputs, &mut out);
            (out, evaluator.overlap(point, &orientation, &mut PointScratch::default()))
        };
        assert_eq!(answers(&evaluator), answers(&fresh));
        assert_eq!(evaluator.halves.is_some(), fresh.halves.is_some());
    }
}

#[test]
fn weights_kept_in_f16_answer_the_same_bits_from_half_the_bytes() {
    let scene = scene();
    // Widths that end panels and registers early.
    let fields = [40, 67, 96].map(|width| field(&teacher(&scene), width));
    for mut field in fields.iter().cloned().chain(fields.iter().cloned().map(FactoredField::fold)) {
        assert!(field.evaluator().halves.is_none(), "random weights need all of f32");
        field.parameters.iter_mut().for_each(|w| *w = half::f16::from_f32(*w).to_f32());
        let fast = field.evaluator();
        if matches!(fast.arch, pulp::Arch::Scalar) || fast.halves.is_none() {
            assert!(!is_avx512(fast.arch), "AVX-512 widens f16");
            continue;
        }
        let mut plain = field.evaluator();
        plain.halves = None;
        let (mut of_fast, mut of_plain) = (PointScratch::default(), PointScratch::default());
        for (index, orientation) in
            OrientationSet::parse("random:40:9").unwrap().orientations.iter().enumerate()
        {
            let fraction = DVec3::new(0.618, 0.755, 0.57) * (index as f64 + 0.5);
            let position = field.grid.origin + field.grid.size() * (0.1 + 0.8 * fraction.fract());
            let direction = orientation.direction();
            assert_eq!(
                fast.overlap_with_gradient(position, direction, &mut of_fast),
                plain.overlap_with_gradient(position, direction, &mut of_plain)
            );
            assert_eq!(
                fast.overlap(position, orientation, &mut of_fast),
                plain.overlap(position, orientation, &mut of_plain)
            );
        }
    }
}

fn is_avx512(arch: pulp::Arch) -> bool {
    format!("{arch:?}").starts_with("V4")
}
