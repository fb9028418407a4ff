//! What an evaluation is of: a field of any family, its scene, and the sections that it was made from.

use std::borrow::Cow;

use anyhow::Result;
use imf_core::orientation::Orientation;
use imf_core::scene::Scene;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::model::{Model, TrainingRecord};
use serde::Serialize;

/// A field to be evaluated.
pub struct Subject<'a> {
    pub(crate) scene: &'a Scene,
    /// Orientations of the sections that it was made from.
    pub(super) seen: Cow<'a, [Orientation]>,
    pub(super) made: Provenance,
    /// Where there is a curve of the training's loss.
    pub(super) training: Option<&'a TrainingRecord>,
}

/// How a field was made, for the report.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Provenance {
    family: &'static str,
    /// Numbers that make up the field: weights, or coefficients of all voxels.
    parameters: usize,
    #[serde(flatten)]
    training: Option<Training>,
    #[serde(skip)]
    how: String,
    /// In titles of panels.
    #[serde(skip)]
    pub(super) shown_as: &'static str,
    /// How the field was made from its sections: trained, fitted.
    #[serde(skip)]
    pub(super) participle: &'static str,
}

#[derive(Clone, Debug, Serialize)]
struct Training {
    training_samples: u64,
    training_steps: u64,
    training_engine: String,
}

impl Provenance {
    /// In words, for the head of the report.
    pub(super) fn describe(&self, sections: usize) -> String {
        format!("{}, made from {sections} exact sections", self.how)
    }
}

impl<'a> Subject<'a> {
    pub(crate) fn describe(&self) -> String {
        self.made.describe(self.seen.len())
    }

    /// A trained network.
    pub fn of_model(model: &'a Model) -> Self {
        let record = &model.record;
        let TrainingRecord { samples, steps, engine, .. } = record;
        let parameters = model.shape.parameter_count();
        Self {
            scene: &model.scene,
            seen: Cow::Borrowed(&record.orientations.orientations),
            made: Provenance {
                family: "siren5",
                parameters,
                training: Some(Training {
                    training_samples: *samples,
                    training_steps: *steps,
                    training_engine: engine.clone(),
                }),
                how: format!(
                    "network of {parameters} parameters, {samples} samples, {steps} steps on {engine}"
                ),
                shown_as: "learnt",
                participle: "trained",
            },
            training: Some(record),
        }
    }

    /// A field from a file of any family.
    ///
    /// # Errors
    /// A number of sections that no set can have.
    pub(crate) fn of_saved_field(saved: &'a FieldFile) -> Result<Self> {
        let (basis, report, family, parameters, how) = match saved {
            FieldFile::Siren(model) => return Ok(Self::of_model(model)),
            FieldFile::Harmonic(file) => {
                let field = &file.field;
                let of = match field.basis.domain() {
                    Domain::Directions => "direction",
                    Domain::Rotations => "rotation",
                };
                let how = format!(
                    "harmonic field of degree {}, {} basis functions of the {of}, {} principal components, {:.0} MB",
                    field.basis.degree(),
                    field.basis.len(),
                    field.component_count(),
                    field.bytes() as f64 / 1e6
                );
                (&field.basis, &field.report, "harmonic", field.coefficients.len(), how)
            }
            FieldFile::Factored(file) => {
                let (field, parameters) = (&file.field, file.field.parameter_count());
                let how = format!(
                    "factored field, {} ({parameters} parameters, {:.2} MB), distilled from a harmonic field of degree {}",
                    field.shape,
                    field.bytes() as f64 / 1e6,
                    field.basis.degree()
                );
                (&field.basis, &file.report, "factored", parameters, how)
            }
        };
        let (shown_as, participle) = (family, "fitted");
        Ok(Self {
            scene: saved.scene(),
            seen: Cow::Owned(basis.fitted_set(report.sections)?),
            made: Provenance { family, parameters, training: None, how, shown_as, participle },
            training: None,
        })
    }
}
