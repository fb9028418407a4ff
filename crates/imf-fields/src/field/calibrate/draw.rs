//! Poses drawn at random, and what they truly are.

use glam::{DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use super::{CHUNK, CalibrationError};
use crate::field::Field;
use crate::parallel::*;
use imf_core::control::Control;
use imf_core::field::{ExactField, PoseField};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::tool::{Clearance, ClearanceError, ToolShape};

/// Separates calibration's poses from those of training.
const SEED_MARK: u64 = 0x4341_4c49_4252_4154;
const TURN: f64 = std::f64::consts::TAU;
/// Pairs of positions tried for one boundary pose.
const TRIES: usize = 200;
/// Of a segment across the box: to a thousandth of a voxel and less.
const HALVINGS: usize = 18;

/// What a pose truly is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The true tool collides.
    Colliding,
    /// The offset tool alone does.
    Between,
    /// The offset tool is free.
    Clear,
}

/// A pose with the field's value.
pub(super) struct SampledPose {
    pub(super) value: f32,
    pub(super) kind: Kind,
    /// True where the value may decide.
    pub(super) decides: bool,
    /// Error of the value, where it was compared.
    pub(super) error: f64,
}

pub(super) struct Truth<'a> {
    field: &'a Field,
    bare: ExactField,
    offset: ExactField,
    /// Minimum clearance of any element.
    room: f64,
}

impl<'a> Truth<'a> {
    pub(super) fn new(field: &'a Field) -> Result<Self, ClearanceError> {
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

    /// As many poses as `draw` makes one by one, the first `errors` of them compared with the exact value. `part` separates draws of one seed.
    pub(super) fn seen(
        &self,
        draw: impl Fn(&Self, &mut ChaCha8Rng) -> Pose + Sync,
        count: usize,
        errors: usize,
        seed: u64,
        part: u64,
        control: Control<'_>,
    ) -> Result<Vec<SampledPose>, CalibrationError> {
        let chunks: Vec<Vec<SampledPose>> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                control.check()?;
                let first = chunk * CHUNK;
                let wanted = CHUNK.min(count - first);
                let mut random = ChaCha8Rng::seed_from_u64(seed ^ SEED_MARK);
                random.set_stream(part << 48 | chunk as u64);
                let poses: Vec<Pose> = (0..wanted).map(|_| draw(self, &mut random)).collect();
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
                    Ok(SampledPose { value, kind, decides: self.field.decides_at(pose.position), error })
                });
                let seen = each.collect::<Result<Vec<_>, CalibrationError>>()?;
                (control.progress)(1);
                Ok(seen)
            })
            .collect::<Result<_, CalibrationError>>()?;
        let mut seen = Vec::with_capacity(count);
        seen.extend(chunks.into_iter().flatten());
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

    /// A part with no free or no colliding pose has no boundary: uniform poses must do.
    pub(super) fn boundary(&self, random: &mut ChaCha8Rng) -> Pose {
        (0..TRIES).find_map(|_| self.near_contact(random)).unwrap_or_else(|| self.uniform(random))
    }

    pub(super) fn uniform(&self, random: &mut ChaCha8Rng) -> Pose {
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

/// Uniform in [0, 1), of 53 bits.
fn number(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}
