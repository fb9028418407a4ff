//! Straight motions with a turning tool: proven free by conservative advancement.
//!
//! On the way from one pose to another ([`Pose::interpolate`]) no point of the tool moves farther in a time dt than dt times
//! the tip's way plus the turn's angle times the tool's reach. So where a clearance c is proven at one time, the motion is free
//! as long as no point has moved by c, before and after. A clearance comes from the obstacle's distance transform; where that
//! proves none, from tools offset by fixed lengths, which collide or not exactly. What is left are stretches where the tool passes closer than the smallest of these lengths and is not
//! seen to collide: they are undecided. So is a motion to where double precision tells no voxel from the next one, but for its
//! ends: it would take as many steps as there are numbers.

use std::sync::{Arc, OnceLock};

use crate::field::ExactField;
use crate::pose::{Pose, StraightMotion};
use crate::tool::ToolShape;

/// What is known of a motion; times run from 0 at its beginning to 1 at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionResult {
    /// No pose of it collides.
    Free,
    /// A pose of it collides.
    Colliding {
        /// Before this time no pose collides.
        free_until: f64,
        /// Time of the first pose that was found to collide: where `free_until` is not close to it, what lies between
        /// could not be decided.
        at: f64,
        /// That pose.
        pose: Pose,
    },
    /// No pose was found to collide, and this stretch, the first such one, could not be decided: the tool passes by very
    /// closely.
    Undecided {
        /// Before this time no pose collides.
        from: f64,
        /// End of the stretch.
        to: f64,
    },
}

/// Why a motion cannot be validated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MotionError {
    /// An end is an invalid pose.
    #[error("an end of the motion is an invalid pose: a number is not finite, or the rotation has no length")]
    InvalidPose,
    /// Which way the tool turns is not said.
    #[error(
        "the tool's axes at the ends are opposite: give a pose between, so that it is clear which way the tool turns"
    )]
    Opposite,
    /// Nothing is proven for mesh tools.
    #[error("motions are proven for tools of revolution: describe the tool by cutter, shank and holder")]
    Mesh,
    /// The tool cannot be offset.
    #[error("the tool cannot be offset by a small clearance")]
    Offset,
}

/// Lengths by which the tool is offset, in pitches, largest first.
const OFFSETS: [f64; 3] = [0.5, 0.125, 1.0 / 32.0];
/// Taken off every proven clearance, in pitches: more than the slack of the tool's predicate.
const MARGIN: f64 = 2e-4;
/// Upper bound of the rounding error of an axis from a quaternion, in radians.
const ANGLE: f64 = 1e-11;
/// Bisection steps between a pose that does not collide and one that does.
const HALVINGS: usize = 12;

/// The field, and its tool offset further.
struct Checker {
    field: ExactField,
    offset: OnceLock<Option<[ExactField; OFFSETS.len()]>>,
}

/// Validates motions of a tool, exactly and without a model: verdicts for every pose between two.
///
/// Clones share field and offset tools; threads share one checker.
#[derive(Clone)]
pub struct MotionChecker(Arc<Checker>);

impl MotionChecker {
    /// Of the tool and the obstacle of an exact field.
    #[must_use]
    pub fn new(field: ExactField) -> Self {
        Self(Arc::new(Checker { field, offset: OnceLock::new() }))
    }

    /// The field that it checks by.
    #[must_use]
    pub fn field(&self) -> &ExactField {
        &self.0.field
    }

    /// Whether the tool may move from `a` to `b`: the tip along the straight line, the axis along the great circle,
    /// both evenly ([`Pose::interpolate`]). Proven free, or colliding, or undecided where the tool passes by closer than a thirtieth of a voxel.
    /// The first call makes the tools that proofs need.
    ///
    /// # Errors
    /// An end that is an invalid pose, axes that are opposite, a mesh tool.
    pub fn check_motion(&self, a: &Pose, b: &Pose) -> Result<MotionResult, MotionError> {
        let Checker { field, offset } = &*self.0;
        if matches!(field.assembly().tool().shape, ToolShape::Mesh(_)) {
            return Err(MotionError::Mesh);
        }
        if !(a.is_valid() && b.is_valid()) {
            return Err(MotionError::InvalidPose);
        }
        let way = StraightMotion::new(a, b).ok_or(MotionError::Opposite)?;
        let offset = offset.get_or_init(|| offset_further(field)).as_ref().ok_or(MotionError::Offset)?;
        Ok(advance(field, offset, &way, a, b))
    }
}

fn offset_further(field: &ExactField) -> Option<[ExactField; OFFSETS.len()]> {
    let pitch = field.obstacle().grid().pitch;
    let made = |offset: f64| {
        let assembly = field.assembly().offset_further(offset * pitch).ok()?;
        Some(ExactField::new(field.obstacle(), assembly))
    };
    let [a, b, c] = OFFSETS.map(made);
    Some([a?, b?, c?])
}

/// Conservative advancement from `a` to `b`.
fn advance(
    field: &ExactField,
    offset: &[ExactField; OFFSETS.len()],
    way: &StraightMotion,
    a: &Pose,
    b: &Pose,
) -> MotionResult {
    let pitch = field.obstacle().grid().pitch;
    let reach = field.reach();
    // Farthest that any point of the tool moves in a unit of time; the tool is round.
    let speed = way.motion_bound(reach, 0.0);
    // Of positions as large as the ends', of axes at the tool's far end.
    let largest = a.position.abs().max(b.position.abs()).max_element();
    let rounding = 4.0 * f64::EPSILON * largest;
    if rounding >= MARGIN * pitch {
        return too_far(field, a, b);
    }
    let margin = MARGIN * pitch + rounding + ANGLE * reach;
    let proven = |pose: &Pose| -> f64 {
        let coarse = field.clearance_bound(pose).unwrap_or(0.0).max(0.0);
        let fine = || {
            let free = offset.iter().position(|field| !field.collides(pose));
            free.map_or(0.0, |index| OFFSETS[index] * pitch)
        };
        let found = if coarse > OFFSETS[0] * pitch { coarse } else { coarse.max(fine()) };
        found - margin
    };
    let step = 0.25 * OFFSETS[OFFSETS.len() - 1] * pitch;
    // All times before it are free, but for what `undecided` says.
    let mut free_until = 0.0_f64;
    let mut undecided: Option<(f64, f64)> = None;
    let (mut time, mut before) = (0.0_f64, 0.0_f64);
    loop {
        let pose = way.at(time);
        if field.collides(&pose) {
            let (at, pose) = first(way, field, before, time, pose);
            let free_until = undecided.map_or(free_until, |(from, _)| from).min(at);
            return MotionResult::Colliding { free_until, at, pose };
        }
        let room = proven(&pose);
        let next = if room > 0.0 {
            let reached = room / speed;
            // What the proof at this time reaches back to.
            if time - reached > free_until {
                undecided = undecided.or(Some((free_until, time - reached)));
            }
            free_until = time + reached;
            free_until
        } else {
            time + step / speed
        };
        if time >= 1.0 {
            break;
        }
        before = time;
        // The end itself is tested as well; every step advances.
        time = next.max(time.next_up()).min(1.0);
    }
    if free_until < 1.0 {
        undecided = undecided.or(Some((free_until, 1.0)));
    }
    undecided.map_or(MotionResult::Free, |(from, to)| MotionResult::Undecided { from, to })
}

/// What is known of a motion that leads so far away, that double precision tells no voxel there: its ends.
fn too_far(field: &ExactField, a: &Pose, b: &Pose) -> MotionResult {
    match [(0.0, a), (1.0, b)].into_iter().find(|(_, pose)| field.collides(pose)) {
        Some((at, pose)) => MotionResult::Colliding { free_until: 0.0, at, pose: *pose },
        None => MotionResult::Undecided { from: 0.0, to: 1.0 },
    }
}

/// The earliest colliding pose that bisection finds between a time without and one with a collision.
fn first(way: &StraightMotion, field: &ExactField, mut low: f64, high: f64, pose: Pose) -> (f64, Pose) {
    let mut found = (high, pose);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + found.0);
        let pose = way.at(middle);
        if field.collides(&pose) {
            found = (middle, pose);
        } else {
            low = middle;
        }
    }
    found
}
