//! A field from a file, beside the exact one of the scene that the file holds.

use std::sync::atomic::{AtomicU64, Ordering};

use imf_core::control::Control;
use imf_core::field::{GridField, PoseField, check_lengths};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{SectionPlan, ToolPoints};
use imf_fields::evaluation::ExactReference;
use imf_fields::field::Field;
use imf_fields::metrics::Errors;
use js_sys::Function;
use wasm_bindgen::prelude::wasm_bindgen;
use wasm_bindgen::{JsError, JsValue};

use crate::network::FieldNetwork;
use crate::scene::direction;

/// A field of any family, and the exact sections of its part and tool.
#[wasm_bindgen]
pub struct FieldFile {
    field: Field,
    plan: SectionPlan,
    network: Option<FieldNetwork>,
}

/// The directions of a section, or of a minimum.
#[wasm_bindgen]
pub struct Directions(pub(crate) Vec<Orientation>);

#[wasm_bindgen]
impl Directions {
    /// That of the angles (θ, φ) in degrees.
    ///
    /// # Errors
    /// Angles that are not finite.
    pub fn one(theta: f64, phi: f64) -> Result<Directions, JsError> {
        Ok(Self(vec![direction(theta, phi)?]))
    }

    /// Those of a text such as `fibonacci:225`.
    ///
    /// # Errors
    /// Names the part of the text that is wrong.
    pub fn read(text: &str) -> Result<Directions, JsError> {
        Ok(Self(OrientationSet::parse(text)?.orientations))
    }

    /// How many.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

/// The exact values, and how far a field's are from them.
#[wasm_bindgen]
pub struct Comparison {
    exact: Vec<f32>,
    /// Mean squared error.
    pub mse: f64,
    /// Largest absolute error.
    pub largest: f64,
}

#[wasm_bindgen]
impl Comparison {
    /// The exact values at every voxel, `[x, y, z]` with z side by side.
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
        let file = imf_fields::file::FieldFile::from_bytes(bytes, name)?;
        let network = FieldNetwork::of(&file);
        let field = Field::new(file)?;
        let plan = SectionPlan::of_scene(field.scene(), ToolPoints::Tip)?;
        Ok(Self { field, plan, network })
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

    /// Edge of a voxel.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn pitch(&self) -> f64 {
        self.plan.grid().pitch
    }

    /// Lower corner of voxel (0, 0, 0).
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn origin(&self) -> Vec<f64> {
        self.plan.grid().origin.to_array().to_vec()
    }

    /// Its network, for a graphics card, once; none of a harmonic field.
    #[must_use]
    pub fn network(&mut self) -> Option<FieldNetwork> {
        self.network.take()
    }

    /// Its minimum over the directions at every voxel, `[x, y, z]` with z side by side: of one direction its section. `progress` gets the
    /// fraction that is done, now and then; of one direction it gets none.
    ///
    /// # Errors
    /// No direction.
    pub fn minimum(&self, directions: &Directions, progress: &Function) -> Result<Vec<f32>, JsError> {
        let grid = self.plan.grid();
        if let [direction] = &directions.0[..] {
            let mut section = vec![0.0; grid.len()];
            self.field.section(direction, &mut section)?;
            return Ok(section);
        }
        let all = (grid.len() * directions.0.len()) as f64;
        let done = AtomicU64::new(0);
        let tell = |values| {
            let before = done.fetch_add(values, Ordering::Relaxed);
            // What it throws is ignored.
            drop(progress.call1(&JsValue::NULL, &((before + values) as f64 / all).into()));
        };
        let control = Control { progress: &tell, ..Control::quiet() };
        Ok(self.field.minimum(&directions.0, control)?.value)
    }

    /// Values as the field has them, from those of its network: in [0, 1], or depths as far as they go.
    #[must_use]
    pub fn clamped(&self, mut values: Vec<f32>) -> Vec<f32> {
        let (quantity, pitch) = (self.field.quantity(), self.plan.grid().pitch);
        values.iter_mut().for_each(|value| *value = quantity.clamp(*value, pitch));
        values
    }

    /// The exact minimum over the directions beside the field's.
    ///
    /// # Errors
    /// A tool that does not fit the grid; values that are not one for each voxel.
    pub fn compare(&self, directions: &Directions, field: &[f32]) -> Result<Comparison, JsError> {
        check_lengths(self.plan.grid().len(), field.len())?;
        let exact = ExactReference::new(&self.plan, self.field.quantity(), None)?;
        let exact = exact.minimum(&directions.0, Control::quiet())?.value;
        let mut errors = Errors::default();
        errors.add(&exact, field, 0.0);
        let report = errors.report(0.0);
        Ok(Comparison { exact, mse: report.mse, largest: report.mpe })
    }
}
