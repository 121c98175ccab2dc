//! The profiler: what it claims of a frame holds, on both backends; what it writes can be read.
//!
//! Without a Vulkan device its tests show as ignored, unless `NULLRAY_REQUIRE_VULKAN=1` says that there must be one.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use gpu_allocator::MemoryLocation;
use nullray::backend::cpu::CpuBackend;
use nullray::backend::vulkan::VulkanBackend;
use nullray::backend::vulkan::buffer::Buffer;
use nullray::backend::vulkan::command::Commands;
use nullray::backend::vulkan::pipeline::{Layout, Pipeline, kernel_spirv};
use nullray::backend::{Backend, Precision, Profiling, RoundCounts};
use nullray::profile::{Profile, Spread};
use nullray::world::World;
use serde_json::Value;
use std::collections::BTreeMap;
use std::process::{Command, Output};
use std::sync::Arc;
use support::*;

/// Frames of every profile.
const FRAMES: u32 = 4;
/// Film of the program's profiles.
const SIZE: (u32, u32) = (160, 90);

fn main() {
    // (name, needs a device, test)
    let tests: [DeviceTest; 11] = [
        ("spread_is_right", false, spread_is_right),
        ("bad_arguments_are_refused", false, bad_arguments_are_refused),
        ("log_says_what_takes_how_long", false, log_says_what_takes_how_long),
        ("table_names_everything", false, table_names_everything),
        ("totals_are_exact", false, totals_are_exact),
        ("cpu_profile_holds", false, || profile_holds("cpu")),
        ("cpu_shows_a_heavier_kernel", false, || shows_a_heavier_kernel(&mut CpuBackend::new(None).unwrap())),
        ("vulkan_profile_holds", true, || profile_holds("vulkan")),
        ("vulkan_shows_a_heavier_kernel", true, || shows_a_heavier_kernel(&mut vulkan())),
        ("backends_count_the_same", true, backends_count_the_same),
        ("untimed_dispatches_are_named", true, untimed_dispatches_are_named),
    ];
    run_device_tests(&tests);
}

fn vulkan() -> VulkanBackend {
    VulkanBackend::new(None).unwrap()
}

/// Runs the program, without validation, which takes time of its own.
fn nullray(arguments: &[&str], log: Option<&str>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_nullray"));
    command.args(arguments).current_dir(root()).env_remove("NULLRAY_VALIDATION").env_remove("NULLRAY_LOG");
    command.envs(log.map(|l| ("NULLRAY_LOG", l))).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("{value} is not a list"))
}

/// The built-in scene at the size of a film.
fn built_in(size: (u32, u32), set: &[&str]) -> World {
    let (width, height) = (format!("film.width={}", size.0), format!("film.height={}", size.1));
    let size = [width.as_str(), height.as_str()];
    asset_world("singularity.toml", &[&size[..], set].concat())
}

fn backend(name: &str) -> Box<dyn Backend> {
    if name == "cpu" { Box::new(CpuBackend::new(None).unwrap()) } else { Box::new(vulkan()) }
}

fn measure(backend: &mut dyn Backend, world: World) -> Profile {
    let height = world.scene.film_height;
    backend.upload(Arc::new(world), Precision::F32, 0).unwrap();
    Profile::measure(backend, height, FRAMES).unwrap()
}

fn spread_is_right() {
    let spread = Spread::of((1..=100).rev().collect());
    assert_eq!((spread.count, spread.min, spread.median, spread.p95, spread.max, spread.total), (100, 1, 50, 95, 100, 5050));
    let one = Spread::of(vec![7]);
    assert_eq!((one.count, one.min, one.median, one.p95, one.max, one.total), (1, 7, 7, 7, 7, 7));
    assert_eq!(Spread::of(vec![]).max, 0);
}

fn bad_arguments_are_refused() {
    let cases: [&[&str]; 4] = [
        &["profile", "--frames", "0"],
        &["profile", "nowhere.toml"],
        &["profile", "--json", "/proc/nowhere/a.json"],
        &["profile", "--chrome-trace", "/proc/nowhere/a.json"],
    ];
    for arguments in cases {
        let output = nullray(arguments, None);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(output.stdout.is_empty() && !message.contains("panicked"), "{arguments:?}: {message}");
    }
    let output = nullray(&["check", "assets/scenes/cornell.toml"], Some("nullray=loud"));
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("NULLRAY_LOG=nullray=loud"), "{}", text(&output.stderr));
}

fn log_says_what_takes_how_long() {
    let arguments = ["check", "assets/scenes/singularity.toml"];
    let quiet = nullray(&arguments, None);
    assert!(quiet.status.success() && quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
    let logged = nullray(&arguments, Some("nullray=info"));
    assert!(logged.status.success());
    assert_eq!(logged.stdout, quiet.stdout);
    let lines = text(&logged.stderr);
    for span in ["load", "compile", "bvh", "clearance"] {
        assert!(lines.lines().any(|l| l.contains(span) && l.contains("close") && l.contains("time.busy")), "no span `{span}` in\n{lines}");
    }
}

fn table_names_everything() {
    let output = nullray(&["profile", "--backend", "cpu", "--size", "64x36", "--frames", "2"], None);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    for word in [
        "generate",
        "advance",
        "shade",
        "resolve",
        "bounce",
        "median us",
        "p95 us",
        "share",
        "items/s",
        "steps/s",
        "between dispatches",
        "submission latency",
        "host submit",
        "outside",
        "host wait",
        "occupied",
        "skips",
        "nodes",
        "triangles",
    ] {
        assert!(table.contains(word), "no `{word}` in\n{table}");
    }
}

/// Totals need no profiling, and records are kept only while it is on.
fn totals_are_exact() {
    let mut cpu = CpuBackend::new(Some(1)).unwrap();
    let world = Arc::new(built_in((64, 36), &[]));
    cpu.upload(world, Precision::F32, 0).unwrap();
    cpu.accumulate(0..36, 0..1).unwrap();
    let timings = cpu.timings();
    assert!(timings.dispatches.is_empty() && timings.submissions.is_empty() && timings.rounds.is_empty());
    let names: Vec<&str> = timings.totals().iter().map(|t| t.kernel.as_str()).collect();
    assert_eq!(names, ["generate", "advance", "shade", "resolve"]);
    assert!(cpu.timings().totals().is_empty(), "taken twice");

    cpu.set_profiling(Profiling::Times);
    cpu.accumulate(0..36, 1..2).unwrap();
    let timings = cpu.timings();
    for total in timings.totals() {
        let own: Vec<u64> = timings.dispatches.iter().filter(|d| *d.kernel == *total.kernel).map(|d| d.duration).collect();
        let time: u64 = own.iter().sum();
        assert_eq!((total.count, total.time.as_nanos() as u64), (own.len() as u64, time), "{}", total.kernel);
    }
    assert!(timings.rounds.is_empty() && timings.submissions.len() == 1 && timings.lost.is_empty());
}

/// What the program reports of a frame adds up, agrees with the film, and its trace shows the same.
fn profile_holds(name: &str) {
    let folder = std::env::temp_dir().join(format!("nullray-profile-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let trace_path = folder.join("trace.json");
    let (size, frames) = (format!("{}x{}", SIZE.0, SIZE.1), FRAMES.to_string());
    let trace_file = trace_path.display().to_string();
    let output =
        nullray(&["profile", "--backend", name, "--size", &size, "--frames", &frames, "--json", "-", "--chrome-trace", &trace_file], None);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let trace: Value = serde_json::from_slice(&std::fs::read(&trace_path).unwrap()).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();

    shares_add_up(&report);
    counts_agree(&report, name);
    trace_agrees(&report, &trace);
}

fn shares_add_up(report: &Value) {
    assert_eq!((number(&report["frames"]), number(&report["frame"]["count"])), (f64::from(FRAMES), f64::from(FRAMES)));
    assert!(number(&report["warm_up"]) >= 2.0);
    let shares = report["shares"].as_object().unwrap();
    let sum: f64 = shares.values().map(number).sum();
    assert!((sum - 1.0).abs() < 1e-6, "{shares:?}");
    assert!(shares.values().all(|s| number(s) >= -1e-3), "{shares:?}");
    // All but the rest is the wall time within 5%.
    assert!(number(&shares["outside"]).abs() < 0.05, "{shares:?}");
    for rows in ["rows", "kernels"] {
        let kernels: f64 = list(&report[rows]).iter().map(|r| number(&r["share"])).sum();
        assert!((kernels - number(&shares["kernels"])).abs() < 1e-6, "{rows}: {kernels}, {shares:?}");
    }
    let per_frame: f64 = report["us_per_frame"].as_object().unwrap().values().map(number).sum();
    let wall = number(&report["frame"]["total_us"]) / f64::from(FRAMES);
    assert!((per_frame - wall).abs() < 1e-3 * wall, "{per_frame} {wall}");
    for row in list(&report["rows"]) {
        let order = ["min_us", "median_us", "p95_us", "max_us"].map(|k| number(&row[k]));
        assert!(order.is_sorted() && number(&row["count"]) > 0.0, "{row}");
        assert!(number(&row["total_us"]) <= number(&row["count"]) * order[3] * (1.0 + 1e-9), "{row}");
    }
    assert!(report["not_timed"].as_object().unwrap().is_empty(), "{}", report["not_timed"]);
}

fn counts_agree(report: &Value, name: &str) {
    let counters = &report["counters"];
    let sample = number(&counters["sample"]) as u32;
    let mut backend = backend(name);
    backend.upload(Arc::new(built_in(SIZE, &[])), Precision::F32, 0).unwrap();
    backend.accumulate(0..SIZE.1, sample..sample + 1).unwrap();
    let film = backend.film().unwrap();
    assert_eq!(number(&counters["rays"]), film.statistics.rays as f64);
    let bounces = list(&counters["bounces"]);
    let pixels = f64::from(SIZE.0 * SIZE.1);
    assert_eq!((number(&bounces[0]["rays"]), number(&bounces[0]["slots"])), (pixels, pixels));
    for (bounce, counts) in bounces.iter().enumerate() {
        assert!(number(&counts["rays"]) <= number(&counts["slots"]), "{bounce}: {counts}");
        let advance = list(&report["rows"])
            .iter()
            .find(|r| r["kernel"].as_str().unwrap().starts_with("advance") && r["bounce"] == bounce)
            .unwrap_or_else(|| panic!("no row for bounce {bounce}"));
        assert_eq!(advance["items_per_frame"], counts["rays"], "{bounce}");
    }
    let total = &counters["total"];
    assert!(number(&total["steps"]) > number(&total["rays"]), "{total}");
    for key in ["skips", "chords", "nodes", "primitives"] {
        assert!(number(&total[key]) > 0.0, "{key}: {total}");
    }
    assert!(number(&total["skips"]) < number(&total["steps"]), "{total}");
    let kernels = list(&report["kernels"]);
    let named = |stem: &str| kernels.iter().find(|k| k["kernel"].as_str().unwrap().starts_with(stem)).unwrap();
    assert!(number(&named("advance")["steps_per_second"]) > 0.0 && named("shade")["steps_per_second"].is_null());
    assert_eq!((number(&named("generate")["items_per_frame"]), number(&named("resolve")["items_per_frame"])), (pixels, pixels));
}

fn trace_agrees(report: &Value, trace: &Value) {
    let events = list(&trace["traceEvents"]);
    let of_kind = |kind: &str| events.iter().filter(|e| e["ph"] == kind).collect::<Vec<_>>();
    let named: Vec<&Value> = of_kind("M").into_iter().filter(|e| e["name"] == "thread_name").map(|e| &e["tid"]).collect();
    let complete = of_kind("X");
    // Times are whole nanoseconds, in microseconds.
    let slack = 1e-4;
    let span = |e: &Value| (number(&e["ts"]), number(&e["ts"]) + number(&e["dur"]));
    let wall = complete.iter().filter(|e| e["name"] == "frame").map(|e| span(e).1).fold(0.0, f64::max);
    let mut rows: BTreeMap<u64, Vec<(f64, f64)>> = BTreeMap::new();
    for event in &complete {
        let (start, end) = span(event);
        assert!(start >= 0.0 && end <= wall + slack, "{event} is outside 0 to {wall}");
        assert!(named.contains(&&event["tid"]), "{event}: a row without a name");
        rows.entry(event["tid"].as_u64().unwrap()).or_default().push((start, end));
    }
    for (row, mut spans) in rows {
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!(spans.windows(2).all(|w| w[0].1 <= w[1].0 + slack), "row {row} overlaps itself");
    }
    let frames = complete.iter().filter(|e| e["name"] == "frame").count();
    assert_eq!(frames, FRAMES as usize);
    for kernel in list(&report["kernels"]) {
        let count = complete.iter().filter(|e| e["name"] == kernel["kernel"]).count();
        assert_eq!(count as f64, number(&kernel["count"]), "{kernel}");
    }
    let waited: f64 = complete.iter().filter(|e| e["name"] == "wait").map(|e| number(&e["dur"])).sum();
    let claimed = number(&report["host_wait_us_per_frame"]) * f64::from(FRAMES);
    assert!((waited - claimed).abs() <= 1e-3 * claimed, "{waited} {claimed}");
}

/// A tolerance a hundred thousand times tighter costs steps, and the kernel that takes them a larger part of the time: the median of
/// five profiles, because the machine may be doing something else meanwhile.
fn shows_a_heavier_kernel(backend: &mut dyn Backend) {
    let mut of_tolerance = |tolerance: &str| {
        let mut measured: Vec<(f64, f64)> = (0..5)
            .map(|_| {
                let profile = measure(backend, built_in((96, 54), &[tolerance]));
                let kernels = profile.kernels();
                let total: u64 = kernels.iter().map(|k| k.spread.total).sum();
                let advance = kernels.iter().find(|k| k.kernel.starts_with("advance")).unwrap();
                (profile.counts().work.steps as f64, advance.spread.total as f64 / total as f64)
            })
            .collect();
        measured.sort_by(|a, b| a.1.total_cmp(&b.1));
        measured[2]
    };
    let (steps, share) = of_tolerance("integrator.tolerance=3");
    let (more_steps, larger_share) = of_tolerance("integrator.tolerance=0.00003");
    println!("steps {steps} and {more_steps}, shares {share:.3} and {larger_share:.3}");
    assert!(more_steps > 2.0 * steps, "{steps} {more_steps}");
    assert!(larger_share > share, "{share} {larger_share}");
}

/// What the kernels do for one sample of a world, round by round.
fn count(backend: &mut dyn Backend, world: World) -> Vec<RoundCounts> {
    let height = world.scene.film_height;
    backend.upload(Arc::new(world), Precision::F32, 0).unwrap();
    backend.set_profiling(Profiling::Counters);
    backend.accumulate(0..height, 0..1).unwrap();
    backend.set_profiling(Profiling::Off);
    backend.timings().rounds
}

fn backends_count_the_same() {
    let (mut cpu, mut gpu) = (backend("cpu"), backend("vulkan"));
    for scene in ["singularity.toml", "cornell.toml", "suzanne-reflected.toml"] {
        let set = ["film.width=96", "film.height=54", "film.max_depth=4"];
        let rounds = [count(cpu.as_mut(), asset_world(scene, &set)), count(gpu.as_mut(), asset_world(scene, &set))];
        assert_eq!(rounds[0][0].slots, rounds[1][0].slots);
        let [c, g] = rounds.map(|rounds| {
            rounds.iter().fold(RoundCounts::default(), |mut sum, round| {
                sum.add(round);
                sum
            })
        });
        println!("{scene}: {c:?} {g:?}");
        let pairs = [
            ("hits", c.hits, g.hits),
            ("misses", c.misses, g.misses),
            ("steps", c.work.steps, g.work.steps),
            ("skips", c.work.skips, g.work.skips),
            ("chords", c.work.chords, g.work.chords),
            ("nodes", c.work.nodes, g.work.nodes),
            ("primitives", c.work.primitives, g.work.primitives),
            ("blocks", c.work.blocks, g.work.blocks),
        ];
        for (what, a, b) in pairs {
            let (a, b) = (a as f64, b as f64);
            assert!((a - b).abs() <= 0.02 * a.max(b) + 20.0, "{scene}: {what}: {a} on the CPU, {b} on the GPU");
        }
    }
}

/// More dispatches than a submission has timestamps for.
fn untimed_dispatches_are_named() {
    let backend = vulkan();
    let device = backend.device();
    let layout = Layout::new(device, 3, 88).unwrap();
    let pipeline = Pipeline::new(device, &layout, "prepare", kernel_spirv("prepare").unwrap()).unwrap();
    let buffers = ["paths", "counters", "queues"].map(|name| Buffer::new(device, name, 1024, MemoryLocation::GpuOnly).unwrap());
    layout.bind(&buffers.each_ref());
    let mut commands = Commands::new(device).unwrap();
    commands.set_profiling(Profiling::Times);
    commands.begin().unwrap();
    commands.clear(&buffers[1]);
    commands.barrier();
    for round in 0..600 {
        commands.begin_round(round);
        commands.dispatch(&layout, &pipeline, &[0; 88], 1);
        commands.barrier();
        commands.end_round();
    }
    commands.submit().unwrap();
    let timings = commands.take_timings();
    assert_eq!(timings.dispatches.len(), 512);
    assert!(timings.dispatches.iter().enumerate().all(|(i, d)| d.round == Some(i as u32) && &*d.kernel == "prepare"));
    assert_eq!(timings.lost, BTreeMap::from([("prepare".to_owned(), 88)]));
    let [submission] = timings.submissions[..] else { panic!("{} submissions", timings.submissions.len()) };
    assert!(timings.dispatches.iter().map(|d| d.duration).sum::<u64>() <= submission.span, "{submission:?}");
}
