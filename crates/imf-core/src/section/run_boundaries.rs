//! Boundaries of a rotated tool's runs of voxels along an axis.
//!
//! Seen along an axis the tool is a set of runs of voxels. One step of the tool along the axis uncovers the voxels at
//! the runs' beginnings and covers those just past their ends, so that the difference of two neighbouring overlaps is
//! a sum over run boundaries alone: a few thousand where the tool has tens of thousands of voxels.

use std::ops::Range;

use super::size::VoxelBox;

/// The axis along which a tool is stepped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    X,
    Y,
    Z,
}

impl Axis {
    pub(super) const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];
}

/// Values by the line along z that they stand on, sorted by its x, then its y.
#[derive(Clone, Default)]
pub(super) struct ByLine<T> {
    /// Offset of the first line from the tip's voxel along x and y.
    pub(super) lower: [i64; 2],
    /// Lines along x and y.
    pub(super) dims: [usize; 2],
    /// `[dims[0]·dims[1] + 1]`: where the values of each line begin.
    starts: Vec<u32>,
    values: Vec<T>,
}

impl<T> ByLine<T> {
    fn clear(&mut self, tool: &VoxelBox<'_>) {
        self.lower = [tool.lower[0], tool.lower[1]];
        // One more than the box: a run may end at its upper side.
        self.dims = [tool.dims[0] + 1, tool.dims[1] + 1];
        self.starts.clear();
        self.values.clear();
    }

    /// What follows stands on the next line.
    fn next(&mut self) {
        self.starts.push(self.values.len() as u32);
    }

    fn range(&self, x: usize, low: usize, high: usize) -> Range<usize> {
        let row = x * self.dims[1];
        self.starts[row + low] as usize..self.starts[row + high] as usize
    }

    /// Everything at offset x (counted from `lower`) with y in `low..high` (counted likewise).
    #[inline]
    pub(super) fn lines(&self, x: usize, low: usize, high: usize) -> &[T] {
        &self.values[self.range(x, low, high)]
    }
}

/// Offsets along z from the tip's voxel.
pub(super) type Offsets = ByLine<i32>;

impl Offsets {
    /// All offsets, in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = [i64; 3]> {
        let (lower, [planes, lines]) = (self.lower, self.dims);
        let line = move |x: usize, y: usize| {
            let at = [lower[0] + x as i64, lower[1] + y as i64];
            self.lines(x, y, y + 1).iter().map(move |&z| [at[0], at[1], i64::from(z)])
        };
        (0..planes).flat_map(move |x| (0..lines).flat_map(move |y| line(x, y)))
    }

    /// Where the offsets of each plane along x begin, and where those of the last one end.
    pub(super) fn plane_starts(&self) -> Vec<u32> {
        let ends = (0..self.dims[0]).map(|x| self.range(x, 0, self.dims[1]).end as u32);
        std::iter::once(0).chain(ends).collect()
    }

    /// The value of each offset into `values`.
    pub(super) fn map_into<T>(&self, values: &mut ByLine<T>, value: impl Fn([i64; 3]) -> T) {
        (values.lower, values.dims) = (self.lower, self.dims);
        values.starts.clone_from(&self.starts);
        values.values.clear();
        values.values.extend(self.iter().map(value));
    }
}

/// The run boundaries of a tool along one axis.
#[derive(Default)]
pub(super) struct RunBoundaries {
    /// Just past the runs' ends: what a step covers.
    pub(super) covered: Offsets,
    /// The runs' beginnings: what a step uncovers.
    pub(super) uncovered: Offsets,
}

impl RunBoundaries {
    /// Number of run boundaries along x, y and z.
    pub(super) fn count(tool: &VoxelBox<'_>) -> [usize; 3] {
        let [nx, ny, nz] = tool.dims;
        let empty = vec![0; nz];
        let line_at = |x, y| if x < nx && y < ny { tool.line(x, y) } else { &empty[..] };
        let mut ends = [0; 3];
        for x in 0..nx {
            for y in 0..ny {
                let line = tool.line(x, y);
                ends[0] += changes(line, line_at(x.wrapping_sub(1), y));
                ends[1] += changes(line, line_at(x, y.wrapping_sub(1)));
                if let Some((first, rest)) = line.split_first() {
                    ends[2] += usize::from(*first) + changes(rest, line) + usize::from(line[nz - 1]);
                }
                // The upper sides close what is still open.
                if x + 1 == nx {
                    ends[0] += changes(line, &empty);
                }
                if y + 1 == ny {
                    ends[1] += changes(line, &empty);
                }
            }
        }
        ends
    }

    pub(super) fn collect(&mut self, tool: &VoxelBox<'_>, axis: Axis) {
        let [nx, ny, nz] = tool.dims;
        self.covered.clear(tool);
        self.uncovered.clear(tool);
        // One voxel of nothing around the line, so that every run has both ends.
        let mut padded = vec![0; nz + 1];
        let empty = vec![0; nz];
        let line_at = |x, y| if x < nx && y < ny { tool.line(x, y) } else { &empty[..] };
        for x in 0..=nx {
            for y in 0..=ny {
                self.covered.next();
                self.uncovered.next();
                let line = line_at(x, y);
                match axis {
                    Axis::X if y < ny => {
                        self.compare(line, line_at(x.wrapping_sub(1), y), tool.lower[2]);
                    }
                    Axis::Y if x < nx => {
                        self.compare(line, line_at(x, y.wrapping_sub(1)), tool.lower[2]);
                    }
                    Axis::Z if x < nx && y < ny => {
                        self.compare(line, &empty[..0], tool.lower[2]);
                        padded[..nz].copy_from_slice(line);
                        self.compare(&padded[1..], line, tool.lower[2] + 1);
                    }
                    _ => {}
                }
            }
        }
        self.covered.next();
        self.uncovered.next();
    }

    /// Takes over where two neighbouring lines differ. Against a line of no voxels only the first voxel counts: it
    /// has no neighbour below.
    fn compare(&mut self, line: &[u8], below: &[u8], lower: i64) {
        const GROUP: usize = 16;
        if below.is_empty() {
            if line.first().is_some_and(|&solid| solid != 0) {
                self.uncovered.values.push(lower as i32);
            }
            return;
        }
        for (group, (here, there)) in line.chunks(GROUP).zip(below.chunks(GROUP)).enumerate() {
            if here == there {
                continue;
            }
            for (place, (&solid, &before)) in here.iter().zip(there).enumerate() {
                let offset = lower as i32 + (group * GROUP + place) as i32;
                match (before, solid) {
                    (0, 1) => self.uncovered.values.push(offset),
                    (1, 0) => self.covered.values.push(offset),
                    _ => {}
                }
            }
        }
    }
}

/// Number of places where two lines of zeros and ones differ.
fn changes(a: &[u8], b: &[u8]) -> usize {
    // Lines shorter than 255 groups keep each byte-wide sum in range.
    a.chunks(128)
        .zip(b.chunks(128))
        .map(|(a, b)| usize::from(a.iter().zip(b).map(|(a, b)| a ^ b).sum::<u8>()))
        .sum()
}
