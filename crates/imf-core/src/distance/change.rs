//! The transform after a few voxels have changed, equal to one computed from scratch.
//!
//! Each of the three passes is a function of single lines: a line along y is done again where the nearest voxel along
//! x has changed on it, and a line along z where the result of that has, both as far as the change has an effect. The
//! result of the second pass is stored from the first change on; of the first pass the required lines are computed
//! again.

use std::ops::Range;
use std::sync::OnceLock;

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
        let lines = along_x.changed_lines(changed);
        // Lines along y.
        let in_plane = &self.in_plane;
        let found = parallel::map(nx, |x| {
            let (mut envelope, mut found) = (Envelope::default(), Vec::new());
            for (place, &z) in planes.iter().enumerate() {
                let index = |y: usize| (x * ny + y) * nz + z;
                let Some(changed) = lines[x * planes.len() + place].places() else { continue };
                let height = |y: usize| along_x.squared(x, y, place);
                let old = |y: usize| match in_plane[index(y)] {
                    NONE => None,
                    old => Some((old as usize % ny, (old as usize / ny).abs_diff(x).pow(2) as u64)),
                };
                let (parabolas, places) = felt(ny, changed, old, height);
                if parabolas.clone().all(|y| height(y).is_none()) {
                    found.extend(places.clone().map(|y| (index(y), NONE)));
                }
                envelope.sweep(parabolas, places, height, |y, (from, _)| {
                    let nearest = along_x.nearest(x, from, place);
                    if in_plane[index(y)] != nearest {
                        found.push((index(y), nearest));
                    }
                });
            }
            found
        });
        let mut lines = vec![Hull::default(); nx * ny];
        for (index, nearest) in found.into_iter().flatten() {
            self.in_plane[index] = nearest;
            lines[index / nz].add(index % nz);
        }
        // Lines along z.
        let Self { in_plane, cells, .. } = &*self;
        let found = parallel::map(nx, |x| {
            let (mut envelope, mut found) = (Envelope::default(), Vec::new());
            for y in 0..ny {
                let start = (x * ny + y) * nz;
                let Some(changed) = lines[x * ny + y].places() else { continue };
                let apart = |place: u32| {
                    let (there, across) = (place as usize / ny, place as usize % ny);
                    (there.abs_diff(x).pow(2) + across.abs_diff(y).pow(2)) as u64
                };
                let height = |z: usize| Some(in_plane[start + z]).filter(|&p| p != NONE).map(apart);
                let old = |z: usize| match cells[start + z][0] {
                    NONE => None,
                    old => Some((old as usize % nz, apart(old / nz as u32))),
                };
                let (parabolas, places) = felt(nz, changed, old, height);
                if parabolas.clone().all(|z| height(z).is_none()) {
                    found.extend(places.clone().map(|z| (start + z, EMPTY)));
                }
                envelope.sweep(parabolas, places, height, |z, (from, squared)| {
                    let nearest = in_plane[start + from] * nz as u32 + from as u32;
                    if cells[start + z][0] != nearest {
                        found.push((start + z, cell(nearest, squared)));
                    }
                });
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

/// On a line of `length` places where the heights of the `changed` parabolas have changed: the parabolas among which
/// the lowest one is, and the places at which the lowest may now be another. `old` gives the vertex of the formerly
/// lowest one, and its height.
///
/// Vertices of lowest parabolas rise along the line. So those places are contiguous: where one of the changed was
/// lowest, and on both sides as far as one of them is now.
fn felt(
    length: usize,
    changed: Range<usize>,
    old: impl Fn(usize) -> Option<(usize, u64)>,
    height: impl Fn(usize) -> Option<u64>,
) -> (Range<usize>, Range<usize>) {
    // Each place tests all changed parabolas: if there are many, the whole line is faster.
    if changed.len() > length / 4 || old(0).is_none() {
        return (0..length, 0..length);
    }
    let vertex = |place: usize| old(place).map_or(0, |(vertex, _)| vertex);
    let from = first(0..length, |place| vertex(place) >= changed.start);
    let to = first(from..length, |place| vertex(place) >= changed.end);
    let at =
        |place: usize, vertex: usize, height: u64| (place.abs_diff(vertex).pow(2) as u64 + height, vertex);
    let is_closer = |place: usize| {
        let old = old(place).map(|(vertex, height)| at(place, vertex, height));
        let new = changed.clone().filter_map(|j| Some(at(place, j, height(j)?)));
        old.zip(new.min()).is_some_and(|(old, new)| new < old)
    };
    let from = first(0..from, is_closer);
    let to = first(to..length, |place| !is_closer(place));
    let lowest = if from > 0 { vertex(from - 1) } else { 0 };
    let end = if to < length { vertex(to) + 1 } else { length };
    (lowest..end, from..to)
}

/// The first of a range for which something holds, from which on it holds to the end.
fn first(range: Range<usize>, holds: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (range.start, range.end);
    while low < high {
        let middle = low.midpoint(high);
        if holds(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

/// From the first to the last of some places on a line.
#[derive(Clone, Default)]
struct Hull(Option<(usize, usize)>);

impl Hull {
    fn add(&mut self, place: usize) {
        self.0 = Some(self.0.map_or((place, place), |(low, high)| (low.min(place), high.max(place))));
    }

    fn places(&self) -> Option<Range<usize>> {
        self.0.map(|(low, high)| low..high + 1)
    }
}

/// By voxel the nearest solid one of the same z, as x · ny + y.
fn nearest_in_planes(obstacle: &Occupancy) -> Vec<u32> {
    let [nx, ny, nz] = obstacle.grid.dims;
    let planes: Vec<usize> = (0..nz).collect();
    let along_x = AlongX::new(obstacle, &planes);
    // Lines of one y share what is read from memory.
    parallel::map(ny, |y| planes.iter().for_each(|&z| _ = along_x.line(y, z)));
    let mut all = vec![NONE; nx * ny * nz];
    parallel::for_each_chunk(&mut all, ny * nz, Envelope::default, |envelope, x, all| {
        for z in 0..nz {
            envelope.sweep(
                0..ny,
                0..ny,
                |y| along_x.squared(x, y, z),
                |y, (from, _)| all[y * nz + z] = along_x.nearest(x, from, z),
            );
        }
    });
    all
}

/// For voxels in some planes of constant z the x of the nearest solid one on their line along x.
struct AlongX<'a> {
    obstacle: &'a Occupancy,
    planes: &'a [usize],
    /// Lines by y, then by plane, each computed when it is first needed.
    lines: Vec<OnceLock<Vec<u32>>>,
}

impl<'a> AlongX<'a> {
    fn new(obstacle: &'a Occupancy, planes: &'a [usize]) -> Self {
        let lines = vec![OnceLock::new(); obstacle.grid.dims[1] * planes.len()];
        Self { obstacle, planes, lines }
    }

    fn line(&self, y: usize, place: usize) -> &[u32] {
        let line = &self.lines[y * self.planes.len() + place];
        line.get_or_init(|| {
            let mut line = self.solid(y, self.planes[place]);
            spread(&mut line);
            line
        })
    }

    /// Solid voxels of a line name themselves.
    fn solid(&self, y: usize, z: usize) -> Vec<u32> {
        let [nx, ny, nz] = self.obstacle.grid.dims;
        let solid = |x: usize| self.obstacle.solid[(x * ny + y) * nz + z] == 1;
        (0..nx).map(|x| if solid(x) { x as u32 } else { NONE }).collect()
    }

    /// How far away the nearest voxel along x is, squared.
    fn squared(&self, x: usize, y: usize, place: usize) -> Option<u64> {
        let nearest = self.line(y, place)[x];
        (nearest != NONE).then(|| u64::from(nearest).abs_diff(x as u64).pow(2))
    }

    /// Which voxel that is, as x · ny + y.
    fn nearest(&self, x: usize, y: usize, place: usize) -> u32 {
        self.line(y, place)[x] * self.obstacle.grid.dims[1] as u32 + y as u32
    }

    /// By x and plane: where on the line along y the nearest voxel along x has changed.
    fn changed_lines(&self, changed: &[usize]) -> Vec<Hull> {
        let [nx, ny, nz] = self.obstacle.grid.dims;
        let mut of_lines: Vec<[usize; 3]> =
            changed.iter().map(|index| [index / nz % ny, index % nz, index / nz / ny]).collect();
        of_lines.sort_unstable();
        let mut lines = vec![Hull::default(); nx * self.planes.len()];
        for of_line in of_lines.chunk_by(|a, b| a[..2] == b[..2]) {
            let [y, z, _] = of_line[0];
            let place = self.planes.partition_point(|&plane| plane < z);
            let mut old = self.solid(y, z);
            for &[_, _, x] in of_line {
                old[x] = if old[x] == NONE { x as u32 } else { NONE };
            }
            spread(&mut old);
            for (x, (old, new)) in old.iter().zip(self.line(y, place)).enumerate() {
                if old != new {
                    lines[x * self.planes.len() + place].add(y);
                }
            }
        }
        lines
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
    use crate::set_cover::local::Numbers;

    #[test]
    fn after_any_changes_the_transform_is_the_one_made_anew() {
        for (dims, one_in) in [
            ([9, 8, 13], 40),
            ([7, 9, 11], 3),
            ([21, 17, 26], 900),
            ([1, 13, 4], 9),
            ([12, 1, 1], 5),
            ([5, 6, 1], 4),
        ] {
            let mut obstacle = scattered(dims, one_in);
            let mut field = DistanceField::new(&obstacle);
            let mut numbers = Numbers(12345);
            let mut next = |below: usize| numbers.below(below);
            for step in 0..60 {
                let before = field.clone();
                // All go, and come back, at last.
                let mut changed: Vec<usize> = match step {
                    40 | 41 => {
                        (0..obstacle.solid.len()).filter(|&v| step == 41 || obstacle.solid[v] == 1).collect()
                    }
                    // A block turns solid or empty.
                    _ if step % 3 == 0 => {
                        let low = dims.map(&mut next);
                        let value = next(2) as u8;
                        let within = |v: &usize| {
                            let at = obstacle.grid.voxel(*v);
                            (0..3).all(|a| (low[a]..low[a] + 5).contains(&at[a]))
                        };
                        (0..obstacle.solid.len())
                            .filter(|v| within(v) && obstacle.solid[*v] != value)
                            .collect()
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
