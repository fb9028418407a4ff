//! Thresholds for decisions, chosen and judged against exact answers.
//!
//! Two kinds of poses are drawn. *Uniform* ones: positions uniform in the box of the voxel centres, where the field is
//! known, orientations uniform. *Boundary* ones: between a free and a colliding position of one orientation the true tool's
//! contact is sought by halving, and left again by up to a pitch in any direction. Thresholds follow from uniform poses
//! alone, so that their rates are rates of all poses; both kinds judge them, drawn anew.
//!
//! The threshold of "free" is the largest at which the bound of the false-free rate keeps half the goal, which leaves
//! room for the judging poses to differ; that of "colliding" is the smallest at which the rate among clear poses
//! keeps nine tenths of its goal. Where the second lies below the first every pose can be decided, and both are moved to the
//! middle between: then either rate is far below its goal.

mod more_poses;

use glam::{DQuat, DVec3};

use crate::parallel::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use thiserror::Error;

use crate::calibration::{Calibration, Goals, Judgement, Rate, decide, most_errors};
use crate::field::Field;
use crate::metrics::larger;
use imf_core::control::Control;
use imf_core::field::{Decision, ExactField, FieldError, PoseField};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::tool::{Clearance, ClearanceError, ToolError, ToolShape};

/// How many poses are drawn, and what the thresholds must reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationSettings {
    /// Uniform poses to choose by, and as many to judge by.
    pub uniform: usize,
    /// Boundary poses to judge by.
    pub boundary: usize,
    /// Of either kind, poses whose overlap is compared with the exact one; depths are judged at all.
    pub errors: usize,
    /// Seed of all poses.
    pub seed: u64,
    /// What the thresholds must reach.
    pub goals: Goals,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self { uniform: 400_000, boundary: 50_000, errors: 2_000, seed: 0, goals: Goals::default() }
    }
}

/// Why a field is not calibrated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// A goal out of range.
    #[error("{name} must lie between 0 and 1, not {value}")]
    Goal {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// Too few poses for so small a rate.
    #[error(
        "{colliding} colliding poses do not show a false-free rate of {rate:e} at this confidence even without an error: \
         draw more poses"
    )]
    TooFew {
        /// Colliding poses drawn.
        colliding: usize,
        /// The target rate.
        rate: f64,
    },
    /// The field has a value that is no number.
    #[error("the field has values that are not finite: it decides nothing, make or train it anew")]
    NotFinite,
    /// Poses cannot be answered.
    #[error(transparent)]
    Planner(#[from] FieldError),
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The tool cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled,
}

/// Poses drawn and answered at a time; one unit of progress.
#[doc(hidden)]
pub const CHUNK: usize = 1024;

impl CalibrationSettings {
    /// Units of progress of [`calibrate`].
    pub fn units(&self) -> u64 {
        (2 * self.uniform.div_ceil(CHUNK) + self.boundary.div_ceil(CHUNK)) as u64
    }

    /// Bytes of the poses of [`calibrate`]: those that thresholds are chosen by, with their sorted values, and beside them
    /// those that judge, each kind twice while its chunks are joined.
    pub fn memory_bytes(&self) -> u64 {
        let seen = size_of::<Seen>() as u64;
        // Values are sorted beside the list that they were gathered in, which may have grown to twice its length.
        let chosen = (seen + 8).saturating_mul(self.uniform as u64);
        let judged = (2 * seen).saturating_mul((self.uniform as u64).saturating_add(self.boundary as u64));
        chosen.saturating_add(judged)
    }

    fn check(&self) -> Result<(), CalibrationError> {
        let Goals { false_free, false_colliding, confidence } = self.goals;
        let all = [
            ("the false-free rate", false_free),
            ("the false-colliding rate", false_colliding),
            ("the confidence", confidence),
        ];
        match all.into_iter().find(|(_, value)| !(*value > 0.0 && *value < 1.0)) {
            Some((name, value)) => Err(CalibrationError::Goal { name, value }),
            None => Ok(()),
        }
    }
}

/// Chooses a field's thresholds and judges them, on all threads of the current pool. The same settings give the same
/// poses.
///
/// # Errors
/// Goals out of range, too few poses to show the target rate, a tool that does not fit, cancellation.
pub fn calibrate(
    field: &Field,
    settings: &CalibrationSettings,
    control: Control<'_>,
) -> Result<Calibration, CalibrationError> {
    settings.check()?;
    let goals = settings.goals;
    let truth = Truth::new(field)?;
    let seen = truth.seen(Draw::Uniform, settings.uniform, 0, settings.seed, 0, control)?;
    if seen.iter().any(|seen| !seen.value.is_finite()) {
        return Err(CalibrationError::NotFinite);
    }
    let values = |kind: Kind| {
        let mut values: Vec<f32> = seen.iter().filter(|s| s.kind == kind).map(|s| s.value).collect();
        values.sort_by(f32::total_cmp);
        values
    };
    let (colliding, clear) = (values(Kind::Colliding), values(Kind::Clear));
    if most_errors(colliding.len() as u64, goals.false_free, goals.confidence).is_none() {
        return Err(CalibrationError::TooFew { colliding: colliding.len(), rate: goals.false_free });
    }
    // Where even half the goal cannot be shown, no error at all is the best there is.
    let most = most_errors(colliding.len() as u64, 0.5 * goals.false_free, goals.confidence).unwrap_or(0);
    let free_up_to = colliding.get(most as usize).map(|value| value.next_down());
    let colliding_from = match most_errors(clear.len() as u64, 0.9 * goals.false_colliding, goals.confidence)
    {
        Some(most) => clear.iter().rev().nth(most as usize).map(|value| value.next_up()),
        None => clear.last().map(|value| value.next_up()),
    };
    let (free_up_to, colliding_from) = match (free_up_to, colliding_from) {
        // Every pose can be decided: in the middle of what the goals allow.
        (Some(free), Some(blocked)) if blocked <= free => {
            let middle = 0.5 * (free + blocked);
            (Some(middle), Some(middle.next_up()))
        }
        (Some(free), None) => (Some(free), Some(free.next_up())),
        (None, None) => (None, Some(f32::MIN)),
        apart => apart,
    };
    let thresholds = Thresholds { free_up_to, colliding_from, goals };
    let [uniform, boundary] = thresholds.judge(&truth, settings, control)?;
    Ok(Calibration { free_up_to, colliding_from, goals, seed: settings.seed, uniform, boundary })
}

/// Judges a field's own calibration on fresh poses of another seed: uniform ones and boundary ones.
///
/// # Errors
/// As [`calibrate`].
pub fn judge(
    field: &Field,
    calibration: &Calibration,
    settings: &CalibrationSettings,
    control: Control<'_>,
) -> Result<[Judgement; 2], CalibrationError> {
    settings.check()?;
    let Calibration { free_up_to, colliding_from, .. } = *calibration;
    let thresholds = Thresholds { free_up_to, colliding_from, goals: settings.goals };
    thresholds.judge(&Truth::new(field)?, settings, control)
}

/// What a pose truly is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The true tool collides.
    Colliding,
    /// The offset tool alone does.
    Between,
    /// The offset tool is free.
    Clear,
}

/// Which poses are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Draw {
    Uniform,
    Boundary,
}

/// A pose with the field's answer.
struct Seen {
    value: f32,
    kind: Kind,
    /// Error of the value, where it was compared.
    error: f64,
}

struct Truth<'a> {
    field: &'a Field,
    bare: ExactField,
    offset: ExactField,
    /// Least clearance of any element.
    room: f64,
}

impl<'a> Truth<'a> {
    fn new(field: &'a Field) -> Result<Self, ClearanceError> {
        let scene = field.scene();
        let clearance = scene.record.clearance;
        let bare = ExactField::of_scene(scene, &Clearance::default())?;
        let offset = ExactField::of_scene(scene, &clearance)?;
        let room = match &scene.record.bare_tool().shape {
            ToolShape::Revolved(elements) => {
                elements.iter().map(|element| clearance.of(element.kind)).fold(f64::INFINITY, f64::min)
            }
            ToolShape::Mesh(_) => 0.0,
        };
        Ok(Self { field, bare, offset, room: if room.is_finite() { room } else { 0.0 } })
    }

    /// So many poses, the first `errors` of them compared with the exact value. `part` keeps draws of one seed apart.
    fn seen(
        &self,
        draw: Draw,
        count: usize,
        errors: usize,
        seed: u64,
        part: u64,
        control: Control<'_>,
    ) -> Result<Vec<Seen>, CalibrationError> {
        let chunks: Vec<Vec<Seen>> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                if control.is_cancelled() {
                    return Err(CalibrationError::Cancelled);
                }
                let first = chunk * CHUNK;
                let wanted = CHUNK.min(count - first);
                let mut random = ChaCha8Rng::seed_from_u64(seed ^ SEED_MARK);
                random.set_stream(part << 48 | chunk as u64);
                let poses: Vec<Pose> = (0..wanted).map(|_| self.pose(draw, &mut random)).collect();
                let mut values = vec![0.0; wanted];
                self.field.values_unclipped(&poses, &mut values)?;
                let each = poses.iter().zip(values).enumerate().map(|(place, (pose, value))| {
                    let kind = match (self.bare.collides(pose), self.offset.collides(pose)) {
                        (true, _) => Kind::Colliding,
                        (false, true) => Kind::Between,
                        (false, false) => Kind::Clear,
                    };
                    let error = match self.field.quantity() {
                        Quantity::Depth => self.wrong_side(kind, value),
                        Quantity::Overlap if first + place < errors => {
                            (self.offset.overlap(pose)? - f64::from(value.clamp(0.0, 1.0))).abs()
                        }
                        Quantity::Overlap => 0.0,
                    };
                    Ok(Seen { value, kind, error })
                });
                let seen = each.collect::<Result<Vec<_>, CalibrationError>>()?;
                (control.progress)(1);
                Ok(seen)
            })
            .collect::<Result<_, _>>()?;
        let mut seen = Vec::with_capacity(count);
        chunks.into_iter().for_each(|chunk| seen.extend(chunk));
        Ok(seen)
    }

    /// How far a depth lies beyond what its pose allows: a colliding tool is at least as deep as its clearance.
    fn wrong_side(&self, kind: Kind, depth: f32) -> f64 {
        let depth = f64::from(depth);
        let wrong = match kind {
            Kind::Colliding => self.room - depth,
            Kind::Between => -depth,
            Kind::Clear => depth,
        };
        wrong.max(0.0)
    }

    fn pose(&self, draw: Draw, random: &mut ChaCha8Rng) -> Pose {
        match draw {
            Draw::Uniform => self.uniform(random),
            Draw::Boundary => {
                // A part with no free or no colliding pose has no boundary: uniform poses must do.
                let found = (0..TRIES).find_map(|_| self.near_contact(random));
                found.unwrap_or_else(|| self.uniform(random))
            }
        }
    }

    fn uniform(&self, random: &mut ChaCha8Rng) -> Pose {
        let grid = &self.field.scene().record.grid;
        let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
        // A hair inside, so that single precision does not step over a face.
        let unit = (DVec3::new(number(random), number(random), number(random)) - 0.5) * (1.0 - 2e-6) + 0.5;
        // Shoemake's uniform rotation.
        let (a, b, c) = (number(random), TURN * number(random), TURN * number(random));
        let (near, far) = ((1.0 - a).sqrt(), a.sqrt());
        let rotation = DQuat::from_xyzw(near * b.sin(), near * b.cos(), far * c.sin(), far * c.cos());
        Pose::new(low + unit * (high - low), rotation)
    }

    /// A pose within a pitch of the true tool's contact, if two uniform positions find one.
    fn near_contact(&self, random: &mut ChaCha8Rng) -> Option<Pose> {
        let grid = &self.field.scene().record.grid;
        let start = self.uniform(random);
        let other = Pose { rotation: start.rotation, ..self.uniform(random) };
        if self.bare.collides(&start) == self.bare.collides(&other) {
            return None;
        }
        let blocked = self.bare.collides(&start);
        let (mut low, mut high) = (start.position, other.position);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.bare.collides(&Pose { position: middle, ..start }) == blocked {
                low = middle;
            } else {
                high = middle;
            }
        }
        // Uniform in a ball of a pitch, by trying points of its cube.
        let mut away = || 2.0 * DVec3::new(number(random), number(random), number(random)) - 1.0;
        let offset = std::iter::repeat_with(&mut away).find(|v| v.length_squared() <= 1.0)?;
        let position = low + offset * grid.pitch;
        grid.is_between_centres(position).then_some(Pose { position, ..start })
    }
}

/// Keeps calibration's poses apart from those of training.
const SEED_MARK: u64 = 0x4341_4c49_4252_4154;
const TURN: f64 = std::f64::consts::TAU;
/// Pairs of positions tried for one boundary pose.
const TRIES: usize = 200;
/// Of a segment across the box: to a thousandth of a voxel and less.
const HALVINGS: usize = 18;

/// Uniform in [0, 1), of 53 bits.
fn number(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

struct Thresholds {
    free_up_to: Option<f32>,
    colliding_from: Option<f32>,
    goals: Goals,
}

impl Thresholds {
    fn judge(
        &self,
        truth: &Truth<'_>,
        settings: &CalibrationSettings,
        control: Control<'_>,
    ) -> Result<[Judgement; 2], CalibrationError> {
        let CalibrationSettings { uniform, boundary, errors, seed, .. } = *settings;
        let uniform = truth.seen(Draw::Uniform, uniform, errors, seed, 1, control)?;
        let boundary = truth.seen(Draw::Boundary, boundary, errors, seed, 2, control)?;
        Ok([self.judgement(&uniform), self.judgement(&boundary)])
    }

    fn judgement(&self, seen: &[Seen]) -> Judgement {
        let count = |kind: Option<Kind>, decision: Option<Decision>| {
            let of = |s: &&Seen| {
                kind.is_none_or(|k| k == s.kind)
                    && decision.is_none_or(|d| d == decide(self.free_up_to, self.colliding_from, s.value))
            };
            seen.iter().filter(of).count() as u64
        };
        let rate = |kind, decision| {
            Rate::new(count(Some(kind), Some(decision)), count(Some(kind), None), self.goals.confidence)
        };
        // In the order that they were drawn in, so that pairs are independent.
        let of = |kind| seen.iter().filter(move |s| s.kind == kind).map(|s| s.value);
        let pairs = || of(Kind::Colliding).zip(of(Kind::Clear));
        let misordered = pairs().filter(|(colliding, clear)| colliding <= clear).count() as u64;
        Judgement {
            poses: seen.len() as u64,
            false_free: rate(Kind::Colliding, Decision::Free),
            false_colliding: rate(Kind::Clear, Decision::Colliding),
            undecided: count(None, Some(Decision::Undecided)),
            found_free: count(Some(Kind::Clear), Some(Decision::Free)),
            misordered: Rate::new(misordered, pairs().count() as u64, self.goals.confidence),
            largest_error: seen.iter().map(|s| s.error).fold(0.0, larger),
        }
    }
}
