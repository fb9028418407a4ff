//! The coefficients of every voxel along the principal components, in f32 or f16.

use std::ops::Range;

use crate::parallel::*;
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use half::vec::HalfBitsVecExt as _;
use serde::{Deserialize, Serialize};

use imf_core::workspaces::Workspaces;

/// The precision in which coefficients are held, in memory and in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StoragePrecision {
    /// 4 bytes each.
    F32,
    /// 2 bytes each, 11 bits of mantissa: an error of 2.4e-4 of each coefficient.
    #[default]
    F16,
}

impl StoragePrecision {
    /// Bytes of a coefficient.
    #[must_use]
    pub const fn bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
        }
    }
}

/// Working memory for a block of voxels.
#[derive(Default)]
pub(super) struct BlockScratch {
    made_from: Vec<f32>,
    /// Before they are turned into halves.
    values: Vec<f32>,
}

/// Zeros of whole numbers, which the kernel hands out untouched: no thread writes them first.
fn zero_halves(count: usize) -> Vec<f16> {
    vec![0u16; count].reinterpret_into()
}

/// `[voxel][axis]`.
#[derive(Clone, Debug, PartialEq)]
pub enum Coefficients {
    /// In f32.
    F32(Vec<f32>),
    /// In f16.
    F16(Vec<f16>),
}

impl Coefficients {
    /// Converts values to a precision; f32 takes the array as it is.
    #[must_use]
    pub fn new(values: Vec<f32>, precision: StoragePrecision) -> Self {
        match precision {
            StoragePrecision::F32 => Self::F32(values),
            StoragePrecision::F16 => {
                let mut halves = zero_halves(values.len());
                halves.convert_from_f32_slice(&values);
                Self::F16(halves)
            }
        }
    }

    /// As many zeros.
    #[must_use]
    pub(super) fn zeros(count: usize, precision: StoragePrecision) -> Self {
        match precision {
            StoragePrecision::F32 => Self::F32(vec![0.0; count]),
            StoragePrecision::F16 => Self::F16(zero_halves(count)),
        }
    }

    /// Computes the coefficients of `voxels`, `components` per voxel, in blocks of up to `block` voxels on the threads of
    /// the current pool: `make(scratch, block_index, values)` fills the block's `[voxel][components]` values; `scratch` is
    /// reused from block to block.
    pub(super) fn fill_by_blocks(
        &mut self,
        voxels: Range<usize>,
        components: usize,
        block: usize,
        workspaces: &Workspaces<BlockScratch>,
        make: impl Fn(&mut Vec<f32>, usize, &mut [f32]) + Sync,
    ) {
        let own = voxels.start * components..voxels.end * components;
        match self {
            Self::F32(all) => {
                let blocks = all[own].par_chunks_mut(block * components).enumerate();
                blocks.for_each(|(index, values)| {
                    workspaces.with(|scratch| make(&mut scratch.made_from, index, values));
                });
            }
            Self::F16(all) => {
                let blocks = all[own].par_chunks_mut(block * components).enumerate();
                blocks.for_each(|(index, halves)| {
                    workspaces.with(|BlockScratch { made_from, values }| {
                        values.resize(block * components, 0.0);
                        let values = &mut values[..halves.len()];
                        make(made_from, index, values);
                        halves.convert_from_f32_slice(values);
                    });
                });
            }
        }
    }

    /// Their precision.
    pub fn precision(&self) -> StoragePrecision {
        match self {
            Self::F32(_) => StoragePrecision::F32,
            Self::F16(_) => StoragePrecision::F16,
        }
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F16(values) => values.len(),
        }
    }

    /// True without any.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads something of every line of memory of those from `from` to `to`, so that the lines come together and not one after another;
    /// the number says nothing.
    #[inline]
    pub(super) fn touch(&self, from: usize, to: usize) -> u32 {
        /// Bytes of a line.
        const LINE: usize = 64;
        match self {
            Self::F32(values) => {
                values[from..to].iter().step_by(LINE / 4).fold(0, |sum, value| sum ^ value.to_bits())
            }
            Self::F16(values) => {
                let lines = values[from..to].iter().step_by(LINE / 2);
                lines.fold(0, |sum, value| sum ^ u32::from(value.to_bits()))
            }
        }
    }

    /// Those from `from` to `to` as f32: where they lie, or turned into `scratch`.
    ///
    /// # Panics
    /// If the range sticks out.
    pub fn read<'a>(&'a self, from: usize, to: usize, scratch: &'a mut Vec<f32>) -> &'a [f32] {
        match self {
            Self::F32(values) => &values[from..to],
            Self::F16(values) => {
                scratch.resize(to - from, 0.0);
                values[from..to].convert_to_f32_slice(scratch);
                scratch
            }
        }
    }
}
