//! A field from a file, beside the exact one of the scene that the file holds.

use imf_core::control::Control;
use imf_core::field::{GridField, PoseField};
use imf_core::orientation::Orientation;
use imf_core::section::{SectionPlan, ToolPoints};
use imf_fields::evaluation::Exact;
use imf_fields::field::Field;
use imf_fields::metrics::Errors;
use wasm_bindgen::JsError;
use wasm_bindgen::prelude::wasm_bindgen;

/// A field of any family, and the exact sections of its part and tool.
#[wasm_bindgen]
pub struct FieldFile {
    field: Field,
    plan: SectionPlan,
}

/// One section of a field, and the exact one.
#[wasm_bindgen]
pub struct Comparison {
    field: Vec<f32>,
    exact: Vec<f32>,
    /// Mean squared error.
    pub mse: f64,
    /// Largest absolute error.
    pub largest: f64,
}

#[wasm_bindgen]
impl Comparison {
    /// The field's values at every voxel, `[x, y, z]` with z side by side.
    #[must_use]
    pub fn field(&self) -> Vec<f32> {
        self.field.clone()
    }

    /// The exact values, alike.
    #[must_use]
    pub fn exact(&self) -> Vec<f32> {
        self.exact.clone()
    }
}

#[wasm_bindgen]
impl FieldFile {
    /// From the bytes of a `.safetensors` file of any family.
    ///
    /// # Errors
    /// Foreign, newer, truncated or damaged bytes.
    pub fn read(name: &str, bytes: &[u8]) -> Result<FieldFile, JsError> {
        let field = Field::from_bytes(bytes, name)?;
        let plan = SectionPlan::of_scene(field.scene(), ToolPoints::Tip)?;
        Ok(Self { field, plan })
    }

    /// The part that it is of.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn part(&self) -> String {
        self.field.scene().record.part.clone()
    }

    /// The tool that it is of.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn tool(&self) -> String {
        self.field.scene().record.tool.name.clone()
    }

    /// The unit of all lengths.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn unit(&self) -> String {
        self.field.scene().record.unit.to_string()
    }

    /// Whether values are overlaps, in [0, 1], or signed penetration depths.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn is_overlap(&self) -> bool {
        self.field.quantity().is_overlap()
    }

    /// Voxels along x, y and z.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn dims(&self) -> Vec<u32> {
        self.plan.grid().dims.map(|count| count as u32).to_vec()
    }

    /// Its section of the direction (θ, φ), and the exact one.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn compare(&self, theta: f64, phi: f64) -> Result<Comparison, JsError> {
        let orientation = Orientation::new(theta, phi);
        let mut field = vec![0.0; self.plan.grid().len()];
        self.field.section(&orientation, &mut field)?;
        let exact = Exact::new(&self.plan, self.field.quantity(), None)?;
        let exact = exact.sections(&[orientation], Control::quiet())?.concat();
        let mut errors = Errors::default();
        errors.add(&exact, &field, 0.0);
        let report = errors.report(0.0);
        Ok(Comparison { field, exact, mse: report.mse, largest: report.mpe })
    }
}
