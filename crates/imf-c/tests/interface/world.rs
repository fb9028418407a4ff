//! Worlds and checkers as C makes them, against the Rust calls.

use std::ffi::CString;
use std::ptr::{null, null_mut};

use imf_c::*;
use imf_core::glam::{DQuat, DVec3};
use imf_core::mesh::Mesh;
use imf_core::mesh::write::write_obj;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::tool::{Clearance, Tool};
use imf_core::world::{MotionOptions, ObstacleMesh, World};

use crate::calls::last_error;

const TOOL: &str = "name = \"mill\"\nunit = \"mm\"\n[cutter]\nshape = \"ball\"\ndiameter = 10\nlength = 35\n";

/// Miri, for which the bracket would be too much, sees a cube and a few poses.
fn mesh() -> Mesh {
    if cfg!(miri) { Mesh::cuboid(DVec3::ZERO, DVec3::splat(30.0)) } else { ReferencePart::Bracket.mesh() }
}

fn poses() -> Vec<Pose> {
    let (orientations, room) = if cfg!(miri) { ("random:12:3", 70.0) } else { ("random:400:3", 180.0) };
    let set = OrientationSet::parse(orientations).unwrap().orientations;
    let spread = |index: usize, prime: usize| (index * prime % 199) as f64 / 199.0;
    let at = |i: usize| DVec3::new(spread(i, 37), spread(i, 53), spread(i, 71)) * room - 20.0;
    set.iter().enumerate().map(|(index, orientation)| Pose::oriented(at(index), orientation)).collect()
}

fn of(pose: &Pose) -> ImfPose {
    ImfPose { position: pose.position.to_array(), rotation: pose.rotation.to_array() }
}

#[test]
fn a_world_of_meshes_is_answered_as_in_rust() {
    let folder = tempfile::tempdir().unwrap();
    let tool_path = folder.path().join("mill.toml");
    std::fs::write(&tool_path, TOOL).unwrap();
    let tool = Tool::read(&tool_path).unwrap();
    let (mesh, pitch) = (mesh(), 3.0);
    let at = Pose::new(DVec3::new(30.0, 10.0, 5.0), DQuat::from_rotation_z(0.7));
    let mut rust = World::builder().pitch(pitch).build().unwrap();
    let first = rust.add(ObstacleMesh::new("bracket", mesh.clone())).unwrap();
    rust.add(ObstacleMesh { at, scale: 0.5, ..ObstacleMesh::new("bracket", mesh.clone()) }).unwrap();
    let room = Clearance { holder: 2.0, shank: 1.0, cutter: 0.5 };
    let mut expected = rust.checker(&tool, &room).unwrap();

    let vertices: Vec<f64> = mesh.vertices.iter().flat_map(DVec3::to_array).collect();
    let triangles: Vec<u32> = mesh.triangles.concat();
    let name = CString::new("bracket").unwrap();
    let path = CString::new(tool_path.to_str().unwrap()).unwrap();
    let whole = ImfMesh {
        name: name.as_ptr(),
        vertices: vertices.as_ptr(),
        vertex_count: mesh.vertices.len(),
        triangles: triangles.as_ptr(),
        triangle_count: mesh.triangles.len(),
        scale: 0.0,
        pitch: 0.0,
        contact: 0.0,
        conservative: 0,
    };
    let here = of(&Pose::new(DVec3::ZERO, DQuat::IDENTITY));
    let obj = folder.path().join("bracket.obj");
    write_obj(&mesh, &obj, "").unwrap();
    let obj = CString::new(obj.to_str().unwrap()).unwrap();
    let all = poses();
    let in_c: Vec<ImfPose> = all.iter().map(of).collect();
    // SAFETY: everything lives on, and there are as many elements as is said; what is NULL is refused before it is read.
    unsafe {
        let (mut world, mut checker) = (null_mut(), null_mut());
        assert_eq!(imf_world_create(ImfUnit::Mm as u32, pitch, &mut world), ImfStatus::Ok);
        let (mut one, mut other) = (u64::MAX, u64::MAX);
        assert_eq!(imf_world_add_mesh(world, &whole, &here, &mut one), ImfStatus::Ok, "{}", last_error());
        let half = ImfMesh { scale: 0.5, vertices: null(), triangles: null(), ..whole };
        let status = imf_world_add_file(world, obj.as_ptr(), &half, &of(&at), &mut other);
        assert_eq!(status, ImfStatus::Ok, "{}", last_error());
        assert!(one == first.0 && one != other);
        let clearance = [2.0, 1.0, 0.5];
        let status = imf_checker_create(world, path.as_ptr(), clearance.as_ptr(), &mut checker);
        assert_eq!(status, ImfStatus::Ok, "{}", last_error());
        for moved in [false, true] {
            if moved {
                let away = Pose::new(DVec3::new(0.0, 0.0, 60.0), DQuat::IDENTITY);
                rust.place(first, away).unwrap();
                expected.follow(&rust).unwrap();
                assert_eq!(imf_world_place(world, one, &of(&away)), ImfStatus::Ok);
                assert_eq!(imf_checker_follow(checker, world), ImfStatus::Ok);
            }
            let mut decisions = vec![ImfDecision::Undecided; all.len()];
            let status = imf_checker_classify(checker, in_c.as_ptr(), all.len(), decisions.as_mut_ptr());
            assert_eq!(status, ImfStatus::Ok);
            let mut free = 0;
            for (pair, decision) in all.windows(2).zip(&decisions) {
                let is_free = expected.is_free(&pair[0]);
                assert_eq!(*decision == ImfDecision::Free, is_free);
                free += usize::from(is_free);
                let (mut distance, mut motion) = (ImfDistance::from(None), std::mem::zeroed::<ImfMotion>());
                let [a, b] = [of(&pair[0]), of(&pair[1])];
                assert_eq!(imf_checker_distance(checker, &a, &mut distance), ImfStatus::Ok);
                assert_eq!(distance, expected.distance(&pair[0]).unwrap().into());
                for none in [-1.0, f64::NAN, 1e-300] {
                    assert_eq!(imf_checker_motion(checker, &a, &b, none, &mut motion), ImfStatus::Argument);
                }
                let status = imf_checker_motion(checker, &a, &b, 0.1, &mut motion);
                let options = MotionOptions { resolution: Some(0.1) };
                match expected.check_motion(&pair[0], &pair[1], &options) {
                    Ok(found) => {
                        // As text, for NaN does not equal itself.
                        assert_eq!(format!("{motion:?}"), format!("{:?}", ImfMotion::from(found)));
                    }
                    Err(_) => assert_eq!(status, ImfStatus::NoAnswer),
                }
            }
            assert!(free > all.len() / 20 && free < all.len() - all.len() / 20, "{free}");
        }
        assert_eq!(imf_world_remove(world, one), ImfStatus::Ok);
        assert_eq!(imf_world_remove(world, one), ImfStatus::Argument);
        assert!(last_error().contains("no obstacle"), "{}", last_error());
        // A sheet between the centres is told, and what C has not is refused.
        let warning = |index: usize| {
            let text = imf_world_warning(world, index);
            (!text.is_null()).then(|| std::ffi::CStr::from_ptr(text).to_str().unwrap().to_owned())
        };
        let told: Vec<String> = (0..).map_while(warning).collect();
        assert_eq!(told, rust.warnings().iter().map(ToString::to_string).collect::<Vec<_>>());
        assert!(imf_world_warning(null(), 0).is_null());
        let mut plate = Mesh::cuboid(DVec3::ZERO, DVec3::splat(20.0));
        plate.append(&Mesh::cuboid(DVec3::new(30.3, 0.0, 0.0), DVec3::new(30.5, 20.0, 20.0)));
        let of_plate = ImfMesh {
            vertices: plate.vertices.as_ptr().cast(),
            vertex_count: plate.vertices.len(),
            triangles: plate.triangles.as_ptr().cast(),
            triangle_count: plate.triangles.len(),
            pitch: if cfg!(miri) { 2.0 } else { 1.0 },
            ..whole
        };
        assert_eq!(
            imf_world_add_mesh(world, &of_plate, &here, &mut other),
            ImfStatus::Ok,
            "{}",
            last_error()
        );
        let sheet = (told.len()..).map_while(warning).find(|text| text.contains("between the centres"));
        assert!(sheet.is_some(), "{:?}", (0..).map_while(warning).collect::<Vec<_>>());
        // A tool that hangs above its own tip.
        let corners = "v -5 -5 30\nv 5 -5 30\nv 0 8 30\nv 0 0 60\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
        std::fs::write(folder.path().join("head.obj"), corners).unwrap();
        std::fs::write(&tool_path, "name = \"hung\"\nunit = \"mm\"\nmesh = \"head.obj\"\n").unwrap();
        let mut hung = null_mut();
        assert_eq!(
            imf_checker_create(world, path.as_ptr(), [0.0_f64; 3].as_ptr(), &mut hung),
            ImfStatus::Ok,
            "{}",
            last_error()
        );
        let text = imf_checker_warning(hung, 0);
        assert!(!text.is_null());
        let text = std::ffi::CStr::from_ptr(text).to_str().unwrap();
        assert!(text.contains("the tip of the tool 'hung'") && text.contains("30 mm away"), "{text}");
        assert!(imf_checker_warning(hung, 1).is_null() && imf_checker_warning(null(), 0).is_null());
        let guarantee = std::ffi::CStr::from_ptr(imf_checker_guarantee(hung)).to_str().unwrap();
        assert!(guarantee.contains("exact for voxel centres"), "{guarantee}");
        assert!(imf_checker_guarantee(null()).is_null());
        imf_checker_close(hung);
        let mut nothing = null_mut();
        assert_eq!(imf_world_create(4, pitch, &mut nothing), ImfStatus::Argument);
        assert!(nothing.is_null() && last_error().contains("unit 4"), "{}", last_error());
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(imf_world_create(ImfUnit::Mm as u32, none, &mut nothing), ImfStatus::Argument);
            assert!(nothing.is_null() && last_error().contains("pitch"), "{}", last_error());
        }
        let bad = [99_u32; 3];
        let bad = ImfMesh { triangles: bad.as_ptr(), triangle_count: 1, vertex_count: 3, ..whole };
        assert_eq!(imf_world_add_mesh(world, &bad, &here, &mut one), ImfStatus::Argument);
        assert_eq!(imf_world_add_mesh(null_mut(), &whole, &here, &mut one), ImfStatus::NullPointer);
        let mut none = checker;
        assert_eq!(imf_checker_create(world, path.as_ptr(), null(), &mut none), ImfStatus::NullPointer);
        assert!(none.is_null());
        imf_checker_close(checker);
        imf_world_close(world);
        imf_world_close(null_mut());
    }
}
