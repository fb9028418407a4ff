//! A learnt field against the exact one: sections, the inaccessibility measure, and the baseline that any field must
//! beat, the nearest section that training saw.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::learnt::LearntField;
use crate::metrics::{ErrorReport, Errors};
use crate::siren::EvaluationEngine;
use imf_core::control::Control;
use imf_core::field::{QueryError, WholeField};
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, SectionError, SectionPlan, imf, sections};

/// Exact sections held in memory at a time.
const AT_ONCE: usize = 8;

/// Why an evaluation stopped.
#[derive(Debug, Error)]
pub enum EvaluationError {
    /// An exact section failed, or the work was interrupted.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// The learnt field failed.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// A comparison with the nearest section needs sections.
    #[error("no training orientation to compare with")]
    NoTraining,
}

/// Errors over a set of sections.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SectionErrors {
    /// All sections together.
    pub overall: ErrorReport,
    /// Each section's own.
    pub sections: Vec<ErrorReport>,
}

/// Errors of a network's sections at `orientations`. One unit of progress is one section.
///
/// # Errors
/// A failed section, a failed device, or cancellation.
pub fn learnt_sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    engine: &mut dyn EvaluationEngine,
    threshold: f64,
    control: Control<'_>,
) -> Result<SectionErrors, EvaluationError> {
    whole_sections(plan, orientations, &mut LearntField::new(*plan.grid(), engine), threshold, control)
}

/// Errors of a field's sections at `orientations`, whatever its family. One unit of progress is one section.
///
/// # Errors
/// A failed section, a field that failed, or cancellation.
pub fn whole_sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    field: &mut dyn WholeField,
    threshold: f64,
    control: Control<'_>,
) -> Result<SectionErrors, EvaluationError> {
    compare(plan, orientations, threshold, control, |_, orientation, values| {
        Ok(field.section_at(orientation, values)?)
    })
}

/// Errors of any field's sections at `orientations`: `field` writes the section of an orientation. One unit of
/// progress is one section.
///
/// # Errors
/// A failed section, or cancellation.
pub fn field_sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    threshold: f64,
    control: Control<'_>,
    mut field: impl FnMut(&Orientation, &mut [f32]),
) -> Result<SectionErrors, EvaluationError> {
    compare(plan, orientations, threshold, control, |_, orientation, values| {
        field(orientation, values);
        Ok(())
    })
}

/// Errors of the least of any field's sections over `orientations`, against the `exact` one of the same orientations.
/// One unit of progress is one section.
///
/// # Errors
/// Cancellation.
pub fn field_imf(
    exact: &Imf,
    orientations: &[Orientation],
    threshold: f64,
    control: Control<'_>,
    mut field: impl FnMut(&Orientation, &mut [f32]),
) -> Result<ErrorReport, EvaluationError> {
    let mut least = Imf::new(exact.value.len());
    let mut values = vec![0.0; exact.value.len()];
    for (index, orientation) in orientations.iter().enumerate() {
        if control.is_cancelled() {
            return Err(SectionError::Cancelled.into());
        }
        field(orientation, &mut values);
        least.lower_to(index, &values);
        (control.progress)(1);
    }
    let mut errors = Errors::default();
    errors.add(&exact.value, &least.value, threshold);
    Ok(errors.report(threshold))
}

/// Errors made by answering with the exact section of the nearest orientation of `training`.
///
/// # Errors
/// A failed section, an empty `training`, or cancellation.
pub fn nearest_sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    training: &[Orientation],
    threshold: f64,
    control: Control<'_>,
) -> Result<SectionErrors, EvaluationError> {
    let nearest: Vec<Orientation> = orientations
        .iter()
        .map(|o| {
            let rotation = o.rotation();
            // The trace of R₁ᵀR₂ orders rotations by angle; axes alone where the tool has no roll to speak of.
            let closeness = |other: &Orientation| {
                if plan.tool().is_axisymmetric() {
                    o.direction().dot(other.direction())
                } else {
                    let product = rotation.transpose() * other.rotation();
                    product.x_axis.x + product.y_axis.y + product.z_axis.z
                }
            };
            training.iter().max_by(|a, b| closeness(a).total_cmp(&closeness(b))).copied()
        })
        .collect::<Option<_>>()
        .ok_or(EvaluationError::NoTraining)?;
    let mut stored: Vec<Vec<f32>> = Vec::new();
    compare(plan, orientations, threshold, control, |index, _, values| {
        if index.is_multiple_of(AT_ONCE) {
            let until = (index + AT_ONCE).min(nearest.len());
            let quiet = Control { progress: &|_| {}, ..control };
            stored = sections(plan, &nearest[index..until], quiet)?;
        }
        values.copy_from_slice(&stored[index % AT_ONCE]);
        Ok(())
    })
}

/// The inaccessibility measure, exact and learnt, and the errors between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ImfComparison {
    /// Exact IMF with its best orientations.
    pub exact: Imf,
    /// The field's.
    pub learnt: Imf,
    /// Errors of the values.
    pub errors: ErrorReport,
}

/// Errors of a network's inaccessibility measure over `orientations`, which exact sections also run over. One unit of
/// progress is one orientation.
///
/// # Errors
/// A failed section, a failed device, or cancellation.
pub fn learnt_imf(
    plan: &SectionPlan,
    orientations: &[Orientation],
    engine: &mut dyn EvaluationEngine,
    threshold: f64,
    control: Control<'_>,
) -> Result<ImfComparison, EvaluationError> {
    whole_imf(plan, orientations, &mut LearntField::new(*plan.grid(), engine), threshold, control)
}

/// Errors of a field's inaccessibility measure over `orientations`, whatever its family; exact sections run over them
/// too. One unit of progress is one orientation.
///
/// # Errors
/// A failed section, a field that failed, or cancellation.
pub fn whole_imf(
    plan: &SectionPlan,
    orientations: &[Orientation],
    field: &mut dyn WholeField,
    threshold: f64,
    control: Control<'_>,
) -> Result<ImfComparison, EvaluationError> {
    let exact = imf(plan, orientations, control)?;
    let quiet = Control { progress: &|_| {}, ..control };
    let learnt = field.least_over(orientations, quiet).map_err(|error| match error {
        QueryError::Cancelled => SectionError::Cancelled.into(),
        other => EvaluationError::Query(other),
    })?;
    let mut errors = Errors::default();
    errors.add(&exact.value, &learnt.value, threshold);
    Ok(ImfComparison { exact, learnt, errors: errors.report(threshold) })
}

fn compare(
    plan: &SectionPlan,
    orientations: &[Orientation],
    threshold: f64,
    control: Control<'_>,
    mut field: impl FnMut(usize, &Orientation, &mut [f32]) -> Result<(), EvaluationError>,
) -> Result<SectionErrors, EvaluationError> {
    let mut overall = Errors::default();
    let mut each = Vec::with_capacity(orientations.len());
    let mut values = vec![0.0; plan.grid().len()];
    for (chunk, part) in orientations.chunks(AT_ONCE).enumerate() {
        let quiet = Control { progress: &|_| {}, ..control };
        let exact = sections(plan, part, quiet)?;
        for (local, (orientation, section)) in part.iter().zip(&exact).enumerate() {
            if control.is_cancelled() {
                return Err(SectionError::Cancelled.into());
            }
            field(chunk * AT_ONCE + local, orientation, &mut values)?;
            let mut errors = Errors::default();
            errors.add(section, &values, threshold);
            overall.merge(&errors);
            each.push(errors.report(threshold));
            (control.progress)(1);
        }
    }
    Ok(SectionErrors { overall: overall.report(threshold), sections: each })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use imf_core::field::EngineError;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::orientation::OrientationSet;
    use imf_core::tool::Tool;

    fn plan() -> SectionPlan {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
        SectionPlan::new(&Occupancy { grid, solid }, &Tool::paper()).unwrap()
    }

    /// Answers a constant everywhere.
    struct Constant(f32);

    impl EvaluationEngine for Constant {
        fn describe(&self) -> String {
            "a constant".into()
        }

        fn evaluate(&mut self, _: &[f32], outputs: &mut [f32]) -> Result<(), EngineError> {
            outputs.fill(self.0);
            Ok(())
        }

        fn minimum(
            &mut self,
            _: &[[f32; 3]],
            _: &[[f32; 2]],
            least: &mut [f32],
            best: &mut [u32],
        ) -> Result<(), EngineError> {
            least.fill(self.0);
            best.fill(0);
            Ok(())
        }
    }

    #[test]
    fn a_constants_error_follows_from_mean_and_variance() {
        let plan = plan();
        let set = OrientationSet::parse("fibonacci:11").unwrap().orientations;
        let zero = learnt_sections(&plan, &set, &mut Constant(0.0), 0.01, Control::quiet()).unwrap();
        assert_eq!(zero.sections.len(), 11);
        assert_eq!((zero.overall.false_free, zero.overall.false_blocked), (1.0, 0.0));
        // mse(c) = variance + (mean − c)², and mae(0) is the mean.
        let mean = zero.overall.mae;
        assert!((zero.overall.mse - zero.overall.variance - mean * mean).abs() < 1e-9);
        let half = learnt_sections(&plan, &set, &mut Constant(0.5), 0.01, Control::quiet()).unwrap().overall;
        assert!((half.mse - half.variance - (mean - 0.5).powi(2)).abs() < 1e-9);
    }

    #[test]
    fn the_nearest_section_of_a_seen_orientation_is_itself() {
        let plan = plan();
        let set = OrientationSet::parse("fibonacci:11").unwrap().orientations;
        let seen = nearest_sections(&plan, &set, &set, 0.0, Control::quiet()).unwrap();
        assert_eq!(seen.overall.mpe, 0.0);
        assert_eq!(seen.overall.iou, 1.0);
        let poles = OrientationSet::parse("0,0;0,180").unwrap().orientations;
        let unseen = nearest_sections(&plan, &set, &poles, 0.0, Control::quiet()).unwrap();
        assert!(unseen.overall.mse > 0.0);
        assert!(matches!(
            nearest_sections(&plan, &set, &[], 0.0, Control::quiet()),
            Err(EvaluationError::NoTraining)
        ));
    }

    #[test]
    fn a_field_of_exact_sections_has_no_error() {
        let plan = plan();
        let set = OrientationSet::parse("fibonacci:11").unwrap().orientations;
        let mut scratch = imf_core::section::SectionScratch::default();
        let mut exact = |o: &Orientation, values: &mut [f32]| plan.cmf(o, &mut scratch, values).unwrap();
        let same = field_sections(&plan, &set, 0.0, Control::quiet(), &mut exact).unwrap();
        assert_eq!((same.overall.mpe, same.overall.iou, same.sections.len()), (0.0, 1.0, 11));
        let least = imf(&plan, &set, Control::quiet()).unwrap();
        assert_eq!(field_imf(&least, &set, 0.0, Control::quiet(), &mut exact).unwrap().mpe, 0.0);
        // The least over fewer orientations is larger somewhere.
        let fewer = field_imf(&least, &set[..3], 0.0, Control::quiet(), &mut exact).unwrap();
        assert!(fewer.mpe > 0.0 && fewer.false_free == 0.0);
    }

    #[test]
    fn the_imf_is_compared_with_the_exact_one() {
        let plan = plan();
        let set = OrientationSet::parse("fibonacci:11").unwrap().orientations;
        let exact = imf(&plan, &set, Control::quiet()).unwrap();
        let mean = exact.value.iter().map(|&v| f64::from(v)).sum::<f64>() / exact.value.len() as f64;
        let report = learnt_imf(&plan, &set, &mut Constant(0.0), 0.01, Control::quiet()).unwrap();
        assert!((report.errors.mae - mean).abs() < 1e-7);
        assert_eq!(report.exact, exact);
    }
}
