//! A field of any family against the exact one: sections, the inaccessibility measure, and the baseline that any field must
//! beat, the nearest section that it was made from.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::metrics::{ErrorReport, Errors, Validation};
use crate::parallel::*;
use imf_core::control::Control;
use imf_core::field::{FieldError, GridField};
use imf_core::orientation::Orientation;
use imf_core::section::{DepthPlan, DepthScratch, Imf, Quantity, SectionError, SectionPlan, imf, sections};

/// Sections held in memory at a time, exact ones and as many learnt ones.
const AT_ONCE: usize = 8;

/// Why an evaluation stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// An exact section failed, or the work was interrupted.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// The learnt field failed.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// A comparison with the nearest section needs sections.
    #[error("no training orientation to compare with")]
    NoTraining,
}

/// The exact reference of a field: overlaps or depths of the tool that it was made for, and where the bare tool
/// collides.
pub struct ExactReference<'a> {
    plan: &'a SectionPlan,
    depth: Option<DepthPlan>,
    /// Says where the bare tool collides, where the values themselves do not.
    bare: Option<&'a SectionPlan>,
}

impl<'a> From<&'a SectionPlan> for ExactReference<'a> {
    /// Overlaps of a tool, which decisions are about too.
    fn from(plan: &'a SectionPlan) -> Self {
        Self { plan, depth: None, bare: None }
    }
}

impl<'a> ExactReference<'a> {
    /// Exact values of `quantity` for `plan`'s tool. Where that tool is offset by a clearance, `bare` is the plan of
    /// the true tool, by which decisions are counted.
    ///
    /// # Errors
    /// A tool that depths cannot be made of.
    pub fn new(
        plan: &'a SectionPlan,
        quantity: Quantity,
        bare: Option<&'a SectionPlan>,
    ) -> Result<Self, SectionError> {
        let depth = if quantity.is_overlap() { None } else { Some(DepthPlan::of(plan)?) };
        Ok(Self { plan, depth, bare })
    }

    /// The exact values of some orientations.
    ///
    /// # Errors
    /// A section that failed, or cancellation.
    pub fn sections(&self, set: &[Orientation], control: Control<'_>) -> Result<Vec<Vec<f32>>, SectionError> {
        let Some(depth) = &self.depth else { return sections(self.plan, set, control) };
        let section = |scratch: &mut DepthScratch, orientation: &Orientation| {
            control.check()?;
            let mut values = vec![0.0; depth.grid().len()];
            depth.depths(orientation, scratch, &mut values)?;
            (control.progress)(1);
            Ok(values)
        };
        set.par_iter().map_init(DepthScratch::default, section).collect()
    }

    /// The minimum of the values over some orientations. One unit of progress is one orientation.
    ///
    /// # Errors
    /// As [`ExactReference::sections`].
    pub fn minimum(&self, set: &[Orientation], control: Control<'_>) -> Result<Imf, SectionError> {
        if self.depth.is_none() {
            return imf(self.plan, set, control);
        }
        let mut least = Imf::new(self.plan.grid().len());
        for (chunk, part) in set.chunks(AT_ONCE).enumerate() {
            for (place, section) in self.sections(part, control)?.iter().enumerate() {
                least.lower_to(chunk * AT_ONCE + place, section);
            }
        }
        Ok(least)
    }
}

/// Errors over a set of sections.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SectionMetrics {
    /// All sections together.
    pub overall: ErrorReport,
    /// Each section's own.
    pub sections: Vec<ErrorReport>,
}

impl SectionMetrics {
    /// The mean squared error with its standard error, where the orientations were drawn at random.
    pub fn validation(&self) -> Validation {
        Validation::of(&self.sections.iter().map(|section| (section.mse, section.mpe)).collect::<Vec<_>>())
    }
}

/// Errors of a field's sections at `orientations`, whatever its family. One unit of progress is one section.
///
/// # Errors
/// A failed section, a field that failed, or cancellation.
pub fn grid_sections(
    exact: &ExactReference<'_>,
    orientations: &[Orientation],
    field: &dyn GridField,
    threshold: f64,
    control: Control<'_>,
) -> Result<SectionMetrics, EvaluationError> {
    compare(exact, orientations, threshold, control, |_, part, values| Ok(field.sections(part, values)?))
}

/// Errors of any field's sections at `orientations`: `field` writes the section of an orientation. One unit of
/// progress is one section.
///
/// # Errors
/// A failed section, or cancellation.
#[doc(hidden)]
pub fn field_sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    threshold: f64,
    control: Control<'_>,
    mut field: impl FnMut(&Orientation, &mut [f32]),
) -> Result<SectionMetrics, EvaluationError> {
    compare(&plan.into(), orientations, threshold, control, |_, part, values| {
        part.iter().zip(values.chunks_exact_mut(plan.grid().len())).for_each(|(o, values)| field(o, values));
        Ok(())
    })
}

/// Errors of the minimum of any field's sections over `orientations`, against the `exact` one of the same orientations.
/// One unit of progress is one section.
///
/// # Errors
/// Cancellation.
#[doc(hidden)]
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
        control.check().map_err(SectionError::from)?;
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
    exact: &ExactReference<'_>,
    orientations: &[Orientation],
    training: &[Orientation],
    threshold: f64,
    control: Control<'_>,
) -> Result<SectionMetrics, EvaluationError> {
    let nearest: Vec<Orientation> = orientations
        .iter()
        .map(|o| {
            let rotation = o.rotation();
            // The trace of R₁ᵀR₂ orders rotations by angle; axes alone where the tool has no roll to speak of.
            let closeness = |other: &Orientation| {
                if exact.plan.tool().is_axisymmetric() {
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
    compare(exact, orientations, threshold, control, |first, part, values| {
        let quiet = Control { progress: &|_| {}, ..control };
        values.copy_from_slice(&exact.sections(&nearest[first..][..part.len()], quiet)?.concat());
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

/// Errors of a field's inaccessibility measure over `orientations`, whatever its family; exact sections run over them
/// too. One unit of progress is one orientation.
///
/// # Errors
/// A failed section, a field that failed, or cancellation.
pub fn grid_imf(
    exact: &ExactReference<'_>,
    orientations: &[Orientation],
    field: &dyn GridField,
    threshold: f64,
    control: Control<'_>,
) -> Result<ImfComparison, EvaluationError> {
    let quiet = Control { progress: &|_| {}, ..control };
    let least = exact.minimum(orientations, control)?;
    let bare = exact.bare.map(|plan| imf(plan, orientations, quiet)).transpose()?;
    let learnt = field.minimum(orientations, quiet).map_err(|error| match error {
        FieldError::Cancelled(stop) => SectionError::from(stop).into(),
        other => EvaluationError::Field(other),
    })?;
    let mut errors = Errors::default();
    errors.add_beside(&least.value, &bare.as_ref().unwrap_or(&least).value, &learnt.value, threshold);
    Ok(ImfComparison { exact: least, learnt, errors: errors.report(threshold) })
}

/// `field` writes the sections of a few orientations, the first of which has the index that it is given.
fn compare(
    exact: &ExactReference<'_>,
    orientations: &[Orientation],
    threshold: f64,
    control: Control<'_>,
    mut field: impl FnMut(usize, &[Orientation], &mut [f32]) -> Result<(), EvaluationError>,
) -> Result<SectionMetrics, EvaluationError> {
    let mut overall = Errors::default();
    let mut each = Vec::with_capacity(orientations.len());
    let voxels = exact.plan.grid().len();
    let mut values = vec![0.0; voxels * orientations.len().min(AT_ONCE)];
    for (chunk, part) in orientations.chunks(AT_ONCE).enumerate() {
        let quiet = Control { progress: &|_| {}, ..control };
        let own = exact.sections(part, quiet)?;
        let bare = exact.bare.map(|plan| sections(plan, part, quiet)).transpose()?;
        let values = &mut values[..voxels * part.len()];
        field(chunk * AT_ONCE, part, values)?;
        let pairs = own.iter().zip(bare.as_ref().unwrap_or(&own));
        for ((section, bare), values) in pairs.zip(values.chunks_exact(voxels)) {
            let mut errors = Errors::default();
            errors.add_beside(section, bare, values, threshold);
            overall.merge(&errors);
            each.push(errors.report(threshold));
            (control.progress)(1);
        }
    }
    Ok(SectionMetrics { overall: overall.report(threshold), sections: each })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use imf_core::field::ExactField;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::orientation::OrientationSet;
    use imf_core::section::ToolPoints;
    use imf_core::tool::Tool;

    fn plan_and_set() -> (SectionPlan, Vec<Orientation>) {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
        let set = OrientationSet::parse("fibonacci:11").unwrap().orientations;
        let plan = SectionPlan::new(&Occupancy { grid, solid }, Tool::paper(), ToolPoints::SharpPoints);
        (plan.unwrap(), set)
    }

    #[test]
    fn a_constants_error_follows_from_mean_and_variance() {
        let (plan, set) = plan_and_set();
        let zero = field_sections(&plan, &set, 0.01, Control::quiet(), |_, out| out.fill(0.0)).unwrap();
        assert_eq!(zero.sections.len(), 11);
        assert_eq!((zero.overall.false_free, zero.overall.false_colliding), (1.0, 0.0));
        // mse(c) = variance + (mean − c)², and mae(0) is the mean.
        let mean = zero.overall.mae;
        assert!((zero.overall.mse - zero.overall.variance - mean * mean).abs() < 1e-9);
        let half =
            field_sections(&plan, &set, 0.01, Control::quiet(), |_, out| out.fill(0.5)).unwrap().overall;
        assert!((half.mse - half.variance - (mean - 0.5).powi(2)).abs() < 1e-9);
    }

    #[test]
    fn the_nearest_section_of_a_seen_orientation_is_itself() {
        let (plan, set) = plan_and_set();
        let seen = nearest_sections(&(&plan).into(), &set, &set, 0.0, Control::quiet()).unwrap();
        assert_eq!(seen.overall.mpe, 0.0);
        assert_eq!(seen.overall.iou, 1.0);
        let poles = OrientationSet::parse("0,0;0,180").unwrap().orientations;
        let unseen = nearest_sections(&(&plan).into(), &set, &poles, 0.0, Control::quiet()).unwrap();
        assert!(unseen.overall.mse > 0.0);
        assert!(matches!(
            nearest_sections(&(&plan).into(), &set, &[], 0.0, Control::quiet()),
            Err(EvaluationError::NoTraining)
        ));
    }

    #[test]
    fn a_field_of_exact_sections_has_no_error() {
        let (plan, set) = plan_and_set();
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
        let (plan, set) = plan_and_set();
        // The exact field itself, and one whose obstacle is empty.
        let tool = Tool::paper().with_tip_only();
        let same = ExactField::new(plan.obstacle(), &tool).unwrap();
        let none = ExactField::new(Occupancy::empty(*plan.grid()), &tool).unwrap();
        let plan = SectionPlan::new(plan.obstacle(), &tool, ToolPoints::SharpPoints).unwrap();
        let exact = imf(&plan, &set, Control::quiet()).unwrap();
        let mean = exact.value.iter().map(|&v| f64::from(v)).sum::<f64>() / exact.value.len() as f64;
        let found = grid_imf(&(&plan).into(), &set, &same, 0.01, Control::quiet()).unwrap();
        assert_eq!((found.errors.mpe, &found.exact, &found.learnt), (0.0, &exact, &exact));
        let found = grid_imf(&(&plan).into(), &set, &none, 0.01, Control::quiet()).unwrap();
        assert!((found.errors.mae - mean).abs() < 1e-7 && mean > 0.0);
        let sections = grid_sections(&(&plan).into(), &set, &none, 0.01, Control::quiet()).unwrap();
        let validation = sections.validation();
        assert!((validation.mse / sections.overall.mse - 1.0).abs() < 1e-12 && validation.orientations == 11);
        let sections = grid_sections(&(&plan).into(), &set, &same, 0.01, Control::quiet()).unwrap();
        assert_eq!(sections.overall.mpe, 0.0);
    }
}
