//! What teaches a network: a harmonic field, or exact sections as they come.

use anyhow::{Result, ensure};
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::scene::Scene;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredShape, FactoredState};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitReport, FitSettings, Sizes};
use imf_fields::siren::ShapeError;
use imf_train::distill::{
    SectionTeacher, bytes_to_solve, optimiser_bytes, start_from, teach, teach_by_sections,
    teach_by_sections_on, teach_on,
};
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Outcome, Report, TrainError};

use super::Settings;
use crate::session::Session;

/// Bytes of a weight: itself, transposed, gradient, two moments, and a copy of weights and moments in a checkpoint.
const BYTES_PER_PARAMETER: u64 = 4 * 8;

/// How large a lesson becomes: known before its teacher is made.
pub struct Extent {
    kind: Kind,
    fit: FitSettings,
    domain: Domain,
    voxels: usize,
}

/// What teaches.
enum Kind {
    Harmonic,
    Sections,
}

impl Extent {
    /// By a harmonic field.
    pub fn of_field(fit: FitSettings, domain: Domain, voxels: usize) -> Self {
        Self { kind: Kind::Harmonic, fit, domain, voxels }
    }

    /// By sections.
    pub(in crate::commands) fn of_sections(fit: FitSettings, domain: Domain, voxels: usize) -> Self {
        Self { kind: Kind::Sections, fit, domain, voxels }
    }

    /// Refuses a lesson that does not fit into memory, the choice of its functions by sections with it.
    pub fn require(&self, session: &Session, settings: &Settings) -> Result<()> {
        let Self { kind, fit, domain, voxels } = self;
        let (teach, voxels) = (&settings.teach, *voxels);
        let Sizes { functions, axes, .. } = fit.sizes(*domain);
        // A network that is told of symmetry has every function for an output; whether there is any is seen later. Three
        // matrices of these are held while it is taught.
        let may_be_told = matches!((kind, domain), (Kind::Harmonic, Domain::Directions));
        let outputs = if may_be_told { functions } else { axes };
        let frames = if may_be_told { 12 * (functions * functions) as u64 } else { 0 };
        let (chosen, teacher, what) = match kind {
            Kind::Harmonic => {
                let field = fit.memory(*domain, voxels).1 + 4 * (functions * (axes + 1)) as u64;
                (
                    0,
                    field + frames + bytes_to_solve(teach, voxels, outputs),
                    "the harmonic field and the network",
                )
            }
            Kind::Sections => (
                fit.outline_memory(*domain, voxels),
                SectionTeacher::memory_bytes(functions, axes, voxels, teach),
                "the sections and the network",
            ),
        };
        let signals = 8 * teach.plan.batch.min(voxels) as u64 * (teach.width * teach.hidden + outputs) as u64;
        let shape = teach.shape(outputs);
        let network =
            BYTES_PER_PARAMETER * shape.parameter_count() as u64 + optimiser_bytes(teach.optimiser, shape);
        session.require_memory(chosen.max(teacher + network + signals), || {
            format!("{what}; {}", settings.smaller)
        })
    }
}

/// Where a network's coefficients come from.
pub enum Teacher<'a> {
    /// Those of a harmonic field.
    Harmonic(&'a HarmonicFile),
    /// Those that exact sections tell.
    Sections(Box<Sections<'a>>),
}

/// The sections of a scene, along functions that were chosen.
pub struct Sections<'a> {
    pub(in crate::commands) teacher: SectionTeacher<'a>,
    pub(in crate::commands) scene: &'a Scene,
    /// What the functions were chosen by.
    pub(in crate::commands) fit: FitSettings,
}

impl Teacher<'_> {
    pub(super) fn scene(&self) -> &Scene {
        match self {
            Self::Harmonic(file) => &file.scene,
            Self::Sections(sections) => sections.scene,
        }
    }

    pub(super) fn grid(&self) -> &Grid {
        &self.scene().record.grid
    }

    pub(super) fn fit(&self) -> FitSettings {
        match self {
            Self::Harmonic(file) => file.settings,
            Self::Sections(sections) => sections.fit,
        }
    }

    pub(super) fn report(&self) -> FitReport {
        match self {
            Self::Harmonic(file) => file.field.report,
            Self::Sections(sections) => sections.teacher.report(),
        }
    }

    /// Outputs of the network.
    pub(super) fn outputs(&self, settings: &DistillSettings) -> usize {
        match self {
            Self::Harmonic(file) => settings.outputs(&file.field),
            Self::Sections(sections) => sections.teacher.axis_count(),
        }
    }

    /// How large the lesson becomes.
    pub(super) fn extent(&self) -> Extent {
        let (kind, domain) = match self {
            Self::Harmonic(file) => (Kind::Harmonic, file.field.basis.domain()),
            Self::Sections(sections) => (Kind::Sections, sections.teacher.domain()),
        };
        Extent { kind, fit: self.fit(), domain, voxels: self.grid().len() }
    }

    /// What is taught, for people.
    pub(super) fn lesson(&self, settings: &DistillSettings) -> String {
        let voxels = self.grid().len();
        match self {
            Self::Harmonic(_) => format!("the coefficients of {voxels} voxels"),
            Self::Sections(_) => {
                let pool = settings.online.unwrap_or_default().pool;
                format!("{voxels} voxels by exact sections, {pool} at a time")
            }
        }
    }

    /// Random weights, or those of another field.
    pub(super) fn begun(
        &self,
        settings: &DistillSettings,
        from: Option<&FactoredFile>,
    ) -> Result<FactoredState> {
        let (Some(from), Self::Harmonic(HarmonicFile { field: teacher, scene, .. })) = (from, self) else {
            return Ok(settings.start(self.outputs(settings)));
        };
        ensure!(
            from.field.basis.domain() == teacher.basis.domain(),
            "--from is a field of another kind of tool: one is symmetric about its axis, the other is not"
        );
        ensure!(
            from.field.quantity == teacher.quantity,
            "--from is a field of another quantity: one is of overlaps, the other of depths"
        );
        Ok(start_from(&from.field, teacher, &scene.obstacle)?)
    }

    pub(super) fn field(
        &self,
        shape: FactoredShape,
        parameters: Vec<f32>,
    ) -> Result<FactoredField, ShapeError> {
        match self {
            Self::Harmonic(file) => FactoredField::new(&file.field, shape, parameters),
            Self::Sections(sections) => sections.teacher.field(shape, parameters),
        }
    }

    /// Teaches on an engine that continues from `state`, or on the CPU.
    pub(super) fn teach(
        &self,
        settings: &DistillSettings,
        state: &mut FactoredState,
        engine: Option<&mut dyn TrainingEngine>,
        control: Control<'_>,
        observer: &mut dyn FnMut(&Report),
    ) -> Result<Outcome, TrainError> {
        match (self, engine) {
            (Self::Harmonic(file), None) => teach(&file.field, settings, state, control, observer),
            (Self::Harmonic(file), Some(engine)) => {
                teach_on(&file.field, settings, state, engine, control, observer)
            }
            (Self::Sections(sections), None) => {
                teach_by_sections(&sections.teacher, settings, state, control, observer)
                    .map(|(outcome, _)| outcome)
            }
            (Self::Sections(sections), Some(engine)) => {
                let taught =
                    teach_by_sections_on(&sections.teacher, settings, state, engine, control, observer);
                taught.map(|(outcome, _)| outcome)
            }
        }
    }
}
