//! Which adapter to run on: the list of what the machine has, and the choice by name or automatically.
//!
//! Automatic means a discrete GPU, else an integrated one. A software device (Mesa's lavapipe, Windows' WARP) is slower
//! than this project's own CPU engine, so it is taken only on request.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use imf_core::field::EngineError;
use wgpu::DeviceType;

/// Which adapter is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// A discrete GPU, else an integrated or virtual one, never a software device.
    #[default]
    Automatic,
    /// A software device.
    Software,
    /// As `Automatic`, else a software device: for tests.
    Any,
    /// The adapter with this index in [`adapters`].
    Index(usize),
    /// The first adapter whose name contains this text, in any case of letters.
    Name(String),
}

impl FromStr for DeviceChoice {
    type Err = Infallible;

    /// `auto` or `gpu`, `software`, `any`, a number for an index, anything else for a name.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "" | "auto" | "gpu" => Self::Automatic,
            "software" => Self::Software,
            "any" => Self::Any,
            _ => text.parse().map_or_else(|_| Self::Name(text.to_owned()), Self::Index),
        })
    }
}

/// One adapter, as a person wants to see it.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterSummary {
    /// Index in the machine's list.
    pub index: usize,
    /// The device's name.
    pub name: String,
    /// Vulkan, Metal or Dx12.
    pub backend: String,
    /// Discrete, integrated, virtual, software or other.
    pub kind: DeviceType,
    /// Driver and its version.
    pub driver: String,
    /// Largest storage binding, in bytes.
    pub storage_binding: u64,
    /// Largest buffer, in bytes.
    pub buffer: u64,
    /// Workgroup memory, in bytes.
    pub workgroup_memory: u32,
    /// Workgroups in one dimension of a dispatch.
    pub workgroups: u32,
    /// Whether shaders have f16.
    pub half: bool,
}

impl AdapterSummary {
    fn new(index: usize, adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let limits = adapter.limits();
        Self {
            index,
            name: info.name,
            backend: format!("{:?}", info.backend),
            kind: info.device_type,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            storage_binding: limits.max_storage_buffer_binding_size,
            buffer: limits.max_buffer_size,
            workgroup_memory: limits.max_compute_workgroup_storage_size,
            workgroups: limits.max_compute_workgroups_per_dimension,
            half: adapter.features().contains(wgpu::Features::SHADER_F16),
        }
    }

    /// True for a device that computes on the CPU.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.kind == DeviceType::Cpu
    }

    /// True for a device whose memory is the machine's own.
    #[must_use]
    pub fn shares_memory(&self) -> bool {
        matches!(self.kind, DeviceType::Cpu | DeviceType::IntegratedGpu)
    }
}

impl fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            DeviceType::DiscreteGpu => "discrete GPU",
            DeviceType::IntegratedGpu => "integrated GPU",
            DeviceType::VirtualGpu => "virtual GPU",
            DeviceType::Cpu => "software",
            DeviceType::Other => "unknown kind",
        };
        let mebibytes = |bytes: u64| bytes >> 20;
        write!(
            f,
            "{}: {} ({}, {kind}; driver {}; storage binding {} MiB, buffer {} MiB, workgroup memory {} KiB, {} \
             workgroups per dimension; {})",
            self.index,
            self.name,
            self.backend,
            if self.driver.is_empty() { "unnamed" } else { &self.driver },
            mebibytes(self.storage_binding),
            mebibytes(self.buffer),
            self.workgroup_memory >> 10,
            self.workgroups,
            if self.half { "f16" } else { "no f16" },
        )
    }
}

/// All adapters of the machine, in the order that [`DeviceChoice::Index`] counts. Empty without a driver or loader.
#[must_use]
pub fn adapters() -> Vec<AdapterSummary> {
    enumerate().into_iter().map(|(summary, _)| summary).collect()
}

/// The adapters with their handles; the instance lives in them.
fn enumerate() -> Vec<(AdapterSummary, wgpu::Adapter)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY))
        .into_iter()
        .enumerate()
        .map(|(index, adapter)| (AdapterSummary::new(index, &adapter), adapter))
        .collect()
}

/// The adapter that a choice means on this machine.
pub(crate) fn choose(choice: &DeviceChoice) -> Result<(AdapterSummary, wgpu::Adapter), EngineError> {
    let mut found = enumerate();
    let summaries: Vec<AdapterSummary> = found.iter().map(|(summary, _)| summary.clone()).collect();
    let position = pick(choice, &summaries).map_err(EngineError::Device)?;
    Ok(found.swap_remove(position))
}

/// Position of the adapter that a choice means in a list; else cause and remedy.
fn pick(choice: &DeviceChoice, found: &[AdapterSummary]) -> Result<usize, String> {
    let Some(first) = found.first() else {
        return Err("no GPU adapter was found: there is no graphics driver, or no Vulkan loader (on Linux). Install the \
                    GPU's driver, or Mesa's software Vulkan (Debian and Ubuntu: `apt install mesa-vulkan-drivers \
                    libvulkan1`), or use the CPU engine"
            .into());
    };
    let of_kind = |kind: DeviceType| found.iter().position(|adapter| adapter.kind == kind);
    let hardware = || {
        [DeviceType::DiscreteGpu, DeviceType::IntegratedGpu, DeviceType::VirtualGpu, DeviceType::Other]
            .into_iter()
            .find_map(of_kind)
    };
    let wanted = |text: &str| {
        let found: Vec<String> =
            found.iter().map(|adapter| format!("{}: {}", adapter.index, adapter.name)).collect();
        let found = found.join("; ");
        format!("no adapter is `{text}`; the adapters are [{found}]: choose one of them by name or index")
    };
    match choice {
        DeviceChoice::Automatic => hardware().ok_or_else(|| {
            format!(
                "only a software adapter was found ({}), which is slower than the CPU engine. Use the CPU engine, or \
                 ask for it with `software`, its name or its index",
                first.name
            )
        }),
        DeviceChoice::Software => of_kind(DeviceType::Cpu).ok_or_else(|| wanted("software")),
        DeviceChoice::Any => Ok(hardware().unwrap_or(0)),
        DeviceChoice::Index(index) => {
            found.iter().position(|adapter| adapter.index == *index).ok_or_else(|| wanted(&index.to_string()))
        }
        DeviceChoice::Name(name) => {
            let name = name.to_lowercase();
            found
                .iter()
                .position(|adapter| adapter.name.to_lowercase().contains(&name))
                .ok_or_else(|| wanted(&name))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(kinds: &[(&str, DeviceType)]) -> Vec<AdapterSummary> {
        let adapter = |(index, &(name, kind)): (usize, &(&str, DeviceType))| AdapterSummary {
            index,
            name: name.to_owned(),
            backend: "Vulkan".to_owned(),
            kind,
            driver: String::new(),
            storage_binding: 1 << 27,
            buffer: 1 << 31,
            workgroup_memory: 32 << 10,
            workgroups: 65_535,
            half: false,
        };
        kinds.iter().enumerate().map(adapter).collect()
    }

    #[test]
    fn automatic_prefers_discrete_then_integrated_and_never_software() {
        let (soft, inner, card) = (
            ("llvmpipe", DeviceType::Cpu),
            ("Iris", DeviceType::IntegratedGpu),
            ("GeForce", DeviceType::DiscreteGpu),
        );
        assert_eq!(pick(&DeviceChoice::Automatic, &machine(&[soft, inner, card])), Ok(2));
        assert_eq!(pick(&DeviceChoice::Automatic, &machine(&[soft, inner])), Ok(1));
        let message = pick(&DeviceChoice::Automatic, &machine(&[soft])).unwrap_err();
        assert!(message.contains("only a software adapter was found (llvmpipe)"), "{message}");
        assert_eq!(pick(&DeviceChoice::Any, &machine(&[soft])), Ok(0));
        assert_eq!(pick(&DeviceChoice::Software, &machine(&[card, soft])), Ok(1));
        assert!(pick(&DeviceChoice::Software, &machine(&[card])).is_err());
    }

    #[test]
    fn names_and_indices_are_found_or_answered_with_the_list() {
        let machine =
            machine(&[("Iris", DeviceType::IntegratedGpu), ("GeForce RTX", DeviceType::DiscreteGpu)]);
        assert_eq!(pick(&"geforce".parse().unwrap(), &machine), Ok(1));
        assert_eq!(pick(&"0".parse().unwrap(), &machine), Ok(0));
        let message = pick(&"7".parse().unwrap(), &machine).unwrap_err();
        assert!(message.contains("`7`") && message.contains("1: GeForce RTX"), "{message}");
    }

    #[test]
    fn a_machine_without_adapters_names_the_remedy() {
        for choice in ["auto", "software", "any", "0", "x"] {
            let message = pick(&choice.parse().unwrap(), &[]).unwrap_err();
            assert!(message.contains("mesa-vulkan-drivers"), "{message}");
        }
    }
}
