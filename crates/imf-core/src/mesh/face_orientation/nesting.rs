//! Which shells lie in which.

use glam::DVec3;

use super::super::Mesh;
use super::super::crossings::CrossingIndex;
use super::super::solid_angle::winding_number;
use super::{NEAR, Patch};

/// Points of a shell that must lie in another for the whole to lie in it.
const SAMPLES: usize = 8;

/// For every patch whether it is closed, faces inwards or neither way, lies in no other closed one, and lies in the solid that the open
/// ones bound together, such as a shell with a gap.
pub(super) fn inside_open(
    mesh: &Mesh,
    triangles: &[Vec<usize>],
    parity: &[bool],
    (closed, around): (&[usize], &[Vec<usize>]),
    patches: &[Patch],
) -> Vec<bool> {
    let mut found = vec![false; patches.len()];
    let open: Vec<usize> =
        (0..patches.len()).filter(|&p| !patches[p].closed && !patches[p].one_sided).collect();
    let lower = open.iter().fold(DVec3::INFINITY, |lower, &p| lower.min(patches[p].lower));
    let upper = open.iter().fold(DVec3::NEG_INFINITY, |upper, &p| upper.max(patches[p].upper));
    let outer = || {
        let all =
            open.iter().flat_map(|&patch| triangles[patch].iter().map(move |&triangle| (patch, triangle)));
        all.map(|(patch, triangle)| {
            let [a, b, c] = mesh.corners(triangle);
            if parity[triangle] != patches[patch].flipped { [a, c, b] } else { [a, b, c] }
        })
    };
    let mut index = None;
    for (&shell, _) in closed.iter().zip(around).filter(|(_, around)| around.is_empty()) {
        let patch = &patches[shell];
        let asked = patch.signed_volume() < 0.0 || !patch.is_clear();
        if !asked || patch.lower.cmplt(lower).any() || patch.upper.cmpgt(upper).any() {
            continue;
        }
        let own = &triangles[shell];
        let middle = |&triangle: &usize| {
            let [p, q, r] = mesh.corners(triangle);
            (p + q + r) / 3.0
        };
        // Most lines miss a small gap. Where they do not say so the definition does, which is slow.
        let index = index.get_or_insert_with(|| CrossingIndex::new(outer()));
        let samples: Vec<DVec3> = own.iter().step_by(own.len().div_ceil(SAMPLES)).map(middle).collect();
        let under = samples.iter().filter(|&&sample| index.winding_number(sample) > 0).count();
        found[shell] = 4 * under >= 3 * samples.len() || winding_number(outer(), samples[0]) > 0.5;
    }
    found
}

/// For every closed patch those that it lies in, the outermost first.
pub(super) fn shells_around(
    mesh: &Mesh,
    triangles: &[Vec<usize>],
    parity: &[bool],
    closed: &[usize],
    patches: &[Patch],
) -> Vec<Vec<usize>> {
    let lies_in = |a: &Patch, b: &Patch| a.lower.cmpge(b.lower).all() && a.upper.cmple(b.upper).all();
    let mut around = vec![Vec::new(); closed.len()];
    for &outer in closed {
        // Made where it is asked: most shells have nothing in them.
        let mut index = None;
        for (place, &inner) in closed.iter().enumerate() {
            if outer == inner || !lies_in(&patches[inner], &patches[outer]) {
                continue;
            }
            let index = index.get_or_insert_with(|| {
                CrossingIndex::new(triangles[outer].iter().map(|&triangle| {
                    let [a, b, c] = mesh.corners(triangle);
                    if parity[triangle] { [a, c, b] } else { [a, b, c] }
                }))
            });
            let own = &triangles[inner];
            // A hair behind the inner one's own face, which may be flush with the outer one's.
            let behind = |triangle: usize| {
                let [p, q, r] = mesh.corners(triangle);
                let normal = (q - p).cross(r - p) * if parity[triangle] { -1.0 } else { 1.0 };
                let outward = normal.normalize_or_zero() * patches[inner].volume.signum();
                (p + q + r) / 3.0 - NEAR * normal.length().sqrt() * outward
            };
            let mut samples = own.iter().step_by(own.len().div_ceil(SAMPLES));
            let is_inside = samples.all(|&triangle| index.winding_number(behind(triangle)) != 0);
            if is_inside {
                around[place].push(outer);
            }
        }
    }
    for found in &mut around {
        found.sort_by(|&a, &b| patches[b].volume.abs().total_cmp(&patches[a].volume.abs()));
    }
    around
}
