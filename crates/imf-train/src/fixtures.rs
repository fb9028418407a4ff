//! What several tests are made with: a small scene, samples of a smooth field, an engine that records its batches.

use std::ops::ControlFlow;

use glam::{DMat4, DVec3};
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::tool::{Clearance, Tool};
use imf_core::unit::LengthUnit;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::INPUTS;

use crate::samples::Samples;
use crate::training::TrainingEngine;
use crate::training::run::Report;

/// A pattern of solid voxels, and the paper's tool.
pub(crate) fn scene() -> Scene {
    let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
    let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
    let obstacle = Occupancy { grid, solid };
    let record = SceneRecord {
        part: "test".into(),
        unit: LengthUnit::Mm,
        transform: DMat4::IDENTITY,
        grid,
        margin: 0,
        conservative: false,
        closed: true,
        tool: Tool::paper(),
        clearance: Clearance::default(),
        bare_tool: None,
        fixtures: Vec::new(),
        contact: None,
        obstacle_crc32: crc32fast::hash(&obstacle.packed()),
    };
    Scene { record, obstacle, layer: None }
}

/// A smooth field over a small grid at five directions.
pub(crate) fn samples() -> Samples {
    let grid = Grid::with_dims(DVec3::ZERO, DVec3::new(1.0, 2.0, 1.5), [6, 11, 9], 0).unwrap();
    let mut samples = Samples::new(grid);
    for section in 0..5 {
        let voxels: Vec<u32> = (0..grid.len() as u32).filter(|v| (v + section) % 3 != 0).collect();
        let value = |voxel: &u32| {
            let unit = grid.unit(grid.centre(grid.voxel(*voxel as usize)));
            (0.5 + 0.4 * ((unit.x + unit.y) * 3.0 + f64::from(section)).sin()) as f32
        };
        let values: Vec<f32> = voxels.iter().map(value).collect();
        samples.push_section([section as f32 * 40.0, 90.0], &voxels, &values);
    }
    samples
}

/// Stops nothing.
pub(crate) fn go_on(_: &Report, _: &mut dyn TrainingEngine) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// An engine that learns nothing and records what it gets.
pub(crate) struct Recorder {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) state: TrainingState,
    /// Inputs and targets of every step.
    pub(crate) batches: Vec<(Vec<f32>, Vec<f32>)>,
    /// From the steps done.
    pub(crate) loss: fn(usize) -> f64,
}

impl Default for Recorder {
    fn default() -> Self {
        Self {
            inputs: INPUTS,
            outputs: 1,
            state: TrainingState::from_parameters(Vec::new()),
            batches: Vec::new(),
            loss: |_| 1.0,
        }
    }
}

impl Recorder {
    /// The bits of every sample, batch after batch.
    pub(crate) fn rows(&self) -> Vec<Vec<[u32; INPUTS + 1]>> {
        let row = |(input, target): (&[f32], &f32)| {
            std::array::from_fn(|i| input.get(i).unwrap_or(target).to_bits())
        };
        let batch =
            |(inputs, targets): &(Vec<f32>, Vec<f32>)| inputs.chunks(INPUTS).zip(targets).map(row).collect();
        self.batches.iter().map(batch).collect()
    }
}

impl TrainingEngine for Recorder {
    fn describe(&self) -> String {
        "a recorder".into()
    }

    fn inputs(&self) -> usize {
        self.inputs
    }

    fn outputs(&self) -> usize {
        self.outputs
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], _: f32) -> Result<(), EngineError> {
        self.batches.push((inputs.to_vec(), targets.to_vec()));
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        Ok((self.loss)(self.batches.len()))
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        Ok(self.state.clone())
    }

    fn replace_parameters(&mut self, _: &[f32]) -> Result<(), EngineError> {
        Ok(())
    }
}
