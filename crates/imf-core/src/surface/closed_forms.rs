//! Parts where geometry determines what a tool reaches, at pitches that halve: every result stays within a bound of
//! the closed form, and the bound falls with the pitch.

mod bodies;
mod cutter_clearance;
mod deep_holes;
mod drills;
mod necks;
mod points;
pub(super) mod solids;
mod tapers;

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::*;
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::orientation::Orientation;
use crate::parts::shell::{circle, pocketed, rounded_rectangle};
use crate::section::test_shapes::{arc, line, orientations};
use crate::tool::{SharpPoints, Tool};
use crate::voxelize::voxelize;
use solids::{ball, cylinder, dimpled, extruded, flat, of_mesh, slotted, tool};

const PITCHES: [f64; 4] = [2.0, 1.0, 0.5, 0.25];
/// Minimum number of samples of a part: some 0.8 to 1.5 mm apart.
const SAMPLES: usize = 1500;

/// A part at a pitch, for several tools.
pub(super) struct Part {
    pub(super) samples: Vec<SurfaceSample>,
    pub(super) environment: CollisionEnvironment,
    pub(super) pitch: f64,
}

impl Part {
    fn new(mesh: &Mesh, pitch: f64) -> Self {
        Self::sampled(mesh, pitch, if pitch < 0.5 { SAMPLES / 2 } else { SAMPLES })
    }

    pub(super) fn sampled(mesh: &Mesh, pitch: f64, samples: usize) -> Self {
        let (lower, upper) = mesh.bounds().unwrap();
        // Off the part's own planes, as a user's part lies.
        let shift = DVec3::new(0.37, 0.21, 0.13) * pitch;
        Self::on(&Grid::with_pitch(lower - shift, upper + shift, pitch, 1).unwrap(), mesh, samples)
    }

    pub(super) fn on(grid: &Grid, mesh: &Mesh, samples: usize) -> Self {
        let solid = Arc::new(voxelize(mesh, grid, false));
        let samples = SurfaceSamples::new(mesh, &solid, samples).samples;
        let environment = CollisionEnvironment::new(&solid.into(), &[]).with_surfaces(&[mesh]);
        Self { samples, environment, pitch: grid.pitch }
    }

    pub(super) fn tolerance(&self) -> f64 {
        default_tolerance(self.pitch, LengthUnit::Mm)
    }

    pub(super) fn surface_tool(&self, tool: &Tool) -> SurfaceTool {
        SurfaceTool::new(&self.environment, &tool.into(), self.tolerance()).unwrap()
    }

    pub(super) fn access(&self, tool: &SurfaceTool, directions: &[Orientation]) -> SurfaceAccess {
        surface_access(tool, &self.samples, directions, Control::quiet()).unwrap()
    }

    fn found(&self, tool: &Tool, directions: &str) -> SampleVerdicts<'_> {
        let tool = self.surface_tool(tool);
        let reach = self.access(&tool, &orientations(directions)).reach;
        SampleVerdicts { samples: &self.samples, tool, reach }
    }
}

/// A part's samples, with what becomes of each.
struct SampleVerdicts<'a> {
    samples: &'a [SurfaceSample],
    tool: SurfaceTool,
    reach: Vec<SampleReach>,
}

impl SampleVerdicts<'_> {
    /// Fraction of the area of chosen samples for which a verdict holds.
    fn share(&self, of: impl Fn(&SurfaceSample) -> bool, is: impl Fn(&SampleReach) -> bool) -> f64 {
        let (mut whole, mut part) = (0.0, 0.0);
        for (sample, reach) in self.samples.iter().zip(&self.reach).filter(|(sample, _)| of(sample)) {
            whole += sample.area;
            part += if is(reach) { sample.area } else { 0.0 };
        }
        assert!(whole > 0.0, "no sample is chosen");
        part / whole
    }

    fn reached(&self, of: impl Fn(&SurfaceSample) -> bool) -> f64 {
        self.share(of, |reach| matches!(reach, SampleReach::Reached { .. }))
    }
}

#[track_caller]
fn assert_near(found: f64, expected: f64, bound: f64, what: impl std::fmt::Debug) {
    assert!((found - expected).abs() < bound, "{what:?}: {found} for {expected}");
}

/// Straight down, and the six axes with 60 more.
const DOWN: &str = "0,0";
const AXES: &str = "0,0;0,180;0,90;90,90;180,90;270,90";

fn is_wall(sample: &SurfaceSample) -> bool {
    sample.normal.z.abs() < 0.5
}

#[test]
fn a_block_is_reached_all_around() {
    let mesh = extruded(&[[0.0, 0.0], [12.0, 0.0], [12.0, 16.0], [0.0, 16.0]], 16.0);
    for pitch in PITCHES {
        let part = Part::new(&mesh, pitch);
        for tool in [flat(5.0), ball(3.0)] {
            assert_eq!(part.found(&tool, AXES).reached(|_| true), 1.0, "{pitch}");
        }
        // No direction is a face's normal: the rim touches.
        assert_eq!(part.found(&flat(5.0), "fibonacci:30").reached(|_| true), 1.0, "{pitch}");
    }
}

#[test]
fn holes_below_at_and_above_the_cutters_diameter() {
    let centre = DVec2::splat(8.0);
    let inside =
        |s: &SurfaceSample| (s.point.truncate() - centre).length() < 4.3 && (0.1..19.9).contains(&s.point.z);
    let wall = |s: &SurfaceSample| inside(s) && is_wall(s);
    for (pitch, depth) in PITCHES.into_iter().flat_map(|pitch| [(pitch, 12.0), (pitch, 20.0)]) {
        // Holes of facets, blind and through: a cutter of the hole's diameter gives way to the facets.
        let part = |radius, facets| {
            let hole = circle(centre, radius, facets);
            Part::new(&pocketed(DVec3::new(16.0, 16.0, 20.0), &hole, depth), pitch)
        };
        let parts = [part(4.0, 24), part(3.0, 64)];
        for (part, radius, cutter_radius, cutter) in [
            (&parts[0], 4.0, 3.0, flat(3.0)),
            (&parts[0], 4.0, 4.0, flat(4.0)),
            (&parts[1], 3.0, 3.0, flat(3.0)),
            (&parts[0], 4.0, 3.0, ball(3.0)),
            (&parts[0], 4.0, 4.0, ball(4.0)),
        ] {
            let found = part.found(&cutter, AXES);
            // A ball touches a wall at its equator, a radius above its tip.
            let is_ball = cutter == ball(cutter_radius);
            let left = if is_ball && depth < 20.0 { cutter_radius } else { 0.0 };
            let expected = 1.0 - left / depth;
            // Samples stand some 1 mm apart.
            let bound = 0.02 + if is_ball { (1.0 + pitch) / depth } else { 0.02 * pitch };
            assert_near(found.reached(wall), expected, bound, (pitch, depth, radius, cutter_radius));
            // A flat end reaches the whole floor, a ball that is as wide as the hole its middle alone.
            if depth < 20.0 && !is_ball && radius > cutter_radius {
                let floor = |s: &SurfaceSample| inside(s) && s.normal.z > 0.5;
                assert!(found.reached(floor) >= 0.995, "{pitch} {radius}: {}", found.reached(floor));
            }
        }
        let found = parts[0].found(&flat(5.0), AXES);
        let fits = found.reached(inside);
        // The cutter dips into the mouth as far as no solid centre lies below it.
        assert!(fits < 0.1 * pitch || pitch > 1.0, "{pitch}: {fits}");
        let gouged =
            found.share(|s| inside(s) && (s.normal.z > 0.5 || is_wall(s)), |r| *r == SampleReach::Gouged);
        assert!(gouged > 0.99 - 0.1 * pitch || pitch > 1.0, "{pitch}: {gouged}");
    }
}

#[test]
fn the_floor_of_a_hole_of_the_cutters_own_diameter_is_reached() {
    let centre = DVec2::splat(8.0);
    for pitch in [1.0, 0.5, 0.25] {
        let hole = circle(centre, 5.0, 64);
        let part = Part::new(&pocketed(DVec3::new(16.0, 16.0, 20.0), &hole, 12.0), pitch);
        let floor = |s: &SurfaceSample| {
            (s.point.truncate() - centre).length() < 5.0 && s.normal.z > 0.5 && s.point.z < 19.0
        };
        // With its axis on the hole's a flat cutter lies on the whole floor.
        let found = part.found(&flat(5.0), DOWN);
        assert!(found.reached(floor) > 0.99, "{pitch}: {}", found.reached(floor));
        // Wide enough that the cutter holds a voxel centre wherever it stands.
        let wide = 5.0 + 1.2 * pitch;
        assert_eq!(part.found(&flat(wide), DOWN).reached(floor), 0.0, "{pitch}");
    }
}

#[test]
fn a_hole_deeper_than_the_stick_out_is_reached_as_far_as_the_holder_lets() {
    let centre = DVec2::splat(8.0);
    let mesh = pocketed(DVec3::new(16.0, 16.0, 44.0), &circle(centre, 4.0, 64), 40.0);
    let wall = |s: &SurfaceSample| (s.point.truncate() - centre).length() < 4.1 && is_wall(s);
    for pitch in PITCHES {
        let part = Part::new(&mesh, pitch);
        let found = part.found(&flat(3.0), AXES);
        // The samples are some 1 mm apart.
        let expected = 30.0 / 40.0;
        let bound = 0.5 * pitch / 40.0 + 0.02;
        assert_near(found.reached(wall), expected, bound, pitch);
        let hits_part = |hits: u64| found.tool.hits(hits).any(|hit| hit == (ElementKind::Holder(0), 0));
        let by_holder = found
            .share(wall, |reach| matches!(*reach, SampleReach::Obstructed { hits, .. } if hits_part(hits)));
        assert_near(by_holder, 1.0 - expected, bound, pitch);
    }
}

#[test]
fn pockets_with_corners_rounder_and_sharper_than_the_cutter() {
    let (r, depth, side) = (3.0, 10.0, 20.0);
    for pitch in PITCHES {
        for corner in [4.0, 2.0] {
            let outline = rounded_rectangle(DVec2::splat(5.0), DVec2::splat(5.0 + side), corner, 12);
            let mesh = pocketed(DVec3::new(30.0, 30.0, 20.0), &outline, depth);
            let part = Part::sampled(&mesh, pitch, 3000);
            let found = part.found(&flat(r), DOWN);
            let inside = |s: &SurfaceSample| (s.point.truncate() - 15.0).abs().max_element() < 10.1;
            let wall = |s: &SurfaceSample| inside(s) && is_wall(s);
            let floor = |s: &SurfaceSample| inside(s) && s.normal.z > 0.5 && s.point.z < 15.0;
            // Of each corner the arc, and of both walls what the cutter leaves beside it.
            let around = 4.0 * (side - 2.0 * corner) + 2.0 * PI * corner;
            let left = if corner < r { 4.0 * (0.5 * PI * corner + 2.0 * (r - corner)) } else { 0.0 };
            let expected = 1.0 - left / around;
            let whole = side * side - (4.0 - PI) * corner * corner;
            let uncut = if corner < r { (4.0 - PI) * (r * r - corner * corner) } else { 0.0 };
            let expected_floor = 1.0 - uncut / whole;
            // A cutter may pass a wall by a voxel's diagonal before it holds a centre.
            let bound = 0.01 + if corner < r { 0.13 * pitch } else { 0.0 };
            assert_near(found.reached(wall), expected, bound, (pitch, corner));
            assert_near(found.reached(floor), expected_floor, bound, (pitch, corner));
        }
    }
}

#[test]
fn undercuts_are_reached_by_the_cutters_made_for_them() {
    let within = |s: &SurfaceSample| (s.point.x - 20.0).abs() < 10.1 && s.normal.y.abs() < 0.5;
    let head_walls =
        |s: &SurfaceSample| within(s) && s.normal.x.abs() > 0.4 && (5.9..12.1).contains(&s.point.z);
    let ceiling = |s: &SurfaceSample| within(s) && s.normal.z < -0.9 && s.point.z > 1.0;
    let floor = |s: &SurfaceSample| within(s) && s.normal.z > 0.9 && s.point.z < 7.0;
    let wide = tool(vec![line(0.0, 4.0, 8.0, 8.0)], 1.8);
    let slotter = Tool { back_cutting: true, ..wide.clone() };
    let taper = 6.0 / 3.0_f64.sqrt();
    let dovetail = tool(vec![line(0.0, 6.0, 8.0, 8.0 - taper)], 2.0);
    for pitch in PITCHES {
        let t_slot = Part::sampled(&slotted(8.0, [20.0, 20.0]), pitch, 3000);
        let plain = t_slot.found(&flat(3.0), DOWN);
        assert_eq!(plain.reached(ceiling), 0.0);
        assert_eq!(plain.share(ceiling, |r| *r == SampleReach::NotFaced), 1.0);
        assert!(plain.reached(head_walls) < 1e-9, "{pitch}: {}", plain.reached(head_walls));
        // Half the floor is eight wide samples; a cutter passes a wall by a voxel at most.
        assert_near(plain.reached(floor), 0.4, 0.05 + 0.12 * pitch, pitch);
        let made_for_it = t_slot.found(&slotter, DOWN);
        for area in [&head_walls as &dyn Fn(&SurfaceSample) -> bool, &ceiling, &floor] {
            assert!(made_for_it.reached(area) > 0.99, "{pitch}: {}", made_for_it.reached(area));
        }
        // One that does not cut with its back.
        assert_eq!(t_slot.found(&wide, DOWN).share(ceiling, |r| *r == SampleReach::NotFaced), 1.0);
        let tail = Part::new(&slotted(20.0 - 2.0 * taper, [20.0, 20.0 - 2.0 * taper]), pitch);
        assert_eq!(tail.found(&flat(3.0), DOWN).reached(head_walls), 0.0);
        let made_for_it = tail.found(&dovetail, DOWN);
        assert!(made_for_it.reached(head_walls) > 0.99, "{pitch}: {}", made_for_it.reached(head_walls));
        // A ball on a thinner neck touches a wall as far down as the neck passes the slot's edge: with its middle no farther
        // from the slot's than half the slot less the neck.
        let lollipop = |neck: f64| {
            let to = 2.5 + (2.5 * 2.5 - neck * neck).sqrt();
            let ball = arc(0.0, to, 2.5, 0.0, 2.5);
            tail.found(&tool(vec![ball], neck), DOWN).reached(head_walls)
        };
        for neck in [1.0, 1.8] {
            let middle = 10.0 - taper - neck;
            let lowest = 6.0 + (10.0 - 2.5 * 0.75_f64.sqrt() - middle) * 3.0_f64.sqrt();
            assert_near(lollipop(neck), (12.0 - lowest) / 6.0, 0.03 + 0.05 * pitch, pitch);
        }
    }
}

#[test]
fn a_slot_is_reached_by_cutters_up_to_its_width() {
    let slot = slotted(8.0, [8.0, 8.0]);
    let floor = |s: &SurfaceSample| (s.point.x - 20.0).abs() < 4.0 && s.normal.z > 0.5 && s.point.z < 7.0;
    for pitch in PITCHES {
        let slot = Part::sampled(&slot, pitch, 3000);
        for radius in [3.0, 4.0] {
            let found = slot.found(&flat(radius), AXES).reached(floor);
            assert!(found > 0.99, "{pitch} {radius}: {found}");
        }
        let too_wide = slot.found(&flat(5.0), AXES);
        // At both ends its round reaches into the slot until its chord is 8 wide, less what the voxels of the walls leave.
        let expected = 2.0 * (25.0 * 0.6_f64.acos() - 12.0) / (8.0 * 20.0);
        let reached = too_wide.reached(floor);
        assert!((reached - expected).abs() < 0.03 + 0.13 * pitch || pitch > 1.0, "{pitch}: {reached}");
    }
}

#[test]
fn a_shank_as_wide_as_its_cutter_may_touch_the_wall_that_the_cutter_touches() {
    let slot = slotted(10.0, [10.0, 10.0]);
    let (lower, upper) = slot.bounds().unwrap();
    // Voxel centres lie in the wall at x = 25.
    let grid = Grid::with_pitch(lower - DVec3::new(2.0, 1.7, 1.3), upper + 2.0, 2.0, 0).unwrap();
    let centres = (25.0 - grid.origin.x) / 2.0 - 0.5;
    assert_eq!(centres, centres.round());
    let slot = Part::on(&grid, &slot, SAMPLES);
    let wall = |s: &SurfaceSample| s.normal.x < -0.9 && (s.point.x - 25.0).abs() < 0.1;
    let with_shank =
        |radius: f64| slot.found(&tool(vec![line(0.0, 4.0, 4.0, 4.0)], radius), DOWN).reached(wall);
    assert!(with_shank(4.0) > 0.999, "{}", with_shank(4.0));
    assert!(with_shank(4.5) < 0.7, "{}", with_shank(4.5));
}

#[test]
fn a_dimple_is_reached_by_balls_up_to_its_radius() {
    let (big, depth) = (10.0, 5.0);
    let middle = DVec3::new(15.0, 15.0, 20.0 - depth + big);
    let mesh = dimpled(big, depth);
    let dimple = |s: &SurfaceSample| (s.point - middle).length() < big + 1e-6 && s.point.z < 19.9;
    for pitch in PITCHES {
        let part = Part::new(&mesh, pitch);
        for (radius, expected) in [(5.0, 1.0), (9.0, 1.0), (16.0, 0.0)] {
            let bound = if expected == 1.0 { 0.005 } else { 0.7 * pitch };
            assert_near(part.found(&ball(radius), DOWN).reached(dimple), expected, bound, (pitch, radius));
        }
    }
}

#[test]
fn a_cylinder_is_reached_by_the_flank_and_its_end_by_the_bottom() {
    let mesh = cylinder(20.0, 16.0);
    for pitch in PITCHES {
        let part = Part::new(&mesh, pitch);
        let found = part.found(&flat(3.0), DOWN);
        assert_eq!(found.reached(|s| s.normal.z > -0.5), 1.0, "{pitch}");
        assert_eq!(found.share(|s| s.normal.z < -0.5, |r| *r == SampleReach::NotFaced), 1.0, "{pitch}");
    }
}

/// Between voxel centres there is room for it: points of the surface keep it out.
#[test]
fn a_mesh_tool_does_not_enter_a_slot_that_is_narrower_than_it_is() {
    let tool = of_mesh(Mesh::revolved(&[[0.0, 3.0], [30.0, 3.0]], 64));
    // At the slot's ends its round flank touches the walls' edges.
    let inside = |s: &SurfaceSample| {
        (s.point.x - 20.0).abs() < 3.6 && (6.1..19.9).contains(&s.point.z) && (4.0..16.0).contains(&s.point.y)
    };
    for (pitch, throat, expected) in [(2.0, 5.5, 0.0), (1.0, 5.5, 0.0), (2.0, 7.0, 1.0), (1.0, 7.0, 1.0)] {
        let part = Part::new(&slotted(throat, [throat, throat]), pitch);
        assert_eq!(part.found(&tool, DOWN).reached(inside), expected, "{pitch} {throat}");
    }
}

#[test]
fn a_mesh_tool_reaches_what_its_shape_fits() {
    // 5 × 5 × 30, its tip in the middle of its end.
    let tool = of_mesh(Mesh::cuboid(DVec3::new(-2.5, -2.5, 0.0), DVec3::new(2.5, 2.5, 30.0)));
    for pitch in [2.0, 1.0] {
        // A groove 8 wide takes it, one 2 wide does not.
        for (width, expected) in [(8.0, 1.0), (2.0, 0.0)] {
            let part = Part::sampled(&slotted(width, [width, width]), pitch, 200);
            let floor = |s: &SurfaceSample| {
                (s.point.x - 20.0).abs() < 0.5 * width
                    && s.normal.z > 0.5
                    && s.point.z < 7.0
                    && (5.0..15.0).contains(&s.point.y)
            };
            let found = part.found(&tool, DOWN);
            assert_eq!(found.reached(floor), expected, "{pitch} {width}");
            // The top is wide on either side.
            assert_eq!(found.reached(|s| s.point.z > 19.99 && s.normal.z > 0.5), 1.0, "{pitch} {width}");
        }
    }
}

#[test]
fn a_mesh_tool_that_says_what_cuts_touches_with_that_alone() {
    // A bar with its tip in the middle of its end, and a housing beside it that reaches 5 lower.
    let mut mesh = Mesh::cuboid(DVec3::new(-2.5, -2.5, 0.0), DVec3::new(2.5, 2.5, 30.0));
    mesh.append(&Mesh::cuboid(DVec3::new(8.0, -2.5, -5.0), DVec3::new(18.0, 2.5, 30.0)));
    let silent = of_mesh(mesh.clone());
    let cutting: Vec<DVec3> = mesh.vertices.into_iter().filter(|v| v.length() < 4.0).collect();
    assert_eq!(cutting.len(), 4);
    let told = Tool { sharp_points: SharpPoints::Points(cutting), ..silent.clone() };
    let post = |width: f64| extruded(&[[0.0, 0.0], [20.0, 0.0], [20.0, width], [0.0, width]], width);
    let top = |s: &SurfaceSample| s.normal.z > 0.5;
    for pitch in [1.0, 0.5] {
        // Above a plate the housing is in the way; it hangs beside a post.
        let (plate, narrow) = (Part::sampled(&post(60.0), pitch, 200), Part::sampled(&post(5.0), pitch, 200));
        assert_eq!(narrow.found(&told, DOWN).reached(top), 1.0, "{pitch}");
        let middle = |s: &SurfaceSample| top(s) && (20.0..40.0).contains(&s.point.x);
        let obstructed = |reach: &SampleReach| matches!(reach, SampleReach::Obstructed { .. });
        assert_eq!(plate.found(&told, DOWN).share(middle, obstructed), 1.0, "{pitch}");
        assert_eq!(plate.found(&silent, DOWN).reached(middle), 1.0, "{pitch}: the housing touches");
    }
}
