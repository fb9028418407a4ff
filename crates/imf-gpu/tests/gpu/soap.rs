//! SOAP on the adapter: its training against the CPU's engine, and states that move between the two.

use imf_fields::recipe::{Loss, Optimiser, SoapConfig, TrainingState};
use imf_fields::siren::stack::{Ending, Stack};
use imf_gpu::{Gpu, GpuTrainer, TrainerSettings};
use imf_train::engine::CpuTrainer;
use imf_train::engine::soap::state_of;
use imf_train::training::TrainingEngine;

use crate::devices::{self, every_device, numbers};
use crate::tolerances::SOAP as APART;

/// With looks between the places where trainings stop, and behind them.
const SOAP: SoapConfig = SoapConfig { beta: 0.9, precondition_every: 3, rate: 1.5 };
const RATE: f32 = 1e-3;

fn settings(optimiser: Optimiser) -> TrainerSettings {
    TrainerSettings { loss: Loss::L2, optimiser, ..TrainerSettings::default() }
}

/// Orthonormal rows: the unit matrix turned by every pair of neighbours, by angles around `angle`.
fn frame(size: usize, angle: f64) -> Vec<f32> {
    let mut rows: Vec<f64> = (0..size * size).map(|i| f64::from(u8::from(i % (size + 1) == 0))).collect();
    for pair in 0..2 * size {
        let (a, b) = (pair % size, (pair * 7 + 1) % size);
        if a == b {
            continue;
        }
        let (sine, cosine) = (angle + 0.01 * pair as f64).sin_cos();
        for column in 0..size {
            let [at_a, at_b] = [a, b].map(|row| row * size + column);
            let (x, y) = (rows[at_a], rows[at_b]);
            (rows[at_a], rows[at_b]) = (cosine * x - sine * y, sine * x + cosine * y);
        }
    }
    rows.iter().map(|&v| v as f32).collect()
}

/// A mean of products with axes of its own, neither those of a [`frame`] nor in their order, each a tenth stronger than the next.
fn mean(size: usize) -> Vec<f32> {
    let own = frame(size, 1.1);
    let strength = |axis: usize| 0.9f32.powi(((axis * 7 + 3) % size) as i32);
    let entry = |place: usize| {
        let (row, column) = (place / size, place % size);
        (0..size).map(|axis| own[axis * size + row] * own[axis * size + column] * strength(axis)).sum()
    };
    (0..size * size).map(entry).collect()
}

/// Largest difference of weights in units of the learning rate.
fn apart(found: &TrainingState, expected: &TrainingState) -> f32 {
    assert_eq!(found.step, expected.step);
    devices::apart(&found.parameters, &expected.parameters) / RATE
}

/// A stretch of training on either engine.
struct Course {
    stack: Stack,
    batch: usize,
    optimiser: Optimiser,
}

impl Course {
    /// Where neither engine's rounding decides what is done. SOAP is some steps old: among its first gradients' axes are some
    /// that carry nothing but rounding, and it steps along all of them alike.
    fn start(&self) -> TrainingState {
        let mut state = TrainingState::from_parameters(self.stack.initial_parameters(5));
        if let Optimiser::Soap(_) = self.optimiser {
            state.step = 4;
            state.first_moment =
                numbers(state.parameters.len(), 0.754_878).iter().map(|v| v * 1e-2).collect();
            let squares = numbers(state.parameters.len(), 0.569_840);
            state.second_moment = squares.iter().map(|v| 1e-3 + 1e-3 * v.abs()).collect();
            for layer in &self.stack.layers()[self.stack.between()] {
                for size in [layer.outputs, layer.inputs] {
                    state.preconditioners.extend(mean(size));
                    state.preconditioners.extend(frame(size, 0.3));
                }
            }
        }
        state
    }

    fn feed(&self, engine: &mut dyn TrainingEngine, steps: std::ops::Range<usize>) -> TrainingState {
        let Stack { inputs: each, outputs, .. } = self.stack;
        for step in steps {
            let inputs = numbers(self.batch * each, 0.618_034 + 0.01 * step as f64);
            let targets: Vec<f32> = inputs
                .chunks_exact(each)
                .flat_map(|p| (0..outputs).map(|a| (p[0] + a as f32 * p[1]).sin() * (1.5 - p[2])))
                .collect();
            engine.step(&inputs, &targets, RATE).expect("a step");
        }
        engine.state().expect("a state")
    }

    fn on_gpu(&self, gpu: &Gpu, state: &TrainingState, steps: std::ops::Range<usize>) -> TrainingState {
        let settings = settings(self.optimiser);
        let mut engine = GpuTrainer::new(gpu, self.stack, &settings, self.batch, state).expect("an engine");
        engine.fill_scratch(f32::NAN).expect("a device");
        self.feed(&mut engine, steps)
    }

    fn on_cpu(&self, state: &TrainingState, steps: std::ops::Range<usize>) -> TrainingState {
        let TrainerSettings { adam, loss, .. } = settings(self.optimiser);
        let mut engine =
            CpuTrainer::new(self.stack, adam, loss, self.batch, state.clone()).expect("an engine");
        match self.optimiser {
            Optimiser::Adam => {}
            Optimiser::Soap(config) => engine.use_soap(config).expect("means and axes"),
        }
        self.feed(&mut engine, steps)
    }
}

/// Stacks with one matrix narrower than a tile, several wider than one, some behind a skip, and none.
fn stacks() -> [Stack; 4] {
    let plain = Stack {
        inputs: 3,
        width: 37,
        hidden: 3,
        skip_after: None,
        omega: 10.0,
        outputs: 7,
        ending: Ending::Linear,
    };
    [
        plain,
        Stack { width: 72, hidden: 4, outputs: 5, ..plain },
        Stack { width: 37, skip_after: Some(1), ..plain },
        Stack { width: 16, hidden: 1, ..plain },
    ]
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn training_is_the_cpus_and_states_move_between_the_two() {
    for stack in stacks() {
        let course = Course { stack, batch: 90, optimiser: Optimiser::Soap(SOAP) };
        let start = course.start();
        let cpu = course.on_cpu(&start, 0..12);
        for gpu in every_device() {
            let name = format!("{}×{}, {}", stack.width, stack.hidden, gpu.matrix_kernel().name());
            let found = course.on_gpu(&gpu, &start, 0..12);
            let there = course.on_gpu(&gpu, &course.on_cpu(&start, 0..4), 4..8);
            let back = course.on_cpu(&there, 8..12);
            println!("{name}: {:.1e}, moved {:.1e}", apart(&found, &cpu), apart(&back, &cpu));
            assert!(apart(&found, &cpu) < APART, "{name}: {}", apart(&found, &cpu));
            assert!(apart(&back, &cpu) < APART, "{name}, moved: {}", apart(&back, &cpu));
            // The engine goes on to the same bits wherever its state was taken.
            let half = course.on_gpu(&gpu, &start, 0..5);
            assert!(course.on_gpu(&gpu, &half, 5..12) == found, "{name}: resumed, it ended elsewhere");
        }
        // Far enough for the comparison to say something.
        let unmoved = TrainingState { step: cpu.step, ..start };
        assert!(apart(&unmoved, &cpu) > 2.0, "{}", apart(&unmoved, &cpu));
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_first_gradient_begins_soaps_means_and_axes_and_moves_no_matrix() {
    // Wider than a workgroup, and so wide that work which is not cut would be lost on software devices.
    let wide = Stack { width: 330, hidden: 2, ..stacks()[0] };
    let all = stacks();
    for stack in all[..3].iter().chain([&wide]) {
        let course = Course { stack: *stack, batch: 90, optimiser: Optimiser::Soap(SOAP) };
        let start = TrainingState::from_parameters(stack.initial_parameters(5));
        let cpu = course.on_cpu(&start, 0..1);
        let expected = squares(stack, &cpu);
        for gpu in every_device() {
            let state = course.on_gpu(&gpu, &start, 0..1);
            for layer in &stack.layers()[stack.between()] {
                let range = layer.weights..layer.biases;
                assert!(state.parameters[range.clone()] == start.parameters[range]);
            }
            for (found, expected) in squares(stack, &state).iter().zip(&expected) {
                let name = format!("{}, {}", found.size, gpu.matrix_kernel().name());
                let largest = expected.mean.iter().fold(0.0f32, |most, v| most.max(v.abs()));
                let off = devices::apart(&found.mean, &expected.mean);
                // Gradients that differ by the rounding of sums of 90 samples, squared.
                assert!(largest > 0.0 && off < 1e-5 * largest, "{name}: {off} of {largest}");
                let size = found.size;
                let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
                let axes: Vec<&[f32]> = found.axes.chunks_exact(size).collect();
                for (i, axis) in axes.iter().enumerate() {
                    for (j, other) in axes.iter().enumerate() {
                        let expected = f32::from(u8::from(i == j));
                        assert!((dot(axis, other) - expected).abs() < 1e-5, "{name}: axes {i} and {j}");
                    }
                }
                // The strongest is far enough from the next for rounding not to turn it.
                assert!((dot(axes[0], &expected.axes[..size]).abs() - 1.0).abs() < 1e-3, "{name}");
            }
        }
    }
}

/// What SOAP keeps of the rows, or of the columns, of one matrix.
struct Square {
    size: usize,
    mean: Vec<f32>,
    axes: Vec<f32>,
}

fn squares(stack: &Stack, state: &TrainingState) -> Vec<Square> {
    let kept = state_of(stack, state.step, &state.preconditioners).expect("means and axes");
    let mut squares = Vec::new();
    for (layer, mut kept) in stack.layers()[stack.between()].iter().zip(kept) {
        for size in [layer.outputs, layer.inputs] {
            let (mean, others) = kept.split_at(size * size);
            let (axes, others) = others.split_at(size * size);
            squares.push(Square { size, mean: mean.to_vec(), axes: axes.to_vec() });
            kept = others;
        }
    }
    squares
}
