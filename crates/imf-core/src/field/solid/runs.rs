//! Counting by runs: the tool's exact run on every line of voxels, summed or read from the obstacle's running sums along
//! z, which give in two reads how many voxels of a line are solid between two heights.

use pulp::{Arch, Simd, WithSimd};

use super::segment::{LANES, PlacedSegment};
use crate::occupancy::Occupancy;

/// Running sums of solid voxels along every line of constant x and y.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Columns {
    /// Voxels along x, y, z.
    dims: [usize; 3],
    /// `nz + 1` sums a line, lines C-ordered over `[x, y]`: entry k counts the solid voxels below k.
    sums: Vec<u32>,
    /// First and last y of a line that holds anything, for each x; first above last where none does.
    rows: Vec<(i64, i64)>,
}

impl Columns {
    pub(super) fn new(obstacle: &Occupancy) -> Self {
        let dims @ [nx, ny, nz] = obstacle.grid.dims;
        let mut columns = Self { dims, sums: vec![0; nx * ny * (nz + 1)], rows: vec![(0, 0); nx] };
        (0..nx * ny).for_each(|line| columns.sum_line(obstacle, line));
        (0..nx).for_each(|x| columns.find_row(x));
        columns
    }

    /// Follows an obstacle of which these voxels have just become solid or empty.
    pub(super) fn change(&mut self, obstacle: &Occupancy, changed: &[usize]) {
        let [_, ny, nz] = self.dims;
        let mut lines: Vec<usize> = changed.iter().map(|index| index / nz).collect();
        lines.sort_unstable();
        lines.dedup();
        lines.iter().for_each(|&line| self.sum_line(obstacle, line));
        let mut all: Vec<usize> = lines.iter().map(|line| line / ny).collect();
        all.dedup();
        all.into_iter().for_each(|x| self.find_row(x));
    }

    fn sum_line(&mut self, obstacle: &Occupancy, line: usize) {
        let [_, _, nz] = self.dims;
        let mut sum = 0;
        let sums = &mut self.sums[line * (nz + 1) + 1..][..nz];
        for (below, &solid) in sums.iter_mut().zip(&obstacle.solid[line * nz..][..nz]) {
            sum += u32::from(solid);
            *below = sum;
        }
    }

    fn find_row(&mut self, x: usize) {
        let [_, ny, nz] = self.dims;
        let holds = |&y: &usize| self.sums[(x * ny + y) * (nz + 1) + nz] > 0;
        let [first, last] = [(0..ny).find(holds), (0..ny).rfind(holds)];
        self.rows[x] =
            first.zip(last).map_or((i64::MAX, i64::MIN), |(first, last)| (first as i64, last as i64));
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

/// Lines at these x and y, in voxels, ends included; `from > to` in x where there are none.
#[derive(Clone, Copy)]
pub(super) struct Lines {
    pub(super) x: (f32, f32),
    pub(super) y: (f32, f32),
}

impl Lines {
    pub(super) const ALL: Self = Self { x: (-1e9, 1e9), y: (-1e9, 1e9) };

    pub(super) fn is_empty(&self) -> bool {
        self.x.0 > self.x.1
    }

    /// Those of both, and what lies between.
    pub(super) fn join(self, other: Self) -> Self {
        let join = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
        Self { x: join(self.x, other.x), y: join(self.y, other.y) }
    }
}

#[derive(Clone, Copy)]
pub(super) enum Within<'a> {
    /// Solid voxels of an obstacle, on some of its lines.
    Obstacle(&'a Columns, Lines),
    /// All voxels, at most this far from the origin along each axis.
    Everything(i64),
}

/// Voxel centres within a segment. With `stop` the count may end at the first line that holds any.
pub(super) fn count(arch: Arch, segment: &PlacedSegment<'_>, within: Within<'_>, stop: bool) -> u32 {
    struct Pass<'a>(&'a PlacedSegment<'a>, Within<'a>, bool);
    impl WithSimd for Pass<'_> {
        type Output = u32;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> u32 {
            match self.1 {
                Within::Obstacle(columns, lines) => {
                    count_lines::<S, true>(simd, self.0, Some((columns, lines)), 0, self.2)
                }
                Within::Everything(most) => count_lines::<S, false>(simd, self.0, None, most, self.2),
            }
        }
    }
    arch.dispatch(Pass(segment, within, stop))
}

#[inline(always)]
fn count_lines<S: Simd, const OBSTACLE: bool>(
    simd: S,
    segment: &PlacedSegment<'_>,
    obstacle: Option<(&Columns, Lines)>,
    most: i64,
    stop: bool,
) -> u32 {
    let tip = segment.placed.tip;
    let (mut x_low, mut x_high) = segment.columns();
    let mut z_bounds = (-most, most);
    let (mut y_least, mut y_most) = (i64::MIN, i64::MAX);
    let columns = obstacle.map(|(columns, _)| columns);
    if let Some((columns, lines)) = obstacle {
        x_low = x_low.max(0).max(lines.x.0.ceil() as i64);
        x_high = x_high.min(columns.dims[0] as i64 - 1).min(lines.x.1.floor() as i64);
        (y_least, y_most) = (lines.y.0.ceil() as i64, lines.y.1.floor() as i64);
        z_bounds = (0, columns.dims[2] as i64 - 1);
    }
    let silhouette = Silhouette::new(segment);
    // A quarter of a voxel off the last centres: an end that was cut off there is sure.
    let cut = (z_bounds.0 as f64 - 0.25, z_bounds.1 as f64 + 0.75);
    let mut total = 0;
    for x in x_low..=x_high {
        let across = x as f64 - tip.x;
        let (mut y, mut y_high) = silhouette.row(across, tip.y);
        if let Some(columns) = columns {
            let (first, last) = columns.row(x as usize);
            y = y.max(first).max(y_least);
            y_high = y_high.min(last).min(y_most);
        }
        while y <= y_high {
            let lanes = ((y_high - y + 1) as usize).min(LANES);
            let runs = segment.runs(simd, across, y as f64 - tip.y, cut);
            match columns {
                Some(columns) if OBSTACLE => {
                    let sums = columns.sums(x as usize, y as usize);
                    let line = columns.dims[2] + 1;
                    for lane in 0..lanes {
                        let (from, to) = if runs.doubt {
                            let (from, to) = segment.run(x, y + lane as i64, z_bounds);
                            (from as i32, to as i32)
                        } else {
                            runs.run(lane)
                        };
                        let sums = &sums[lane * line..];
                        total += sums[to.max(from) as usize] - sums[from as usize];
                    }
                }
                _ if runs.doubt => {
                    for lane in 0..lanes {
                        let (from, to) = segment.run(x, y + lane as i64, z_bounds);
                        total += (to - from).max(0) as u32;
                    }
                }
                // Lines past the last one miss the tool: their runs are empty.
                _ => total += runs.sum(),
            }
            y += LANES as i64;
        }
        if stop && total > 0 {
            return total;
        }
    }
    total
}

/// A solid voxel whose centre lies within the segment, in whole numbers: slow and simple.
#[inline(never)]
pub(super) fn first_solid(segment: &PlacedSegment<'_>, columns: &Columns) -> Option<[f64; 3]> {
    let [nx, _, nz] = columns.dims.map(|n| n as i64);
    let silhouette = Silhouette::new(segment);
    let (x_low, x_high) = segment.columns();
    for x in x_low.max(0)..=x_high.min(nx - 1) {
        let (low, high) = silhouette.row(x as f64 - segment.placed.tip.x, segment.placed.tip.y);
        let (first, last) = columns.row(x as usize);
        for y in low.max(first)..=high.min(last) {
            let (from, to) = segment.run(x, y, (0, nz - 1));
            let sums = columns.sums(x as usize, y as usize);
            let mut solid = (from..to).filter(|&z| sums[z as usize + 1] > sums[z as usize]);
            if let Some(z) = solid.next() {
                return Some([x, y, z].map(|v| v as f64));
            }
        }
    }
    None
}

/// The oblong that holds a segment as seen along z: a strip along the axis and its two ends.
pub(super) struct Silhouette {
    /// Unit vector of the axis as seen along z.
    along: [f64; 2],
    half_width: f64,
    ends: (f64, f64),
}

impl Silhouette {
    pub(super) fn new(segment: &PlacedSegment<'_>) -> Self {
        let d = segment.placed.direction;
        let lean = (d.x * d.x + d.y * d.y).sqrt();
        let along = if lean > 1e-12 { [d.x / lean, d.y / lean] } else { [1.0, 0.0] };
        let spread = segment.widest * d.z.abs();
        Self {
            along,
            half_width: segment.widest,
            ends: (segment.from * lean - spread, segment.to * lean + spread),
        }
    }

    /// First and last whole y of lines at distance `x` from the tip that may meet the segment.
    #[inline(always)]
    pub(super) fn row(&self, x: f64, tip_y: f64) -> (i64, i64) {
        let [ux, uy] = self.along;
        let (mut low, mut high) = (-1e9, 1e9);
        // |y·ux − x·uy| ≤ half_width, and the ends ≤ x·ux + y·uy. More than rounding is added before a small factor divides it.
        let bounds = [
            (ux, -self.half_width + x * uy, self.half_width + x * uy),
            (uy, self.ends.0 - x * ux, self.ends.1 - x * ux),
        ];
        for (factor, lowest, highest) in bounds {
            let (lowest, highest) = (lowest - 1e-6, highest + 1e-6);
            if factor.abs() > 1e-12 {
                let (one, other) = (lowest / factor, highest / factor);
                low = f64::max(low, one.min(other));
                high = f64::min(high, one.max(other));
            } else if lowest > 0.0 || highest < 0.0 {
                return (0, -1);
            }
        }
        ((tip_y + low - 1e-6).ceil() as i64, (tip_y + high + 1e-6).floor() as i64)
    }
}
