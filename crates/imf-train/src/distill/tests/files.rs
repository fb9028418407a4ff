//! What is kept and carried over: files, folded networks, the network of another part.

use super::*;

fn targets(harmonic: &HarmonicField) -> Targets<'_> {
    Targets::new(harmonic, Symmetry::default()).unwrap()
}

#[test]
fn a_folded_network_is_the_same_field_of_fewer_numbers() {
    let scene = scene();
    let plain = field(&harmonic(&scene), 40);
    let folded = plain.clone().folded();
    // 21 axes of 36 functions: 40·36 numbers in place of 21·(40 + 36), and 21 biases.
    assert_eq!(plain.parameter_count() - folded.parameter_count(), 21 * 76 + 21 - 40 * 36);
    assert_eq!(folded.clone().folded(), folded);
    let wide = field(&harmonic(&scene), 60);
    assert_eq!(wide.clone().folded(), wide, "where it takes more it is left alone");

    let set = OrientationSet::parse("random:20:4").unwrap().orientations;
    let sections = |field: &FactoredField| {
        let mut sections = vec![0.0; field.grid.len() * set.len()];
        field.evaluator().sections(&field.direction_weights(&set), &mut sections);
        sections
    };
    let expected = sections(&plain);
    let worst = |found: Vec<f32>| found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(expected.iter().any(|&v| v > 0.1));
    // Sums of some hundred products in f32.
    assert!(worst(sections(&folded)) < 1e-5);
    let unfolded = folded.unfolded().into_owned();
    assert!(!unfolded.shape.folded);
    assert!(worst(sections(&unfolded)) < 1e-5);
}

#[test]
fn a_folded_network_is_not_trained() {
    let scene = scene();
    let folded = field(&harmonic(&scene), 40).fold();
    let state = FactoredState::from_parameters(folded.parameters.clone());
    let plan = TrainingPlan::default();
    let Err(error) = engine::cpu_engine(folded.shape, &plan, Optimiser::Adam, 8, &state) else { panic!() };
    assert!(error.to_string().contains("evaluated, not trained"), "{error}");
}

#[test]
fn files_read_back_bit_for_bit_and_damage_is_named() {
    let scene = scene();
    let harmonic = harmonic(&scene);
    let axes = harmonic.axis_count();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    let [adam, soap] = OPTIMISERS;
    for (optimiser, precision, resumable, folded) in [
        (adam, Precision::F32, true, false),
        (soap, Precision::F32, true, false),
        (adam, Precision::F32, false, false),
        (soap, Precision::F16, false, false),
        (adam, Precision::F32, false, true),
        (soap, Precision::F16, false, true),
    ] {
        let settings = DistillSettings { optimiser, ..settings(8) };
        let mut state = settings.start(axes);
        distil(&harmonic, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
        let field =
            FactoredField::new(&harmonic, settings.shape(axes), state.training.parameters.clone()).unwrap();
        let mut file = FactoredFile {
            field: if folded { field.fold() } else { field },
            scene: Scene::from_union(scene.record.clone(), scene.obstacle.clone()),
            fit: FIT,
            report: harmonic.report,
            settings,
            precision,
            state: resumable.then_some(state),
            calibration: None,
        };
        file.write(&path).unwrap();
        assert!(FactoredFile::is_one(&path));
        let read = FactoredFile::read(&path).unwrap();
        if precision == Precision::F16 {
            let FactoredField { parameters, axes, .. } = &mut file.field;
            let axes = axes.iter_mut().filter(|_| folded);
            parameters.iter_mut().chain(axes).for_each(|w| *w = half::f16::from_f32(*w).to_f32());
        }
        assert_eq!(read, file);
        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let error = FactoredFile::read(&path).unwrap_err();
            assert!(error.to_string().contains("field.safetensors"), "{error}");
        }
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        for place in [header + 11, (header + bytes.len()) / 2, bytes.len() - 3] {
            let mut flipped = bytes.clone();
            flipped[place] ^= 0x10;
            std::fs::write(&path, flipped).unwrap();
            let error = FactoredFile::read(&path).unwrap_err();
            assert!(matches!(error, FieldFileError::Damaged { .. }), "byte {place}: {error}");
        }
        let text = std::str::from_utf8(&bytes[8..header]).unwrap();
        let newer = text.replacen(r#"\"version\":1"#, r#"\"version\":9"#, 1);
        let other = [&bytes[..8], newer.as_bytes(), &bytes[header..]].concat();
        std::fs::write(&path, other).unwrap();
        assert!(matches!(FactoredFile::read(&path), Err(FieldFileError::Newer { found: 9, .. })));
    }
    assert!(matches!(FactoredFile::read(&folder.path().join("none")), Err(FieldFileError::Read { .. })));
}

#[test]
fn weights_turned_to_another_teacher_answer_as_before() {
    let scene = scene();
    let own = field(&harmonic(&scene), 40);
    // Another grid, all axes, a higher degree: nothing is left out.
    let mesh = ReferencePart::Teapot.mesh();
    let tool = Tool::paper();
    let spec =
        SceneSpec { margin: 1, ..SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [16, 22, 29], &tool) };
    let other = spec.scene().unwrap();
    let plan = SectionPlan::new(&other.obstacle, &other.record.tool, ToolPoints::SharpPoints).unwrap();
    let richer = FitSettings { degree: 6, axes: usize::MAX, ..FIT };
    let richer = fit(&plan, Domain::Directions, &richer, Control::quiet()).unwrap();
    let shape = FactoredShape { axes: richer.axis_count(), ..own.shape };
    let turned =
        FactoredField::new(&richer, shape, parameters_for(&own, &richer, &targets(&richer)).unwrap())
            .unwrap();
    let folded = parameters_for(&own.clone().fold(), &richer, &targets(&richer)).unwrap();
    let worst = folded.iter().zip(&turned.parameters).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
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
    let same = {
        let harmonic = harmonic(&scene);
        parameters_for(&own, &harmonic, &targets(&harmonic)).unwrap()
    };
    let worst = same.iter().zip(&own.parameters).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-4, "to its own harmonic nothing changes: {worst}");
}
