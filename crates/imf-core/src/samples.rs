//! Samples of the exact field in memory, as training reads them: voxel, section, value.

use crate::grid::Grid;
use crate::siren::{INPUTS, features};

/// Samples of several sections of one scene, section after section: 8 bytes a sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// The grid whose voxels `voxels` counts.
    pub grid: Grid,
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
    /// No samples yet.
    #[must_use]
    pub fn new(grid: Grid) -> Self {
        Self { grid, angles: Vec::new(), starts: vec![0], voxels: Vec::new(), values: Vec::new() }
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

    /// Network inputs and target of one sample.
    ///
    /// # Panics
    /// If there is no such sample.
    #[must_use]
    pub fn sample(&self, index: usize) -> ([f32; INPUTS], f32) {
        let section = self.starts.partition_point(|&start| start <= index) - 1;
        let [theta, phi] = self.angles[section];
        let point = self.grid.unit(self.grid.centre(self.grid.voxel(self.voxels[index] as usize)));
        (features(point.as_vec3().to_array(), theta, phi), self.values[index])
    }
}
