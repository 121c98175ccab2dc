//! `nullray view`: the window.

use super::render::check_writable;
use super::{BackendChoice, DeviceArgs, SceneArgs, print_line};
use crate::backend::Precision;
use crate::error::{Error, Result};
use crate::viewer::{self, RenderOn, ViewOptions};
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub struct ViewArgs {
    /// Scene file; without one, the built-in singularity scene
    scene: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    options: SceneArgs,
    /// Close the window after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    frames: Option<u64>,
    /// Write the picture to a PNG before the window closes; without --frames, after the first one
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Print a JSON summary when the window has closed
    #[arg(long)]
    json: bool,
}

pub fn run(args: &ViewArgs) -> Result<()> {
    if let Some(path) = &args.screenshot {
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            let argument = format!("--screenshot {}", path.display());
            return Err(Error::Usage { argument, reason: "expected a file name ending in .png".into() });
        }
        check_writable(path)?;
    }
    let summary = viewer::run(ViewOptions {
        scene: args.scene.clone(),
        overrides: args.options.overrides()?,
        linear: args.options.linear,
        render_on: match args.device.backend {
            BackendChoice::Auto => RenderOn::Auto,
            BackendChoice::Vulkan => RenderOn::Vulkan,
            BackendChoice::Cpu => RenderOn::Cpu,
        },
        device: args.device.device.clone(),
        precision: args.device.precision(Precision::F32),
        threads: args.device.threads.map(|t| t as usize),
        frames: args.frames.or(args.screenshot.as_ref().map(|_| 1)),
        screenshot: args.screenshot.clone(),
    })?;
    if !args.json {
        return Ok(());
    }
    let (median, max) = summary.latency_ms.unzip();
    let report = serde_json::json!({
        "frames": summary.frames,
        "samples": summary.samples,
        "latency_ms": { "median": median, "max": max, "count": summary.answers },
        "backend": summary.backend,
        "width": summary.size.0,
        "height": summary.size.1,
    });
    print_line(&report.to_string())
}
