//! Fields of random numbers over a coarse teapot, of every family.

use std::sync::Arc;

use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::tool::Tool;
use imf_fields::calibration::Calibration;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredShape, Symmetry};
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::{Basis, Domain};
use imf_fields::harmonic::coefficients::{Coefficients, StoragePrecision};
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitReport, FitSettings, HarmonicField};
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;

use crate::devices::number;
use crate::queries::poses;

pub(crate) fn scene() -> Scene {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    scene.scene().expect("a scene")
}

/// Thresholds of any worth.
pub(crate) fn calibration(free_up_to: f32, colliding_from: f32) -> Calibration {
    Calibration::unmeasured(Some(free_up_to), Some(colliding_from))
}

/// What a field is made of.
#[derive(Clone, Copy)]
pub(crate) struct Spec {
    pub(crate) domain: Domain,
    pub(crate) degree: usize,
    pub(crate) components: usize,
    pub(crate) quantity: Quantity,
    pub(crate) symmetry: Symmetry,
    /// Of a factored field's coefficients: at 1 values lie on both sides of 0 and of 1, so that clipping is met.
    pub(crate) scale: f32,
}

impl Spec {
    pub(crate) fn new(domain: Domain, degree: usize, components: usize, quantity: Quantity) -> Self {
        Self { domain, degree, components, quantity, symmetry: Symmetry::default(), scale: 0.3 }
    }

    /// A field of random weights, axes and mean, which nothing trained: its values spread around 1/2 with waves of the highest
    /// degree among them. Thresholds cut them in three.
    pub(crate) fn factored(self) -> FactoredFile {
        let Self { domain, degree, components, quantity, symmetry, scale } = self;
        let scene = scene();
        let shape = FactoredShape { width: 44, hidden: 3, omega: 10.0, components, folded: false, symmetry };
        let basis = Basis::new(domain, degree);
        let mean = (0..basis.len()).map(|k| if k == 0 { 0.5 } else { 0.1 * number(k, 0.618_034) / k as f32 });
        let size = 1.0 / (basis.len() as f32).sqrt();
        let field = FactoredField {
            quantity,
            grid: scene.record.grid,
            components: (0..basis.len() * components)
                .map(|place| size * number(place + 1, 0.754_878))
                .collect(),
            mean: mean.collect(),
            basis,
            shape,
            parameters: shape.initial_parameters(3),
            scale,
        };
        let functions = field.basis.len();
        let precision = StoragePrecision::F32;
        let file = FactoredFile {
            field,
            scene,
            fit: FitSettings { quantity, degree, components, precision, ..FitSettings::default() },
            report: FitReport { functions, ..FitReport::default() },
            settings: DistillSettings::default(),
            precision,
            state: None,
            calibration: None,
        };
        let twin = Field::new(FieldFile::Factored(Box::new(file.clone()))).expect("a field");
        let asked = poses(&file.scene.record.grid, 500);
        let mut values = vec![0.0; asked.len()];
        twin.values_unclipped(&asked, &mut values).expect("values");
        values.retain(|value| value.is_finite());
        values.sort_by(f32::total_cmp);
        let calibration = calibration(values[values.len() / 3], values[values.len() * 2 / 3]);
        FactoredFile { calibration: Some(calibration), ..file }
    }

    /// With the network folded, if so.
    pub(crate) fn factored_file(self, folded: bool) -> FieldFile {
        let mut file = self.factored();
        if folded {
            file.field = file.field.folded();
        }
        FieldFile::Factored(Box::new(file))
    }

    /// The same functions with random coefficients at every voxel.
    pub(crate) fn harmonic(self, precision: StoragePrecision) -> Arc<HarmonicFile> {
        let Self { components, quantity, .. } = self;
        let FactoredFile { field, scene, fit, report, calibration, .. } = self.factored();
        let number = |place: usize| ((place as f64 * 0.569_840).fract() * 0.6 - 0.3) as f32;
        let values = (0..field.grid.len() * components).map(number).collect();
        Arc::new(HarmonicFile {
            field: HarmonicField {
                quantity,
                grid: field.grid,
                basis: field.basis,
                components: field.components,
                mean: field.mean,
                coefficients: Coefficients::new(values, precision),
                report,
            },
            scene,
            settings: fit,
            calibration,
        })
    }
}

/// A network of random weights, with thresholds among its values, which are worth nothing.
pub(crate) fn model(skip_after: Option<usize>) -> Model {
    let shape = SirenShape { width: 48, hidden: 3, skip_after, omega: 10.0 };
    let orientations = OrientationSet::parse("fibonacci:3").expect("a set");
    Model {
        shape,
        scene: scene(),
        record: TrainingRecord { finished: true, ..TrainingRecord::untrained(orientations) },
        state: TrainingState::new(&shape, 4),
        calibration: Some(calibration(0.49, 0.51)),
    }
}
