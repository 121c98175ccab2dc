//! Helpers of the tests: reference tables, scenes from text, films of them.
#![allow(dead_code, reason = "every test file uses a part")]

pub mod tables;

use libtest_mimic::{Arguments, Failed, Trial};
use nullray::backend::vulkan::VulkanBackend;
use nullray::backend::vulkan::instance::validation_messages;
use nullray::backend::{Backend, Precision, Stop, TraceOptions, TraceRay};
use nullray::film::Film;
use nullray::scene::{Scene, load_scene, parse_scene};
use nullray::world::World;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A test: its name, whether it needs a Vulkan device, and what it does.
pub type DeviceTest = (&'static str, bool, fn());

/// Runs tests one after another, because there is one device and times are measured, with validation on, whose messages fail them.
/// Without a device the tests that need one are ignored, or all fail with `NULLRAY_REQUIRE_VULKAN=1`.
pub fn run_device_tests(tests: &[DeviceTest]) -> ! {
    // SAFETY: no other thread runs yet.
    unsafe { std::env::set_var("NULLRAY_VALIDATION", "1") };
    let mut arguments = Arguments::from_args();
    arguments.test_threads = Some(1);
    let missing = VulkanBackend::new(None).err();
    let required = std::env::var("NULLRAY_REQUIRE_VULKAN").is_ok_and(|v| v == "1");
    if let (Some(e), true) = (&missing, required) {
        eprintln!("a Vulkan device is required: {e}");
        std::process::exit(1);
    }
    let trial = |&(name, needs_device, test): &DeviceTest| {
        let run = move || {
            let before = validation_messages();
            test();
            let messages = validation_messages() - before;
            if messages > 0 { Err(Failed::from(format!("{messages} validation messages"))) } else { Ok(()) }
        };
        Trial::test(name, run).with_ignored_flag(needs_device && missing.is_some())
    };
    libtest_mimic::run(&arguments, tests.iter().map(trial).collect()).exit()
}

/// A row of a reference table by column name.
pub struct Row(HashMap<String, String>);

impl Row {
    pub fn text(&self, column: &str) -> &str {
        self.0.get(column).map(String::as_str).unwrap_or_else(|| panic!("no column {column}"))
    }
    pub fn number(&self, column: &str) -> f64 {
        self.text(column).parse().unwrap_or_else(|e| panic!("{column} = {:?}: {e}", self.text(column)))
    }
    pub fn vector(&self, columns: [&str; 3]) -> [f64; 3] {
        columns.map(|c| self.number(c))
    }
}

/// Splits a line of CSV; quoted fields may hold commas.
fn fields(line: &str) -> Vec<String> {
    let mut out = vec![String::new()];
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            ',' if !quoted => out.push(String::new()),
            c => out.last_mut().unwrap().push(c),
        }
    }
    out
}

/// Reads tests/reference/<name>.csv.
pub fn table(name: &str) -> Vec<Row> {
    let path = root().join("tests/reference").join(format!("{name}.csv"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut lines = text.lines();
    let header = fields(lines.next().unwrap());
    let rows: Vec<Row> = lines.map(|l| Row(header.iter().cloned().zip(fields(l)).collect())).collect();
    assert!(!rows.is_empty(), "{name} is empty");
    rows
}

/// The repository.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A world from scene text.
pub fn world(text: &str) -> World {
    let scene = parse_scene(Path::new("test.toml"), text, &[]).unwrap();
    World::compile(&scene).unwrap()
}

/// A scene from a file of assets/scenes, with overrides.
pub fn asset_scene(name: &str, set: &[&str]) -> Scene {
    let set: Vec<String> = set.iter().map(|s| s.to_string()).collect();
    load_scene(Some(&root().join("assets/scenes").join(name)), &set).unwrap()
}

/// A world from a file of assets/scenes, with overrides.
pub fn asset_world(name: &str, set: &[&str]) -> World {
    World::compile(&asset_scene(name, set)).unwrap()
}

/// Renders samples `0..spp`.
pub fn film(backend: &mut dyn Backend, world: World, precision: Precision, spp: u32) -> Film {
    let height = world.scene.film_height;
    backend.upload(Arc::new(world), precision, 0).unwrap();
    backend.accumulate(0..height, 0..spp).unwrap();
    backend.film().unwrap()
}

/// A world rendered with new parameters gives the film of a world that was compiled with them, to the bit.
pub fn new_parameters_are_as_good_as_a_new_world(backend: &mut dyn Backend) {
    let small = ["film.width=33", "film.height=19"];
    let large = [
        "film.width=70",
        "film.height=41",
        "film.max_depth=3",
        "film.filter=box",
        "integrator.tolerance=1.0",
        "camera.position=[0.6, 1.9, -8]",
        "camera.fov_degrees=60",
        "camera.aperture_radius=0.05",
    ];
    for name in ["singularity.toml", "dim-curved.toml", "cornell.toml"] {
        // The film grows, then it shrinks.
        for [before, after] in [[&small[..], &large[..]], [&large[..], &small[..]]] {
            let (old, scene) = (Arc::new(asset_world(name, before)), asset_scene(name, after));
            let (parameters, fresh) = (old.parameters_for(&scene).unwrap(), World::compile(&scene).unwrap());
            assert_eq!(bytemuck::bytes_of(&parameters), bytemuck::bytes_of(&fresh.scene), "{name}: parameters differ");
            let old_height = old.scene.film_height;
            backend.upload(old, Precision::F32, 0).unwrap();
            backend.accumulate(0..old_height, 0..1).unwrap();
            backend.set_parameters(&parameters).unwrap();
            backend.accumulate(0..parameters.film_height, 0..2).unwrap();
            let changed = backend.film().unwrap();
            assert!(changed == film(backend, fresh, Precision::F32, 2), "{name}: films differ on {}", backend.name());
        }
    }
}

pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

/// The scene of one row of a groeller table.
fn gravity_world(row: &Row, strength: f64, form: &str, step: f64) -> World {
    let center = row.vector(["xg_x", "xg_y", "xg_z"]);
    world(&format!(
        "[spacetime]\nkind = \"gravity\"\nform = \"{form}\"\n[[spacetime.center]]\nposition = {center:?}\nstrength = {strength:?}\nradius = {:?}\n\
         [integrator]\nmax_steps = 1000000\nstep = {step:?}",
        row.number("R")
    ))
}

fn traced(backend: &mut dyn Backend, world: World, precision: Precision, row: &Row, tolerance: f64, length: f64) -> ([f64; 3], [f64; 3]) {
    backend.upload(Arc::new(world), precision, 0).unwrap();
    let ray = TraceRay::looking(row.vector(["x0_x", "x0_y", "x0_z"]), row.vector(["v0_x", "v0_y", "v0_z"]));
    let result = backend.trace(&[ray], TraceOptions { tolerance, stop: Stop::Length(length), max_steps: None }).unwrap()[0];
    (result.position, result.momentum)
}

/// Largest error of the thesis' literal recurrence over every row.
pub fn groeller_literal_error(backend: &mut dyn Backend, precision: Precision) -> f64 {
    let mut worst: f64 = 0.0;
    for row in table("groeller_euler") {
        let world = gravity_world(&row, row.number("gM"), "literal", row.number("h"));
        // The recurrence makes n_steps steps of h, wherever they lead.
        let length = row.number("h") * row.number("n_steps");
        let (x, v) = traced(backend, world, precision, &row, 1.0, length);
        worst = worst.max(distance(x, row.vector(["xN_x", "xN_y", "xN_z"])));
        worst = worst.max(distance(v, row.vector(["vN_x", "vN_y", "vN_z"])));
    }
    worst
}

/// Largest error of the equation of motion over every row.
pub fn groeller_limit_error(backend: &mut dyn Backend, precision: Precision, tolerance: f64) -> f64 {
    let mut worst: f64 = 0.0;
    for row in table("groeller_limit") {
        let world = gravity_world(&row, row.number("kappa"), "ode", 0.1);
        let (x, v) = traced(backend, world, precision, &row, tolerance, row.number("s_end"));
        worst = worst.max(distance(x, row.vector(["xe_x", "xe_y", "xe_z"])));
        worst = worst.max(distance(v, row.vector(["ve_x", "ve_y", "ve_z"])));
    }
    worst
}
