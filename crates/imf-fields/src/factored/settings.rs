//! How a network of the point is distilled, and what that changes.

use serde::{Deserialize, Serialize};

use super::{FactoredShape, Symmetry};
use crate::harmonic::HarmonicField;
use crate::recipe::divergence::Watch;
use crate::recipe::schedule::Schedule;
use crate::recipe::{
    AdamConfig, Cursor, Loss, Optimiser, RecipeError, SoapConfig, TrainingLength, TrainingPlan, TrainingState,
};

/// How a factored field is trained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DistillSettings {
    /// Neurons of every hidden layer.
    pub width: usize,
    /// Hidden layers.
    pub hidden: usize,
    /// Frequency factor ω.
    pub omega: f32,
    /// Length, batch, rate, loss, seed: an epoch is every voxel once.
    pub plan: TrainingPlan,
    /// How the weights follow the gradient.
    pub optimiser: Optimiser,
    /// Steps between two solutions of the output layer in closed form, one of which ends the training, and one begins it if it has
    /// no more than 400 steps; 0 for none. They are of least squares, whatever the plan's loss.
    pub solve_every: u64,
    /// The obstacle's symmetry as a prior, for a field of directions: [`Symmetry::of`] finds what there is.
    #[serde(skip_serializing_if = "Symmetry::is_none")]
    pub symmetry: Symmetry,
    /// CRC-32 of the weights of another field that it begins with; none where they are random.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<u32>,
}

/// Steps in which the rate rises; a closed-form output layer needs few.
const WARMUP: u64 = 10;
/// The highest rate from a training's length; it falls to 0 over it. Short ones hardly change the sines that they begin with, and the
/// output layer is solved for.
const RATES: Schedule =
    Schedule::Length { initial: 1.5e-3, steps: 1000, power: 0.75, shorter: 0.6, warmup: WARMUP };

/// The highest rate from another field's network, and steps between two solutions of the output layer: higher rates lose what it
/// knows in the first steps, before there are moments to go by.
const RATE_OF_ANOTHER: f32 = 3e-4;
const SOLVE_OF_ANOTHER: u64 = 10;

impl Default for DistillSettings {
    /// A network of about a megabyte, every voxel seen five times.
    fn default() -> Self {
        Self {
            width: 256,
            hidden: 3,
            omega: 20.0,
            plan: TrainingPlan {
                length: TrainingLength::Epochs(Self::EPOCHS),
                batch: 1024,
                schedule: RATES,
                adam: AdamConfig { weight_decay: 0.0, ..AdamConfig::default() },
                loss: Loss::L2,
                report_every: 20,
                ..TrainingPlan::default()
            },
            optimiser: Optimiser::Soap(SoapConfig::default()),
            solve_every: 25,
            symmetry: Symmetry::default(),
            from: None,
        }
    }
}

impl DistillSettings {
    /// Times that every voxel is seen by default.
    pub const EPOCHS: u64 = 5;

    /// The defaults for a length.
    #[must_use]
    pub fn of_length(length: TrainingLength) -> Self {
        let defaults = Self::default();
        Self { plan: TrainingPlan { length, ..defaults.plan }, ..defaults }
    }

    /// The defaults for a length of a warm start: a training from the network of another field, such as that of the part before
    /// it was changed.
    #[must_use]
    pub fn of_another(length: TrainingLength) -> Self {
        let usual = Self::of_length(length);
        let plan = TrainingPlan { schedule: Self::rates_from(RATE_OF_ANOTHER), ..usual.plan };
        Self { plan, solve_every: SOLVE_OF_ANOTHER, ..usual }
    }

    /// The rates of a training from the highest, which by default follows from the length.
    pub fn rates_from(highest: f32) -> Schedule {
        Schedule::Cosine { initial: highest, last: 0.0, warmup: WARMUP }
    }

    /// Outputs of the network that a field is distilled into: its components, or its functions where the network is
    /// symmetry-reduced.
    pub fn outputs(&self, teacher: &HarmonicField) -> usize {
        self.symmetry.coefficients(teacher.component_count(), teacher.basis.len())
    }

    /// The network for `components` components.
    pub fn shape(&self, components: usize) -> FactoredShape {
        let Self { width, hidden, omega, symmetry, .. } = *self;
        FactoredShape { width, hidden, omega, components, folded: false, symmetry }
    }

    /// The network that learns a field.
    #[must_use]
    pub fn shape_for(&self, teacher: &HarmonicField) -> FactoredShape {
        self.shape(self.outputs(teacher))
    }

    /// Voxels of a step.
    #[must_use]
    pub fn batch(&self, teacher: &HarmonicField) -> usize {
        self.plan.batch.min(teacher.grid.len())
    }

    /// The random start of a training.
    pub fn start(&self, components: usize) -> FactoredState {
        FactoredState::new(&self.shape(components), self.plan.seed)
    }

    /// Checks the ranges that types do not ensure.
    ///
    /// # Errors
    /// A plan or shape out of range, by name.
    pub fn check(&self) -> Result<(), RecipeError> {
        self.plan.check()?;
        let refuse = |what: String| Err(RecipeError(what));
        if self.plan.loss == Loss::L1Small {
            return refuse("loss l1-small is for the paper's network, whose outputs are shares".into());
        }
        if let Some(fault) = self.symmetry.fault() {
            return refuse(fault);
        }
        self.shape(1).check().map_err(|error| RecipeError(error.to_string()))
    }
}

/// Everything that training changes: enough to go on to the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredState {
    /// Weights, moments and steps.
    pub training: TrainingState,
    /// Where the plan stands.
    pub cursor: Cursor,
    /// Watches the losses for divergence.
    pub watch: Watch,
}

impl FactoredState {
    /// Random starting weights.
    #[must_use]
    pub fn new(shape: &FactoredShape, seed: u64) -> Self {
        Self::from_parameters(shape.initial_parameters(seed))
    }

    /// Given weights.
    #[must_use]
    pub fn from_parameters(parameters: Vec<f32>) -> Self {
        Self {
            training: TrainingState::from_parameters(parameters),
            cursor: Cursor::default(),
            watch: Watch::default(),
        }
    }
}
