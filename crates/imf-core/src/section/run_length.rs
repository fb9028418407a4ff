//! Run-length difference counting: stepping the tool by a voxel changes the overlap by what its run boundaries cover and uncover.
//!
//! Far enough along the axis the tool has left the obstacle and its overlap is zero; from there the differences are
//! summed up. All is whole numbers, so nothing is rounded. The sums over run boundaries are taken for thousands of voxels
//! at once (`bit_sliced`), from the obstacle's bits (`bit_obstacle`).

use std::ops::Range;

use pulp::Arch;

use super::bit_obstacle::BitObstacle;
use super::bit_sliced::{DIGITS, Digits, TILE_BITS, add, spread, subtract};
use super::run_boundaries::{Axis, ByLine, RunBoundaries};
use super::size::{CircularSize, QueryBox, VoxelBox};
use super::sweep::Sweep;
use crate::occupancy::Occupancy;
use crate::vectorised::vectorised;

/// The obstacle prepared for tools and query boxes of one size.
pub(super) struct RunLengthCounter {
    arch: Arch,
    obstacle: BitObstacle,
}

/// State of a count that advances plane by plane through a query box.
#[derive(Clone, Default)]
pub(super) struct Cursor {
    /// `None` where the tool meets nothing.
    sweep: Option<Sweep>,
    /// Addresses at which is read what steps cover and what they uncover, relative to a tile's; they wrap.
    addresses: [ByLine<u32>; 2],
    /// Plane along x whose differences are taken next, where the tool is stepped along x.
    next: i64,
    /// Overlaps of the plane before, where the tool is stepped along x.
    previous: Vec<i32>,
}

impl Cursor {
    /// Bytes of one, by estimate.
    pub(super) fn memory(tool: &VoxelBox<'_>, query: &QueryBox) -> u64 {
        let [_, ny, nz] = query.dims;
        let ends = RunBoundaries::count(tool).into_iter().max().unwrap_or(0);
        let table = 2 * (tool.dims[0] + 1) * (tool.dims[1] + 1);
        4 * (table + 2 * ends + ny * nz) as u64
    }
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    ends: RunBoundaries,
    /// Addresses that one tile reads.
    reads: Vec<u32>,
    digits: Box<[Digits; 2]>,
    /// Differences of one plane, then overlaps.
    plane: Vec<i32>,
}

impl RunLengthCounter {
    pub(super) fn new(arch: Arch, obstacle: &Occupancy, size: &CircularSize) -> Self {
        Self { arch, obstacle: BitObstacle::new(obstacle, size) }
    }

    /// Puts a tool before the first plane of a query box. Where planes are taken one after the other, the sweep is one of
    /// [`Order::PlanesUpwards`](super::sweep::Order::PlanesUpwards).
    pub(super) fn start(
        &self,
        tool: &VoxelBox<'_>,
        sweep: Sweep,
        scratch: &mut Scratch,
        cursor: &mut Cursor,
    ) {
        cursor.sweep = (tool.dims[0] > 0 && sweep.steps() > 0).then_some(sweep);
        if cursor.sweep.is_none() {
            return;
        }
        let ends = &mut scratch.ends;
        ends.collect(tool, sweep.axis);
        for (addresses, offsets) in cursor.addresses.iter_mut().zip([&ends.covered, &ends.uncovered]) {
            offsets.map_into(addresses, |offset| self.obstacle.offset_address(offset) as u32);
        }
        cursor.next = i64::MIN;
        cursor.previous.clear();
    }

    /// Overlaps over the next planes of the query box into `counts`: planes upwards from one
    /// call to the next, or all at once.
    pub(super) fn advance(
        &self,
        cursor: &mut Cursor,
        query: &QueryBox,
        planes: Range<i64>,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) {
        counts.fill(0);
        let Some(sweep) = cursor.sweep else { return };
        let [xs, ys, zs] = Axis::ALL.map(|axis| sweep.range(axis, query));
        let lines = (ys.end - ys.start) as usize;
        let length = (zs.end - zs.start) as usize;
        scratch.plane.resize(lines * length, 0);
        let along_x = sweep.axis == Axis::X;
        // A difference upwards leads to the next plane.
        let ahead = i64::from(along_x && sweep.upwards);
        let xs = if along_x && sweep.upwards {
            cursor.next.max(xs.start)..xs.end.min(planes.end - ahead)
        } else if along_x {
            xs
        } else {
            planes.clone()
        };
        cursor.next = xs.end.max(cursor.next);
        if along_x {
            cursor.previous.resize(lines * length, 0);
        }
        let mut window = *query;
        (window.lower[0], window.dims[0]) = (planes.start, (planes.end - planes.start) as usize);
        for step in 0..(xs.end - xs.start).max(0) {
            let x = if along_x && !sweep.upwards { xs.end - 1 - step } else { xs.start + step };
            self.differences(x, &ys, &zs, &cursor.addresses, scratch);
            let (plane, previous) = (&mut scratch.plane, &mut cursor.previous);
            vectorised!(self.arch, {
                match sweep.axis {
                    Axis::X => add_up(previous, plane, sweep.upwards),
                    Axis::Y => sum_lines(plane, length, sweep.upwards),
                    Axis::Z => {
                        plane.chunks_exact_mut(length).for_each(|line| sum_line(line, sweep.upwards));
                    }
                }
                let source = if along_x { &*previous } else { &*plane };
                store(&window, x + ahead, &ys, &zs, &sweep, source, counts);
            });
        }
    }

    /// Differences at plane x over `ys × zs` into `scratch.plane`.
    fn differences(
        &self,
        x: i64,
        ys: &Range<i64>,
        zs: &Range<i64>,
        addresses: &[ByLine<u32>; 2],
        scratch: &mut Scratch,
    ) {
        let line = self.obstacle.line_bits;
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
            let Scratch { reads, digits, .. } = scratch;
            for ((addresses, digits), used) in addresses.iter().zip(digits.iter_mut()).zip(&mut used) {
                self.reads_of(addresses, x, top..bottom, tile_address, reads);
                // Digits beyond those of this tile are never read.
                let most = (usize::BITS - reads.len().leading_zeros()) as usize;
                digits[..most.clamp(5, DIGITS)].fill([0; TILE_BITS / 64]);
                if !reads.is_empty() {
                    *used = add(self.arch, &self.obstacle.bytes, reads, digits);
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
        addresses: &ByLine<u32>,
        x: i64,
        lines: Range<i64>,
        tile_address: u32,
        reads: &mut Vec<u32>,
    ) {
        reads.clear();
        let ([first_x, first_y], [planes, all_lines]) = (addresses.lower, addresses.dims);
        // Planes that are inside the obstacle's grid.
        let low = (-x - first_x).max(0);
        let high = (self.obstacle.dims[0] as i64 - x - first_x).min(planes as i64);
        for offset in low..high {
            let Some([first, last]) = self.obstacle.solid_lines[(x + first_x + offset) as usize] else {
                continue;
            };
            let from = (first - lines.end - first_y).max(0);
            let to = (last - lines.start - first_y + 1).min(all_lines as i64);
            if from < to {
                let addresses = addresses.lines(offset as usize, from as usize, to as usize);
                reads.extend(addresses.iter().map(|&address| tile_address.wrapping_add(address)));
            }
        }
        reads.resize(reads.len().next_multiple_of(8), 0);
    }
}

/// Copies the overlaps of a plane that the query box wants.
#[inline(always)]
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
#[inline(always)]
fn add_up(total: &mut [i32], differences: &[i32], upwards: bool) {
    if upwards {
        total.iter_mut().zip(differences).for_each(|(t, d)| *t += d);
    } else {
        total.iter_mut().zip(differences).for_each(|(t, d)| *t -= d);
    }
}

/// Sums up the differences between lines.
#[inline(always)]
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
#[inline(always)]
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
