//! What a program with a graphics card of its own needs to evaluate a field's network there, as the page does by WebGPU.
//!
//! ```text
//! paper's network   points, directions → layers → sigmoid                                         → minimum over directions
//! factored field    points → layers → coefficients, turned out of their frames → × directions → minimum over directions
//! ```

use imf_core::grid::Grid;
use imf_fields::factored::FactoredField;
use imf_fields::file::FieldFile;
use imf_fields::model::Model;
use imf_fields::siren::stack::Stack;
use imf_fields::siren::{features, over_grid};
use wasm_bindgen::prelude::wasm_bindgen;

use crate::field::Directions;

/// The network of a field.
#[wasm_bindgen]
pub struct FieldNetwork {
    family: Family,
    grid: Grid,
}

enum Family {
    Siren(Box<Model>),
    /// In the form that the network is evaluated in: by function of a symmetry-reduced field, else with its linear
    /// layer.
    Factored(Box<FactoredField>),
}

impl FieldNetwork {
    /// That of a field; a harmonic one has none.
    pub(crate) fn of(file: &FieldFile) -> Option<Self> {
        let family = match file {
            FieldFile::Siren(model) => Family::Siren(model.clone()),
            FieldFile::Harmonic(_) => return None,
            FieldFile::Factored(file) if file.field.shape.symmetry.is_none() => {
                Family::Factored(Box::new(file.field.unfolded().into_owned()))
            }
            FieldFile::Factored(file) => Family::Factored(Box::new(file.field.by_function())),
        };
        Some(Self { family, grid: file.scene().record.grid })
    }

    fn stack(&self) -> Stack {
        match &self.family {
            Family::Siren(model) => model.shape.stack(),
            Family::Factored(field) => field.shape.stack(),
        }
    }
}

#[wasm_bindgen]
impl FieldNetwork {
    /// Whether directions are inputs of the network, and its one output goes through the sigmoid. Else outputs are coefficients.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn sees_directions(&self) -> bool {
        matches!(self.family, Family::Siren(_))
    }

    /// The highest degree of the harmonics whose coefficients are in the frames of their places; nothing where frames are the world's.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn turned_degree(&self) -> Option<u32> {
        match &self.family {
            Family::Factored(field) if !field.shape.symmetry.is_none() => Some(field.basis.degree() as u32),
            _ => None,
        }
    }

    /// The factor ω in every sine.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn omega(&self) -> f32 {
        self.stack().omega
    }

    /// Inputs of the network.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.stack().inputs
    }

    /// Five numbers a layer: inputs, outputs, where weights `[outputs][inputs]` and biases begin among the parameters, and 1 where the
    /// network's inputs follow the layer's own.
    #[must_use]
    pub fn layers(&self) -> Vec<u32> {
        let layers = self.stack().layers().into_iter();
        layers
            .flat_map(|layer| {
                [layer.inputs, layer.outputs, layer.weights, layer.biases, usize::from(layer.skip)]
            })
            .map(|number| number as u32)
            .collect()
    }

    /// Weights and biases.
    #[must_use]
    pub fn parameters(&self) -> Vec<f32> {
        match &self.family {
            Family::Siren(model) => model.state.parameters.clone(),
            Family::Factored(field) => field.parameters.clone(),
        }
    }

    /// What the network sees of the centres of some voxels.
    #[must_use]
    pub fn points(&self, first: usize, count: usize) -> Vec<f32> {
        let voxels = first..first + count;
        match &self.family {
            Family::Siren(_) => over_grid::points(&self.grid, voxels)
                .into_iter()
                .flat_map(|point| {
                    let [x, y, z, ..] = features(point, 0.0, 0.0);
                    [x, y, z]
                })
                .collect(),
            Family::Factored(field) => {
                let centres = voxels.map(|voxel| self.grid.centre(self.grid.voxel(voxel)));
                centres.flat_map(|centre| field.input(centre).to_vec()).collect()
            }
        }
    }

    /// The frames of the centres of some voxels: of each the bits of cosine and sine, and across which axes it is mirrored.
    #[must_use]
    pub fn frames(&self, first: usize, count: usize) -> Vec<u32> {
        let Family::Factored(field) = &self.family else { return Vec::new() };
        let centres = (first..first + count).map(|voxel| self.grid.centre(self.grid.voxel(voxel)));
        centres
            .flat_map(|centre| {
                let (_, frame) = field.seen(centre);
                let bits = frame.mirrored.iter().zip(0..).map(|(&mirrored, bit)| u32::from(mirrored) << bit);
                [frame.turn[0].to_bits(), frame.turn[1].to_bits(), bits.sum()]
            })
            .collect()
    }

    /// Directions as the network sees them, two numbers each; else what coefficients are multiplied with, `[direction][coefficients]`,
    /// then the constants of all.
    #[must_use]
    pub fn directions(&self, directions: &Directions) -> Vec<f32> {
        let set = &directions.0;
        match &self.family {
            Family::Siren(_) => set
                .iter()
                .flat_map(|direction| {
                    let [theta, phi] = direction.angles();
                    let [.., theta, phi] = features([0.0; 3], theta, phi);
                    [theta, phi]
                })
                .collect(),
            Family::Factored(field) => {
                let weights = field.direction_weights(set);
                let (along, count) = (weights.along(), set.len());
                let rows = (0..count).flat_map(|direction| along[direction..].iter().step_by(count));
                rows.map(|weight| weight * field.scale).chain(weights.constants().iter().copied()).collect()
            }
        }
    }
}
