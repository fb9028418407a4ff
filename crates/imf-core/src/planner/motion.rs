//! Straight motions with a turning tool: proven free by conservative advancement.
//!
//! On the way from one pose to another the tip moves along a line and the axis along a great circle, both evenly. No point
//! of the tool moves farther in a time dt than dt times the tip's way plus the turn's angle times the tool's reach. So where a
//! clearance c is proven at one time, the motion is free as long as no point has moved by c, before and after. A clearance
//! comes from the obstacle's distance transform; where that proves none, from tools grown by fixed lengths, which collide or
//! not exactly. What is left are stretches where the tool passes closer than the least of these lengths and is not
//! seen to collide: they are unknown. So is a motion to where single precision tells no voxel from the next one, but for its
//! ends: it would take as many steps as there are numbers.
//!
//! Poses are rounded to single precision when they are asked, so that a colliding pose that is returned collides itself.
//! Proofs leave room for that rounding.

use std::sync::OnceLock;

use super::Pose;
use super::exact::clearance;
use super::guard::Guard;
use crate::scene::Scene;
use crate::tool::{Clearance, ClearanceError, ToolShape};
use crate::toolpath::{Location, Motion};

/// What is known of a motion; times run from 0 at its beginning to 1 at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Passage {
    /// No pose of it collides.
    Free,
    /// A pose of it collides.
    Blocked {
        /// Before this time no pose collides.
        free_until: f64,
        /// Time of the first pose that was found to collide: where `free_until` is not close to it, what lies between
        /// could not be decided.
        at: f64,
        /// That pose.
        pose: Pose,
    },
    /// No pose was seen to collide, and this stretch, the first such one, could not be decided: the tool passes by very
    /// closely.
    Unknown {
        /// Before this time no pose collides.
        from: f64,
        /// End of the stretch.
        to: f64,
    },
}

/// Why a motion has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MotionError {
    /// An end is no pose.
    #[error("an end of the motion is no pose: a number is not finite, or the rotation has no length")]
    NoPose,
    /// Which way the tool turns is not said.
    #[error(
        "the tool's axes at the ends are opposite: give a pose between, so that it is clear which way the tool turns"
    )]
    Opposite,
    /// Nothing is proven for mesh tools.
    #[error("motions are proven for tools of revolution: describe the tool by cutter, shank and holder")]
    Mesh,
    /// The scene's tool cannot be grown.
    #[error("the tool cannot be grown by a small clearance")]
    Growth,
}

/// Lengths by which the tool is grown, in pitches, largest first.
const GROWTHS: [f64; 3] = [0.5, 0.125, 1.0 / 32.0];
/// Taken off every proven clearance, in pitches: more than the slack of the tool's predicate.
const MARGIN: f64 = 2e-4;
/// Directions in single precision are off by less.
const ANGLE: f64 = 5e-7;
/// Halvings between a pose that does not collide and one that does.
const HALVINGS: usize = 12;

/// The grown tools, made at the first motion.
#[derive(Default)]
pub struct Growths {
    guards: OnceLock<Option<[Guard; GROWTHS.len()]>>,
}

impl Growths {
    fn get(&self, scene: &Scene, clearance: &Clearance) -> Option<&[Guard; GROWTHS.len()]> {
        let pitch = scene.record.grid.pitch;
        let guard = |growth: f64| -> Result<Guard, ClearanceError> {
            let more = growth * pitch;
            let Clearance { holder, shank, cutter } = *clearance;
            Guard::new(
                scene,
                &Clearance { holder: holder + more, shank: shank + more, cutter: cutter + more },
            )
        };
        let made = self.guards.get_or_init(|| {
            let [a, b, c] = GROWTHS.map(guard);
            Some([a.ok()?, b.ok()?, c.ok()?])
        });
        made.as_ref()
    }
}

/// The way between two poses.
fn way(a: &Pose, b: &Pose) -> Result<Motion, MotionError> {
    let end = |pose: &Pose| {
        let axis = pose.direction().ok_or(MotionError::NoPose)?;
        Ok(Location { line: 0, position: pose.tip(), axis })
    };
    Motion::new(end(a)?, end(b)?).map_err(|_| MotionError::Opposite)
}

/// The pose at a time, rounded.
fn pose_at(way: &Motion, time: f64) -> Pose {
    let (position, axis) = way.at(time);
    Pose::along(position.as_vec3(), axis.as_vec3())
}

/// What is known of the motion from `a` to `b` of the guarded tool.
pub fn free_along(
    scene: &Scene,
    guard: &Guard,
    growths: &Growths,
    kept: &Clearance,
    a: &Pose,
    b: &Pose,
) -> Result<Passage, MotionError> {
    if matches!(scene.record.bare_tool().shape, ToolShape::Mesh(_)) {
        return Err(MotionError::Mesh);
    }
    let way = way(a, b)?;
    let grown = growths.get(scene, kept).ok_or(MotionError::Growth)?;
    let pitch = scene.record.grid.pitch;
    let reach = guard.reach();
    // Farthest that any point of the tool moves in a unit of time.
    let speed = way.sweep(reach);
    // Single precision: of positions as large as the ends', of directions at the tool's far end.
    let largest = a.tip().abs().max(b.tip().abs()).max_element();
    let rounding = 2.0 * f64::from(f32::EPSILON) * largest;
    if rounding >= GROWTHS[0] * pitch {
        return Ok(too_far(guard, a, b));
    }
    let margin = MARGIN * pitch + rounding + ANGLE * reach;
    let proven = |pose: &Pose| -> f64 {
        let coarse = guard.bodies.iter().map(|body| clearance(body, pose)).fold(f64::INFINITY, f64::min);
        let fine = || {
            let free = grown.iter().position(|guard| !guard.touches(pose));
            free.map_or(0.0, |index| GROWTHS[index] * pitch)
        };
        let found = if coarse > GROWTHS[0] * pitch { coarse } else { coarse.max(fine()) };
        found - margin
    };
    let step = 0.25 * GROWTHS[GROWTHS.len() - 1] * pitch;
    // All times before it are free, but for what `unknown` says.
    let mut free_until = 0.0_f64;
    let mut unknown: Option<(f64, f64)> = None;
    let (mut time, mut before) = (0.0_f64, 0.0_f64);
    loop {
        let pose = pose_at(&way, time);
        if guard.touches(&pose) {
            let (at, pose) = first(&way, guard, before, time, pose);
            let free_until = unknown.map_or(free_until, |(from, _)| from).min(at);
            return Ok(Passage::Blocked { free_until, at, pose });
        }
        let room = proven(&pose);
        let next = if room > 0.0 {
            let reached = room / speed;
            // What the proof at this time reaches back to.
            if time - reached > free_until {
                unknown = unknown.or(Some((free_until, time - reached)));
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
        // At the end itself a pose is asked as well; a time never stands still.
        time = next.max(time.next_up()).min(1.0);
    }
    if free_until < 1.0 {
        unknown = unknown.or(Some((free_until, 1.0)));
    }
    Ok(unknown.map_or(Passage::Free, |(from, to)| Passage::Unknown { from, to }))
}

/// What is known of a motion that leads so far away, millions of voxels, that single precision tells no voxel there: its ends.
fn too_far(guard: &Guard, a: &Pose, b: &Pose) -> Passage {
    match [(0.0, a), (1.0, b)].into_iter().find(|(_, pose)| guard.touches(pose)) {
        Some((at, pose)) => Passage::Blocked { free_until: 0.0, at, pose: *pose },
        None => Passage::Unknown { from: 0.0, to: 1.0 },
    }
}

/// The earliest colliding pose that halving finds between a time without and one with a collision.
fn first(way: &Motion, guard: &Guard, mut low: f64, high: f64, pose: Pose) -> (f64, Pose) {
    let mut found = (high, pose);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + found.0);
        let pose = pose_at(way, middle);
        if guard.touches(&pose) {
            found = (middle, pose);
        } else {
            low = middle;
        }
    }
    found
}
