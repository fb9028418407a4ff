//! The tool's voxels in one orientation, in the world grid with the tip on a voxel centre.

use std::ops::Range;

use glam::{DMat4, DVec3};

use super::extent::{Span, bounds, line_through_cylinder};
use super::profile::top;
use super::{Segment, Tool, ToolError, ToolShape};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::vectorised::vectorised;
use crate::voxelize::voxelize;

/// Which voxels a rotated tool holds, relative to the voxel its tip is on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ToolVoxels {
    /// Offset of the first voxel of the box from the tip's voxel.
    pub lower: [i32; 3],
    /// Voxels of the box along x, y, z.
    pub dims: [usize; 3],
    /// 1 where solid, C-ordered over the box.
    pub solid: Vec<u8>,
    /// Solid voxels: the normaliser of the collision measure in this orientation.
    pub count: u32,
}

/// Centres this close to the surface count as inside, in pitch²: rounding must not decide at exact ties.
pub(crate) const SLACK: f64 = 1e-9;

/// Centres are sampled with this offset in the tool's own frame, in pitches: those on a mesh's surface then fall to
/// the same side at every rotation despite rounding; on the face of the tip inside, as in a tool of revolution.
pub(crate) const ASIDE: DVec3 = DVec3::new(3.1e-7, 4.7e-7, 1e-6);

/// A mesh tool in an orientation, [`ASIDE`].
pub(super) fn turn(mesh: &Mesh, orientation: &Orientation, pitch: f64) -> Mesh {
    let aside = DMat4::from_translation(-ASIDE * pitch);
    mesh.transformed(&(DMat4::from_mat3(orientation.rotation()) * aside))
}

/// A rotated tool that holds more voxels than this, or whose box does where all of it is needed, is refused: it is a slip of units.
const MAX_VOXELS: u64 = 1 << 31;
/// So is one whose box has more lines along z.
const MAX_LINES: u64 = 1 << 26;

impl ToolVoxels {
    /// The tool turned by `orientation`, voxelised at `pitch` (in the tool's own unit).
    ///
    /// A voxel is solid where its centre is inside in the tool frame: `0 ≤ z + 1e-9·pitch < length` and
    /// `r² ≤ ρ(z)² + 1e-9·pitch²`; a mesh tool by its winding number, with centres on its surface on one side in every orientation.
    ///
    /// # Errors
    /// A tool that holds no voxel centre, or whose box is larger than can be indexed.
    pub fn new(tool: &Tool, orientation: &Orientation, pitch: f64) -> Result<Self, ToolError> {
        Self::within(tool, orientation, pitch, [i64::MIN; 3], [i64::MAX; 3])
    }

    /// The same without the voxels before the offset `first` and behind `last` along some axis, which are counted all the same. The box
    /// is empty where none is left.
    pub(crate) fn within(
        tool: &Tool,
        orientation: &Orientation,
        pitch: f64,
        first: [i64; 3],
        last: [i64; 3],
    ) -> Result<Self, ToolError> {
        let (lower, upper) = bounds(tool, orientation, pitch);
        let spans = (upper - lower + 1.0).to_array();
        let dims64 = spans.map(|s| s as u64);
        let too_large = || ToolError::TooLarge { name: tool.name.clone(), dims: dims64, pitch };
        if lower.abs().max(upper.abs()).max_element() > 1e9 {
            return Err(too_large());
        }
        let whole = Span { lower: lower.to_array().map(|v| v as i32), dims: dims64.map(|d| d as usize) };
        let kept = whole.within(first, last);
        let voxels = |span: Span| span.dims.iter().fold(1u64, |product, &d| product.saturating_mul(d as u64));
        let is_round = tool.mesh().is_none();
        if voxels(if is_round { kept } else { whole }) > MAX_VOXELS
            || is_round && dims64[0] * dims64[1] > MAX_LINES
            || tool.volume() / pitch.powi(3) > MAX_VOXELS as f64
        {
            return Err(too_large());
        }
        let mut rotated = Self { lower: kept.lower, dims: kept.dims, solid: Vec::new(), count: 0 };
        match &tool.shape {
            ToolShape::Revolved(_) => {
                let profile: Vec<Segment> = tool.segments().copied().collect();
                let direction = orientation.direction();
                rotated.solid = vec![0; kept.dims.iter().product()];
                vectorised!(pulp::Arch::new(), rotated.fill_revolved(whole, &profile, direction, pitch));
            }
            ToolShape::Mesh(mesh) => {
                let turned = turn(mesh, orientation, pitch);
                let grid = Grid { origin: (lower - 0.5) * pitch, pitch, dims: whole.dims };
                let all = voxelize(&turned, &grid, false);
                rotated.count = all.count() as u32;
                let origin = (DVec3::from_array(kept.lower.map(f64::from)) - 0.5) * pitch;
                // The grids' voxels coincide.
                rotated.solid = all.on(&Grid { origin, dims: kept.dims, ..grid }).unwrap_or(all).solid;
            }
        }
        if rotated.count == 0 {
            return Err(ToolError::TooSmall { name: tool.name.clone(), pitch });
        }
        rotated.crop();
        Ok(rotated)
    }

    /// Solid voxels of an obstacle that it holds with its tip on a voxel, which may lie outside the grid.
    #[must_use]
    pub fn count_in(&self, obstacle: &Occupancy, tip: [i64; 3]) -> u32 {
        let grid = &obstacle.grid;
        // Of the box's places those in the grid, and the grid's voxel of the first of them.
        let span = |axis: usize| {
            let first = tip[axis] + i64::from(self.lower[axis]);
            let most = self.dims[axis] as i64;
            let from = (-first).clamp(0, most);
            let to = (grid.dims[axis] as i64 - first).clamp(from, most);
            (from as usize..to as usize, (first + from) as usize)
        };
        let [(xs, x), (ys, y), (zs, z)] = [0, 1, 2].map(span);
        if [&xs, &ys, &zs].into_iter().any(Range::is_empty) {
            return 0;
        }
        let [_, ny, nz] = self.dims;
        let mut count = 0;
        for (i, own_x) in xs.enumerate() {
            for (j, own_y) in ys.clone().enumerate() {
                let own = &self.solid[(own_x * ny + own_y) * nz..][zs.clone()];
                let held = &obstacle.solid[grid.index([x + i, y + j, z])..][..own.len()];
                count += own.iter().zip(held).map(|(own, held)| u32::from(own & held)).sum::<u32>();
            }
        }
        count
    }

    /// Offsets of the solid voxels from the tip's.
    pub(crate) fn offsets(&self) -> impl Iterator<Item = [i64; 3]> {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: self.dims };
        let solid = (0..self.solid.len()).filter(|&i| self.solid[i] == 1);
        solid.map(move |i| grid.voxel(i)).map(|v| [0, 1, 2].map(|a| i64::from(self.lower[a]) + v[a] as i64))
    }

    /// Offset of the last voxel of the box from the tip's voxel.
    #[must_use]
    pub fn upper(&self) -> [i32; 3] {
        [0, 1, 2].map(|axis| self.lower[axis] + self.dims[axis] as i32 - 1)
    }

    /// Tests voxel centres, line by line along z, within the cylinder around the widest radius, and keeps those of its own box. The
    /// arithmetic is that of [`locate_inside`], operation by operation, so that both agree to the last bit; a whole line at a time.
    #[inline(always)]
    fn fill_revolved(&mut self, whole: Span, profile: &[Segment], direction: DVec3, pitch: f64) {
        let span = (profile.first().map_or(0.0, |s| s.range().0), top(profile));
        let widest = profile.iter().map(Segment::max_radius).fold(0.0, f64::max);
        let (above, slack) = (SLACK * pitch, SLACK * pitch * pitch);
        let [nx, ny, nz] = whole.dims;
        let zs: Vec<f64> = (0..nz).map(|iz| f64::from(whole.lower[2] + iz as i32) * pitch).collect();
        let mut heights = vec![0.0; nz];
        let mut squares = vec![0.0; nz];
        let mut inside = vec![0; nz];
        // The box's own voxels along z, and places of the whole in it.
        let start = [0, 1, 2].map(|axis| self.lower[axis].wrapping_sub(whole.lower[axis]) as usize);
        let kept = start[2]..start[2] + self.dims[2];
        for (ix, iy) in (0..nx).flat_map(|ix| (0..ny).map(move |iy| (ix, iy))) {
            let x = f64::from(whole.lower[0] + ix as i32) * pitch;
            let y = f64::from(whole.lower[1] + iy as i32) * pitch;
            let candidates = line_through_cylinder(x, y, direction, widest, span, pitch);
            let first = (candidates.0 - f64::from(whole.lower[2])).clamp(0.0, nz as f64) as usize;
            let last = (candidates.1 - f64::from(whole.lower[2]) + 1.0).clamp(0.0, nz as f64) as usize;
            if first >= last {
                continue;
            }
            let line = &mut inside[first..last];
            line.fill(0);
            let heights = &mut heights[..line.len()];
            let squares = &mut squares[..line.len()];
            let (flat, flat_square) = (x * direction.x + y * direction.y, x * x + y * y);
            for ((height, square), &z) in heights.iter_mut().zip(squares.iter_mut()).zip(&zs[first..last]) {
                *height = flat + z * direction.z;
                *square = (flat_square + z * z) - *height * *height;
            }
            let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
            for &height in heights.iter() {
                lowest = lowest.min(height + above);
                highest = highest.max(height + above);
            }
            // The segments' ranges meet without overlap: at most one of them holds a height.
            for segment in profile {
                let (from, to) = segment.range();
                if from > highest || to <= lowest {
                    continue;
                }
                for ((solid, &height), &square) in line.iter_mut().zip(heights.iter()).zip(squares.iter()) {
                    let radius = segment.radius(height);
                    let level = height + above;
                    let inside = (from <= level) & (level < to) & (square <= radius * radius + slack);
                    *solid |= u8::from(inside);
                }
            }
            self.count += line.iter().map(|&solid| u32::from(solid)).sum::<u32>();
            let (own_x, own_y) = (ix.wrapping_sub(start[0]), iy.wrapping_sub(start[1]));
            let (from, to) = (first.max(kept.start), last.min(kept.end));
            if own_x < self.dims[0] && own_y < self.dims[1] && from < to {
                let row = (own_x * self.dims[1] + own_y) * self.dims[2];
                self.solid[row + from - kept.start..][..to - from].copy_from_slice(&inside[from..to]);
            }
        }
    }

    /// Shrinks the box to its solid voxels, so that convolutions are no larger than they need be.
    fn crop(&mut self) {
        if !self.solid.contains(&1) {
            (self.dims, self.solid) = ([0; 3], Vec::new());
            return;
        }
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: self.dims };
        let whole = Occupancy { grid, solid: std::mem::take(&mut self.solid) };
        let Occupancy { grid, solid } = whole.cropped();
        self.lower = [0, 1, 2].map(|axis| self.lower[axis] + grid.origin[axis] as i32);
        (self.dims, self.solid) = (grid.dims, solid);
    }
}

/// True where the point `p`, relative to the tip and turned with the world, lies in a body of revolution among voxels of a pitch.
pub(crate) fn contains(profile: &[Segment], direction: DVec3, p: DVec3, pitch: f64) -> bool {
    locate_inside(profile, direction, p, pitch).is_some()
}

/// The predicate that defines the tool: height on the axis and squared distance from it of a point that a body of revolution holds. A
/// centre on an end, as many are in directions such as 45°, must not depend on how its direction was rounded.
#[inline]
pub(super) fn locate_inside(
    profile: &[Segment],
    direction: DVec3,
    p: DVec3,
    pitch: f64,
) -> Option<(f64, f64)> {
    let height = p.dot(direction);
    let level = height + SLACK * pitch;
    let segment = profile.iter().find(|s| s.range().0 <= level && level < s.range().1)?;
    let (radius, squared) = (segment.radius(height), p.length_squared() - height * height);
    (squared <= radius * radius + SLACK * pitch * pitch).then_some((height, squared))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{arc, line, orientations, revolved};
    use crate::tool::ElementKind;

    /// Every voxel of a generous box tested against the definition.
    fn definition(tool: &Tool, orientation: &Orientation, pitch: f64) -> Vec<[i64; 3]> {
        let d = orientation.direction();
        let reach = (tool.reach() / pitch).ceil() as i32 + 1;
        let mut inside = Vec::new();
        for x in -reach..=reach {
            for y in -reach..=reach {
                for z in -reach..=reach {
                    let p = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * pitch;
                    let height = p.dot(d);
                    let r2 = p.length_squared() - height * height;
                    let solid = tool.segments().any(|s| {
                        (s.range().0..s.range().1).contains(&(height + 1e-9 * pitch))
                            && r2 <= s.radius(height).powi(2) + 1e-9 * pitch * pitch
                    });
                    if solid {
                        inside.push([x, y, z].map(i64::from));
                    }
                }
            }
        }
        inside
    }

    #[test]
    fn rotated_tools_are_their_definition() {
        let paper = Tool::paper();
        // A bull nose under a cone that narrows upwards and a wide collar: several runs on a line.
        let profile = vec![
            arc(0.0, 4.0, 4.0, 6.0, 4.0),
            line(4.0, 20.0, 10.0, 3.0),
            Segment::cylinder(20.0, 31.0, 13.0),
        ];
        let waisted = revolved([(ElementKind::Cutter, profile)]);
        let mut set = orientations("random:12:3");
        set.extend(orientations("0,0;0,90;90,90;0,180;45,90;0,45"));
        for (tool, pitch) in [(&paper, 3.1), (&waisted, 1.0)] {
            for orientation in &set {
                let rotated = ToolVoxels::new(tool, orientation, pitch).unwrap();
                let expected = definition(tool, orientation, pitch);
                assert_eq!(rotated.offsets().collect::<Vec<_>>(), expected, "{orientation:?}");
                assert_eq!(rotated.count as usize, expected.len());
            }
        }
    }

    #[test]
    fn what_lies_beyond_a_box_is_counted_and_not_kept() {
        let leaning = Tool {
            shape: ToolShape::Mesh(Mesh::cuboid(DVec3::ZERO, DVec3::new(9.0, 5.0, 30.0))),
            ..Tool::paper()
        };
        let boxes = [([-4, -9, -20], [8, 3, 11]), ([-2, -2, 3], [90, 90, 90]), ([200; 3], [300; 3])];
        for (tool, pitch) in [(&Tool::paper(), 3.1), (&leaning, 1.0)] {
            for orientation in orientations("random:6:5") {
                let whole = ToolVoxels::new(tool, &orientation, pitch).unwrap();
                for (first, last) in boxes {
                    let part = ToolVoxels::within(tool, &orientation, pitch, first, last).unwrap();
                    let is_within = |v: &[i64; 3]| (0..3).all(|a| (first[a]..=last[a]).contains(&v[a]));
                    let expected: Vec<_> = whole.offsets().filter(is_within).collect();
                    assert_eq!((part.offsets().collect::<Vec<_>>(), part.count), (expected, whole.count));
                    assert!(part.solid.len() <= whole.solid.len());
                }
            }
        }
    }

    #[test]
    fn upright_the_papers_tool_is_29_by_29_by_83_voxels() {
        let rotated = ToolVoxels::new(&Tool::paper(), &Orientation::default(), 1.0).unwrap();
        assert_eq!(rotated.dims, [29, 29, 83]);
        assert_eq!(rotated.lower, [-14, -14, 0]);
        assert_eq!(rotated.upper(), [14, 14, 82]);
    }

    #[test]
    fn a_mesh_tool_turns_like_its_vertices() {
        // A box 4 × 2 × 6 off the axis.
        let mesh = Mesh::cuboid(DVec3::new(0.6, -1.1, 0.3), DVec3::new(4.6, 0.9, 6.3));
        assert!((mesh.signed_volume() - 48.0).abs() < 1e-9);
        let tool = Tool { shape: ToolShape::Mesh(mesh), ..Tool::paper() };
        let upright = ToolVoxels::new(&tool, &Orientation::default(), 1.0).unwrap();
        assert_eq!((upright.dims, upright.lower), ([4, 2, 6], [1, -1, 1]));
        let turned = ToolVoxels::new(&tool, &Orientation { theta: 0.0, phi: 90.0, roll: 0.0 }, 1.0).unwrap();
        // R_y(90°): x → −z, z → x.
        assert_eq!((turned.dims, turned.lower), ([6, 2, 4], [1, -1, -4]));
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let made = |tool: &Tool, pitch: f64| ToolVoxels::new(tool, &Orientation::default(), pitch);
        assert!(matches!(made(&Tool::paper(), 1e-3), Err(ToolError::TooLarge { .. })));
        let needle = revolved([(ElementKind::Cutter, vec![Segment::cylinder(0.5, 0.9, 0.1)])]);
        assert!(matches!(made(&needle, 1.0), Err(ToolError::TooSmall { .. })));
    }
}
