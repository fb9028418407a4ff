//! Models with random weights, made without training.

use std::path::Path;

use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::tool::Tool;
use imf_fields::model::{LossPoint, Model, TrainingRecord};
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;

/// A tiny network for the bracket on 5×15×9 voxels.
pub(crate) fn model() -> Model {
    let mesh = ReferencePart::Bracket.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [5, 15, 9], &tool);
    let shape = SirenShape { width: 9, hidden: 3, ..SirenShape::paper() };
    let record = TrainingRecord {
        finished: true,
        steps: 12,
        engine: "none: random weights".into(),
        samples: 100,
        dataset_crc32: 7,
        losses: vec![LossPoint { step: 12, loss: 0.25 }],
        ..TrainingRecord::untrained(OrientationSet::parse("fibonacci:3").unwrap())
    };
    let state = TrainingState::new(&shape, 1);
    Model { shape, scene: spec.scene().unwrap(), record, state, calibration: None }
}

pub(crate) fn write_model(path: &Path) -> Model {
    let model = model();
    model.write(path).unwrap();
    model
}
