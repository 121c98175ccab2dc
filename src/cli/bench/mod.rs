//! `nullray bench`: the thesis' tables 5.1 (linear) and 5.2 (non-linear), time per sample of the benchmark scene, and what every model costs.

mod models;

use super::{DeviceArgs, print_line};
use crate::backend::{Backend, Precision};
use crate::error::{Error, Result};
use crate::scene::load_scene;
use crate::world::World;
use clap::{Args, ValueEnum};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// The thesis' milliseconds per sample at 1080p, 720p, 480p and 240p (tables 5.1 and 5.2; its own scene, 8 cores at 5 GHz).
const THESIS: [(&str, [f64; 2]); 4] = [("1080p", [135.0, 992.0]), ("720p", [60.0, 444.0]), ("480p", [27.0, 197.0]), ("240p", [15.0, 41.0])];
const SIZES: [(&str, u32, u32); 4] = [("1080p", 1920, 1080), ("720p", 1280, 720), ("480p", 854, 480), ("240p", 426, 240)];

/// Samples before those that are timed.
const WARM_UP: u32 = 2;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Table {
    Linear,
    Nonlinear,
    Both,
    /// Every bending model on the benchmark scene
    Models,
}

#[derive(Args)]
pub struct BenchArgs {
    /// Which table
    #[arg(long, value_enum, default_value = "both")]
    table: Table,
    /// Sizes, separated by commas [default: all four; of models 480p]
    #[arg(long)]
    sizes: Option<String>,
    /// Non-linear form: A (gravity center), B (Schwarzschild) or C (Kerr)
    #[arg(long, default_value = "A")]
    form: String,
    /// Measured samples per row
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Benchmark scene; by default assets/scenes/benchmark.toml of the repository
    #[arg(long)]
    scene: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

struct Row {
    table: &'static str,
    form: String,
    size: &'static str,
    width: u32,
    height: u32,
    milliseconds: Vec<f64>,
}

impl Row {
    fn median(&self) -> f64 {
        self.milliseconds[self.milliseconds.len() / 2]
    }
}

/// The benchmark scene: as given, here, or beside an ancestor of the program.
fn scene_path(given: Option<&PathBuf>) -> Result<PathBuf> {
    let relative = PathBuf::from("assets/scenes/benchmark.toml");
    if let Some(path) = given {
        return Ok(path.clone());
    }
    let program = std::env::current_exe().unwrap_or_default();
    std::iter::once(relative.clone())
        .chain(program.ancestors().skip(1).map(|folder| folder.join(&relative)))
        .find(|p| p.is_file())
        .ok_or_else(|| Error::Usage {
            argument: "bench".into(),
            reason: "assets/scenes/benchmark.toml is not here, expected --scene FILE".into(),
        })
}

/// Overrides that turn the linear scene into a non-linear form: A (gravity center), B (Schwarzschild) or C (Kerr).
pub fn form_overrides(form: &str) -> Result<Vec<String>> {
    let lines: &[&str] = match form {
        "A" => &["spacetime.kind=gravity", "spacetime.center=[{ position = [0.9, 2.0, 1.2], strength = 0.3, radius = 5 }]"],
        "B" => &["spacetime.kind=schwarzschild", "spacetime.mass=0.1", "spacetime.position=[0.9, 2.0, 1.2]"],
        "C" => &["spacetime.kind=kerr", "spacetime.mass=0.1", "spacetime.spin=0.09", "spacetime.position=[0.9, 2.0, 1.2]"],
        _ => return Err(Error::Usage { argument: format!("--form {form}"), reason: "expected A, B or C".into() }),
    };
    Ok(lines.iter().map(|s| s.to_string()).collect())
}

pub fn run(args: &BenchArgs) -> Result<()> {
    let path = scene_path(args.scene.as_ref())?;
    let bent = form_overrides(&args.form)?;
    let wanted = args.sizes.as_deref().unwrap_or(if args.table == Table::Models { "480p" } else { "1080p,720p,480p,240p" });
    let mut sizes = vec![];
    for name in wanted.split(',') {
        let known = SIZES.iter().find(|(n, ..)| *n == name.trim()).ok_or_else(|| Error::Usage {
            argument: format!("--sizes {wanted}"),
            reason: format!("found `{name}`, expected 1080p, 720p, 480p or 240p"),
        })?;
        sizes.push(*known);
    }
    let mut backend = args.device.open()?;
    if args.table == Table::Models {
        return models::run(args, &path, &sizes, backend.as_mut());
    }
    let mut rows = vec![];
    for table in [Table::Linear, Table::Nonlinear] {
        if args.table != Table::Both && args.table != table {
            continue;
        }
        let linear = table == Table::Linear;
        for &(size, width, height) in &sizes {
            let mut set = if linear { vec!["spacetime.kind=flat".into()] } else { bent.clone() };
            set.push(format!("film.width={width}"));
            set.push(format!("film.height={height}"));
            let world = Arc::new(World::compile(&load_scene(Some(&path), &set)?)?);
            let milliseconds = measure(backend.as_mut(), world, args)?;
            let form = if linear { "linear".into() } else { args.form.clone() };
            let row = Row { table: if linear { "linear" } else { "nonlinear" }, form, size, width, height, milliseconds };
            report_row(&row, backend.timings().totals());
            rows.push(row);
        }
    }
    print_results(args, &backend.name(), &rows)
}

/// Times samples of a world: milliseconds of each, the shortest first.
fn measure(backend: &mut dyn Backend, world: Arc<World>, args: &BenchArgs) -> Result<Vec<f64>> {
    let height = world.scene.film_height;
    backend.upload(world, args.device.precision(Precision::F32), 0)?;
    // Warm-up: pages, caches, kernels compiled at first use.
    backend.accumulate(0..height, 0..WARM_UP)?;
    backend.timings();
    let mut milliseconds: Vec<f64> = (WARM_UP..WARM_UP + args.repeats)
        .map(|sample| {
            let start = Instant::now();
            backend.accumulate(0..height, sample..sample + 1).map(|()| start.elapsed().as_secs_f64() * 1e3)
        })
        .collect::<Result<_>>()?;
    milliseconds.sort_by(f64::total_cmp);
    Ok(milliseconds)
}

fn report_row(row: &Row, timings: &[crate::backend::KernelTiming]) {
    let total: f64 = timings.iter().map(|t| t.time.as_secs_f64()).sum();
    let shares: Vec<String> =
        timings.iter().map(|t| format!("{} {:.0}%", t.kernel, 100.0 * t.time.as_secs_f64() / total.max(1e-12))).collect();
    eprintln!("nullray: {} {} {:.1} ms ({})", row.table, row.size, row.median(), shares.join(", "));
}

fn print_results(args: &BenchArgs, backend: &str, rows: &[Row]) -> Result<()> {
    let median = |table: &str, size: &str| rows.iter().find(|r| r.table == table && r.size == size).map(Row::median);
    let ratios: BTreeMap<&str, f64> =
        SIZES.iter().filter_map(|(s, ..)| Some((*s, median("nonlinear", s)? / median("linear", s)?))).collect();
    if args.json {
        let list: Vec<_> = rows
            .iter()
            .map(|r| {
                serde_json::json!({
                    "table": r.table, "form": r.form, "size": r.size, "width": r.width, "height": r.height,
                    "ms_per_sample": r.median(), "min": r.milliseconds.first(), "max": r.milliseconds.last(), "repeats": r.milliseconds.len(),
                })
            })
            .collect();
        return print_line(&serde_json::json!({ "machine": machine(), "backend": backend, "rows": list, "ratio": ratios }).to_string());
    }
    print_line(&format!("{}; {backend}", machine()))?;
    print_line("table      form    size    ms/sample      min      max    thesis")?;
    for r in rows {
        let thesis = THESIS.iter().find(|(s, _)| *s == r.size).map_or(0.0, |(_, t)| t[usize::from(r.table == "nonlinear")]);
        let (min, max) = (r.milliseconds.first().copied().unwrap_or(0.0), r.milliseconds.last().copied().unwrap_or(0.0));
        print_line(&format!("{:<10} {:<7} {:<6} {:>10.1} {min:>8.1} {max:>8.1} {thesis:>9.0}", r.table, r.form, r.size, r.median()))?;
    }
    for (size, ratio) in ratios {
        print_line(&format!("ratio at {size}: {ratio:.2} (thesis 7.3 at 1080p)"))?;
    }
    Ok(())
}

/// The processor's name and core count.
fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|l| l.strip_prefix("model name"))
        .and_then(|l| l.split_once(':'))
        .map_or("unknown processor", |(_, m)| m.trim());
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    format!("{model}, {cores} cores")
}
