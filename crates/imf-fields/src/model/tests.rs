use super::*;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::tool::Tool;

fn model() -> Model {
    let mesh = ReferencePart::Bracket.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [5, 15, 9], &tool);
    let shape = SirenShape { width: 7, hidden: 3, ..SirenShape::default() };
    let mut state = TrainingState::new(&shape, 1);
    state.step = 12;
    state.first_moment[3] = 0.1;
    let record = TrainingRecord {
        program: "0".into(),
        plan: TrainingPlan::default(),
        cursor: Cursor { epoch: 1, step: 2 },
        watch: seen(),
        finished: false,
        steps: 12,
        seconds: 0.1,
        engine: "test".into(),
        orientations: OrientationSet::parse("fibonacci:3").unwrap(),
        sampling: Sampling::default(),
        samples: 100,
        dataset_crc32: 7,
        groups_per_epoch: None,
        fine_tuned_from: None,
        losses: vec![LossPoint { step: 12, loss: 0.3 }],
        pending_loss: (0.1, 3),
        held_out: None,
    };
    Model { shape, scene: spec.scene().unwrap(), record, state, calibration: None }
}

/// Of some losses.
fn seen() -> Watch {
    let mut watch = Watch::default();
    for report in 1..8 {
        watch.observe(50 * report, 50, 0.1 / report as f64);
    }
    watch
}

#[test]
fn models_read_back_bit_for_bit_with_and_without_moments() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.safetensors");
    for model in [model(), model().without_moments()] {
        model.write(&path).unwrap();
        assert_eq!(Model::read(&path).unwrap(), model);
        let bytes = std::fs::read(&path).unwrap();
        model.write(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
    }
}

#[test]
fn a_flip_of_any_byte_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.safetensors");
    model().write(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    for at in 0..bytes.len() {
        for bit in [0, 5] {
            bytes[at] ^= 1 << bit;
            std::fs::write(&path, &bytes).unwrap();
            let error = Model::read(&path).unwrap_err().to_string();
            assert!(error.contains("m.safetensors"), "byte {at}, bit {bit}: {error}");
            bytes[at] ^= 1 << bit;
        }
    }
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(Model::read(&path).unwrap(), model());
}

#[test]
fn files_without_a_checksum_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.safetensors");
    model().write(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = checksum_digits(&bytes).unwrap();
    // Spaces where the checksum was.
    bytes[at.start - CHECKSUM_KEY.len()..at.end + 3].fill(b' ');
    std::fs::write(&path, &bytes).unwrap();
    assert!(Model::read(&path).unwrap_err().to_string().contains("no checksum"));
}

#[test]
fn damage_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.safetensors");
    let error = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Model::read(&path).unwrap_err()
    };
    model().write(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in [0, 4, 100, whole.len() / 2, whole.len() - 1] {
        let text = error(&whole[..length]).to_string();
        assert!(text.contains("m.safetensors") && text.contains("no intact model"), "{length}: {text}");
    }
    assert!(
        error(b"solid model of something else entirely, not ours").to_string().contains("no intact model")
    );
    let foreign =
        safetensors::serialize([("a", TensorView::new(Dtype::U8, vec![1], &[1]).unwrap())], None).unwrap();
    assert!(error(&foreign).to_string().contains("not one of imf's"));
    let key = br#"\"version\":1"#;
    let at = whole.windows(key.len()).position(|w| w == key).unwrap();
    let mut newer = whole.clone();
    newer[at + key.len() - 1] = b'9';
    assert!(matches!(error(&newer), ModelError::Newer { found: 9, .. }));
    let mut broken = model();
    broken.state.parameters[5] = f32::NAN;
    broken.write(&path).unwrap();
    assert!(Model::read(&path).unwrap_err().to_string().contains("finite"));
    assert!(matches!(Model::read(Path::new("no/model")), Err(ModelError::Read { .. })));
}
