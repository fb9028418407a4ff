//! An update of the axes of the rows, or of the columns, of all matrices: M·Q by falling mean, made orthonormal.
//!
//! ```text
//! M·Q → means, order → panels of reflections, each then taken to the axes behind it → all of them back to the unit matrix → Q
//! ```
//!
//! The work of a dispatch has bounds of its own. Mesa's software Vulkan ends every loop of an invocation once it has
//! made 65,535 turns of all loops together, without an error; a workgroup of a GPU must not hold it for long either.

use std::ops::Range;

use imf_core::field::EngineError;

use super::side::SideBuffers;
use super::{Factor, Products};
use crate::device::Gpu;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::shader::{SOAP_PANEL, Shader};
use crate::uniforms::Panel;

/// Turns of the loops of an invocation that takes reflections to an axis, at most: two for each number of each.
const MOST_TURNS: usize = 1 << 15;

/// The kernels of updates.
pub(super) struct UpdateKernels {
    means: Kernel,
    order: Kernel,
    panel: Kernel,
    reflect: Kernel,
}

impl UpdateKernels {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        Ok(Self {
            means: Kernel::new(gpu, Shader::SoapMeans)?,
            order: Kernel::new(gpu, Shader::SoapOrder)?,
            panel: Kernel::new(gpu, Shader::SoapPanel)?,
            reflect: Kernel::new(gpu, Shader::SoapReflect)?,
        })
    }

    /// An update of one side of all matrices, whose mean is M.
    pub(super) fn update(
        &self,
        gpu: &Gpu,
        products: &Products<'_>,
        side: &SideBuffers,
    ) -> Result<Vec<Dispatch>, EngineError> {
        let SideBuffers { stride, table, mean, axes, turned, before, reflections, order, line } = side;
        let stride = *stride;
        let block = |span: &Range<usize>, behind: usize, backwards: bool| {
            let [first, end, behind] = [span.start, span.end, behind].map(|n| n as u32);
            uniform(gpu, "reflections", &Panel { first, end, behind, backwards: backwards.into() })
        };
        let spans = |length: usize| {
            let span = move |start: usize| start..(start + length).min(stride);
            (0..stride).step_by(length).map(span)
        };
        // Once M·Q is in order, its place is the vectors'.
        let vectors = turned;
        // Some reflections, taken to the axes behind.
        let taken = |span: &Range<usize>, behind: usize, to: &wgpu::Buffer, backwards| {
            let block = block(span, behind, backwards)?;
            let axes = Extent::Sliced(stride - behind);
            Ok::<_, EngineError>(self.reflect.bind(axes, &[&block, table, vectors, to]))
        };
        let each = Extent::Sliced(stride);
        let mut update = vec![
            products.of([stride; 3], [Factor::Plain(mean), Factor::Plain(axes)], turned)?,
            self.means.bind(each, &[table, axes, turned, before, line]),
            self.order.bind(each, &[table, line, turned, order, reflections, axes]),
        ];
        let panel = SOAP_PANEL as usize;
        // A power of two, as a panel's length is: no part lies in two panels.
        let at_once = 1 << (MOST_TURNS / (2 * stride)).clamp(1, panel).ilog2();
        for own in spans(panel) {
            let found = [&block(&own, own.end, false)?, table, reflections, vectors];
            update.push(self.panel.bind(Extent::Sliced(1), &found));
            for part in spans(at_once).filter(|part| own.contains(&part.start) && own.end < stride) {
                update.push(taken(&part, own.end, reflections, false)?);
            }
        }
        for part in spans(at_once).collect::<Vec<_>>().into_iter().rev() {
            update.push(taken(&part, part.start, axes, true)?);
        }
        Ok(update)
    }
}
