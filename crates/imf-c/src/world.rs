//! Obstacles that move, and checkers of one tool among them.

use std::ffi::{CString, c_char};
use std::path::Path;

use imf_core::field::Decision;
use imf_core::glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::mesh::read::read_mesh_file;
use imf_core::pose::Pose;
use imf_core::scene::SceneWarning;
use imf_core::tool::{Clearance, Tool};
use imf_core::unit::LengthUnit;
use imf_core::world::{Checker, MotionOptions, ObstacleId, ObstacleMesh, World, WorldError};

use crate::boundary::{ImfStatus, Refusal, call, close, output, read, read_one, text, write_one};
use crate::query::{check_motion, each, of_query};
use crate::values::{ImfDecision, ImfDistance, ImfMesh, ImfMotion, ImfPose, ImfUnit};

/// Obstacles with their places.
pub struct ImfWorld {
    world: World,
    /// What is to be known of its meshes, as texts that stay where they are.
    warnings: Vec<CString>,
}

impl ImfWorld {
    fn add(&mut self, obstacle: ObstacleMesh) -> Result<u64, Refusal> {
        let id = self.world.add(obstacle).map_err(|error| of_world(&error))?;
        self.warnings.extend(texts(&self.world.warnings()[self.warnings.len()..]));
        Ok(id.0)
    }
}

/// One tool among the obstacles of a world, with a clearance.
pub struct ImfChecker {
    checker: Checker,
    /// What is to be known of its tool, as texts that stay where they are.
    warnings: Vec<CString>,
    guarantee: CString,
}

impl ImfChecker {
    fn new(checker: Checker) -> Self {
        let warnings = texts(&checker.warnings()).collect();
        let guarantee =
            checker.guarantee().map_or_else(|| "there is no obstacle".to_owned(), |known| known.to_string());
        Self { checker, warnings, guarantee: CString::new(guarantee).unwrap_or_default() }
    }
}

fn texts(warnings: &[SceneWarning]) -> impl Iterator<Item = CString> {
    warnings.iter().map(|warning| CString::new(warning.to_string()).unwrap_or_default())
}

/// The text of an index, or NULL.
fn text_at(warnings: Option<&[CString]>, index: usize) -> *const c_char {
    warnings.and_then(|warnings| warnings.get(index)).map_or(std::ptr::null(), |text| text.as_ptr())
}

fn of_world(error: &WorldError) -> Refusal {
    Refusal::new(ImfStatus::Argument, error.to_string())
}

/// Makes a world without obstacles: its unit, an ImfUnit, and the edge of a voxel of obstacles that have none of their own. On failure *world is
/// NULL.
///
/// # Safety
/// world has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_create(unit: u32, pitch: f64, world: *mut *mut ImfWorld) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let place = &mut unsafe { output(world, 1, "world") }?[0];
        place.write(std::ptr::null_mut());
        let unit = unit_of(unit).ok_or_else(|| {
            Refusal::new(
                ImfStatus::Argument,
                format!("unit {unit} is unknown: units run from 0 to 3, see ImfUnit"),
            )
        })?;
        let world = World::builder().unit(unit).pitch(pitch).build().map_err(|error| of_world(&error))?;
        place.write(Box::into_raw(Box::new(ImfWorld { world, warnings: Vec::new() })));
        Ok(())
    })
}

/// Adds an obstacle: makes voxels of a mesh, in its own frame, which stands at a place in the world. It gets a number, by which it
/// can be moved and removed.
///
/// # Safety
/// world was created and not closed, and no other thread calls with it; mesh is one, and holds as many numbers as it says; at is a pose; id
/// has room for a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_add_mesh(
    world: *mut ImfWorld,
    mesh: *const ImfMesh,
    at: *const ImfPose,
    id: *mut u64,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (world, mesh, at) =
            unsafe { (write_one(world, "world")?, read_one(mesh, "mesh")?, read_one(at, "at")?) };
        // SAFETY: guaranteed by the caller; a count that overflows is absurd and refused as such.
        let (name, vertices, triangles, place) = unsafe {
            (
                text(mesh.name, "mesh.name")?,
                read(mesh.vertices, mesh.vertex_count.saturating_mul(3), "mesh.vertices")?,
                read(mesh.triangles, mesh.triangle_count.saturating_mul(3), "mesh.triangles")?,
                output(id, 1, "id")?,
            )
        };
        let vertices: Vec<DVec3> = vertices.as_chunks().0.iter().copied().map(DVec3::from_array).collect();
        let outside = |&vertex: &u32| vertex as usize >= vertices.len();
        if triangles.iter().any(outside) || !vertices.iter().all(|vertex| vertex.is_finite()) {
            let message = "mesh: a triangle has a vertex that is not there, or a number is not finite";
            return Err(Refusal::new(ImfStatus::Argument, message));
        }
        let triangles = triangles.as_chunks().0.to_vec();
        let obstacle = mesh.obstacle(name, Mesh { vertices, triangles }, at.to_pose());
        place[0].write(world.add(obstacle)?);
        Ok(())
    })
}

/// As imf_world_add_mesh, of an OBJ, STL, PLY or 3MF file; of mesh its triangles are not read. Files that state no unit are in the world's.
///
/// # Safety
/// As imf_world_add_mesh; path is a text that ends with 0, in UTF-8.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_add_file(
    world: *mut ImfWorld,
    path_text: *const c_char,
    mesh: *const ImfMesh,
    at: *const ImfPose,
    id: *mut u64,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (world, mesh, at) =
            unsafe { (write_one(world, "world")?, read_one(mesh, "mesh")?, read_one(at, "at")?) };
        // SAFETY: guaranteed by the caller.
        let (name, path, place) =
            unsafe { (text(mesh.name, "mesh.name")?, text(path_text, "path")?, output(id, 1, "id")?) };
        let file = read_mesh_file(path).map_err(|error| Refusal::new(ImfStatus::File, error.to_string()))?;
        let obstacle = mesh.obstacle(name, file.in_unit(world.world.unit()), at.to_pose());
        place[0].write(world.add(obstacle)?);
        Ok(())
    })
}

/// Warnings about the meshes that were added, a text for each index from 0; NULL beyond the last, and for a world
/// that is NULL. They report walls that lie between the voxels' centres, through which a tool would pass undetected,
/// and meshes that are not closed. A text stays until the world is closed.
///
/// # Safety
/// world was created and not closed, and no other thread changes it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_warning(world: *const ImfWorld, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    let world = unsafe { read_one(world, "world") };
    text_at(world.ok().map(|world| &*world.warnings), index)
}

/// Moves an obstacle: at is from its own frame into the world. Checkers see it once they follow.
///
/// # Safety
/// world was created and not closed, and no other thread calls with it; at is a pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_place(world: *mut ImfWorld, id: u64, at: *const ImfPose) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (world, at) = unsafe { (write_one(world, "world")?, read_one(at, "at")?) };
        world.world.place(ObstacleId(id), at.to_pose()).map_err(|error| of_world(&error))
    })
}

/// Removes an obstacle. Checkers see it once they follow.
///
/// # Safety
/// world was created and not closed, and no other thread calls with it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_remove(world: *mut ImfWorld, id: u64) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let world = unsafe { write_one(world, "world") }?;
        world.world.remove(ObstacleId(id)).map_err(|error| of_world(&error))
    })
}

/// Closes a world; NULL is ignored. Checkers of it stay.
///
/// # Safety
/// world is NULL, or was created, not closed yet, and no thread calls with it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_world_close(world: *mut ImfWorld) {
    // SAFETY: guaranteed by the caller.
    unsafe { close(world) }
}

/// Makes a checker of a tool in a world: the tool by its file (imf's own TOML, or a library's file of one tool), offset by the clearance of
/// holder, shank and cutter, in the world's unit. On failure *checker is NULL.
///
/// # Safety
/// world was created and not closed; tool_path is a text that ends with 0, in UTF-8; there are three clearances; checker has room for a
/// pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_create(
    world: *const ImfWorld,
    tool_path: *const c_char,
    clearance: *const f64,
    checker: *mut *mut ImfChecker,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let place = &mut unsafe { output(checker, 1, "checker") }?[0];
        place.write(std::ptr::null_mut());
        // SAFETY: guaranteed by the caller.
        let (world, path, clearance) = unsafe {
            (read_one(world, "world")?, text(tool_path, "path")?, read(clearance, 3, "clearance")?)
        };
        let tool = Tool::read(Path::new(path));
        let tool = tool.map_err(|error| Refusal::new(ImfStatus::File, error.to_string()))?;
        let clearance = Clearance { holder: clearance[0], shank: clearance[1], cutter: clearance[2] };
        let made = world.world.checker(&tool, &clearance).map_err(|error| of_world(&error))?;
        place.write(Box::into_raw(Box::new(ImfChecker::new(made))));
        Ok(())
    })
}

/// Updates the places of the world's obstacles, including added and removed ones. What was computed for those that
/// remain is reused. On failure the checker stays as it was. Texts of its warnings and its guarantee go.
///
/// # Safety
/// checker was created and not closed, and no other thread calls with it; world was created and not closed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_follow(checker: *mut ImfChecker, world: *const ImfWorld) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (checker, world) = unsafe { (write_one(checker, "checker")?, read_one(world, "world")?) };
        checker.checker.follow(&world.world).map_err(|error| of_world(&error))?;
        *checker = ImfChecker::new(checker.checker.clone());
        Ok(())
    })
}

/// Warnings about the checker's tool among its obstacles, a text for each index from 0; NULL beyond the last, and for
/// a checker that is NULL. They report a tool whose tip is not at the origin, as one in another frame or unit, and a
/// tip so slender that it passes between voxels' centres for a while. A text stays until the checker follows or is
/// closed.
///
/// # Safety
/// checker was created and not closed, and no other thread changes it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_warning(checker: *const ImfChecker, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    let checker = unsafe { read_one(checker, "checker") };
    text_at(checker.ok().map(|checker| &*checker.warnings), index)
}

/// What "free" guarantees for the meshes of the obstacles, as a text; NULL for a checker that is NULL. It stays until the checker follows
/// or is closed.
///
/// # Safety
/// checker was created and not closed, and no other thread changes it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_guarantee(checker: *const ImfChecker) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    let checker = unsafe { read_one(checker, "checker") };
    checker.map_or(std::ptr::null(), |checker| checker.guarantee.as_ptr())
}

/// Whether the tool collides at every pose: free or colliding, exactly for voxel centres.
///
/// # Safety
/// checker was created and not closed; there are count poses, and room for as many decisions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_classify(
    checker: *const ImfChecker,
    poses: *const ImfPose,
    count: usize,
    decisions: *mut ImfDecision,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let checker = &unsafe { read_one(checker, "checker") }?.checker;
        let ask = |p: &[Pose], d: &mut [Decision]| checker.classify(p, d);
        // SAFETY: guaranteed by the caller.
        unsafe { each(poses, count, decisions, "decisions", Decision::Undecided, ask) }
    })
}

/// How far the tool is from the nearest obstacle, or how deep it is in one.
///
/// # Safety
/// checker was created and not closed; pose is one; distance has room for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_distance(
    checker: *const ImfChecker,
    pose: *const ImfPose,
    distance: *mut ImfDistance,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (checker, pose, place) = unsafe {
            (read_one(checker, "checker")?, read_one(pose, "pose")?, output(distance, 1, "distance")?)
        };
        place[0].write(checker.checker.distance(&pose.to_pose()).map_err(|error| of_query(&error))?.into());
        Ok(())
    })
}

/// Whether the tool may move from a to b: the tip along the straight line, the axis along the great circle, both evenly. Where it passes too
/// closely for a proof, poses are tried between which no point of the tool moves farther than resolution; 0 for a hundredth of the finest
/// pitch.
///
/// # Safety
/// checker was created and not closed; a and b are poses; motion has room for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_motion(
    checker: *const ImfChecker,
    a: *const ImfPose,
    b: *const ImfPose,
    resolution: f64,
    motion: *mut ImfMotion,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let checker = &unsafe { read_one(checker, "checker") }?.checker;
        let options = MotionOptions { resolution: (resolution != 0.0).then_some(resolution) };
        // SAFETY: guaranteed by the caller.
        unsafe { check_motion(checker, a, b, &options, motion) }
    })
}

/// Closes a checker; NULL is ignored.
///
/// # Safety
/// checker is NULL, or was created, not closed yet, and no thread calls with it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_checker_close(checker: *mut ImfChecker) {
    // SAFETY: guaranteed by the caller.
    unsafe { close(checker) }
}

impl ImfMesh {
    fn obstacle(&self, name: &str, mesh: Mesh, at: Pose) -> ObstacleMesh {
        ObstacleMesh {
            scale: if self.scale == 0.0 { 1.0 } else { self.scale },
            at,
            pitch: (self.pitch != 0.0).then_some(self.pitch),
            conservative: Some(self.conservative != 0),
            contact: self.contact,
            ..ObstacleMesh::new(name, mesh)
        }
    }
}

/// The unit of an [`ImfUnit`]'s number, which C may get wrong.
fn unit_of(number: u32) -> Option<LengthUnit> {
    let all = [
        (ImfUnit::Mm, LengthUnit::Mm),
        (ImfUnit::Cm, LengthUnit::Cm),
        (ImfUnit::M, LengthUnit::M),
        (ImfUnit::Inch, LengthUnit::Inch),
    ];
    all.into_iter().find(|(unit, _)| *unit as u32 == number).map(|(_, unit)| unit)
}
