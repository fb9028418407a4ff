//! Sections and minima of fields that are their own mirror images, computed on one side.
//!
//! The sum of the even terms and that of the odd ones are a voxel's value when added and its image's when subtracted. For k
//! planes the 2^k sums, one of each parity, have together as many terms as the value of one voxel, and serve 2^k voxels.
//! Networks are evaluated on one side alone.

use std::ops::Range;

use pulp::Arch;

use super::{Mirrors, PARITIES, Parity, Planes};
use crate::harmonic::HarmonicField;
use crate::harmonic::evaluate::{DirectionWeights, VoxelCoefficients, lowest};
use crate::parallel::*;
use crate::siren::matrix::{Matrix, multiply};
use imf_core::control::Control;
use imf_core::section::Imf;
use imf_core::vectorised::vectorised;

/// [`HarmonicField::sections`] of such a field.
pub(in crate::harmonic) fn sections_of(
    source: &dyn VoxelCoefficients,
    mirrors: &Mirrors,
    weights: &DirectionWeights,
    sections: &mut [f32],
) {
    let side = OneSide::new(source, mirrors, weights);
    let (count, quantity, pitch) = (weights.len(), source.quantity(), source.grid().pitch);
    let mut slabs: Vec<Vec<&mut [f32]>> =
        (0..side.planes.dims[0]).map(|_| Vec::with_capacity(count)).collect();
    for section in sections.chunks_exact_mut(source.grid().len()) {
        for (slab, piece) in section.chunks_exact_mut(side.slab()).enumerate() {
            slabs[slab].push(piece);
        }
    }
    side.paired(slabs).into_par_iter().enumerate().for_each_init(
        Scratch::default,
        |scratch, (x, mut pair)| {
            side.visit(x, scratch, |orientations, voxels, crossed, values| {
                let Some(sections) = &mut pair[usize::from(crossed & 1)] else { return };
                let columns = orientations.len();
                for (section, column) in sections[orientations].iter_mut().zip(0..) {
                    let values = values[column..].iter().step_by(columns);
                    for (voxel, &value) in voxels.clone().zip(values) {
                        if let Some(image) = side.image(voxel, crossed) {
                            section[image] = quantity.clamp(value, pitch);
                        }
                    }
                }
            });
        },
    );
}

/// Values and best orientations of the voxels with one x.
type Slab<'a> = (&'a mut [f32], &'a mut [u32]);

/// `lower_to` of such a field.
pub(in crate::harmonic) fn lower_to(
    source: &dyn VoxelCoefficients,
    mirrors: &Mirrors,
    weights: &DirectionWeights,
    first: usize,
    least: &mut Imf,
    control: Control<'_>,
) -> bool {
    let side = OneSide::new(source, mirrors, weights);
    let (slab, arch) = (side.slab(), Arch::new());
    let slabs = least.value.chunks_exact_mut(slab).zip(least.best.chunks_exact_mut(slab)).collect();
    let pairs = side.paired(slabs).into_par_iter().enumerate();
    let done = |scratch: &mut Scratch, (x, mut pair): (usize, [Option<Slab<'_>>; 2])| {
        if control.is_cancelled() {
            return false;
        }
        side.visit(x, scratch, |orientations, voxels, crossed, values| {
            let Some((least, best)) = &mut pair[usize::from(crossed & 1)] else { return };
            for (voxel, row) in voxels.zip(values.chunks_exact(orientations.len())) {
                let Some(image) = side.image(voxel, crossed) else { continue };
                let lowest = vectorised!(arch, lowest(row));
                if lowest < least[image] {
                    let place = row.iter().position(|&value| value == lowest).unwrap_or(0);
                    (least[image], best[image]) = (lowest, (first + orientations.start + place) as u32);
                }
            }
        });
        (control.progress)((slab * pair.iter().flatten().count() * weights.len()) as u64);
        true
    };
    pairs.map_init(Scratch::default, done).all(|done| done)
}

/// One side of a field, beside the orientations as it reads them.
struct OneSide<'a> {
    source: &'a dyn VoxelCoefficients,
    planes: Planes,
    /// The coefficients one parity after the other, and where each parity's begin and end.
    order: Vec<usize>,
    classes: [Range<usize>; PARITIES],
    /// `[coefficient in that order][orientation]`, and what is added to the even ones.
    along: Vec<f32>,
    weights: &'a DirectionWeights,
}

/// Working memory of one thread.
#[derive(Default)]
struct Scratch {
    arch: Arch,
    read: Vec<f32>,
    /// `[voxel][coefficient in order]`.
    ordered: Vec<f32>,
    /// `[voxel][orientation]` of every parity, then of every image.
    values: [Vec<f32>; PARITIES],
}

impl<'a> OneSide<'a> {
    fn new(source: &'a dyn VoxelCoefficients, mirrors: &Mirrors, weights: &'a DirectionWeights) -> Self {
        let mut order = Vec::with_capacity(mirrors.parities.len());
        let classes = std::array::from_fn(|class| {
            let start = order.len();
            let parities = mirrors.parities.iter().enumerate();
            let own = parities.filter(|&(_, &parity)| usize::from(parity) == class);
            order.extend(own.map(|(place, _)| place));
            start..order.len()
        });
        let count = weights.len();
        let mut along = vec![0.0; weights.along().len()];
        along.par_chunks_mut(count.max(1)).zip(&order).for_each(|(row, &place)| {
            row.copy_from_slice(&weights.along()[place * count..][..count]);
        });
        Self { source, planes: mirrors.planes, order, classes, along, weights }
    }

    /// Voxels with one x.
    fn slab(&self) -> usize {
        self.planes.dims[1] * self.planes.dims[2]
    }

    /// Of each x of the side its slab and that of its image, where that is another.
    fn paired<T>(&self, slabs: Vec<T>) -> Vec<[Option<T>; 2]> {
        let mut slabs: Vec<Option<T>> = slabs.into_iter().map(Some).collect();
        let planes = self.planes;
        (0..planes.side()[0])
            .map(|x| {
                let own = slabs[x].take();
                let image = planes.is_across(0).then(|| slabs[planes.dims[0] - 1 - x].take());
                [own, image.flatten()]
            })
            .collect()
    }

    /// The image of a voxel of a slab across planes along y and z; `None` where it is on one of them, its own image.
    fn image(&self, voxel: usize, crossed: Parity) -> Option<usize> {
        let [_, ny, nz] = self.planes.dims;
        let mut at = [voxel / nz, voxel % nz];
        for (axis, (at, n)) in at.iter_mut().zip([ny, nz]).enumerate() {
            if crossed >> (axis + 1) & 1 == 1 {
                let image = n - 1 - *at;
                if image == *at {
                    return None;
                }
                *at = image;
            }
        }
        Some(at[0] * nz + at[1])
    }

    /// Visits the values of all voxels of a slab of the side, and of their images, a chunk of orientations and a run of voxels at
    /// a time: `on_values(orientations, voxels, crossed, values)`, `values` being `[voxel][orientation]` of the images across what
    /// is crossed, and voxels those of the slab.
    fn visit(
        &self,
        x: usize,
        scratch: &mut Scratch,
        mut on_values: impl FnMut(Range<usize>, Range<usize>, Parity, &[f32]),
    ) {
        let ([_, ny, nz], whole) = (self.planes.side(), self.planes.dims[2]);
        // Runs of voxels that lie side by side.
        let (lines, length) = if nz == whole { (1, ny * nz) } else { (ny, nz) };
        for line in 0..lines {
            let first = line * whole;
            for start in (first..first + length).step_by(HarmonicField::BLOCK) {
                let voxels = start..(start + HarmonicField::BLOCK).min(first + length);
                self.read(x, &voxels, scratch);
                for chunk in self.weights.chunks() {
                    self.values(&voxels, &chunk, scratch);
                    for crossed in self.planes.choices() {
                        let values = &scratch.values[usize::from(crossed)];
                        on_values(chunk.clone(), voxels.clone(), crossed, values);
                    }
                }
            }
        }
    }

    /// The coefficients of some voxels of a slab, in order.
    fn read(&self, x: usize, voxels: &Range<usize>, scratch: &mut Scratch) {
        let Scratch { read, ordered, .. } = scratch;
        let first = x * self.slab();
        let z = self.source.read(first + voxels.start..first + voxels.end, read);
        ordered.resize(z.len(), 0.0);
        let components = self.order.len();
        for (row, z) in ordered.chunks_exact_mut(components).zip(z.chunks_exact(components)) {
            row.iter_mut().zip(&self.order).for_each(|(value, &place)| *value = z[place]);
        }
    }

    /// The values of what was read, of every image.
    fn values(&self, voxels: &Range<usize>, chunk: &Range<usize>, scratch: &mut Scratch) {
        let Scratch { arch, ordered, values, .. } = scratch;
        let (rows, columns, components) = (voxels.len(), chunk.len(), self.order.len());
        for class in self.planes.choices().map(usize::from) {
            let (own, values) = (self.classes[class].clone(), &mut values[class]);
            values.resize(rows * columns, 0.0);
            if class == 0 {
                let constants = &self.weights.constants()[chunk.clone()];
                values.chunks_exact_mut(columns).for_each(|row| row.copy_from_slice(constants));
            }
            if own.is_empty() {
                if class > 0 {
                    values.fill(0.0);
                }
                continue;
            }
            let along = &self.along[own.start * self.weights.len() + chunk.start..];
            let along = Matrix::row_major(along, own.len(), columns, self.weights.len());
            let z = Matrix::row_major(&ordered[own.start..], rows, own.len(), components);
            multiply(values, columns, z, along, class == 0);
        }
        // Sums and differences, plane by plane.
        for plane in (0..3).filter(|&axis| self.planes.is_across(axis)).map(|axis| 1 << axis) {
            for class in self.planes.choices().filter(|class| class & plane == 0) {
                let (near, far) = values.split_at_mut(usize::from(class | plane));
                let (near, far) = (&mut near[usize::from(class)][..], &mut far[0][..]);
                vectorised!(arch, add_and_subtract(near, far));
            }
        }
    }
}

/// `a + b` and `a − b` in the places of a and b.
#[inline(always)]
fn add_and_subtract(a: &mut [f32], b: &mut [f32]) {
    for (a, b) in a.iter_mut().zip(b) {
        (*a, *b) = (*a + *b, *a - *b);
    }
}
