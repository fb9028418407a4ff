//! Tables of exact sections at an angle grid: of all voxels, or of every so many-th one, with straight lines between them in place
//! and angle. What a given amount of memory is worth without any idea.

use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionError, SectionPlan, stream_sections};
use rayon::prelude::*;

use super::AngleGrid;

/// Along each axis at least this many points are kept, of grids that have as many voxels.
const LEAST_POINTS: usize = 2;
/// Points that one thread interpolates at a time.
const BLOCK: usize = 4096;

/// Exact sections at the pairs of an angle grid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SectionTable {
    angles: AngleGrid,
    orientations: Vec<Orientation>,
    dims: [usize; 3],
    axes: [Lattice; 3],
    /// `[section][x, y, z]` of the points kept.
    sections: Vec<Vec<f32>>,
}

/// The voxels of an axis that are kept, and between which of them each voxel lies.
#[derive(Clone, Debug, PartialEq)]
struct Lattice {
    kept: Vec<usize>,
    /// For each voxel the kept one at or below it, and how far it is to the next.
    places: Vec<(usize, f32)>,
}

impl Lattice {
    /// `count` of `n` voxels, the first and the last among them, as evenly as whole voxels allow.
    fn new(n: usize, count: usize) -> Self {
        let count = count.clamp(LEAST_POINTS.min(n), n);
        let last = (count - 1).max(1);
        let kept: Vec<usize> = (0..count).map(|i| (i * (n - 1) + last / 2) / last).collect();
        let place = |voxel: usize| {
            let below = kept.partition_point(|&k| k <= voxel) - 1;
            let width = kept.get(below + 1).map_or(1, |&next| next - kept[below]).max(1);
            (below, (voxel - kept[below]) as f32 / width as f32)
        };
        Self { places: (0..n).map(place).collect(), kept }
    }

    fn len(&self) -> usize {
        self.kept.len()
    }
}

impl SectionTable {
    /// How many points along each axis a table of about `bytes` has room for, beside n × n angles.
    pub(crate) fn points_within(grid: &Grid, angles: AngleGrid, bytes: u64) -> [usize; 3] {
        let whole = 4.0 * (angles.n * angles.n * grid.len()) as f64;
        let share = (bytes as f64 / whole).cbrt().min(1.0);
        grid.dims.map(|n| ((n as f64 * share).round() as usize).clamp(LEAST_POINTS.min(n), n))
    }

    /// Computes n × n sections and keeps `points` of their voxels. One unit of progress is one section.
    ///
    /// # Errors
    /// A failed section, or cancellation.
    pub(crate) fn new(
        plan: &SectionPlan,
        angles: AngleGrid,
        points: [usize; 3],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let dims = plan.grid().dims;
        let axes = [0, 1, 2].map(|axis| Lattice::new(dims[axis], points[axis]));
        let orientations = angles.orientations();
        let each: usize = axes.iter().map(Lattice::len).product();
        let parts =
            stream_sections(plan, &orientations, control, Vec::new, |own: &mut Vec<_>, index, cmf| {
                let mut kept = Vec::with_capacity(each);
                for &x in &axes[0].kept {
                    for &y in &axes[1].kept {
                        let line = (x * dims[1] + y) * dims[2];
                        kept.extend(axes[2].kept.iter().map(|&z| cmf[line + z]));
                    }
                }
                own.push((index, kept));
            })?;
        let mut sections = vec![Vec::new(); orientations.len()];
        for (index, kept) in parts.into_iter().flatten() {
            sections[index] = kept;
        }
        Ok(Self { angles, orientations, dims, axes, sections })
    }

    /// Bytes that n × n sections of so many voxels take.
    pub(crate) fn memory(angles: AngleGrid, voxels: usize) -> u64 {
        4 * (angles.n * angles.n * voxels) as u64
    }

    /// Bytes of the values.
    pub(crate) fn bytes(&self) -> u64 {
        4 * (self.points() * self.sections.len()) as u64
    }

    /// Points of a section.
    fn points(&self) -> usize {
        self.sections[0].len()
    }

    /// Points kept along x, y and z, and sections.
    pub(crate) fn shape(&self) -> ([usize; 3], usize) {
        ([0, 1, 2].map(|axis| self.axes[axis].len()), self.angles.n * self.angles.n)
    }

    /// The kept points of the section of the nearest direction.
    ///
    /// # Panics
    /// If `values` has not their number.
    pub(crate) fn nearest(&self, orientation: &Orientation, values: &mut [f32]) {
        let direction = orientation.direction();
        let closeness = |o: &Orientation| direction.dot(o.direction());
        let places = self.orientations.iter().enumerate();
        let nearest = places.max_by(|(_, a), (_, b)| closeness(a).total_cmp(&closeness(b)));
        values.copy_from_slice(&self.sections[nearest.map_or(0, |(index, _)| index)]);
    }

    /// The section at an orientation: linear in angle, by the weights of [`AngleGrid::weights`], and trilinear in place.
    ///
    /// # Panics
    /// If `values` has not a section's length.
    pub(crate) fn linear(&self, orientation: &Orientation, values: &mut [f32]) {
        let [nx, ny, nz] = self.dims;
        assert_eq!(values.len(), nx * ny * nz, "one value for each voxel");
        if self.points() == values.len() {
            return self.at_points(orientation, values);
        }
        let ([_, my, mz], _) = self.shape();
        let mut turned = vec![0.0f32; self.points()];
        self.at_points(orientation, &mut turned);
        let [along_x, along_y, along_z] = &self.axes;
        values.par_chunks_exact_mut(ny * nz).zip(&along_x.places).for_each(|(slab, &(x, tx))| {
            let mut plane = vec![0.0f32; my * mz];
            let next = (x + 1).min(along_x.len() - 1);
            let (low, high) = (&turned[x * my * mz..][..my * mz], &turned[next * my * mz..][..my * mz]);
            for (out, (&a, &b)) in plane.iter_mut().zip(low.iter().zip(high)) {
                *out = a + tx * (b - a);
            }
            let mut line = vec![0.0f32; mz];
            for (row, &(y, ty)) in slab.chunks_exact_mut(nz).zip(&along_y.places) {
                let next = (y + 1).min(my - 1);
                let (low, high) = (&plane[y * mz..][..mz], &plane[next * mz..][..mz]);
                for (out, (&a, &b)) in line.iter_mut().zip(low.iter().zip(high)) {
                    *out = a + ty * (b - a);
                }
                for (out, &(z, tz)) in row.iter_mut().zip(&along_z.places) {
                    let (a, b) = (line[z], line[(z + 1).min(mz - 1)]);
                    *out = a + tz * (b - a);
                }
            }
        });
    }

    /// The kept points of the section at an orientation.
    fn at_points(&self, orientation: &Orientation, values: &mut [f32]) {
        let weights = self.angles.weights(orientation);
        values.par_chunks_mut(BLOCK).enumerate().for_each(|(block, values)| {
            values.fill(0.0);
            for &(index, weight) in &weights {
                let section = &self.sections[index][block * BLOCK..][..values.len()];
                values.iter_mut().zip(section).for_each(|(value, &s)| *value += weight as f32 * s);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use imf_core::occupancy::Occupancy;
    use imf_core::section::{At, sections};
    use imf_core::tool::Tool;

    fn plan() -> SectionPlan {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
        SectionPlan::new(&Occupancy { grid, solid }, Tool::paper(), At::SharpPoints).unwrap()
    }

    fn whole(plan: &SectionPlan, n: usize) -> SectionTable {
        SectionTable::new(plan, AngleGrid::new(n), plan.grid().dims, Control::quiet()).unwrap()
    }

    #[test]
    fn whole_sections_are_interpolated_in_angle_alone() {
        let (plan, angles) = (plan(), AngleGrid::new(6));
        let (voxels, stored) = (plan.grid().len(), whole(&plan, 6));
        assert_eq!(stored.bytes(), SectionTable::memory(angles, voxels));
        let between = Orientation::new(37.0, 81.0);
        let exact = sections(&plan, &stored.orientations, Control::quiet()).unwrap();
        let (mut linear, mut nearest) = (vec![7.0; voxels], vec![7.0; voxels]);
        stored.linear(&between, &mut linear);
        stored.nearest(&between, &mut nearest);
        for voxel in 0..voxels {
            let expected: f64 =
                angles.weights(&between).iter().map(|&(i, w)| w * f64::from(exact[i][voxel])).sum();
            // Four products of values below 1, in f32.
            assert!((f64::from(linear[voxel]) - expected).abs() < 1e-6);
        }
        // θ = 60°, φ = 90° is the nearest of the grid's pairs: index 1·6 + 3.
        assert_eq!(nearest, exact[9]);
    }

    #[test]
    fn kept_voxels_are_exact_at_kept_angles_and_others_lie_between() {
        let (plan, angles) = (plan(), AngleGrid::new(4));
        let points = SectionTable::points_within(plan.grid(), angles, 4000);
        let table = SectionTable::new(&plan, angles, points, Control::quiet()).unwrap();
        assert!(table.bytes() <= 6000 && table.bytes() > 2000, "{} bytes", table.bytes());
        let (mut exact, mut found) = (vec![0.0; plan.grid().len()], vec![7.0; plan.grid().len()]);
        let grid = plan.grid();
        // By the definition: the mean of the eight corners of the cell, weighted by the distance.
        let around = |axis: usize, voxel: usize| {
            let kept = &table.axes[axis].kept;
            let above = kept.iter().position(|&k| k >= voxel).unwrap();
            let below = kept.iter().rposition(|&k| k <= voxel).unwrap();
            let width = (kept[above] - kept[below]).max(1) as f32;
            let t = (voxel - kept[below]) as f32 / width;
            [(kept[below], 1.0 - t), (kept[above], t)]
        };
        let of_grid = angles.orientations()[6];
        for orientation in [of_grid, Orientation::new(100.0, 20.0), Orientation::new(355.0, 179.0)] {
            whole(&plan, 4).linear(&orientation, &mut exact);
            table.linear(&orientation, &mut found);
            for index in 0..grid.len() {
                let voxel = grid.voxel(index);
                let mut expected = 0.0;
                for (x, a) in around(0, voxel[0]) {
                    for (y, b) in around(1, voxel[1]) {
                        for (z, c) in around(2, voxel[2]) {
                            expected += a * b * c * exact[grid.index([x, y, z])];
                        }
                    }
                }
                assert!((found[index] - expected).abs() < 1e-6, "{voxel:?}: {} and {expected}", found[index]);
            }
        }
    }

    #[test]
    fn a_lattice_keeps_both_ends() {
        for (n, count) in [(1, 1), (2, 2), (7, 3), (30, 11), (5, 5)] {
            let lattice = Lattice::new(n, count);
            assert_eq!((lattice.kept[0], lattice.kept[lattice.len() - 1]), (0, n - 1), "{n} {count}");
            assert_eq!((lattice.len(), lattice.places.len()), (count, n));
            assert!(lattice.kept.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}
