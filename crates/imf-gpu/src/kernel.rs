//! A compiled kernel, what it is bound to, and how many workgroups it takes.

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::shader::{Factors, LINEAR_GROUP, Shader, TILE};

/// A compiled kernel. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    name: String,
}

/// A kernel with its buffers.
#[derive(Debug)]
pub(crate) struct Bound {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

impl Kernel {
    /// Compiles a shader for the device's matrix kernel.
    pub(crate) fn new(gpu: &Gpu, shader: Shader) -> Result<Self, EngineError> {
        Self::with_factors(gpu, shader, Factors::Single)
    }

    /// The same matrix product for the layers between the first and the last: itself where their factors are f32.
    pub(crate) fn between_layers(
        &self,
        gpu: &Gpu,
        shader: Shader,
        factors: Factors,
    ) -> Result<Self, EngineError> {
        match factors {
            Factors::Single => Ok(self.clone()),
            _ => Self::with_factors(gpu, shader, factors),
        }
    }

    /// As [`Self::new`], for a matrix product with these factors.
    fn with_factors(gpu: &Gpu, shader: Shader, factors: Factors) -> Result<Self, EngineError> {
        let name = format!("{shader:?}, {}", factors.name());
        let pipeline = gpu.guarded(|| {
            let module = wgpu::ShaderModuleDescriptor {
                label: Some(&name),
                source: wgpu::ShaderSource::Wgsl(shader.source(gpu.matrix_kernel(), factors).into()),
            };
            let module = match shader.has_counting_loops() {
                true => with_loops_as_they_stand(gpu.device(), module),
                false => gpu.device().create_shader_module(module),
            };
            gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&name),
                layout: None,
                module: &module,
                entry_point: Some("main"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    // Products in tiles write all of their workgroup memory before they read it; so does the loss.
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        })?;
        Ok(Self { pipeline, name })
    }

    /// Binds whole buffers to bindings 0, 1, 2, …
    pub(crate) fn bind(&self, gpu: &Gpu, buffers: &[&wgpu::Buffer]) -> Bound {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = buffers
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Bound { pipeline: self.pipeline.clone(), group }
    }
}

impl Bound {
    fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, groups: [u32; 3]) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
    }

    /// A matrix product with `rows` × `columns` outputs in each of `slices` slices.
    pub(crate) fn product(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        rows: usize,
        columns: usize,
        slices: usize,
    ) {
        let tiles = |n: usize| n.div_ceil(TILE as usize) as u32;
        self.dispatch(pass, [tiles(columns), tiles(rows), slices as u32]);
    }

    /// A kernel that strides over `count` elements, with at most `limit` workgroups.
    pub(crate) fn linear(&self, pass: &mut wgpu::ComputePass<'_>, count: usize, limit: u32) {
        let groups = count.div_ceil(LINEAR_GROUP as usize).min(limit as usize) as u32;
        self.dispatch(pass, [groups.max(1), 1, 1]);
    }

    /// A kernel with one invocation for each of `count` elements in each of `slices` slices.
    pub(crate) fn sliced(&self, pass: &mut wgpu::ComputePass<'_>, count: usize, slices: usize) {
        self.dispatch(pass, [count.div_ceil(LINEAR_GROUP as usize) as u32, slices as u32, 1]);
    }

    /// A kernel of one workgroup.
    pub(crate) fn single(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.dispatch(pass, [1, 1, 1]);
    }
}

/// The module of a shader with constant steps. By default the graphics interface counts the turns of every loop, to end those that
/// never do, which stands in the way of unrolling a product's inner loop.
#[expect(unsafe_code, reason = "wgpu's way of saying that it is left to us that loops end")]
fn with_loops_as_they_stand(
    device: &wgpu::Device,
    module: wgpu::ShaderModuleDescriptor<'_>,
) -> wgpu::ShaderModule {
    let checks =
        wgpu::ShaderRuntimeChecks { force_loop_bounding: false, ..wgpu::ShaderRuntimeChecks::checked() };
    // SAFETY: only shaders of this crate come here whose loops count up to a bound in constant steps (`tests/shaders.rs` looks at
    // all of them). Every other check, that of bounds above all, stays.
    unsafe { device.create_shader_module_trusted(module, checks) }
}

/// A uniform buffer with its first contents.
pub(crate) fn uniform<T: bytemuck::Pod>(
    gpu: &Gpu,
    name: &str,
    value: &T,
) -> Result<wgpu::Buffer, EngineError> {
    let buffer = gpu.guarded(|| {
        gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size: size_of::<T>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    })?;
    gpu.queue().write_buffer(&buffer, 0, bytemuck::bytes_of(value));
    Ok(buffer)
}
