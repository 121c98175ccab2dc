//! `nullray profile`: a table of where the time of a frame goes, kernel by kernel and bounce by bounce.

use super::chrome_trace::write_chrome_trace;
use super::render::check_writable;
use super::trace_output::through_temporary;
use super::{DeviceArgs, SceneArgs, print_line};
use crate::backend::{Precision, RoundCounts};
use crate::error::{Error, Result};
use crate::profile::{Profile, Row, Spread};
use crate::scene::Scene;
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Smallest share of the frame that a bounce must have for a line of the table.
const SHOWN: f64 = 1e-3;

#[derive(Args)]
pub struct ProfileArgs {
    /// Scene file; without one, the built-in singularity scene
    scene: Option<PathBuf>,
    /// Timed frames of one sample per pixel each; fewer if they have very many dispatches
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Write everything as JSON; - prints it instead of the table
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a trace for Perfetto or chrome://tracing
    #[arg(long, value_name = "FILE")]
    chrome_trace: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    options: SceneArgs,
}

pub fn run(args: &ProfileArgs) -> Result<()> {
    let json_file = args.json.as_deref().filter(|path| *path != Path::new("-"));
    for path in json_file.into_iter().chain(args.chrome_trace.as_deref()) {
        check_writable(path)?;
    }
    let (scene, world) = args.options.load(args.scene.as_ref())?;
    let mut backend = args.device.open()?;
    backend.upload(Arc::new(world), args.device.precision(Precision::F32), 0)?;
    eprintln!("nullray: {}, {}x{}, {} frames", backend.name(), scene.film.width, scene.film.height, args.frames);
    let profile = Profile::measure(backend.as_mut(), scene.film.height, args.frames)?;
    if profile.passes.len() < args.frames as usize {
        eprintln!("nullray: only {} frames, which have as many dispatches as are kept", profile.passes.len());
    }
    if let Some(path) = &args.chrome_trace {
        write_chrome_trace(path, &profile)?;
    }
    if args.json.is_none() {
        return print_table(&profile);
    }
    let text = report(&scene, &profile).to_string();
    let Some(path) = json_file else { return print_line(&text) };
    through_temporary(path, |to| std::fs::write(to, text + "\n").map_err(|source| Error::Io { path: path.into(), source }))?;
    print_table(&profile)
}

/// Nanoseconds in microseconds.
fn micros(nanos: f64) -> f64 {
    nanos / 1e3
}

/// A number with three significant digits or so, and k, M or G.
fn short(value: f64) -> String {
    let units = [(1e9, " G"), (1e6, " M"), (1e3, " k")];
    match units.into_iter().find(|(size, _)| value >= *size) {
        Some((size, unit)) => format!("{:.2}{unit}", value / size),
        None => format!("{value:.0}"),
    }
}

fn print_table(profile: &Profile) -> Result<()> {
    let frames = profile.passes.len() as f64;
    let frame = profile.frame();
    let [min, median, p95, max] = [frame.min, frame.median, frame.p95, frame.max].map(|v| v as f64 / 1e6);
    print_line(&format!("{}; {frames} frames of one sample after {} of warm-up", profile.backend, profile.warm_up))?;
    print_line(&format!("frame: median {median:.3} ms, min {min:.3}, p95 {p95:.3}, max {max:.3}"))?;
    print_line("")?;
    print_line(&format!(
        "{:<32} {:>6} {:>8} {:>10} {:>10} {:>10} {:>10} {:>7} {:>12} {:>10} {:>10}",
        "kernel", "bounce", "count", "min us", "median us", "p95 us", "max us", "share", "items/frame", "items/s", "steps/s"
    ))?;
    let rows = profile.rows();
    for kernel in profile.kernels() {
        let bounces: Vec<&Row> = rows.iter().filter(|r| r.kernel == kernel.kernel && r.round.is_some()).collect();
        print_row(&kernel, if bounces.is_empty() { "-" } else { "all" })?;
        for row in bounces.into_iter().filter(|r| r.share >= SHOWN) {
            print_row(row, &row.round.unwrap_or(0).to_string())?;
        }
    }
    print_line("")?;

    let balance = profile.balance();
    print_line(&format!("{:<32} {:>12} {:>7}", "of the frame", "ms/frame", "share"))?;
    for (name, time) in balance.parts() {
        print_line(&format!("{:<32} {:>12.3} {:>6.1}%", name.replace('_', " "), time / frames / 1e6, 100.0 * time / balance.wall))?;
    }
    print_line(&format!("{:<32} {:>12.3}", "wall", balance.wall / frames / 1e6))?;
    print_line(&format!("{:<32} {:>12.3}         (while kernels run)", "host wait", balance.wait / frames / 1e6))?;
    for (name, count) in profile.lost() {
        print_line(&format!("not timed: {name}, {count} times"))?;
    }
    print_line("")?;
    print_counts(profile)
}

fn print_row(row: &Row, bounce: &str) -> Result<()> {
    let s = &row.spread;
    let [min, median, p95, max] = [s.min, s.median, s.p95, s.max].map(|v| micros(v as f64));
    let rate = |value: Option<f64>| value.map_or_else(String::new, short);
    print_line(
        format!(
            "{:<32} {bounce:>6} {:>8} {min:>10.1} {median:>10.1} {p95:>10.1} {max:>10.1} {:>6.1}% {:>12} {:>10} {:>10}",
            row.kernel,
            s.count,
            100.0 * row.share,
            row.items.map_or_else(String::new, |i| i.to_string()),
            rate(row.items_per_second),
            rate(row.steps_per_second),
        )
        .trim_end(),
    )
}

/// What the kernels did in the first timed frame.
fn print_counts(profile: &Profile) -> Result<()> {
    print_line(&format!(
        "{:>6} {:>10} {:>9} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "bounce", "rays", "occupied", "hits", "misses", "steps", "skips", "chords", "nodes", "primitives", "tri blocks"
    ))?;
    let bounces = profile.rounds.iter().enumerate().map(|(i, counts)| (i.to_string(), *counts));
    for (bounce, c) in bounces.chain([("all".to_owned(), profile.counts())]) {
        let w = c.work;
        let columns = [c.hits, c.misses, w.steps, w.skips, w.chords, w.nodes, w.primitives, w.blocks];
        let columns: String = columns.iter().map(|n| format!(" {:>10}", short(*n as f64))).collect();
        print_line(&format!("{bounce:>6} {:>10} {:>8.1}%{columns}", short(c.rays as f64), 100.0 * c.occupancy()))?;
    }
    print_line("triangles are tested in blocks of up to eight; chords met the BVH, skips are steps that the clearance grid kept out of it")
}

/// Everything in the table, and more digits.
fn report(scene: &Scene, profile: &Profile) -> Value {
    let balance = profile.balance();
    let frames = profile.passes.len() as f64;
    let shares: serde_json::Map<_, _> = balance.parts().into_iter().map(|(name, t)| (name.to_owned(), json!(t / balance.wall))).collect();
    let times: serde_json::Map<_, _> = balance.parts().into_iter().map(|(name, t)| (name.to_owned(), json!(micros(t / frames)))).collect();
    let counts = profile.counts();
    json!({
        "backend": profile.backend,
        "scene": scene.path.display().to_string(),
        "width": scene.film.width,
        "height": scene.film.height,
        "workers": profile.workers(),
        "warm_up": profile.warm_up,
        "frames": profile.passes.len(),
        "frame": spread_json(&profile.frame()),
        "rows": profile.rows().iter().map(row_json).collect::<Vec<_>>(),
        "kernels": profile.kernels().iter().map(row_json).collect::<Vec<_>>(),
        "shares": shares,
        "us_per_frame": times,
        "host_wait_us_per_frame": micros(balance.wait / frames),
        "counters": {
            "sample": profile.warm_up,
            "rays": counts.hits + counts.misses,
            "bounces": profile.rounds.iter().map(counts_json).collect::<Vec<_>>(),
            "total": counts_json(&counts),
        },
        "not_timed": profile.lost(),
    })
}

fn spread_json(s: &Spread) -> Value {
    let [min, median, p95, max, total] = [s.min, s.median, s.p95, s.max, s.total].map(|v| micros(v as f64));
    json!({ "count": s.count, "min_us": min, "median_us": median, "p95_us": p95, "max_us": max, "total_us": total })
}

fn row_json(row: &Row) -> Value {
    let mut value = spread_json(&row.spread);
    value["kernel"] = json!(&*row.kernel);
    value["bounce"] = json!(row.round);
    value["share"] = json!(row.share);
    value["items_per_frame"] = json!(row.items);
    value["items_per_second"] = json!(row.items_per_second);
    value["steps_per_second"] = json!(row.steps_per_second);
    value
}

fn counts_json(c: &RoundCounts) -> Value {
    json!({
        "rays": c.rays, "slots": c.slots, "occupancy": c.occupancy(), "hits": c.hits, "misses": c.misses,
        "steps": c.work.steps, "skips": c.work.skips, "chords": c.work.chords, "nodes": c.work.nodes,
        "primitives": c.work.primitives, "triangle_blocks": c.work.blocks,
    })
}
