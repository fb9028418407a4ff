//! Mirror symmetry: what is fitted or computed on one side of a middle plane of the grid serves both.
//!
//! Across a middle plane where all voxels are those of the other side, a tool of revolution overlaps with its tip at a point,
//! in a direction, as it does at the point's image in the direction's image. A real harmonic is even or odd across the plane,
//! so coefficients at a voxel's image are the same but for the odd ones' signs: half the work for one plane, a quarter for
//! two, an eighth for three. A fit solves for one side and unfolds it (`Planes::unfolded`); while it is unfolded, memory
//! holds the side's coefficients beside the whole field's. Depths and the minimum over other sharp points than the tip, whose
//! images stand elsewhere, are fitted whole. Sections and minima of such a field are computed on one side (`one_side`).

pub(super) mod one_side;

use std::ops::{BitOr, BitXor};

use bytemuck::cast_slice_mut;
use glam::DVec3;
use half::slice::HalfFloatSliceExt as _;

use super::HarmonicField;
use super::basis::{Basis, Domain};
use super::coefficients::Coefficients;
use super::sphere::all_that_change_sign;
use crate::parallel::*;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::section::{Quantity, SectionPlan};

/// Which coefficients change their sign across which planes, or which planes lie between a voxel and its image: bit 0 for x, 1
/// for y, 2 for z.
pub(crate) type Parity = u8;
/// Parities there are.
const PARITIES: usize = 8;

/// Middle planes of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Planes {
    across: Parity,
    dims: [usize; 3],
}

impl Planes {
    pub(crate) fn new(dims: [usize; 3], across: [bool; 3]) -> Self {
        let across = (0..3).map(|axis| u8::from(across[axis]) << axis).sum();
        Self { across, dims }
    }

    /// Those across which a plan's obstacle, the layer that the cutter may enter and all, is its own image; none for what is not
    /// fitted on one side.
    pub(super) fn of_plan(plan: &SectionPlan, domain: Domain, quantity: Quantity) -> Self {
        let obstacle = plan.obstacle();
        let can_be = domain == Domain::Directions
            && quantity.is_overlap()
            && plan.tip_alone()
            && plan.tool().is_axisymmetric()
            && plan.grid() == obstacle.grid();
        let holds = |axis| {
            can_be
                && is_mirrored(&obstacle.forbidden, axis)
                && obstacle.cuttable.as_ref().is_none_or(|layer| is_mirrored(layer, axis))
        };
        Self::new(plan.grid().dims, [0, 1, 2].map(holds))
    }

    fn is_across(self, axis: usize) -> bool {
        self.across >> axis & 1 == 1
    }

    /// True without any.
    pub(super) fn is_empty(self) -> bool {
        self.across == 0
    }

    /// Voxels of one side along each axis: half for each plane, with those on it.
    pub(super) fn side(self) -> [usize; 3] {
        [0, 1, 2].map(|axis| if self.is_across(axis) { self.dims[axis].div_ceil(2) } else { self.dims[axis] })
    }

    /// Every choice of planes, none of them first.
    pub(super) fn choices(self) -> impl Iterator<Item = Parity> {
        (0..PARITIES as Parity).filter(move |choice| choice & !self.across == 0)
    }

    /// The parity of the harmonics up to a degree across these planes, where the directions' numbers are in an order.
    pub(crate) fn parities(self, degree: usize, order: [usize; 3]) -> Vec<Parity> {
        let mut parities = vec![0; (degree + 1) * (degree + 1)];
        for axis in (0..3).filter(|&axis| self.is_across(axis)) {
            let odd = all_that_change_sign(degree, order.map(|other| other == axis));
            parities.iter_mut().zip(odd).for_each(|(parity, odd)| *parity |= u8::from(odd) << axis);
        }
        parities
    }

    /// The parity of every function of a basis.
    pub(super) fn parities_of(self, basis: &Basis) -> Vec<Parity> {
        match basis.domain() {
            Domain::Directions => self.parities(basis.degree(), [0, 1, 2]),
            Domain::Rotations => vec![0; basis.len()],
        }
    }

    /// The images of some orientations, which stand for these on the other sides.
    pub(super) fn images(self, orientations: &[Orientation]) -> Vec<Orientation> {
        let images = self.choices().skip(1).flat_map(|crossed| {
            let signs = [0, 1, 2].map(|axis| if crossed >> axis & 1 == 1 { -1.0 } else { 1.0 });
            orientations.iter().map(move |orientation| orientation.direction() * DVec3::from(signs))
        });
        images.filter_map(Orientation::from_direction).collect()
    }

    /// Coefficients over the whole grid from those over one side, along axes of these parities.
    pub(super) fn unfolded(self, side: Coefficients, parities: &[Parity]) -> Coefficients {
        if self.is_empty() {
            return side;
        }
        let count = self.dims.iter().product::<usize>() * parities.len();
        let mut whole = Coefficients::zeros(count, side.precision());
        match (&side, &mut whole) {
            (Coefficients::F32(side), Coefficients::F32(whole)) => {
                self.unfold(bytemuck::cast_slice(side), cast_slice_mut(whole), parities, 1_u32 << 31);
            }
            (Coefficients::F16(side), Coefficients::F16(whole)) => {
                self.unfold(side.reinterpret_cast(), whole.reinterpret_cast_mut(), parities, 1_u16 << 15);
            }
            _ => unreachable!("both have one precision"),
        }
        whole
    }

    /// The same of the bits of numbers, `sign` among them.
    fn unfold<B: Bits>(self, side: &[B], whole: &mut [B], parities: &[Parity], sign: B) {
        let [_, ny, nz] = self.dims;
        let (components, own) = (parities.len(), self.side());
        // What every axis takes on where these planes lie between.
        let signs: [Vec<B>; PARITIES] = std::array::from_fn(|crossed| {
            let is_odd = |parity: &Parity| (parity & crossed as Parity).count_ones() % 2 == 1;
            parities.iter().map(|parity| if is_odd(parity) { sign } else { B::default() }).collect()
        });
        whole.par_chunks_exact_mut(nz * components).enumerate().for_each(|(line, values)| {
            let (x, y) = (line / ny, line % ny);
            for (z, values) in values.chunks_exact_mut(components).enumerate() {
                let (mut voxel, mut crossed) = ([x, y, z], 0);
                for axis in 0..3 {
                    if voxel[axis] >= own[axis] {
                        voxel[axis] = self.dims[axis] - 1 - voxel[axis];
                        crossed |= 1 << axis;
                    }
                }
                let [x, y, z] = voxel;
                let from = &side[((x * own[1] + y) * own[2] + z) * components..][..components];
                for ((value, &from), &sign) in values.iter_mut().zip(from).zip(&signs[crossed]) {
                    *value = from ^ sign;
                }
            }
        });
    }
}

/// The bits of a number.
trait Bits: Copy + Default + PartialEq + BitOr<Output = Self> + BitXor<Output = Self> + Send + Sync {}
impl Bits for u16 {}
impl Bits for u32 {}

/// True where every voxel is as solid as its image across the grid's middle plane; false where the grid is one voxel thick.
fn is_mirrored(Occupancy { grid, solid }: &Occupancy, axis: usize) -> bool {
    let [nx, ny, nz] = grid.dims;
    let line = |x: usize, y: usize| &solid[(x * ny + y) * nz..][..nz];
    let lines = || (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y)));
    grid.dims[axis] > 1
        && match axis {
            0 => lines().all(|(x, y)| line(x, y) == line(nx - 1 - x, y)),
            1 => lines().all(|(x, y)| line(x, y) == line(x, ny - 1 - y)),
            _ => lines().all(|(x, y)| line(x, y).iter().eq(line(x, y).iter().rev())),
        }
}

/// Planes across which a field is its own image, and the parity of its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirrors {
    planes: Planes,
    parities: Vec<Parity>,
}

impl Mirrors {
    /// `None` where there is no plane. Parities are of these planes alone.
    pub(crate) fn new(planes: Planes, parities: Vec<Parity>) -> Option<Self> {
        (!planes.is_empty()).then_some(Self { planes, parities })
    }

    /// Those of a field's coefficients, to the bit, as a fit to one side leaves them.
    pub(super) fn of(field: &HarmonicField) -> Option<Self> {
        if field.basis.domain() != Domain::Directions {
            return None;
        }
        let mut parities = vec![0; field.component_count()];
        let across = [0, 1, 2].map(|axis| {
            let plane = Planes::new(field.grid.dims, [0, 1, 2].map(|other| other == axis));
            let functions = plane.parities_of(&field.basis);
            let of_components =
                parities_of_components(field, &functions).filter(|odd| are_images(field, axis, odd));
            let own = of_components.iter().flatten();
            parities.iter_mut().zip(own).for_each(|(parity, own)| *parity |= own);
            of_components.is_some()
        });
        Self::new(Planes::new(field.grid.dims, across), parities)
    }
}

/// The parity of a field's axes across one plane, from that of its functions; `None` where an axis or the mean is of both.
fn parities_of_components(field: &HarmonicField, functions: &[Parity]) -> Option<Vec<Parity>> {
    let mut found = vec![None; field.component_count()];
    for (row, &parity) in field.components.chunks_exact(found.len()).zip(functions) {
        for (found, _) in found.iter_mut().zip(row).filter(|&(_, &value)| value != 0.0) {
            if found.is_some_and(|found| found != parity) {
                return None;
            }
            *found = Some(parity);
        }
    }
    let even = field.mean.iter().zip(functions).all(|(&mean, &parity)| mean == 0.0 || parity == 0);
    even.then(|| found.into_iter().map(|parity| parity.unwrap_or(0)).collect())
}

/// Whether every voxel's coefficients are those of its image across a plane of the grid, but for the odd ones' sign; false where
/// the grid is one voxel thick.
fn are_images(field: &HarmonicField, axis: usize, odd: &[Parity]) -> bool {
    fn agree<B: Bits>(grid: &Grid, axis: usize, values: &[B], odd: &[Parity], sign: B) -> bool {
        let change: Vec<B> = odd.iter().map(|&odd| if odd == 0 { B::default() } else { sign }).collect();
        let own = |voxel: [usize; 3]| &values[grid.index(voxel) * odd.len()..][..odd.len()];
        (0..grid.len()).into_par_iter().all(|index| {
            let voxel = grid.voxel(index);
            let mut image = voxel;
            image[axis] = grid.dims[axis] - 1 - image[axis];
            let pairs = own(voxel).iter().zip(own(image)).zip(&change);
            image[axis] <= voxel[axis]
                || pairs.fold(B::default(), |apart, ((&a, &b), &change)| apart | (a ^ b ^ change))
                    == B::default()
        })
    }
    let grid = &field.grid;
    grid.dims[axis] > 1
        && match &field.coefficients {
            Coefficients::F32(values) => agree(grid, axis, bytemuck::cast_slice(values), odd, 1_u32 << 31),
            Coefficients::F16(values) => agree(grid, axis, values.reinterpret_cast(), odd, 1_u16 << 15),
        }
}

#[cfg(test)]
pub(super) mod tests;
