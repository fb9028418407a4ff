//! The fields that stand beside the paper's network, made from as many exact sections as it learns from, and evaluated alike.

use anyhow::{Result, bail};
use imf_cli::engine::Device;
use imf_cli::session::Session;
use imf_core::control::Cancelled;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::tool::Tool;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, Symmetry};
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::{Basis, Domain};
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_train::distill::distil_on;
use imf_train::training::run::{Outcome, Report};

/// Sections for each basis function at least: with fewer the fit has no firm minimum.
const MINIMUM_SECTIONS: f64 = 1.3;

/// A reference part with the paper's tool, at a fraction of its own resolution.
pub(crate) fn reference_scene(part: ReferencePart, scale: f64) -> Result<Scene> {
    let dims = part.dims().map(|n| ((n as f64 * scale).round() as usize).max(4));
    Ok(SceneSpec::of_reference(part, &part.mesh(), dims, &Tool::paper()).scene()?)
}

/// Settings of the harmonic field of the highest degree that `sections` sections determine.
pub(crate) fn harmonic_settings(sections: usize) -> FitSettings {
    let fits = |degree: &usize| {
        Basis::count(Domain::Directions, *degree) as f64 * MINIMUM_SECTIONS <= sections as f64
    };
    let degree = (0..40).take_while(fits).last().unwrap_or(0);
    let functions = Basis::count(Domain::Directions, degree);
    FitSettings {
        degree,
        // Rounded up by the fit to the number of sections exactly, and down to whole fours.
        sections_per_function: (sections as f64 - 0.5) / functions as f64,
        components: functions,
        precision: StoragePrecision::F16,
        ..FitSettings::default()
    }
}

/// `settings` with the symmetry that a field and its obstacle have.
pub(crate) fn symmetric(teacher: &HarmonicFile, settings: DistillSettings) -> DistillSettings {
    DistillSettings { symmetry: Symmetry::of(&teacher.field, &teacher.scene.obstacle), ..settings }
}

/// The factored field that a device distils from a harmonic one.
pub(crate) fn distilled(
    session: &Session,
    device: &Device,
    teacher: &HarmonicFile,
    settings: DistillSettings,
) -> Result<FactoredFile> {
    let field = &teacher.field;
    let mut state = settings.start(settings.shape_for(field).components);
    let stage = session.stage("factored", "steps", settings.plan.total_steps(field.grid.len()));
    let advance = |steps| stage.advance(steps);
    let control = session.control(&advance);
    let mut loss = f64::NAN;
    let observer = &mut |report: &Report| loss = report.mean_loss;
    let mut engine = device.distiller(field, &settings, &state)?;
    let outcome = distil_on(field, &settings, &mut state, &mut *engine, control, observer)?;
    if !matches!(outcome, Outcome::Finished) {
        bail!(Cancelled);
    }
    stage.finish(&format!("loss {loss:.2e}"));
    Ok(FactoredFile::distilled(teacher, settings, state)?.finished(StoragePrecision::F32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_harmonic_field_takes_as_many_sections_as_are_given_in_whole_fours() {
        for n in [4, 8, 15, 30] {
            let settings = harmonic_settings(n * n);
            let sizes = settings.sizes(Domain::Directions);
            // Directions are fitted in fours.
            assert_eq!(sizes.sections, n * n / 4 * 4);
            assert!(sizes.sections as f64 >= MINIMUM_SECTIONS * sizes.functions as f64);
            let next = Basis::count(Domain::Directions, settings.degree + 1);
            assert!((n * n) as f64 / (next as f64) < MINIMUM_SECTIONS, "a higher degree would do");
        }
        assert_eq!(harmonic_settings(225).degree, 12);
    }
}
