//! The shaders' own sine and cosine against f64, alone.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod adapter;

use imf_gpu::shader::sine_source;
use imf_gpu::{Gpu, wgpu};

/// One invocation takes four angles.
const PROBE: &str = "
@group(0) @binding(0) var<storage, read> angles: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> sines: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> cosines: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&angles) {
        let result = sine_cosine(angles[id.x]);
        sines[id.x] = result.sine;
        cosines[id.x] = result.cosine;
    }
}
";

/// Sines and cosines as the device computes them. `angles` is a multiple of four.
fn on_device(gpu: &Gpu, angles: &[f32]) -> [Vec<f32>; 2] {
    let device = gpu.device();
    let source = format!("{}{PROBE}", sine_source());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let size = 4 * angles.len() as u64;
    let buffer = |usage| {
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let input = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST);
    let outputs = [0, 1].map(|_| buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC));
    let staging = [0, 1].map(|_| buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST));
    gpu.queue().write_buffer(&input, 0, bytemuck::cast_slice(angles));
    let entries = [&input, &outputs[0], &outputs[1]].map(wgpu::Buffer::as_entire_binding);
    let entries: Vec<wgpu::BindGroupEntry<'_>> =
        (0..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((angles.len() / 4).div_ceil(64) as u32, 1, 1);
    }
    for (output, staging) in outputs.iter().zip(&staging) {
        encoder.copy_buffer_to_buffer(output, 0, staging, 0, size);
        encoder.map_buffer_on_submit(staging, wgpu::MapMode::Read, .., |result| result.unwrap());
    }
    gpu.queue().submit([encoder.finish()]);
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    staging.map(|staging| bytemuck::pod_collect_to_vec(&staging.get_mapped_range(..).unwrap()))
}

/// Rounding of the reduced angle, of the polynomial's sums and of the result: 9.1e-8 on lavapipe, with room for a device that
/// contracts sums differently.
const TOLERANCE: f64 = 3e-7;

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn sine_and_cosine_are_good_to_three_tenths_of_a_millionth() {
    let gpu = adapter::open();
    let mut angles: Vec<f32> = (0..200_000).map(|i| (i as f32 - 100_000.0) * 0.010_007).collect();
    // Around multiples of π/2, where the reduction cancels most.
    for n in -636..=636 {
        let at = (f64::from(n) * std::f64::consts::FRAC_PI_2) as f32;
        angles.extend([at, at.next_up(), at.next_down(), at + 1e-4]);
    }
    angles.extend([0.0, -0.0, 1e-20, f32::MIN_POSITIVE]);
    let [sines, cosines] = on_device(&gpu, &angles);
    let mut worst = (0.0, 0.0);
    for ((&x, &sine), &cosine) in angles.iter().zip(&sines).zip(&cosines) {
        let x = f64::from(x);
        let error = (f64::from(sine) - x.sin()).abs().max((f64::from(cosine) - x.cos()).abs());
        if error > worst.0 || error.is_nan() {
            worst = (error, x);
        }
    }
    println!("largest error {:.2e} at {}", worst.0, worst.1);
    assert!(worst.0 <= TOLERANCE, "error {} at {}", worst.0, worst.1);
}
