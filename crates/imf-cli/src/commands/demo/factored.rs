//! The demo by the families that serve a newcomer best: a harmonic field of the full teapot from a few hundred exact
//! sections, then the network of a megabyte that is distilled from it. As `imf train` and `imf eval`.

use anyhow::Result;
use imf_core::scene::Scene;
use imf_core::section::Quantity;
use imf_fields::factored::DistillSettings;
use imf_fields::factored::file::FactoredFile;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::recipe::{TrainingLength, TrainingPlan};

use super::make_report;
use crate::arguments::DemoArguments;
use crate::commands::eval::IMF_ORIENTATIONS;
use crate::commands::train::factored::{beside, of_scene};
use crate::engine::Device;
use crate::job::{self, Distillation, FactoredStart};
use crate::output::lock_folder;
use crate::report::Report;
use crate::session::Session;

/// Steps of training: twice through the grid, a dozen seconds on two fast cores.
const STEPS: u64 = 1_000;
/// Seconds between checkpoints.
const CHECKPOINT_EVERY: f64 = 30.0;

pub(super) fn run(session: &Session, arguments: &DemoArguments, scene: &Scene) -> Result<Report> {
    let device = Device::open(&arguments.device.device, session)?;
    let _lock = lock_folder(&arguments.out)?;
    let start = FactoredStart::at(&arguments.out, job::is_unfinished::<FactoredFile>(&arguments.out))?;
    let defaults = DistillSettings::of_length(TrainingLength::Steps(arguments.steps.unwrap_or(STEPS)));
    let defaults = start.resolve_settings(None, None, defaults);
    let symmetry = start.symmetry(true);
    let settings = DistillSettings {
        plan: TrainingPlan { seed: arguments.seed, ..defaults.plan },
        symmetry: symmetry.unwrap_or_default(),
        ..defaults
    };
    start.require_settings(&settings)?;
    let distillation = Distillation {
        settings,
        find_symmetry: symmetry.is_none(),
        precision: StoragePrecision::F32,
        beside: beside(CHECKPOINT_EVERY, "run the same command again"),
        smaller: "raise --memory, or take the smaller demo: --family siren5",
        start: &start,
    };
    let (file, _) = of_scene(session, &device, distillation, scene, (Quantity::Overlap, None), None)?;

    let imf = file.field.basis.even_set(IMF_ORIENTATIONS)?;
    drop(file);
    make_report(session, &device, arguments, None, imf)
}
