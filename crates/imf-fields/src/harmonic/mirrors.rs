//! Mirror planes of fields: which coefficients are even and which are odd, and whether they are.

use rayon::prelude::*;

use super::HarmonicField;
use super::basis::Domain;
use super::coefficients::Coefficients;
use super::sphere::all_that_change_sign;
use imf_core::grid::Grid;

/// Which coefficients change their sign across which planes, or which planes lie between a voxel and its image: bit 0 for x, 1
/// for y, 2 for z.
pub(crate) type Parity = u8;
/// Parities there are.
pub(crate) const PARITIES: usize = 8;

/// The parity of the harmonics up to a degree across some planes, where the directions' numbers are in an order.
pub(crate) fn parities(degree: usize, across: [bool; 3], order: [usize; 3]) -> Vec<Parity> {
    let mut parities = vec![0; (degree + 1) * (degree + 1)];
    for axis in (0..3).filter(|&axis| across[axis]) {
        let odd = all_that_change_sign(degree, order.map(|other| other == axis));
        parities.iter_mut().zip(odd).for_each(|(parity, odd)| *parity |= u8::from(odd) << axis);
    }
    parities
}

/// The middle planes of a grid across which a field is its own image, and the parity of its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirrors {
    /// Every plane.
    pub(super) across: Parity,
    pub(super) parities: Vec<Parity>,
}

impl Mirrors {
    /// `None` where there is no plane. Parities are of these planes alone.
    pub(crate) fn new(across: [bool; 3], parities: Vec<Parity>) -> Option<Self> {
        let across = (0..3).map(|axis| u8::from(across[axis]) << axis).sum();
        (across != 0).then_some(Self { across, parities })
    }

    /// Those of a field's coefficients, to the bit, as a fit to one side leaves them.
    pub(super) fn of(field: &HarmonicField) -> Option<Self> {
        if field.basis.domain() != Domain::Directions {
            return None;
        }
        let of_axes = [0, 1, 2].map(|axis| {
            let odd = parities(field.basis.degree(), [0, 1, 2].map(|other| other == axis), [0, 1, 2]);
            of_axes(field, &odd).filter(|of_axes| is_mirrored(field, axis, of_axes))
        });
        let mut all = vec![0; field.axis_count()];
        for own in of_axes.iter().flatten() {
            all.iter_mut().zip(own).for_each(|(all, own)| *all |= own);
        }
        Self::new(of_axes.map(|own| own.is_some()), all)
    }
}

/// The parity of a field's axes across one plane, from that of its functions; `None` where an axis or the mean is of both.
fn of_axes(field: &HarmonicField, functions: &[Parity]) -> Option<Vec<Parity>> {
    let mut found = vec![None; field.axis_count()];
    for (row, &parity) in field.axes.chunks_exact(found.len()).zip(functions) {
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

/// Whether every voxel's coefficients are those of its image across a plane of the grid, but for the odd ones' sign.
fn is_mirrored(field: &HarmonicField, axis: usize, odd: &[Parity]) -> bool {
    let change = |sign: u32| odd.iter().map(|&odd| if odd == 0 { 0 } else { sign }).collect::<Vec<u32>>();
    match &field.coefficients {
        Coefficients::F32(values) => {
            let change = change(1 << 31);
            are_images(&field.grid, axis, values, odd.len(), |a, b| {
                let pairs = a.iter().zip(b).zip(&change);
                pairs.fold(0, |apart, ((a, b), change)| apart | (a.to_bits() ^ b.to_bits() ^ change)) == 0
            })
        }
        Coefficients::F16(values) => {
            let change: Vec<u16> = change(1 << 15).into_iter().map(|change| change as u16).collect();
            are_images(&field.grid, axis, values, odd.len(), |a, b| {
                let pairs = a.iter().zip(b).zip(&change);
                pairs.fold(0, |apart, ((a, b), change)| apart | (a.to_bits() ^ b.to_bits() ^ change)) == 0
            })
        }
    }
}

/// Whether `agree` holds for the coefficients of every voxel and of its image; false where the grid is one voxel thick.
fn are_images<T: Sync>(
    grid: &Grid,
    axis: usize,
    values: &[T],
    axes: usize,
    agree: impl Fn(&[T], &[T]) -> bool + Sync,
) -> bool {
    let [nx, ny, nz] = grid.dims;
    let own = |voxel: [usize; 3]| &values[grid.index(voxel) * axes..][..axes];
    grid.dims[axis] > 1
        && (0..nx).into_par_iter().all(|x| {
            (0..ny).all(|y| {
                (0..nz).all(|z| {
                    let voxel = [x, y, z];
                    let mut image = voxel;
                    image[axis] = grid.dims[axis] - 1 - image[axis];
                    image[axis] <= voxel[axis] || agree(own(voxel), own(image))
                })
            })
        })
}

#[cfg(test)]
mod tests {
    use super::super::FitSettings;
    use super::super::coefficients::Precision;
    use super::super::fit::mirrored::tests::{made, plan};
    use super::*;

    #[test]
    fn planes_are_those_across_which_every_coefficient_has_its_image() {
        for precision in [Precision::F32, Precision::F16] {
            let whole =
                made(&plan(1), &FitSettings { degree: 6, axes: 20, precision, ..FitSettings::default() });
            assert_eq!(Mirrors::of(&whole), None);
            let field =
                made(&plan(0), &FitSettings { degree: 6, axes: 20, precision, ..FitSettings::default() });
            // One coefficient of one voxel, off the plane across x or on it.
            for (x, expected) in [(3, None), (7, Some(0b001))] {
                let mut other = field.clone();
                let place = field.grid.index([x, 4, 5]) * 20 + 3;
                match &mut other.coefficients {
                    Coefficients::F32(values) => values[place] += 1e-3,
                    Coefficients::F16(values) => values[place] = half::f16::from_f32(0.125),
                }
                assert_eq!(Mirrors::of(&other).map(|mirrors| mirrors.across), expected, "{x}");
            }
            // An axis, or the mean, of even and odd functions.
            let (mut turned, mut shifted) = (field.clone(), field);
            turned.axes.iter_mut().step_by(20).for_each(|value| *value = 0.1);
            shifted.mean.fill(0.1);
            assert_eq!((Mirrors::of(&turned), Mirrors::of(&shifted)), (None, None));
        }
    }
}
