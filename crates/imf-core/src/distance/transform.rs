//! The transform itself: along x, then y, then z.

use std::ops::Range;

use crate::occupancy::Occupancy;
use crate::parallel;

/// No such voxel anywhere.
pub(super) const NONE: u32 = u32::MAX;

/// For every voxel what `found` makes of the nearest one whose value is `wanted` and of the squared distance to it in voxels; `none` everywhere
/// where no voxel has that value.
pub(super) fn nearest_voxels<T: Copy + Default + Send + Sync>(
    obstacle: &Occupancy,
    wanted: u8,
    none: T,
    found: impl Fn(u32, u64) -> T + Sync + Send,
) -> Vec<T> {
    let [nx, ny, nz] = obstacle.grid.dims;
    let slab = ny * nz;
    if !obstacle.solid.contains(&wanted) {
        return vec![none; nx * slab];
    }
    // Zeros: their memory is not touched before it is written.
    let mut nearest_x = vec![0; nx * slab];
    // Two sweeps along x, whole slabs at a time.
    for x in 0..nx {
        let (before, here) = nearest_x.split_at_mut(x * slab);
        let solid = &obstacle.solid[x * slab..][..slab];
        for i in 0..slab {
            let last = if x > 0 { before[(x - 1) * slab + i] } else { NONE };
            here[i] = if solid[i] == wanted { x as u32 } else { last };
        }
    }
    for x in (0..nx.saturating_sub(1)).rev() {
        let (here, after) = nearest_x.split_at_mut((x + 1) * slab);
        for i in 0..slab {
            let (low, high) = (here[x * slab + i], after[i]);
            let closer = high != NONE && (low == NONE || high.abs_diff(x as u32) < (x as u32).abs_diff(low));
            here[x * slab + i] = if closer { high } else { low };
        }
    }
    let mut nearest = vec![T::default(); nx * slab];
    parallel::for_each_chunk(
        &mut nearest,
        slab,
        || (),
        |(), x, out| {
            let along_x = &nearest_x[x * slab..][..slab];
            let mut envelope = Envelope::default();
            let mut witness = vec![NONE; slab];
            let mut squared = vec![u64::MAX; slab];
            for z in 0..nz {
                let height = |y: usize| match along_x[y * nz + z] {
                    NONE => None,
                    w => Some(u64::from(w).abs_diff(x as u64).pow(2)),
                };
                envelope.sweep(0..ny, 0..ny, height, |y, (from, d2)| {
                    witness[y * nz + z] = along_x[from * nz + z] * ny as u32 + from as u32;
                    squared[y * nz + z] = d2;
                });
            }
            for y in 0..ny {
                let line = &squared[y * nz..][..nz];
                envelope.sweep(
                    0..nz,
                    0..nz,
                    |z| Some(line[z]).filter(|&s| s != u64::MAX),
                    |z, (from, squared)| {
                        out[y * nz + z] = found(witness[y * nz + from] * nz as u32 + from as u32, squared);
                    },
                );
            }
        },
    );
    nearest
}

/// The lower envelope of parabolas `(i − j)² + height(j)` over whole numbers `i`; memory is reused between lines.
///
/// Without a division, as Maurer, Qi and Raghavan (2003) compare where neighbours meet.
#[derive(Default)]
pub(super) struct Envelope {
    /// Parabolas on the envelope from left to right: vertex v, and v² + height.
    parts: Vec<(i64, i64)>,
}

impl Envelope {
    /// Calls `visit(i, (j, (i − j)² + height(j)))` with the lowest of the `parabolas` for every i of `places`, if
    /// there is any; of equal ones with the first.
    #[inline]
    pub(super) fn sweep(
        &mut self,
        parabolas: Range<usize>,
        places: Range<usize>,
        height: impl Fn(usize) -> Option<u64>,
        mut visit: impl FnMut(usize, (usize, u64)),
    ) {
        self.parts.clear();
        for j in parabolas {
            let Some(h) = height(j) else { continue };
            let vertex = j as i64;
            let sum = vertex * vertex + h as i64;
            // A parabola that meets its left neighbour no sooner than the new one is nowhere below both.
            while let [.., (left, left_sum), (last, last_sum)] = self.parts[..]
                && wide(last_sum - left_sum, vertex - last) >= wide(sum - last_sum, last - left)
            {
                self.parts.pop();
            }
            self.parts.push((vertex, sum));
        }
        let mut parts = self.parts.iter().copied();
        let Some((mut vertex, mut sum)) = parts.next() else { return };
        let mut next = parts.next();
        for i in places {
            let at = i as i64;
            while let Some((v, s)) = next
                && s - 2 * at * v < sum - 2 * at * vertex
            {
                (vertex, sum) = (v, s);
                next = parts.next();
            }
            visit(i, (vertex as usize, (at * (at - 2 * vertex) + sum) as u64));
        }
    }
}

/// A product, which a line of millions of voxels would make too large.
fn wide(a: i64, b: i64) -> i128 {
    i128::from(a) * i128::from(b)
}
