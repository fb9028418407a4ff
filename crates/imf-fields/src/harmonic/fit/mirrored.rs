//! Obstacles that are their own mirror images, fitted on one side alone.
//!
//! Across a middle plane of the grid where all voxels are those of the other side, a tool of revolution overlaps with its tip
//! at a point, in a direction, as it does at the point's image in the direction's image. A real harmonic is even or odd
//! across the plane. So sections are counted and coefficients solved for on one side, and those of the other side are
//! the same but for the odd functions' signs: half the work for one plane, a quarter for two, an eighth for three. While it is
//! unfolded, memory holds the side's coefficients beside the whole field's. Depths and the least over other sharp points
//! than the tip, whose images stand elsewhere, are fitted whole.
//!
//! Axes are then even or odd themselves: the covariance over both sides has nothing between even and odd functions, and the
//! mean nothing of the odd ones (voxels on the plane, which are their own images, are taken for either side's).

use glam::DVec3;
use half::slice::HalfFloatSliceExt as _;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::solve::Solved;
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::Coefficients;
use crate::harmonic::mirrors::{PARITIES, Parity, parities};
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::section::{Quantity, SectionError, SectionPlan};

/// The middle planes of a grid across which what is fitted is its own image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mirrored {
    whole: Grid,
    across: [bool; 3],
}

impl Mirrored {
    /// Those of a plan's obstacle, skin and all.
    pub(super) fn of(plan: &SectionPlan, domain: Domain, quantity: Quantity) -> Self {
        let whole = *plan.grid();
        let can_be = domain == Domain::Directions
            && quantity.is_overlap()
            && plan.tip_alone()
            && plan.tool().is_axisymmetric()
            && whole == *plan.obstacle().grid();
        let holds = |axis| {
            can_be
                && is_mirrored(&plan.obstacle().forbidden, axis)
                && plan.obstacle().cuttable.as_ref().is_none_or(|layer| is_mirrored(layer, axis))
        };
        Self { whole, across: [0, 1, 2].map(holds) }
    }

    /// The voxels that are fitted: half of the grid for each plane, with the voxels on it.
    pub(super) fn side(&self) -> Grid {
        let dims = [0, 1, 2].map(|axis| self.side_length(axis));
        Grid { dims, ..self.whole }
    }

    fn side_length(&self, axis: usize) -> usize {
        let length = self.whole.dims[axis];
        if self.across[axis] { length.div_ceil(2) } else { length }
    }

    /// A plan of the same sections over [`Mirrored::side`]; `None` where that is the whole grid.
    pub(super) fn plan(&self, plan: &SectionPlan) -> Result<Option<SectionPlan>, SectionError> {
        self.across.contains(&true).then(|| plan.over(&self.side())).transpose()
    }

    /// The parity of every function.
    pub(super) fn parities(&self, basis: &Basis) -> Vec<Parity> {
        match basis.domain() {
            Domain::Directions => parities(basis.degree(), self.across, [0, 1, 2]),
            Domain::Rotations => vec![0; basis.len()],
        }
    }

    /// What stands for some orientations on the other side, or on the other sides: their images, which are none where nothing is
    /// mirrored.
    pub(super) fn images(&self, orientations: &[Orientation]) -> Vec<Orientation> {
        let sides =
            (1..PARITIES).filter(|side| (0..3).all(|axis| side >> axis & 1 == 0 || self.across[axis]));
        let images = sides.flat_map(|side| {
            let signs = [0, 1, 2].map(|axis| if side >> axis & 1 == 1 { -1.0 } else { 1.0 });
            orientations.iter().map(move |orientation| orientation.direction() * DVec3::from(signs))
        });
        images.filter_map(Orientation::from_direction).collect()
    }

    /// Coefficients over the whole grid from those over [`Mirrored::side`], along axes of these parities.
    pub(super) fn unfolded(&self, side: Coefficients, parities: &[Parity]) -> Coefficients {
        if !self.across.contains(&true) {
            return side;
        }
        let mut whole = Coefficients::zeros(self.whole.len() * parities.len(), side.precision());
        match (&side, &mut whole) {
            (Coefficients::F32(side), Coefficients::F32(whole)) => {
                self.unfold(side, whole, parities, 1 << 31, |value, sign: u32| {
                    f32::from_bits(value.to_bits() ^ sign)
                });
            }
            (Coefficients::F16(side), Coefficients::F16(whole)) => {
                let (side, whole) = (side.reinterpret_cast(), whole.reinterpret_cast_mut());
                self.unfold(side, whole, parities, 1 << 15, |value, sign: u16| value ^ sign);
            }
            _ => unreachable!("both have one precision"),
        }
        whole
    }

    /// The same for values of a type whose sign is changed by `sign` in `with`.
    fn unfold<T: Copy + Send + Sync, S: Copy + Default + Sync>(
        &self,
        side: &[T],
        whole: &mut [T],
        parities: &[Parity],
        sign: S,
        with: impl Fn(T, S) -> T + Sync,
    ) {
        let [_, ny, nz] = self.whole.dims;
        let (axes, own) = (parities.len(), self.side());
        // What every axis takes on where these planes lie between.
        let signs: [Vec<S>; PARITIES] = std::array::from_fn(|crossed| {
            let is_odd = |parity: &Parity| (parity & crossed as Parity).count_ones() % 2 == 1;
            parities.iter().map(|parity| if is_odd(parity) { sign } else { S::default() }).collect()
        });
        whole.par_chunks_exact_mut(nz * axes).enumerate().for_each(|(line, values)| {
            let (x, y) = (line / ny, line % ny);
            for (z, values) in values.chunks_exact_mut(axes).enumerate() {
                let (mut voxel, mut crossed) = ([x, y, z], 0);
                for axis in 0..3 {
                    if voxel[axis] >= own.dims[axis] {
                        voxel[axis] = self.whole.dims[axis] - 1 - voxel[axis];
                        crossed |= 1 << axis;
                    }
                }
                let from = &side[own.index(voxel) * axes..][..axes];
                for ((value, &from), &sign) in values.iter_mut().zip(from).zip(&signs[crossed]) {
                    *value = with(from, sign);
                }
            }
        });
    }
}

impl Solved {
    /// What a sample of one side tells of both.
    pub(super) fn of_both_sides(mut self, parities: &[Parity]) -> Self {
        if parities.iter().all(|&parity| parity == 0) {
            return self;
        }
        let both = keep_even(&self.mean, parities);
        self.covariance += &self.mean * self.mean.transpose() - &both * both.transpose();
        for ((row, column), value) in entries(&mut self.covariance) {
            if parities[row] != parities[column] {
                *value = 0.0;
            }
        }
        self.mean = both;
        self
    }
}

/// The mean over both sides, from that over one.
pub(super) fn keep_even(mean: &DVector<f64>, parities: &[Parity]) -> DVector<f64> {
    let both = mean.iter().zip(parities).map(|(&mean, &parity)| if parity == 0 { mean } else { 0.0 });
    DVector::from_iterator(mean.len(), both)
}

fn entries(matrix: &mut DMatrix<f64>) -> impl Iterator<Item = ((usize, usize), &mut f64)> {
    let rows = matrix.nrows();
    matrix.iter_mut().enumerate().map(move |(place, value)| ((place % rows, place / rows), value))
}

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

#[cfg(test)]
pub(in crate::harmonic) mod tests {
    use super::*;
    use crate::fixtures::small_tool;
    use crate::harmonic::coefficients::Precision;
    use crate::harmonic::{FitSettings, HarmonicField, fit};
    use imf_core::control::Control;
    use imf_core::obstacle::Obstacle;
    use imf_core::orientation::OrientationSet;
    use imf_core::section::{At, sections};
    use std::sync::Arc;

    const DIMS: [usize; 3] = [15, 12, 14];

    /// A bent bar and a pin, or a quarter of them and its images across x and z; `beyond` empty planes lie along x and z behind.
    fn obstacle(beyond: usize) -> Occupancy {
        let dims = [DIMS[0] + beyond, DIMS[1], DIMS[2] + beyond];
        let grid = Grid {
            dims,
            ..Grid::with_dims(DVec3::ZERO, DVec3::from(DIMS.map(|n| n as f64)), DIMS, 0).unwrap()
        };
        let mut obstacle = Occupancy::empty(grid);
        for index in 0..grid.len() {
            let [x, y, z] = grid.voxel(index);
            if x < DIMS[0] && z < DIMS[2] {
                let (x, z) = (x.min(DIMS[0] - 1 - x), z.min(DIMS[2] - 1 - z));
                let is_solid =
                    (2..4).contains(&x) && y > 1 && (3..6).contains(&z) || y == 3 && x > 2 && z > 2;
                obstacle.solid[index] = u8::from(is_solid);
            }
        }
        obstacle
    }

    pub(in crate::harmonic) fn plan(beyond: usize) -> SectionPlan {
        SectionPlan::new(obstacle(beyond), small_tool(), At::SharpPoints).unwrap()
    }

    pub(in crate::harmonic) fn made(plan: &SectionPlan, settings: &FitSettings) -> HarmonicField {
        fit(plan, Domain::Directions, settings, Control::quiet()).unwrap()
    }

    fn across(plan: &SectionPlan) -> [bool; 3] {
        Mirrored::of(plan, Domain::Directions, Quantity::Overlap).across
    }

    fn values(field: &HarmonicField, set: &[Orientation]) -> Vec<f32> {
        let mut values = vec![f32::NAN; field.grid.len() * set.len()];
        field.sections(&field.direction_weights(set), &mut values);
        values
    }

    #[test]
    fn planes_are_those_across_which_every_voxel_has_its_image() {
        assert_eq!(across(&plan(0)), [true, false, true]);
        assert_eq!(across(&plan(1)), [false; 3]);
        let mut dented = obstacle(0);
        let place = dented.grid.index([2, 5, 4]);
        dented.solid[place] = 0;
        let tool = small_tool();
        assert_eq!(across(&SectionPlan::new(&dented, &tool, At::SharpPoints).unwrap()), [false; 3]);
        // With the voxel's image across x, and with that across z.
        for (image, expected) in [([12, 5, 4], [true, false, false]), ([2, 5, 9], [false, false, true])] {
            let mut dented = dented.clone();
            let place = dented.grid.index(image);
            dented.solid[place] = 0;
            assert_eq!(across(&SectionPlan::new(&dented, &tool, At::SharpPoints).unwrap()), expected);
        }
        assert_eq!(Mirrored::of(&plan(0), Domain::Rotations, Quantity::Overlap).across, [false; 3]);
        assert_eq!(Mirrored::of(&plan(0), Domain::Directions, Quantity::Depth).across, [false; 3]);
    }

    #[test]
    fn a_layer_that_the_cutter_may_enter_is_mirrored_as_well_or_nothing_is() {
        let solid = obstacle(0);
        assert!(small_tool().without_cutter().is_some());
        let mut voxels = Occupancy::empty(solid.grid);
        for (layer, expected) in [([7, 1, 6], [true, false, false]), ([7, 1, 7], [true, false, true])] {
            let place = voxels.grid.index(layer);
            voxels.solid[place] = 1;
            let obstacle =
                Obstacle { forbidden: Arc::new(solid.clone()), cuttable: Some(Arc::new(voxels.clone())) };
            let plan = SectionPlan::new(obstacle, small_tool(), At::SharpPoints).unwrap();
            assert_eq!(across(&plan), expected);
        }
    }

    #[test]
    fn memory_is_asked_for_one_side_and_then_for_the_whole_field_beside_it() {
        let settings = FitSettings { degree: 6, axes: 49, ..FitSettings::default() };
        let (plan, voxels) = (plan(0), DIMS.iter().product::<usize>() as u64);
        let (peak, field) = settings.memory_with(&plan, Domain::Directions);
        // Two bytes for each of 49 functions; eight of fifteen planes, half of the lines.
        assert_eq!(field, voxels * 98);
        assert!(peak >= field + field * 4 / 15 && peak > 2 * 196 * voxels * 4 / 15);
    }

    #[test]
    fn both_sides_hold_what_one_side_of_a_fit_of_the_whole_grid_does() {
        let settings = FitSettings {
            degree: 6,
            axes: usize::MAX,
            sections_per_function: 1.33,
            ..FitSettings::default()
        };
        // One pass rounds sections to multiples of 1/65535; directions and their images to 1e-16. Halves have 11 bits.
        for (one_pass, precision, tolerance) in
            [(true, Precision::F32, 5e-5), (false, Precision::F32, 5e-5), (true, Precision::F16, 1e-3)]
        {
            let settings = FitSettings { one_pass, precision, ..settings };
            let (mirrored, whole) = (made(&plan(0), &settings), made(&plan(1), &settings));
            let set = OrientationSet::parse("random:6:3").unwrap().orientations;
            for orientation in &set {
                let found = values(&mirrored, &[*orientation]);
                for [flip_x, flip_z] in [[false, false], [true, false], [false, true], [true, true]] {
                    let sign = |flip| if flip { -1.0 } else { 1.0 };
                    let image = orientation.direction() * DVec3::new(sign(flip_x), 1.0, sign(flip_z));
                    let image = Orientation::from_direction(image).unwrap();
                    let expected = values(&whole, &[image]);
                    // What lies on the plane across x is fitted, not mirrored.
                    for x in 0..DIMS[0] / 2 {
                        for (y, z) in (0..DIMS[1]).flat_map(|y| (0..DIMS[2] / 2).map(move |z| (y, z))) {
                            let of = |flip: bool, v: usize, n: usize| if flip { n - 1 - v } else { v };
                            let voxel = [of(flip_x, x, DIMS[0]), y, of(flip_z, z, DIMS[2])];
                            let found = found[mirrored.grid.index(voxel)];
                            let expected = expected[whole.grid.index([x, y, z])];
                            assert!((found - expected).abs() < tolerance, "{voxel:?}: {found} {expected}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_report_tells_of_both_sides() {
        let (plan, set) = (plan(0), OrientationSet::parse("random:16:0").unwrap().orientations);
        let field = made(&plan, &FitSettings { degree: 6, axes: 49, ..FitSettings::default() });
        let exact = sections(&plan, &set, Control::quiet()).unwrap().concat();
        let squares: Vec<f64> =
            exact.iter().zip(values(&field, &set)).map(|(e, v)| f64::from(e - v).powi(2)).collect();
        let mean = |squares: Vec<f64>| squares.iter().sum::<f64>() / squares.len() as f64;
        let is_fitted = |place: &usize| {
            let [x, _, z] = field.grid.voxel(place % field.grid.len());
            x <= DIMS[0] / 2 && z < DIMS[2] / 2
        };
        let one_side = mean((0..squares.len()).filter(is_fitted).map(|place| squares[place]).collect());
        let all = mean(squares);
        let told = field.report.held_out_mse;
        // The plane across x counts twice.
        assert!((0.9..1.1).contains(&(told / all)), "{told} {all} {one_side}");
        assert!(!(0.9..1.1).contains(&(told / one_side)), "{told} {all} {one_side}");
    }

    /// Coefficients of all functions at every voxel.
    fn functions(field: &HarmonicField) -> Vec<f32> {
        let (count, axes) = (field.mean.len(), field.axes.len() / field.mean.len());
        let Coefficients::F32(coefficients) = &field.coefficients else { panic!("made in f32") };
        let rows = coefficients.chunks_exact(axes);
        let of = |z: &[f32], k: usize| -> f32 {
            field.mean[k] + z.iter().zip(&field.axes[k * axes..]).map(|(z, u)| z * u).sum::<f32>()
        };
        rows.flat_map(|z| (0..count).map(move |k| of(z, k))).collect()
    }

    #[test]
    fn fewer_axes_leave_out_over_both_sides_what_one_side_told() {
        let plan = plan(0);
        for one_pass in [true, false] {
            let settings =
                FitSettings { degree: 6, one_pass, precision: Precision::F32, ..FitSettings::default() };
            let all = functions(&made(&plan, &FitSettings { axes: 49, ..settings }));
            for axes in [5, 20] {
                let field = made(&plan, &FitSettings { axes, ..settings });
                let few = functions(&field);
                let sum: f64 = all.iter().zip(&few).map(|(a, b)| f64::from(a - b).powi(2)).sum();
                let ratio = sum / plan.grid().len() as f64 / field.report.dropped;
                // The plane across x is an eighth of one side, a fifteenth of both.
                assert!((0.9..1.1).contains(&ratio), "{axes}: {ratio}");
            }
        }
    }
}
