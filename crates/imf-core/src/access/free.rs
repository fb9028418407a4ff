//! Which orientations are free at a voxel: one bit for each pair, where they are wanted.

/// For every orientation the voxels where it is free, one bit each.
///
/// ```text
/// planes[orientation]: [x][y][⌈nz / 8⌉] bytes, the lowest z of a byte in its lowest bit
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FreeOrientations {
    dims: [usize; 3],
    /// By orientation; empty until it has been visited.
    planes: Vec<Vec<u8>>,
}

impl FreeOrientations {
    /// No orientation yet, for a grid of `dims` voxels.
    #[must_use]
    pub fn new(dims: [usize; 3]) -> Self {
        Self { dims, planes: Vec::new() }
    }

    /// Bytes that so many orientations take.
    #[must_use]
    pub fn memory_estimate(dims: [usize; 3], orientations: usize) -> u64 {
        dims[0] as u64 * dims[1] as u64 * dims[2].div_ceil(8) as u64 * orientations as u64
    }

    /// Number of orientations, and bytes along x·y and z of each one's plane.
    #[must_use]
    pub fn shape(&self) -> [usize; 3] {
        [self.planes.len(), self.dims[0] * self.dims[1], self.dims[2].div_ceil(8)]
    }

    /// All planes one after the other: an array of [`FreeOrientations::shape`].
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.shape().iter().product());
        // Each plane is dropped once it is copied.
        self.planes.into_iter().for_each(|plane| bytes.extend(plane));
        bytes
    }

    /// The free orientations of a voxel by index, in order.
    ///
    /// # Panics
    /// If the voxel does not exist.
    #[must_use]
    pub fn of(&self, [x, y, z]: [usize; 3]) -> Vec<usize> {
        let byte = (x * self.dims[1] + y) * self.dims[2].div_ceil(8) + z / 8;
        let is_free = |plane: &[u8]| plane[byte] >> (z % 8) & 1 == 1;
        (0..self.planes.len()).filter(|&index| is_free(&self.planes[index])).collect()
    }

    /// Notes the section of orientation `index`.
    pub(super) fn push(&mut self, index: usize, cmf: &[f32], tau: f64) {
        let mut plane = Vec::with_capacity(self.dims[0] * self.dims[1] * self.dims[2].div_ceil(8));
        for row in cmf.chunks_exact(self.dims[2]) {
            plane.extend(row.chunks(8).map(|chunk| {
                let bits = chunk.iter().enumerate().map(|(bit, &v)| u8::from(f64::from(v) <= tau) << bit);
                bits.fold(0, |byte, bit| byte | bit)
            }));
        }
        self.planes.resize(self.planes.len().max(index + 1), Vec::new());
        self.planes[index] = plane;
    }

    /// Takes the orientations that another thread has visited.
    pub(super) fn append(&mut self, other: Self) {
        self.planes.resize(self.planes.len().max(other.planes.len()), Vec::new());
        for (mine, theirs) in self.planes.iter_mut().zip(other.planes).filter(|(_, p)| !p.is_empty()) {
            *mine = theirs;
        }
    }
}
