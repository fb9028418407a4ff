//! What several tests are made with: a small scene, samples of a smooth field, a plan to train by, an engine that records its
//! batches, and comparison with definitions in f64.

use std::ops::ControlFlow;

use glam::{DMat4, DVec3};
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::tool::{Clearance, Tool};
use imf_core::unit::LengthUnit;
use imf_fields::recipe::{TrainingLength, TrainingPlan, TrainingState};
pub(crate) use imf_fields::siren::reference::{as_f64, rows};
use imf_fields::siren::{INPUTS, SirenShape};

use crate::engine::CpuTrainer;
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

/// The bits of every sample, inputs and target.
pub(crate) fn bits(samples: &Samples) -> Vec<[u32; INPUTS + 1]> {
    let sample = |index| {
        let (input, target) = samples.sample(index);
        bits_of(&input, target)
    };
    (0..samples.len()).map(sample).collect()
}

fn bits_of(input: &[f32], target: f32) -> [u32; INPUTS + 1] {
    std::array::from_fn(|i| input.get(i).unwrap_or(&target).to_bits())
}

/// Some epochs of batches that do not divide the samples.
pub(crate) fn plan(epochs: u64) -> TrainingPlan {
    TrainingPlan {
        length: TrainingLength::Epochs(epochs),
        batch: 150,
        report_every: 4,
        seed: 9,
        ..TrainingPlan::default()
    }
}

/// The CPU's engine for a plan's batches.
pub(crate) fn engine(shape: SirenShape, plan: &TrainingPlan, state: TrainingState) -> CpuTrainer {
    CpuTrainer::new(shape.stack(), plan.adam, plan.loss, plan.batch, state).unwrap()
}

/// Seeded numbers in ±1 without pattern: the starting weights of a first layer of five inputs, which are in ±1/5.
pub(crate) fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let shape = SirenShape { width: count, hidden: 1, skip_after: None, omega: 1.0 };
    shape.initial_parameters(seed)[..count].iter().map(|v| v * 5.0).collect()
}

/// A gradient is off by no more than so much of its largest entry: single ones are smaller.
pub(crate) fn assert_gradient(found: &[f32], expected: &[f64], tolerance: f64, name: &str) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let scale = expected.iter().fold(0.0f64, |top, g| top.max(g.abs()));
    for (index, (&found, &expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(found) - expected).abs();
        assert!(error <= tolerance * scale, "{name}, {index}: {found}, not {expected}");
    }
}

/// What `work` returns on a pool of so many threads.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
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
        let batch = |(inputs, targets): &(Vec<f32>, Vec<f32>)| {
            inputs.chunks(INPUTS).zip(targets).map(|(input, &target)| bits_of(input, target)).collect()
        };
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
