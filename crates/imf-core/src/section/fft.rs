//! Correlation of obstacle and tool by real FFTs, planned once, with empty and unread lines skipped.
//!
//! The half spectrum along z is cut into blocks of [`LANES`] wave numbers. Within a block everything that follows
//! is a plane transform: along y for the tool's own rows, along x and back with the product in between, back along
//! y for the rows that are read. A block's planes stay in the cache.
//!
//! ```text
//! tool [tx][ty][z] → r2c z → [block][tx][ty][lane] → y → [tx][ky][lane]
//!   → x → · obstacle [block][ky][lane][kx] → x⁻¹ → [qx][ky][lane] → y⁻¹ → [block][qx][qy][lane] → c2r z → counts
//! ```

use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use super::size::{CircularSize, Precision, QueryBox, VoxelBox};
use crate::occupancy::Occupancy;

/// Wave numbers along z that are transformed together: one cache line of complex f32.
const LANES: usize = 8;

/// Plans and the obstacle's spectrum.
pub(super) struct Convolver<T: Precision> {
    size: CircularSize,
    forward_z: Arc<dyn RealToComplex<T>>,
    inverse_z: Arc<dyn ComplexToReal<T>>,
    forward: [Arc<dyn Fft<T>>; 2],
    inverse: [Arc<dyn Fft<T>>; 2],
    /// `[block][ky][lane][kx]`, divided by the number of points.
    spectrum: Vec<Complex<T>>,
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch<T> {
    real: Vec<T>,
    half: Vec<Complex<T>>,
    input: Vec<Complex<T>>,
    output: Vec<Complex<T>>,
    columns: Vec<Complex<T>>,
    rows: Vec<Complex<T>>,
    lines: Vec<Complex<T>>,
    fft: Vec<Complex<T>>,
}

impl<T: Precision> Convolver<T> {
    pub(super) fn new(obstacle: &Occupancy, size: CircularSize) -> Self {
        let mut real = RealFftPlanner::new();
        let mut complex = FftPlanner::new();
        let [nx, ny, nz] = size.n;
        let mut convolver = Self {
            size,
            forward_z: real.plan_fft_forward(nz),
            inverse_z: real.plan_fft_inverse(nz),
            forward: [complex.plan_fft_forward(nx), complex.plan_fft_forward(ny)],
            inverse: [complex.plan_fft_inverse(nx), complex.plan_fft_inverse(ny)],
            spectrum: Vec::new(),
        };
        convolver.spectrum = convolver.obstacle_spectrum(obstacle);
        convolver
    }

    fn blocks(&self) -> usize {
        (self.size.n[2] / 2 + 1).div_ceil(LANES)
    }

    fn zero() -> Complex<T> {
        Complex::new(T::zero(), T::zero())
    }

    fn obstacle_spectrum(&self, obstacle: &Occupancy) -> Vec<Complex<T>> {
        let [nx, ny, _] = self.size.n;
        let mut scratch = Scratch::default();
        let solid = VoxelBox::of_obstacle(obstacle);
        self.transform_z(&solid, &mut scratch);
        let points = self.size.n.iter().map(|&n| n as f64).product::<f64>();
        let scale = T::from_f64(1.0 / points).unwrap_or_else(T::one);
        let mut spectrum = vec![Self::zero(); self.blocks() * ny * LANES * nx];
        for (block, out) in spectrum.chunks_exact_mut(ny * LANES * nx).enumerate() {
            self.transform_y(&solid, block, &mut scratch);
            for (ky, lines) in out.chunks_exact_mut(LANES * nx).enumerate() {
                self.gather_x(&solid, ky, &scratch.columns, lines);
                self.forward[0].process_with_scratch(lines, &mut scratch.fft);
                lines.iter_mut().for_each(|value| *value = *value * scale);
            }
        }
        spectrum
    }

    /// Correlates the obstacle with a tool: whole numbers over a query box, for which the size given to `new` holds,
    /// into `counts`. Returns the largest distance of an output from a whole number.
    pub(super) fn correlate(
        &self,
        tool: &VoxelBox<'_>,
        query: &QueryBox,
        scratch: &mut Scratch<T>,
        counts: &mut [u32],
    ) -> f64 {
        let [nx, ny, nz] = self.size.n;
        let [qx, qy, qz] = query.dims;
        self.transform_z(tool, scratch);
        let blocks = self.blocks();
        scratch.output.resize(blocks * qx * qy * LANES, Self::zero());
        for block in 0..blocks {
            self.transform_y(tool, block, scratch);
            let Scratch { columns, rows, lines, fft, output, .. } = scratch;
            rows.resize(qx * ny * LANES, Self::zero());
            lines.resize(LANES * nx.max(ny), Self::zero());
            for ky in 0..ny {
                let lines = &mut lines[..LANES * nx];
                self.gather_x(tool, ky, columns, lines);
                self.forward[0].process_with_scratch(lines, fft);
                let obstacle = &self.spectrum[(block * ny + ky) * LANES * nx..][..LANES * nx];
                for (value, &other) in lines.iter_mut().zip(obstacle) {
                    *value = other * value.conj();
                }
                self.inverse[0].process_with_scratch(lines, fft);
                for x in 0..qx {
                    let at = wrap(query.lower[0] + x as i64, nx);
                    let target = &mut rows[(x * ny + ky) * LANES..][..LANES];
                    for (lane, value) in target.iter_mut().enumerate() {
                        *value = lines[lane * nx + at];
                    }
                }
            }
            for x in 0..qx {
                let lines = &mut lines[..LANES * ny];
                for (ky, source) in rows[x * ny * LANES..][..ny * LANES].chunks_exact(LANES).enumerate() {
                    for (lane, &value) in source.iter().enumerate() {
                        lines[lane * ny + ky] = value;
                    }
                }
                self.inverse[1].process_with_scratch(lines, fft);
                for y in 0..qy {
                    let at = wrap(query.lower[1] + y as i64, ny);
                    let target = &mut output[((block * qx + x) * qy + y) * LANES..][..LANES];
                    for (lane, value) in target.iter_mut().enumerate() {
                        *value = lines[lane * ny + at];
                    }
                }
            }
        }
        let mut worst = 0.0f64;
        let Scratch { real, half, fft, output, .. } = scratch;
        for row in 0..qx * qy {
            half.resize(blocks * LANES, Self::zero());
            for block in 0..blocks {
                half[block * LANES..][..LANES]
                    .copy_from_slice(&output[(block * qx * qy + row) * LANES..][..LANES]);
            }
            let half = &mut half[..nz / 2 + 1];
            // Real up to rounding; the transform insists.
            half[0].im = T::zero();
            half[nz / 2].im = T::zero();
            let done = self.inverse_z.process_with_scratch(half, &mut real[..nz], fft);
            debug_assert!(done.is_ok(), "buffer lengths are the plan's");
            for (z, count) in counts[row * qz..][..qz].iter_mut().enumerate() {
                let value: f64 = real[wrap(query.lower[2] + z as i64, nz)].into();
                let rounded = value.round();
                worst = worst.max((value - rounded).abs());
                *count = rounded.max(0.0) as u32;
            }
        }
        worst
    }

    /// r2c along z of the non-empty lines into `scratch.input [block][tx][ty][lane]`.
    fn transform_z(&self, solid: &VoxelBox<'_>, scratch: &mut Scratch<T>) {
        let nz = self.size.n[2];
        let [tx, ty, _] = solid.dims;
        let blocks = self.blocks();
        let plans = [&self.forward[0], &self.forward[1], &self.inverse[0], &self.inverse[1]];
        let complex = plans.iter().map(|plan| plan.get_inplace_scratch_len()).max().unwrap_or(0);
        let longest = complex.max(self.forward_z.get_scratch_len()).max(self.inverse_z.get_scratch_len());
        scratch.fft.resize(longest, Self::zero());
        scratch.real.resize(nz, T::zero());
        scratch.half.resize(blocks * LANES, Self::zero());
        scratch.input.clear();
        scratch.input.resize(blocks * tx * ty * LANES, Self::zero());
        for row in 0..tx * ty {
            let line = solid.line(row / ty, row % ty);
            if line.iter().all(|&s| s == 0) {
                continue;
            }
            scratch.real.fill(T::zero());
            for (z, _) in line.iter().enumerate().filter(|&(_, &s)| s != 0) {
                scratch.real[wrap(solid.lower[2] + z as i64, nz)] = T::one();
            }
            scratch.half[nz / 2 + 1..].fill(Self::zero());
            let half = &mut scratch.half[..nz / 2 + 1];
            let done = self.forward_z.process_with_scratch(&mut scratch.real, half, &mut scratch.fft);
            debug_assert!(done.is_ok(), "buffer lengths are the plan's");
            for block in 0..blocks {
                let target = &mut scratch.input[(block * tx * ty + row) * LANES..][..LANES];
                target.copy_from_slice(&scratch.half[block * LANES..][..LANES]);
            }
        }
    }

    /// FFT along y of one block into `scratch.columns [tx][ky][lane]`.
    fn transform_y(&self, solid: &VoxelBox<'_>, block: usize, scratch: &mut Scratch<T>) {
        let [nx, ny, _] = self.size.n;
        let [tx, ty, _] = solid.dims;
        scratch.columns.resize(tx * ny * LANES, Self::zero());
        scratch.lines.resize(LANES * nx.max(ny), Self::zero());
        let lines = &mut scratch.lines[..LANES * ny];
        for x in 0..tx {
            lines.fill(Self::zero());
            let source = &scratch.input[(block * tx + x) * ty * LANES..][..ty * LANES];
            for (y, values) in source.chunks_exact(LANES).enumerate() {
                let at = wrap(solid.lower[1] + y as i64, ny);
                for (lane, &value) in values.iter().enumerate() {
                    lines[lane * ny + at] = value;
                }
            }
            self.forward[1].process_with_scratch(lines, &mut scratch.fft);
            let target = &mut scratch.columns[x * ny * LANES..][..ny * LANES];
            for (ky, values) in target.chunks_exact_mut(LANES).enumerate() {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = lines[lane * ny + ky];
                }
            }
        }
    }

    /// The lines along x of one block and wave number ky into `lines [lane][nx]`.
    fn gather_x(&self, solid: &VoxelBox<'_>, ky: usize, columns: &[Complex<T>], lines: &mut [Complex<T>]) {
        let [nx, ny, _] = self.size.n;
        lines.fill(Self::zero());
        for x in 0..solid.dims[0] {
            let at = wrap(solid.lower[0] + x as i64, nx);
            for (lane, &value) in columns[(x * ny + ky) * LANES..][..LANES].iter().enumerate() {
                lines[lane * nx + at] = value;
            }
        }
    }
}

/// Position on a circle of `n` points.
fn wrap(index: i64, n: usize) -> usize {
    index.rem_euclid(n as i64) as usize
}
