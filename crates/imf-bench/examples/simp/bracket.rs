//! The bracket as a problem: what is given, what pulls, what holds.
//!
//! The design domain is symmetric about two planes, and so is each load or its opposite: a quarter says everything. Its
//! lattice, 24×72×88 elements of 1.02×1.02×0.99 mm, halves three times.

use glam::DVec3;
use imf_core::parts::bracket::{
    BOLT_RADIUS, BOLTS, COUNTERBORE_FLOOR, COUNTERBORE_RADIUS, LUG, LUG_RADIUS, PIN, PIN_RADIUS, SEAT_HEIGHT,
    SEAT_RADIUS, SIZE,
};

use crate::lattice::Lattice;
use crate::optimiser::{Load, Material, Problem};

/// Elements of the quarter.
const QUARTER: [usize; 3] = [24, 72, 88];
/// Share of the design domain that is left.
pub(crate) const VOLUME: f64 = 0.15;
/// Millimetres: members become about twice as thick.
const RADIUS: f64 = 3.5;
/// Weights of a pull of the pin along x, y and z, all of the same force.
const WEIGHTS: [f64; 3] = [0.4, 0.7, 1.0];
/// How far from its bore the pin's force enters, in millimetres.
const PRESSED: f64 = 2.0;

/// Distance to a circle's line along an axis, in the plane of the two others; negative inside.
fn cylinder(p: [f64; 2], centre: [f64; 2], radius: f64) -> f64 {
    (p[0] - centre[0]).hypot(p[1] - centre[1]) - radius
}

/// The nearest bolt's axis.
fn bolt(p: DVec3) -> [f64; 2] {
    let nearest = |at: f64, choices: [f64; 2]| {
        if (at - choices[0]).abs() < (at - choices[1]).abs() { choices[0] } else { choices[1] }
    };
    [nearest(p.x, BOLTS[0]), nearest(p.y, BOLTS[1])]
}

/// Signed distance to the design domain, negative inside; exact near its faces.
pub(crate) fn domain(p: DVec3) -> f64 {
    let size = DVec3::from_array(SIZE);
    let outside = (p - size).max(-p).max_element();
    let from_bolt = |radius| -cylinder([p.x, p.y], bolt(p), radius);
    let above = from_bolt(COUNTERBORE_RADIUS).min(p.z - COUNTERBORE_FLOOR);
    let pin = -cylinder([p.y, p.z], PIN.to_array(), PIN_RADIUS);
    outside.max(from_bolt(BOLT_RADIUS)).max(above).max(pin)
}

/// Signed distance to what stays solid: seats under the bolts' heads, lugs around the pin.
pub(crate) fn fixed(p: DVec3) -> f64 {
    let seat = cylinder([p.x, p.y], bolt(p), SEAT_RADIUS).max(p.z - SEAT_HEIGHT);
    let lugs = cylinder([p.y, p.z], PIN.to_array(), LUG_RADIUS).max(p.x.min(SIZE[0] - p.x) - LUG);
    seat.min(lugs)
}

/// The problem at a resolution that is `coarser` times lower along each axis (1, 2, 4 or 8).
pub(crate) fn problem(coarser: usize) -> Problem {
    let lattice = Lattice { n: QUARTER.map(|n| n / coarser) };
    let [x, y, z] = QUARTER.map(|n| n as f64);
    let sides = [SIZE[0] / 2.0 / x, SIZE[1] / 2.0 / y, SIZE[2] / z].map(|side| side * coarser as f64);
    let at = |i: [f64; 3]| DVec3::new(i[0] * sides[0], i[1] * sides[1], i[2] * sides[2]);
    let [_, ny, nz] = lattice.n;
    let material = (0..lattice.elements()).map(|e| {
        let centre = at([e / (ny * nz), e / nz % ny, e % nz].map(|i| i as f64 + 0.5));
        if domain(centre) > 0.0 {
            Material::Void
        } else if fixed(centre) <= 0.0 {
            Material::Solid
        } else {
            Material::Free
        }
    });
    let material = material.collect();
    let loads = (0..3).map(|axis| load(lattice, axis, |node| at(node.map(|i| i as f64)))).collect();
    let mirrored = [true, true, false];
    Problem {
        lattice,
        sides,
        mirrored,
        material,
        loads,
        volume: VOLUME,
        radius: RADIUS.max(1.5 * sides[0]),
        tolerance: 1e-3,
    }
}

/// A pull of the whole pin by 1 along an axis, on the quarter.
fn load(lattice: Lattice, pulled: usize, at: impl Fn([usize; 3]) -> DVec3) -> Load {
    let mut held = vec![false; lattice.unknowns()];
    let mut force = vec![0.0; lattice.unknowns()];
    let mut whole = 0.0;
    for node in lattice.nodes() {
        let p = at(node);
        let seated = cylinder([p.x, p.y], bolt(p), COUNTERBORE_RADIUS) <= 0.0 && p.z <= COUNTERBORE_FLOOR;
        let planes = [node[0] == lattice.n[0], node[1] == lattice.n[1], false];
        for d in 0..3 {
            // On a plane of symmetry nothing leaves it; where the load is its own opposite there, nothing else moves.
            let by_plane = (0..2).any(|axis| planes[axis] && ((d == axis) != (pulled == axis)));
            held[lattice.unknown(node, d)] = seated || by_plane;
        }
        let from_pin = cylinder([p.y, p.z], PIN.to_array(), PIN_RADIUS);
        if p.x <= LUG && (0.0..=PRESSED).contains(&from_pin) {
            // Nodes on the plane belong to both halves.
            let share = if planes[1] { 0.5 } else { 1.0 };
            force[lattice.unknown(node, pulled)] = share;
            whole += share;
        }
    }
    force.iter_mut().for_each(|f| *f *= 0.25 / whole);
    Load { weight: WEIGHTS[pulled], held, force }
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::mesh::topology::MeshReport;

    use crate::optimiser::optimise;
    use crate::surface::surface;

    #[test]
    fn what_is_given_is_given_and_each_load_is_held() {
        let problem = problem(2);
        let count = |material| problem.material.iter().filter(|&&m| m == material).count() as f64;
        let element: f64 = problem.sides.iter().product();
        // Of the quarter: the holes' cylinders, to the lattice's roughness.
        let pi = std::f64::consts::PI;
        let holes = pi
            * (BOLT_RADIUS.powi(2) * COUNTERBORE_FLOOR
                + COUNTERBORE_RADIUS.powi(2) * (SIZE[2] - COUNTERBORE_FLOOR))
            + pi * PIN_RADIUS.powi(2) * SIZE[0] / 4.0;
        let void = count(Material::Void) * element;
        assert!((void / holes - 1.0).abs() < 0.05, "{void} against {holes}");
        assert!(count(Material::Solid) * element < VOLUME * 0.5 * count(Material::Free) * element);
        for (axis, load) in problem.loads.iter().enumerate() {
            let sum: f64 = load.force.iter().sum();
            assert!((sum - 0.25).abs() < 1e-12, "{axis}");
            assert!(
                load.force.iter().zip(&load.held).filter(|(f, _)| **f != 0.0).all(|(_, held)| !held),
                "{axis}"
            );
        }
    }

    #[test]
    fn a_coarse_bracket_is_whole_and_the_same_every_time() {
        let problem = problem(4);
        let run = || optimise(&problem, &[(3, 1.0), (9, 3.0)], None, |_| {}).unwrap();
        let [design, again] = [run(), run()];
        assert_eq!(design.density, again.density);
        assert!(design.compliance > design.solid_compliance);
        let mesh = surface(problem.lattice, &design.density).unwrap();
        let report = MeshReport::new(&mesh);
        assert!(report.closed && report.signed_volume > 0.0, "{report:?}");
        assert_eq!((report.components, report.degenerate_triangles), (1, 0));
        assert_eq!(report.extents.to_array(), SIZE);
    }
}
