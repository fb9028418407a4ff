//! A compiled kernel, the buffers that it is bound to, and how many workgroups it takes.

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::shader::{LINEAR_GROUP, Shader, TILE};
use crate::uniforms::Batch;

/// A compiled kernel. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    gpu: Gpu,
    pipeline: wgpu::ComputePipeline,
    name: String,
}

/// How many invocations a dispatch has, by the rows at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// Strides over this number of elements of every row.
    Rows(usize),
    /// Strides over the rows, those of padding among them.
    PaddedRows,
    /// Strides over this number of elements.
    Elements(usize),
    /// A matrix product with this number of columns for every row, those of padding among them.
    Product(usize),
    /// A matrix product of this number of rows and columns in every slice.
    SlicedProduct(usize, usize),
    /// One invocation for each of this number of elements in every slice.
    Sliced(usize),
    /// One workgroup.
    Single,
}

/// A kernel with its buffers and its extent.
#[derive(Debug)]
pub(crate) struct Dispatch {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    extent: Extent,
    /// Workgroups of one that strides, at most.
    most_groups: u32,
}

impl Kernel {
    /// Compiles a shader for the device's matrix kernel.
    pub(crate) fn new(gpu: &Gpu, shader: Shader) -> Result<Self, EngineError> {
        Self::compile(gpu, shader, false)
    }

    /// The same matrix product with factors rounded to f16, if `half`; else itself.
    pub(crate) fn rounded(&self, shader: Shader, half: bool) -> Result<Self, EngineError> {
        if half { Self::compile(&self.gpu, shader, true) } else { Ok(self.clone()) }
    }

    fn compile(gpu: &Gpu, shader: Shader, half: bool) -> Result<Self, EngineError> {
        let name = format!("{shader:?}, {}", if half { "f16" } else { "f32" });
        let source = shader.source(gpu.matrix_kernel(), half);
        Self::of_source(gpu, name, source, shader.has_counting_loops())
    }

    /// Compiles a text with the entry point `main`, whose loops all count up to a bound, if so declared.
    pub(crate) fn of_source(
        gpu: &Gpu,
        name: String,
        source: String,
        counting_loops: bool,
    ) -> Result<Self, EngineError> {
        let pipeline = gpu.in_error_scope(|| {
            let module = wgpu::ShaderModuleDescriptor {
                label: Some(&name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            };
            let module = match counting_loops {
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
        Ok(Self { gpu: gpu.clone(), pipeline, name })
    }

    /// Binds whole buffers to bindings 0, 1, 2, …
    pub(crate) fn bind(&self, extent: Extent, buffers: &[&wgpu::Buffer]) -> Dispatch {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = buffers
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let group = self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let most_groups = self.gpu.limits().workgroups;
        Dispatch { pipeline: self.pipeline.clone(), group, extent, most_groups }
    }
}

impl Dispatch {
    /// Records it for the rows and slices at hand.
    pub(crate) fn record(&self, pass: &mut wgpu::ComputePass<'_>, batch: Batch) {
        let Batch { rows, padded_rows, slices, .. } = batch;
        let groups = |count: usize| count.div_ceil(LINEAR_GROUP as usize) as u32;
        let striding = |count: usize| [groups(count).clamp(1, self.most_groups), 1, 1];
        let tiles = |n: usize| n.div_ceil(TILE as usize) as u32;
        let [x, y, z] = match self.extent {
            Extent::Rows(each) => striding(rows as usize * each),
            Extent::PaddedRows => striding(padded_rows as usize),
            Extent::Elements(count) => striding(count),
            Extent::Product(columns) => [tiles(columns), tiles(padded_rows as usize), 1],
            Extent::SlicedProduct(rows, columns) => [tiles(columns), tiles(rows), slices],
            Extent::Sliced(count) => [groups(count), slices, 1],
            Extent::Single => [1, 1, 1],
        };
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(x, y, z);
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
    // SAFETY: only shaders of this crate come here whose loops count up to a bound in constant steps
    // (`shader/tests.rs` checks all of them). Every other check, that of bounds above all, stays.
    unsafe { device.create_shader_module_trusted(module, checks) }
}

/// A uniform buffer with its first contents.
pub(crate) fn uniform<T: bytemuck::Pod>(
    gpu: &Gpu,
    name: &str,
    value: &T,
) -> Result<wgpu::Buffer, EngineError> {
    let buffer = gpu.in_error_scope(|| {
        gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size: size_of::<T>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    })?;
    gpu.write(&buffer, std::slice::from_ref(value));
    Ok(buffer)
}
