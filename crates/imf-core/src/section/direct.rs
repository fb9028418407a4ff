//! The definition: overlaps counted voxel by voxel. Slow and obviously right.

use glam::DVec3;

use super::size::QueryBox;
use super::{SectionError, cuttable_and_noncutting};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Assembly, Element, ElementKind, Tool, ToolError, ToolVoxels, contains};

/// Voxels that are solid both in the obstacle and in the rotated tool with its tip on `voxel`, which may lie outside
/// the obstacle's grid (space there is empty).
#[must_use]
pub fn direct_count(obstacle: &Occupancy, tool: &ToolVoxels, voxel: [i64; 3]) -> u32 {
    tool.count_in(obstacle, voxel)
}

/// The collision measure at the centre of `voxel`: the minimum overlap over the sharp points, each the trilinear mean
/// of the eight direct sums around `x − R k`.
///
/// # Errors
/// A tool that holds no voxel centre, or is too large.
pub fn direct_cmf(
    obstacle: &Occupancy,
    tool: &Tool,
    orientation: &Orientation,
    voxel: [usize; 3],
) -> Result<f64, ToolError> {
    let rotated = ToolVoxels::new(tool, orientation, obstacle.grid.pitch)?;
    let sharp_points = tool.sharp_point_positions(obstacle.grid.pitch);
    let at = DVec3::from_array(voxel.map(|v| v as f64));
    Ok(minimum_mean(obstacle, &rotated, &sharp_points, orientation, at))
}

/// The minimum over sharp points of the trilinear means of direct sums around `x − R k`, over the rotated tool's own count.
/// `at`, x, counts in voxels from the centre of the obstacle's first one, and may lie outside its grid.
pub(crate) fn minimum_mean(
    forbidden: &Occupancy,
    rotated: &ToolVoxels,
    sharp_points: &[DVec3],
    orientation: &Orientation,
    at: DVec3,
) -> f64 {
    let (rotation, pitch) = (orientation.rotation(), forbidden.grid.pitch);
    let mut minimum = f64::INFINITY;
    for &sharp in sharp_points {
        let mut mean = 0.0;
        for (position, weight) in around(at - rotation * sharp / pitch) {
            mean += weight * f64::from(direct_count(forbidden, rotated, position));
        }
        minimum = minimum.min(mean / f64::from(rotated.count));
    }
    minimum
}

/// Points this close to a voxel's centre, in voxels, are at it: rounding of a rotation must not make a neighbour count.
const AT_CENTRE: f64 = 1e-9;

/// The voxels around a point (in voxels) that count, and the weights of their trilinear mean.
pub(crate) fn around(at: DVec3) -> impl Iterator<Item = ([i64; 3], f64)> {
    let nearest = at.round();
    let at = DVec3::select((at - nearest).abs().cmplt(DVec3::splat(AT_CENTRE)), nearest, at);
    let low = at.floor();
    let fraction = at - low;
    let corners = (0..8).map(move |corner: i64| {
        let bits = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let weight: f64 =
            (0..3).map(|axis| if bits[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] }).product();
        ([0, 1, 2].map(|axis| low[axis] as i64 + bits[axis]), weight)
    });
    corners.filter(|&(_, weight)| weight > 0.0)
}

/// The collision measure at the centre of `voxel` (of the obstacle's grid), element by element, from the tip upwards:
/// every solid voxel belongs to the element whose heights hold its centre in the tool frame, or, in the layer that the
/// cutter may enter, to that of shank and holder alone; each element's voxels over the whole tool's count, at the first
/// sharp point at which their sum (as an f32) is smallest. Empty for a mesh tool.
///
/// # Errors
/// A tool that holds no voxel centre, or is too large.
pub fn direct_element_measures(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    orientation: &Orientation,
    voxel: [usize; 3],
) -> Result<Vec<(ElementKind, f64)>, ToolError> {
    let (obstacle, assembly) = (obstacle.into(), assembly.into());
    element_measures(&obstacle, &assembly, assembly.whole(), orientation, voxel.map(|v| v as i64))
}

/// The same with the minimum over the sharp points of `tool`, at a voxel that may lie outside the obstacle's grid.
pub(super) fn element_measures(
    obstacle: &Obstacle,
    assembly: &Assembly,
    tool: &Tool,
    orientation: &Orientation,
    voxel: [i64; 3],
) -> Result<Vec<(ElementKind, f64)>, ToolError> {
    let (grid, layer) = (obstacle.grid(), cuttable_and_noncutting(obstacle, assembly));
    let normaliser = f64::from(ToolVoxels::new(tool, orientation, grid.pitch)?.count);
    let rest = layer.map(|(_, noncutting)| noncutting.elements()).unwrap_or_default();
    let whole = tool.elements();
    let kinds = kinds_of(whole.iter().chain(rest));
    let mut minimum = (f32::INFINITY, Vec::new());
    for sharp in tool.sharp_point_positions(grid.pitch) {
        let mut measures = vec![0.0; kinds.len()];
        let at = DVec3::from_array(voxel.map(|v| v as f64)) - orientation.rotation() * sharp / grid.pitch;
        for (tip, weight) in around(at) {
            for index in 0..grid.len() {
                let there = [0, 1, 2].map(|axis| (grid.voxel(index)[axis] as i64 - tip[axis]) as f64);
                let point = DVec3::from_array(there) * grid.pitch;
                let in_layer = layer.is_some_and(|(voxels, _)| voxels.solid[index] != 0);
                let elements = match (obstacle.forbidden.solid[index] != 0, in_layer) {
                    (true, _) => whole,
                    (false, true) => rest,
                    (false, false) => continue,
                };
                let holds = |e: &&Element| contains(&e.profile, orientation.direction(), point, grid.pitch);
                let owner = elements.iter().find(holds);
                if let Some(place) = owner.and_then(|owner| kinds.iter().position(|&k| k == owner.kind)) {
                    measures[place] += weight / normaliser;
                }
            }
        }
        let sum = measures.iter().sum::<f64>() as f32;
        if sum < minimum.0 {
            minimum = (sum, measures);
        }
    }
    Ok(kinds.into_iter().zip(minimum.1).collect())
}

/// Each element once, from the tip upwards.
pub(super) fn kinds_of<'a>(elements: impl Iterator<Item = &'a Element>) -> Vec<ElementKind> {
    let mut kinds: Vec<ElementKind> = elements.map(|e| e.kind).collect();
    kinds.sort_by_key(|kind| kind.order());
    kinds.dedup();
    kinds
}

/// A voxel of a query box and its count by a direct sum.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// Position in the box's C-ordered array.
    pub(super) index: usize,
    voxel: [i64; 3],
    expected: u32,
}

impl Spot {
    /// Compares what was counted there.
    pub(super) fn check(&self, found: u32) -> Result<(), SectionError> {
        let Self { voxel, expected, .. } = *self;
        if found == expected { Ok(()) } else { Err(SectionError::SpotCheck { voxel, found, expected }) }
    }
}

/// A few voxels of the query box, other ones for every orientation.
pub(super) fn spots(obstacle: &Occupancy, rotated: &ToolVoxels, query: &QueryBox) -> [Spot; 3] {
    let seed = u64::from(rotated.count).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ rotated.solid.len() as u64;
    [0u64, 1, 2].map(|spot| {
        let mixed = (seed ^ (spot << 17)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 20;
        let index = (mixed % query.len() as u64) as usize;
        let voxel = query.voxel(index);
        Spot { index, voxel, expected: direct_count(obstacle, rotated, voxel) }
    })
}

/// Compares a few voxels of the query box with direct sums.
pub(super) fn spot_check(
    obstacle: &Occupancy,
    rotated: &ToolVoxels,
    query: &QueryBox,
    counts: &[u32],
) -> Result<(), SectionError> {
    spots(obstacle, rotated, query).iter().try_for_each(|spot| spot.check(counts[spot.index]))
}
