//! `nullray bench --table models`: what a ray costs in every bending model, on the benchmark scene.

use super::{BenchArgs, WARM_UP, machine, measure};
use crate::backend::{Backend, Profiling};
use crate::cli::print_line;
use crate::error::{Error, Result};
use crate::kernels::work::Work;
use crate::scene::parse_scene;
use crate::world::World;
use std::path::Path;
use std::sync::Arc;

/// Every model, as `[spacetime]` after its kind, at a strength that bends the picture and leaves it recognisable. Most are at PLACE.
const MODELS: [(&str, &str); 19] = [
    ("flat", "kind = \"flat\""),
    ("gravity, center", "kind = \"gravity\"\n[[spacetime.center]]\nposition = [0.9, 2.0, 1.2]\nstrength = 0.3\nradius = 5"),
    (
        "gravity, inverse square",
        "kind = \"gravity\"\nlaw = \"power\"\nexponent = 2\n[[spacetime.center]]\nposition = [0.9, 2.0, 1.2]\nstrength = 0.2\nradius = 8",
    ),
    ("lorenz", "kind = \"lorenz\"\nweight = 0.1\nposition = [0.9, 2.0, 1.2]"),
    ("rossler", "kind = \"rossler\"\nweight = 0.1\nposition = [0.9, 2.0, 1.2]"),
    ("parametric, helix", "kind = \"parametric\"\ncurve = \"helix\"\namplitude = 0.05\nfrequency = 2"),
    ("grin, fish-eye", "kind = \"grin\"\nprofile = \"fisheye\"\nn0 = 1.5\nradius = 12\nposition = [0.9, 2.0, 1.2]"),
    ("grin, luneburg", "kind = \"grin\"\nprofile = \"luneburg\"\nradius = 3\nposition = [0.9, 2.0, 1.2]"),
    ("grin, radial", "kind = \"grin\"\nprofile = \"radial\"\ncoefficients = [1.3, -0.01]\nradius = 5\nposition = [0.9, 2.0, 1.2]"),
    ("grin, layers", "kind = \"grin\"\nprofile = \"layered\"\nheights = [0, 2]\nindices = [0.95, 1.0]"),
    ("schwarzschild", "kind = \"schwarzschild\"\nmass = 0.1\nposition = [0.9, 2.0, 1.2]"),
    ("reissner-nordstrom", "kind = \"reissner-nordstrom\"\nmass = 0.1\ncharge = 0.08\nposition = [0.9, 2.0, 1.2]"),
    ("kerr", "kind = \"kerr\"\nmass = 0.1\nspin = 0.09\nposition = [0.9, 2.0, 1.2]"),
    (
        "majumdar-papapetrou",
        "kind = \"majumdar-papapetrou\"\n[[spacetime.mass]]\nposition = [0.9, 2.0, 1.2]\nmass = 0.05\n[[spacetime.mass]]\nposition = [-1.5, 2.2, 0.6]\nmass = 0.05",
    ),
    (
        "weak-lens",
        "kind = \"weak-lens\"\n[[spacetime.mass]]\nposition = [0.9, 2.0, 1.2]\nmass = 0.02\n[[spacetime.mass]]\nposition = [-1.5, 2.2, 0.6]\nmass = 0.02",
    ),
    ("alcubierre", "kind = \"alcubierre\"\nspeed = 0.5\nradius = 1\nsigma = 4\nposition = [0.9, 2.0, 1.2]"),
    ("ellis", "kind = \"ellis\"\nthroat = 0.4\nposition = [0.9, 2.0, 1.2]"),
    ("dneg", "kind = \"dneg\"\nthroat_radius = 0.4\nposition = [0.9, 2.0, 1.2]"),
    ("dust-disc", "kind = \"dust-disc\"\nmu = 0.5\nradius = 0.5\nposition = [0.9, 2.0, 1.2]"),
];

/// What rays of one model cost.
struct Cost {
    model: &'static str,
    size: &'static str,
    milliseconds: Vec<f64>,
    rays: f64,
    nanoseconds: f64,
    work: Work,
}

impl Cost {
    fn median(&self) -> f64 {
        self.milliseconds[self.milliseconds.len() / 2]
    }
    fn per_ray(&self, count: u64) -> f64 {
        count as f64 / self.rays
    }
}

/// Measures every model and prints the table.
pub fn run(args: &BenchArgs, path: &Path, sizes: &[(&'static str, u32, u32)], backend: &mut dyn Backend) -> Result<()> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.into(), source })?;
    let mut costs = vec![];
    for &(size, width, height) in sizes {
        for (model, spacetime) in MODELS {
            let text = format!("{text}\n[spacetime]\n{spacetime}\n");
            let scene = parse_scene(path, &text, &[format!("film.width={width}"), format!("film.height={height}")])?;
            costs.push(cost(args, backend, model, size, World::compile(&scene)?)?);
            eprintln!("nullray: {model} {size} {:.1} ms", costs.last().map_or(0.0, Cost::median));
        }
    }
    print_costs(args, &backend.name(), &costs)
}

fn cost(args: &BenchArgs, backend: &mut dyn Backend, model: &'static str, size: &'static str, world: World) -> Result<Cost> {
    let height = world.scene.film_height;
    let milliseconds = measure(backend, Arc::new(world), args)?;
    let workers = backend.timings().workers;
    // Counting has a sample of its own, which slows nothing that is timed.
    let before = backend.film()?.statistics.rays;
    let sample = WARM_UP + args.repeats;
    backend.set_profiling(Profiling::Counters);
    let counted = backend.accumulate(0..height, sample..sample + 1);
    backend.set_profiling(Profiling::Off);
    counted?;
    let mut work = Work::default();
    backend.timings().rounds.iter().for_each(|round| work.add(&round.work));
    let rays = (backend.film()?.statistics.rays - before) as f64;
    let median = milliseconds[milliseconds.len() / 2];
    Ok(Cost { model, size, milliseconds, rays, nanoseconds: 1e6 * median * f64::from(workers.max(1)) / rays, work })
}

fn print_costs(args: &BenchArgs, backend: &str, costs: &[Cost]) -> Result<()> {
    let to_flat = |cost: &Cost| {
        let flat = costs.iter().find(|c| c.size == cost.size && c.model == "flat");
        flat.map_or(f64::NAN, |flat| cost.nanoseconds / flat.nanoseconds)
    };
    if args.json {
        let rows: Vec<_> = costs
            .iter()
            .map(|c| {
                serde_json::json!({
                    "model": c.model, "size": c.size, "ms_per_sample": c.median(), "min": c.milliseconds.first(), "max": c.milliseconds.last(),
                    "repeats": c.milliseconds.len(), "rays_per_sample": c.rays, "ns_per_ray": c.nanoseconds, "steps_per_ray": c.per_ray(c.work.steps),
                    "chords_per_ray": c.per_ray(c.work.chords), "nodes_per_ray": c.per_ray(c.work.nodes), "ratio_to_flat": to_flat(c),
                })
            })
            .collect();
        return print_line(&serde_json::json!({ "machine": machine(), "backend": backend, "table": "models", "rows": rows }).to_string());
    }
    print_line(&format!("{}; {backend}", machine()))?;
    print_line("model                    size   ms/sample      min      max  ns/ray  steps  chords  nodes  to flat")?;
    for c in costs {
        let (min, max) = (c.milliseconds.first().copied().unwrap_or(0.0), c.milliseconds.last().copied().unwrap_or(0.0));
        print_line(&format!(
            "{:<24} {:<6} {:>9.1} {min:>8.1} {max:>8.1} {:>7.0} {:>6.1} {:>7.2} {:>6.2} {:>8.2}",
            c.model,
            c.size,
            c.median(),
            c.nanoseconds,
            c.per_ray(c.work.steps),
            c.per_ray(c.work.chords),
            c.per_ray(c.work.nodes),
            to_flat(c)
        ))?;
    }
    print_line("ns/ray is the time of a sample over its rays, of one worker; steps, chords and nodes are per ray, rejected steps included")
}
