//! A factored field: distilled from a harmonic field, one of a file or one that is fitted first. `imf demo` makes its field so too.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use imf_core::scene::Scene;
use imf_core::section::{Quantity, SectionPlan, ToolPoints};
use imf_fields::evaluation::{ExactReference, grid_sections};
use imf_fields::factored::DistillSettings;
use imf_fields::factored::file::FactoredFile;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_train::dataset::Manifest;
use serde_json::json;

use super::harmonic;
use super::harmonic::validation_text;
use crate::arguments::quantity::scene_of;
use crate::arguments::settings::checkpoint_every;
use crate::arguments::train::FactoredArguments;
use crate::commands::calibrate::calibrate_written;
use crate::commands::field::is_field;
use crate::engine::Device;
use crate::interrupt;
use crate::job::{self, Distillation, FIELD, FactoredStart, Settings};
use crate::output::{OutputFolder, lock_folder, print_result, require_other};
use crate::session::{Session, show_bytes};

/// Random orientations that a finished network is held against exact sections at.
const VALIDATED: usize = 64;

pub(super) fn run(session: &Session, arguments: &FactoredArguments) -> Result<()> {
    let FactoredArguments { explicit, scene, contact, quantity, run, start, degree, .. } = arguments;
    let subject = Path::new(&scene.part);
    if FactoredFile::is_one(subject) {
        bail!(
            "{0} is a factored field already, and a part or a harmonic field is distilled (imf train harmonic); --from {0} begins with \
             this one's network",
            scene.part
        );
    }
    if Manifest::is_in(subject) {
        bail!(
            "{0} is a dataset, which has samples of some directions, and a factored field is trained on all of them: give the part \
             instead, or train siren5 on it (imf train siren5 {0})",
            scene.part
        );
    }
    let is_saved = is_field(subject);
    if is_saved {
        let whose = "a part, and the harmonic field was made with its own";
        explicit.refuse_scene(&["degree"], whose)?;
    }
    let (settings, set) = arguments.settings()?;
    let read = |path| Ok::<_, anyhow::Error>((path, FactoredFile::read(path)?));
    let from = start.from.as_deref().map(read).transpose()?;
    let folder = OutputFolder::check(&run.out)?;
    for source in is_saved.then_some(subject).into_iter().chain(start.from.as_deref()) {
        require_other(source, &folder.file(FIELD))?;
    }
    let device = Device::open(run.device.as_deref().unwrap_or("cpu"), session)?;
    let _before = lock_folder(&folder.path)?;
    let begun = FactoredStart::at(&folder.path, run.resume)?;
    let mut settings = settings;
    if let Some((path, from)) = &from {
        begun.require_network_of(path, from)?;
        let DistillSettings { width, hidden, omega, .. } = from.settings;
        let weights = Some(job::weights_crc32(&from.field.parameters));
        settings = DistillSettings { width, hidden, omega, from: weights, ..settings };
    }
    settings = begun.resolve_settings(run.rate, set.optimiser(), settings);
    let symmetry = match &from {
        Some((_, from)) => Some(from.settings.symmetry),
        None => begun.symmetry(set.symmetry.unwrap_or(true)),
    };
    settings.symmetry = symmetry.unwrap_or_default();
    begun.require_settings(&settings)?;
    let quantity = quantity.of(scene);
    if let Some((path, from)) = from.as_ref().filter(|(_, from)| !is_saved && from.field.quantity != quantity)
    {
        let [theirs, ours] = [from.field.quantity, quantity]
            .map(|quantity| if quantity.is_overlap() { "overlap" } else { "depth" });
        bail!(
            "--from {} is a field of {theirs}, and this one would be of {ours}: add --quantity {theirs}, or leave out --from",
            path.display()
        );
    }
    let distillation = Distillation {
        settings,
        find_symmetry: symmetry.is_none(),
        precision: if arguments.half { StoragePrecision::F16 } else { StoragePrecision::F32 },
        beside: beside(checkpoint_every(set.checkpoint_every)?, "add --resume"),
        smaller: "use a lower --degree, a smaller --network, or a larger --pitch",
        start: &begun,
    };
    let from = from.as_ref().map(|(_, from)| from);
    let trained = if is_saved {
        let field = HarmonicFile::read(subject)?;
        begun.require_source(&field.scene, &field.settings)?;
        match begun.finished(session, distillation.precision)? {
            Some(file) => (file, None),
            None => {
                folder.create()?;
                let _lock = lock_folder(&folder.path)?;
                distillation.run(session, &device, &field, from)?
            }
        }
    } else {
        let scene = scene_of(quantity, explicit, scene).scene_with(session, contact)?;
        folder.create()?;
        let _lock = lock_folder(&folder.path)?;
        of_scene(session, &device, distillation, &scene, (quantity, *degree), from)?
    };
    conclude(session, &folder.path, trained, !run.no_calibrate)
}

/// What happens beside the steps.
pub(crate) fn beside(checkpoint_every: f64, go_on: &'static str) -> Settings {
    Settings { checkpoint_every, go_on, slower: " with --rate ", held_out: 0, held_out_every: None }
}

/// The field of a scene, written to the folder, with the last loss. Where a training is resumed that has steps left, the harmonic
/// field is fitted once more. What cannot be is refused before. The harmonics are of `degree`, by default that of their kind of
/// functions.
pub(crate) fn of_scene(
    session: &Session,
    device: &Device,
    distillation: Distillation<'_>,
    scene: &Scene,
    (quantity, degree): (Quantity, Option<usize>),
    from: Option<&FactoredFile>,
) -> Result<(FactoredFile, Option<f64>)> {
    let domain = Domain::of_tool(scene.record.bare_tool());
    let usual = FitSettings::for_distillation(domain);
    let fit = FitSettings { quantity, degree: degree.unwrap_or(usual.degree), ..usual };
    let Distillation { settings, precision, smaller, start, .. } = distillation;
    start.require_source(scene, &fit)?;
    if let Some(file) = start.finished(session, precision)? {
        return Ok((file, None));
    }
    job::require_memory(session, &settings, &fit, domain, scene.record.grid.len(), smaller)?;
    let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
    let field = harmonic::fit_field(session, scene, &plan, domain, fit, smaller)?;
    drop(plan);
    distillation.run(session, device, &field, from)
}

/// The end of a training: its error, error rates of the field's decisions, and its closing lines.
fn conclude(
    session: &Session,
    out: &Path,
    (file, loss): (FactoredFile, Option<f64>),
    calibrate: bool,
) -> Result<()> {
    let path = out.join(FIELD);
    let quality = calibrate_written(session, &path, calibrate)?;
    interrupt::leave("the field is finished and written; imf eval holds it against exact sections".into());
    let (scene, quantity, plan) = (file.scene.clone(), file.field.quantity, file.settings.plan);
    let random = file.field.basis.random_set(VALIDATED, plan.seed)?.orientations;
    let parameters = file.field.parameter_count();
    let (settings, teacher) = (file.settings, file.report);
    let validation = {
        let sections = SectionPlan::of_scene(&scene, ToolPoints::Tip)?;
        let exact = ExactReference::new(&sections, quantity, None)?;
        let field = Field::new(FieldFile::Factored(Box::new(file)))?;
        let sections = session.staged("validating", "sections", random.len() as u64, |control| {
            grid_sections(&exact, &random, &field, 0.0, control)
        })?;
        sections.validation()
    };
    let bytes = std::fs::metadata(&path).with_context(|| format!("cannot read {}", path.display()))?.len();
    let json = json!({
        "field": path, "bytes": bytes, "parameters": parameters, "loss": loss, "settings": settings, "source": teacher,
        "quantity": quantity, "validation": validation, "verdict": quality.json(),
    });
    // None where a finished training was to go on.
    let loss = loss.map_or_else(String::new, |loss| {
        format!("MSE from the harmonic field in the last steps {loss:.1e}, ")
    });
    let (shown, size) = (path.display(), show_bytes(bytes));
    let error = validation_text(&validation, quantity, scene.record.unit);
    let text =
        format!("{shown}: {size}, {loss}{error}; query it with: imf query {shown}\n{}", quality.text());
    print_result(session, &json, &text)
}
