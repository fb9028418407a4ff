//! Where sections are counted, on the CPU or on a GPU: a stream of sections, or their minimum. Both give the same
//! values.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, Error, Result};
use imf_core::control::Control;
use imf_core::section::{Imf, SectionPlan, stream_depths, stream_sections};
use imf_gpu::{Gpu, GpuSections};

use super::{ExactSections, Values, Work};
use crate::engine::Device;
use crate::interrupt;

impl Work<'_> {
    pub(super) fn computed_by(&self) -> String {
        let ExactSections { plan, .. } = match &self.values {
            Values::Saved(field) => {
                return match self.device {
                    Device::Gpu(gpu) => format!("{}, evaluated on {}", field.described, gpu.describe()),
                    Device::Cpu => field.described.clone(),
                };
            }
            Values::Exact(counted) => counted,
        };
        match self.device {
            Device::Cpu => plan.describe(),
            Device::Gpu(gpu) => format!("run-length differences on {}", gpu.describe()),
        }
    }

    /// Shows every section to `visit`, after its check, with progress and until Ctrl-C, once what makes them is there and the caller is
    /// `ready`. The first failure stops all.
    pub(super) fn stream<V: Send>(
        &self,
        ready: impl FnOnce() -> Result<()>,
        start: impl Fn() -> V + Sync,
        visit: impl Fn(&mut V, usize, &[f32]) -> Result<()> + Sync,
    ) -> Result<Vec<V>> {
        let ExactSections { plan, depth, check, .. } = match &self.values {
            Values::Saved(field) => return field.stream(self, ready, start, visit),
            Values::Exact(counted) => counted,
        };
        let mut device = match self.device {
            Device::Cpu => None,
            Device::Gpu(gpu) => Some(self.on_device(gpu, plan)?),
        };
        ready()?;
        let failure = Mutex::new(None::<Error>);
        let result = self.staged(|control, stop| {
            let visit = |own: &mut V, index: usize, cmf: &[f32]| {
                let orientation = &self.set.orientations[index];
                let checked = check.compare(plan, orientation, index, cmf);
                if let Err(error) = checked.and_then(|()| visit(own, index, cmf)) {
                    stop.store(true, Ordering::Relaxed);
                    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                }
            };
            let orientations = &self.set.orientations;
            match (&mut device, depth) {
                (None, None) => {
                    stream_sections(plan, orientations, control, start, visit).map_err(Error::from)
                }
                (None, Some(depth)) => Ok(stream_depths(depth, orientations, control, start, visit)?),
                (Some(device), _) => Ok(device.stream(orientations, control, start, visit)?),
            }
        });
        match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => result,
        }
    }

    pub(super) fn minimum(&self) -> Result<Imf> {
        let ExactSections { plan, check, .. } = match &self.values {
            Values::Saved(field) => return field.minimum(self),
            Values::Exact(counted) => counted,
        };
        if let Device::Gpu(gpu) = self.device {
            let whole = plan.tip_alone() && !plan.has_layer();
            let why = match (whole, check.is_wanted()) {
                (true, false) => {
                    return self.staged(|control, _| {
                        Ok(self.on_device(gpu, plan)?.imf(&self.set.orientations, control)?)
                    });
                }
                (false, _) if plan.tip_alone() => "the cutter may touch the part",
                (false, _) => "points off the tip are sharp",
                (true, true) => "--check compares sections",
            };
            self.session.note(&format!(
                "{why}: the GPU counts, sections are read back, and the CPU takes their minimum"
            ));
        }
        let voxels = plan.grid().len();
        let visit = |minimum: &mut Imf, index: usize, cmf: &[f32]| {
            minimum.lower_to(index, cmf);
            Ok(())
        };
        let parts = self.stream(|| Ok(()), || Imf::new(voxels), visit)?;
        let mut whole = Imf::new(voxels);
        parts.iter().for_each(|part| whole.merge(part));
        Ok(whole)
    }

    fn on_device<'a>(&self, gpu: &Gpu, plan: &'a SectionPlan) -> Result<GpuSections<'a>> {
        let device = GpuSections::new(gpu, plan).context("--device")?;
        self.session.require_memory(device.host_bytes(), || {
            "sections that come from the GPU wait in memory: take a larger pitch, or --device cpu".into()
        })?;
        Ok(device)
    }

    /// Runs `work` with a progress line and a flag that stops it, which Ctrl-C sets as well.
    fn staged<T>(&self, work: impl FnOnce(Control<'_>, &AtomicBool) -> Result<T>) -> Result<T> {
        let stop = AtomicBool::new(false);
        let stage = self.session.stage("exact sections", "sections", self.set.len() as u64);
        let advance = |sections| {
            stage.advance(sections);
            if interrupt::requested() {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let result = work(Control { progress: &advance, cancelled: &stop }, &stop)?;
        stage.finish(&self.computed_by());
        Ok(result)
    }
}
