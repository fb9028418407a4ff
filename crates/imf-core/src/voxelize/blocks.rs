//! Winding numbers of an open mesh by blocks of voxels.
//!
//! What the crossings do not count changes little where the boundary is far away: one value serves a whole block if it decides for
//! every voxel in it, and else a plane through the values if it decides for all but a few. Where it does not, the block is halved
//! along each axis, down to single voxels.

use glam::DVec3;

use super::cone::{BoundaryCone, OpenPart};
use super::{SOLID, UNDECIDED, deciding_point};
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;

/// Planes that are decided together: an edge of the largest blocks.
pub(super) const PLANES: usize = 16;

/// What all pieces of the boundary together may be off for good where they are far away.
const FAR: f64 = 1e-3;

/// Voxels of a block that cost as much by themselves as the eight parts of the block.
const FEW: usize = 12;

/// State of some planes x of a grid, from one of them on.
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

/// What is filled.
struct Output<'a> {
    solid: &'a mut [u8],
    doubt: Doubt,
}

impl Planes<'_> {
    /// 1 for every solid voxel of the planes in `solid`; nothing more of it where the control asks to stop.
    pub(super) fn fill(&self, solid: &mut [u8]) -> Doubt {
        let [_, ny, nz] = self.grid.dims;
        let mut out = Output { solid, doubt: Doubt::default() };
        let all: Vec<u32> = (0..self.cone.pieces() as u32).collect();
        let planes = out.solid.len() / (ny * nz);
        for y in (0..ny).step_by(PLANES) {
            for z in (0..nz).step_by(PLANES) {
                let high = [planes, (y + PLANES).min(ny), (z + PLANES).min(nz)];
                self.fill_block([0, y, z], high, OpenPart::default(), &all, &mut out);
            }
        }
        out.doubt
    }

    /// The voxels from `low` on and before `high`: `far` is what all pieces of the boundary but `near` add there.
    fn fill_block(
        &self,
        low: [usize; 3],
        high: [usize; 3],
        far: OpenPart,
        near: &[u32],
        out: &mut Output<'_>,
    ) {
        if self.control.is_cancelled() {
            return;
        }
        let (first, last) = (self.centre(low), self.centre(high.map(|v| v - 1)));
        if first == last {
            self.fill_all(low, high, out, |voxel, closed| self.exact(voxel, closed, far, near));
            return;
        }
        let (middle, radius) = (0.5 * (first + last), 0.5 * first.distance(last));
        let (mut far, mut here, mut meets) = (far, OpenPart::default(), false);
        let mut still_near = Vec::with_capacity(near.len());
        for &piece in near {
            match self.cone.open_part(piece as usize, middle, radius) {
                Some(part) if part.error * self.cone.pieces() as f64 <= FAR => far += part,
                part => {
                    still_near.push(piece);
                    meets |= part.is_none();
                    here += part.unwrap_or_default();
                }
            }
        }
        here += far;
        if !meets && here.error < 0.5 {
            if decides(here.at(middle), here.gradient.length() * radius + here.error) {
                let open = here.at(middle);
                self.fill_all(low, high, out, |_, closed| f64::from(closed) + open);
                return;
            }
            let open = |voxel| here.at(self.centre(voxel));
            if voxels(low, high).filter(|&voxel| !decides(open(voxel), here.error)).take(FEW).count() < FEW {
                self.fill_all(low, high, out, |voxel, closed| {
                    let open = open(voxel);
                    let decided = decides(open, here.error);
                    if decided {
                        f64::from(closed) + open
                    } else {
                        self.exact(voxel, closed, far, &still_near)
                    }
                });
                return;
            }
        }
        let middle = [0, 1, 2].map(|axis| (low[axis] + high[axis]).div_ceil(2));
        for part in 0..8 {
            let upper = |axis: usize| part >> axis & 1 == 1;
            let from = [0, 1, 2].map(|axis| if upper(axis) { middle[axis] } else { low[axis] });
            let to = [0, 1, 2].map(|axis| if upper(axis) { high[axis] } else { middle[axis] });
            if (0..3).all(|axis| from[axis] < to[axis]) {
                self.fill_block(from, to, far, &still_near, out);
            }
        }
    }

    /// The winding number of a voxel, or one of which the same is made.
    fn exact(&self, voxel: [usize; 3], closed: i32, far: OpenPart, near: &[u32]) -> f64 {
        let point = self.centre(voxel);
        let open = self.cone.open_winding_of(near, point).map(|open| open + far.at(point));
        match open.filter(|&open| decides(open, far.error)) {
            Some(open) => f64::from(closed) + open,
            None => self.cone.winding(closed, point, self.mesh),
        }
    }

    fn centre(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        deciding_point(self.grid, [self.first + x, y, z])
    }

    /// `winding` has a voxel and the closed mesh's winding number there.
    fn fill_all(
        &self,
        low: [usize; 3],
        high: [usize; 3],
        out: &mut Output<'_>,
        winding: impl Fn([usize; 3], i32) -> f64,
    ) {
        let [_, ny, nz] = self.grid.dims;
        for voxel @ [x, y, z] in voxels(low, high) {
            let line = x * ny + y;
            let winding = winding(voxel, self.closed[line * (nz + 1) + z]).abs();
            out.doubt.claimed += usize::from(winding >= UNDECIDED.0);
            out.doubt.undecided += usize::from(winding >= UNDECIDED.0 && winding < UNDECIDED.1);
            out.solid[line * nz + z] = u8::from(winding > SOLID);
        }
    }
}

/// The voxels from `low` on and before `high`.
fn voxels(low: [usize; 3], high: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = [0, 1, 2].map(|axis| low[axis]..high[axis]);
    x.flat_map(move |x| {
        let z = z.clone();
        y.clone().flat_map(move |y| z.clone().map(move |z| [x, y, z]))
    })
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
