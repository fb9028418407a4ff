//! What every field is compared at, so that the networks of recipes and what stands beside them have the same rows.

mod drawn;

use anyhow::{Context as _, Result, bail};
use imf_cli::engine::{Device, DeviceField, Workload};
use imf_cli::output::short;
use imf_cli::report::{self, Subject};
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{Imf, SectionPlan, ToolPoints, imf, sections};
use imf_fields::evaluation::{field_imf, field_sections, grid_imf};
use imf_fields::file::FieldFile;
use imf_fields::metrics::{ErrorReport, Errors, Validation};
use imf_fields::model::Model;
use imf_fields::siren::over_grid;
use serde::{Deserialize, Serialize};
use std::path::Path;

use super::definition::{Recipe, Stage, pair};
use drawn::VoxelSample;

/// How the name of the last question ends.
pub(crate) const RANDOM: &str = "random sections";

/// Two sections, the inaccessibility measure over some sets, and random sections, in this order.
pub(crate) struct EvaluationSets {
    pub(crate) in_sample: Orientation,
    pub(crate) out_of_sample: Orientation,
    /// Of these two, whether a result has learnt from them.
    learnt: [String; 2],
    pub(crate) imf: Vec<OrientationSet>,
    random: OrientationSet,
    threshold: f64,
    /// Fraction of the voxels at which a network's minima and random sections are compared.
    voxels: f64,
}

/// One comparison with the exact field.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Answer {
    /// What was compared.
    pub(crate) name: String,
    #[serde(flatten)]
    pub(crate) errors: ErrorReport,
    /// Standard error of the mean squared error, where voxels were drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) standard_error: Option<f64>,
}

/// In words whether a section was learnt from, in the result's own stage or in one that it starts from.
fn learnt(recipe: &Recipe, result: &Stage, section: &Orientation) -> Result<String> {
    let mut stage = Some(result);
    while let Some(own) = stage {
        let same = |o: &Orientation| o.direction().abs_diff_eq(section.direction(), 1e-9);
        // Sections of another part are other sections.
        let part = |stage: &Stage| stage.part.clone().unwrap_or_else(|| recipe.scene.part.clone());
        if part(own) == part(result) && own.directions()?.orientations.iter().any(same) {
            let is_result = own.name == result.name;
            return Ok(if is_result {
                "in-sample".into()
            } else {
                format!("in-sample of stage {}", own.name)
            });
        }
        stage = recipe.stages.iter().find(|earlier| earlier.name == own.start);
    }
    Ok("out-of-sample".into())
}

impl EvaluationSets {
    /// Of a recipe's first result.
    pub(crate) fn of(recipe: &Recipe) -> Result<Self> {
        let first = recipe.results().next().context("a recipe has a result")?;
        Self::of_result(recipe, first)
    }

    /// Of the result that a stage is.
    pub(crate) fn of_result(recipe: &Recipe, result: &Stage) -> Result<Self> {
        let settings = &recipe.evaluation;
        let [in_sample, out_of_sample] = [pair(&settings.in_sample)?, pair(&settings.out_of_sample)?];
        Ok(Self {
            learnt: [learnt(recipe, result, &in_sample)?, learnt(recipe, result, &out_of_sample)?],
            in_sample,
            out_of_sample,
            imf: settings.imf.iter().map(|spec| OrientationSet::parse(spec)).collect::<Result<_, _>>()?,
            random: OrientationSet::parse(&format!("random:{}:{}", settings.random, settings.seed))?,
            threshold: settings.threshold,
            voxels: settings.voxels,
        })
    }

    /// Names of the questions, in order.
    pub(crate) fn names(&self) -> Vec<String> {
        let pair = |o: &Orientation| format!("({}°, {}°)", short(o.theta), short(o.phi));
        let mut names = vec![
            format!("section {}, {}", pair(&self.in_sample), self.learnt[0]),
            format!("section {}, {}", pair(&self.out_of_sample), self.learnt[1]),
        ];
        names.extend(self.imf.iter().map(|set| format!("IMF over {}", set.len())));
        names.push(format!("{} {RANDOM}", self.random.len()));
        names
    }

    fn named(&self, errors: impl IntoIterator<Item = ErrorReport>) -> Vec<Answer> {
        let answer = |(name, errors)| Answer { name, errors, standard_error: None };
        self.names().into_iter().zip(errors).map(answer).collect()
    }

    /// Exact and other sections that [`Self::exact`] and [`Self::ask`] compute.
    pub(crate) fn sections(&self) -> [usize; 2] {
        let exact = self.imf.iter().map(OrientationSet::len).sum();
        [exact, 2 + exact + self.random.len()]
    }

    /// The exact minima, which all fields of a scene are compared with. One unit of progress is one section.
    pub(crate) fn exact(&self, plan: &SectionPlan, control: Control<'_>) -> Result<Vec<Imf>> {
        let imf = self.imf.iter().map(|set| imf(plan, &set.orientations, control));
        Ok(imf.collect::<Result<_, _>>()?)
    }

    /// The results of a field. One unit of progress is one section.
    pub(crate) fn ask(
        &self,
        plan: &SectionPlan,
        exact: &[Imf],
        control: Control<'_>,
        mut field: impl FnMut(&Orientation, &mut [f32]),
    ) -> Result<Vec<Answer>> {
        let tau = self.threshold;
        let mut errors = Vec::with_capacity(3 + exact.len());
        for section in [self.in_sample, self.out_of_sample] {
            errors.push(field_sections(plan, &[section], tau, control, &mut field)?.overall);
        }
        for (set, exact) in self.imf.iter().zip(exact) {
            errors.push(field_imf(exact, &set.orientations, tau, control, &mut field)?);
        }
        errors.push(field_sections(plan, &self.random.orientations, tau, control, &mut field)?.overall);
        Ok(self.named(errors))
    }

    /// The results of a network. At all voxels those of the nearest section that it learnt from follow, and a report
    /// with pictures is written.
    pub(crate) fn report(
        &self,
        session: &Session,
        device: &Device,
        model: &Model,
        folder: &Path,
    ) -> Result<Vec<Answer>> {
        if self.voxels < 1.0 {
            return self.at_drawn_voxels(session, device, model);
        }
        let Some((first, others)) = self.imf.split_first() else { bail!("evaluation.imf names no set") };
        let questions = report::EvaluationSettings {
            in_sample: Some(self.in_sample),
            out_of_sample: Some(self.out_of_sample),
            random: self.random.clone(),
            imf: first.clone(),
            threshold: Some(self.threshold),
        };
        let file = FieldFile::Siren(Box::new(model.clone()));
        let DeviceField { field, by, .. } = device.field(session, &file, Workload::Many)?;
        let subject = Subject::of_model(model);
        let evaluation = report::evaluate_at_threshold(session, &subject, &*field, by, &questions)?;
        evaluation.write(folder)?;
        let [in_sample, out_of_sample, random, nearest, first] = evaluation.report.rows.as_slice() else {
            bail!("a report of {} rows", evaluation.report.rows.len());
        };
        let mut errors = vec![in_sample.errors, out_of_sample.errors, first.errors];
        let plan = SectionPlan::of_scene(&model.scene, ToolPoints::Tip)?;
        for set in others {
            let imf = session.staged("evaluating", "sections", set.len() as u64, |control| {
                grid_imf(&(&plan).into(), &set.orientations, &*field, self.threshold, control)
            })?;
            errors.push(imf.errors);
        }
        errors.push(random.errors);
        let mut answers = self.named(errors);
        answers.push(Answer { name: nearest.name.clone(), errors: nearest.errors, standard_error: None });
        Ok(answers)
    }

    /// The same, minima and random sections at voxels drawn at random; the two sections are whole.
    fn at_drawn_voxels(&self, session: &Session, device: &Device, model: &Model) -> Result<Vec<Answer>> {
        let plan = SectionPlan::of_scene(&model.scene, ToolPoints::Tip)?;
        let grid = plan.grid();
        let drawn = VoxelSample::of(grid, self.voxels);
        let mut engine = device.evaluator(model.shape, &model.state.parameters)?;
        let whole = 2 * grid.len() as u64;
        let [exact_sections, _] = self.sections();
        let values = (exact_sections + self.random.len()) as u64 * drawn.len() as u64;
        let stage = session.stage("evaluating", "values", whole + values);
        let advance = |values| stage.advance(values);
        let (control, quiet) = (session.control(&advance), session.control(&|_| {}));
        let tau = self.threshold;
        let mut answers = Vec::new();
        for section in [self.in_sample, self.out_of_sample] {
            let exact = sections(&plan, &[section], quiet)?;
            let mut learnt = vec![0.0; grid.len()];
            over_grid::section(engine.as_mut(), grid, section.angles(), &mut learnt)?;
            let mut errors = Errors::default();
            errors.add(&exact[0], &learnt, tau);
            answers.push((errors.report(tau), None));
            advance(grid.len() as u64);
        }
        for set in &self.imf {
            let exact = imf(&plan, &set.orientations, quiet)?;
            let directions: Vec<[f32; 2]> = set.orientations.iter().map(Orientation::angles).collect();
            let learnt = drawn.minimum(engine.as_mut(), &directions, control)?;
            let (report, error) = drawn.errors(&exact.value, &learnt, tau);
            answers.push((report, Some(error)));
        }
        let mut overall = Errors::default();
        let mut each = Vec::new();
        for orientation in &self.random.orientations {
            let exact = sections(&plan, std::slice::from_ref(orientation), quiet)?;
            let learnt = drawn.minimum(engine.as_mut(), &[orientation.angles()], control)?;
            let mut errors = Errors::default();
            errors.add(&drawn.of_section(&exact[0]), &learnt, tau);
            let own = errors.report(tau);
            each.push((own.mse, own.mpe));
            overall.merge(&errors);
        }
        answers.push((overall.report(tau), Some(Validation::of(&each).standard_error)));
        stage.finish("");
        let answer = |(name, (errors, standard_error))| Answer { name, errors, standard_error };
        Ok(self.names().into_iter().zip(answers).map(answer).collect())
    }
}
