//! `nullray trace`: single rays from a CSV file, where they end, and every vertex on the way if asked for.
//!
//! Rays are read, traced and written in chunks, so that a file of any length needs bounded memory. A ray that stops at a plane is
//! launched again from there with what it carries: its momentum in a metric, its direction and speed in a medium. The vertices of paths
//! come from tracing the same rays with one step more each time: that is quadratic in the number of steps, and meant for plots.

use super::trace_input::{Expected, RayReader};
use super::trace_output::{PathsWriter, Progress, RowWriter, Tally, Traced, Vertex, through_temporary};
use super::{BackendChoice, DeviceArgs};
use crate::backend::cpu::CpuBackend;
use crate::backend::path::trace_steps;
use crate::backend::{Backend, Launch, Precision, Stop, TraceOptions, TraceRay, TraceResult};
use crate::error::{Error, Result};
use crate::kernels::constants::STATUS_STOPPED;
use crate::scene::{Scene, Spacetime, load_scene};
use crate::spacetime::Class;
use crate::world::World;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Rays that are in memory at once.
const CHUNK: usize = 262_144;
/// Steps a traced ray is given at least.
const MAX_STEPS: u32 = 100_000;
/// Most rays whose paths are written.
const MAX_PATHS: usize = 100_000;
/// Most crossings of a plane that a ray is followed through.
const MAX_CROSSINGS: usize = 16;
/// What a stop must be less than.
const MAX_STOP: f64 = 1e12;

#[derive(Args)]
pub struct TraceArgs {
    /// Scene file
    scene: PathBuf,
    /// Rays: a CSV file with a header
    ///
    /// Columns x,y,z and either dx,dy,dz (direction in the local frame) or px,py,pz (covariant momentum of the photon); optionally
    /// `trace` (past or future) and `side` (1 or -1). Other columns are passed through.
    #[arg(long, value_name = "IN.csv")]
    rays: PathBuf,
    /// Where the rays ended: a CSV file
    #[arg(short, long, value_name = "OUT.csv")]
    output: PathBuf,
    /// Also write every vertex of every path, .csv or .vtp; time grows as the square of the number of steps
    #[arg(long, value_name = "FILE")]
    paths: Option<PathBuf>,
    /// Error allowed per step, in scene units [default: 1e-12, with --precision f32 1e-5]
    #[arg(long, value_name = "T")]
    tolerance: Option<f64>,
    /// End where rays last leave this coordinate radius of the model
    #[arg(long, value_name = "R", group = "stop")]
    sphere: Option<f64>,
    /// End at this coordinate length
    #[arg(long, value_name = "S", group = "stop")]
    length: Option<f64>,
    /// End at this coordinate time (metrics only)
    #[arg(long, value_name = "T", group = "stop")]
    time: Option<f64>,
    /// Record crossings of the plane n . x = d, up to 16 for each ray
    #[arg(long, value_name = "nx,ny,nz,d", group = "stop", allow_hyphen_values = true)]
    plane: Option<String>,
    /// Trace straight light
    #[arg(long)]
    linear: bool,
    /// Override a value of the scene, e.g. spacetime.mass=0.5
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Print a JSON summary
    #[arg(long)]
    json: bool,
}

impl TraceArgs {
    /// What ends the rays besides hits, capture and escape.
    fn stop(&self, kind: &str, class: Class) -> Result<Stop> {
        let usage = |argument: String, reason: String| Err(Error::Usage { argument, reason });
        if let Some(radius) = positive("--sphere", self.sphere)? {
            return Ok(Stop::Sphere(radius));
        }
        if let Some(length) = positive("--length", self.length)? {
            return Ok(Stop::Length(length));
        }
        if let Some(time) = positive("--time", self.time)? {
            return match class {
                Class::Metric => Ok(Stop::Parameter(time)),
                _ => usage(format!("--time {time}"), format!("kind `{kind}` has no coordinate time, expected a metric; use --length")),
            };
        }
        let Some(text) = &self.plane else { return Ok(Stop::Never) };
        let argument = format!("--plane {text}");
        if class == Class::Flow {
            return usage(argument, format!("rays of kind `{kind}` cannot be taken up again at a plane, expected a medium or a metric"));
        }
        match parse_plane(text) {
            Some((normal, d)) => Ok(Stop::Plane(normal, d)),
            None => usage(argument, "expected four numbers nx,ny,nz,d with a normal that is not zero".into()),
        }
    }

    /// Refuses outputs that cannot be meant.
    fn check_outputs(&self) -> Result<()> {
        if self.paths.as_ref() == Some(&self.output) {
            let argument = format!("--paths {}", self.output.display());
            return Err(Error::Usage { argument, reason: "expected another file than that of -o".into() });
        }
        Ok(())
    }

    /// The scene and its world, without a picture.
    fn load(&self) -> Result<(Scene, World)> {
        let mut scene = load_scene(Some(&self.scene), &self.set)?;
        if self.linear {
            scene.spacetime = Spacetime::flat();
        }
        // Backends keep a film of the scene's size, which rays on their own never touch.
        (scene.film.width, scene.film.height) = (1, 1);
        let world = World::compile(&scene)?;
        Ok((scene, world))
    }

    /// A backend that holds the world; `auto` goes to the CPU if the GPU lacks the precision.
    fn open(&self, world: World, precision: Precision) -> Result<Box<dyn Backend>> {
        let world = Arc::new(world);
        let mut backend = self.device.open()?;
        match backend.upload(world.clone(), precision, 0) {
            Err(e @ Error::NoDevice { .. }) if self.device.backend == BackendChoice::Auto && self.device.device.is_none() => {
                eprintln!("nullray: {e}; using the CPU backend");
                backend = Box::new(CpuBackend::new(self.device.threads.map(|t| t as usize))?);
                backend.upload(world, precision, 0)?;
            }
            outcome => outcome?,
        }
        Ok(backend)
    }
}

fn positive(name: &str, value: Option<f64>) -> Result<Option<f64>> {
    match value {
        Some(v) if !(v > 0.0 && v < MAX_STOP) => {
            Err(Error::Usage { argument: format!("{name} {v}"), reason: format!("expected a number above 0 and below {MAX_STOP:e}") })
        }
        v => Ok(v),
    }
}

/// Unit normal and distance of `nx,ny,nz,d`.
fn parse_plane(text: &str) -> Option<([f64; 3], f64)> {
    let values: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    let [x, y, z, d]: [f64; 4] = values?.try_into().ok()?;
    let size = norm([x, y, z]);
    let plane = ([x, y, z].map(|v| v / size), d / size);
    (size > 0.0 && size.is_finite() && plane.1.abs() < MAX_STOP).then_some(plane)
}

/// Length of a vector.
pub fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

pub fn run(args: &TraceArgs) -> Result<()> {
    args.check_outputs()?;
    let precision = args.device.precision(Precision::F64);
    let default = if precision == Precision::F64 { 1e-12 } else { 1e-5 };
    let tolerance = positive("--tolerance", args.tolerance)?.unwrap_or(default);
    let paths_format = args.paths.as_deref().map(PathsWriter::format_of).transpose()?;
    let (scene, world) = args.load()?;
    let class = world.model.class();
    let stop = args.stop(scene.spacetime.kind, class)?;
    let two_sided = world.model.has_throat() || scene.shapes.iter().any(|s| s.side != 0);
    let rays = RayReader::open(&args.rays, &Expected { kind: scene.spacetime.kind, class, two_sided })?;
    let backend = args.open(world, precision)?;

    let cancel = Arc::new(AtomicBool::new(false));
    let flag = cancel.clone();
    // A handler that cannot be installed only costs the clean exit on Ctrl-C.
    let _ = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed));
    eprintln!("nullray: {}, tolerance {tolerance:e}", backend.name());
    // A film's budget of steps is too small for tolerances of traced rays.
    let max_steps = Some(scene.integrator.max_steps.max(MAX_STEPS));
    let options = TraceOptions { tolerance, stop, max_steps };
    let mut job = Job { class, options, backend, rays, cancel, tally: Tally::new() };
    let rows = |to: &Path| RowWriter { to: to.into(), path: args.output.clone(), crossings: matches!(stop, Stop::Plane(..)) };
    match args.paths.as_deref().zip(paths_format) {
        Some((paths, format)) => through_temporary(paths, |paths_to| {
            let paths = PathsWriter { to: paths_to.into(), path: paths.into(), format };
            through_temporary(&args.output, |to| job.run(&scene, &rows(to), Some(&paths)))
        })?,
        None => through_temporary(&args.output, |to| job.run(&scene, &rows(to), None))?,
    }
    job.tally.report(&args.output, args.paths.as_deref(), args.json)
}

/// Everything that turns a file of rays into a file of ends.
struct Job {
    class: Class,
    options: TraceOptions,
    backend: Box<dyn Backend>,
    rays: RayReader,
    cancel: Arc<AtomicBool>,
    tally: Tally,
}

impl Job {
    /// Traces all rays of the file, in chunks.
    fn run(&mut self, scene: &Scene, rows: &RowWriter, paths: Option<&PathsWriter>) -> Result<()> {
        let mut file = rows.create(scene, &self.rays.passed_names())?;
        let mut paths = paths.map(|p| p.create().map(|file| (p, file))).transpose()?;
        let mut polylines: Vec<Vec<Vertex>> = Vec::new();
        let mut progress = Progress::new(self.rays.bytes);
        loop {
            let chunk = self.rays.read(CHUNK)?;
            if chunk.rays.is_empty() {
                break;
            }
            if paths.is_some() {
                if chunk.rays.len() > MAX_PATHS {
                    let reason = format!("more than {MAX_PATHS} rays in {}, expected at most as many", self.rays.path.display());
                    return Err(Error::Usage { argument: "--paths".into(), reason });
                }
                polylines = chunk.rays.iter().map(|r| vec![Vertex { position: r.origin, length: 0.0, side: r.side }]).collect();
            }
            let traced = self.trace(&chunk.rays, paths.is_some().then_some(&mut polylines[..]))?;
            self.tally.count(&traced);
            rows.write(&mut file, &chunk.passed, &traced)?;
            progress.report(self.tally.rays, self.rays.reader.position().byte());
        }
        if let Some((writer, file)) = &mut paths {
            writer.write(file, &polylines)?;
        }
        progress.finish();
        Ok(())
    }

    /// Traces rays to their ends, on through the planes they cross, and appends what they pass to `polylines`, one for each ray.
    fn trace(&mut self, rays: &[TraceRay], mut polylines: Option<&mut [Vec<Vertex>]>) -> Result<Vec<Traced>> {
        let crosses = matches!(self.options.stop, Stop::Plane(..));
        let mut traced: Vec<Traced> = Vec::with_capacity(rays.len());
        let mut going: Vec<usize> = (0..rays.len()).collect();
        let mut legs = rays.to_vec();
        while !going.is_empty() {
            check_cancelled(&self.cancel)?;
            let start = Instant::now();
            let ends = self.backend.trace(&legs, self.options)?;
            self.tally.tracing += start.elapsed();
            if let Some(polylines) = polylines.as_deref_mut() {
                self.collect(&legs, &ends, |leg, vertex| {
                    let i = going[leg];
                    let before = traced.get(i).map_or(0.0, |t: &Traced| t.result.length);
                    extend(&mut polylines[i], Vertex { length: before + vertex.length, ..vertex });
                })?;
            }
            for (&i, end) in going.iter().zip(ends) {
                match traced.get_mut(i) {
                    Some(ray) => ray.result = joined(&ray.result, &end, orientation(self.class, &rays[i], &ray.result)),
                    None => traced.push(Traced { result: end, crossings: Vec::new() }),
                }
                if crosses && end.status == STATUS_STOPPED {
                    traced[i].crossings.push(end.position);
                }
            }
            going.retain(|&i| crosses && traced[i].result.status == STATUS_STOPPED && traced[i].crossings.len() < MAX_CROSSINGS);
            legs = going.iter().map(|&i| onward(self.class, &rays[i], &traced[i].result)).collect();
        }
        // A line has two ends, even that of a ray that got nowhere.
        for line in polylines.into_iter().flatten().filter(|line| line.len() == 1) {
            line.push(line[0]);
        }
        Ok(traced)
    }

    /// Hands every vertex behind the start of each ray to `push`: where it is after each of its steps, and its end.
    fn collect(&mut self, rays: &[TraceRay], ends: &[TraceResult], mut push: impl FnMut(usize, Vertex)) -> Result<()> {
        let cancel = &self.cancel;
        let go_on = || check_cancelled(cancel);
        trace_steps(self.backend.as_mut(), rays, ends, self.options, 1, go_on, |i, at| push(i, Vertex::of(at)))
    }
}

fn check_cancelled(cancel: &AtomicBool) -> Result<()> {
    if cancel.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
}

/// Appends a vertex unless the line is there already, as it is after a step that was rejected.
fn extend(line: &mut Vec<Vertex>, vertex: Vertex) {
    let repeated = line.last().is_some_and(|last| last.position == vertex.position && last.side == vertex.side);
    if !repeated && vertex.position.iter().all(|c| c.is_finite()) {
        line.push(vertex);
    }
}

/// Sign of the momentum that `ray` reports, `so_far` for one, over that which is reported when it is taken up by [`onward`].
fn orientation(class: Class, ray: &TraceRay, so_far: &TraceResult) -> f64 {
    let opposite = match (class, ray.launch) {
        // Taken up with the photon's momentum: one followed backward along a direction reports its own, which is the opposite.
        (Class::Metric, Launch::Direction(_)) => ray.past,
        (Class::Metric, Launch::Momentum(_)) => false,
        // Taken up along its direction, which is that of its own momentum.
        _ => so_far.momentum.iter().zip(so_far.direction).map(|(p, d)| p * d).sum::<f64>() < 0.0,
    };
    if opposite { -1.0 } else { 1.0 }
}

/// The ray that goes on from where `ray` stopped.
fn onward(class: Class, ray: &TraceRay, so_far: &TraceResult) -> TraceRay {
    let launch = if class == Class::Metric {
        let sign = orientation(class, ray, so_far);
        Launch::Momentum(so_far.momentum.map(|c| c * sign))
    } else {
        let speed = norm(so_far.momentum);
        Launch::Direction(so_far.direction.map(|c| c * speed))
    };
    TraceRay { origin: so_far.position, launch, past: ray.past, side: so_far.side }
}

/// The end of a ray that came `so_far` and then took `leg`, whose momentum has this `sign` over the ray's. Drifts add up at worst.
fn joined(so_far: &TraceResult, leg: &TraceResult, sign: f64) -> TraceResult {
    TraceResult {
        momentum: leg.momentum.map(|c| c * sign),
        length: so_far.length + leg.length,
        parameter: so_far.parameter + leg.parameter,
        steps: so_far.steps.saturating_add(leg.steps),
        chords: so_far.chords.saturating_add(leg.chords),
        constraint_error: so_far.constraint_error + leg.constraint_error,
        frequency_ratio: so_far.frequency_ratio * leg.frequency_ratio,
        ..*leg
    }
}
