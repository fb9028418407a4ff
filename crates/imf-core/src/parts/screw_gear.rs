//! The screw gear: a helical gear with recessed web and hub on a threaded bore, its axis along z.
//!
//! Teeth are involutes over a rounded gap floor, twisted about the axis over the face width; the bore is a
//! single-start trapezoidal thread, a cross-section that turns once a pitch. A 5 mm ball enters the gaps between
//! the teeth but does not reach their floor, enters the bore but not the bottom of the thread's groove, and passes
//! none of the holes through the web. The hub stands 23 mm above the teeth, in the holder's way.
//!
//! Of fourteen teeth, two point along x while two gaps open along y: the gear is a little wider in x than in y, as
//! the grid of 99×98 is.
//!
//! Sizes are in millimetres.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};

use super::shell::{Axis, Facing, Shell, circle};
use crate::mesh::Mesh;

const TEETH: usize = 14;
/// Half the extent in x. With the tooth's land and its twist the gap along y leaves just under 98 mm there.
const TIP_RADIUS: f64 = 49.1;
/// The module of a gear whose teeth end one module outside the pitch circle.
const MODULE: f64 = 2.0 * TIP_RADIUS / (TEETH as f64 + 2.0);
const PITCH_RADIUS: f64 = 0.5 * MODULE * TEETH as f64;
/// The gap's floor lies one and a quarter module within the pitch circle.
const ROOT_RADIUS: f64 = PITCH_RADIUS - 1.25 * MODULE;
const PRESSURE_ANGLE: f64 = 20.0;
/// The teeth turn by this angle over the face width: a helix of 13.7° on the pitch circle.
const TWIST: f64 = 13.0;

/// Segments to an involute flank and to the floor of a gap.
const FLANK: usize = 6;
const FLOOR: usize = 8;
/// Slices of the face width; an even number, so that untwisted teeth stand in the middle.
const SLICES: usize = 10;
/// Segments to a circle, and corners of the bore's cross-section.
const CIRCLE: usize = 64;
const THREAD: usize = 32;

/// Heights: of the teeth and of the whole gear with its hub.
const FACE_WIDTH: f64 = 40.0;
const HUB_TOP: f64 = 63.0;
/// The web between the recesses in the two ends.
const WEB: [f64; 2] = [12.0, 28.0];
const RIM_RADIUS: f64 = 31.5;
const HUB_RADIUS: f64 = 20.0;
const CHAMFER: f64 = 1.5;
/// The holes through the web: their number, radius, and distance from the axis.
const HOLES: usize = 7;
const HOLE_RADIUS: f64 = 4.0;
const HOLE_CIRCLE: f64 = 25.75;

/// The thread's crest and groove, as radii, and its pitch: seven turns over the bore.
const THREAD_RADII: [f64; 2] = [12.5, 15.0];
const TURNS: usize = 7;

/// The gear: closed, one shell, facing outwards; its lower end at z = 0, its axis at x = y = 0.
pub(super) fn mesh() -> Mesh {
    let mut shell = Shell::default();
    let (rim, hub) = (circle(DVec2::ZERO, RIM_RADIUS, CIRCLE), circle(DVec2::ZERO, HUB_RADIUS, CIRCLE));
    let chamfered = circle(DVec2::ZERO, HUB_RADIUS - CHAMFER, CIRCLE);
    let (holes, bore) = (web_holes(), bore(0));

    let slices: Vec<Vec<DVec2>> = (0..=SLICES).map(gear_slice).collect();
    let height = |slice: usize| FACE_WIDTH * slice as f64 / SLICES as f64;
    for slice in 0..SLICES {
        let [low, high] = [slice, slice + 1].map(|s| Axis::Z.place(&slices[s], height(s)));
        shell.band(&low, &high);
    }
    shell.face(Axis::Z, 0.0, Facing::Down, &slices[0], &[&rim]);
    shell.face(Axis::Z, FACE_WIDTH, Facing::Up, &slices[SLICES], &[&rim]);

    shell.hole(Axis::Z, &rim, [0.0, WEB[0]]);
    shell.hole(Axis::Z, &rim, [WEB[1], FACE_WIDTH]);
    let mut inner: Vec<&[DVec2]> = holes.iter().map(Vec::as_slice).collect();
    inner.push(&hub);
    shell.face(Axis::Z, WEB[0], Facing::Down, &rim, &inner);
    shell.face(Axis::Z, WEB[1], Facing::Up, &rim, &inner);
    for hole in &holes {
        shell.hole(Axis::Z, hole, WEB);
    }

    let edges = [CHAMFER, HUB_TOP - CHAMFER];
    shell.band(&Axis::Z.place(&chamfered, 0.0), &Axis::Z.place(&hub, edges[0]));
    shell.post(Axis::Z, &hub, [edges[0], WEB[0]]);
    shell.post(Axis::Z, &hub, [WEB[1], edges[1]]);
    shell.band(&Axis::Z.place(&hub, edges[1]), &Axis::Z.place(&chamfered, HUB_TOP));
    shell.face(Axis::Z, 0.0, Facing::Down, &chamfered, &[&bore]);
    shell.face(Axis::Z, HUB_TOP, Facing::Up, &chamfered, &[&bore]);
    add_thread(&mut shell);
    shell.into_mesh()
}

/// The thread's surface: the bore's cross-section, turned by one of its corners a slice.
fn add_thread(shell: &mut Shell) {
    let slices = TURNS * THREAD;
    let corners =
        |slice: usize| -> Vec<DVec3> { Axis::Z.place(&bore(slice), HUB_TOP * slice as f64 / slices as f64) };
    for slice in 0..slices {
        // The bore's inside is the outside of the gear.
        shell.band(&corners(slice + 1), &corners(slice));
    }
}

/// The bore's cross-section in a slice of the thread; corner `i` of every slice is the same point of the profile,
/// so edges run along the helix and crest and groove stay sharp. A right-hand thread.
fn bore(slice: usize) -> Vec<DVec2> {
    let [crest, groove] = THREAD_RADII;
    (0..THREAD)
        .map(|corner| {
            // A quarter of the turn each for crest, flank, groove and flank.
            let quarter = 4.0 * corner as f64 / THREAD as f64;
            let depth = (quarter - 1.0).clamp(0.0, 1.0) - (quarter - 3.0).clamp(0.0, 1.0);
            let turned = (corner + slice) % THREAD;
            (crest + depth * (groove - crest)) * DVec2::from_angle(TAU * turned as f64 / THREAD as f64)
        })
        .collect()
}

fn web_holes() -> Vec<Vec<DVec2>> {
    (0..HOLES)
        .map(|i| {
            let centre = HOLE_CIRCLE * DVec2::from_angle(TAU * i as f64 / HOLES as f64);
            circle(centre, HOLE_RADIUS, CIRCLE / 2)
        })
        .collect()
}

/// The cross-section of the teeth in a slice of the face width, counter-clockwise.
fn gear_slice(slice: usize) -> Vec<DVec2> {
    let turn = DVec2::from_angle((TWIST * (slice as f64 / SLICES as f64 - 0.5)).to_radians());
    let tooth = tooth();
    (0..TEETH)
        .flat_map(|i| {
            let turn = turn.rotate(DVec2::from_angle(TAU * i as f64 / TEETH as f64));
            tooth.iter().map(move |&p| turn.rotate(p)).collect::<Vec<_>>()
        })
        .collect()
}

/// One tooth about the x axis and the gap after it, counter-clockwise.
fn tooth() -> Vec<DVec2> {
    let pressure = PRESSURE_ANGLE.to_radians();
    let base = PITCH_RADIUS * pressure.cos();
    let involute = |angle: f64| angle.tan() - angle;
    // Half the angle that the tooth takes up at a radius outside the base circle.
    let half = |radius: f64| {
        PI / (2.0 * TEETH as f64) + involute(pressure) - involute((base / radius).min(1.0).acos())
    };
    // Evenly spaced in the unrolled angle, which is denser where the involute bends.
    let tip_angle = (base / TIP_RADIUS).acos().tan();
    let flank: Vec<(f64, f64)> = (0..=FLANK)
        .map(|i| base * (1.0 + (tip_angle * i as f64 / FLANK as f64).powi(2)).sqrt())
        .map(|radius| (radius, half(radius)))
        .collect();
    let polar = |radius: f64, angle: f64| radius * DVec2::from_angle(angle);

    let mut points: Vec<DVec2> = flank.iter().map(|&(radius, angle)| polar(radius, -angle)).collect();
    points.push(DVec2::new(TIP_RADIUS, 0.0));
    points.extend(flank.iter().rev().map(|&(radius, angle)| polar(radius, angle)));
    // From the base circle down to the floor and up again: steep at the teeth, flat in the middle.
    let half_gap = PI / TEETH as f64 - half(base);
    for i in 1..FLOOR {
        let across = (FRAC_PI_2 * (2.0 * i as f64 / FLOOR as f64 - 1.0)).sin();
        let radius = ROOT_RADIUS + (base - ROOT_RADIUS) * across.powi(4);
        points.push(polar(radius, PI / TEETH as f64 + half_gap * across));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::shell::area;

    #[test]
    fn extents_are_the_papers_grid() {
        let (lower, upper) = mesh().bounds().unwrap();
        let extent = upper - lower;
        assert_eq!((lower.z, upper.z), (0.0, HUB_TOP));
        assert!((extent.x - 2.0 * TIP_RADIUS).abs() < 1e-9, "{extent}");
        assert!(extent.y > 97.0 && extent.y <= 98.0, "{extent}");
    }

    #[test]
    fn the_volume_is_the_sum_of_areas_times_heights() {
        let disc = |radius: f64| area(&circle(DVec2::ZERO, radius, CIRCLE));
        let holes: f64 = web_holes().iter().map(|l| area(l)).sum();
        let recesses = FACE_WIDTH - (WEB[1] - WEB[0]);
        let teeth =
            area(&gear_slice(0)) * FACE_WIDTH - disc(RIM_RADIUS) * recesses - holes * (WEB[1] - WEB[0]);
        let narrow = HUB_RADIUS - CHAMFER;
        let frustum = disc(1.0) / 3.0 * (HUB_RADIUS.powi(3) - narrow.powi(3));
        let hub = disc(HUB_RADIUS) * (HUB_TOP - (WEB[1] - WEB[0]) - 2.0 * CHAMFER) + 2.0 * frustum;
        let expected = teeth + hub - area(&bore(0)) * HUB_TOP;
        // A quadrilateral of a twisted wall is not flat; its diagonal cuts a little off or leaves a little on.
        let volume = mesh().signed_volume();
        assert!((volume - expected).abs() < 2e-3 * expected, "{volume} against {expected}");
    }

    #[test]
    fn teeth_are_where_a_gear_has_them() {
        let slice = gear_slice(SLICES / 2);
        assert!(slice.iter().all(|p| p.length() < TIP_RADIUS + 1e-9 && p.length() > ROOT_RADIUS - 1e-9));
        // On the pitch circle tooth and gap are equally wide: the tooth's flank crosses it at a quarter pitch.
        let base = PITCH_RADIUS * PRESSURE_ANGLE.to_radians().cos();
        let on_flank = tooth()[..=FLANK].iter().map(|p| (p.length(), -p.to_angle())).collect::<Vec<_>>();
        assert!((on_flank[0].0 - base).abs() < 1e-9);
        let after = on_flank.iter().position(|&(radius, _)| radius > PITCH_RADIUS).unwrap();
        let (a, b) = (on_flank[after - 1], on_flank[after]);
        let crossing = a.1 + (b.1 - a.1) * (PITCH_RADIUS - a.0) / (b.0 - a.0);
        assert!((crossing - FRAC_PI_2 / TEETH as f64).abs() < 2e-3, "{crossing}");
    }
}
