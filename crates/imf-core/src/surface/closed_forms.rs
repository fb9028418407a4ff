//! Parts of which geometry tells what a tool reaches, at pitches that halve: every answer stays within a bound of the closed
//! form, and the bound falls with the pitch.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::*;
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::orientation::OrientationSet;
use crate::parts::shell::{Axis, Facing as Side, Shell, circle, pocketed, rounded_rectangle};
use crate::tool::{Segment, SharpPoints, Tool};
use crate::voxelize::voxelize;

const PITCHES: [f64; 4] = [2.0, 1.0, 0.5, 0.25];

fn line(from: f64, to: f64, radius_from: f64, radius_to: f64) -> Segment {
    Segment::Line { from, to, radius_from, radius_to }
}

/// A cutter, a shank of a radius up to 30, and a holder of diameter 24 up to 60.
fn tool(cutter: Vec<Segment>, shank: f64) -> Tool {
    let end = cutter.last().unwrap().range().1;
    let elements = [
        (ElementKind::Cutter, cutter),
        (ElementKind::Shank, vec![line(end, 30.0, shank, shank)]),
        (ElementKind::Holder(0), vec![line(30.0, 60.0, 12.0, 12.0)]),
    ];
    Tool {
        name: "test".into(),
        unit: LengthUnit::Mm,
        shape: ToolShape::Revolved(
            elements.into_iter().map(|(kind, profile)| Element { kind, profile }).collect(),
        ),
        sharp_points: SharpPoints::Tip,
    }
}

fn flat(radius: f64) -> Tool {
    tool(vec![line(0.0, 20.0, radius, radius)], radius)
}

fn ball(radius: f64) -> Tool {
    let round =
        Segment::Arc { from: 0.0, to: radius, centre_height: radius, centre_radius: 0.0, arc_radius: radius };
    tool(vec![round, line(radius, 20.0, radius, radius)], radius)
}

/// A profile in (z, x), counter-clockwise, extruded along y.
fn extruded(profile: &[[f64; 2]], length: f64) -> Mesh {
    let outline: Vec<DVec2> = profile.iter().map(|&p| DVec2::from_array(p)).collect();
    let mut shell = Shell::default();
    shell.post(Axis::Y, &outline, [0.0, length]);
    shell.face(Axis::Y, 0.0, Side::Down, &outline, &[]);
    shell.face(Axis::Y, length, Side::Up, &outline, &[]);
    shell.into_mesh()
}

/// A part's samples, with what becomes of each.
struct Found {
    samples: Vec<SurfaceSample>,
    reach: Vec<Reach>,
}

impl Found {
    fn new(mesh: &Mesh, tool: &Tool, pitch: f64, directions: &str) -> Self {
        let (lower, upper) = mesh.bounds().unwrap();
        // Off the part's own planes, as a user's part lies.
        let shift = DVec3::new(0.37, 0.21, 0.13) * pitch;
        let grid = Grid::with_pitch(lower - shift, upper + shift, pitch, 1).unwrap();
        let solid = Arc::new(voxelize(mesh, &grid, false));
        let samples = SurfaceSamples::new(mesh, &solid, 3000).samples;
        let tolerance = default_tolerance(pitch, LengthUnit::Mm);
        let tool = SurfaceTool::new(&solid, &solid, &tool.into(), tolerance).unwrap();
        let directions = OrientationSet::parse(directions).unwrap().orientations;
        let reach = surface_access(&tool, &samples, &directions, Control::quiet()).unwrap().reach;
        Self { samples, reach }
    }

    /// The share of the area of chosen samples for which a verdict holds.
    fn share(&self, of: impl Fn(&SurfaceSample) -> bool, is: impl Fn(&Reach) -> bool) -> f64 {
        let (mut whole, mut part) = (0.0, 0.0);
        for (sample, reach) in self.samples.iter().zip(&self.reach).filter(|(sample, _)| of(sample)) {
            whole += sample.area;
            part += if is(reach) { sample.area } else { 0.0 };
        }
        assert!(whole > 0.0, "no sample is chosen");
        part / whole
    }

    fn reached(&self, of: impl Fn(&SurfaceSample) -> bool) -> f64 {
        self.share(of, |reach| matches!(reach, Reach::Reached { .. }))
    }
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
        for tool in [flat(5.0), ball(3.0)] {
            assert_eq!(Found::new(&mesh, &tool, pitch, AXES).reached(|_| true), 1.0, "{pitch}");
        }
        // No direction is a face's normal: the rim touches.
        assert_eq!(Found::new(&mesh, &flat(5.0), pitch, "fibonacci:30").reached(|_| true), 1.0, "{pitch}");
    }
}

#[test]
fn holes_below_at_and_above_the_cutters_diameter() {
    let centre = DVec2::splat(8.0);
    let inside =
        |s: &SurfaceSample| (s.point.truncate() - centre).length() < 4.3 && (0.1..19.9).contains(&s.point.z);
    for pitch in PITCHES {
        // Facets of less than the tolerance: a cutter as wide as the hole is moved along the facet that it touches.
        for depth in [12.0, 20.0] {
            let block = |radius| pocketed(DVec3::new(16.0, 16.0, 20.0), &circle(centre, radius, 256), depth);
            for (radius, cutter_radius, cutter) in
                [(4.0, 3.0, flat(3.0)), (3.0, 3.0, flat(3.0)), (4.0, 3.0, ball(3.0)), (4.0, 4.0, ball(4.0))]
            {
                let found = Found::new(&block(radius), &cutter, pitch, AXES);
                let wall = |s: &SurfaceSample| inside(s) && is_wall(s);
                // A ball touches a wall at its equator, a radius above its tip.
                let is_ball = cutter == ball(3.0) || cutter == ball(4.0);
                let left = if is_ball && depth < 20.0 { cutter_radius } else { 0.0 };
                let expected = 1.0 - left / depth;
                // Samples stand some 0.8 mm apart.
                let bound = 0.01 + if is_ball { (0.8 + pitch) / depth } else { 0.0 };
                assert!(
                    (found.reached(wall) - expected).abs() < bound,
                    "{pitch} {depth} {radius} {cutter_radius}: {} for {expected}",
                    found.reached(wall)
                );
                // A flat end reaches the whole floor; a ball that is as wide as the hole its middle alone.
                if depth < 20.0 && radius == 4.0 {
                    let floor = |s: &SurfaceSample| inside(s) && s.normal.z > 0.5;
                    let found = found.reached(floor);
                    let least = if is_ball { 0.0 } else { 0.995 };
                    assert!(found >= least, "{pitch} {radius}: {found}");
                }
            }
            let found = Found::new(&block(4.0), &flat(5.0), pitch, AXES);
            let fits = found.reached(inside);
            // The cutter dips into the mouth as far as no solid centre lies below it.
            assert!(fits < 0.1 * pitch || pitch > 1.0, "{pitch}: {fits}");
            let gouged = found
                .share(|s| inside(s) && s.normal.z > 0.5 || inside(s) && is_wall(s), |r| *r == Reach::Gouged);
            assert!(gouged > 0.99 - 0.1 * pitch || pitch > 1.0, "{pitch}: {gouged}");
        }
    }
}

#[test]
fn a_hole_deeper_than_the_stick_out_is_reached_as_far_as_the_holder_lets() {
    let centre = DVec2::splat(8.0);
    let mesh = pocketed(DVec3::new(16.0, 16.0, 44.0), &circle(centre, 4.0, 64), 40.0);
    let wall = |s: &SurfaceSample| (s.point.truncate() - centre).length() < 4.1 && is_wall(s);
    for pitch in PITCHES {
        let found = Found::new(&mesh, &flat(3.0), pitch, AXES);
        // The samples are some 1 mm apart.
        let expected = 30.0 / 40.0;
        let bound = 0.5 * pitch / 40.0 + 0.02;
        assert!((found.reached(wall) - expected).abs() < bound, "{pitch}: {}", found.reached(wall));
        let by_holder = found
            .share(wall, |reach| matches!(reach, Reach::Obstructed { elements, .. } if elements & 0b10 != 0));
        let gouged = found.share(wall, |r| *r == Reach::Gouged);
        assert!(
            (by_holder - (1.0 - expected)).abs() < bound,
            "{pitch}: {by_holder}, reached {}, gouged {gouged}",
            found.reached(wall)
        );
    }
}

#[test]
fn pockets_with_corners_rounder_and_sharper_than_the_cutter() {
    let (r, depth, side) = (3.0, 10.0, 20.0);
    for pitch in PITCHES {
        for corner in [4.0, 2.0] {
            let outline = rounded_rectangle(DVec2::splat(5.0), DVec2::splat(5.0 + side), corner, 12);
            let mesh = pocketed(DVec3::new(30.0, 30.0, 20.0), &outline, depth);
            let found = Found::new(&mesh, &flat(r), pitch, DOWN);
            let inside = |s: &SurfaceSample| {
                let p = s.point.truncate();
                p.min_element() > 4.9 && p.max_element() < 25.1
            };
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
            assert!(
                (found.reached(wall) - expected).abs() < bound,
                "{pitch} {corner}: {} for {expected}",
                found.reached(wall)
            );
            let found_floor = found.reached(floor);
            assert!(
                (found_floor - expected_floor).abs() < bound,
                "{pitch} {corner}: {found_floor} for {expected_floor}"
            );
        }
    }
}

/// A block of 40 × 20 × 20 with a slot along y: a throat of a width in its top, and a head below.
fn slotted(throat: f64, head: [f64; 2]) -> Mesh {
    let (t, bottom, top) = (throat / 2.0, head[0] / 2.0, head[1] / 2.0);
    let x = |offset: f64| 20.0 + offset;
    // (z, x): up the left side would be clockwise; from the origin along z is against it.
    let profile = [
        [0.0, 0.0],
        [20.0, 0.0],
        [20.0, x(-t)],
        [12.0, x(-t)],
        [12.0, x(-top)],
        [6.0, x(-bottom)],
        [6.0, x(bottom)],
        [12.0, x(top)],
        [12.0, x(t)],
        [20.0, x(t)],
        [20.0, 40.0],
        [0.0, 40.0],
    ];
    let mut mesh = extruded(&dedup(&profile), 20.0);
    if mesh.signed_volume() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

fn dedup(profile: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut profile = profile.to_vec();
    profile.dedup();
    profile
}

#[test]
fn undercuts_are_reached_by_the_cutters_made_for_them() {
    let within = |s: &SurfaceSample| (s.point.x - 20.0).abs() < 10.1 && s.normal.y.abs() < 0.5;
    let head_walls =
        |s: &SurfaceSample| within(s) && s.normal.x.abs() > 0.4 && (5.9..12.1).contains(&s.point.z);
    let ceiling = |s: &SurfaceSample| within(s) && s.normal.z < -0.9 && s.point.z > 1.0;
    let floor = |s: &SurfaceSample| within(s) && s.normal.z > 0.9 && s.point.z < 7.0;
    let slotter = tool(vec![line(0.0, 4.0, 8.0, 8.0)], 1.8);
    let taper = 6.0 / 3.0_f64.sqrt();
    let dovetail = tool(vec![line(0.0, 6.0, 8.0, 8.0 - taper)], 2.0);
    for pitch in PITCHES {
        let t_slot = slotted(8.0, [20.0, 20.0]);
        let plain = Found::new(&t_slot, &flat(3.0), pitch, DOWN);
        assert_eq!(plain.reached(ceiling), 0.0);
        assert_eq!(plain.share(ceiling, |r| *r == Reach::NotFaced), 1.0);
        assert!(plain.reached(head_walls) < 1e-9, "{pitch}: {}", plain.reached(head_walls));
        let under_throat = plain.reached(floor);
        // Half the floor is eight wide samples; a cutter passes a wall by a voxel at most.
        assert!((under_throat - 0.4).abs() < 0.05 + 0.12 * pitch, "{pitch}: {under_throat}");
        let made_for_it = Found::new(&t_slot, &slotter, pitch, DOWN);
        for area in [&head_walls as &dyn Fn(&SurfaceSample) -> bool, &ceiling, &floor] {
            assert!(made_for_it.reached(area) > 0.99, "{pitch}: {}", made_for_it.reached(area));
        }
        let tail = slotted(20.0 - 2.0 * taper, [20.0, 20.0 - 2.0 * taper]);
        assert_eq!(Found::new(&tail, &flat(3.0), pitch, DOWN).reached(head_walls), 0.0);
        let made_for_it = Found::new(&tail, &dovetail, pitch, DOWN);
        assert!(made_for_it.reached(head_walls) > 0.99, "{pitch}: {}", made_for_it.reached(head_walls));
    }
}

#[test]
fn a_slot_is_reached_by_cutters_up_to_its_width() {
    let slot = slotted(8.0, [8.0, 8.0]);
    let floor = |s: &SurfaceSample| (s.point.x - 20.0).abs() < 4.0 && s.normal.z > 0.5 && s.point.z < 7.0;
    for pitch in PITCHES {
        for radius in [3.0, 4.0] {
            let found = Found::new(&slot, &flat(radius), pitch, AXES).reached(floor);
            assert!(found > 0.99, "{pitch} {radius}: {found}");
        }
        let too_wide = Found::new(&slot, &flat(5.0), pitch, AXES);
        // From the open ends a tool lies on the last voxel of the floor, or on the last sample.
        let reached = too_wide.reached(floor);
        assert!(reached < 0.12 + 0.12 * pitch || pitch > 1.0, "{pitch}: {reached}");
    }
}

#[test]
fn a_dimple_is_reached_by_balls_up_to_its_radius() {
    let (big, depth) = (10.0, 5.0);
    let centre = DVec2::splat(15.0);
    let middle = DVec3::new(15.0, 15.0, 20.0 - depth + big);
    let mut shell = Shell::default();
    let outer = [DVec2::ZERO, DVec2::new(30.0, 0.0), DVec2::splat(30.0), DVec2::new(0.0, 30.0)];
    let rim = |i: usize| {
        let (sine, cosine) = (PI / 3.0 * i as f64 / 16.0).sin_cos();
        (circle(centre, big * sine, 64), middle.z - big * cosine)
    };
    shell.post(Axis::Z, &outer, [0.0, 20.0]);
    shell.face(Axis::Z, 0.0, Side::Down, &outer, &[]);
    shell.face(Axis::Z, 20.0, Side::Up, &outer, &[&rim(16).0]);
    for i in 1..=16 {
        let (upper, height) = rim(i);
        // The last ring lies in the top's own plane.
        let height = if i == 16 { 20.0 } else { height };
        if i == 1 {
            shell.face(Axis::Z, height, Side::Up, &upper, &[]);
        } else {
            let (lower, below) = rim(i - 1);
            shell.band(&Axis::Z.place(&upper, height), &Axis::Z.place(&lower, below));
        }
    }
    let mesh = shell.into_mesh();
    let dimple = |s: &SurfaceSample| (s.point - middle).length() < big + 1e-6 && s.point.z < 19.9;
    for pitch in PITCHES {
        for (radius, expected) in [(5.0, 1.0), (9.0, 1.0), (16.0, 0.0)] {
            let found = Found::new(&mesh, &ball(radius), pitch, DOWN).reached(dimple);
            let bound = if expected == 1.0 { 0.005 } else { 0.7 * pitch };
            assert!((found - expected).abs() < bound, "{pitch} {radius}: {found}");
        }
    }
}

#[test]
fn a_cylinder_is_reached_by_the_flank_and_its_end_by_the_bottom() {
    let mut shell = Shell::default();
    let outline = circle(DVec2::ZERO, 20.0, 128);
    shell.post(Axis::Z, &outline, [0.0, 16.0]);
    shell.face(Axis::Z, 0.0, Side::Down, &outline, &[]);
    shell.face(Axis::Z, 16.0, Side::Up, &outline, &[]);
    let mesh = shell.into_mesh();
    for pitch in PITCHES {
        let found = Found::new(&mesh, &flat(3.0), pitch, DOWN);
        assert_eq!(found.reached(|s| s.normal.z > -0.5), 1.0, "{pitch}");
        assert_eq!(found.share(|s| s.normal.z < -0.5, |r| *r == Reach::NotFaced), 1.0, "{pitch}");
    }
}
