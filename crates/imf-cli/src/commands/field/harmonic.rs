//! `imf field --method harmonic`: a fit to exact sections answers for any orientations.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};
use imf_core::field::ExactField;
use imf_core::harmonic::basis::Domain;
use imf_core::harmonic::file::HarmonicFile;
use imf_core::harmonic::{
    CANDIDATES, FitSettings, HarmonicError, HarmonicField, Refined, degree_for, fit, section_count,
    sections_tried,
};
use imf_core::scene::Scene;
use imf_core::section::{Imf, SectionError, SectionPlan};
use imf_core::tool::Tool;
use serde_json::{Value, json};

use super::Work;
use super::counting::Streamed;
use crate::arguments::field::FieldArguments;
use crate::arguments::harmonic::{FieldMethod, HarmonicArguments};
use crate::interrupt::{self, Interrupted};
use crate::output::OutputFile;
use crate::session::{Session, show_bytes};

/// True where a field is kept for NumPy.
pub(super) fn is_npz(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz"))
}

/// Sections evaluated at a time.
const AT_ONCE: usize = 16;

/// A harmonic field and how it is used.
pub(super) struct Harmonic {
    field: HarmonicField,
    settings: FitSettings,
    /// Best orientations are counted exactly.
    confirm: bool,
    /// The minimum is over all directions.
    refine: bool,
}

/// The settings, with the degree that the memory allows or the error asks for.
fn chosen(
    session: &Session,
    plan: &SectionPlan,
    domain: Domain,
    asked: &HarmonicArguments,
) -> Result<FitSettings> {
    let settings = asked.settings();
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
pub(in crate::commands) fn fitted(
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

impl Harmonic {
    /// Makes the field; `None` where exact sections are asked for.
    pub(super) fn make(
        session: &Session,
        scene: &Scene,
        plan: &SectionPlan,
        arguments: &FieldArguments,
    ) -> Result<Option<Self>> {
        let asked = &arguments.harmonic;
        if asked.method == FieldMethod::Exact {
            return Ok(None);
        }
        if arguments.elements || arguments.check > 0 {
            bail!(
                "--elements and --check are of exact sections: leave them out, or leave out --method harmonic"
            );
        }
        if asked.confirm && (plan.skin().is_some() || !plan.tip_alone()) {
            bail!(
                "--confirm counts at the tool's tip against the whole obstacle: leave it out where other points are \
                 sharp or --contact is given"
            );
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
        if asked.refine && domain == Domain::Rotations {
            bail!("--refine is for tools that are symmetric about their axis: leave it out");
        }
        let settings = chosen(session, plan, domain, asked)?;
        let smaller = "use a lower --degree or --axes, or a larger --pitch";
        let file = fitted(session, scene, plan, domain, settings, smaller)?;
        if let Some(save) = save {
            let path = save.begin()?;
            if is_npz(path) {
                file.write_npz(path)?;
            } else {
                file.write(path)?;
            }
            session.note(&format!("wrote {}", path.display()));
        }
        Ok(Some(Self { field: file.field, settings, confirm: asked.confirm, refine: asked.refine }))
    }

    /// How values are computed, for people.
    pub(super) fn describe(&self) -> String {
        let report = &self.field.report;
        let confirmed = match self.confirm {
            true => format!("; the best {CANDIDATES} orientations of every voxel counted exactly"),
            false => String::new(),
        };
        format!(
            "{} harmonics of degree {} fitted to {} exact sections, {} axes; {}{confirmed}",
            report.functions,
            self.settings.degree,
            report.sections,
            self.field.axis_count(),
            errors_text(&self.field),
        )
    }

    /// Which promise holds for the values.
    pub(super) fn promise(&self) -> String {
        if self.confirm {
            "values are exact counts of the orientation named, and zeros are proven; another orientation of the set may \
             be lower where the value is not zero"
                .into()
        } else {
            format!("approximate ({}); decisions need exact counts", errors_text(&self.field))
        }
    }

    pub(super) fn summary(&self) -> Value {
        json!({
            "settings": self.settings,
            "report": self.field.report,
            "bytes": self.field.bytes(),
            "confirmed": self.confirm,
            "refined": self.refine,
        })
    }

    /// Shows the sections of all orientations in order.
    pub(super) fn stream<V>(
        &self,
        work: &Work<'_>,
        start: impl Fn() -> V,
        visit: impl Fn(&mut V, usize, &[f32]) -> Result<()>,
    ) -> Result<Streamed<Vec<V>>> {
        let voxels = self.field.grid.len();
        let all = &work.set.orientations;
        let stage = work.session.stage("harmonic sections", "sections", all.len() as u64);
        let mut values = vec![0.0; voxels * AT_ONCE.min(all.len())];
        let mut own = start();
        for (batch, orientations) in all.chunks(AT_ONCE).enumerate() {
            if interrupt::requested() {
                return Ok(Streamed::Interrupted);
            }
            let sections = &mut values[..voxels * orientations.len()];
            self.field.sections(&self.field.heads(orientations), sections);
            for (place, section) in sections.chunks_exact(voxels).enumerate() {
                visit(&mut own, batch * AT_ONCE + place, section)?;
                stage.advance(1);
            }
        }
        stage.finish("");
        Ok(Streamed::Whole(vec![own]))
    }

    /// The least value over all orientations.
    pub(super) fn least(&self, work: &Work<'_>) -> Result<Streamed<Imf>> {
        let all = &work.set.orientations;
        if !self.confirm {
            return Ok(Streamed::Whole(self.field.minimum(&self.field.heads(all))));
        }
        let stage = work.session.stage("confirming", "voxels", self.field.grid.len() as u64);
        let stop = AtomicBool::new(false);
        let advance = |voxels| {
            stage.advance(voxels);
            if interrupt::requested() {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let control = imf_core::control::Control { progress: &advance, cancelled: &stop };
        match self.field.screened(all, &ExactField::new(work.scene), control) {
            Err(HarmonicError::Section(SectionError::Cancelled)) => Ok(Streamed::Interrupted),
            Err(error) => Err(error.into()),
            Ok(screened) => {
                let proven = screened.proven.iter().filter(|&&proven| proven == 1).count();
                stage.finish(&format!("{} exact answers, {proven} voxels proven free", screened.counted));
                Ok(Streamed::Whole(screened.imf))
            }
        }
    }
}

impl Harmonic {
    /// The minimum over all directions, where that is asked for.
    pub(super) fn refined(&self, work: &Work<'_>, least: &Imf) -> Result<Option<Streamed<Refined>>> {
        if !self.refine {
            return Ok(None);
        }
        let stage = work.session.stage("refining", "voxels", self.field.grid.len() as u64);
        let advance = |voxels| stage.advance(voxels);
        let found = self.field.refined(least, &work.set.orientations, work.session.control(&advance));
        match found {
            Err(SectionError::Cancelled) => Ok(Some(Streamed::Interrupted)),
            Err(error) => Err(error.into()),
            Ok(refined) => {
                stage.finish("");
                Ok(refined.map(Streamed::Whole))
            }
        }
    }
}

fn errors_text(field: &HarmonicField) -> String {
    let report = &field.report;
    let left_out = match report.dropped {
        0.0 => String::new(),
        dropped => format!(", and {dropped:.1e} by the axes left out"),
    };
    format!(
        "at unseen orientations MSE {:.1e}, MPE {:.3}{left_out}",
        report.held_out_mse, report.held_out_mpe
    )
}
