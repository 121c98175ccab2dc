//! `nullray devices`: what Vulkan offers here.

use super::print_line;
use crate::backend::vulkan::device::{DeviceReport, enumerate};
use crate::backend::vulkan::instance::Instance;
use crate::error::Result;
use clap::Args;

#[derive(Args)]
pub struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &DevicesArgs) -> Result<()> {
    let devices = enumerate(&Instance::new()?)?;
    if args.json {
        let list: Vec<_> = devices.iter().map(device_json).collect();
        return print_line(&serde_json::json!({ "devices": list }).to_string());
    }
    if devices.is_empty() {
        return print_line("no Vulkan device; install a driver, or mesa-vulkan-drivers for one in software");
    }
    for d in &devices {
        let (major, minor, patch) = d.api_version;
        let verdict = if d.missing.is_empty() { "usable".to_string() } else { format!("lacks {}", d.missing.join(", ")) };
        let yes = |b: bool| if b { "yes" } else { "no" };
        print_line(&format!("{}: {} ({}), Vulkan {major}.{minor}.{patch}: {verdict}", d.index, d.name, d.kind))?;
        print_line(&format!(
            "   double precision {}, synchronization2 {}, timestamps {}, storage buffers up to {} MiB, memory {} MiB",
            yes(d.float64),
            yes(d.synchronization2),
            yes(d.timestamps),
            d.max_storage_buffer_range >> 20,
            d.memory >> 20
        ))?;
    }
    Ok(())
}

fn device_json(d: &DeviceReport) -> serde_json::Value {
    let (major, minor, patch) = d.api_version;
    serde_json::json!({
        "index": d.index,
        "name": d.name,
        "kind": d.kind,
        "api_version": format!("{major}.{minor}.{patch}"),
        "usable": d.missing.is_empty(),
        "missing": d.missing,
        "shader_float64": d.float64,
        "synchronization2": d.synchronization2,
        "timestamps": d.timestamps,
        "max_storage_buffer_range": d.max_storage_buffer_range,
        "device_memory": d.memory,
    })
}
