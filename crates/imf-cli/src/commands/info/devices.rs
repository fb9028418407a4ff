//! `imf info` of nothing: where this machine can train and evaluate, and the built-in parts.

use anyhow::Result;
use imf_core::parts::ReferencePart;
use imf_gpu::wgpu::DeviceType;
use imf_gpu::{AdapterSummary, DeviceChoice, Gpu, adapters};
use serde_json::{Value, json};

use crate::output::print_result;
use crate::session::{Session, show_bytes};

/// What to do where there is no adapter.
const REMEDY: &str = "for a GPU install its driver; for software Vulkan on Debian or Ubuntu: \
                      apt install mesa-vulkan-drivers libvulkan1";

pub(super) fn run(session: &Session) -> Result<()> {
    let found = adapters();
    // Opened, not only listed: a broken driver shows here.
    let chosen = if found.is_empty() {
        None
    } else {
        Gpu::open(&DeviceChoice::Automatic)
            .map_err(|error| session.detail(&format!("auto takes the CPU engine: {error}")))
            .ok()
            .map(|gpu| gpu.adapter().index)
    };
    let json = json!({
        "cpu": { "threads": session.threads() },
        "adapters": found.iter().map(entry).collect::<Vec<_>>(),
        "parts": ReferencePart::ALL.map(|part| part.to_string()),
        "auto": chosen.map_or_else(|| json!("cpu"), |index| json!(index)),
    });
    let mark = |yes: bool| if yes { "  ← auto" } else { "" };
    let mut text = format!("cpu  CPU engine, {} threads{}\n", session.threads(), mark(chosen.is_none()));
    for adapter in &found {
        text += &format!("{}{}\n", block(adapter), mark(chosen == Some(adapter.index)));
    }
    if found.is_empty() {
        text += &format!("no GPU adapter was found: {REMEDY}\n");
    }
    let parts = ReferencePart::ALL.map(|part| part.to_string()).join(", ");
    print_result(session, &json, &format!("{text}\nbuilt-in parts: {parts}; tool: paper\n"))
}

fn kind(adapter: &AdapterSummary) -> &'static str {
    match adapter.kind {
        DeviceType::DiscreteGpu => "discrete",
        DeviceType::IntegratedGpu => "integrated",
        DeviceType::VirtualGpu => "virtual",
        DeviceType::Cpu => "software",
        DeviceType::Other => "unknown kind",
    }
}

fn entry(adapter: &AdapterSummary) -> Value {
    json!({
        "index": adapter.index,
        "name": adapter.name,
        "backend": adapter.backend,
        "kind": kind(adapter),
        "driver": adapter.driver,
        "storage_binding": adapter.storage_binding,
        "buffer": adapter.buffer,
        "workgroup_memory": adapter.workgroup_memory,
        "workgroups_per_dimension": adapter.workgroups,
    })
}

fn block(adapter: &AdapterSummary) -> String {
    let AdapterSummary { index, name, backend, driver, workgroups, .. } = adapter;
    let driver = if driver.is_empty() { "unnamed" } else { driver };
    format!(
        "{index:<3}  {name}\n     {backend}, {}, driver {driver}\n     storage binding {}, buffer {}, workgroup memory {}, \
         {workgroups} workgroups per dimension",
        kind(adapter),
        show_bytes(adapter.storage_binding),
        show_bytes(adapter.buffer),
        show_bytes(u64::from(adapter.workgroup_memory))
    )
}
