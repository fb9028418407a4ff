//! Sections and minima at any orientations by one blocked product, never storing the field.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::HarmonicField;
use crate::orientation::Orientation;
use crate::section::Imf;
use crate::siren::matrix::{Matrix, multiply};

/// Orientations as the field reads them: `Uᵀ b(R)` and `μ·b(R)` for each.
pub struct Heads {
    /// `[axes][orientation]`.
    along: Vec<f32>,
    /// `[orientation]`.
    constant: Vec<f32>,
}

impl Heads {
    /// Number of orientations.
    #[must_use]
    pub fn len(&self) -> usize {
        self.constant.len()
    }

    /// True without any.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.constant.is_empty()
    }
}

impl HarmonicField {
    /// Voxels of a block: its coefficients and a chunk's values stay in the inner caches.
    pub(super) const BLOCK: usize = 256;
    /// Orientations of a chunk.
    pub(super) const CHUNK: usize = 512;

    /// Prepares orientations.
    #[must_use]
    pub fn heads(&self, orientations: &[Orientation]) -> Heads {
        let (functions, axes) = (self.basis.len(), self.axis_count());
        let mut values = vec![0.0f32; functions * orientations.len()];
        values.par_chunks_mut(functions).zip(orientations).for_each_init(
            || vec![0.0; functions],
            |row, (out, orientation)| {
                self.basis.values(orientation, row);
                out.iter_mut().zip(row).for_each(|(out, &mut v)| *out = v as f32);
            },
        );
        let constant = values
            .par_chunks(functions)
            .map(|row| {
                row.iter().zip(&self.mean).map(|(&b, &m)| f64::from(b) * f64::from(m)).sum::<f64>() as f32
            })
            .collect();
        let mut along = vec![0.0; axes * orientations.len()];
        multiply(
            &mut along,
            orientations.len(),
            Matrix::row_major(&self.axes, functions, axes, axes).transposed(),
            Matrix::row_major(&values, orientations.len(), functions, functions).transposed(),
            false,
        );
        Heads { along, constant }
    }

    /// Values at the voxels of a block for the orientations of a range, `[voxel][orientation]`, not clipped.
    pub(super) fn block_values(
        &self,
        voxels: Range<usize>,
        heads: &Heads,
        chunk: Range<usize>,
        scratch: &mut Scratch,
    ) {
        let axes = self.axis_count();
        let (rows, columns) = (voxels.len(), chunk.len());
        let z = self.coefficients.read(voxels.start * axes, voxels.end * axes, &mut scratch.coefficients);
        scratch.values.resize(rows * columns, 0.0);
        for row in scratch.values.chunks_exact_mut(columns) {
            row.copy_from_slice(&heads.constant[chunk.clone()]);
        }
        multiply(
            &mut scratch.values,
            columns,
            Matrix::row_major(z, rows, axes, axes),
            Matrix::row_major(&heads.along[chunk.start..], axes, columns, heads.len()),
            true,
        );
    }

    /// The sections of some orientations, `[orientation][voxel]` into `sections`, in [0, 1].
    ///
    /// # Panics
    /// If `sections` has not that length.
    pub fn sections(&self, heads: &Heads, sections: &mut [f32]) {
        let voxels = self.grid.len();
        assert_eq!(sections.len(), voxels * heads.len(), "one value for each orientation and voxel");
        // The same array by blocks of voxels: one piece of each section.
        let blocks = voxels.div_ceil(Self::BLOCK);
        let mut pieces: Vec<Vec<&mut [f32]>> = (0..blocks).map(|_| Vec::with_capacity(heads.len())).collect();
        for section in sections.chunks_exact_mut(voxels) {
            for (block, piece) in section.chunks_mut(Self::BLOCK).enumerate() {
                pieces[block].push(piece);
            }
        }
        pieces.par_iter_mut().enumerate().for_each_init(Scratch::default, |scratch, (block, pieces)| {
            let from = block * Self::BLOCK;
            let range = from..(from + Self::BLOCK).min(voxels);
            for start in (0..heads.len()).step_by(Self::CHUNK) {
                let chunk = start..(start + Self::CHUNK).min(heads.len());
                self.block_values(range.clone(), heads, chunk.clone(), scratch);
                let columns = chunk.len();
                for (column, piece) in pieces[chunk].iter_mut().enumerate() {
                    let values = scratch.values[column..].iter().step_by(columns);
                    piece.iter_mut().zip(values).for_each(|(out, &value)| *out = value.clamp(0.0, 1.0));
                }
            }
        });
    }

    /// The least value over the orientations at every voxel, in [0, 1], with the first orientation that has it before
    /// clipping. Memory does not grow with the number of orientations but for [`Heads`].
    #[must_use]
    pub fn minimum(&self, heads: &Heads) -> Imf {
        let voxels = self.grid.len();
        let mut whole = Imf::new(voxels);
        let values = whole.value.par_chunks_mut(Self::BLOCK);
        values.zip(whole.best.par_chunks_mut(Self::BLOCK)).enumerate().for_each_init(
            Scratch::default,
            |scratch, (block, (least, best))| {
                let range = block * Self::BLOCK..block * Self::BLOCK + least.len();
                for start in (0..heads.len()).step_by(Self::CHUNK) {
                    let chunk = start..(start + Self::CHUNK).min(heads.len());
                    self.block_values(range.clone(), heads, chunk.clone(), scratch);
                    let rows = scratch.values.chunks_exact(chunk.len());
                    for ((least, best), row) in least.iter_mut().zip(best.iter_mut()).zip(rows) {
                        let lowest = scratch
                            .arch
                            .dispatch(|| row.iter().fold(f32::INFINITY, |a, &b| if b < a { b } else { a }));
                        if lowest < *least {
                            let place = row.iter().position(|&v| v == lowest).unwrap_or(0);
                            (*least, *best) = (lowest, (start + place) as u32);
                        }
                    }
                }
                least.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            },
        );
        whole
    }
}

/// Working memory of one thread.
pub(super) struct Scratch {
    pub(super) arch: Arch,
    coefficients: Vec<f32>,
    /// `[voxel][orientation]` of the block and chunk last computed.
    pub(super) values: Vec<f32>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self { arch: Arch::new(), coefficients: Vec::new(), values: Vec::new() }
    }
}
