//! The runs of voxel centres that one body holds, line by line along z: for voxels that change, of which there are no
//! running sums.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::Body;
use super::runs::Silhouette;
use super::segment::{LANES, PlacedSegment, Runs, VoxelPose, whole_of};
use crate::grid::Grid;
use crate::pose::Pose;
use crate::tool::{Element, snapped};

/// Visits the lines of a body.
pub(crate) trait LineVisitor {
    /// False where none of the lines `y` of one x between two heights matters: they are skipped.
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
        self.visit_all(grid, std::slice::from_ref(pose), visitor);
    }

    /// The same with what the body holds at any of several poses, which should be close to each other: what a line holds at poses that
    /// follow one another is joined, but a voxel may come more than once.
    ///
    /// # Panics
    /// If the grid is of another pitch.
    pub(crate) fn visit_all(&self, grid: &Grid, poses: &[Pose], visitor: &mut impl LineVisitor) {
        assert!(grid.pitch == self.pitch, "the grid's pitch is the body's");
        let placed = poses.iter().filter_map(|pose| {
            let direction = pose.axis()?;
            Some(VoxelPose { tip: snapped(grid, pose.position), direction, pitch: self.pitch })
        });
        let placed: Vec<_> = placed.collect();
        let mut segments = Vec::with_capacity(placed.len());
        for (world, part) in self.body.profile.iter().zip(&self.body.parts) {
            segments.clear();
            segments.extend(placed.iter().map(|&placed| {
                let segment = part.placed(world, placed);
                (Silhouette::new(&segment), segment.columns(), segment)
            }));
            if !self.arch.dispatch(Pass { segments: &segments, dims: grid.dims, visitor: &mut *visitor }) {
                return;
            }
        }
    }
}

struct Pass<'a, V> {
    segments: &'a [(Silhouette, (i64, i64), PlacedSegment<'a>)],
    dims: [usize; 3],
    visitor: &'a mut V,
}

/// A segment on the lines of one x: how far they are from its tip, and the first and last y that may meet it.
struct Row<'a> {
    segment: &'a PlacedSegment<'a>,
    across: f64,
    low: i64,
    high: i64,
}

impl<V: LineVisitor> WithSimd for Pass<'_, V> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { segments, dims, visitor } = self;
        let [nx, ny, nz] = dims.map(|n| n as i64);
        let x_low = segments.iter().map(|(_, columns, _)| columns.0).min().unwrap_or(0);
        let x_high = segments.iter().map(|(_, columns, _)| columns.1).max().unwrap_or(-1);
        // A quarter of a voxel off the last centres: an end that was cut off there is sure.
        let cut = (-0.25, nz as f64 - 0.25);
        let mut rows = Vec::with_capacity(segments.len());
        for x in x_low.max(0)..=x_high.min(nx - 1) {
            rows.clear();
            for (silhouette, columns, segment) in segments {
                if (columns.0..=columns.1).contains(&x) {
                    let across = x as f64 - segment.placed.tip.x;
                    let (low, high) = silhouette.row(across, segment.placed.tip.y);
                    let (low, high) = (low.max(0), high.min(ny - 1));
                    if low <= high {
                        rows.push(Row { segment, across, low, high });
                    }
                }
            }
            let mut y = rows.iter().map(|row| row.low).min().unwrap_or(0);
            let y_high = rows.iter().map(|row| row.high).max().unwrap_or(-1);
            while y <= y_high {
                let first = y;
                let lanes = ((y_high - y + 1) as usize).min(LANES);
                y += LANES as i64;
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                let meets = |row: &&Row<'_>| row.low < first + LANES as i64 && row.high >= first;
                for Row { segment, across, .. } in rows.iter().filter(meets) {
                    let from_tip = first as f64 - segment.placed.tip.y;
                    let range = segment.z_range(*across, (from_tip, from_tip + (lanes - 1) as f64));
                    if range.0 <= range.1 {
                        low = low.min(segment.placed.tip.z + range.0);
                        high = high.max(segment.placed.tip.z + range.1);
                    }
                }
                // A cast of what is below 0 gives 0.
                let (low, high) = (low.ceil() as usize, (high + 1.0).floor().max(0.0) as usize);
                let high = high.min(dims[2]);
                let line = first as usize;
                if low >= high || !visitor.may_hold(x as usize, line..line + lanes, low..high) {
                    continue;
                }
                let mut joined = RunUnion::NOTHING;
                for Row { segment, across, .. } in rows.iter().filter(meets) {
                    let mut runs = segment.runs(simd, *across, first as f64 - segment.placed.tip.y, cut);
                    if runs.doubt {
                        runs.settle(|lane| segment.run(x, first + lane as i64, (0, nz - 1)));
                    }
                    if !joined.add(&runs) {
                        if !joined.show(x as usize, line, lanes, visitor) {
                            return false;
                        }
                        joined = RunUnion::NOTHING;
                        joined.add(&runs);
                    }
                }
                if !joined.show(x as usize, line, lanes, visitor) {
                    return false;
                }
            }
        }
        true
    }
}

/// One run on each of eight lines, as [`Runs`] has it; from infinity to minus infinity where there is none.
struct RunUnion {
    from: [f64; LANES],
    to: [f64; LANES],
}

impl RunUnion {
    const NOTHING: Self = Self { from: [f64::INFINITY; LANES], to: [f64::NEG_INFINITY; LANES] };

    /// False, and nothing is added, where a gap lies between a line's runs.
    #[inline(always)]
    fn add(&mut self, Runs { from, to, .. }: &Runs) -> bool {
        let (mut next, mut apart) = (Self::NOTHING, false);
        for lane in 0..LANES {
            let empty = from[lane] >= to[lane];
            let begins = if empty { f64::INFINITY } else { from[lane] };
            let ends = if empty { f64::NEG_INFINITY } else { to[lane] };
            let gap = (begins > self.to[lane]) | (ends < self.from[lane]);
            apart |= gap & !empty & (self.from[lane] < f64::INFINITY);
            next.from[lane] = if begins < self.from[lane] { begins } else { self.from[lane] };
            next.to[lane] = if ends > self.to[lane] { ends } else { self.to[lane] };
        }
        if !apart {
            *self = next;
        }
        !apart
    }

    /// Shows the runs on the first `lanes` lines; false where the visitor ends the visit.
    #[inline(always)]
    fn show(&self, x: usize, y: usize, lanes: usize, visitor: &mut impl LineVisitor) -> bool {
        (0..lanes).filter(|&lane| self.from[lane] < self.to[lane]).all(|lane| {
            visitor.line(x, y + lane, whole_of(self.from[lane]) as usize, whole_of(self.to[lane]) as usize)
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::section::test_shapes::{arc, line, orientations};
    use crate::tool::{ElementKind, contains};

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
                        let expected = contains(&element.profile, pose.axis().unwrap(), offset, grid.pitch);
                        assert_eq!(count, u8::from(expected), "{pose:?} {at}");
                    }
                }
            }
        }
    }

    #[test]
    fn lines_of_several_poses_hold_what_each_of_them_holds() {
        let profile = vec![arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 9.0, 3.0, 4.0)];
        let grid = Grid { origin: DVec3::new(-5.0, -4.0, -6.0), pitch: 0.5, dims: [23, 19, 27] };
        let lines = BodyLines::new(&Element { kind: ElementKind::Cutter, profile }, grid.pitch).unwrap();
        // Side by side, apart along a line, and far apart; one of them nowhere.
        for step in [DVec3::new(0.2, 0.1, 0.05), DVec3::new(0.1, 0.0, 11.0), DVec3::new(4.0, -3.0, 2.0)] {
            for orientation in orientations("random:12:7") {
                let place = |index: i32| DVec3::new(-3.1, 1.3, -4.0) + step * f64::from(index);
                let mut poses: Vec<Pose> =
                    (0..5).map(|index| Pose::oriented(place(index), &orientation)).collect();
                poses.push(Pose { position: DVec3::NAN, ..poses[0] });
                let held = |poses: &[Pose]| {
                    let mut held = vec![0; grid.len()];
                    lines.visit_all(&grid, poses, &mut |x, y, from, to| {
                        (from..to).for_each(|z| held[grid.index([x, y, z])] = 1);
                        true
                    });
                    held
                };
                let mut each = vec![0; grid.len()];
                for pose in &poses {
                    each.iter_mut().zip(held(std::slice::from_ref(pose))).for_each(|(all, one)| *all |= one);
                }
                assert_eq!(held(&poses), each, "{step} {orientation:?}");
            }
        }
    }
}
