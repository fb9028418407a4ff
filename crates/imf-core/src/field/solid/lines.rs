//! The runs of voxel centres that one body holds, line by line along z: for voxels that change, which no sum is kept of.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::runs::Silhouette;
use super::segment::{LANES, PlacedSegment, VoxelPose};
use super::{Body, body_segments};
use crate::grid::Grid;
use crate::pose::Pose;
use crate::tool::{Element, snapped};

/// Who looks at the lines of a body.
pub(crate) trait LineVisitor {
    /// False where nothing is to be seen at any of the lines `y` of one x between two heights: they are passed over.
    #[inline(always)]
    fn may_hold(&self, _x: usize, _y: Range<usize>, _z: Range<usize>) -> bool {
        true
    }

    /// A line at x and y, and the voxels on it that the body holds; false ends the visit.
    fn line(&mut self, x: usize, y: usize, from: usize, to: usize) -> bool;
}

impl<F: FnMut(usize, usize, usize, usize) -> bool> LineVisitor for F {
    #[inline(always)]
    fn line(&mut self, x: usize, y: usize, from: usize, to: usize) -> bool {
        self(x, y, from, to)
    }
}

/// A body of revolution as runs on the lines of any grid of one pitch.
pub(crate) struct BodyLines {
    body: Body,
    pitch: f64,
    arch: Arch,
}

impl BodyLines {
    /// `None` for an outline with an arc around a centre beyond the axis, or with more than 64 segments.
    pub(crate) fn new(element: &Element, pitch: f64) -> Option<Self> {
        Some(Self { body: Body::new(element, pitch)?, pitch, arch: Arch::new() })
    }

    /// Visits every line of the grid that holds centres in the body at a pose, by the predicate that defines the tool. A line comes once
    /// for each segment of the outline that it meets, with other voxels each time. Nothing at an invalid pose.
    ///
    /// # Panics
    /// If the grid is of another pitch.
    pub(crate) fn visit(&self, grid: &Grid, pose: &Pose, visitor: &mut impl LineVisitor) {
        assert!(grid.pitch == self.pitch, "the grid's pitch is the body's");
        let Some(direction) = pose.axis() else { return };
        let placed = VoxelPose { tip: snapped(grid, pose.position), direction, pitch: self.pitch };
        for segment in body_segments(&self.body, placed) {
            if !self.arch.dispatch(Pass { segment: &segment, dims: grid.dims, visitor: &mut *visitor }) {
                return;
            }
        }
    }
}

struct Pass<'a, V> {
    segment: &'a PlacedSegment<'a>,
    dims: [usize; 3],
    visitor: &'a mut V,
}

impl<V: LineVisitor> WithSimd for Pass<'_, V> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { segment, dims, visitor } = self;
        let [nx, ny, nz] = dims.map(|n| n as i64);
        let tip = segment.placed.tip;
        let (x_low, x_high) = segment.columns();
        let silhouette = Silhouette::new(segment);
        // A quarter of a voxel off the last centres: an end that was cut off there is sure.
        let cut = (-0.25, nz as f64 - 0.25);
        for x in x_low.max(0)..=x_high.min(nx - 1) {
            let across = x as f64 - tip.x;
            let (low, high) = silhouette.row(across, tip.y);
            let (mut y, high) = (low.max(0), high.min(ny - 1));
            while y <= high {
                let lanes = ((high - y + 1) as usize).min(LANES);
                let first = y as usize;
                y += LANES as i64;
                let y_last = (first + lanes - 1) as f64 - tip.y;
                let (low, high) = segment.z_range(across, (first as f64 - tip.y, y_last));
                // A cast of what is below 0 gives 0.
                let (low, high) =
                    ((tip.z + low).ceil() as usize, (tip.z + high + 1.0).floor().max(0.0) as usize);
                let high = high.min(dims[2]);
                if low >= high || !visitor.may_hold(x as usize, first..first + lanes, low..high) {
                    continue;
                }
                let runs = segment.runs(simd, across, first as f64 - tip.y, cut);
                for lane in 0..lanes {
                    let (from, to) = if runs.doubt {
                        let (from, to) = segment.run(x, (first + lane) as i64, (0, nz - 1));
                        (from as i32, to as i32)
                    } else {
                        runs.run(lane)
                    };
                    if from < to && !visitor.line(x as usize, first + lane, from as usize, to as usize) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::section::test_shapes::{arc, line, orientations};
    use crate::tool::{ElementKind, SLACK, contains};

    #[test]
    fn lines_hold_the_centres_that_the_predicate_holds() {
        let bull = vec![arc(0.0, 1.0, 1.0, 2.5, 1.0), line(1.0, 6.0, 3.5, 3.5), line(6.0, 9.0, 3.5, 5.0)];
        let ball = vec![arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 9.0, 3.0, 3.0)];
        let bulge = vec![arc(1.0, 4.0, 2.5, 1.0, 2.0), line(4.0, 5.0, 2.5, 2.5)];
        let grid = Grid { origin: DVec3::new(-5.0, -4.0, -6.0), pitch: 0.5, dims: [23, 19, 27] };
        let mut all = orientations("random:25:4");
        all.extend(orientations("0,0;0,180;0,90;90,90;45,90"));
        for profile in [bull, ball, bulge] {
            let element = Element { kind: ElementKind::Cutter, profile };
            let lines = BodyLines::new(&element, grid.pitch).unwrap();
            for (index, orientation) in all.iter().enumerate() {
                let place = |step: f64| (index as f64 * step).fract() - 0.5;
                let aside = DVec3::new(place(0.618), place(0.755), place(0.57)) * 6.0;
                // On centres, on faces, and anywhere.
                for position in [aside, (aside * 2.0).round() / 2.0, (aside * 2.0).floor() / 2.0 + 0.25] {
                    let pose = Pose::oriented(position, orientation);
                    let mut found = vec![0; grid.len()];
                    lines.visit(&grid, &pose, &mut |x, y, from, to| {
                        (from..to).for_each(|z| found[grid.index([x, y, z])] += 1);
                        true
                    });
                    let tip = snapped(&grid, position);
                    for (voxel, &count) in found.iter().enumerate() {
                        let at = DVec3::from_array(grid.voxel(voxel).map(|v| v as f64));
                        let offset = (at - tip) * grid.pitch;
                        let slack = SLACK * grid.pitch * grid.pitch;
                        let expected = contains(&element.profile, pose.axis().unwrap(), offset, slack);
                        assert_eq!(count, u8::from(expected), "{pose:?} {at}");
                    }
                }
            }
        }
    }
}
