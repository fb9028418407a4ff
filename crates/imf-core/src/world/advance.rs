//! Motions with a turning tool: proven free by conservative advancement.
//!
//! On the way from one pose to another no point of the tool moves farther in a time dt than dt times the way's
//! length, which is that of the tip plus the turns' angles times the tool's reach. So where a clearance c is proven
//! at one time, the motion is free as long as no point has moved by c, before and after. A clearance comes from the
//! obstacles' distance transforms; where those prove none, from tools offset by fixed lengths, which collide or not
//! exactly. On the remaining stretches the tool passes closer than the smallest of these lengths: there poses are
//! sampled so closely that no point moves farther than a given resolution between two.

use serde::{Deserialize, Serialize};

use super::checker::{Checker, Contact, PlacedField, QueryError};
use crate::field::ExactField;
use crate::machine::MachineMotion;
use crate::parallel::{self, make_once};
use crate::pose::{Pose, StraightMotion};

/// How motions are followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MotionOptions {
    /// Where the tool passes too closely for a proof: the farthest that any of its points moves between two poses that are tried, in
    /// the world's unit. `None` for a hundredth of the finest pitch.
    pub resolution: Option<f64>,
}

/// The result for a motion. Times run from 0 at its beginning to 1 at its end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionResult {
    /// Time and pose up to which the motion is free: its end where all of it is, else the last one before the first that collides. `None`
    /// where it begins with a collision.
    pub last_valid: Option<(f64, Pose)>,
    /// The first pose that was found to collide.
    pub first_colliding: Option<MotionCollision>,
    /// Before this time every pose is proven free. From then on, where the tool passes too closely, a voxel's centre may have been in the tool
    /// between two poses that were tried, no deeper than half the resolution.
    pub proven_until: f64,
}

impl MotionResult {
    /// True where no pose of the motion collides, to the resolution.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.first_colliding.is_none() && self.last_valid.is_some_and(|(time, _)| time >= 1.0)
    }

    /// True where every pose of the motion is proven free.
    #[must_use]
    pub fn is_proven(&self) -> bool {
        self.is_free() && self.proven_until >= 1.0
    }
}

/// A collision on the way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionCollision {
    /// Fraction of the motion, from 0 to 1.
    pub time: f64,
    /// The tool's pose.
    pub pose: Pose,
    /// What it hits.
    pub contact: Contact,
}

/// Lengths by which the tool is offset, in pitches, largest first.
pub(super) const OFFSETS: [f64; 3] = [0.5, 0.125, 1.0 / 32.0];
/// Taken off every proven clearance, in pitches: more than the slack of the tool's predicate.
const MARGIN: f64 = 2e-4;
/// Upper bound of the rounding error of an axis from a quaternion, in radians.
const ANGLE: f64 = 1e-11;
/// Bisection steps between a pose that does not collide and one that does.
const HALVINGS: usize = 12;
/// The resolution that is chosen, and the finest that is followed, in pitches.
const RESOLUTION: f64 = 0.01;
const FINEST: f64 = 1e-4;

impl Checker {
    /// Whether the tool may move from `a` to `b`: the tip along the straight line, the axis along the great circle, both evenly
    /// ([`Pose::interpolate`]). The first call makes the tools that proofs need.
    ///
    /// # Errors
    /// An end that is an invalid pose, axes that are opposite, a mesh tool, ends beyond double precision, a
    /// resolution that is not a length.
    pub fn check_motion(
        &self,
        a: &Pose,
        b: &Pose,
        options: &MotionOptions,
    ) -> Result<MotionResult, QueryError> {
        if !(a.is_valid() && b.is_valid()) {
            return Err(QueryError::InvalidPose);
        }
        let way = StraightMotion::new(a, b).ok_or(QueryError::Opposite)?;
        self.follow_way(&|time| way.at(time), way.motion_bound(self.tool.reach, 0.0), options)
    }

    /// Whether the tool may move with a machine's joints: rotary axes evenly, and the tip straight or the linear axes evenly
    /// ([`MachineMotion`]). The world's frame is the part's, as [`Machine::forward`](crate::machine::Machine::forward) has it. Head and
    /// table are not obstacles of it, and travel is not checked: see [`check`](mod@crate::check) and
    /// [`Machine::out_of_travel`](crate::machine::Machine::out_of_travel).
    ///
    /// # Errors
    /// As [`Checker::check_motion`]; a machine with a [fault](crate::machine::Machine::fault), or in another unit than the world's.
    pub fn check_machine_motion(
        &self,
        motion: &MachineMotion<'_>,
        options: &MotionOptions,
    ) -> Result<MotionResult, QueryError> {
        if let Some(fault) = motion.machine().fault() {
            return Err(QueryError::Machine { name: motion.machine().name.clone(), fault });
        }
        let (machine, world) = (motion.machine().unit, self.tool.unit);
        if machine != world {
            return Err(QueryError::Unit { machine, world });
        }
        self.follow_way(&|time| motion.pose(time), motion.tool_motion_bound(self.tool.reach), options)
    }

    /// [`Checker::check_motion`] of every pair of poses, on all threads of the current pool.
    #[must_use]
    pub fn check_motions_on_all_threads(
        &self,
        motions: &[[Pose; 2]],
        options: &MotionOptions,
    ) -> Vec<Result<MotionResult, QueryError>> {
        parallel::map(motions.len(), |index| {
            self.check_motion(&motions[index][0], &motions[index][1], options)
        })
    }

    /// Along the poses `at` times. No point of the tool moves farther than `length`, and evenly divided times divide it evenly.
    fn follow_way(
        &self,
        at: &dyn Fn(f64) -> Pose,
        length: f64,
        options: &MotionOptions,
    ) -> Result<MotionResult, QueryError> {
        if self.tool.assembly.tool().mesh().is_some() {
            return Err(QueryError::Mesh);
        }
        for one in self.placed.iter() {
            let offset = make_once(&one.around.offset, || offset_further(&one.around.field));
            offset.as_ref().ok_or(QueryError::Offset)?;
        }
        advance(self, at, length, options)
    }
}

fn offset_further(field: &ExactField) -> Option<[ExactField; OFFSETS.len()]> {
    let pitch = field.obstacle().grid().pitch;
    let made = |offset: f64| {
        let assembly = field.assembly().offset_further(offset * pitch).ok()?;
        Some(ExactField::around(field.prepared(), assembly))
    };
    let [a, b, c] = OFFSETS.map(made);
    Some([a?, b?, c?])
}

/// A proven lower bound of the distance from a tool that does not collide to one obstacle; at most 0 where none is proven.
fn room(one: &PlacedField, pose: &Pose) -> f64 {
    let field = &one.around.field;
    let pitch = field.obstacle().grid().pitch;
    let coarse = field.clearance_bound(pose).unwrap_or(0.0).max(0.0);
    let fine = || {
        let offset = one.around.offset.get().and_then(Option::as_ref);
        let free = offset.and_then(|offset| offset.iter().position(|field| !field.collides(pose)));
        free.map_or(0.0, |index| OFFSETS[index] * pitch)
    };
    let found = if coarse > OFFSETS[0] * pitch { coarse } else { coarse.max(fine()) };
    found - MARGIN * pitch
}

/// The same for all obstacles; those that are farther away for certain are not tried.
fn least_room(checker: &Checker, pose: &Pose) -> f64 {
    let Some(middle) = checker.tool_middle(pose) else { return 0.0 };
    let mut least = f64::INFINITY;
    for one in checker.placed.iter() {
        let gap = checker.gap(one, middle);
        if gap < least {
            least = least.min(room(one, &one.local(pose)).max(gap));
        }
    }
    least
}

/// Follows a way from its beginning to its end, or to the first collision.
fn advance(
    checker: &Checker,
    at: &dyn Fn(f64) -> Pose,
    length: f64,
    options: &MotionOptions,
) -> Result<MotionResult, QueryError> {
    let ends = [0.0, 1.0].map(|time| (time, at(time)));
    if !ends.iter().all(|(_, pose)| pose.is_valid()) {
        return Err(QueryError::InvalidPose);
    }
    let free = MotionResult { last_valid: Some(ends[1]), first_colliding: None, proven_until: 1.0 };
    let known = checker.finest_pitch();
    let (given, least) = (options.resolution, FINEST * known.unwrap_or(0.0));
    // The finest itself is accepted, however it is rounded.
    let is_length = |given: f64| given.is_finite() && given >= least * (1.0 - 1e-9);
    if let Some(given) = given.filter(|&given| !is_length(given)) {
        return Err(QueryError::Resolution { given, least });
    }
    let Some(pitch) = known else { return Ok(free) };
    let given = given.unwrap_or(RESOLUTION * pitch);
    // A tool that stands still takes no time.
    let length = length.max(f64::MIN_POSITIVE);
    // Of positions as large as the farthest on the way, of axes at the tool's far end.
    let largest = ends[0].1.position.abs().max_element() + length + checker.moved(&ends[0].1, length);
    let rounding = 8.0 * f64::EPSILON * largest + ANGLE * checker.tool.reach;
    if rounding >= MARGIN * pitch {
        let hit = ends.into_iter().find(|(_, pose)| !checker.is_free(pose));
        let Some((time, pose)) = hit else { return Err(QueryError::TooFar) };
        let last_valid = (time > 0.0).then_some(ends[0]);
        return Ok(MotionResult { last_valid, ..collision(checker, time, &pose)? });
    }
    // Proven free up to a time, except for gaps between two poses that prove too little; the first such gap.
    let (mut covered, mut gap) = (0.0_f64, None);
    let (mut time, mut before) = (0.0_f64, None);
    loop {
        let pose = at(time);
        if !checker.is_free(&pose) {
            let (last_valid, time, pose) = first(at, checker, before, time, pose);
            let last = last_valid.map_or(0.0, |(last, _)| last);
            let proven_until = gap.unwrap_or(covered).min(last);
            return Ok(MotionResult { last_valid, proven_until, ..collision(checker, time, &pose)? });
        }
        let room = (least_room(checker, &pose) - rounding).max(0.0);
        // What the proof at this time reaches back to.
        if time - room / length > covered {
            gap = gap.or(Some(covered));
        }
        covered = covered.max(time + room / length);
        if time >= 1.0 {
            return Ok(MotionResult { proven_until: gap.unwrap_or(1.0), ..free });
        }
        before = Some((time, pose));
        // The end itself is tried as well; every step advances.
        time = (time + room.max(given) / length).max(time.next_up()).min(1.0);
    }
}

fn collision(checker: &Checker, time: f64, pose: &Pose) -> Result<MotionResult, QueryError> {
    let contact = checker.contact(pose)?;
    let first_colliding = contact.map(|contact| MotionCollision { time, pose: *pose, contact });
    Ok(MotionResult { last_valid: None, first_colliding, proven_until: 0.0 })
}

/// The earliest colliding pose that bisection finds between a time without and one with a collision, and the last before it without.
fn first(
    at: &dyn Fn(f64) -> Pose,
    checker: &Checker,
    before: Option<(f64, Pose)>,
    time: f64,
    pose: Pose,
) -> (Option<(f64, Pose)>, f64, Pose) {
    let Some(mut low) = before else { return (None, time, pose) };
    let mut found = (time, pose);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low.0 + found.0);
        let pose = at(middle);
        if checker.is_free(&pose) {
            low = (middle, pose);
        } else {
            found = (middle, pose);
        }
    }
    (Some(low), found.0, found.1)
}
