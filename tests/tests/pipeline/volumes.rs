//! The reference parts as voxels at the paper's resolution.

use imf_core::mesh::topology::MeshReport;
use imf_core::parts::ReferencePart;

use crate::scene::scene;

/// A voxel is solid or not by its centre. Errors of the surface's voxels, some tens of thousands, cancel but for planes
/// that lie across many centres at once; a shell that leaks or a cavity that fills is off by tens of per cent.
const SHARE: f64 = 0.02;

#[test]
fn solid_voxels_fill_the_meshes_volume() {
    let mut closed = 0;
    for part in ReferencePart::ALL {
        let solid = scene(part, part.dims()).obstacle;
        let report = MeshReport::new(&part.mesh());
        if report.closed {
            let off = solid.volume() / report.signed_volume - 1.0;
            assert!(
                off.abs() < SHARE,
                "{part}: {} of {}, off by {off:.4}",
                solid.volume(),
                report.signed_volume
            );
            closed += 1;
        }
        let share = solid.count() as f64 / solid.grid.len() as f64;
        assert!((0.05..0.95).contains(&share), "{part}: {share:.3} of the grid is solid");
    }
    assert!(closed >= 3, "only {closed} parts are closed");
}

#[test]
fn the_teapots_handle_and_spout_are_solid_where_they_meet_the_body() {
    // Newell's patches run into each other: the mesh counts the shared volume twice, the voxels once.
    let part = ReferencePart::Teapot;
    let solid = scene(part, part.dims()).obstacle;
    let twice = MeshReport::new(&part.mesh()).signed_volume;
    assert!(solid.volume() < twice * (1.0 + SHARE), "{} voxels, mesh {twice}", solid.volume());
    assert!(solid.volume() > twice * 0.85, "{} voxels, mesh {twice}", solid.volume());
}
