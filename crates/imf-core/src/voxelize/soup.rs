//! Triangles with corners of their own, against the mesh whose they are.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::tests::sphere;
use super::*;
use crate::parts::ReferencePart;

/// Every triangle on corners of its own, each moved by up to `jitter` along every axis, and a random fraction of them
/// turned.
fn soup(mesh: &Mesh, jitter: f64, turned: f64) -> Mesh {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut soup = Mesh::default();
    for triangle in 0..mesh.triangles.len() {
        let mut corners = mesh.corners(triangle);
        if random.random_bool(turned) {
            corners.swap(1, 2);
        }
        let first = soup.vertices.len() as u32;
        soup.triangles.push([first, first + 1, first + 2]);
        soup.vertices.extend(corners.map(|corner| {
            corner + DVec3::from_array([(); 3].map(|()| jitter * random.random_range(-1.0..1.0)))
        }));
    }
    soup
}

/// Mesh, size, and a grid of some forty voxels along it.
fn shapes() -> [(Mesh, f64, Grid); 2] {
    [sphere(DVec3::new(0.3, 0.2, 0.1), 20.0, 4), ReferencePart::ScrewGear.mesh()].map(|mesh| {
        let (lower, upper) = mesh.bounds().unwrap();
        let size = (upper - lower).length();
        let grid = Grid::with_pitch(lower, upper, size / 61.7, 1).unwrap();
        (mesh, size, grid)
    })
}

#[test]
fn a_soup_has_the_voxels_of_the_joined_mesh() {
    for (mesh, size, grid) in shapes() {
        let wanted = voxelize(&mesh, &grid, false);
        assert!(wanted.count() > 5_000);
        for jitter in [0.0, 2e-6] {
            for turned in [0.0, 0.1, 0.5] {
                let (repaired, repair) = soup(&mesh, jitter * size, turned).with_consistent_faces();
                let voxels = voxelize_with(&repaired, &grid, false, Control::quiet()).unwrap();
                assert!(voxels.solid == wanted, "jitter {jitter}, turned {turned}: {repair:?}");
                assert_eq!(voxels.undecided, 0.0);
                assert!(repair.joined > 0 && (repair.flipped > 0) == (turned > 0.0), "{repair:?}");
            }
        }
    }
}

/// What is too far apart to be joined is not a consistent surface, and that is reported.
#[test]
fn a_soup_that_cannot_be_joined_is_in_doubt() {
    let mesh = sphere(DVec3::new(0.3, 0.2, 0.1), 20.0, 3);
    let (lower, upper) = mesh.bounds().unwrap();
    let size = (upper - lower).length();
    let grid = Grid::with_pitch(lower, upper, size / 31.7, 1).unwrap();
    let doubt = |turned: f64| {
        let (soup, _) = soup(&mesh, 1e-4 * size, turned).with_consistent_faces();
        voxelize_with(&soup, &grid, false, Control::quiet()).unwrap().undecided
    };
    let doubts = [0.0, 0.1, 0.5].map(doubt);
    assert!(doubts[0] < 0.1 && doubts[1] > 0.3 && doubts[2] > 0.9, "{doubts:?}");
}
