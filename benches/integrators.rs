//! What every integrator costs at equal error: camera rays past a black hole, at rest and spinning.
//!
//! The rays of a pinhole at 20 M are traced in f64 on one thread, out to 15 times as far, about where pictures take the asymptote: all
//! end on one sphere, so that their directions compare. The error of a ray is the angle to the direction of a reference; of the rays
//! that escape, the hardest 2 % are left out, since every error grows without bound towards the critical curve. Step or tolerance is
//! searched for until the error is within `SLACK` below a target. Steps include rejected ones.
//!
//! Evaluations of the force are the fair comparison, time is what a user pays: `symplectic`, `leapfrog` and, at rest, `euler` step one
//! ray at a time, the others run in SIMD lanes; and each step looks for geometry, of which there is none. Methods of fixed steps trace
//! every 16th ray in the order of difficulty; they are given up once their order says that they need more than `STEP_LIMIT` steps.
#![allow(clippy::unwrap_used, reason = "a benchmark stops where it cannot go on")]

use glam::DVec3;
use nullray::backend::cpu::CpuBackend;
use nullray::backend::{Backend, Precision, Stop, TraceOptions, TraceRay, TraceResult};
use nullray::kernels::constants::{STATUS_ESCAPED, SYMPLECTIC_ITERATIONS};
use nullray::scene::{Extent, parse_scene};
use nullray::world::World;
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Models by name, and their scene keys.
const MODELS: [(&str, &str); 2] =
    [("Schwarzschild", "kind = \"schwarzschild\""), ("Kerr of spin 0.9", "kind = \"kerr\"\nspin = 0.9\naxis = [0, 1, 0]")];

/// Rays across and down, vertical field of view (radians), and distance of the camera.
const WIDTH: u32 = 64;
const HEIGHT: u32 = 36;
const FOV: f64 = PI / 3.0;
const DISTANCE: f64 = 20.0;
/// Distance of the sphere on which rays end, over that of the camera.
const REACH: f64 = 15.0;

/// Errors to compare at (radians): a quarter of a pixel of a picture with 1080 rows, and one that nobody sees.
const TARGETS: [f64; 2] = [FOV / 1080.0 / 4.0, 1e-7];
/// Share of the escaping rays that err by less than the target.
const PERCENTILE: f64 = 0.98;
/// How far below the target the error may end up, as a share of it.
const SLACK: f64 = 0.1;
/// Method and tolerance of the reference.
const REFERENCE: (&str, f64) = ("dormand-prince", 1e-13);

/// Steps per ray that are too many to wait for.
const STEP_LIMIT: u32 = 200_000;
/// Length at which a ray with fixed steps is given up: some coarse steps lead nowhere.
const LONGEST: f64 = 1000.0;
/// Methods of fixed steps trace one ray of so many.
const FEW: usize = 16;

/// Settings that are tried, first step and tolerance, and the factor by which one trial may differ from the last.
const TRIALS: usize = 16;
const FIRST_STEP: f64 = 0.5;
const FIRST_TOLERANCE: f64 = 1e-4;
const STRIDE: f64 = 4.0;
/// Calls that are timed, unless one takes so many seconds that it will do.
const REPEATS: usize = 3;
const LONG_RUN: f64 = 1.0;

/// A way to integrate.
struct Method {
    /// Name in scene files.
    name: &'static str,
    /// Order of a method of fixed steps; the others choose theirs by a tolerance.
    order: Option<f64>,
    /// Evaluations of the force per step.
    evaluations: u32,
}

const METHODS: [Method; 7] = [
    Method { name: "euler", order: Some(1.0), evaluations: 1 },
    Method { name: "symplectic", order: Some(1.0), evaluations: SYMPLECTIC_ITERATIONS + 1 },
    Method { name: "leapfrog", order: Some(2.0), evaluations: 1 },
    Method { name: "rk4", order: Some(4.0), evaluations: 4 },
    Method { name: "bogacki-shampine", order: None, evaluations: 3 },
    Method { name: "dormand-prince", order: None, evaluations: 6 },
    Method { name: "nystrom", order: None, evaluations: 3 },
];

fn main() {
    let mut backend = CpuBackend::new(Some(1)).unwrap();
    println!("{}; f64; {WIDTH} x {HEIGHT} rays", backend.name());
    for (name, spacetime) in MODELS {
        let all = Sample::escaping(&mut backend, spacetime);
        let few = all.every(FEW);
        println!("\n{name}: {} rays escape\n", all.rays.len());
        let columns = TARGETS.map(|t| format!(" step or tolerance for {t:.1e} rad | steps | evaluations | microseconds |"));
        println!("| method |{}", columns.concat());
        println!("| --- |{}", " ---: |".repeat(4 * TARGETS.len()));
        for method in &METHODS {
            let cells = match compile(spacetime, method.name) {
                Some(world) => {
                    let sample = if method.order.is_some() { &few } else { &all };
                    Contestant { method, world, sample, backend: &mut backend }.cells()
                }
                None => " - |".repeat(4 * TARGETS.len()),
            };
            println!("| {} |{cells}", method.name);
        }
    }
}

/// An empty world; `None` if the model does not allow the method.
fn compile(spacetime: &str, method: &str) -> Option<World> {
    let text = format!("[film]\nwidth = {WIDTH}\nheight = {HEIGHT}\n[spacetime]\n{spacetime}\n[integrator]\nmethod = \"{method}\"\n");
    let mut scene = parse_scene(Path::new("integrators"), &text, &[]).ok()?;
    // In f64 rays would go to 4e5 M, in vain for our targets and without end in fixed steps.
    scene.spacetime.extent = Extent::Scenes(REACH);
    Some(World::compile(&scene).unwrap())
}

/// Ends of the rays in `world`, and the seconds that took.
fn trace(backend: &mut CpuBackend, world: World, rays: &[TraceRay], tolerance: f64, max_steps: u32) -> (Vec<TraceResult>, f64) {
    backend.upload(Arc::new(world), Precision::F64, 0).unwrap();
    let options = TraceOptions { tolerance, stop: Stop::Never, max_steps: Some(max_steps) };
    let start = Instant::now();
    let results = backend.trace(rays, options).unwrap();
    (results, start.elapsed().as_secs_f64())
}

// The rays.

/// Camera rays, and the directions they should end in.
struct Sample {
    rays: Vec<TraceRay>,
    exact: Vec<DVec3>,
}

impl Sample {
    /// The rays that escape, from the easiest to the hardest, as the steps of the reference tell.
    fn escaping(backend: &mut CpuBackend, spacetime: &str) -> Sample {
        let (method, tolerance) = REFERENCE;
        let rays = camera_rays();
        let (results, _) = trace(backend, compile(spacetime, method).unwrap(), &rays, tolerance, STEP_LIMIT);
        let mut escaped: Vec<(TraceRay, TraceResult)> =
            rays.into_iter().zip(results).filter(|(_, result)| result.status == STATUS_ESCAPED).collect();
        escaped.sort_by_key(|(_, result)| result.steps);
        let (rays, exact) = escaped.into_iter().map(|(ray, result)| (ray, DVec3::from(result.direction))).unzip();
        Sample { rays, exact }
    }

    /// One ray of every `count`.
    fn every(&self, count: usize) -> Sample {
        let pick = |i: &usize| i % count == count / 2;
        let (rays, exact) = (0..self.rays.len()).filter(pick).map(|i| (self.rays[i], self.exact[i])).unzip();
        Sample { rays, exact }
    }
}

/// Rays through the centers of the pixels of a camera that looks at the hole.
fn camera_rays() -> Vec<TraceRay> {
    let scale = 2.0 * (0.5 * FOV).tan() / f64::from(HEIGHT);
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let x = f64::from(i % WIDTH) + 0.5 - 0.5 * f64::from(WIDTH);
            let y = f64::from(i / WIDTH) + 0.5 - 0.5 * f64::from(HEIGHT);
            TraceRay::looking([0.0, 0.0, DISTANCE], [scale * x, -scale * y, -1.0])
        })
        .collect()
}

// The measurement.

/// What a method did at one setting of its step or tolerance.
#[derive(Clone, Copy)]
struct Cost {
    setting: f64,
    /// Percentile of the angles to the exact directions (radians).
    error: f64,
    /// Mean steps of the rays that escaped.
    steps: f64,
    /// Time of the call.
    seconds: f64,
}

/// A method on a model.
struct Contestant<'a> {
    method: &'a Method,
    world: World,
    sample: &'a Sample,
    backend: &'a mut CpuBackend,
}

impl Contestant<'_> {
    /// The method's cells of the table.
    fn cells(&mut self) -> String {
        let first = if self.method.order.is_some() { FIRST_STEP } else { FIRST_TOLERANCE };
        let mut cost = None;
        let mut cells = String::new();
        for (i, target) in TARGETS.into_iter().enumerate() {
            // What was too much for one target is too much for the next.
            if i == 0 || cost.is_some() {
                cost = self.search(target, cost.map_or(first, |c: Cost| c.setting));
            }
            cells += &match cost {
                Some(c) => {
                    let evaluations = c.steps * f64::from(self.method.evaluations);
                    format!(" {:.1e} | {:.1} | {evaluations:.0} | {:.2} |", c.setting, c.steps, self.microseconds(c))
                }
                None => format!(" - | > {},{:03} | - | - |", STEP_LIMIT / 1000, STEP_LIMIT % 1000),
            };
        }
        cells
    }

    /// Traces the sample.
    fn run(&mut self, setting: f64) -> Cost {
        let mut world = self.world.clone();
        let (tolerance, max_steps) = match self.method.order {
            Some(_) => {
                world.parameters.step = setting;
                (1.0, (LONGEST / setting) as u32)
            }
            None => (setting, STEP_LIMIT),
        };
        let (results, seconds) = trace(self.backend, world, &self.sample.rays, tolerance, max_steps);
        let mut errors: Vec<f64> = results.iter().zip(&self.sample.exact).map(|(result, exact)| error(result, *exact)).collect();
        errors.sort_by(f64::total_cmp);
        let steps: Vec<f64> = results.iter().filter(|r| r.status == STATUS_ESCAPED).map(|r| f64::from(r.steps)).collect();
        Cost {
            setting,
            error: errors[(PERCENTILE * errors.len() as f64) as usize],
            steps: steps.iter().sum::<f64>() / steps.len() as f64,
            seconds,
        }
    }

    /// The cost where the error is `target`, looked for from the setting `first`; `None` beyond `STEP_LIMIT`.
    fn search(&mut self, target: f64, first: f64) -> Option<Cost> {
        // Errors are in proportion to a tolerance.
        let order = self.method.order.unwrap_or(1.0);
        let limit = f64::from(STEP_LIMIT);
        let (mut fine, mut coarse) = (None::<Cost>, None::<f64>);
        let mut setting = first;
        for _ in 0..TRIALS {
            let cost = self.run(setting);
            let excess = cost.error / target;
            if excess > 1.0 {
                let needed = cost.steps * excess.powf(1.0 / order);
                if self.method.order.is_some() && cost.steps > 0.1 * limit && needed > limit {
                    return None;
                }
                coarse = Some(setting);
            } else {
                if fine.is_none_or(|f| f.setting < setting) {
                    fine = Some(cost);
                }
                if excess > 1.0 - SLACK {
                    break;
                }
            }
            // Aim by the order, but stay between what was too fine and what was too coarse.
            let factor = ((1.0 - 0.5 * SLACK) / excess).powf(1.0 / order);
            let aimed = setting * factor.clamp(1.0 / STRIDE, STRIDE);
            setting = match (fine, coarse) {
                (Some(fine), Some(coarse)) if aimed <= fine.setting || aimed >= coarse => (fine.setting * coarse).sqrt(),
                _ => aimed,
            };
        }
        fine
    }

    /// Microseconds per ray: the median of `REPEATS` calls, of which `cost` has one.
    fn microseconds(&mut self, cost: Cost) -> f64 {
        let mut seconds = vec![cost.seconds];
        while seconds.len() < REPEATS && cost.seconds < LONG_RUN {
            seconds.push(self.run(cost.setting).seconds);
        }
        seconds.sort_by(f64::total_cmp);
        1e6 * seconds[seconds.len() / 2] / self.sample.rays.len() as f64
    }
}

/// Angle between the end of a ray and the exact one (radians); the largest there is if it did not escape.
fn error(result: &TraceResult, exact: DVec3) -> f64 {
    if result.status != STATUS_ESCAPED {
        return PI;
    }
    // A direction that is not a number errs by all there is, too: `min` ignores it.
    2.0 * (0.5 * exact.distance(DVec3::from(result.direction))).min(1.0).asin()
}
