//! `nullray check`: read and validate scenes, render nothing.

use super::{SceneArgs, print_line};
use crate::error::Result;
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub struct CheckArgs {
    /// Scene files
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Override a value of the scenes
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub fn run(args: &CheckArgs) -> Result<()> {
    let options = SceneArgs { set: args.set.clone(), ..SceneArgs::default() };
    let mut failed = None;
    for path in &args.scenes {
        match options.load(Some(path)) {
            Ok((_, world)) => print_line(&format!(
                "{}: ok, {} triangles, {} primitives, {} lights, {:.1} MB",
                path.display(),
                world.triangles.len(),
                world.primitives.len(),
                world.lights.len(),
                world.bytes() as f64 / 1e6
            ))?,
            Err(e) => {
                // Every file is looked at; the last error becomes the exit code.
                if let Some(before) = failed.replace(e) {
                    eprintln!("nullray: error: {before}");
                }
            }
        }
    }
    failed.map_or(Ok(()), Err)
}
