//! Counting by runs: the tool's exact run on every line of voxels, summed or read from the obstacle's running sums.

use pulp::{Arch, Simd, WithSimd};

use super::columns::Columns;
use super::sweep::{LANES, Sweep};

/// What is counted.
#[derive(Clone, Copy)]
pub(super) enum Within<'a> {
    /// Solid voxels of an obstacle.
    Obstacle(&'a Columns),
    /// All voxels, at most this far from the origin along each axis.
    Everything(i64),
}

/// Voxel centres within a segment. With `stop` the count may end at the first line that holds any.
pub(super) fn count(arch: Arch, sweep: &Sweep<'_>, within: Within<'_>, stop: bool) -> u32 {
    struct Pass<'a>(&'a Sweep<'a>, Within<'a>, bool);
    impl WithSimd for Pass<'_> {
        type Output = u32;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> u32 {
            match self.1 {
                Within::Obstacle(columns) => count_lines::<S, true>(simd, self.0, Some(columns), 0, self.2),
                Within::Everything(most) => count_lines::<S, false>(simd, self.0, None, most, self.2),
            }
        }
    }
    arch.dispatch(Pass(sweep, within, stop))
}

#[inline(always)]
fn count_lines<S: Simd, const OBSTACLE: bool>(
    simd: S,
    sweep: &Sweep<'_>,
    columns: Option<&Columns>,
    most: i64,
    stop: bool,
) -> u32 {
    let tip = sweep.placed.tip;
    let (mut x_low, mut x_high) = sweep.columns();
    let mut z_bounds = (-most, most);
    if let Some(columns) = columns {
        x_low = x_low.max(0);
        x_high = x_high.min(columns.dims[0] as i64 - 1);
        z_bounds = (0, columns.dims[2] as i64 - 1);
    }
    let silhouette = Silhouette::new(sweep);
    // A quarter of a voxel off the last centres: an end that was cut off there is sure.
    let cut = (z_bounds.0 as f64 - 0.25, z_bounds.1 as f64 + 0.75);
    let mut total = 0;
    for x in x_low..=x_high {
        let across = x as f64 - tip.x;
        let (mut y, mut y_high) = silhouette.row(across, tip.y);
        if let Some(columns) = columns {
            let (first, last) = columns.row(x as usize);
            y = y.max(first);
            y_high = y_high.min(last);
        }
        while y <= y_high {
            let lanes = ((y_high - y + 1) as usize).min(LANES);
            let runs = sweep.runs(simd, across, y as f64 - tip.y, cut);
            match columns {
                Some(columns) if OBSTACLE => {
                    let sums = columns.sums(x as usize, y as usize);
                    let line = columns.dims[2] + 1;
                    for lane in 0..lanes {
                        let (from, to) = if runs.doubt {
                            let (from, to) = sweep.run(x, y + lane as i64, z_bounds);
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
                        let (from, to) = sweep.run(x, y + lane as i64, z_bounds);
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

/// The oblong that holds a segment as seen along z: a strip along the axis and its two ends.
struct Silhouette {
    /// Unit vector of the axis as seen along z.
    along: [f64; 2],
    half_width: f64,
    ends: (f64, f64),
}

impl Silhouette {
    fn new(sweep: &Sweep<'_>) -> Self {
        let d = sweep.placed.direction;
        let lean = d.x.hypot(d.y);
        let along = if lean > 1e-12 { [d.x / lean, d.y / lean] } else { [1.0, 0.0] };
        let spread = sweep.widest * d.z.abs();
        Self { along, half_width: sweep.widest, ends: (sweep.from * lean - spread, sweep.to * lean + spread) }
    }

    /// First and last whole y of lines at distance `x` from the tip that may meet the segment.
    #[inline(always)]
    fn row(&self, x: f64, tip_y: f64) -> (i64, i64) {
        let [ux, uy] = self.along;
        let (mut low, mut high) = (-1e9, 1e9);
        // |y·ux − x·uy| ≤ half_width, and the ends ≤ x·ux + y·uy.
        let bounds = [
            (ux, -self.half_width + x * uy, self.half_width + x * uy),
            (uy, self.ends.0 - x * ux, self.ends.1 - x * ux),
        ];
        for (factor, least, most) in bounds {
            if factor.abs() > 1e-9 {
                let (one, other) = (least / factor, most / factor);
                low = f64::max(low, one.min(other));
                high = f64::min(high, one.max(other));
            } else if least > 1e-6 || most < -1e-6 {
                return (0, -1);
            }
        }
        ((tip_y + low - 1e-6).ceil() as i64, (tip_y + high + 1e-6).floor() as i64)
    }
}
