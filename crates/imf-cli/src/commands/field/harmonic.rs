//! `imf field --method harmonic`: a fit to exact sections, which answers for any orientations.

use std::sync::Arc;

use anyhow::{Result, bail};
use imf_core::scene::Scene;
use imf_core::section::{SectionError, SectionPlan};
use imf_core::tool::Tool;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, HarmonicError, degree_for, fit, section_count, sections_tried};

use super::approximate::{Approximate, errors_text};
use crate::arguments::field::FieldArguments;
use crate::arguments::harmonic::{FieldMethod, HarmonicArguments};
use crate::interrupt::Interrupted;
use crate::output::OutputFile;
use crate::session::{Session, show_bytes};

/// The settings, with the degree that the memory allows or the error asks for.
fn chosen(
    session: &Session,
    plan: &SectionPlan,
    domain: Domain,
    asked: &HarmonicArguments,
) -> Result<FitSettings> {
    let settings = asked.settings(domain);
    if !asked.chooses_degree() {
        return Ok(settings);
    }
    let room = session.memory_limit();
    let Some(most) = settings.degree_within(plan, domain, room) else {
        bail!(
            "no harmonic field fits into {} of memory; use a larger --pitch, or raise --memory",
            show_bytes(room)
        );
    };
    let Some(target) = asked.target_mse else {
        session.note(&format!("degree {most} is the highest that {} of memory allow", show_bytes(room)));
        return Ok(FitSettings { degree: most, ..settings });
    };
    let stage =
        session.stage("choosing the degree", "sections", sections_tried(domain, &settings, most) as u64);
    let advance = |sections| stage.advance(sections);
    let found = degree_for(plan, domain, &settings, target, most, session.control(&advance));
    let (settings, report) = found.map_err(|error| interruption(error, "choosing the degree"))?;
    stage.finish(&format!("{}: MSE {:.1e} expected", settings.degree, report.expected_mse()));
    if report.expected_mse() > target {
        session.warn(&format!(
            "an MSE of {target:e} is out of reach: degree {}, the best up to {most}, is expected to have {:.1e}",
            settings.degree,
            report.expected_mse()
        ));
    }
    Ok(settings)
}

/// An interrupted fit says that nothing is kept; other errors stay as they are.
pub(in crate::commands) fn interruption(error: HarmonicError, what: &str) -> anyhow::Error {
    match error {
        HarmonicError::Section(SectionError::Cancelled) => {
            Interrupted(format!("{what} needs every section; nothing was written")).into()
        }
        other => other.into(),
    }
}

/// What the field of a tool depends on beside the point; the tool is one without clearance.
pub(in crate::commands) fn domain(bare: &Tool) -> Domain {
    if bare.is_axisymmetric() { Domain::Directions } else { Domain::Rotations }
}

/// The field of a scene, in so many exact sections as the settings ask for; `smaller` says what takes less memory.
pub fn fitted(
    session: &Session,
    scene: &Scene,
    plan: &SectionPlan,
    domain: Domain,
    mut settings: FitSettings,
    smaller: &str,
) -> Result<HarmonicFile> {
    let [one, two] =
        [true, false].map(|one_pass| FitSettings { one_pass, ..settings }.memory_with(plan, domain).0);
    settings.one_pass = one <= session.memory_limit().max(two);
    let needed = if settings.one_pass { one } else { two };
    session.require_memory(needed, || {
        let axes = settings.sizes(domain).axes;
        format!("a harmonic field of degree {} along {axes} axes; {smaller}", settings.degree)
    })?;
    let stage = session.stage("sections to fit", "sections", section_count(domain, &settings) as u64);
    let advance = |sections| stage.advance(sections);
    let field = fit(plan, domain, &settings, session.control(&advance));
    let field = field.map_err(|error| interruption(error, "a fit"))?;
    stage.finish(&errors_text(&field));
    // As its file would have them, which does not tell one pass from two: what is taught by it is resumed by a fit in either.
    let settings = FitSettings { one_pass: true, ..settings };
    Ok(HarmonicFile { field, scene: scene.clone(), settings, calibration: None })
}

/// Makes the field; `None` where exact sections are asked for.
pub(super) fn make(
    session: &Session,
    scene: &Scene,
    plan: &SectionPlan,
    arguments: &FieldArguments,
) -> Result<Option<Approximate>> {
    let asked = &arguments.harmonic;
    if asked.method == FieldMethod::Exact {
        return Ok(None);
    }
    if arguments.elements || arguments.check > 0 {
        bail!("--elements and --check are of exact sections: leave them out, or leave out --method harmonic");
    }
    if asked.save.is_some() && !plan.tip_alone() {
        bail!(
            "a field that is kept is of the tool's tip, which serves every sharp point, and sections are the least over \
             all of them: leave out --orientations and --out to keep it, and --save for sections"
        );
    }
    let save = asked.save.as_deref().map(OutputFile::check).transpose()?;
    let bare = scene.record.bare_tool();
    // Turning a tool of revolution about its axis moves its sharp points, not the overlap at its tip.
    let bare = if plan.tip_alone() { &bare.with_tip_only() } else { bare };
    let domain = domain(bare);
    let settings = chosen(session, plan, domain, asked)?;
    let smaller = "use a lower --degree or --axes, or a larger --pitch";
    let file = fitted(session, scene, plan, domain, settings, smaller)?;
    if let Some(save) = save {
        let path = save.begin()?;
        file.write(path)?;
        session.note(&format!("wrote {}", path.display()));
    }
    let stored = FieldFile::Harmonic(Arc::new(file));
    Ok(Some(Approximate::new(stored, asked.refine)?))
}
