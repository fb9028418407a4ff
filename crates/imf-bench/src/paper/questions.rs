//! What every field is asked, so that networks and baselines stand in the same rows.

use anyhow::{Context as _, Result, bail};
use imf_cli::output::short;
use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{Imf, SectionPlan, imf};
use imf_fields::evaluation::{field_imf, field_sections};
use imf_fields::metrics::ErrorReport;

use crate::experiment::Outcome;
use crate::recipe::EvaluationSettings;

/// How the name of the last question ends.
pub(super) const RANDOM: &str = "random sections";

/// Two sections, the inaccessibility measure over some sets, and random sections, in this order.
pub(super) struct Questions {
    pub(super) in_sample: Orientation,
    pub(super) out_of_sample: Orientation,
    pub(super) imf: Vec<OrientationSet>,
    random: OrientationSet,
    threshold: f64,
}

/// Exact answers that every field is compared with.
pub(super) struct Exact {
    imf: Vec<Imf>,
}

impl Questions {
    /// What a recipe's results are asked.
    pub(super) fn of(asked: &EvaluationSettings) -> Result<Self> {
        let pair = |text: &str| match OrientationSet::parse(text)?.orientations.as_slice() {
            [one] => Ok(*one),
            _ => bail!("'{text}' must be one pair θ,φ"),
        };
        Ok(Self {
            in_sample: pair(&asked.in_sample)?,
            out_of_sample: pair(&asked.out_of_sample)?,
            imf: asked.imf.iter().map(|spec| OrientationSet::parse(spec)).collect::<Result<_, _>>()?,
            random: OrientationSet::parse(&format!("random:{}:{}", asked.random, asked.seed))?,
            threshold: asked.threshold,
        })
    }

    /// Names of the questions, in order.
    pub(super) fn names(&self) -> Vec<String> {
        let pair = |o: &Orientation| format!("({}°, {}°)", short(o.theta), short(o.phi));
        let mut names = vec![
            format!("section {}, in-sample", pair(&self.in_sample)),
            format!("section {}, out-of-sample", pair(&self.out_of_sample)),
        ];
        names.extend(self.imf.iter().map(|set| format!("IMF over {}", set.len())));
        names.push(format!("{} {RANDOM}", self.random.len()));
        names
    }

    /// A recipe's answers in that order.
    pub(super) fn answers(&self, outcome: &Outcome) -> Result<Vec<ErrorReport>> {
        let answers = outcome.sections().chain(outcome.imf()).chain(outcome.random());
        let answers: Vec<ErrorReport> = answers.map(|answer| answer.errors).collect();
        let asked = 3 + self.imf.len();
        (answers.len() == asked)
            .then_some(answers)
            .with_context(|| format!("the run of stage {} did not answer {asked} questions", outcome.stage))
    }

    /// Sections that [`Self::exact`] computes.
    pub(super) fn exact_sections(&self) -> usize {
        self.imf.iter().map(OrientationSet::len).sum()
    }

    /// Computes what all fields share. One unit of progress is one section.
    pub(super) fn exact(&self, plan: &SectionPlan, control: Control<'_>) -> Result<Exact> {
        let imf = self.imf.iter().map(|set| imf(plan, &set.orientations, control));
        Ok(Exact { imf: imf.collect::<Result<_, _>>()? })
    }

    /// Sections that [`Self::ask`] takes of a field.
    pub(super) fn field_sections(&self) -> usize {
        2 + self.exact_sections() + self.random.len()
    }

    /// What a field answers. One unit of progress is one section.
    pub(super) fn ask(
        &self,
        plan: &SectionPlan,
        exact: &Exact,
        control: Control<'_>,
        mut field: impl FnMut(&Orientation, &mut [f32]),
    ) -> Result<Vec<ErrorReport>> {
        let tau = self.threshold;
        let mut answers = Vec::with_capacity(3 + self.imf.len());
        for section in [self.in_sample, self.out_of_sample] {
            answers.push(field_sections(plan, &[section], tau, control, &mut field)?.overall);
        }
        for (set, exact) in self.imf.iter().zip(&exact.imf) {
            answers.push(field_imf(exact, &set.orientations, tau, control, &mut field)?);
        }
        answers.push(field_sections(plan, &self.random.orientations, tau, control, &mut field)?.overall);
        Ok(answers)
    }
}
