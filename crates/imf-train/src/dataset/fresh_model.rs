//! A model of a dataset at the start of its training.

use imf_core::scene::Scene;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::{TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;

use super::Manifest;

impl Manifest {
    /// An untrained model of this dataset's `scene` and `samples` samples.
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
            plan,
            sampling: self.sampling,
            samples,
            dataset_crc32: self.fingerprint(),
            fine_tuned_from,
            ..TrainingRecord::untrained(self.orientations.clone())
        };
        Model { shape, scene, record, state, calibration: None }
    }
}
