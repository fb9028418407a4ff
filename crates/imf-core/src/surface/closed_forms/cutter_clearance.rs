//! Room that the cutter keeps from fixtures.

use super::*;
use crate::tool::Clearance;

#[test]
fn a_cutter_keeps_its_clearance_from_a_clamp_beside_the_part() {
    for pitch in [1.0, 0.5] {
        let mesh = Mesh::cuboid(DVec3::ZERO, DVec3::new(30.0, 30.0, 10.0));
        let clamp = Mesh::cuboid(DVec3::new(30.0, -5.0, 0.0), DVec3::new(40.0, 35.0, 25.0));
        let shift = DVec3::new(0.37, 0.21, 0.13) * pitch;
        let upper = DVec3::new(40.0, 35.0, 25.0);
        let grid = Grid::with_pitch(DVec3::new(0.0, -5.0, 0.0) - shift, upper + shift, pitch, 1).unwrap();
        let voxels = |mesh: &Mesh| Arc::new(voxelize(mesh, &grid, false));
        let environment = CollisionEnvironment::new(&voxels(&mesh).into(), &[voxels(&clamp).into()]);
        let samples = SurfaceSamples::new(&mesh, &voxels(&mesh), SAMPLES).samples;
        let tolerance = default_tolerance(pitch, LengthUnit::Mm);
        let above = OrientationSet::parse("0,0").unwrap().orientations;
        for cutter in [0.0, 3.0] {
            let room = Clearance { holder: 0.0, shank: 0.0, cutter };
            let tool = SurfaceTool::new(&environment, &flat(3.0).offset(&room).unwrap(), tolerance).unwrap();
            let reach = surface_access(&tool, &samples, &above, Control::quiet()).unwrap().reach;
            let top = Found { samples: &samples, tool, reach }.reached(|sample| sample.normal.z > 0.9);
            // The cutter's edge stays 3 before the clamp; centres lie up to half a pitch behind its face.
            assert!(
                (top - (30.0 - cutter) / 30.0).abs() < (0.5 * pitch + 0.8) / 30.0,
                "{pitch} {cutter}: {top}"
            );
        }
    }
}
