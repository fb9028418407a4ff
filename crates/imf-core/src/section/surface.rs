//! Overlaps by differences: stepping the tool by a voxel changes the overlap by what its run ends cover and uncover.
//!
//! Far enough along the axis the tool has left the obstacle and its overlap is zero; from there the differences are
//! summed up. All is whole numbers, so nothing is rounded. The sums over run ends are taken for thousands of voxels
//! at once (`bit_adder`), from the obstacle's bits (`bit_obstacle`).

use std::ops::Range;

use pulp::Arch;

use super::bit_adder::{DIGITS, Digits, TILE_BITS, ZERO, add, spread, subtract};
use super::bit_obstacle::BitObstacle;
use super::clipped::ClippedTool;
use super::run_ends::{Axis, Offsets, RunEnds};
use super::size::{CircularSize, QueryBox};
use super::sweep::Sweep;
use crate::occupancy::Occupancy;

/// The obstacle prepared for tools and query boxes of one size.
pub(super) struct SurfaceCounter {
    arch: Arch,
    obstacle: BitObstacle,
}

/// Working memory of one thread.
pub(super) struct Scratch {
    ends: RunEnds,
    /// Addresses of the run ends relative to a tile's; they wrap.
    addresses: [Vec<u32>; 2],
    /// Addresses that one tile reads.
    reads: Vec<u32>,
    digits: Box<[Digits; 2]>,
    /// Differences of one plane, then overlaps.
    plane: Vec<i32>,
    /// Overlaps of the plane before.
    previous: Vec<i32>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self {
            ends: RunEnds::default(),
            addresses: [Vec::new(), Vec::new()],
            reads: Vec::new(),
            digits: Box::new([ZERO, ZERO]),
            plane: Vec::new(),
            previous: Vec::new(),
        }
    }
}

impl SurfaceCounter {
    pub(super) fn new(arch: Arch, obstacle: &Occupancy, size: &CircularSize) -> Self {
        Self { arch, obstacle: BitObstacle::new(obstacle, size, TILE_BITS) }
    }

    /// Overlaps of the tool over a query box into `counts`; the size given to `new` holds for the box.
    pub(super) fn count(
        &self,
        tool: &ClippedTool<'_>,
        query: &QueryBox,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) {
        counts.fill(0);
        if tool.dims[0] == 0 {
            return;
        }
        let sweep = Sweep::choose(tool, self.obstacle.dims(), self.obstacle.line_bits(), query);
        if sweep.steps() == 0 {
            return;
        }
        scratch.ends.collect(tool, sweep.axis);
        for (addresses, offsets) in
            scratch.addresses.iter_mut().zip([&scratch.ends.covered, &scratch.ends.uncovered])
        {
            self.addresses_of(offsets, addresses);
        }
        let [xs, ys, zs] = Axis::ALL.map(|axis| sweep.range(axis, query));
        let lines = (ys.end - ys.start) as usize;
        let length = (zs.end - zs.start) as usize;
        scratch.previous.clear();
        scratch.previous.resize(lines * length, 0);
        scratch.plane.resize(lines * length, 0);
        let planes: Box<dyn Iterator<Item = i64>> =
            if sweep.axis == Axis::X && !sweep.upwards { Box::new(xs.rev()) } else { Box::new(xs) };
        for x in planes {
            self.differences(x, &ys, &zs, scratch);
            let Scratch { plane, previous, .. } = scratch;
            let target = match sweep.axis {
                Axis::X => {
                    add_up(previous, plane, sweep.upwards);
                    // A difference upwards leads to the next plane.
                    x + i64::from(sweep.upwards)
                }
                Axis::Y => {
                    sum_lines(plane, length, sweep.upwards);
                    x
                }
                Axis::Z => {
                    plane.chunks_exact_mut(length).for_each(|line| sum_line(line, sweep.upwards));
                    x
                }
            };
            let source = if sweep.axis == Axis::X { &*previous } else { &*plane };
            store(query, target, &ys, &zs, &sweep, source, counts);
        }
    }

    fn addresses_of(&self, offsets: &Offsets, addresses: &mut Vec<u32>) {
        addresses.clear();
        for x in 0..offsets.dims[0] {
            for y in 0..offsets.dims[1] {
                let at = [offsets.lower[0] + x as i64, offsets.lower[1] + y as i64];
                let range = offsets.range(x, y, y + 1);
                addresses.extend(
                    offsets.z[range]
                        .iter()
                        .map(|&z| self.obstacle.offset_address([at[0], at[1], i64::from(z)]) as u32),
                );
            }
        }
    }

    /// Differences at plane x over `ys × zs` into `scratch.plane`.
    fn differences(&self, x: i64, ys: &Range<i64>, zs: &Range<i64>, scratch: &mut Scratch) {
        let line = self.obstacle.line_bits();
        let length = (zs.end - zs.start) as usize;
        let first = (ys.start * line + zs.start).div_euclid(8) * 8;
        let end = (ys.end - 1) * line + zs.end;
        scratch.plane.fill(0);
        for start in (first..end).step_by(TILE_BITS) {
            // Lines that the tile touches; a line begins at the first z that is wanted.
            let top = (start - zs.start).div_euclid(line);
            let bottom = (start + TILE_BITS as i64 - 1 - zs.start).div_euclid(line).min(ys.end - 1);
            let tile_address = self.obstacle.tile_address(x, start) as u32;
            let mut used = [0; 2];
            for side in 0..2 {
                let offsets = if side == 0 { &scratch.ends.covered } else { &scratch.ends.uncovered };
                let reads = &mut scratch.reads;
                self.reads_of(offsets, &scratch.addresses[side], x, top..bottom, tile_address, reads);
                let digits = &mut scratch.digits[side];
                // Digits beyond those of this tile are never read.
                let most = (usize::BITS - reads.len().leading_zeros()) as usize;
                digits[..most.clamp(5, DIGITS)].fill([0; TILE_BITS / 64]);
                if !reads.is_empty() {
                    used[side] = add(self.arch, self.obstacle.bytes(), reads, digits);
                }
            }
            let most = used[0].max(used[1]);
            if most == 0 {
                continue;
            }
            for (digits, used) in scratch.digits.iter_mut().zip(used) {
                digits[used..most].fill([0; TILE_BITS / 64]);
            }
            let [covered, uncovered] = &mut *scratch.digits;
            subtract(self.arch, covered, uncovered, most);
            for y in top.max(ys.start)..=bottom {
                let from = (y * line + zs.start - start).max(0);
                let to = (y * line + zs.end - start).min(TILE_BITS as i64);
                if from < to {
                    let skipped = from - (y * line + zs.start - start);
                    let target = (y - ys.start) as usize * length + skipped as usize;
                    let target = &mut scratch.plane[target..][..(to - from) as usize];
                    spread(self.arch, covered, most, from as usize, target);
                }
            }
        }
    }

    /// Addresses that a tile at plane x over these lines reads; padded with zeros' addresses to a multiple of eight.
    fn reads_of(
        &self,
        offsets: &Offsets,
        addresses: &[u32],
        x: i64,
        lines: Range<i64>,
        tile_address: u32,
        reads: &mut Vec<u32>,
    ) {
        reads.clear();
        // Planes that are inside the obstacle's grid.
        let low = (-x - offsets.lower[0]).max(0);
        let high = (self.obstacle.dims()[0] as i64 - x - offsets.lower[0]).min(offsets.dims[0] as i64);
        for offset in low..high {
            let Some([first, last]) = self.obstacle.solid_lines((x + offsets.lower[0] + offset) as usize)
            else {
                continue;
            };
            let from = (first - lines.end - offsets.lower[1]).max(0);
            let to = (last - lines.start - offsets.lower[1] + 1).min(offsets.dims[1] as i64);
            if from < to {
                let range = offsets.range(offset as usize, from as usize, to as usize);
                reads.extend(addresses[range].iter().map(|&address| tile_address.wrapping_add(address)));
            }
        }
        reads.resize(reads.len().next_multiple_of(8), 0);
    }
}

/// Copies the overlaps of a plane that the query box wants.
fn store(
    query: &QueryBox,
    x: i64,
    ys: &Range<i64>,
    zs: &Range<i64>,
    sweep: &Sweep,
    source: &[i32],
    counts: &mut [u32],
) {
    let [qx, qy, qz] = query.dims;
    let [lx, ly, lz] = query.lower;
    if x < lx || x >= lx + qx as i64 {
        return;
    }
    let length = (zs.end - zs.start) as usize;
    // A difference upwards belongs to the next voxel.
    let step = |axis: Axis| i64::from(sweep.axis == axis && sweep.upwards);
    let (y0, z0) = (ys.start + step(Axis::Y), zs.start + step(Axis::Z));
    let (y1, z1) = (ys.end + step(Axis::Y), zs.end + step(Axis::Z));
    for y in y0.max(ly)..y1.min(ly + qy as i64) {
        let (from, to) = (z0.max(lz), z1.min(lz + qz as i64));
        if from >= to {
            continue;
        }
        let line = &source[(y - y0) as usize * length..][(from - z0) as usize..(to - z0) as usize];
        let row = (x - lx) as usize * qy + (y - ly) as usize;
        let target = &mut counts[row * qz + (from - lz) as usize..][..line.len()];
        for (count, &overlap) in target.iter_mut().zip(line) {
            *count = overlap as u32;
        }
    }
}

/// `total ± differences`: upwards a difference is added, downwards taken off.
fn add_up(total: &mut [i32], differences: &[i32], upwards: bool) {
    if upwards {
        total.iter_mut().zip(differences).for_each(|(t, d)| *t += d);
    } else {
        total.iter_mut().zip(differences).for_each(|(t, d)| *t -= d);
    }
}

/// Sums up the differences between lines.
fn sum_lines(plane: &mut [i32], length: usize, upwards: bool) {
    let lines = plane.len() / length;
    if upwards {
        for y in 1..lines {
            let (done, rest) = plane.split_at_mut(y * length);
            add_up(&mut rest[..length], &done[(y - 1) * length..], true);
        }
    } else {
        plane.iter_mut().for_each(|d| *d = -*d);
        for y in (0..lines.saturating_sub(1)).rev() {
            let (rest, done) = plane.split_at_mut((y + 1) * length);
            add_up(&mut rest[y * length..], &done[..length], true);
        }
    }
}

/// Sums up the differences along a line.
fn sum_line(line: &mut [i32], upwards: bool) {
    let mut total = 0;
    if upwards {
        for value in line {
            total += *value;
            *value = total;
        }
    } else {
        for value in line.iter_mut().rev() {
            total -= *value;
            *value = total;
        }
    }
}
