//! The demo by the families that serve a newcomer best: a harmonic field of the full teapot from a few hundred exact
//! sections, then the network of a megabyte that is distilled from it. As `imf train` and `imf eval`.

use anyhow::Result;
use imf_core::scene::Scene;
use imf_core::section::Quantity;
use imf_fields::factored::DistillSettings;
use imf_fields::factored::file::FactoredFile;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::recipe::{Length, TrainingPlan};

use super::make_report;
use crate::arguments::DemoArguments;
use crate::commands::eval::IMF_ORIENTATIONS;
use crate::commands::train::factored::{Request, beside};
use crate::engine::Device;
use crate::job::{self, FactoredStart};
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
    let defaults = DistillSettings::of_length(Length::Steps(arguments.steps.unwrap_or(STEPS)));
    let defaults = start.resolve_settings(None, None, defaults);
    let symmetry = start.symmetry(true);
    let request = Request {
        quantity: Quantity::Overlap,
        degree: None,
        find_symmetry: symmetry.is_none(),
        settings: DistillSettings {
            plan: TrainingPlan { seed: arguments.seed, ..defaults.plan },
            symmetry: symmetry.unwrap_or_default(),
            ..defaults
        },
        precision: Precision::F32,
        beside: beside(CHECKPOINT_EVERY, "run the same command again"),
        smaller: "raise --memory, or take the smaller demo: --family siren5",
    };
    start.require_settings(&request.settings)?;
    let (file, _) = request.of_scene(session, &device, scene, &start, None)?;

    let imf = file.field.basis.even_set(IMF_ORIENTATIONS)?;
    drop(file);
    make_report(session, &device, arguments, None, imf)
}
