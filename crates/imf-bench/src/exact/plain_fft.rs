//! rustfft as one would use it: complex three-dimensional transforms padded to part and tool, nothing skipped.
//!
//! The obstacle's spectrum is computed once. A section is the tool's transform, the product and the way back; threads
//! share the sections. An array is transformed along its last axis and turned round, three times.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use imf_cli::session::Session;
use imf_core::tool::RotatedTool;
use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::{Rival, Trial};

struct Plain {
    size: [usize; 3],
    forward: [Arc<dyn Fft<f32>>; 3],
    inverse: [Arc<dyn Fft<f32>>; 3],
    spectrum: Vec<Complex32>,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    values: Vec<Complex32>,
    turned: Vec<Complex32>,
    fft: Vec<Complex32>,
}

pub(super) fn measure(session: &Session, trial: &Trial, ours: f64) -> Rival {
    let plain = Plain::new(trial);
    let sections = trial.tools.len();
    // The first section of each thread allocates; it is not measured.
    let pool_scratch = || (Scratch::default(), vec![0; trial.obstacle.grid.len()]);
    let equal = AtomicUsize::new(0);
    let threads = session.threads().min(sections);
    let seconds: f64 = (0..threads)
        .into_par_iter()
        .map(|thread| {
            let (mut scratch, mut counts) = pool_scratch();
            plain.section(trial, &trial.tools[thread], &mut scratch, &mut counts);
            let start = Instant::now();
            for index in (thread..sections).step_by(threads) {
                plain.section(trial, &trial.tools[index], &mut scratch, &mut counts);
                equal.fetch_add(usize::from(counts == trial.counts[index]), Ordering::Relaxed);
            }
            start.elapsed().as_secs_f64()
        })
        .sum();
    // Threads start and end together but for a section: their mean is the time of all.
    let each = seconds / threads as f64 / sections as f64;
    let [x, y, z] = plain.size;
    Rival {
        name: "rustfft".into(),
        sections,
        milliseconds_per_section: each * 1e3,
        ratio: each / ours,
        equal: Some(equal.into_inner() == sections),
        how: format!("complex f32, {x}×{y}×{z}, sections over {threads} threads"),
    }
}

#[cfg(test)]
pub(super) fn all_equal(trial: &Trial) -> bool {
    let plain = Plain::new(trial);
    let mut counts = vec![0; trial.obstacle.grid.len()];
    trial.tools.iter().zip(&trial.counts).all(|(tool, expected)| {
        plain.section(trial, tool, &mut Scratch::default(), &mut counts);
        counts == *expected
    })
}

impl Plain {
    fn new(trial: &Trial) -> Self {
        let size = trial.obstacle.grid.dims.map(|n| fast_length(n + trial.reach));
        let mut planner = FftPlanner::new();
        let mut plain = Self {
            size,
            forward: size.map(|n| planner.plan_fft_forward(n)),
            inverse: size.map(|n| planner.plan_fft_inverse(n)),
            spectrum: Vec::new(),
        };
        let mut scratch = Scratch::default();
        plain.place(&trial.obstacle.solid, trial.obstacle.grid.dims, [0; 3], &mut scratch);
        plain.transform(&plain.forward, [2, 1, 0], &mut scratch);
        let scale = 1.0 / size.iter().product::<usize>() as f32;
        plain.spectrum = scratch.values.iter().map(|value| value * scale).collect();
        plain
    }

    /// A box of voxels in a padded array of zeros; what lies below 0 wraps.
    fn place(&self, solid: &[u8], dims: [usize; 3], lower: [i32; 3], scratch: &mut Scratch) {
        let [nx, ny, nz] = self.size;
        scratch.values.clear();
        scratch.values.resize(nx * ny * nz, Complex32::ZERO);
        let wrap = |index: usize, axis: usize| {
            (index as i64 + i64::from(lower[axis])).rem_euclid(self.size[axis] as i64) as usize
        };
        for (row, line) in solid.chunks_exact(dims[2]).enumerate() {
            let from = (wrap(row / dims[1], 0) * ny + wrap(row % dims[1], 1)) * nz;
            for (z, _) in line.iter().enumerate().filter(|&(_, &solid)| solid != 0) {
                scratch.values[from + wrap(z, 2)].re = 1.0;
            }
        }
    }

    /// Transforms `values` along the three axes, last one first; each turn makes the next axis the last.
    fn transform(&self, plans: &[Arc<dyn Fft<f32>>; 3], axes: [usize; 3], scratch: &mut Scratch) {
        for axis in axes {
            let n = self.size[axis];
            scratch.fft.resize(plans[axis].get_inplace_scratch_len(), Complex32::ZERO);
            plans[axis].process_with_scratch(&mut scratch.values, &mut scratch.fft);
            scratch.turned.resize(scratch.values.len(), Complex32::ZERO);
            turn(&scratch.values, n, &mut scratch.turned);
            std::mem::swap(&mut scratch.values, &mut scratch.turned);
        }
    }

    fn section(&self, trial: &Trial, tool: &RotatedTool, scratch: &mut Scratch, counts: &mut [u32]) {
        self.place(&tool.solid, tool.dims, tool.lower, scratch);
        self.transform(&self.forward, [2, 1, 0], scratch);
        for (value, obstacle) in scratch.values.iter_mut().zip(&self.spectrum) {
            *value = obstacle * value.conj();
        }
        self.transform(&self.inverse, [2, 1, 0], scratch);
        let ([_, ny, nz], [_, qy, qz]) = (self.size, trial.obstacle.grid.dims);
        for (row, line) in counts.chunks_exact_mut(qz).enumerate() {
            let from = (row / qy * ny + row % qy) * nz;
            for (count, value) in line.iter_mut().zip(&scratch.values[from..]) {
                *count = value.re.round() as u32;
            }
        }
    }
}

/// `[m][n]` to `[n][m]`, in blocks that fit the cache.
fn turn(source: &[Complex32], n: usize, target: &mut [Complex32]) {
    const BLOCK: usize = 16;
    let m = source.len() / n;
    for rows in (0..m).step_by(BLOCK) {
        for columns in (0..n).step_by(BLOCK) {
            for column in columns..(columns + BLOCK).min(n) {
                for row in rows..(rows + BLOCK).min(m) {
                    target[column * m + row] = source[row * n + column];
                }
            }
        }
    }
}

/// The least product of 2, 3 and 5 that is at least `n`.
fn fast_length(n: usize) -> usize {
    let smooth = |&candidate: &usize| {
        [2, 3, 5].iter().fold(candidate, |mut rest, &prime| {
            while rest % prime == 0 {
                rest /= prime;
            }
            rest
        }) == 1
    };
    (n.max(1)..).find(smooth).unwrap_or(n)
}
