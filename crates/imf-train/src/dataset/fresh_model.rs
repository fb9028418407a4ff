//! A model of a dataset at the start of its training.

use imf_core::scene::Scene;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::divergence::Watch;
use imf_fields::recipe::{Cursor, TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;

use super::Manifest;

impl Manifest {
    /// A model of this dataset's `scene` and so many `samples`, of which no step is done.
    #[must_use]
    pub fn fresh_model(
        &self,
        scene: Scene,
        samples: u64,
        shape: SirenShape,
        plan: TrainingPlan,
        state: TrainingState,
        fine_tuned_from: Option<String>,
    ) -> Model {
        let record = TrainingRecord {
            program: env!("CARGO_PKG_VERSION").into(),
            plan,
            cursor: Cursor::default(),
            watch: Watch::default(),
            finished: false,
            steps: 0,
            seconds: 0.0,
            engine: String::new(),
            orientations: self.orientations.clone(),
            sampling: self.sampling,
            samples,
            dataset_crc32: self.fingerprint(),
            groups_per_epoch: None,
            fine_tuned_from,
            losses: Vec::new(),
            pending_loss: (0.0, 0),
            held_out: None,
        };
        Model { shape, scene, record, state, calibration: None }
    }
}
