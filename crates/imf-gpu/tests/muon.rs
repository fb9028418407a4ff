//! Muon on the adapter: its step against the definition in f64, its training against the CPU's engine, and states that move
//! between the two.

mod adapter;

use imf_core::factored::{FactoredShape, FactoredState, INPUTS, Optimiser, Symmetry};
use imf_core::siren::SirenShape;
use imf_core::siren::engine::CpuTrainer;
use imf_core::siren::muon::{LENGTH, MuonConfig, QUINTIC, STEPS};
use imf_core::training::{Loss, TrainingEngine, TrainingState};
use imf_gpu::{Gpu, GpuTrainer, MatrixKernel, TrainerSettings};

const CONFIG: MuonConfig = MuonConfig { momentum: 0.9, rate: 1.5 };
const RATE: f32 = 1e-3;

fn every_device() -> [Gpu; 2] {
    let gpu = adapter::open();
    MatrixKernel::ALL.map(|kernel| gpu.clone().with_matrix_kernel(kernel))
}

fn settings() -> TrainerSettings {
    TrainerSettings { loss: Loss::L2, optimiser: Optimiser::Muon(CONFIG), ..TrainerSettings::default() }
}

/// Multiples of irrational numbers, modulo 1, in [−1, 1].
fn numbers(count: usize, step: f64) -> Vec<f32> {
    (0..count).map(|i| ((i as f64 * step).fract() * 2.0 - 1.0) as f32).collect()
}

/// `X` of the definition: five Newton-Schulz steps of `u/‖u‖`, `[rows][columns]`, in f64.
fn orthogonalised(u: &[f64], rows: usize) -> Vec<f64> {
    let columns = u.len() / rows;
    let norm = u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut x: Vec<f64> = u.iter().map(|v| v / norm).collect();
    let product = |a: &[f64], b: &dyn Fn(usize, usize) -> f64, inner: usize, width: usize| -> Vec<f64> {
        let each =
            |place: usize| (0..inner).map(|k| a[place / width * inner + k] * b(k, place % width)).sum();
        (0..a.len() / inner * width).map(each).collect()
    };
    let [a, b, c] = QUINTIC.map(f64::from);
    for _ in 0..STEPS {
        let gram = product(&x, &|k, column| x[column * columns + k], columns, rows);
        let square = product(&gram, &|k, column| gram[k * rows + column], rows, rows);
        let both: Vec<f64> = gram.iter().zip(square).map(|(g, s)| b * g + c * s).collect();
        let turned = product(&both, &|k, column| x[k * columns + column], rows, columns);
        x = x.iter().zip(turned).map(|(x, t)| a * x + t).collect();
    }
    x
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_step_is_the_definitions_with_a_skip_and_without() {
    for (width, skip_after) in [(37, Some(1)), (24, None)] {
        let shape = SirenShape { width, hidden: 3, skip_after, omega: 10.0 };
        let mut state = TrainingState::new(&shape, 3);
        // Momentum from earlier steps.
        state.first_moment = numbers(state.parameters.len(), 0.754_878).iter().map(|v| v * 1e-3).collect();
        let count = 70;
        let (inputs, targets) = (numbers(count * 5, 0.618_034), numbers(count, 0.569_840));
        for gpu in every_device() {
            let mut trainer = GpuTrainer::of_stack(&gpu, shape.stack(), &settings(), count, &state).unwrap();
            trainer.fill_scratch(f32::NAN).unwrap();
            let gradient = trainer.loss_and_gradient(&inputs, &targets).unwrap().1;
            trainer.step(&inputs, &targets, RATE).unwrap();
            let found = trainer.state().unwrap();
            let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
            let kept = f64::from(CONFIG.momentum);
            for layer in &shape.stack().layers()[1..shape.hidden] {
                let range = layer.weights..layer.biases;
                let [weights, before, gradient, after, momentum] = [
                    &state.parameters,
                    &state.first_moment,
                    &gradient,
                    &found.parameters,
                    &found.first_moment,
                ]
                .map(|all| wide(&all[range.clone()]));
                let expected: Vec<f64> =
                    before.iter().zip(&gradient).map(|(m, g)| kept * m + (1.0 - kept) * g).collect();
                let u: Vec<f64> =
                    expected.iter().zip(&gradient).map(|(m, g)| kept * m + (1.0 - kept) * g).collect();
                let length = f64::from(RATE * CONFIG.rate * LENGTH) * (layer.inputs as f64).sqrt();
                for (place, x) in orthogonalised(&u, layer.outputs).iter().enumerate() {
                    let name = format!("{width}, {}, {place}", gpu.matrix_kernel().name());
                    // One rounding of numbers up to 1e-3.
                    assert!((momentum[place] - expected[place]).abs() < 1e-9, "{name}");
                    // X is right to some 1e-5 (singular values near 0 grow 485 times in five steps, and their rounding
                    // with them), and the weight, up to 0.5, is rounded once.
                    let step = weights[place] - after[place];
                    assert!((step - length * x).abs() < 2e-5 * length + 6e-8, "{name}: {step}, {x}");
                }
                assert!(found.second_moment[range] == state.second_moment[layer.weights..layer.biases]);
            }
            assert_eq!(found.step, state.step + 1);
        }
    }
}

/// Largest difference of weights in units of the learning rate, or of first moments in units of their largest, whichever is
/// larger.
fn apart(a: &TrainingState, b: &TrainingState) -> f32 {
    let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
    assert_eq!(a.step, b.step);
    let zeros = vec![0.0; b.first_moment.len()];
    let moments = largest(&a.first_moment, &b.first_moment) / largest(&b.first_moment, &zeros).max(1e-30);
    moments.max(largest(&a.parameters, &b.parameters) / RATE)
}

/// A stretch of training on either engine.
struct Course {
    shape: FactoredShape,
    batch: usize,
}

impl Course {
    fn feed(&self, engine: &mut dyn TrainingEngine, steps: std::ops::Range<usize>) {
        for step in steps {
            let inputs = numbers(self.batch * INPUTS, 0.618_034 + 0.01 * step as f64);
            let targets: Vec<f32> = inputs
                .chunks_exact(INPUTS)
                .flat_map(|p| (0..self.shape.axes).map(|a| (p[0] + a as f32 * p[1]).sin() * (1.5 - p[2])))
                .collect();
            engine.step(&inputs, &targets, RATE).expect("a step");
        }
    }

    fn on_gpu(&self, gpu: &Gpu, state: &TrainingState, steps: std::ops::Range<usize>) -> TrainingState {
        let mut engine =
            GpuTrainer::of_stack(gpu, self.shape.stack(), &settings(), self.batch, state).expect("an engine");
        self.feed(&mut engine, steps);
        engine.state().expect("a state")
    }

    fn on_cpu(&self, state: &TrainingState, steps: std::ops::Range<usize>) -> TrainingState {
        let TrainerSettings { adam, loss, .. } = settings();
        let (stack, state) = (self.shape.stack(), state.clone());
        let mut engine = CpuTrainer::of_stack(stack, adam, loss, self.batch, state).expect("an engine");
        engine.use_muon(CONFIG);
        self.feed(&mut engine, steps);
        engine.state().expect("a state")
    }
}

/// Twelve steps that each round weights of up to 0.5, by 3e-5 of the learning rate, and gradients that differ by their own
/// rounding; 1.2e-4 was found. Another iteration, length or order of the two averages parts them by more than 0.1.
const APART: f32 = 2e-3;

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn training_is_the_cpus_and_states_move_between_the_two() {
    // Matrices narrower than a tile, wider than one, several of them, and none.
    for (width, hidden, axes) in [(37, 3, 7), (72, 4, 5), (16, 1, 3)] {
        let course = Course {
            shape: FactoredShape {
                width,
                hidden,
                omega: 10.0,
                axes,
                folded: false,
                symmetry: Symmetry::default(),
            },
            batch: 90,
        };
        let start = FactoredState::new(&course.shape, 5).training;
        let cpu = course.on_cpu(&start, 0..12);
        for gpu in every_device() {
            let name = format!("{width}×{hidden}, {}", gpu.matrix_kernel().name());
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
