//! The cutter and fixtures, into which it may not cut.

use super::*;
use crate::tool::Clearance;

#[test]
fn a_cutter_keeps_its_clearance_from_a_clamp_beside_the_part() {
    let clamp = [Mesh::cuboid(DVec3::new(30.0, -5.0, 0.0), DVec3::new(40.0, 35.0, 25.0))];
    for pitch in [1.0, 0.5] {
        let tolerance = default_tolerance(pitch, LengthUnit::Mm);
        for cutter in [0.0, 3.0] {
            let room = Clearance { holder: 0.0, shank: 0.0, cutter };
            let tool = flat(3.0).offset(&room).unwrap();
            let top = top_among(&clamp, &tool, pitch, false, tolerance);
            // The cutter's edge stays 3 before the clamp; samples are as large as this.
            assert_near(top, (30.0 - cutter) / 30.0, 0.8 / 30.0, (pitch, cutter));
        }
    }
}

/// What a tool reaches from above of the top of a slab of 30 × 30 × 10 among fixtures, which are conservative or not.
fn top_among(fixtures: &[Mesh], tool: &Assembly, pitch: f64, conservative: bool, tolerance: f64) -> f64 {
    let slab = DVec3::new(30.0, 30.0, 10.0);
    let mesh = Mesh::cuboid(DVec3::ZERO, slab);
    let shift = DVec3::new(0.37, 0.21, 0.13) * pitch;
    let (lower, upper) = (DVec3::new(-12.0, -12.0, 0.0) - shift, slab + 12.0 + shift);
    let grid = Grid::with_pitch(lower, upper, pitch, 1).unwrap();
    let voxels = |mesh: &Mesh, conservative| Arc::new(voxelize(mesh, &grid, conservative));
    let part = SolidBody { centres: voxels(&mesh, false), keep_out: voxels(&mesh, conservative) };
    let held: Vec<_> = fixtures.iter().map(|mesh| voxels(mesh, conservative)).collect();
    let meshes: Vec<&Mesh> = std::iter::once(&mesh).chain(fixtures).collect();
    let environment = CollisionEnvironment::new(&part, &held).with_surfaces(&meshes);
    let samples = SurfaceSamples::new(&mesh, environment.part(), SAMPLES).samples;
    let tool = SurfaceTool::new(&environment, tool, tolerance).unwrap();
    let reach = surface_access(&tool, &samples, &orientations(DOWN), Control::quiet()).unwrap().reach;
    SampleVerdicts { samples: &samples, tool, reach }.reached(|sample| sample.normal.z > 0.9)
}

#[test]
fn a_strap_that_holds_no_centre_keeps_a_cutter_out_where_voxels_are_conservative() {
    let strap = Mesh::cuboid(DVec3::new(-5.0, -5.0, 14.55), DVec3::new(35.0, 35.0, 14.95));
    let tolerance = default_tolerance(1.0, LengthUnit::Mm);
    assert_eq!(top_among(&[strap], &flat(3.0).into(), 1.0, true, tolerance), 0.0);
}

#[test]
fn a_cutter_does_not_pass_between_jaws_by_the_tolerance_of_the_part() {
    // 4.8 apart, for a cutter of 6, and no way around them; 6.2 apart it passes.
    for (apart, passes) in [(4.8, false), (6.2, true)] {
        let jaw =
            |from: f64, to: f64| Mesh::cuboid(DVec3::new(from, -10.0, 10.0), DVec3::new(to, 40.0, 20.0));
        let jaws = [jaw(-10.0, 15.0 - apart / 2.0), jaw(15.0 + apart / 2.0, 40.0)];
        let reached = top_among(&jaws, &flat(3.0).into(), 0.5, false, 0.6);
        assert_eq!(reached > 0.15, passes, "{apart}: {reached}");
        assert!(passes || reached == 0.0, "{apart}: {reached}");
    }
}
