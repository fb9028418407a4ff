//! A look at the axes of the rows, or of the columns, of all matrices: M·Q by falling mean, made orthonormal.
//!
//! ```text
//! M·Q → means, order → panels of reflections, each then taken to the axes behind it → all of them back to the unit matrix → Q
//! ```
//!
//! The work of a dispatch has bounds of its own. Mesa's software Vulkan ends every loop of an invocation once it has gone
//! through 65,535 turns of all loops together, and says nothing; a workgroup of a GPU must not hold it for long either.

use imf_core::field::EngineError;

use super::products::{BoundProduct, Factor, Products};
use super::side::SidePlaces;
use crate::device::Gpu;
use crate::kernel::{Bound, Kernel, uniform};
use crate::shader::{SOAP_PANEL, Shader};
use crate::uniforms::Panel;

/// Turns of the loops of an invocation that takes reflections to an axis, at most: two for each number of each.
const MOST_TURNS: usize = 1 << 15;

/// The kernels of looks.
pub(super) struct LookKernels {
    means: Kernel,
    order: Kernel,
    panel: Kernel,
    reflect: Kernel,
}

impl LookKernels {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        Ok(Self {
            means: Kernel::new(gpu, Shader::SoapMeans)?,
            order: Kernel::new(gpu, Shader::SoapOrder)?,
            panel: Kernel::new(gpu, Shader::SoapPanel)?,
            reflect: Kernel::new(gpu, Shader::SoapReflect)?,
        })
    }
}

/// A look of one side, bound.
#[derive(Debug)]
pub(super) struct Look {
    count: usize,
    stride: usize,
    turned: BoundProduct,
    means: Bound,
    order: Bound,
    /// Each with what takes it to the axes behind.
    panels: Vec<(Bound, Vec<Reflections>)>,
    back: Vec<Reflections>,
}

/// Some reflections, and how many axes they are taken to.
#[derive(Debug)]
struct Reflections {
    kernel: Bound,
    axes: usize,
}

impl Look {
    /// For `count` matrices whose mean is M.
    pub(super) fn new(
        gpu: &Gpu,
        kernels: &LookKernels,
        products: &Products<'_>,
        places: &SidePlaces,
        buffers: &[wgpu::Buffer],
        count: usize,
    ) -> Result<Self, EngineError> {
        let stride = places.stride;
        let [table, mean, axes, turned, before, reflections, order, line] =
            places.all().map(|place| &buffers[place]);
        let block = |span: &std::ops::Range<usize>, behind: usize, backwards: bool| {
            let panel = Panel {
                first: span.start as u32,
                end: span.end as u32,
                behind: behind as u32,
                backwards: backwards.into(),
            };
            uniform(gpu, "reflections", &panel)
        };
        let spans = |length: usize| {
            let span = move |start: usize| start..(start + length).min(stride);
            (0..stride).step_by(length).map(span)
        };
        // Once M·Q is in order, its place is the vectors'.
        let vectors = turned;
        let taken = |span: std::ops::Range<usize>, behind: usize, to: &wgpu::Buffer, backwards| {
            let block = block(&span, behind, backwards)?;
            let kernel = kernels.reflect.bind(gpu, &[&block, table, vectors, to]);
            Ok::<_, EngineError>(Reflections { kernel, axes: stride - behind })
        };
        let panel = SOAP_PANEL as usize;
        // A power of two, as a panel's length is: no part lies in two panels.
        let at_once = 1 << (MOST_TURNS / (2 * stride)).clamp(1, panel).ilog2();
        let mut panels = Vec::new();
        for own in spans(panel) {
            let found =
                kernels.panel.bind(gpu, &[&block(&own, own.end, false)?, table, reflections, vectors]);
            let parts = spans(at_once).filter(|part| own.contains(&part.start) && own.end < stride);
            let behind = parts.map(|part| taken(part, own.end, reflections, false));
            panels.push((found, behind.collect::<Result<_, _>>()?));
        }
        let mut back = spans(at_once)
            .map(|part| taken(part.clone(), part.start, axes, true))
            .collect::<Result<Vec<_>, _>>()?;
        back.reverse();
        Ok(Self {
            count,
            stride,
            turned: products.of([stride; 3], [Factor::Plain(mean), Factor::Plain(axes)], turned)?,
            means: kernels.means.bind(gpu, &[table, axes, turned, before, line]),
            order: kernels.order.bind(gpu, &[table, line, turned, order, reflections, axes]),
            panels,
            back,
        })
    }

    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.turned.record(pass);
        self.means.sliced(pass, self.stride, self.count);
        self.order.sliced(pass, self.stride, self.count);
        for (found, behind) in &self.panels {
            found.sliced(pass, 1, self.count);
            behind.iter().for_each(|taken| taken.kernel.sliced(pass, taken.axes, self.count));
        }
        self.back.iter().for_each(|taken| taken.kernel.sliced(pass, taken.axes, self.count));
    }
}
