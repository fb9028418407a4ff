//! Sections and minima of fields that are their own mirror images: what is computed on one side serves all sides.
//!
//! Across a middle plane of the grid each coefficient is even or odd: at a voxel's image it is the same, or the same with the
//! other sign. The sum of the even terms and that of the odd ones are then the voxel's value when added and its image's when
//! subtracted. For k planes the 2^k sums, one of each parity, have together as many terms as the value of one voxel, and serve
//! 2^k voxels: half the products for one plane, a quarter for two, an eighth for three. Networks are asked on one side alone.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::HarmonicField;
use super::evaluate::{DirectionWeights, VoxelCoefficients, lowest};
use super::mirrors::{Mirrors, PARITIES, Parity};
use crate::siren::matrix::{Matrix, multiply};
use imf_core::control::Control;
use imf_core::section::Imf;
use imf_core::vectorised::vectorised;

/// [`HarmonicField::sections`] of such a field.
pub(super) fn sections_of(
    source: &impl VoxelCoefficients,
    mirrors: &Mirrors,
    heads: &DirectionWeights,
    sections: &mut [f32],
) {
    let sides = Sides::new(source, mirrors, heads);
    let (count, quantity) = (heads.len(), source.quantity());
    let mut slabs: Vec<Vec<&mut [f32]>> = (0..sides.dims[0]).map(|_| Vec::with_capacity(count)).collect();
    for section in sections.chunks_exact_mut(source.voxels()) {
        for (slab, piece) in section.chunks_exact_mut(sides.slab()).enumerate() {
            slabs[slab].push(piece);
        }
    }
    sides.paired(slabs).into_par_iter().enumerate().for_each_init(
        Scratch::default,
        |scratch, (x, mut pair)| {
            sides.visit(x, scratch, |orientations, voxels, crossed, values| {
                let Some(sections) = &mut pair[usize::from(crossed & 1)] else { return };
                let columns = orientations.len();
                for (section, column) in sections[orientations].iter_mut().zip(0..) {
                    let values = values[column..].iter().step_by(columns);
                    for (voxel, &value) in voxels.clone().zip(values) {
                        if let Some(image) = sides.image(voxel, crossed) {
                            section[image] = quantity.held(value);
                        }
                    }
                }
            });
        },
    );
}

/// `lower_to` of such a field.
pub(super) fn lower_to(
    source: &impl VoxelCoefficients,
    mirrors: &Mirrors,
    heads: &DirectionWeights,
    first: usize,
    least: &mut Imf,
    control: Control<'_>,
) -> bool {
    let sides = Sides::new(source, mirrors, heads);
    let (slab, arch) = (sides.slab(), Arch::new());
    let slabs = least.value.chunks_exact_mut(slab).zip(least.best.chunks_exact_mut(slab)).collect();
    let pairs = sides.paired(slabs).into_par_iter().enumerate();
    let done = pairs.map_init(Scratch::default, |scratch, (x, mut pair)| {
        if control.is_cancelled() {
            return false;
        }
        sides.visit(x, scratch, |orientations, voxels, crossed, values| {
            let Some((least, best)) = &mut pair[usize::from(crossed & 1)] else { return };
            for (voxel, row) in voxels.zip(values.chunks_exact(orientations.len())) {
                let Some(image) = sides.image(voxel, crossed) else { continue };
                let lowest = vectorised!(arch, lowest(row));
                if lowest < least[image] {
                    let place = row.iter().position(|&value| value == lowest).unwrap_or(0);
                    (least[image], best[image]) = (lowest, (first + orientations.start + place) as u32);
                }
            }
        });
        (control.progress)((slab * pair.iter().flatten().count() * heads.len()) as u64);
        true
    });
    done.reduce(|| true, |a, b| a && b)
}

/// One side of a field, beside the orientations as it reads them.
struct Sides<'a, S> {
    source: &'a S,
    across: Parity,
    dims: [usize; 3],
    /// Voxels of one side along each axis, those on a plane among them.
    side: [usize; 3],
    /// The coefficients one parity after the other, and where each parity's begin and end.
    order: Vec<usize>,
    classes: [Range<usize>; PARITIES],
    /// `[coefficient in that order][orientation]`, and what is added to the even ones.
    along: Vec<f32>,
    heads: &'a DirectionWeights,
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

impl<'a, S: VoxelCoefficients> Sides<'a, S> {
    fn new(source: &'a S, mirrors: &Mirrors, heads: &'a DirectionWeights) -> Self {
        let (dims, across, count) = (source.dims(), mirrors.across, heads.len());
        let mut order = Vec::with_capacity(mirrors.parities.len());
        let classes = std::array::from_fn(|class| {
            let start = order.len();
            let own =
                mirrors.parities.iter().enumerate().filter(|&(_, &parity)| usize::from(parity) == class);
            order.extend(own.map(|(place, _)| place));
            start..order.len()
        });
        let mut along = vec![0.0; heads.along().len()];
        along.par_chunks_mut(count.max(1)).zip(&order).for_each(|(row, &place)| {
            row.copy_from_slice(&heads.along()[place * count..][..count]);
        });
        let side =
            [0, 1, 2].map(|axis| if across >> axis & 1 == 1 { dims[axis].div_ceil(2) } else { dims[axis] });
        Self { source, across, dims, side, order, classes, along, heads }
    }

    /// Voxels with one x.
    fn slab(&self) -> usize {
        self.dims[1] * self.dims[2]
    }

    /// Of each x of the side its slab and that of its image, where that is another.
    fn paired<T>(&self, slabs: Vec<T>) -> Vec<[Option<T>; 2]> {
        let mut slabs: Vec<Option<T>> = slabs.into_iter().map(Some).collect();
        (0..self.side[0])
            .map(|x| {
                let own = slabs[x].take();
                let image = if self.across & 1 == 1 { slabs[self.dims[0] - 1 - x].take() } else { None };
                [own, image]
            })
            .collect()
    }

    /// The image of a voxel of a slab across planes along y and z; `None` where it is on one of them, its own image.
    fn image(&self, voxel: usize, crossed: Parity) -> Option<usize> {
        let [_, ny, nz] = self.dims;
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

    /// Tells the values of all voxels of a slab of the side, and of their images, a chunk of orientations and a run of voxels at
    /// a time: `hear(orientations, voxels, crossed, values)`, `values` being `[voxel][orientation]` of the images across what
    /// is crossed, and voxels those of the slab.
    fn visit(
        &self,
        x: usize,
        scratch: &mut Scratch,
        mut hear: impl FnMut(Range<usize>, Range<usize>, Parity, &[f32]),
    ) {
        let [_, ny, nz] = self.side;
        // Runs of voxels that lie side by side.
        let (lines, length) = if nz == self.dims[2] { (1, ny * nz) } else { (ny, nz) };
        for line in 0..lines {
            let first = line * self.dims[2];
            for start in (first..first + length).step_by(HarmonicField::BLOCK) {
                let voxels = start..(start + HarmonicField::BLOCK).min(first + length);
                self.read(x, &voxels, scratch);
                for chunk in self.heads.chunks() {
                    self.values(&voxels, &chunk, scratch);
                    for crossed in self.images() {
                        hear(chunk.clone(), voxels.clone(), crossed, &scratch.values[usize::from(crossed)]);
                    }
                }
            }
        }
    }

    /// Every choice of planes.
    fn images(&self) -> impl Iterator<Item = Parity> + use<S> {
        let across = self.across;
        (0..PARITIES as Parity).filter(move |crossed| crossed & !across == 0)
    }

    /// The coefficients of some voxels of a slab, in order.
    fn read(&self, x: usize, voxels: &Range<usize>, scratch: &mut Scratch) {
        let Scratch { read, ordered, .. } = scratch;
        let first = x * self.slab();
        let z = self.source.read(first + voxels.start..first + voxels.end, read);
        ordered.resize(z.len(), 0.0);
        let axes = self.order.len();
        for (row, z) in ordered.chunks_exact_mut(axes).zip(z.chunks_exact(axes)) {
            row.iter_mut().zip(&self.order).for_each(|(value, &place)| *value = z[place]);
        }
    }

    /// The values of what was read, of every image.
    fn values(&self, voxels: &Range<usize>, chunk: &Range<usize>, scratch: &mut Scratch) {
        let Scratch { arch, ordered, values, .. } = scratch;
        let (rows, columns, axes) = (voxels.len(), chunk.len(), self.order.len());
        for class in self.images().map(usize::from) {
            let (own, values) = (self.classes[class].clone(), &mut values[class]);
            values.resize(rows * columns, 0.0);
            match class {
                0 => values
                    .chunks_exact_mut(columns)
                    .for_each(|row| row.copy_from_slice(&self.heads.constants()[chunk.clone()])),
                _ if own.is_empty() => values.fill(0.0),
                _ => {}
            }
            if own.is_empty() {
                continue;
            }
            multiply(
                values,
                columns,
                Matrix::row_major(&ordered[own.start..], rows, own.len(), axes),
                Matrix::row_major(
                    &self.along[own.start * self.heads.len() + chunk.start..],
                    own.len(),
                    columns,
                    self.heads.len(),
                ),
                class == 0,
            );
        }
        // Sums and differences, plane by plane.
        for plane in (0..3).map(|axis| 1 << axis).filter(|plane| self.across & plane != 0) {
            for class in self.images().filter(|class| class & plane == 0) {
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    use super::super::coefficients::Precision;
    use super::super::evaluate::{DIRECTIONS_AT_ONCE, MANY, lower_to_whole, whole_sections};
    use super::super::fit::mirrored::tests::{made, plan};
    use super::super::{
        FitSettings, minimum_of as found_minimum, minimum_over, sections_of as found_sections,
    };
    use super::*;
    use crate::fixtures::small_tool;
    use glam::DVec3;
    use imf_core::field::FieldError;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::orientation::{Orientation, OrientationSet};
    use imf_core::section::{At, SectionPlan};

    /// Mirrored across x, where a plane goes through voxels, and z, where one goes between.
    fn field(axes: usize, precision: Precision) -> HarmonicField {
        made(&plan(0), &FitSettings { degree: 6, axes, precision, ..FitSettings::default() })
    }

    /// One side's sums and every voxel's own.
    fn assert_agree(field: &HarmonicField, set: &[Orientation]) {
        let heads = field.direction_weights(set);
        let [mut found, mut expected] = [0, 1].map(|_| vec![f32::NAN; field.grid.len() * set.len()]);
        found_sections(field, &heads, &mut found);
        whole_sections(field, &heads, &mut expected);
        let apart = found.iter().zip(&expected).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        // Sums of up to 49 products in another order.
        assert!(apart < 2e-6, "{apart}");
        let (least, mut whole) = (found_minimum(field, &heads), Imf::new(field.grid.len()));
        assert!(lower_to_whole(field, &heads, 0, &mut whole, Control::quiet()));
        whole.hold(field.quantity);
        for voxel in 0..field.grid.len() {
            let value = least.value[voxel];
            assert!((value - whole.value[voxel]).abs() < 2e-6, "voxel {voxel}");
            assert_eq!(value, found[least.best[voxel] as usize * field.grid.len() + voxel]);
        }
    }

    #[test]
    fn what_one_side_tells_of_all_is_what_every_voxel_tells_of_itself() {
        let set = OrientationSet::parse("random:600:3").unwrap().orientations;
        for (axes, precision) in [(49, Precision::F32), (20, Precision::F32), (20, Precision::F16)] {
            let field = field(axes, precision);
            assert_eq!(Mirrors::of(&field).unwrap().across, 0b101);
            // Products of chunks of orientations, whole and cut.
            for count in [MANY, 600] {
                assert_agree(&field, &set[..count]);
            }
        }
    }

    #[test]
    fn a_minimum_tells_how_far_it_is_and_stops_when_asked() {
        let field = field(49, Precision::F32);
        let set = OrientationSet::parse("random:120:3").unwrap().orientations;
        // Voxel by voxel, and on one side.
        for count in [MANY - 1, set.len()] {
            let (done, stop) = (AtomicU64::new(0), AtomicBool::new(false));
            let progress = |voxels| {
                done.fetch_add(voxels, Ordering::Relaxed);
            };
            let control = Control { progress: &progress, cancelled: &stop };
            let minimum =
                |some: &[Orientation]| minimum_over(&field, |o| field.direction_weights(o), some, control);
            let found = minimum(&set[..count]).unwrap();
            assert_eq!(found, field.minimum(&field.direction_weights(&set[..count])));
            assert_eq!(done.swap(0, Ordering::Relaxed), (field.grid.len() * count) as u64);
            stop.store(true, Ordering::Relaxed);
            assert!(matches!(minimum(&set[..count]), Err(FieldError::Cancelled)));
            assert_eq!(done.load(Ordering::Relaxed), 0);
        }
    }

    #[test]
    fn more_orientations_than_are_held_at_a_time_have_the_least_of_all() {
        let field = field(9, Precision::F32);
        let set = OrientationSet::parse("random:16500:3").unwrap().orientations;
        let least =
            minimum_over(&field, |some| field.direction_weights(some), &set, Control::quiet()).unwrap();
        let together = field.minimum(&field.direction_weights(&set));
        let mut late = 0;
        for voxel in 0..field.grid.len() {
            // The last few are too few for one side to be worth while: other sums.
            assert!((least.value[voxel] - together.value[voxel]).abs() < 2e-6, "voxel {voxel}");
            late += usize::from(least.best[voxel] as usize >= DIRECTIONS_AT_ONCE);
        }
        assert!(late > 0, "none of the last orientations is the best anywhere");
    }

    #[test]
    fn three_planes_leave_an_eighth() {
        // Even and odd lengths.
        let dims = [8, 7, 10];
        let grid = Grid::with_dims(DVec3::ZERO, DVec3::new(8.0, 7.0, 10.0), dims, 0).unwrap();
        let mut cross = Occupancy::empty(grid);
        for place in 0..grid.len() {
            let [x, y, z] = grid.voxel(place);
            let inside = |from: usize, at: usize, n: usize| (from..n - from).contains(&at);
            let bar = inside(1, x, 8) && inside(3, y, 7) && inside(3, z, 10);
            cross.solid[place] = u8::from(bar || inside(3, x, 8) && inside(2, y, 7) && inside(4, z, 10));
        }
        let plan = SectionPlan::new(&cross, small_tool(), At::SharpPoints).unwrap();
        let settings =
            FitSettings { degree: 5, axes: 36, precision: Precision::F32, ..FitSettings::default() };
        let field = made(&plan, &settings);
        let mirrors = Mirrors::of(&field).unwrap();
        assert_eq!(mirrors.across, 0b111);
        assert!((0..8).all(|parity| mirrors.parities.contains(&parity)));
        assert_agree(&field, &OrientationSet::parse("random:150:3").unwrap().orientations);
    }
}
