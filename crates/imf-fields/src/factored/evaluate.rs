//! The field over a whole grid: g once at every voxel, then the harmonic field's products with all orientations.

use std::borrow::Cow;
use std::ops::Range;

use crate::parallel::*;
use glam::DVec3;
use pulp::Arch;

use super::FactoredField;
use super::symmetry::{LocalHarmonics, MOST_INPUTS, Place};
use crate::harmonic::basis::Basis;
use crate::harmonic::coefficients::{Coefficients, StoragePrecision};
use crate::harmonic::{
    DirectionWeights, FitReport, HarmonicField, Mirrors, Planes, VoxelCoefficients, minimum_of, sections_of,
};
use crate::siren::forward::Network;
use crate::siren::matrix::{Matrix, multiply, prefer_unpacked};
use crate::siren::plan::{Plan, transpose_all};
use crate::siren::scratch::ScratchPool;
use crate::siren::split::{GRID, SplitBoth, SplitWeights, where_many};
use crate::siren::transpose::transpose;
use imf_core::grid::Grid;
use imf_core::section::{Imf, Quantity};
use imf_core::workspaces::Workspaces;

/// A field ready to be evaluated, on the current rayon pool.
pub struct FactoredEvaluator<'a> {
    pub(super) field: Cow<'a, FactoredField>,
    /// The instruction set.
    pub arch: Arch,
    pub(crate) plan: Plan,
    pub(crate) panels: Vec<f32>,
    /// The weights for products by tiles.
    pub(crate) split: Option<SplitWeights>,
    /// The functions for products by tiles, `[function][axis]`.
    pub(crate) split_functions: Option<SplitBoth>,
    /// Two layers of a block.
    layers: ScratchPool,
    /// A block's points.
    places: Workspaces<Vec<Place>>,
    /// Where the network's outputs are along functions of its places' frames.
    pub(super) local: Option<Local>,
}

/// What takes a block's outputs into the world's frame.
pub(super) struct Local {
    harmonics: LocalHarmonics,
    /// Uᵀ: `[components][K]`.
    functions: Vec<f32>,
    /// The outputs of a block.
    outputs: ScratchPool,
}

/// A mirror plane that is so near to the grid's middle, in pitches, takes voxels to voxels.
const NEAR: f64 = 1e-6;
/// Points that pass through the network together.
const BLOCK: usize = HarmonicField::BLOCK;

impl FactoredField {
    /// Lays the weights out for evaluation.
    pub fn evaluator(&self) -> FactoredEvaluator<'_> {
        FactoredEvaluator::new(Cow::Borrowed(self))
    }

    /// As [`FactoredField::evaluator`], with the field inside.
    #[must_use]
    pub fn into_evaluator(self) -> FactoredEvaluator<'static> {
        FactoredEvaluator::new(Cow::Owned(self))
    }
}

impl<'a> FactoredEvaluator<'a> {
    fn new(field: Cow<'a, FactoredField>) -> Self {
        prefer_unpacked();
        let plan = Plan::new(field.shape.stack());
        let mut panels = vec![0.0; field.parameters.len()];
        transpose_all(&plan, &field.parameters, &mut panels);
        let (layers, places) = (ScratchPool::new(2 * BLOCK * plan.stride()), Workspaces::default());
        let arch = Arch::new();
        let split = SplitWeights::new(&plan, &field.parameters);
        let split_functions = SplitBoth::new(&field.components, field.basis.len(), field.shape.components);
        let local = field.local_harmonics().map(|harmonics| {
            let (components, mut functions) = (field.shape.components, vec![0.0; field.components.len()]);
            transpose(&field.components, harmonics.len(), components, &mut functions);
            Local { harmonics, functions, outputs: ScratchPool::new(BLOCK * components) }
        });
        FactoredEvaluator { field, arch, plan, panels, split, split_functions, layers, places, local }
    }

    /// The field that is evaluated.
    pub fn field(&self) -> &FactoredField {
        &self.field
    }

    /// For a call with the given number of points.
    pub(super) fn network(&self, asked: usize) -> Network<'_> {
        let network = Network::new(self.arch, &self.plan, &self.field.parameters, &self.panels);
        Network { split: where_many(self.split.as_ref(), asked), ..network }
    }

    /// The coefficients at up to a block's points (world frame) of a larger call, into `z` as `[point][coefficient]`.
    pub(crate) fn block(&self, points: impl Iterator<Item = DVec3>, asked: usize, z: &mut [f32]) {
        let field = &*self.field;
        self.places.with(|places| {
            places.clear();
            places.extend(points.map(|point| field.shape.symmetry.place(point)));
            let Some(Local { harmonics, functions, outputs }) = &self.local else {
                return self.outputs_at(places, asked, z);
            };
            let (rows, components, count) = (places.len(), field.shape.components, harmonics.len());
            outputs.with(|outputs| {
                let outputs = &mut outputs[..rows * components];
                self.outputs_at(places, asked, outputs);
                z.chunks_exact_mut(count).for_each(|row| row.copy_from_slice(&field.mean));
                match where_many(self.split_functions.as_ref(), asked) {
                    Some(split) => {
                        split.multiply(|of| &of.transposed, (outputs, rows, components), (z, count), true);
                    }
                    None => {
                        let outputs = Matrix::dense(outputs, components);
                        multiply(z, count, outputs, Matrix::dense(functions, count), true);
                    }
                }
            });
            for (row, place) in z.chunks_exact_mut(count).zip(places) {
                harmonics.to_world(place, row);
            }
        });
    }

    /// The network's outputs at up to a block's places, scaled, into `z` as `[place][components]`.
    fn outputs_at(&self, places: &[Place], asked: usize, z: &mut [f32]) {
        let field = &*self.field;
        let mut inputs = [0.0; BLOCK * MOST_INPUTS];
        let inputs = &mut inputs[..places.len() * self.plan.stack.inputs];
        for (input, place) in inputs.chunks_exact_mut(self.plan.stack.inputs).zip(places) {
            input.copy_from_slice(&field.shape.symmetry.inputs_at(&field.grid, place));
        }
        self.layers.with(|layers| {
            let (first, second) = layers.split_at_mut(BLOCK * self.plan.stride());
            let network = self.network(asked);
            let last = network.hidden_layers(inputs, first, second);
            network.outputs(last, z);
        });
        z.iter_mut().for_each(|z| *z *= self.field.scale);
    }

    /// The network's own outputs, not scaled, `[sample][components]` into `out`, of `[sample][input]`.
    pub fn outputs(&self, inputs: &[f32], out: &mut [f32]) {
        self.outputs_and(inputs, out, |_, _| ());
    }

    /// As [`Self::outputs`]; `last_layer` gets each block's first sample and its last hidden layer, `[sample][stride]`.
    fn outputs_and(&self, inputs: &[f32], out: &mut [f32], mut last_layer: impl FnMut(usize, &[f32])) {
        let network = self.network(GRID);
        self.layers.with(|layers| {
            let (first, second) = layers.split_at_mut(BLOCK * self.plan.stride());
            let out = out.chunks_mut(BLOCK * self.field.shape.components);
            let blocks = inputs.chunks(BLOCK * self.plan.stack.inputs).zip(out);
            for (block, (inputs, out)) in blocks.enumerate() {
                let hidden = network.hidden_layers(inputs, first, second);
                network.outputs(hidden, out);
                last_layer(block * BLOCK, hidden);
            }
        });
    }

    /// The last hidden layer's activations with a 1 behind them, into `last` as `[point][width + 1]`, and the network's own
    /// outputs, not scaled, into `outputs` as `[point][components]`.
    pub fn with_last_layer(
        &self,
        points: impl Iterator<Item = DVec3>,
        last: &mut [f32],
        outputs: &mut [f32],
    ) {
        let (width, stride) = (self.plan.stack.width, self.plan.stride());
        let mut inputs = Vec::with_capacity(points.size_hint().0 * self.field.shape.symmetry.inputs());
        points.for_each(|point| inputs.extend_from_slice(&self.field.input(point)));
        self.outputs_and(&inputs, outputs, |first, hidden| {
            let rows = last.chunks_exact_mut(width + 1).skip(first);
            for (last, hidden) in rows.zip(hidden.chunks_exact(stride)) {
                last[..width].copy_from_slice(&hidden[..width]);
                last[width] = 1.0;
            }
        });
    }

    /// The sections of some orientations, `[orientation][voxel]` into `sections`, in [0, 1].
    ///
    /// # Panics
    /// If `sections` has not that length.
    pub fn sections(&self, weights: &DirectionWeights, sections: &mut [f32]) {
        sections_of(self, weights, sections);
    }

    /// The minimum over the orientations at every voxel with the first orientation that attains it, as
    /// [`HarmonicField::minimum`].
    pub fn minimum(&self, weights: &DirectionWeights) -> Imf {
        minimum_of(self, weights)
    }

    /// The coefficients at every voxel, for many evaluations; `report` is the teacher's.
    pub fn expanded(&self, precision: StoragePrecision, report: FitReport) -> HarmonicField {
        let (field, components) = (&self.field, self.field.coefficient_count());
        let mut coefficients = vec![0.0; field.grid.len() * components];
        coefficients.par_chunks_mut(BLOCK * components).enumerate().for_each(|(block, z)| {
            let from = block * BLOCK;
            let voxels = from..from + z.len() / components;
            self.block(voxels.map(|voxel| field.grid.centre(field.grid.voxel(voxel))), GRID, z);
        });
        let (functions, mean) = field.functions_in_world();
        HarmonicField {
            quantity: field.quantity,
            grid: field.grid,
            basis: field.basis.clone(),
            components: functions.into_owned(),
            mean: mean.into_owned(),
            coefficients: Coefficients::new(coefficients, precision),
            report,
        }
    }
}

impl VoxelCoefficients for FactoredEvaluator<'_> {
    fn quantity(&self) -> Quantity {
        self.field.quantity
    }

    fn grid(&self) -> &Grid {
        &self.field.grid
    }

    fn components(&self) -> usize {
        self.field.coefficient_count()
    }

    fn mirrors(&self, _: usize) -> Option<Mirrors> {
        let (local, grid) = (self.local.as_ref()?, &self.field.grid);
        let middle = grid.origin + 0.5 * grid.size();
        let across = [0, 1, 2].map(|axis| {
            let plane = self.field.shape.symmetry.mirrors[axis];
            plane.is_some_and(|plane| (plane - middle[axis]).abs() <= NEAR * grid.pitch)
        });
        let planes = Planes::new(grid.dims, across);
        Mirrors::new(planes, planes.parities(self.field.basis.degree(), local.harmonics.order()))
    }

    fn read<'a>(&'a self, voxels: Range<usize>, scratch: &'a mut Vec<f32>) -> &'a [f32] {
        scratch.resize(voxels.len() * self.components(), 0.0);
        let grid = &self.field.grid;
        self.block(voxels.map(|voxel| grid.centre(grid.voxel(voxel))), GRID, scratch);
        scratch
    }

    fn at(&self, points: &mut dyn Iterator<Item = DVec3>, z: &mut [f32], _: &mut Vec<f32>) {
        self.block(points, z.len() / self.components(), z);
    }

    fn functions(&self) -> (&Basis, &[f32], &[f32]) {
        (&self.field.basis, &self.field.components, &self.field.mean)
    }

    fn order(&self) -> Option<[usize; 3]> {
        self.local.as_ref().map(|local| local.harmonics.order())
    }
}
