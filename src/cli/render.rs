//! `nullray render`: a scene to PNG and EXR files.

use super::{DeviceArgs, SceneArgs, print_line};
use crate::backend::Precision;
use crate::error::{Error, Result};
use crate::film::{Film, write_exr, write_png};
use crate::scene::Scene;
use crate::scheduler::{Ending, Goal, Progress, render};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[derive(Args)]
pub struct RenderArgs {
    /// Scene file; without one, the built-in singularity scene
    scene: Option<PathBuf>,
    /// Output file, .png or .exr; may be given several times
    #[arg(short, long, default_value = "nullray.png")]
    output: Vec<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    options: SceneArgs,
    /// Samples per pixel
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    spp: Option<u32>,
    /// Index of the first sample: parts rendered apart hold the samples of one run
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1_000_000_000))]
    first_sample: u32,
    /// Stop after this many seconds
    #[arg(long, value_name = "SECONDS")]
    time: Option<f64>,
    /// Stop when the relative error of the film falls below this
    #[arg(long, value_name = "TARGET")]
    noise: Option<f64>,
    /// Print a JSON summary
    #[arg(long)]
    json: bool,
}

fn positive(name: &str, value: Option<f64>) -> Result<Option<f64>> {
    match value {
        Some(v) if !(v.is_finite() && v > 0.0 && v < 1e9) => {
            Err(Error::Usage { argument: format!("{name} {v}"), reason: "expected a number above 0".into() })
        }
        v => Ok(v),
    }
}

/// Refuses outputs that could not be written, before any work is done.
fn check_outputs(outputs: &[PathBuf]) -> Result<()> {
    for path in outputs {
        let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if !matches!(extension.as_deref(), Some("png" | "exr")) {
            return Err(Error::Usage {
                argument: format!("-o {}", path.display()),
                reason: "expected a file name ending in .png or .exr".into(),
            });
        }
        check_writable(path)?;
    }
    Ok(())
}

/// Refuses a file that could not be written.
pub fn check_writable(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let probe = folder.join(format!(".nullray.{}.probe", std::process::id()));
    let writable = match std::fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(std::io::ErrorKind::IsADirectory.into()),
        // A pipe or a device is written straight.
        Ok(found) if !found.is_file() => Ok(()),
        _ => std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)),
    };
    writable.map_err(|source| Error::Io { path: path.into(), source })
}

pub fn run(args: &RenderArgs) -> Result<()> {
    let start = Instant::now();
    check_outputs(&args.output)?;
    let time = positive("--time", args.time)?;
    let noise = positive("--noise", args.noise)?;
    let (scene, world) = args.options.load(args.scene.as_ref())?;
    let triangles = world.triangles.len();
    let mut backend = args.device.open()?;
    backend.upload(Arc::new(world), args.device.precision(Precision::F32), args.first_sample)?;
    // A time or noise limit without --spp renders as many samples as it takes.
    let samples = args.spp.unwrap_or(if time.is_some() || noise.is_some() { 1_000_000 } else { scene.film.samples });
    let goal = Goal { first_sample: args.first_sample, samples, time: time.map(Duration::from_secs_f64), noise };

    let cancel = Arc::new(AtomicBool::new(false));
    let flag = cancel.clone();
    // A handler that cannot be installed only costs the clean exit on Ctrl-C.
    let _ = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed));
    eprintln!("nullray: {}, {}x{}, {} triangles", backend.name(), scene.film.width, scene.film.height, triangles);
    let mut reporter = Reporter::new(&goal);
    let outcome = render(backend.as_mut(), scene.film.height, &goal, &cancel, |p| reporter.report(p));
    reporter.finish();
    // A device that was lost still leaves the film of what it finished.
    let film = backend.film()?;
    let seconds = start.elapsed().as_secs_f64();
    let metadata = metadata(args, &scene, &film, &backend.name(), seconds);
    for path in &args.output {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
            write_exr(path, &film, &metadata)?;
        } else {
            write_png(path, &film, scene.film.exposure, scene.film.tone_map)?;
        }
    }
    let ending = outcome?;
    report(args, &film, seconds, ending)?;
    if ending == Ending::Cancelled { Err(Error::Interrupted) } else { Ok(()) }
}

fn report(args: &RenderArgs, film: &Film, seconds: f64, ending: Ending) -> Result<()> {
    let s = film.statistics;
    if s.exhausted > 0 {
        eprintln!(
            "nullray: {} of {} rays ran out of steps ({:.4}%); raise integrator.max_steps",
            s.exhausted,
            s.rays,
            100.0 * s.exhausted as f64 / s.rays as f64
        );
    }
    if s.invalid > 0 {
        eprintln!("nullray: warning: {} samples were not a number and count as black", s.invalid);
    }
    let files: Vec<String> = args.output.iter().map(|p| p.display().to_string()).collect();
    eprintln!("nullray: {} samples in {seconds:.2} s, relative error {:.4}: {}", film.samples(), film.relative_error(), files.join(", "));
    if args.json {
        let summary = serde_json::json!({
            "outputs": files,
            "width": film.width,
            "height": film.height,
            "samples": film.samples(),
            "seconds": seconds,
            "rays": s.rays,
            "exhausted": s.exhausted,
            "invalid": s.invalid,
            "steps_per_camera_ray": film.aovs.iter().map(|a| f64::from(a.steps)).sum::<f64>() / film.aovs.len() as f64,
            "chords_per_camera_ray": film.aovs.iter().map(|a| f64::from(a.chords)).sum::<f64>() / film.aovs.len() as f64,
            "relative_error": if film.samples() > 1 { Some(film.relative_error()) } else { None },
            "complete": ending != Ending::Cancelled,
        });
        print_line(&summary.to_string())?;
    }
    Ok(())
}

/// Every parameter of the run, and what came of it.
fn metadata(args: &RenderArgs, scene: &Scene, film: &Film, backend: &str, seconds: f64) -> Vec<(String, String)> {
    let mut drift: Vec<f32> = film.aovs.iter().map(|a| a.constraint_error).collect();
    drift.sort_by(f32::total_cmp);
    let p999 = drift.get(drift.len().saturating_sub(1 + drift.len() / 1000)).copied().unwrap_or(0.0);
    let pairs = [
        ("version", env!("CARGO_PKG_VERSION").to_string()),
        ("scene", scene.path.display().to_string()),
        ("backend", backend.to_string()),
        ("precision", format!("{:?}", args.device.precision(Precision::F32))),
        ("camera", format!("{:?}", scene.camera)),
        ("film", format!("{:?}", scene.film)),
        ("spacetime", format!("{:?}", scene.spacetime)),
        ("integrator", format!("{:?}", scene.integrator)),
        ("environment", format!("{:?}", scene.environment)),
        ("overrides", args.options.set.join("; ")),
        ("first_sample", film.first_sample.to_string()),
        ("samples", film.samples().to_string()),
        ("seconds", format!("{seconds:.3}")),
        ("rays", film.statistics.rays.to_string()),
        ("exhausted", film.statistics.exhausted.to_string()),
        ("invalid", film.statistics.invalid.to_string()),
        ("constraint_error_p99.9", format!("{p999:e}")),
    ];
    pairs.into_iter().map(|(k, v)| (k.to_string(), v.chars().filter(char::is_ascii).collect())).collect()
}

/// A bar on a terminal, a line every few seconds elsewhere.
struct Reporter {
    bar: Option<ProgressBar>,
    last: Instant,
}

impl Reporter {
    fn new(goal: &Goal) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(u64::from(goal.samples) * 1000);
            if let Ok(style) = ProgressStyle::with_template("{wide_bar} {msg}") {
                bar.set_style(style);
            }
            bar
        });
        Reporter { bar, last: Instant::now() }
    }

    fn report(&mut self, p: Progress) {
        let done = f64::from(p.samples) + p.pass;
        let rate = done / p.elapsed.as_secs_f64().max(1e-9);
        let left = (f64::from(p.goal) - done) / rate.max(1e-9);
        let noise = p.noise.map(|n| format!(", error {n:.4}")).unwrap_or_default();
        let text = format!("{done:.1}/{} samples, {rate:.2}/s, {left:.0} s left{noise}", p.goal);
        match &self.bar {
            Some(bar) => {
                bar.set_position((done * 1000.0) as u64);
                bar.set_message(text);
            }
            None if self.last.elapsed() > Duration::from_secs(5) => {
                self.last = Instant::now();
                eprintln!("nullray: {text}");
            }
            None => {}
        }
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
