//! Queries: poses in C's layout are converted into the planner's a block at a time, on the stack.

use imf_core::field::{Best, Decision, FieldError, Gradient};
use imf_core::glam::{DQuat, DVec3};
use imf_core::pose::Pose;
use imf_core::world::{Checker, MotionOptions, QueryError};

use crate::boundary::{ImfStatus, Refusal, call, output, read, read_one};
use crate::field::ImfField;
use crate::values::{ImfBest, ImfDecision, ImfGradient, ImfMotion, ImfPose};

/// Poses turned at a time: the block that the planner's fields work in, so that batches are cut alike.
const BLOCK: usize = 256;

fn of_field(error: &FieldError) -> Refusal {
    let status = match error {
        FieldError::Length { .. } | FieldError::Orientations(_) => ImfStatus::Argument,
        _ => ImfStatus::NoAnswer,
    };
    Refusal::new(status, error.to_string())
}

/// Calls `ask` for every block of poses and writes its results, `blank` before.
///
/// # Safety
/// There are count poses, and room for count results.
pub(crate) unsafe fn each<T: Copy, C: Copy + From<T>>(
    poses: *const ImfPose,
    count: usize,
    answers: *mut C,
    what: &str,
    blank: T,
    ask: impl Fn(&[Pose], &mut [T]) -> Result<(), FieldError>,
) -> Result<(), Refusal> {
    // SAFETY: guaranteed by the caller.
    let (poses, answers) = unsafe { (read(poses, count, "poses")?, output(answers, count, what)?) };
    let mut turned = [Pose::new(DVec3::ZERO, DQuat::IDENTITY); BLOCK];
    let mut found = [blank; BLOCK];
    for (poses, answers) in poses.chunks(BLOCK).zip(answers.chunks_mut(BLOCK)) {
        for (turned, pose) in turned.iter_mut().zip(poses) {
            *turned = pose.to_pose();
        }
        let found = &mut found[..poses.len()];
        ask(&turned[..poses.len()], found).map_err(|error| of_field(&error))?;
        answers.iter_mut().zip(found).for_each(|(place, answer)| _ = place.write((*answer).into()));
    }
    Ok(())
}

/// The overlap, 0 to 1, of every pose: the fraction of the tool's volume that lies in the obstacle; of a field of depth the depth
/// (ImfInfo.quantity). NaN for invalid poses.
///
/// # Safety
/// field was opened and not closed; there are count poses, and room for as many values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_values(
    field: *const ImfField,
    poses: *const ImfPose,
    count: usize,
    values: *mut f32,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let field = unsafe { read_one(field, "field") }?;
        // SAFETY: guaranteed by the caller.
        unsafe { each(poses, count, values, "values", 0.0_f32, |p, v| field.poses.values(p, v)) }
    })
}

/// The values of imf_values, but not clipped, with their derivatives. Those of an exact field, whose values are steps,
/// are differences over a voxel's width.
///
/// # Safety
/// field was opened and not closed; there are count poses, and room for as many gradients.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_gradients(
    field: *const ImfField,
    poses: *const ImfPose,
    count: usize,
    gradients: *mut ImfGradient,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let field = unsafe { read_one(field, "field") }?;
        let ask = |p: &[Pose], g: &mut [Gradient]| field.poses.gradients(p, g);
        // SAFETY: guaranteed by the caller.
        unsafe { each(poses, count, gradients, "gradients", Gradient::NAN, ask) }
    })
}

/// Whether the tool collides at every pose. Exact and verified fields decide every pose; a model returns undecided
/// where its calibration leaves it open, and everywhere outside its box.
///
/// # Safety
/// field was opened and not closed; there are count poses, and room for as many decisions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_classify(
    field: *const ImfField,
    poses: *const ImfPose,
    count: usize,
    decisions: *mut ImfDecision,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let field = unsafe { read_one(field, "field") }?;
        let ask = |p: &[Pose], d: &mut [Decision]| field.poses.classify(p, d);
        // SAFETY: guaranteed by the caller.
        unsafe { each(poses, count, decisions, "decisions", Decision::Undecided, ask) }
    })
}

/// The inaccessibility measure with the best orientation of every point: points are x, y, z, three numbers each; rotations are
/// quaternions x, y, z, w, four numbers each, at least one. Takes memory for a copy of both for the time of the call.
///
/// # Safety
/// field was opened and not closed; there are 3 * point_count numbers of points, 4 * rotation_count of rotations, and
/// room for point_count results.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_best(
    field: *const ImfField,
    points: *const f64,
    point_count: usize,
    rotations: *const f64,
    rotation_count: usize,
    best: *mut ImfBest,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let field = unsafe { read_one(field, "field") }?;
        // SAFETY: guaranteed by the caller; a count that overflows is absurd and refused as such.
        let (points, rotations, places) = unsafe {
            (
                read(points, point_count.saturating_mul(3), "points")?,
                read(rotations, rotation_count.saturating_mul(4), "rotations")?,
                output(best, point_count, "best")?,
            )
        };
        let points: Vec<DVec3> = points.as_chunks().0.iter().copied().map(DVec3::from_array).collect();
        let rotations: Vec<DQuat> = rotations.as_chunks().0.iter().copied().map(DQuat::from_array).collect();
        let mut found = vec![Best::NONE; points.len()];
        field.poses.best(&points, &rotations, &mut found).map_err(|error| of_field(&error))?;
        places.iter_mut().zip(found).for_each(|(place, best)| _ = place.write(best.into()));
        Ok(())
    })
}

/// Whether the tool may move from a to b: the tip along the straight line, the axis along the great circle, both evenly.
/// Exact and verified fields support it.
///
/// # Safety
/// field was opened and not closed; a and b are poses; motion has room for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_check_motion(
    field: *const ImfField,
    a: *const ImfPose,
    b: *const ImfPose,
    motion: *mut ImfMotion,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let field = unsafe { read_one(field, "field") }?;
        let message = "motions are proven by exact and verified fields: open the file by imf_open_exact or \
                       imf_open_verified";
        let unsupported = || Refusal::new(ImfStatus::Unsupported, message);
        let checker = field.checker.as_ref().ok_or_else(unsupported)?;
        // SAFETY: guaranteed by the caller.
        unsafe { check_motion(checker, a, b, &MotionOptions::default(), motion) }
    })
}

/// Checks a motion and writes what is found.
///
/// # Safety
/// a and b are poses; motion has room for one.
pub(crate) unsafe fn check_motion(
    checker: &Checker,
    a: *const ImfPose,
    b: *const ImfPose,
    options: &MotionOptions,
    motion: *mut ImfMotion,
) -> Result<(), Refusal> {
    // SAFETY: guaranteed by the caller.
    let (a, b, place) = unsafe { (read_one(a, "a")?, read_one(b, "b")?, output(motion, 1, "motion")?) };
    let found =
        checker.check_motion(&a.to_pose(), &b.to_pose(), options).map_err(|error| of_query(&error))?;
    place[0].write(found.into());
    Ok(())
}

pub(crate) fn of_query(error: &QueryError) -> Refusal {
    let status = match error {
        QueryError::Resolution { .. } => ImfStatus::Argument,
        QueryError::Mesh | QueryError::Outline => ImfStatus::Unsupported,
        _ => ImfStatus::NoAnswer,
    };
    Refusal::new(status, error.to_string())
}
