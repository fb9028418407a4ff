//! A flat cutter in a hole of its own diameter: with its axis on the hole's it lies on the whole floor.

use super::*;

#[test]
fn the_floor_of_a_hole_of_the_cutters_own_diameter_is_reached() {
    let centre = DVec2::splat(8.0);
    for pitch in [1.0, 0.5, 0.25] {
        let hole = circle(centre, 5.0, 64);
        let part = Part::new(&pocketed(DVec3::new(16.0, 16.0, 20.0), &hole, 12.0), pitch);
        let floor = |s: &SurfaceSample| {
            (s.point.truncate() - centre).length() < 5.0 && s.normal.z > 0.5 && s.point.z < 19.0
        };
        let found = part.found(&flat(5.0), DOWN);
        assert!(found.reached(floor) > 0.99, "{pitch}: {}", found.reached(floor));
        // Wide enough that the cutter holds a voxel centre wherever it stands.
        let wide = 5.0 + 1.2 * pitch;
        assert_eq!(part.found(&flat(wide), DOWN).reached(floor), 0.0, "{pitch}");
    }
}
