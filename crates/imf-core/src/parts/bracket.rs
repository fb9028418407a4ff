//! The bracket: a fork on a base plate, and the block that it is what is left of.
//!
//! Both are shaped by hand, not by an optimiser. The plate stands on z = 0 and is bolted down at its four corners;
//! two cheeks rise from it across x and carry a pin bore along x; a web joins them below. Lightening holes go
//! through the cheeks (a 5 mm ball passes all but the smallest), a small hole through the web and two slots through
//! the plate. The gap between the cheeks is narrower than the tool's holder and, under the pin, deeper than the
//! 35 mm cutter; the slots open it from below.
//!
//! The design domain keeps what is given, the plate with its bolt holes and the pin bore, and fills the rest with
//! a block around the fork. The bracket lies within it.
//!
//! Sizes are in millimetres.

use glam::DVec2;

use super::shell::{Axis, Facing, Shell, arc, circle, rounded_rectangle};
use crate::mesh::Mesh;

/// Extents of both shapes.
pub const SIZE: [f64; 3] = [49.0, 147.0, 87.0];

/// Segments to a full circle: at the largest radius, 20 mm, chords stay within 0.05 mm of the arc.
const CIRCLE: usize = 48;

const PLATE_TOP: f64 = 10.0;
const PLATE_CORNER: f64 = 8.0;
/// The bolts' axes: every x with every y.
const BOLTS: [[f64; 2]; 2] = [[12.5, 36.5], [13.0, 134.0]];
const BOLT_RADIUS: f64 = 5.5;
/// The bolts' heads sink into counterbores down to this height.
const COUNTERBORE_FLOOR: f64 = 7.0;
const COUNTERBORE_RADIUS: f64 = 9.0;
/// The slots through the plate under the fork: their corners in (x, y).
const SLOTS: [[[f64; 2]; 2]; 2] = [[[19.0, 36.0], [30.0, 58.0]], [[19.0, 89.0], [30.0, 111.0]]];

/// Centre (y, z) of the pin bore; the cheek's round head ends at the top of the part.
const PIN: DVec2 = DVec2::new(73.5, 67.0);
const PIN_RADIUS: f64 = 11.0;
const HEAD_RADIUS: f64 = 20.0;
const BOSS_RADIUS: f64 = 16.0;
/// Of both cheeks in x: the end of the boss, the outer face, the inner face.
const CHEEKS: [[f64; 3]; 2] = [[4.0, 8.0, 17.0], [45.0, 41.0, 32.0]];
/// Where the cheeks stand on the plate, in y.
const FOOT: [f64; 2] = [26.0, 121.0];
/// The cheeks' lightening holes: y, z and radius.
const LIGHTENING: [[f64; 3]; 5] =
    [[52.0, 28.0, 9.0], [95.0, 28.0, 9.0], [58.0, 49.0, 6.0], [89.0, 49.0, 6.0], [73.5, 42.0, 4.0]];

/// The web between the cheeks in y, its top, and the radius of the hole through its middle.
const WEB: [f64; 2] = [69.0, 78.0];
const WEB_TOP: f64 = 33.0;
const WEB_HOLE_RADIUS: f64 = 4.0;

/// The bracket: closed, one shell, facing outwards.
#[must_use]
pub fn mesh() -> Mesh {
    let mut shell = Shell::default();
    let [[outer0, inner0], [outer1, inner1]] = CHEEKS.map(|[_, outer, inner]| [outer, inner]);
    let ([y0, y1], [w0, w1]) = (FOOT, WEB);
    // Both cheeks and the web, seen from above: an H on its side.
    let footprint = [
        [outer0, y0],
        [inner0, y0],
        [inner0, w0],
        [inner1, w0],
        [inner1, y0],
        [outer1, y0],
        [outer1, y1],
        [inner1, y1],
        [inner1, w1],
        [inner0, w1],
        [inner0, y1],
        [outer0, y1],
    ]
    .map(DVec2::from_array);
    plate(&mut shell, &footprint, &slots());
    for cheek in CHEEKS {
        add_cheek(&mut shell, cheek);
    }
    add_web(&mut shell, [inner0, inner1]);
    shell.into_mesh()
}

/// The bracket's design domain: closed, one shell, facing outwards.
#[must_use]
pub fn design_domain() -> Mesh {
    let mut shell = Shell::default();
    let ([x0, x1], [y0, y1], top) = (CHEEKS.map(|cheek| cheek[0]), FOOT, SIZE[2]);
    let block = rectangle([x0, x1], [y0, y1]);
    plate(&mut shell, &block, &[]);
    shell.face(Axis::Z, top, Facing::Up, &block, &[]);
    let end = rectangle([PLATE_TOP, top], [x0, x1]);
    shell.face(Axis::Y, y0, Facing::Down, &end, &[]);
    shell.face(Axis::Y, y1, Facing::Up, &end, &[]);
    let (side, pin) = (rectangle([y0, y1], [PLATE_TOP, top]), pin());
    shell.face(Axis::X, x0, Facing::Down, &side, &[&pin]);
    shell.face(Axis::X, x1, Facing::Up, &side, &[&pin]);
    shell.hole(Axis::X, &pin, [x0, x1]);
    shell.into_mesh()
}

/// The plate with its holes, its top open where `footprint` rises from it.
fn plate(shell: &mut Shell, footprint: &[DVec2], slots: &[Vec<DVec2>]) {
    let (outline, bolts, heads) = (plate_outline(), bolts(BOLT_RADIUS), bolts(COUNTERBORE_RADIUS));
    let through: Vec<&[DVec2]> = bolts.iter().chain(slots).map(Vec::as_slice).collect();
    let above: Vec<&[DVec2]> = heads.iter().chain(slots).map(Vec::as_slice).chain([footprint]).collect();
    shell.face(Axis::Z, 0.0, Facing::Down, &outline, &through);
    shell.face(Axis::Z, PLATE_TOP, Facing::Up, &outline, &above);
    shell.post(Axis::Z, &outline, [0.0, PLATE_TOP]);
    for slot in slots {
        shell.hole(Axis::Z, slot, [0.0, PLATE_TOP]);
    }
    for (bolt, head) in bolts.iter().zip(&heads) {
        shell.hole(Axis::Z, bolt, [0.0, COUNTERBORE_FLOOR]);
        shell.face(Axis::Z, COUNTERBORE_FLOOR, Facing::Up, head, &[bolt]);
        shell.hole(Axis::Z, head, [COUNTERBORE_FLOOR, PLATE_TOP]);
    }
}

/// A cheek with its boss; its inner face is open where the web joins it.
fn add_cheek(shell: &mut Shell, [boss_end, outer, inner]: [f64; 3]) {
    let sorted = |a: f64, b: f64| [a.min(b), a.max(b)];
    let (away, towards) = if outer < inner { (Facing::Down, Facing::Up) } else { (Facing::Up, Facing::Down) };
    let (flank, pin, boss, lightening) = (flank(), pin(), circle(PIN, BOSS_RADIUS, CIRCLE), lightening());
    let small = || lightening.iter().map(Vec::as_slice);

    let outer_holes: Vec<&[DVec2]> = small().chain([boss.as_slice()]).collect();
    shell.face(Axis::X, outer, away, &flank, &outer_holes);
    let notch = [[WEB[0], PLATE_TOP], [WEB[0], WEB_TOP], [WEB[1], WEB_TOP], [WEB[1], PLATE_TOP]];
    let mut notched = flank.clone();
    notched.extend(notch.map(DVec2::from_array));
    let inner_holes: Vec<&[DVec2]> = small().chain([pin.as_slice()]).collect();
    shell.face(Axis::X, inner, towards, &notched, &inner_holes);

    let [low, high] = sorted(outer, inner);
    shell.strip(&Axis::X.place(&flank, low), &Axis::X.place(&flank, high));
    for hole in small() {
        shell.hole(Axis::X, hole, [low, high]);
    }
    shell.post(Axis::X, &boss, sorted(boss_end, outer));
    shell.face(Axis::X, boss_end, away, &boss, &[&pin]);
    shell.hole(Axis::X, &pin, sorted(boss_end, inner));
}

/// The web between the cheeks' inner faces at `x`.
fn add_web(shell: &mut Shell, x: [f64; 2]) {
    let (side, hole) = (rectangle([PLATE_TOP, WEB_TOP], x), web_hole());
    shell.face(Axis::Y, WEB[0], Facing::Down, &side, &[&hole]);
    shell.face(Axis::Y, WEB[1], Facing::Up, &side, &[&hole]);
    shell.hole(Axis::Y, &hole, WEB);
    shell.face(Axis::Z, WEB_TOP, Facing::Up, &rectangle(x, WEB), &[]);
}

/// A rectangle over two ranges of the plane's coordinates, counter-clockwise.
fn rectangle(u: [f64; 2], v: [f64; 2]) -> [DVec2; 4] {
    [[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]].map(DVec2::from_array)
}

fn plate_outline() -> Vec<DVec2> {
    rounded_rectangle(DVec2::ZERO, DVec2::new(SIZE[0], SIZE[1]), PLATE_CORNER, CIRCLE / 4)
}

fn bolts(radius: f64) -> Vec<Vec<DVec2>> {
    let [xs, ys] = BOLTS;
    ys.iter().flat_map(|&y| xs.map(|x| circle(DVec2::new(x, y), radius, CIRCLE))).collect()
}

fn slots() -> Vec<Vec<DVec2>> {
    SLOTS
        .iter()
        .map(|&[lower, upper]| {
            let radius = (upper[0] - lower[0]) / 2.0;
            rounded_rectangle(DVec2::from_array(lower), DVec2::from_array(upper), radius, CIRCLE / 4)
        })
        .collect()
}

fn pin() -> Vec<DVec2> {
    circle(PIN, PIN_RADIUS, CIRCLE)
}

fn lightening() -> Vec<Vec<DVec2>> {
    LIGHTENING.iter().map(|&[y, z, radius]| circle(DVec2::new(y, z), radius, CIRCLE)).collect()
}

fn web_hole() -> Vec<DVec2> {
    let x = (CHEEKS[0][2] + CHEEKS[1][2]) / 2.0;
    circle(DVec2::new((PLATE_TOP + WEB_TOP) / 2.0, x), WEB_HOLE_RADIUS, CIRCLE)
}

/// The cheek's outline from its foot at high y over the head to its foot at low y: straight flanks that touch the
/// head's arc.
fn flank() -> Vec<DVec2> {
    let [low, high] = FOOT.map(|y| DVec2::new(y, PLATE_TOP));
    let from_pin = high - PIN;
    let touching = from_pin.to_angle() + (HEAD_RADIUS / from_pin.length()).acos();
    let start = touching.to_degrees();
    // The foot stands midway below the pin, so the other flank is the mirror image.
    let mut outline = vec![high];
    outline.extend(arc(PIN, HEAD_RADIUS, [start, 180.0 - start], CIRCLE / 2));
    outline.push(low);
    outline
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::parts::shell::area;

    fn plate_volume(slots: &[Vec<DVec2>]) -> f64 {
        let areas = |loops: &[Vec<DVec2>]| loops.iter().map(|l| area(l)).sum::<f64>();
        PLATE_TOP * (area(&plate_outline()) - areas(slots))
            - COUNTERBORE_FLOOR * areas(&bolts(BOLT_RADIUS))
            - (PLATE_TOP - COUNTERBORE_FLOOR) * areas(&bolts(COUNTERBORE_RADIUS))
    }

    #[test]
    fn extents_are_exact() {
        for mesh in [mesh(), design_domain()] {
            let (lower, upper) = mesh.bounds().unwrap();
            assert!(lower.abs().max_element() < 1e-12, "{lower}");
            assert!((upper - DVec3::from_array(SIZE)).abs().max_element() < 1e-12, "{upper}");
        }
    }

    #[test]
    fn the_brackets_volume_is_the_sum_of_areas_times_heights() {
        let pin = area(&pin());
        let boss = area(&circle(PIN, BOSS_RADIUS, CIRCLE)) - pin;
        let cheek = area(&flank()) - lightening().iter().map(|l| area(l)).sum::<f64>() - pin;
        let web = 15.0 * (WEB_TOP - PLATE_TOP) - area(&web_hole());
        let expected = plate_volume(&slots()) + 2.0 * (9.0 * cheek + 4.0 * boss) + 9.0 * web;
        let volume = mesh().signed_volume();
        assert!((volume - expected).abs() < 1e-9 * expected, "{volume} against {expected}");
    }

    #[test]
    fn the_design_domains_volume_is_the_sum_of_areas_times_heights() {
        let block = 41.0 * (95.0 * (SIZE[2] - PLATE_TOP) - area(&pin()));
        let expected = plate_volume(&[]) + block;
        let volume = design_domain().signed_volume();
        assert!((volume - expected).abs() < 1e-9 * expected, "{volume} against {expected}");
    }

    #[test]
    fn the_bracket_lies_within_its_design_domain() {
        let above_plate = |p: &DVec3| p.z > PLATE_TOP;
        let block = [DVec3::new(4.0, FOOT[0], PLATE_TOP), DVec3::new(45.0, FOOT[1], SIZE[2])];
        for p in mesh().vertices.iter().filter(|&p| above_plate(p)) {
            assert!(p.cmpge(block[0]).all() && p.cmple(block[1]).all(), "{p}");
        }
    }
}
