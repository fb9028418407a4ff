//! The same sections on a GPU: what the device takes alone, with the host's preparation, and with sections read back.

use anyhow::Result;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionPlan, imf, sections};
use imf_gpu::{Gpu, GpuSections};

use crate::exact::Rival;
use crate::measurement::{ROUNDS, minimum_seconds};

/// Sections that a software device is measured at.
const MOST_ON_SOFTWARE: usize = 16;

/// Measures `orientations` on `gpu`; `ours` is the CPU's time for a section in seconds.
pub(super) fn measure(
    gpu: &Gpu,
    plan: &SectionPlan,
    orientations: &[Orientation],
    compared: &[Orientation],
    ours: f64,
    control: Control<'_>,
) -> Result<Vec<Rival>> {
    // A software device shows that the counts are right; its speed takes no 225 sections to know.
    let most = if gpu.adapter().is_software() { MOST_ON_SOFTWARE } else { usize::MAX };
    let orientations = &orientations[..orientations.len().min(most)];
    let mut device = GpuSections::new(gpu, plan)?;
    let name = &gpu.adapter().name;
    let rival = |what: &str, seconds: f64, equal: bool, how: &str| Rival {
        name: format!("{name}, {what}"),
        sections: orientations.len(),
        milliseconds_per_section: seconds * 1e3,
        ratio: seconds / ours,
        equal: Some(equal),
        how: how.to_owned(),
    };

    // Every value of the compared sections, before anything is timed: this also compiles and allocates.
    let expected = sections(plan, compared, control)?;
    let equal =
        device.stream(compared, control, || true, |equal, index, cmf| *equal &= cmf == expected[index])?;
    let equal = equal.into_iter().all(|equal| equal);
    let same_least = device.imf(compared, control)? == imf(plan, compared, control)?;

    let alone = device.measure(orientations, ROUNDS)?;
    let device = std::cell::RefCell::new(device);
    let [minimum, read] = minimum_seconds(
        ROUNDS,
        [&mut || Ok(device.borrow_mut().imf(orientations, control).map(drop)?), &mut || {
            Ok(device.borrow_mut().stream(orientations, control, || (), |(), _, _| {}).map(drop)?)
        }],
    )?
    .map(|seconds| seconds / orientations.len() as f64);
    Ok(vec![
        rival(
            "device alone",
            alone,
            equal,
            "run-length differences; tools prepared and uploaded before, nothing read back",
        ),
        rival("IMF", minimum, same_least, "tools prepared by the host, minimum kept on the device"),
        rival("sections read back", read, equal, "tools prepared by the host, every section read back"),
    ])
}
