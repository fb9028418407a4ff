//! Finding the symmetry of a field and of its obstacle.

use std::f64::consts::TAU;

use crate::parallel::*;
use glam::DVec3;

use super::super::targets::ByFunction;
use super::{Axis, LocalHarmonics, Symmetry};
use crate::harmonic::HarmonicField;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;

/// Voxels that are compared first: most planes are not mirrors, and these show it.
const FIRST: usize = 4096;
/// Times the mean squared error that averaging may change at a voxel. Measured: 0.4 of parts that are their own images.
const WORST: f64 = 4.0;
/// Voxels that a plane may stand off the grid's middle.
const NEAR: f64 = 1e-3;
/// Angles that the obstacle is turned by: no simple fraction of a turn, which gears would pass.
const ANGLES: usize = 8;
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Solid voxels that are turned, about.
const TURNED: usize = 20_000;
/// An obstacle that leaves more of itself behind as it turns is not of revolution. Measured: a teapot leaves 0.04, a gear
/// 0.26, a box 0.28 and more, a bracket 0.73.
const LEFT_BEHIND: f64 = 0.27;
/// The last step of the search for the axis, in voxels.
const LAST_STEP: f64 = 0.2;

impl Symmetry {
    /// The symmetry of a field that a network is distilled from: the grid's middle planes across which field and obstacle are their own
    /// images, as far as the field's own errors and the voxels' rounding go; and an axis where the obstacle is about one of
    /// revolution. Nothing of fields over rotations. `obstacle` is what the field is of, on its grid.
    #[must_use]
    pub fn of(field: &HarmonicField, obstacle: &Occupancy) -> Self {
        let Some(all) = ByFunction::of(field) else { return Self::default() };
        let middle = middle(&field.grid);
        let mirrors =
            [0, 1, 2].map(|axis| Mirror::new(field, &all, axis).holds(obstacle).then_some(middle[axis]));
        let axis = of_revolution(obstacle).map(|mut axis| {
            // A mirror plane along the axis holds it.
            for across in (0..3).filter(|&across| across != axis.along) {
                if let Some(plane) = mirrors[across] {
                    axis.through[across] = plane;
                }
            }
            axis
        });
        Self { mirrors, axis }
    }

    /// True where a network that was reduced by this symmetry of another field can be trained on this one: its mirror planes are
    /// mirror planes here as well.
    pub fn holds_in(&self, field: &HarmonicField, obstacle: &Occupancy) -> bool {
        let planes = || (0..3).filter_map(|axis| self.mirrors[axis].map(|plane| (axis, plane)));
        let (middle, near) = (middle(&field.grid), NEAR * field.grid.pitch);
        if planes().any(|(axis, plane)| (plane - middle[axis]).abs() > near) {
            return false;
        }
        match ByFunction::of(field) {
            Some(all) => planes().all(|(axis, _)| Mirror::new(field, &all, axis).holds(obstacle)),
            None => planes().next().is_none(),
        }
    }
}

/// A field that may be its own image across the grid's middle plane.
struct Mirror<'a> {
    field: &'a HarmonicField,
    all: &'a ByFunction<'a>,
    axis: usize,
    symmetry: Symmetry,
    harmonics: LocalHarmonics,
}

/// Coefficients at a voxel and at its image.
#[derive(Default)]
struct Pair {
    halves: Vec<f32>,
    here: Vec<f32>,
    there: Vec<f32>,
}

impl<'a> Mirror<'a> {
    fn new(field: &'a HarmonicField, all: &'a ByFunction<'a>, axis: usize) -> Self {
        let mut symmetry = Symmetry::default();
        symmetry.mirrors[axis] = Some(middle(&field.grid)[axis]);
        let harmonics = LocalHarmonics::new(&symmetry, field.basis.degree());
        Self { field, all, axis, symmetry, harmonics }
    }

    /// True where the obstacle is its own image but for what rounding makes of a surface, and what averaging both sides would
    /// change is less than half of the field's own mean squared error, at no voxel many times as much.
    fn holds(&self, obstacle: &Occupancy) -> bool {
        let (grid, mse) = (&self.field.grid, self.field.report.validation.mse);
        let agrees = |voxels: &[usize]| {
            let changes: Vec<f64> =
                voxels.par_iter().map_init(Pair::default, |pair, &voxel| self.change(pair, voxel)).collect();
            let mean = changes.iter().sum::<f64>() / changes.len().max(1) as f64;
            mean <= 0.5 * mse && changes.iter().all(|&change| change <= WORST * mse)
        };
        let one_side = |step: usize| -> Vec<usize> {
            let is_near = |&voxel: &usize| 2 * grid.voxel(voxel)[self.axis] < grid.dims[self.axis];
            (0..grid.len()).step_by(step).filter(is_near).collect()
        };
        self.is_solid_mirrored(obstacle)
            && agrees(&one_side((grid.len() / FIRST).max(1)))
            && agrees(&one_side(1))
    }

    /// True where no 2×2×2 voxels in a row all differ from their images: a surface that lies between voxel centres may be rounded
    /// either way, a pin or a hole on one side is thicker.
    fn is_solid_mirrored(&self, Occupancy { grid, solid }: &Occupancy) -> bool {
        let differs = |voxel: [usize; 3]| {
            let mut image = voxel;
            image[self.axis] = grid.dims[self.axis] - 1 - voxel[self.axis];
            (solid[grid.index(voxel)] != 0) != (solid[grid.index(image)] != 0)
        };
        let corners = |[x, y, z]: [usize; 3]| {
            (0..8).map(move |bits| [x + (bits >> 2), y + (bits >> 1 & 1), z + (bits & 1)])
        };
        let has_room = |voxel: [usize; 3]| (0..3).all(|axis| voxel[axis] + 1 < grid.dims[axis]);
        (0..grid.len())
            .into_par_iter()
            .map(|index| grid.voxel(index))
            .all(|voxel| !differs(voxel) || !has_room(voxel) || !corners(voxel).all(differs))
    }

    /// Half the distance of a voxel's values from its image's, squared, the mean over all directions; `pair` is left with the
    /// coefficients.
    fn change(&self, pair: &mut Pair, index: usize) -> f64 {
        let (grid, axis) = (&self.field.grid, self.axis);
        let voxel = grid.voxel(index);
        let mut image = voxel;
        image[axis] = grid.dims[axis] - 1 - voxel[axis];
        let Pair { halves, here, there } = pair;
        for (coefficients, voxel) in [(&mut *here, voxel), (&mut *there, image)] {
            coefficients.resize(self.harmonics.len(), 0.0);
            self.all.read(grid.index(voxel), halves, coefficients);
            self.harmonics.to_local(&self.symmetry.place(grid.centre(voxel)), coefficients);
        }
        let squares = here.iter().zip(&*there).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        0.25 * squares.sum::<f64>()
    }
}

fn middle(grid: &Grid) -> DVec3 {
    grid.origin + 0.5 * grid.size()
}

/// The world axis about which the obstacle maps best onto itself as it turns, where the error is small enough.
fn of_revolution(obstacle: &Occupancy) -> Option<Axis> {
    let Occupancy { grid, solid } = obstacle;
    let apart = (obstacle.count() / TURNED).max(1);
    let voxels = solid.iter().enumerate().filter(|&(_, &solid)| solid != 0).step_by(apart);
    let points: Vec<DVec3> = voxels.map(|(index, _)| grid.centre(grid.voxel(index))).collect();
    if points.is_empty() {
        return None;
    }
    let centroid = points.iter().sum::<DVec3>() / points.len() as f64;
    let found = (0..3usize).into_par_iter().map(|along| {
        let left_behind = |through: DVec3| left_behind(grid, solid, &points, Axis { along, through });
        let (mut through, mut least) = (centroid, left_behind(centroid));
        let mut step = 4.0 * grid.pitch;
        while step >= LAST_STEP * grid.pitch {
            let [x, y, _] = Axis::order(along).map(|axis| DVec3::AXES[axis]);
            let around = [x, -x, y, -y].map(|way| through + step * way);
            let better = around.into_iter().map(|at| (left_behind(at), at)).find(|&(left, _)| left < least);
            match better {
                Some((left, at)) => (least, through) = (left, at),
                None => step *= 0.5,
            }
        }
        (least, Axis { along, through })
    });
    let found: Vec<(f64, Axis)> = found.collect();
    let (least, axis) = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (least <= LEFT_BEHIND).then_some(axis)
}

/// Fraction of the solid points that some turns about an axis take to where nothing is solid.
fn left_behind(grid: &Grid, solid: &[u8], points: &[DVec3], Axis { along, through }: Axis) -> f64 {
    let [x, y, _] = Axis::order(along);
    let mut left = 0usize;
    for turn in 1..=ANGLES {
        let (sine, cosine) = (TAU * GOLDEN * turn as f64).sin_cos();
        for &point in points {
            let (across, up) = (point[x] - through[x], point[y] - through[y]);
            let mut turned = point;
            turned[x] = through[x] + cosine * across - sine * up;
            turned[y] = through[y] + sine * across + cosine * up;
            let voxel = ((turned - grid.origin) / grid.pitch).floor();
            let inside = (0..3).all(|axis| voxel[axis] >= 0.0 && voxel[axis] < grid.dims[axis] as f64);
            let voxel = voxel.to_array().map(|v| v as usize);
            left += usize::from(!inside || solid[grid.index(voxel)] == 0);
        }
    }
    left as f64 / (ANGLES * points.len()) as f64
}
