//! Samples of the exact field in memory, as training reads them: voxel, section, value.
//!
//! A sample takes [`Samples::BYTES_PER_SAMPLE`], a section some more; room that is reserved beforehand is all that is taken.

use imf_core::grid::Grid;
use imf_fields::siren::{INPUTS, is_vertical, named_features};

/// The golden section: multiples of it by whole numbers spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Samples of several sections of one scene, section after section.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// The grid whose voxels `voxels` counts.
    pub grid: Grid,
    /// The grid whose unit coordinates the network's inputs are: `grid` itself, or the full grid where `grid` is a
    /// coarser one of the same scene. Both may have other boxes; a voxel's centre is the same point of the world.
    pub frame: Grid,
    /// (θ, φ) in degrees of each section.
    pub angles: Vec<[f32; 2]>,
    /// Samples of section `s` are `starts[s]..starts[s + 1]`; one entry more than sections.
    pub starts: Vec<usize>,
    /// C-order index of each sample's voxel.
    pub voxels: Vec<u32>,
    /// Collision measure of each sample, in [0, 1].
    pub values: Vec<f32>,
}

impl Samples {
    /// Memory of a sample: its voxel and its value.
    pub const BYTES_PER_SAMPLE: u64 = (size_of::<u32>() + size_of::<f32>()) as u64;
    /// Memory of a section beside its samples: its angles, and where it starts.
    const BYTES_PER_SECTION: u64 = (size_of::<[f32; 2]>() + size_of::<usize>()) as u64;

    /// No samples yet.
    #[must_use]
    pub fn new(grid: Grid) -> Self {
        Self::with_capacity(grid, 0, 0)
    }

    /// No samples yet, and room for `sections` sections and `samples` samples.
    pub(crate) fn with_capacity(grid: Grid, sections: usize, samples: usize) -> Self {
        let mut starts = Vec::with_capacity(sections + 1);
        starts.push(0);
        Self {
            grid,
            frame: grid,
            angles: Vec::with_capacity(sections),
            starts,
            voxels: Vec::with_capacity(samples),
            values: Vec::with_capacity(samples),
        }
    }

    /// Bytes of `sections` sections with `samples` samples in all.
    pub(crate) fn memory_bytes(sections: u64, samples: u64) -> u64 {
        let samples = samples.saturating_mul(Self::BYTES_PER_SAMPLE);
        samples.saturating_add(sections.saturating_mul(Self::BYTES_PER_SECTION))
    }

    /// Takes all samples out; the room stays.
    pub(crate) fn clear(&mut self) {
        self.angles.clear();
        self.starts.truncate(1);
        self.voxels.clear();
        self.values.clear();
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// True without samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// Appends the samples of one section.
    ///
    /// # Panics
    /// If `voxels` and `values` differ in length.
    pub fn push_section(&mut self, angles: [f32; 2], voxels: &[u32], values: &[f32]) {
        assert_eq!(voxels.len(), values.len(), "one value for each voxel");
        self.angles.push(angles);
        self.voxels.extend_from_slice(voxels);
        self.values.extend_from_slice(values);
        self.starts.push(self.voxels.len());
    }

    /// Network inputs and target of one sample. A vertical direction has every θ: each voxel has another, so that the network learns
    /// that θ says nothing there.
    ///
    /// # Panics
    /// If there is no such sample.
    #[must_use]
    pub fn sample(&self, index: usize) -> ([f32; INPUTS], f32) {
        let section = self.starts.partition_point(|&start| start <= index) - 1;
        let mut angles = self.angles[section];
        let voxel = self.voxels[index];
        if is_vertical(angles[1]) {
            // Those above each other are far apart.
            let turns = f64::from(voxel) * GOLDEN;
            angles[0] = 360.0 * (f64::from(angles[0]) / 360.0 + turns).fract() as f32;
        }
        let point = self.frame.unit(self.grid.centre(self.grid.voxel(voxel as usize)));
        (named_features(point.as_vec3().to_array(), angles), self.values[index])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn voxels_of_a_vertical_section_are_learnt_at_angles_all_around() {
        let grid = Grid::with_dims(DVec3::ZERO, DVec3::splat(1.0), [6, 5, 4], 0).unwrap();
        let mut samples = Samples::new(grid);
        let voxels: Vec<u32> = (0..grid.len() as u32).collect();
        for angles in [[0.0, 0.0], [300.0, 180.0], [300.0, 179.0]] {
            samples.push_section(angles, &voxels, &vec![0.5; grid.len()]);
        }
        let thetas = |section: usize| -> Vec<f32> {
            let of_section = samples.starts[section]..samples.starts[section + 1];
            of_section.map(|index| samples.sample(index).0[3]).collect()
        };
        for section in [0, 1] {
            let mut spread = thetas(section);
            spread.sort_by(f32::total_cmp);
            let ends = [spread[0], spread[grid.len() - 1]];
            assert!((-1.0..-0.95).contains(&ends[0]) && (0.95..1.0).contains(&ends[1]), "{ends:?}");
            // Evenly: 2/120 apart on average.
            assert!(spread.windows(2).all(|pair| (0.005..0.04).contains(&(pair[1] - pair[0]))), "{spread:?}");
        }
        assert!(thetas(2).iter().all(|&theta| theta == 300.0 / 180.0 - 1.0));
        let [point, other] = [0, 2 * grid.len()].map(|index| samples.sample(index).0);
        assert_eq!(point[..3], other[..3]);
    }

    #[test]
    fn samples_of_a_coarse_grid_speak_of_the_full_grids_points() {
        // The boxes differ: 0.65 of 13 voxels are 8.45, so the coarse grid has nine that stick out.
        let (lower, upper) = (DVec3::new(-3.0, 2.0, 5.0), DVec3::new(10.0, 9.0, 26.0));
        let full = Grid::with_pitch(lower, upper, 1.0, 0).unwrap();
        let coarse = Grid::with_pitch(lower, upper, 1.0 / 0.65, 0).unwrap();
        assert!((coarse.origin - full.origin).length() > 0.1 && coarse.dims == [9, 5, 14]);
        let mut samples = Samples::new(coarse);
        samples.frame = full;
        let voxels: Vec<u32> = (0..coarse.len() as u32).collect();
        samples.push_section([30.0, 60.0], &voxels, &vec![0.5; coarse.len()]);
        for index in 0..samples.len() {
            let world = coarse.centre(coarse.voxel(index));
            let (input, _) = samples.sample(index);
            // From the inputs back to the world by the full grid alone: 2u − 1 of the full box.
            let unit = DVec3::new(f64::from(input[0]), f64::from(input[1]), f64::from(input[2])) * 0.5 + 0.5;
            let back = full.origin + unit * full.size();
            // Inputs are f32 of magnitude about one, a box is 21 long.
            assert!((back - world).length() < 1e-5, "voxel {index}: {back} is not {world}");
        }
        // Read in its own box, the coarse grid's corner would stand elsewhere by a tenth of a voxel and more.
        let own = Samples { frame: coarse, ..samples.clone() };
        assert!((own.sample(0).0[0] - samples.sample(0).0[0]).abs() > 0.01);
    }
}
