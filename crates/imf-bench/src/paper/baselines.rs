//! What stands beside the paper's network: the nearest of the stored sections, linear interpolation between them, the
//! harmonic field fitted to as many, and that taught to a small network of the point (the factored field).

use std::time::Instant;

use anyhow::{Context as _, Result};
use imf_cli::session::Session;
use imf_core::orientation::Orientation;
use imf_core::scene::Scene;
use imf_core::section::{At, SectionError, SectionPlan};
use imf_fields::factored::{DistillSettings, FactoredField, Symmetry};
use imf_fields::harmonic::basis::{Basis, Domain};
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit, section_count};
use imf_fields::metrics::ErrorReport;
use imf_train::distill::distil;
use imf_train::training::run::Outcome;
use serde::{Deserialize, Serialize};

use super::questions::Questions;
use crate::interpolation::{AngleGrid, StoredSections};

/// Sections for each function at least: with fewer the fit has no firm minimum.
const LEAST_SECTIONS: f64 = 1.3;

/// A field beside the paper's network, and what it came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Method {
    pub(super) name: String,
    /// Seconds to make it.
    pub(super) made: f64,
    /// Seconds for the sections of the first IMF's set.
    pub(super) sections: f64,
    /// Bytes of what is kept.
    pub(super) bytes: u64,
    /// In the order of the questions.
    pub(super) answers: Vec<ErrorReport>,
}

/// Settings of the harmonic field of the highest degree that `sections` sections determine.
pub(crate) fn settings(sections: usize) -> FitSettings {
    let fits =
        |degree: &usize| Basis::count(Domain::Directions, *degree) as f64 * LEAST_SECTIONS <= sections as f64;
    let degree = (0..40).take_while(fits).last().unwrap_or(0);
    let functions = Basis::count(Domain::Directions, degree);
    FitSettings {
        degree,
        // Rounded up by the fit to the number of sections exactly, and down to whole fours.
        sections_per_function: (sections as f64 - 0.5) / functions as f64,
        axes: functions,
        precision: Precision::F16,
        ..FitSettings::default()
    }
}

/// The harmonic field taught to a network, as `imf train factored` does, and the seconds that took.
fn taught(
    session: &Session,
    teacher: &HarmonicField,
    scene: &Scene,
    settings: &DistillSettings,
) -> Result<(FactoredField, f64)> {
    let stage = session.stage("teaching", "steps", settings.plan.total_steps(teacher.grid.len()));
    let advance = |steps| stage.advance(steps);
    let (begun, mut loss) = (Instant::now(), f64::NAN);
    let settings = &DistillSettings { symmetry: Symmetry::of(teacher, &scene.obstacle), ..*settings };
    let axes = settings.outputs(teacher);
    let mut state = settings.start(axes);
    let (outcome, _) =
        distil(teacher, settings, &mut state, session.control(&advance), &mut |step| loss = step.mean_loss)?;
    if let Outcome::Stopped(_) = outcome {
        return Err(SectionError::Cancelled.into());
    }
    stage.finish(&format!("loss {loss:.2e}"));
    let field = FactoredField::new(teacher, settings.shape(axes), state.training.parameters)?;
    Ok((field.folded(), begun.elapsed().as_secs_f64()))
}

/// Makes and asks all of them from the n × n sections of `grid:n`, or as many; the factored field by `teaching`.
pub(super) fn measure(
    session: &Session,
    scene: &Scene,
    questions: &Questions,
    n: usize,
    teaching: &DistillSettings,
) -> Result<Vec<Method>> {
    let angles = AngleGrid::new(n);
    let voxels = scene.record.grid.len();
    let tool = scene.record.tool.with_tip_only();
    let settings = settings(n * n);
    let needed = StoredSections::memory(angles, voxels)
        + settings.memory(Domain::Directions, voxels).0
        // The factored field's coefficients at every voxel.
        + 2 * (voxels * settings.axes) as u64
        + SectionPlan::memory_estimate(&scene.record.grid, &tool, session.threads());
    session.require_memory(needed, || format!("{} stored sections and a harmonic field of them", n * n))?;
    let plan = SectionPlan::of_scene(scene, At::Tip)?;
    let repeated = &questions.imf[0].orientations;
    let asked = 4 * (questions.field_sections() + repeated.len());
    let total = n * n + questions.exact_sections() + section_count(Domain::Directions, &settings) + asked;
    let stage = session.stage("baselines", "sections", total as u64);
    let advance = |sections| stage.advance(sections);
    let control = session.control(&advance);

    let exact = questions.exact(&plan, control)?;
    let begun = Instant::now();
    let stored = StoredSections::new(&plan, angles, control)?;
    let stored_in = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let harmonic = fit(&plan, Domain::Directions, &settings, control)?;
    let fitted_in = begun.elapsed().as_secs_f64();

    let mut measured = Vec::new();
    let mut judge =
        |name: String, made: f64, bytes: u64, field: &dyn Fn(&Orientation, &mut [f32])| -> Result<()> {
            let answers = questions.ask(&plan, &exact, control, field)?;
            let mut values = vec![0.0; voxels];
            let begun = Instant::now();
            for orientation in repeated {
                field(orientation, &mut values);
                advance(1);
            }
            let sections = begun.elapsed().as_secs_f64();
            measured.push(Method { name, made, sections, bytes, answers });
            Ok(())
        };
    let bytes = StoredSections::memory(angles, voxels);
    judge("nearest section".into(), stored_in, bytes, &|o, values| stored.nearest(o, values))?;
    judge("linear in angle".into(), stored_in, bytes, &|o, values| stored.linear(o, values))?;
    let name = format!("harmonic, degree {}", settings.degree);
    judge(name, fitted_in, harmonic.bytes(), &|o, values| {
        harmonic.sections(&harmonic.direction_weights(&[*o]), values);
    })?;
    let (factored, taught_in) = taught(session, &harmonic, scene, teaching)?;
    // Its coefficients at every voxel, once for all sections.
    let begun = Instant::now();
    let known = factored.evaluator().expanded(Precision::F16, harmonic.report);
    let known_in = begun.elapsed().as_secs_f64();
    let name = format!("factored, {}×{}", teaching.hidden, teaching.width);
    let made = fitted_in + taught_in;
    judge(name, made, factored.bytes(), &|o, values| {
        known.sections(&known.direction_weights(&[*o]), values);
    })?;
    measured.last_mut().context("a field without answers")?.sections += known_in;
    stage.finish("");
    Ok(measured)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_harmonic_field_takes_as_many_sections_as_are_stored_in_whole_fours() {
        for n in [4, 8, 15, 30] {
            let settings = settings(n * n);
            let sizes = settings.sizes(Domain::Directions);
            // Directions are fitted in fours.
            assert_eq!(sizes.sections, n * n / 4 * 4);
            assert!(sizes.sections as f64 >= LEAST_SECTIONS * sizes.functions as f64);
            let next = Basis::count(Domain::Directions, settings.degree + 1);
            assert!((n * n) as f64 / (next as f64) < LEAST_SECTIONS, "a higher degree would do");
        }
        assert_eq!(settings(225).degree, 12);
    }
}
