//! The part's surface with measure and best direction at every vertex.

use std::path::Path;

use anyhow::Result;
use imf_core::access::{surface_voxels, vertex_normals};
use imf_core::field_files::write_ply;
use imf_core::mesh::Mesh;

use super::Findings;
use super::setup::Setup;
use crate::picture::Scale;

/// Edges longer than this many pitches are halved, so that values show between the corners of large triangles.
const LONGEST_EDGE: f64 = 2.0;
/// No more refining from so many triangles on.
const MOST_TRIANGLES: usize = 4_000_000;

/// Values at the vertices of the part's refined mesh.
pub(super) struct Surface {
    mesh: Mesh,
    imf: Vec<f32>,
    /// Components i, j, k of the best tool's best direction.
    best: [Vec<f32>; 3],
    /// Share of the surface's area that is reached.
    pub(super) accessible_share: f64,
}

impl Surface {
    pub(super) fn read(setup: &Setup, findings: &Findings) -> Self {
        let mesh = setup.mesh.welded().refined(LONGEST_EDGE * setup.query.pitch, MOST_TRIANGLES);
        let normals = vertex_normals(&mesh);
        let voxels = surface_voxels(&mesh, &normals, &setup.solid);
        let together = &findings.together.imf;
        let imf: Vec<f32> = voxels.iter().map(|v| v.map_or(f32::NAN, |v| together.value[v])).collect();
        let mut best = [(); 3].map(|()| Vec::with_capacity(voxels.len()));
        for voxel in &voxels {
            let orientation =
                voxel.and_then(|v| setup.orientations.orientations.get(together.best[v] as usize));
            let direction = orientation.map(|o| o.direction().to_array()).unwrap_or_default();
            best.iter_mut().zip(direction).for_each(|(list, d)| list.push(d as f32));
        }
        // A third of every triangle belongs to each of its corners.
        let (mut reached, mut whole) = (0.0, 0.0);
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(triangle);
            let third = (b - a).cross(c - a).length() / 6.0;
            whole += 3.0 * third;
            let free = |&&v: &&u32| f64::from(imf[v as usize]) <= setup.tau;
            reached += third * corners.iter().filter(free).count() as f64;
        }
        let accessible_share = if whole > 0.0 { reached / whole } else { 0.0 };
        Self { mesh, imf, best, accessible_share }
    }

    pub(super) fn vertices(&self) -> usize {
        self.mesh.vertices.len()
    }

    pub(super) fn write(&self, setup: &Setup, path: &Path) -> Result<()> {
        let scale = self.scale();
        let colours: Vec<[u8; 3]> = self.imf.iter().map(|&v| scale.rgb(v)).collect();
        let [i, j, k] = &self.best;
        let values = [("imf", &self.imf[..]), ("best_i", &i[..]), ("best_j", &j[..]), ("best_k", &k[..])];
        let comments = [
            format!("imf {}: {} in {}", env!("CARGO_PKG_VERSION"), setup.part, setup.unit),
            "imf: inaccessibility measure half a pitch outside; best: direction from tip to holder".into(),
            setup.guarantee.to_string(),
        ];
        Ok(write_ply(path, &self.mesh, &values, &colours, &comments)?)
    }

    fn scale(&self) -> Scale {
        let all = ndarray::ArrayView2::from_shape((1, self.imf.len()), &self.imf);
        all.map_or_else(|_| Scale::measure_of(&[], "IMF"), |all| Scale::measure_of(&[all], "IMF"))
    }
}
