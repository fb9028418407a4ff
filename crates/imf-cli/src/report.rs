//! The evaluation of a field of any family as a table, as JSON and as pictures.

mod pictures;
mod subject;
mod text;

pub use subject::Subject;

use std::path::Path;

use anyhow::{Result, bail};
use glam::DVec3;
use imf_core::field::GridField;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{Quantity, SectionPlan, ToolPoints};
use imf_core::tool::Clearance;
use imf_fields::calibration::Calibration;
use imf_fields::evaluation::{ExactReference, ImfComparison, grid_imf, grid_sections, nearest_sections};
use imf_fields::metrics::{ErrorReport, Validation};
use serde::Serialize;
use serde_json::Value;

use crate::commands::calibrate::DecisionQuality;
use crate::output::{PROGRAM, short, write_json, write_text};
use crate::session::Session;
use subject::Provenance;

/// The threshold of overlaps that the paper compares by.
pub(crate) const PAPER_THRESHOLD: f64 = 1e-3;

/// Where the table's threshold comes from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
enum ThresholdOf {
    /// It was requested.
    Question,
    /// The field's calibration calls values up to it free.
    Calibration,
    /// The calibration calls values from it on colliding, and none free.
    CollidingAlone,
    /// The field is not calibrated.
    Nothing,
}

impl ThresholdOf {
    /// The threshold of a field, where none was given.
    fn calibrated(known: Option<&Calibration>, [lowest, _]: [f64; 2]) -> (f64, Self) {
        let Some(known) = known else { return (0.0, Self::Nothing) };
        match known.free_up_to.map(f64::from) {
            Some(free) => (free, Self::Calibration),
            None => {
                let colliding = known.colliding_from.map_or(lowest, f64::from);
                (colliding.max(lowest), Self::CollidingAlone)
            }
        }
    }
}

/// What to evaluate.
pub struct EvaluationSettings {
    /// A section that training saw.
    pub in_sample: Option<Orientation>,
    /// A section that training did not see.
    pub out_of_sample: Option<Orientation>,
    /// Orientations whose sections are compared.
    pub random: OrientationSet,
    /// Orientations of the inaccessibility measure.
    pub imf: OrientationSet,
    /// Value above which a pose counts as colliding, instead of the calibrated one.
    pub threshold: Option<f64>,
}

/// One row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What was compared.
    pub name: String,
    /// Sections, or orientations of an IMF.
    pub(crate) orientations: usize,
    /// Of the field against the exact one.
    #[serde(flatten)]
    pub errors: ErrorReport,
}

/// Everything that an evaluation found.
#[derive(Debug, Serialize)]
pub struct Report {
    program: String,
    part: String,
    tool: String,
    dims: [usize; 3],
    pitch: f64,
    unit: String,
    /// By how much the tool is offset, in `unit`.
    clearance: Clearance,
    /// How deep the cutter may reach below the part's surface, in `unit`.
    contact: Option<f64>,
    guarantee: String,
    /// The tool has sharp points beside its tip, and the values here are those with its tip at the voxel.
    tip_alone: bool,
    #[serde(flatten)]
    made: Provenance,
    /// Sections that it was made from.
    training_sections: usize,
    evaluation_engine: String,
    /// What was compared, line by line.
    pub rows: Vec<Row>,
    /// What the values are.
    quantity: Quantity,
    /// Value above which a pose counts as colliding.
    threshold: f64,
    threshold_of: ThresholdOf,
    /// The error at the random orientations.
    validation: Validation,
    /// MSE of the field at random orientations over the exact field's variance there.
    mse_over_variance: f64,
    /// The same over the MSE of the nearest training section.
    mse_over_nearest: f64,
    /// What the field may be used for.
    verdict: Value,
    #[serde(skip)]
    verdict_text: String,
}

/// A report with the fields that its pictures show.
pub struct Evaluation<'a> {
    /// In numbers.
    pub report: Report,
    subject: &'a Subject<'a>,
    field: &'a dyn GridField,
    settings: &'a EvaluationSettings,
    imf: ImfComparison,
    plan: SectionPlan,
}

/// Compares a field with the exact one by the threshold of `eval_settings` alone: decisions are not measured.
pub fn evaluate_at_threshold<'a>(
    session: &Session,
    subject: &'a Subject<'a>,
    field: &'a dyn GridField,
    engine: String,
    eval_settings: &'a EvaluationSettings,
) -> Result<Evaluation<'a>> {
    let quality = DecisionQuality::Unknown("that was not requested".into());
    evaluate(session, subject, field, engine, eval_settings, &quality)
}

/// Compares a field with the exact one; `engine` says what evaluates it, `quality` the error rates of its decisions, and the
/// threshold by which poses are classified.
pub(crate) fn evaluate<'a>(
    session: &Session,
    subject: &'a Subject<'a>,
    field: &'a dyn GridField,
    engine: String,
    eval_settings: &'a EvaluationSettings,
    quality: &DecisionQuality,
) -> Result<Evaluation<'a>> {
    if eval_settings.random.is_empty() {
        bail!("at least one random orientation is needed");
    }
    let record = &subject.scene.record;
    let plan = SectionPlan::of_scene(subject.scene, ToolPoints::Tip)?;
    let bare = match record.clearance.is_zero() {
        true => None,
        false => Some(SectionPlan::of_scene(
            &subject.scene.clone().with_clearance(&Clearance::default())?,
            ToolPoints::Tip,
        )?),
    };
    let quantity = field.quantity();
    let exact = ExactReference::new(&plan, quantity, bare.as_ref())?;
    session.detail(&format!("sections: {}", plan.describe()));
    let training = subject.seen.as_ref();
    let singles: Vec<Orientation> =
        [eval_settings.in_sample, eval_settings.out_of_sample].into_iter().flatten().collect();
    let total = singles.len() + 2 * eval_settings.random.len() + eval_settings.imf.len();
    let stage = session.stage("evaluating", "sections", total as u64);
    let advance = |n| stage.advance(n);
    let control = session.control(&advance);
    let (tau, threshold_of) = eval_settings.threshold.map_or_else(
        || ThresholdOf::calibrated(quality.calibration(), quantity.bounds(record.grid.pitch)),
        |tau| (tau, ThresholdOf::Question),
    );

    let mut rows = Vec::new();
    for orientation in &singles {
        // Whether training saw it is looked up, not assumed.
        let seen = training.iter().any(|o| (o.direction() - orientation.direction()).length() < 1e-9);
        let kind = if seen { "in-sample" } else { "out-of-sample" };
        let errors = grid_sections(&exact, &[*orientation], field, tau, control)?.overall;
        let degrees = |angle: f64| short((1e2 * angle).round() / 1e2);
        let name =
            format!("section ({}°, {}°), {kind}", degrees(orientation.theta), degrees(orientation.phi));
        rows.push(Row { name, orientations: 1, errors });
    }
    let random = &eval_settings.random.orientations;
    let learnt = grid_sections(&exact, random, field, tau, control)?;
    let (validation, learnt) = (learnt.validation(), learnt.overall);
    let nearest = nearest_sections(&exact, random, training, tau, control)?.overall;
    let n = random.len();
    rows.push(Row { name: format!("{n} random sections"), orientations: n, errors: learnt });
    rows.push(Row {
        name: format!("{n} random sections by nearest {} section", subject.made.participle),
        orientations: n,
        errors: nearest,
    });
    let imf = grid_imf(&exact, &eval_settings.imf.orientations, field, tau, control)?;
    let measure = if quantity.is_overlap() { "IMF" } else { "minimum depth" };
    let name = format!("{measure} over {} ({})", eval_settings.imf.len(), eval_settings.imf.spec);
    rows.push(Row { name, orientations: eval_settings.imf.len(), errors: imf.errors });
    stage.finish("");

    let over = |base: f64| if base > 0.0 { learnt.mse / base } else { f64::INFINITY };
    let (mse_over_variance, mse_over_nearest) = (over(learnt.variance), over(nearest.mse));
    let report = Report {
        program: PROGRAM.into(),
        part: record.part.clone(),
        tool: record.tool.name.clone(),
        dims: record.grid.dims,
        pitch: record.grid.pitch,
        unit: record.unit.to_string(),
        clearance: record.clearance,
        contact: record.contact,
        guarantee: record.guarantee().to_string(),
        tip_alone: record.tool.sharp_point_positions(record.grid.pitch) != [DVec3::ZERO],
        made: subject.made.clone(),
        training_sections: training.len(),
        evaluation_engine: engine,
        rows,
        mse_over_variance,
        mse_over_nearest,
        quantity,
        threshold: tau,
        threshold_of,
        validation,
        verdict: quality.json(),
        verdict_text: quality.text(),
    };
    drop(exact);
    Ok(Evaluation { report, subject, field, settings: eval_settings, imf, plan })
}

/// Takes away what an earlier field's evaluation left in a folder, which would stand beside a new one.
pub(crate) fn forget(folder: &Path) {
    for file in ["report.json", "report.md", "sections.png", "imf.png", "errors.png"] {
        // What cannot be removed is overwritten later, or then reported.
        let _ = std::fs::remove_file(folder.join(file));
    }
}

impl Evaluation<'_> {
    /// Writes `report.json`, `report.md` and the pictures.
    pub fn write(&self, folder: &Path) -> Result<()> {
        self.draw_sections(folder)?;
        self.draw_imf(folder)?;
        self.error_bars().save(&folder.join("errors.png"))?;
        let mut pictures = vec![
            (
                "sections.png",
                "Sections of the exact field and of this one at orientations that it was not made from, and their \
                 difference",
            ),
            (
                "imf.png",
                match self.report.quantity {
                    Quantity::Overlap => {
                        "Inaccessibility measure, exact and of this field, and their difference"
                    }
                    Quantity::Depth => "Minimum of the depth, exact and of this field, and their difference",
                },
            ),
            ("errors.png", "Error of the field beside what any field must beat"),
        ];
        if let Some(record) = self.subject.training.filter(|record| !record.losses.is_empty()) {
            crate::job::loss_chart(record).save(&folder.join("loss.png"))?;
            pictures.push(("loss.png", "Training loss"));
        }
        write_json(&folder.join("report.json"), &self.report)?;
        write_text(&folder.join("report.md"), &self.report.markdown(&pictures))
    }
}
