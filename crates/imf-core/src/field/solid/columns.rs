//! The obstacle as sums along z: how many voxels of a line are solid between two heights, in two reads.

use crate::occupancy::Occupancy;

/// Running sums of solid voxels along every line of constant x and y.
pub(super) struct Columns {
    /// Voxels along x, y, z.
    pub(super) dims: [usize; 3],
    /// `nz + 1` sums a line, lines C-ordered over `[x, y]`: entry k counts the solid voxels below k.
    sums: Vec<u32>,
    /// First and last y of a line that holds anything, for each x; first above last where none does.
    rows: Vec<(i64, i64)>,
}

impl Columns {
    pub(super) fn new(obstacle: &Occupancy) -> Self {
        let [nx, ny, nz] = obstacle.grid.dims;
        let mut sums = Vec::with_capacity(nx * ny * (nz + 1));
        let mut rows = vec![(i64::MAX, i64::MIN); nx];
        for (line, solid) in obstacle.solid.chunks(nz).enumerate() {
            let mut sum = 0;
            sums.push(sum);
            sums.extend(solid.iter().map(|&s| {
                sum += u32::from(s);
                sum
            }));
            if sum > 0 {
                let y = (line % ny) as i64;
                let row = &mut rows[line / ny];
                *row = (row.0.min(y), row.1.max(y));
            }
        }
        Self { dims: obstacle.grid.dims, sums, rows }
    }

    /// The sums of the lines of one x, from `y` on.
    #[inline(always)]
    pub(super) fn sums(&self, x: usize, y: usize) -> &[u32] {
        let [_, ny, nz] = self.dims;
        &self.sums[(x * ny + y) * (nz + 1)..]
    }

    /// First and last y at this x of a line that holds anything.
    #[inline(always)]
    pub(super) fn row(&self, x: usize) -> (i64, i64) {
        self.rows[x]
    }
}
