//! Parts: meshes from files in memory, and the built-in ones.

use imf_core::mesh::Mesh;
use imf_core::mesh::read::MeshFile;
use imf_core::parts::ReferencePart;
use imf_core::unit::LengthUnit;
use wasm_bindgen::JsError;
use wasm_bindgen::prelude::wasm_bindgen;

/// A part's surface.
#[wasm_bindgen]
pub struct Part {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    pub(crate) unit: LengthUnit,
    pub(crate) reference: Option<ReferencePart>,
}

#[wasm_bindgen]
impl Part {
    /// From the bytes of an OBJ, STL, PLY or 3MF file, by the ending of its name; `unit` (such as `mm`) is that of files which
    /// state none.
    ///
    /// # Errors
    /// An unknown unit; as `read_mesh_file` of `imf-core`.
    pub fn read(name: &str, bytes: &[u8], unit: &str) -> Result<Part, JsError> {
        let unit: LengthUnit = unit.parse()?;
        let MeshFile { mesh, unit: stated } = MeshFile::from_bytes(bytes, name)?;
        Ok(Self { name: name.to_owned(), mesh, unit: stated.unwrap_or(unit), reference: None })
    }

    /// A built-in part: `teapot`, `bracket`, `bracket-raw` or `screw-gear`.
    ///
    /// # Errors
    /// Another name.
    pub fn reference(name: &str) -> Result<Part, JsError> {
        let part: ReferencePart = name.parse()?;
        Ok(Self { name: name.to_owned(), mesh: part.mesh(), unit: LengthUnit::Mm, reference: Some(part) })
    }

    /// Three corners of each triangle.
    #[must_use]
    pub fn corners(&self) -> Vec<f32> {
        corners(&self.mesh)
    }
}

/// Three corners of each triangle.
pub(crate) fn corners(mesh: &Mesh) -> Vec<f32> {
    let corners = (0..mesh.triangles.len()).flat_map(|triangle| mesh.corners(triangle));
    corners.flat_map(|corner| corner.as_vec3().to_array()).collect()
}
