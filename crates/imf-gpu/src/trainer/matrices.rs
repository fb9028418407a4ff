//! The matrices between hidden layers, where another optimiser than Adam steps them: what they fit in, where they lie
//! among the parameters, and what steps them.

use imf_core::field::EngineError;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::TrainingState;

use super::Buffers;
use super::muon::{MuonPlaces, MuonStep};
use super::soap::{SoapPlaces, SoapStep};
use crate::device::Gpu;
use crate::forward::Network;
use crate::kernel::{Bound, uniform};
use crate::layout::PaddedLayout;
use crate::memory::Plan;
use crate::shader::{LINEAR_GROUP, MATRIX_GROUPS};
use crate::uniforms::{Between, MatrixPlace};

/// How many matrices lie between hidden layers, and what they fit in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Matrices {
    pub(super) count: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
}

impl Matrices {
    /// Those of a network; none where there is one hidden layer.
    fn of(layout: &PaddedLayout) -> Option<Self> {
        let between = layout.between();
        let rows = between.first()?.outputs;
        let columns = between.iter().map(|layer| layer.inputs).max()?;
        Some(Self { count: between.len(), rows, columns })
    }

    /// Writes into `table` where each stands, and by how much a step is longer than the learning rate, by the inputs that it
    /// learns from; returns what the kernels know of them all, moments of which a step leaves the share `kept`.
    pub(super) fn upload(
        &self,
        gpu: &Gpu,
        layout: &PaddedLayout,
        table: &wgpu::Buffer,
        kept: f32,
        length: impl Fn(usize) -> f32,
    ) -> Result<wgpu::Buffer, EngineError> {
        let both = layout.between().iter().zip(layout.learnt_between());
        let places: Vec<MatrixPlace> = both
            .map(|(layer, learnt)| MatrixPlace {
                weights: layer.weights as u32,
                columns: layer.inputs as u32,
                length: length(learnt.inputs),
            })
            .collect();
        gpu.queue().write_buffer(table, 0, bytemuck::cast_slice(&places));
        let (rows, columns) = (self.rows as u32, self.columns as u32);
        uniform(gpu, "matrices", &Between { rows, columns, kept, one_minus_kept: 1.0 - kept })
    }

    /// A kernel that goes over the numbers of all matrices.
    pub(super) fn each(&self, pass: &mut wgpu::ComputePass<'_>, kernel: &Bound) {
        kernel.sliced(pass, (MATRIX_GROUPS * LINEAR_GROUP) as usize, self.count);
    }
}

/// Places of what an optimiser of matrices works with in a trainer's plan.
pub(super) enum MatrixPlaces {
    Muon(MuonPlaces),
    Soap(SoapPlaces),
}

impl MatrixPlaces {
    /// None where Adam steps all parameters, or there is no matrix.
    pub(super) fn plan(plan: &mut Plan, layout: &PaddedLayout, optimiser: Optimiser) -> Option<Self> {
        let matrices = Matrices::of(layout)?;
        match optimiser {
            Optimiser::Adam => None,
            Optimiser::Muon(config) => Some(Self::Muon(MuonPlaces::plan(plan, config, matrices))),
            Optimiser::Soap(config) => Some(Self::Soap(SoapPlaces::plan(plan, config, matrices))),
        }
    }

    /// What a step writes before it reads it.
    pub(super) fn scratch(&self) -> Vec<usize> {
        match self {
            Self::Muon(places) => places.scratch().into(),
            Self::Soap(places) => places.scratch(),
        }
    }
}

/// What steps all matrices, bound.
#[derive(Debug)]
pub(super) enum MatrixStep {
    Muon(MuonStep),
    Soap(Box<SoapStep>),
}

impl MatrixStep {
    /// Compiles and binds the kernels and uploads what `state` keeps; `buffers` are those of the trainer's plan.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        places: &MatrixPlaces,
        buffers: &[wgpu::Buffer],
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        Ok(match places {
            MatrixPlaces::Muon(places) => Self::Muon(MuonStep::new(gpu, network, host, places, buffers)?),
            MatrixPlaces::Soap(places) => {
                Self::Soap(SoapStep::new(gpu, network, host, places, buffers, state)?.into())
            }
        })
    }

    /// Step number `step`, counted from 1, by a gradient that is whole.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>, step: u64) {
        match self {
            Self::Muon(muon) => muon.record(pass),
            Self::Soap(soap) => soap.record(pass, step),
        }
    }

    /// What is kept beside the moments, as a state has it.
    pub(super) fn kept(&self, gpu: &Gpu, layout: &PaddedLayout) -> Result<Vec<f32>, EngineError> {
        match self {
            Self::Muon(_) => Ok(Vec::new()),
            Self::Soap(soap) => soap.kept(gpu, layout),
        }
    }
}
