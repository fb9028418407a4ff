//! Poses and results as C holds them.

use std::ffi::c_char;

use imf_core::field::{Best, Decision, Gradient};
use imf_core::glam::{DQuat, DVec3};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::tool::ElementKind;
use imf_core::world::{Distance, MotionResult};

/// Where the tool is.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfPose {
    /// Position of the tool's tip in the world.
    pub position: [f64; 3],
    /// Rotation from the tool's frame (tip at the origin, axis +z from tip to holder) to the world: a quaternion x, y, z, w of
    /// any length from 1e-150 to 1e150. The roll about the tool's axis is idle for tools of revolution.
    pub rotation: [f64; 4],
}

/// Whether the tool collides.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImfDecision {
    /// It does not.
    Free = 0,
    /// It does; or the pose is invalid.
    Colliding = 1,
    /// Too close to tell: an exact or verified field must decide.
    Undecided = 2,
}

/// What a field's values are. Either falls towards freedom.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImfQuantity {
    /// The fraction of the tool's volume that lies in the obstacle, 0 to 1.
    Overlap = 0,
    /// How far the tool must be moved to be free, in the scene's unit; below 0 how far it may be moved. Clamped within 7.5
    /// pitches.
    Depth = 1,
}

/// A value and how it changes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfGradient {
    /// The value, not clipped: a model's overlap may lie a little outside 0 to 1, its depth beyond 7.5 pitches (ImfInfo.quantity).
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: [f32; 3],
    /// Change for a turn of the tool's axis by a radian: tangent to the sphere at the axis.
    pub direction: [f32; 3],
    /// Change for a turn of the whole tool by a radian, as a vector w in the world's frame (R becomes exp(w) R).
    pub rotation: [f32; 3],
}

/// The best way to reach a point.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfBest {
    /// The minimum collision measure, in 0 to 1, or the minimum depth (ImfInfo.quantity); NaN for a point that is not
    /// finite.
    pub value: f32,
    /// Its orientation, by its place in the list: of the least value before it is clipped the first of equals, one that is decided free
    /// before all others.
    pub orientation: u32,
    /// What is decided there.
    pub decision: ImfDecision,
}

/// What is known of a motion.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImfMotionKind {
    /// No pose of it was found to collide; where proven_until is 1 none does.
    Free = 0,
    /// A pose of it collides.
    Colliding = 1,
}

/// The result for a motion; times run from 0 at its beginning to 1 at its end.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfMotion {
    /// Which of the two.
    pub kind: ImfMotionKind,
    /// Before this time every pose is proven free. From then on, where the tool passes too closely for a proof, poses
    /// were sampled between which no point of the tool moves farther than a hundredth of a pitch, or than the given
    /// resolution.
    pub proven_until: f64,
    /// Up to this time the motion is free; 1 where all of it is, 0 where it begins with a collision.
    pub free_until: f64,
    /// The pose at that time; an invalid one (NaN) where the motion begins with a collision.
    pub last_valid: ImfPose,
    /// Colliding: time of the first pose that was found to collide. Free: 1.
    pub until: f64,
    /// Colliding: the pose that collides. Else an invalid pose (NaN).
    pub pose: ImfPose,
    /// Colliding: the element that collides: 0 the cutter, 1 the shank, 2 and more the holder's segments from the tip upwards. Else, and of a
    /// mesh, -1.
    pub element: i32,
    /// Colliding: the number of the obstacle. Else 0.
    pub obstacle: u64,
}

/// A unit of length.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImfUnit {
    /// Millimetre.
    Mm = 0,
    /// Centimetre.
    Cm = 1,
    /// Metre.
    M = 2,
    /// Inch.
    Inch = 3,
}

/// A mesh that becomes an obstacle, and how.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ImfMesh {
    /// Its name, which ends with 0, in UTF-8.
    pub name: *const c_char,
    /// x, y and z of every vertex, in the mesh's own frame.
    pub vertices: *const f64,
    /// How many vertices.
    pub vertex_count: usize,
    /// Three vertices of every triangle, counter-clockwise seen from outside.
    pub triangles: *const u32,
    /// How many triangles.
    pub triangle_count: usize,
    /// From the mesh's lengths to the world's; 0 for 1.
    pub scale: f64,
    /// Edge of a voxel, in the world's unit; 0 for the world's own.
    pub pitch: f64,
    /// How deep below its surface the cutter may reach, in the world's unit; 0 for what is not to be cut.
    pub contact: f64,
    /// Whether every voxel that the surface touches is solid; 0 for no. The tool is then free of the mesh itself where it has a clearance
    /// of 0.8661 pitches all around as well (imf_checker_guarantee).
    pub conservative: u8,
}

/// A distance with its bounds, in the world's unit: above 0 between the tool, offset by its clearance, and the nearest solid voxel's centre, but for
/// those that the cutter may hold by ImfMesh.contact; below 0 minus the shortest translation that frees the tool from the obstacle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfDistance {
    /// The distance is at least this; infinite where there is no obstacle, and then nothing below means anything.
    pub lower: f64,
    /// It is at most this.
    pub upper: f64,
    /// A point of the tool's surface.
    pub tool_point: [f64; 3],
    /// The voxel's centre to which that point is nearest.
    pub obstacle_point: [f64; 3],
    /// The tool's element: 0 the cutter, 1 the shank, 2 and more the holder's segments from the tip upwards.
    pub element: i32,
    /// The number of the obstacle.
    pub obstacle: u64,
}

const NO_POSE: ImfPose = ImfPose { position: [f64::NAN; 3], rotation: [f64::NAN; 4] };

/// The pose of a tool whose tip is at (x, y, z) and whose axis, from tip to holder, points along (i, j, k), of any
/// length but 0; without roll. An axis without direction gives an invalid pose (NaN), for which every field returns
/// NaN and colliding.
#[unsafe(no_mangle)]
pub extern "C" fn imf_pose_along(x: f64, y: f64, z: f64, i: f64, j: f64, k: f64) -> ImfPose {
    let pose = std::panic::catch_unwind(|| Pose::along(DVec3::new(x, y, z), DVec3::new(i, j, k)).into());
    pose.unwrap_or(NO_POSE)
}

impl ImfPose {
    pub(crate) fn to_pose(self) -> Pose {
        Pose::new(DVec3::from_array(self.position), DQuat::from_array(self.rotation))
    }
}

impl From<Pose> for ImfPose {
    fn from(pose: Pose) -> Self {
        Self { position: pose.position.to_array(), rotation: pose.rotation.to_array() }
    }
}

impl From<Decision> for ImfDecision {
    fn from(decision: Decision) -> Self {
        match decision {
            Decision::Free => Self::Free,
            Decision::Colliding => Self::Colliding,
            Decision::Undecided => Self::Undecided,
        }
    }
}

impl From<Quantity> for ImfQuantity {
    fn from(quantity: Quantity) -> Self {
        match quantity {
            Quantity::Overlap => Self::Overlap,
            Quantity::Depth => Self::Depth,
        }
    }
}

impl From<Gradient> for ImfGradient {
    fn from(found: Gradient) -> Self {
        Self {
            value: found.value,
            position: found.position.to_array(),
            direction: found.direction.to_array(),
            rotation: found.rotation.to_array(),
        }
    }
}

impl From<Best> for ImfBest {
    fn from(best: Best) -> Self {
        Self { value: best.value, orientation: best.orientation, decision: best.decision.into() }
    }
}

impl From<MotionResult> for ImfMotion {
    fn from(MotionResult { last_valid, first_colliding, proven_until }: MotionResult) -> Self {
        let kind = first_colliding.map_or(ImfMotionKind::Free, |_| ImfMotionKind::Colliding);
        Self {
            kind,
            proven_until,
            free_until: last_valid.map_or(0.0, |(time, _)| time),
            last_valid: last_valid.map_or(NO_POSE, |(_, pose)| pose.into()),
            until: first_colliding.map_or(1.0, |collision| collision.time),
            pose: first_colliding.map_or(NO_POSE, |collision| collision.pose.into()),
            element: first_colliding.and_then(|collision| collision.contact.element).map_or(-1, element),
            obstacle: first_colliding.map_or(0, |collision| collision.contact.obstacle.0),
        }
    }
}

fn element(kind: ElementKind) -> i32 {
    i32::try_from(kind.order()).unwrap_or(i32::MAX)
}

impl From<Option<Distance>> for ImfDistance {
    fn from(found: Option<Distance>) -> Self {
        let Some(found) = found else {
            return Self {
                lower: f64::INFINITY,
                upper: f64::INFINITY,
                tool_point: [f64::NAN; 3],
                obstacle_point: [f64::NAN; 3],
                element: -1,
                obstacle: 0,
            };
        };
        Self {
            lower: found.lower,
            upper: found.upper,
            tool_point: found.tool_point.to_array(),
            obstacle_point: found.obstacle_point.to_array(),
            element: element(found.element),
            obstacle: found.obstacle.0,
        }
    }
}
