//! The transform after a few voxels have changed, equal to one made anew.
//!
//! Each of the three passes is a function of single lines: a line along y is done again where the nearest voxel along x has changed on it,
//! and a line along z where the result of that has. The result of the second pass is kept from the first change on; that of the first
//! one is found again, in the planes of constant z that hold a change.

use super::transform::{Envelope, NONE};
use super::{DistanceField, EMPTY, cell};
use crate::occupancy::Occupancy;
use crate::parallel;

impl DistanceField {
    /// Follows an obstacle of which some voxels have just become solid or empty: each of `changed` once. The result is that of
    /// [`DistanceField::new`]. Returns the voxels of which the nearest solid one has changed, in no order.
    ///
    /// # Panics
    /// If the obstacle is on another grid.
    pub(crate) fn change(&mut self, obstacle: &Occupancy, changed: &[usize]) -> Vec<usize> {
        assert_eq!(self.dims, obstacle.grid.dims);
        let [nx, ny, nz] = self.dims;
        if self.in_plane.is_empty() {
            let mut old = obstacle.clone();
            changed.iter().for_each(|&index| old.solid[index] ^= 1);
            self.in_plane = nearest_in_planes(&old);
        }
        let mut planes: Vec<usize> = changed.iter().map(|index| index % nz).collect();
        planes.sort_unstable();
        planes.dedup();
        let along_x = AlongX::new(obstacle, &planes);
        let lines = along_x.changed_lines(obstacle, changed, &planes);
        // Lines along y.
        let in_plane = &self.in_plane;
        let found = parallel::map(nx, |x| {
            let mut envelope = Envelope::default();
            let (mut line, mut found) = (vec![NONE; ny], Vec::new());
            for (place, &z) in planes.iter().enumerate().filter(|(place, _)| lines[x * planes.len() + place])
            {
                along_x.nearest_along_y(&mut envelope, x, place, &mut line);
                let all = line.iter().enumerate().map(|(y, &nearest)| ((x * ny + y) * nz + z, nearest));
                found.extend(all.filter(|&(index, nearest)| in_plane[index] != nearest));
            }
            found
        });
        let mut lines = vec![false; nx * ny];
        for (index, nearest) in found.into_iter().flatten() {
            self.in_plane[index] = nearest;
            lines[index / nz] = true;
        }
        // Lines along z.
        let Self { in_plane, cells, .. } = &*self;
        let found = parallel::map(nx, |x| {
            let mut envelope = Envelope::default();
            let (mut squared, mut line, mut found) = (vec![None; nz], vec![EMPTY; nz], Vec::new());
            for y in (0..ny).filter(|y| lines[x * ny + y]) {
                let start = (x * ny + y) * nz;
                let in_plane = &in_plane[start..][..nz];
                for (squared, &nearest) in squared.iter_mut().zip(in_plane) {
                    let (there, across) = (nearest / ny as u32, nearest % ny as u32);
                    let apart = |a: u32, b: usize| u64::from(a).abs_diff(b as u64).pow(2);
                    *squared = (nearest != NONE).then(|| apart(there, x) + apart(across, y));
                }
                line.fill(EMPTY);
                envelope.sweep(
                    nz,
                    |z| squared[z],
                    |z, (from, squared)| {
                        line[z] = cell(in_plane[from] * nz as u32 + from as u32, squared);
                    },
                );
                let all = line.iter().enumerate().map(|(z, cell)| (start + z, *cell));
                found.extend(all.filter(|&(index, cell)| cells[index] != cell));
            }
            found
        });
        let mut all = Vec::new();
        for (index, cell) in found.into_iter().flatten() {
            self.cells[index] = cell;
            all.push(index);
        }
        all
    }
}

/// By voxel the nearest solid one of the same z, as x · ny + y.
fn nearest_in_planes(obstacle: &Occupancy) -> Vec<u32> {
    let [_, ny, nz] = obstacle.grid.dims;
    let planes: Vec<usize> = (0..nz).collect();
    let along_x = AlongX::new(obstacle, &planes);
    let mut all = vec![NONE; obstacle.grid.len()];
    parallel::for_each_chunk(
        &mut all,
        ny * nz,
        || (Envelope::default(), vec![NONE; ny]),
        |(envelope, line), x, all| {
            for z in 0..nz {
                along_x.nearest_along_y(envelope, x, z, line);
                line.iter().enumerate().for_each(|(y, &nearest)| all[y * nz + z] = nearest);
            }
        },
    );
    all
}

/// For voxels in some planes of constant z the x of the nearest solid one on their line along x.
struct AlongX {
    dims: [usize; 3],
    planes: usize,
    /// Lines by y, then by plane.
    nearest: Vec<u32>,
}

impl AlongX {
    fn new(obstacle: &Occupancy, planes: &[usize]) -> Self {
        let dims = obstacle.grid.dims;
        let [nx, ny, nz] = dims;
        let mut nearest = vec![NONE; planes.len() * nx * ny];
        let solid = |x: usize, y: usize, z: usize| obstacle.solid[(x * ny + y) * nz + z] == 1;
        parallel::for_each_chunk(
            &mut nearest,
            planes.len() * nx,
            || (),
            |(), y, lines| {
                // A line of the array at a time.
                for x in 0..nx {
                    for (place, &z) in planes.iter().enumerate() {
                        lines[place * nx + x] = if solid(x, y, z) { x as u32 } else { NONE };
                    }
                }
                lines.chunks_mut(nx).for_each(spread);
            },
        );
        Self { dims, planes: planes.len(), nearest }
    }

    fn line(&self, y: usize, place: usize) -> &[u32] {
        let nx = self.dims[0];
        &self.nearest[(y * self.planes + place) * nx..][..nx]
    }

    /// By x and plane: whether the nearest voxel along x has changed anywhere on the line along y.
    fn changed_lines(&self, obstacle: &Occupancy, changed: &[usize], planes: &[usize]) -> Vec<bool> {
        let [nx, ny, nz] = self.dims;
        let mut of_lines: Vec<[usize; 3]> =
            changed.iter().map(|index| [index / nz % ny, index % nz, index / nz / ny]).collect();
        of_lines.sort_unstable();
        let mut lines = vec![false; nx * planes.len()];
        let mut old = vec![NONE; nx];
        for of_line in of_lines.chunk_by(|a, b| a[..2] == b[..2]) {
            let [y, z, _] = of_line[0];
            let place = planes.partition_point(|&plane| plane < z);
            for (x, old) in old.iter_mut().enumerate() {
                *old = if obstacle.solid[(x * ny + y) * nz + z] == 1 { x as u32 } else { NONE };
            }
            for &[_, _, x] in of_line {
                old[x] = if old[x] == NONE { x as u32 } else { NONE };
            }
            spread(&mut old);
            for (x, (old, new)) in old.iter().zip(self.line(y, place)).enumerate() {
                lines[x * planes.len() + place] |= old != new;
            }
        }
        lines
    }

    /// By y the nearest solid voxel, as x · ny + y, of those in one plane.
    fn nearest_along_y(&self, envelope: &mut Envelope, x: usize, place: usize, line: &mut [u32]) {
        let ny = self.dims[1];
        line.fill(NONE);
        let along_x = |y: usize| self.line(y, place)[x];
        let height = |y: usize| match along_x(y) {
            NONE => None,
            nearest => Some(u64::from(nearest).abs_diff(x as u64).pow(2)),
        };
        envelope.sweep(ny, height, |y, (from, _)| line[y] = along_x(from) * ny as u32 + from as u32);
    }
}

/// From the solid voxels of a line, which name themselves, to all: the nearest one, of two the lower.
fn spread(line: &mut [u32]) {
    for x in 1..line.len() {
        if line[x] == NONE {
            line[x] = line[x - 1];
        }
    }
    for x in (0..line.len().saturating_sub(1)).rev() {
        let (low, high) = (line[x], line[x + 1]);
        let closer = high != NONE && (low == NONE || high.abs_diff(x as u32) < (x as u32).abs_diff(low));
        line[x] = if closer { high } else { low };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::tests::scattered;

    #[test]
    fn after_any_changes_the_transform_is_the_one_made_anew() {
        for (dims, one_in) in
            [([9, 8, 13], 40), ([7, 9, 11], 3), ([1, 13, 4], 9), ([12, 1, 1], 5), ([5, 6, 1], 4)]
        {
            let mut obstacle = scattered(dims, one_in);
            let mut field = DistanceField::new(&obstacle);
            let mut random = 12345_usize;
            let mut next = |below: usize| {
                random =
                    random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (random >> 33) % below
            };
            for step in 0..60 {
                let before = field.clone();
                // All go, and come back, at last.
                let mut changed: Vec<usize> = match step {
                    40 | 41 => {
                        (0..obstacle.solid.len()).filter(|&v| step == 41 || obstacle.solid[v] == 1).collect()
                    }
                    _ => (0..1 + step % 7).map(|_| next(obstacle.solid.len())).collect(),
                };
                changed.sort_unstable();
                changed.dedup();
                changed.iter().for_each(|&index| obstacle.solid[index] ^= 1);
                let mut moved = field.change(&obstacle, &changed);
                let anew = DistanceField::new(&obstacle);
                assert_eq!(field.cells, anew.cells, "{dims:?} {step}");
                moved.sort_unstable();
                let differ = (0..obstacle.solid.len()).filter(|&v| before.cells[v] != anew.cells[v]);
                assert_eq!(moved, differ.collect::<Vec<_>>());
            }
        }
    }
}
