//! From counted overlaps to values: fractions of the tool, and the minimum over its sharp points by trilinear means.
//!
//! Boxes of sharp points that can lower no value of a line are skipped as a whole, and then single points.

use std::ops::Range;

use glam::DVec3;

use super::{SectionPlan, direct};
use crate::orientation::Orientation;

impl SectionPlan {
    /// The collision measure at every voxel of the grid, from counts over the query box.
    pub(super) fn read_values(
        &self,
        orientation: &Orientation,
        normaliser: u32,
        (counts, around): (&[u32], &mut LowestAround),
        cmf: &mut [f32],
    ) {
        assert_eq!(cmf.len(), self.grid.len(), "one value for each voxel of the grid");
        if self.tip_alone() {
            for (value, &count) in cmf.iter_mut().zip(counts) {
                *value = overlap_fraction(count, normaliser);
            }
            return;
        }
        let reading = SharpPointReader::new(self, orientation, normaliser, (counts, around));
        let mut line = Line::default();
        cmf.fill(f32::INFINITY);
        for (range, at) in self.lines() {
            reading.lower(at, &mut cmf[range], None, &mut line);
        }
    }

    /// The voxels around `x − R sharp` from the voxel `x` of the grid, and the weights of their trilinear mean over the
    /// normaliser.
    fn corners(&self, orientation: &Orientation, sharp: DVec3, normaliser: u32) -> Vec<([i64; 3], f64)> {
        let shift = -(orientation.rotation() * sharp / self.obstacle.grid().pitch);
        // Corners of weight zero are not read: a whole shift reads one voxel.
        let corners = direct::around(shift + DVec3::from_array(self.offset.map(|v| v as f64)));
        corners.map(|(corner, weight)| (corner, weight / f64::from(normaliser))).collect()
    }

    /// Every line along z of the grid: where it stands in an array over the grid, and its x and y.
    pub(super) fn lines(&self) -> impl Iterator<Item = (Range<usize>, [i64; 2])> {
        let [nx, ny, nz] = self.grid.dims;
        let line = move |x: usize, y: usize| ((x * ny + y) * nz..(x * ny + y + 1) * nz, [x as i64, y as i64]);
        (0..nx).flat_map(move |x| (0..ny).map(move |y| line(x, y)))
    }

    /// Where in the query box the reading of a line begins.
    pub(super) fn starts(
        &self,
        corners: &[([i64; 3], f64)],
        [x, y]: [i64; 2],
        starts: &mut Vec<(usize, f64)>,
    ) {
        starts.clear();
        let corners = corners.iter();
        starts.extend(corners.map(|&([dx, dy, dz], w)| (self.query.index([x + dx, y + dy, dz]), w)));
    }
}

/// The weighted mean of counts at the `z`-th voxel of a line.
#[inline(always)]
pub(super) fn mean(counts: &[u32], starts: &[(usize, f64)], z: usize) -> f32 {
    let mean: f64 = starts.iter().map(|&(from, weight)| weight * f64::from(counts[from + z])).sum();
    (mean as f32).clamp(0.0, 1.0)
}

/// The collision measure of `count` common voxels of a tool that has `normaliser`, rounded as every section is.
#[inline]
#[must_use]
pub fn overlap_fraction(count: u32, normaliser: u32) -> f32 {
    ((1.0 / f64::from(normaliser)) * f64::from(count)).min(1.0) as f32
}

/// Voxels along the edge of a box of sharp points, and of the smaller ones in it: with the corners of its points' means a box
/// spans 8 voxels, a smaller one 4, a point's own 2.
const BOX: [i64; 2] = [7, 3];

/// By powers of two, the minimum count of a voxel and those after it along each axis: 2, 4 and 8 in all. A mean whose
/// corners lie among them is no lower.
#[derive(Default)]
pub(super) struct LowestAround([Vec<u32>; 3]);

impl LowestAround {
    fn fill(&mut self, counts: &[u32], [_, ny, nz]: [usize; 3]) {
        for level in 0..3 {
            let (made, rest) = self.0.split_at_mut(level);
            let (lowest, step) = (&mut rest[0], 1 << level);
            lowest.clear();
            lowest.extend_from_slice(made.last().map_or(counts, Vec::as_slice));
            for line in lowest.chunks_exact_mut(nz.max(1)) {
                lower_to_next(line, step);
            }
            for slab in lowest.chunks_exact_mut((ny * nz).max(1)) {
                lower_to_next(slab, step * nz);
            }
            lower_to_next(lowest, step * ny * nz);
        }
    }
}

/// Every element's minimum with the one `step` after it.
fn lower_to_next(values: &mut [u32], step: usize) {
    for next in step..values.len() {
        values[next - step] = values[next - step].min(values[next]);
    }
}

/// Points, or boxes of them, side by side.
struct PointBox {
    /// No voxel of theirs lies before it, from the voxel of the grid that is read.
    lowest: [i64; 3],
    contains: Range<usize>,
}

/// Working memory of a line.
#[derive(Default)]
pub(super) struct Line {
    starts: Vec<(usize, f64)>,
    /// By voxel: no count from here on changes its value.
    limits: Vec<u32>,
    /// The boxes, first those that lowered values last.
    order: Vec<usize>,
}

/// Counts of an orientation, read at sharp points off the tip.
pub(super) struct SharpPointReader<'a> {
    plan: &'a SectionPlan,
    counts: &'a [u32],
    normaliser: u32,
    /// By sharp point.
    pub(super) corners: Vec<Vec<([i64; 3], f64)>>,
    around: &'a LowestAround,
    /// Of smaller boxes.
    boxes: Vec<PointBox>,
    /// Of points.
    smaller: Vec<PointBox>,
    points: Vec<usize>,
}

impl<'a> SharpPointReader<'a> {
    pub(super) fn new(
        plan: &'a SectionPlan,
        orientation: &Orientation,
        normaliser: u32,
        (counts, around): (&'a [u32], &'a mut LowestAround),
    ) -> Self {
        let corners = plan.sharp_points.iter().map(|&sharp| plan.corners(orientation, sharp, normaliser));
        let corners: Vec<Vec<([i64; 3], f64)>> = corners.collect();
        around.fill(counts, plan.query.dims);
        let place = |point: usize| {
            let at = corners[point][0].0;
            let coarse = at.map(|v| v.div_euclid(BOX[0]));
            (coarse, at.map(|v| v.rem_euclid(BOX[0]) / BOX[1]))
        };
        let mut points: Vec<usize> = (0..corners.len()).collect();
        points.sort_by_key(|&point| place(point));
        let (mut boxes, mut smaller) = (Vec::<PointBox>::new(), Vec::<PointBox>::new());
        for (index, &point) in points.iter().enumerate() {
            let at = corners[point][0].0;
            let before = index.checked_sub(1).map(|before| place(points[before]));
            if before != Some(place(point)) {
                if before.map(|(coarse, _)| coarse) != Some(place(point).0) {
                    boxes.push(PointBox { lowest: at, contains: smaller.len()..smaller.len() });
                }
                smaller.push(PointBox { lowest: at, contains: index..index });
                boxes.last_mut().into_iter().for_each(|last| last.contains.end += 1);
            }
            smaller.last_mut().into_iter().for_each(|last| last.contains.end += 1);
            for last in [boxes.last_mut(), smaller.last_mut()].into_iter().flatten() {
                last.lowest = [0, 1, 2].map(|axis| last.lowest[axis].min(at[axis]));
            }
        }
        Self { plan, counts, normaliser, corners, around, boxes, smaller, points }
    }

    /// Lowers the values of a line to the minimum over the sharp points. Where it is given, `first` gets for each
    /// lowered value other than 0 the first point that attains it.
    pub(super) fn lower(
        &self,
        at: [i64; 2],
        values: &mut [f32],
        mut first: Option<&mut [u32]>,
        line: &mut Line,
    ) {
        let Line { starts, limits, order } = line;
        let ties = first.is_some();
        limits.clear();
        limits.extend(values.iter().map(|&value| self.limit(value, ties)));
        if order.len() != self.boxes.len() {
            order.clear();
            order.extend(0..self.boxes.len());
        }
        for place in 0..order.len() {
            let PointBox { lowest, contains } = &self.boxes[order[place]];
            if !self.may_lower(2, at, *lowest, limits) {
                continue;
            }
            let mut lowered = false;
            for PointBox { lowest, contains } in &self.smaller[contains.clone()] {
                if !self.may_lower(1, at, *lowest, limits) {
                    continue;
                }
                for &point in &self.points[contains.clone()] {
                    // The first corner is the lowest one: its weight is never 0.
                    if self.may_lower(0, at, self.corners[point][0].0, limits) {
                        let first = first.as_deref_mut();
                        lowered |= self.lower_by(point, at, values, first, (starts, limits));
                    }
                }
            }
            if lowered {
                order[..=place].rotate_right(1);
                if limits.iter().all(|&limit| limit == 0) {
                    return;
                }
            }
        }
    }

    /// No count from here on lowers the value or, with `ties`, is as low, whatever the rounding.
    #[inline]
    fn limit(&self, value: f32, ties: bool) -> u32 {
        let counts = f64::from(value) * f64::from(self.normaliser);
        if ties && value > 0.0 {
            // Means this close above are rounded to the value.
            return ((counts * (1.0 + f64::from(f32::EPSILON))).floor() as u32).saturating_add(1);
        }
        (counts * (1.0 + 1e-9)).ceil() as u32
    }

    /// True where some count of the level's box behind a line's voxels is below their limits.
    #[inline]
    fn may_lower(&self, level: usize, [x, y]: [i64; 2], [dx, dy, dz]: [i64; 3], limits: &[u32]) -> bool {
        let from = self.plan.query.index([x + dx, y + dy, dz]);
        let lowest = &self.around.0[level][from..from + limits.len()];
        lowest.iter().zip(limits).fold(false, |any, (low, limit)| any | (low < limit))
    }

    /// The same for one point; true where it lowers a value.
    fn lower_by(
        &self,
        point: usize,
        at: [i64; 2],
        values: &mut [f32],
        mut first: Option<&mut [u32]>,
        (starts, limits): (&mut Vec<(usize, f64)>, &mut [u32]),
    ) -> bool {
        self.plan.starts(&self.corners[point], at, starts);
        let [dx, dy, dz] = self.corners[point][0].0;
        let from = self.plan.query.index([at[0] + dx, at[1] + dy, dz]);
        let lowest = &self.around.0[0][from..from + values.len()];
        let mut any = false;
        for (z, (value, limit)) in values.iter_mut().zip(limits).enumerate() {
            if lowest[z] >= *limit {
                continue;
            }
            let overlap = mean(self.counts, starts, z);
            if overlap < *value {
                any = true;
                (*value, *limit) = (overlap, self.limit(overlap, first.is_some()));
                if let Some(first) = first.as_deref_mut() {
                    first[z] = point as u32;
                }
            } else if let Some(first) = first.as_deref_mut()
                && overlap == *value
            {
                first[z] = first[z].min(point as u32);
            }
        }
        any
    }
}
