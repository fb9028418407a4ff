//! Winding numbers of an open mesh by blocks of voxels.
//!
//! What the crossings do not count changes little where the boundary is far away: one value serves a whole block if it decides for
//! every voxel in it. Where it does not, the block is halved along each axis, down to single voxels.

use super::cone::BoundaryCone;
use super::{SOLID, UNDECIDED};
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;

/// Planes that are decided together: an edge of the largest blocks.
pub(super) const PLANES: usize = 16;

/// What is known of some planes x of a grid, from one of them on.
pub(super) struct Planes<'a> {
    pub(super) grid: &'a Grid,
    pub(super) mesh: &'a Mesh,
    pub(super) cone: &'a BoundaryCone,
    pub(super) first: usize,
    /// Winding numbers of the closed mesh, `[planes][ny][nz + 1]`.
    pub(super) closed: &'a [i32],
    pub(super) control: Control<'a>,
}

/// Voxels with a winding number of at least the lower bound of [`UNDECIDED`], and those of them that are below the upper.
#[derive(Clone, Copy, Default)]
pub(super) struct Doubt {
    pub(super) claimed: usize,
    pub(super) undecided: usize,
}

impl Planes<'_> {
    /// 1 for every solid voxel of the planes in `solid`; nothing more of it where the control asks to stop.
    pub(super) fn fill(&self, solid: &mut [u8]) -> Doubt {
        let [_, ny, nz] = self.grid.dims;
        let mut doubt = Doubt::default();
        let planes = solid.len() / (ny * nz);
        for y in (0..ny).step_by(PLANES) {
            for z in (0..nz).step_by(PLANES) {
                let high = [planes, (y + PLANES).min(ny), (z + PLANES).min(nz)];
                self.fill_block([0, y, z], high, solid, &mut doubt);
            }
        }
        doubt
    }

    /// The voxels from `low` on and before `high`.
    fn fill_block(&self, low: [usize; 3], high: [usize; 3], solid: &mut [u8], doubt: &mut Doubt) {
        if self.control.is_cancelled() {
            return;
        }
        let centre = |[x, y, z]: [usize; 3]| self.grid.centre([self.first + x, y, z]);
        let (first, last) = (centre(low), centre(high.map(|v| v - 1)));
        if first == last {
            let winding = |closed| self.cone.open_winding(closed, first, self.mesh);
            return self.fill_all(low, high, solid, doubt, winding);
        }
        let (middle, radius) = (0.5 * (first + last), 0.5 * first.distance(last));
        match self.cone.open_part(middle, radius, self.mesh) {
            Some((open, change)) if decides(open, change) => {
                self.fill_all(low, high, solid, doubt, |closed| f64::from(closed) + open);
            }
            _ => {
                let middle = [0, 1, 2].map(|axis| (low[axis] + high[axis]).div_ceil(2));
                for part in 0..8 {
                    let upper = |axis: usize| part >> axis & 1 == 1;
                    let from = [0, 1, 2].map(|axis| if upper(axis) { middle[axis] } else { low[axis] });
                    let to = [0, 1, 2].map(|axis| if upper(axis) { high[axis] } else { middle[axis] });
                    if (0..3).all(|axis| from[axis] < to[axis]) {
                        self.fill_block(from, to, solid, doubt);
                    }
                }
            }
        }
    }

    fn fill_all(
        &self,
        low: [usize; 3],
        high: [usize; 3],
        solid: &mut [u8],
        doubt: &mut Doubt,
        winding: impl Fn(i32) -> f64,
    ) {
        let [_, ny, nz] = self.grid.dims;
        for (x, y) in (low[0]..high[0]).flat_map(|x| (low[1]..high[1]).map(move |y| (x, y))) {
            let line = x * ny + y;
            for z in low[2]..high[2] {
                let winding = winding(self.closed[line * (nz + 1) + z]).abs();
                doubt.claimed += usize::from(winding >= UNDECIDED.0);
                doubt.undecided += usize::from(winding >= UNDECIDED.0 && winding < UNDECIDED.1);
                solid[line * nz + z] = u8::from(winding > SOLID);
            }
        }
    }
}

/// True where any whole number and `open`, changed by at most `change`, make the same of a voxel.
fn decides(open: f64, change: f64) -> bool {
    // More than all rounding.
    let change = change + 1e-9;
    [UNDECIDED.0, SOLID, UNDECIDED.1].into_iter().all(|bound| {
        let off = open - bound;
        (off - off.round()).abs() > change
    })
}
