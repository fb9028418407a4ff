//! Files of every family, read back and damaged.

use half::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::*;
use crate::factored::FactoredState;
use crate::field::Field;
use crate::field::scenes::{
    calibration, factored_file, harmonic_file, harmonic_in_halves, scene, siren_model,
};
use crate::harmonic::coefficients::StoragePrecision;
use crate::recipe::Cursor;
use imf_core::tool::Tool;

/// Every family, in every precision, with and without what training goes on by.
fn all() -> Vec<FieldFile> {
    let scene = scene(&Tool::paper(), 2.0);
    let mut model = siren_model(&scene);
    model.state.step = 12;
    model.state.first_moment[3] = 0.1;
    model.record.pending_loss = (0.1, 3);
    for report in 1..8 {
        model.record.watch.observe(50 * report, 50, 0.1 / report as f64);
    }
    let factored = factored_file(&scene);
    let mut checkpoint = factored.clone();
    let mut state = FactoredState::from_parameters(factored.field.parameters.clone());
    state.training.first_moment[1] = 0.2;
    checkpoint.state = Some(state);
    // What SOAP keeps of the one matrix between hidden layers, once there was a step.
    let mut stepped = checkpoint.clone();
    let state = stepped.state.as_mut().unwrap();
    state.cursor = Cursor { epoch: 2, step: 5 };
    state.watch.observe(5, 100, 0.125);
    let training = &mut state.training;
    let width = factored.settings.width;
    training.step = 1;
    let numbers = |count: usize, last: f32| (0..count).map(|i| last + i as f32).collect();
    training.second_moment = numbers(training.second_moment.len(), 0.5);
    training.preconditioners = numbers(factored.settings.optimiser.state_count(width, width), 0.25);
    assert!(!training.preconditioners.is_empty());
    // In f16 weights are rounded, and the axes of a folded network, which are most of them.
    let round = |values: &mut [f32]| values.iter_mut().for_each(|w| *w = f16::from_f32(*w).to_f32());
    let mut halves = FactoredFile { precision: StoragePrecision::F16, ..factored.clone() };
    round(&mut halves.field.parameters);
    let mut folded = factored.clone().finished(StoragePrecision::F16);
    assert!(folded.field.shape.folded);
    round(&mut folded.field.parameters);
    round(&mut folded.field.components);
    vec![
        FieldFile::Siren(Box::new(model.clone())),
        FieldFile::Siren(Box::new(model.without_moments())),
        FieldFile::Harmonic(Arc::new(harmonic_file(&scene, 4))),
        FieldFile::Harmonic(Arc::new(harmonic_in_halves(&scene, 4))),
        FieldFile::Factored(Box::new(factored.clone())),
        FieldFile::Factored(Box::new(factored.clone().finished(StoragePrecision::F32))),
        FieldFile::Factored(Box::new(checkpoint)),
        FieldFile::Factored(Box::new(stepped)),
        FieldFile::Factored(Box::new(halves)),
        FieldFile::Factored(Box::new(folded)),
    ]
}

/// A place for a field; the folder is there as long as its handle is.
fn place() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    (folder, path)
}

fn bytes_of(file: &FieldFile) -> Vec<u8> {
    let (_folder, path) = place();
    file.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    file.write(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes, "equal fields give equal bytes");
    assert_eq!(FieldFile::read(&path).unwrap(), *file);
    assert_eq!(HarmonicFile::is_one(&path), matches!(file, FieldFile::Harmonic(_)));
    assert_eq!(FactoredFile::is_one(&path), matches!(file, FieldFile::Factored(_)));
    bytes
}

fn refused(bytes: &[u8]) -> FieldFileError {
    let error = FieldFile::from_bytes(bytes, "mine.safetensors").unwrap_err();
    assert!(error.to_string().contains("mine.safetensors"), "{error}");
    error
}

/// Where a quoted key of the description stands.
fn place_of(bytes: &[u8], key: &[u8]) -> usize {
    bytes.windows(key.len()).position(|window| window == key).unwrap()
}

#[test]
fn files_are_the_librarys_and_read_back_bit_for_bit() {
    for file in all() {
        let bytes = bytes_of(&file);
        assert_eq!(FieldFile::from_bytes(&bytes, "mine").unwrap(), file);
        assert_eq!(FieldFile::from_reader(&bytes[..], "mine").unwrap(), file);
        let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        let whole = safetensors::serialize(tensors.tensors(), metadata.metadata().clone()).unwrap();
        assert_eq!(whole, bytes);
    }
}

#[test]
fn damage_is_named() {
    for file in all() {
        let whole = bytes_of(&file);
        for length in [0, 4, 7, 100, whole.len() / 2, whole.len() - 1] {
            let text = refused(&whole[..length]).to_string();
            assert!(text.contains("not an intact") && text.contains("cut short"), "{length}: {text}");
        }
        // Any byte of the smallest file.
        let step = if matches!(file, FieldFile::Siren(_)) { 1 } else { 1009 };
        let mut bytes = whole.clone();
        for at in (0..whole.len()).step_by(step) {
            for bit in [0, 5] {
                bytes[at] ^= 1 << bit;
                refused(&bytes);
                bytes[at] ^= 1 << bit;
            }
        }
        bytes[whole.len() - 500] ^= 0x10;
        assert!(matches!(refused(&bytes), FieldFileError::Damaged { .. }));
        let mut newer = whole.clone();
        let key = br#"\"version\":1"#;
        newer[place_of(&whole, key) + key.len() - 1] = b'9';
        assert!(matches!(refused(&newer), FieldFileError::Newer { found: 9, .. }));
        // Spaces where the checksum was.
        let mut unsigned = whole.clone();
        let key = br#"\"crc32\":\"01234567\","#;
        let at = place_of(&whole, &key[..12]);
        unsigned[at..at + key.len()].fill(b' ');
        assert!(refused(&unsigned).to_string().contains("no checksum"));
    }
    let other = refused(b"solid model of something else entirely").to_string();
    assert!(other.contains("not an intact model: it is a file of another kind"), "{other}");
    let foreign =
        safetensors::serialize([("a", TensorView::new(Dtype::U8, vec![1], &[1]).unwrap())], None).unwrap();
    assert!(refused(&foreign).to_string().contains("not one of imf's"));
    let mut broken = siren_model(&scene(&Tool::paper(), 0.0));
    broken.state.parameters[5] = f32::NAN;
    let (_folder, path) = place();
    broken.write(&path).unwrap();
    assert!(FieldFile::read(&path).unwrap_err().to_string().contains("finite"));
    for error in [
        FieldFile::read(Path::new("no/field")).unwrap_err(),
        Model::read(Path::new("no/field")).unwrap_err(),
        HarmonicFile::read(Path::new("no/field")).unwrap_err(),
        FactoredFile::read(Path::new("no/field")).unwrap_err(),
    ] {
        assert!(matches!(error, FieldFileError::Read { .. }) && error.to_string().contains("cannot read"));
    }
}

#[test]
fn every_family_keeps_its_calibration() {
    let calibration = calibration(0.1, 0.2);
    for mut file in all() {
        let plain = bytes_of(&file);
        assert!(!plain.windows(11).any(|w| w == b"calibration"));
        assert_eq!(FieldFile::from_bytes(&plain, "mine").unwrap().calibration(), None);
        file.set_calibration(calibration);
        let bytes = bytes_of(&file);
        let field = Field::from_bytes(&bytes, "mine").unwrap();
        assert_eq!(field.calibration(), Some(&calibration));
        // Thresholds that cannot be.
        file.set_calibration(Calibration { free_up_to: Some(0.5), ..calibration });
        let (_folder, path) = place();
        file.write(&path).unwrap();
        let error = FieldFile::read(&path).unwrap_err().to_string();
        assert!(error.contains("thresholds cross"), "{error}");
    }
}
