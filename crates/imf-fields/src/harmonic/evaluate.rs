//! Sections and minima at any orientations by one blocked product, never storing the field.

use std::ops::Range;

use crate::parallel::*;
use glam::DVec3;
use pulp::Arch;

use super::HarmonicField;
use super::basis::Basis;
use super::mirror::{Mirrors, one_side};
use crate::siren::matrix::{Matrix, multiply, product};
use imf_core::control::{Cancelled, Control};
use imf_core::field::FieldError;
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, Quantity};
use imf_core::vectorised::vectorised;

/// Orientations as the field reads them: `Uᵀ b(R)` and `μ·b(R)` for each.
pub struct DirectionWeights {
    /// `[components][orientation]`.
    along: Vec<f32>,
    /// `[orientation]`.
    constant: Vec<f32>,
}

impl DirectionWeights {
    /// Orientations for the functions of a basis, their `components` `[K][components]` and `mean` `[K]`.
    ///
    /// # Panics
    /// If there is not one mean and one row of axes for each function.
    #[must_use]
    pub fn new(basis: &Basis, components: &[f32], mean: &[f32], orientations: &[Orientation]) -> Self {
        let functions = basis.len();
        assert!(
            mean.len() == functions && components.len().is_multiple_of(functions),
            "a mean and a row for each function"
        );
        let width = components.len() / functions;
        let values = basis.values_at(orientations);
        let constant = values
            .par_chunks(functions)
            .map(|row| row.iter().zip(mean).map(|(&b, &m)| f64::from(b) * f64::from(m)).sum::<f64>() as f32)
            .collect();
        let along = product(
            Matrix::dense(components, width).transposed(),
            Matrix::dense(&values, functions).transposed(),
        );
        Self { along, constant }
    }

    /// Orientations for coefficients that are those of the functions themselves, of directions whose numbers are in an order.
    pub(crate) fn in_order(basis: &Basis, order: [usize; 3], orientations: &[Orientation]) -> Self {
        let (functions, count) = (basis.len(), orientations.len());
        let mut along = vec![0.0f32; functions * count];
        let mut row = vec![0.0; functions];
        for (place, orientation) in orientations.iter().enumerate() {
            let direction = orientation.direction();
            basis.values_of_direction(order.map(|axis| direction[axis]).into(), &mut row);
            along[place..].iter_mut().step_by(count).zip(&row).for_each(|(out, &value)| *out = value as f32);
        }
        Self { along, constant: vec![0.0; count] }
    }

    /// `Uᵀ b(R)` of every orientation: `[components][orientation]`.
    pub fn along(&self) -> &[f32] {
        &self.along
    }

    /// `μ·b(R)` of every orientation.
    pub fn constants(&self) -> &[f32] {
        &self.constant
    }

    /// The orientations in chunks whose values stay in the inner caches.
    pub(super) fn chunks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let count = self.len();
        (0..count).step_by(CHUNK).map(move |start| start..(start + CHUNK).min(count))
    }

    /// Values of some voxels, whose coefficients `z` are `[voxel][components]`, in the orientations of a chunk:
    /// `[voxel][orientation]`, not clipped.
    pub(super) fn values(&self, z: &[f32], components: usize, chunk: Range<usize>, values: &mut Vec<f32>) {
        let (rows, columns) = (z.len() / components, chunk.len());
        values.resize(rows * columns, 0.0);
        for row in values.chunks_exact_mut(columns) {
            row.copy_from_slice(&self.constant[chunk.clone()]);
        }
        let along = Matrix::row_major(&self.along[chunk.start..], components, columns, self.len());
        multiply(values, columns, Matrix::dense(z, components), along, true);
    }

    /// Number of orientations.
    pub fn len(&self) -> usize {
        self.constant.len()
    }

    /// True without any.
    pub fn is_empty(&self) -> bool {
        self.constant.is_empty()
    }
}

/// Where coefficients come from: an array, or a network.
pub trait VoxelCoefficients: Sync {
    /// Where the voxels are.
    fn grid(&self) -> &Grid;
    /// What the values are.
    fn quantity(&self) -> Quantity;
    /// Coefficients of a voxel.
    fn components(&self) -> usize;
    /// The planes across which they are their own mirror images, if finding them pays for this number of orientations.
    fn mirrors(&self, orientations: usize) -> Option<Mirrors>;
    /// `[voxel][components]` of a range: where they lie, or computed into `scratch`.
    fn read<'a>(&'a self, voxels: Range<usize>, scratch: &'a mut Vec<f32>) -> &'a [f32];
    /// `[point][components]` of up to a block's points, which lie in the box of the voxel centres; `scratch` is working memory.
    fn at(&self, points: &mut dyn Iterator<Item = DVec3>, z: &mut [f32], scratch: &mut Vec<f32>);
    /// Basis, U `[K][components]`, μ `[K]`; where there is an order of directions only the basis is of the world.
    fn functions(&self) -> (&Basis, &[f32], &[f32]);
    /// Where the coefficients are those of the functions themselves: the order that directions are to be brought in.
    fn order(&self) -> Option<[usize; 3]> {
        None
    }
    /// Prepares orientations.
    fn direction_weights(&self, orientations: &[Orientation]) -> DirectionWeights {
        let (basis, components, mean) = self.functions();
        match self.order() {
            None => DirectionWeights::new(basis, components, mean, orientations),
            Some(order) => DirectionWeights::in_order(basis, order, orientations),
        }
    }
}

/// Orientations of a chunk.
const CHUNK: usize = 512;
/// Orientations whose [`DirectionWeights`] are held at a time whatever their number: 57 MB of a field of degree 16.
pub const DIRECTIONS_AT_ONCE: usize = 1 << 14;
/// From this number of orientations on a field is searched for its mirror planes: a product with that many takes
/// several times as long.
pub(super) const MANY: usize = 100;
impl HarmonicField {
    /// Voxels of a block: its coefficients and a chunk's values stay in the inner caches.
    pub const BLOCK: usize = 256;

    /// Prepares orientations.
    pub fn direction_weights(&self, orientations: &[Orientation]) -> DirectionWeights {
        DirectionWeights::new(&self.basis, &self.components, &self.mean, orientations)
    }

    /// The sections of some orientations, `[orientation][voxel]` into `sections`; overlaps in [0, 1].
    ///
    /// # Panics
    /// If `sections` has not that length.
    pub fn sections(&self, weights: &DirectionWeights, sections: &mut [f32]) {
        sections_of(self, weights, sections);
    }

    /// The minimum over the orientations at every voxel, an overlap in [0, 1], with the first orientation that
    /// attains it before clipping. Memory does not grow with the number of orientations but for [`DirectionWeights`],
    /// and a copy of these where the field is its own mirror image.
    pub fn minimum(&self, weights: &DirectionWeights) -> Imf {
        minimum_of(self, weights)
    }
}

impl VoxelCoefficients for HarmonicField {
    fn quantity(&self) -> Quantity {
        self.quantity
    }

    fn grid(&self) -> &Grid {
        &self.grid
    }

    fn components(&self) -> usize {
        self.component_count()
    }

    fn mirrors(&self, orientations: usize) -> Option<Mirrors> {
        if orientations < MANY { None } else { Mirrors::of(self) }
    }

    fn read<'a>(&'a self, voxels: Range<usize>, scratch: &'a mut Vec<f32>) -> &'a [f32] {
        let components = self.component_count();
        self.coefficients.read(voxels.start * components, voxels.end * components, scratch)
    }

    fn at(&self, points: &mut dyn Iterator<Item = DVec3>, z: &mut [f32], scratch: &mut Vec<f32>) {
        for (point, z) in points.zip(z.chunks_exact_mut(self.component_count())) {
            // In the box there is a value; rounding far from the origin must not leave that of another point.
            if self.coefficients_at(point, z, scratch).is_none() {
                z.fill(f32::NAN);
            }
        }
    }

    fn functions(&self) -> (&Basis, &[f32], &[f32]) {
        (&self.basis, &self.components, &self.mean)
    }
}

/// [`HarmonicField::sections`] of coefficients from anywhere.
pub(crate) fn sections_of(source: &dyn VoxelCoefficients, weights: &DirectionWeights, sections: &mut [f32]) {
    assert_eq!(
        sections.len(),
        source.grid().len() * weights.len(),
        "one value for each orientation and voxel"
    );
    match source.mirrors(weights.len()) {
        Some(mirrors) => one_side::sections_of(source, &mirrors, weights, sections),
        None => whole_sections(source, weights, sections),
    }
}

/// [`HarmonicField::minimum`] of coefficients from anywhere.
pub(crate) fn minimum_of(source: &dyn VoxelCoefficients, weights: &DirectionWeights) -> Imf {
    let mut least = Imf::new(source.grid().len());
    lower_to(source, weights, 0, &mut least, Control::quiet());
    least.clamp(source.quantity(), source.grid().pitch);
    least
}

/// The same of any number of orientations, whose weights are made for some at a time. One unit of progress is one value.
pub(crate) fn minimum_over(
    source: &dyn VoxelCoefficients,
    orientations: &[Orientation],
    control: Control<'_>,
) -> Result<Imf, FieldError> {
    let mut least = Imf::new(source.grid().len());
    for (batch, orientations) in orientations.chunks(DIRECTIONS_AT_ONCE).enumerate() {
        let weights = source.direction_weights(orientations);
        if !lower_to(source, &weights, batch * DIRECTIONS_AT_ONCE, &mut least, control) {
            return Err(Cancelled.into());
        }
    }
    least.clamp(source.quantity(), source.grid().pitch);
    Ok(least)
}

/// Takes the values of some orientations, the first of which has a place in a longer list, into account, not clipped; `false` where
/// the control asked to stop before all was done.
fn lower_to(
    source: &dyn VoxelCoefficients,
    weights: &DirectionWeights,
    first: usize,
    least: &mut Imf,
    control: Control<'_>,
) -> bool {
    match source.mirrors(weights.len()) {
        Some(mirrors) => one_side::lower_to(source, &mirrors, weights, first, least, control),
        None => lower_to_whole(source, weights, first, least, control),
    }
}

/// [`sections_of`], voxel by voxel.
pub(super) fn whole_sections(
    source: &dyn VoxelCoefficients,
    weights: &DirectionWeights,
    sections: &mut [f32],
) {
    let (voxels, components) = (source.grid().len(), source.components());
    let (quantity, pitch) = (source.quantity(), source.grid().pitch);
    // The same array by blocks of voxels: one piece of each section.
    let blocks = voxels.div_ceil(HarmonicField::BLOCK);
    let mut pieces: Vec<Vec<&mut [f32]>> = (0..blocks).map(|_| Vec::with_capacity(weights.len())).collect();
    for section in sections.chunks_exact_mut(voxels) {
        for (block, piece) in section.chunks_mut(HarmonicField::BLOCK).enumerate() {
            pieces[block].push(piece);
        }
    }
    pieces.par_iter_mut().enumerate().for_each_init(Scratch::default, |scratch, (block, pieces)| {
        let Scratch { coefficients, values, .. } = scratch;
        let from = block * HarmonicField::BLOCK;
        let z = source.read(from..(from + HarmonicField::BLOCK).min(voxels), coefficients);
        for chunk in weights.chunks() {
            weights.values(z, components, chunk.clone(), values);
            let columns = chunk.len();
            for (column, piece) in pieces[chunk].iter_mut().enumerate() {
                let values = values[column..].iter().step_by(columns);
                piece.iter_mut().zip(values).for_each(|(out, &value)| *out = quantity.clamp(value, pitch));
            }
        }
    });
}

/// [`lower_to`], voxel by voxel.
pub(super) fn lower_to_whole(
    source: &dyn VoxelCoefficients,
    weights: &DirectionWeights,
    first: usize,
    least: &mut Imf,
    control: Control<'_>,
) -> bool {
    let components = source.components();
    let values = least.value.par_chunks_mut(HarmonicField::BLOCK);
    let blocks = values.zip(least.best.par_chunks_mut(HarmonicField::BLOCK)).enumerate();
    let done = |scratch: &mut Scratch, (block, (least, best)): (usize, (&mut [f32], &mut [u32]))| {
        if control.is_cancelled() {
            return false;
        }
        let Scratch { arch, coefficients, values } = scratch;
        let from = block * HarmonicField::BLOCK;
        let z = source.read(from..from + least.len(), coefficients);
        for chunk in weights.chunks() {
            weights.values(z, components, chunk.clone(), values);
            let rows = values.chunks_exact(chunk.len());
            for ((least, best), row) in least.iter_mut().zip(best.iter_mut()).zip(rows) {
                let lowest = vectorised!(arch, lowest(row));
                if lowest < *least {
                    let place = row.iter().position(|&v| v == lowest).unwrap_or(0);
                    (*least, *best) = (lowest, (first + chunk.start + place) as u32);
                }
            }
        }
        (control.progress)((least.len() * weights.len()) as u64);
        true
    };
    blocks.map_init(Scratch::default, done).all(|done| done)
}

/// The minimum of some values.
#[inline(always)]
pub(super) fn lowest(values: &[f32]) -> f32 {
    values.iter().fold(f32::INFINITY, |a, &b| if b < a { b } else { a })
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    pub arch: Arch,
    pub(super) coefficients: Vec<f32>,
    /// `[voxel][orientation]` of the block and chunk last computed.
    pub(super) values: Vec<f32>,
}
