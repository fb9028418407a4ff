//! Training of the sine networks, fields of every family, and exact sections, on the GPU, through wgpu (Vulkan, Metal,
//! Direct3D 12).
//!
//! # Where to begin
//! [`Gpu::open`] opens a device. On it [`GpuField`] evaluates poses and grids from a field's file as
//! [`imf_fields::field::Field`] does on the CPU, [`GpuTrainer`] is the training engine, and [`GpuSections`] counts
//! exact sections.
//!
//! # Example
//! One step of a small network, on any device that there is.
#![cfg_attr(no_gpu_tests, doc = "```no_run")]
#![cfg_attr(not(no_gpu_tests), doc = "```")]
//! use imf_fields::recipe::TrainingState;
//! use imf_fields::siren::SirenShape;
//! use imf_gpu::{DeviceChoice, Gpu, GpuTrainer, TrainerSettings};
//! use imf_train::training::TrainingEngine;
//!
//! // `Automatic`, the default, takes hardware alone.
//! let gpu = Gpu::open(&DeviceChoice::Any)?;
//! println!("{}", gpu.describe());
//! let shape = SirenShape { width: 16, ..SirenShape::paper() };
//! let state = TrainingState::new(&shape, 1);
//! let mut trainer = GpuTrainer::new(&gpu, shape.stack(), &TrainerSettings::default(), 64, &state)?;
//! // Two samples of five numbers in [−1, 1], and what they should give.
//! trainer.step(&[0.0, 0.1, 0.2, 0.3, 0.4, -0.5, 0.0, 0.5, 0.0, -1.0], &[0.5, 0.0], 5e-4)?;
//! let loss = trainer.take_mean_loss()?;
//! assert!((0.0..=1.0).contains(&loss));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! GPU objects by lifetime: [`Gpu`] is one open device; a trainer or evaluator compiles its kernels and allocates its
//! buffers once, when it is made; a step or a part of an evaluation only writes inputs and small uniforms and submits.
//!
//! Conventions: parameters cross the door in the flat layout of [`imf_fields::siren::SirenShape::layers`]; inside, every
//! dimension is padded with zeros to what the matrix kernel works in (`layout.rs`). No kernel adds floats atomically, so the same
//! seed on the same adapter gives the same weights, bit for bit. Different adapters agree within rounding.

mod adapter;
mod device;
mod evaluator;
mod field;
mod forward;
mod kernel;
mod layout;
mod memory;
mod over_orientations;
mod peak;
mod sections;
mod shader;
mod submit;
mod trainer;
mod transfer;
mod uniforms;

pub use adapter::{AdapterSummary, DeviceChoice, adapters};
pub use device::{Gpu, GpuLimits};
pub use evaluator::GpuEvaluator;
pub use field::{DeviceGradient, DevicePose, GpuField, decision_of};
pub use peak::Peak;
pub use sections::{GpuSectionError, GpuSections};
pub use shader::MatrixKernel;
pub use trainer::{GpuTrainer, TrainerSettings};
/// The graphics interface in the version that [`Gpu::device`] and [`Gpu::queue`] belong to.
pub use wgpu;
