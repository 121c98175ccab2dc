//! `nullray validate`: the film of the GPU against the film of the CPU.

use super::{SceneArgs, print_line};
use crate::backend::cpu::CpuBackend;
use crate::backend::vulkan::VulkanBackend;
use crate::backend::{Backend, Precision};
use crate::error::{Error, Result};
use crate::film::compare::{Difference, Thresholds, compare};
use crate::film::{Film, write_exr};
use crate::kernels::layout::Aov;
use crate::world::World;
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;

/// Bounces of the comparison pixel by pixel.
const SHALLOW_DEPTH: u32 = 2;

#[derive(Args)]
pub struct ValidateArgs {
    /// Scene files; without one, the built-in scene
    scenes: Vec<PathBuf>,
    /// Vulkan device, by number or part of its name
    #[arg(long)]
    device: Option<String>,
    /// Samples per pixel of the comparison of whole paths
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    spp: u32,
    #[command(flatten)]
    options: SceneArgs,
    /// Also compare the double-precision kernels
    #[arg(long)]
    f64: bool,
    /// Print a JSON report
    #[arg(long)]
    json: bool,
    /// Write the difference of the last films (GPU minus CPU, absolute)
    #[arg(long, value_name = "FILE.exr")]
    diff: Option<PathBuf>,
}

/// One comparison of a scene.
struct Check {
    name: &'static str,
    difference: Difference,
    thresholds: Thresholds,
}

pub fn run(args: &ValidateArgs) -> Result<()> {
    let mut vulkan = VulkanBackend::new(args.device.as_deref())?;
    let mut cpu = CpuBackend::new(None)?;
    let scenes: Vec<Option<&PathBuf>> = if args.scenes.is_empty() { vec![None] } else { args.scenes.iter().map(Some).collect() };
    let mut options = args.options.clone();
    options.size.get_or_insert_with(|| "160x90".into());
    let mut reports = vec![];
    let mut failed = vec![];
    for path in scenes {
        let (scene, world) = options.load(path)?;
        let name = scene.path.display().to_string();
        let checks = compare_scene(&mut vulkan, &mut cpu, world, args)?;
        let agrees = checks.iter().all(|c| c.thresholds.hold(&c.difference));
        for c in &checks {
            let (d, t) = (&c.difference, &c.thresholds);
            eprintln!(
                "nullray: {name}: {}: {} pixels differ {:.4} (at most {}), rays {:.4} ({}), mean {:.5} ({}), p99 {:.2e}",
                c.name,
                if t.hold(d) { "agrees," } else { "DIFFERS," },
                d.pixels,
                t.pixels,
                d.rays,
                t.rays,
                d.mean,
                t.mean,
                d.p99
            );
        }
        let json: Vec<_> = checks.iter().map(check_json).collect();
        reports.push(serde_json::json!({ "scene": name, "checks": json, "agrees": agrees }));
        if !agrees {
            failed.push(name);
        }
    }
    if args.json {
        print_line(&serde_json::json!({ "device": vulkan.name(), "scenes": reports, "agrees": failed.is_empty() }).to_string())?;
    }
    if failed.is_empty() { Ok(()) } else { Err(Error::CheckFailed(format!("GPU and CPU differ on {}", failed.join(", ")))) }
}

fn check_json(c: &Check) -> serde_json::Value {
    let (d, t) = (&c.difference, &c.thresholds);
    serde_json::json!({
        "check": c.name,
        "measured": { "pixels": d.pixels, "rays": d.rays, "mean": d.mean, "p99": d.p99 },
        "thresholds": { "pixels": t.pixels, "rays": t.rays, "mean": t.mean },
        "agrees": t.hold(d),
    })
}

fn compare_scene(vulkan: &mut VulkanBackend, cpu: &mut CpuBackend, world: World, args: &ValidateArgs) -> Result<Vec<Check>> {
    let mut shallow = world.clone();
    shallow.scene.max_depth = shallow.scene.max_depth.min(SHALLOW_DEPTH);
    let (shallow, deep) = (Arc::new(shallow), Arc::new(world));
    let mut runs = vec![
        ("1 sample, 2 bounces", &shallow, Precision::F32, 1, Thresholds::SHALLOW),
        ("whole paths", &deep, Precision::F32, args.spp, Thresholds::DEEP),
    ];
    if args.f64 && vulkan.supports_f64() {
        runs.push(("1 sample, 2 bounces, f64", &shallow, Precision::F64, 1, Thresholds::SHALLOW));
    }
    let mut checks = vec![];
    let mut last = None;
    for (name, world, precision, spp, thresholds) in runs {
        let gpu_film = render_film(vulkan, world, precision, spp)?;
        let cpu_film = render_film(cpu, world, precision, spp)?;
        checks.push(Check { name, difference: compare(&gpu_film, &cpu_film), thresholds });
        last = Some((gpu_film, cpu_film));
    }
    if let (Some(path), Some((gpu_film, cpu_film))) = (&args.diff, last) {
        write_exr(path, &difference_film(&gpu_film, &cpu_film), &[])?;
    }
    Ok(checks)
}

/// All samples of a world on one backend.
fn render_film(backend: &mut dyn Backend, world: &Arc<World>, precision: Precision, spp: u32) -> Result<Film> {
    backend.upload(world.clone(), precision, 0)?;
    backend.accumulate(0..world.scene.film_height, 0..spp)?;
    backend.film()
}

fn difference_film(a: &Film, b: &Film) -> Film {
    let mut film = Film::new(a.width, a.height, 0);
    film.counts.clone_from(&a.counts);
    for (i, sum) in film.sums.iter_mut().enumerate() {
        for (c, value) in sum.iter_mut().enumerate().take(3) {
            *value = a.sums[i][c].abs_diff(b.sums[i][c]);
        }
    }
    film.aovs = a.aovs.iter().zip(&b.aovs).map(|(p, q)| Aov { distance: (p.distance - q.distance).abs(), ..*p }).collect();
    film
}
