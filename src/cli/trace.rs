//! `nullray trace`: single rays from a CSV file, where they end, and every vertex on the way if asked for.
//!
//! Rays are read, traced and written in chunks, so that a file of any length needs bounded memory. A ray that stops at a plane is
//! launched again from there with what it carries: its momentum in a metric, its direction and speed in a medium. The vertices of paths
//! come from tracing the same rays with one step more each time: that is quadratic in the number of steps, and meant for plots.

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
use csv::{ByteRecord, Position};
use std::fs::File;
use std::io::{BufReader, Read};
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
/// Largest number a column may hold.
const MAX_VALUE: f64 = 1e9;
/// What a stop must be less than.
const MAX_STOP: f64 = 1e12;

const POSITION: [&str; 3] = ["x", "y", "z"];
const DIRECTION: [&str; 3] = ["dx", "dy", "dz"];
const MOMENTUM: [&str; 3] = ["px", "py", "pz"];

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

fn norm(v: [f64; 3]) -> f64 {
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

/// A column, from 0, and what is wrong with it.
type Complaint = (usize, String);
type Checked<T> = std::result::Result<T, Complaint>;

/// What a file of rays may ask for, by the scene they go through.
struct Expected {
    kind: &'static str,
    class: Class,
    two_sided: bool,
}

/// Rays, and the fields beside each that are passed through.
#[derive(Default)]
struct Chunk {
    rays: Vec<TraceRay>,
    passed: Vec<ByteRecord>,
}

/// Reads rays from a CSV file.
struct RayReader {
    path: PathBuf,
    reader: csv::Reader<File>,
    header: ByteRecord,
    columns: Columns,
    /// Size of the file; 0 if it has none.
    bytes: u64,
}

impl RayReader {
    /// Opens a file and reads its header.
    fn open(path: &Path, expected: &Expected) -> Result<RayReader> {
        let file = File::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
        let bytes = file.metadata().map_or(0, |m| m.len());
        let mut reader = csv::ReaderBuilder::new().buffer_capacity(1 << 16).from_reader(file);
        let header = reader.byte_headers().map_err(|e| csv_error(path, e))?.clone();
        let columns = Columns::of(&header, expected).map_err(|complaint| bad_field(path, header.position(), complaint))?;
        Ok(RayReader { path: path.into(), reader, header, columns, bytes })
    }

    /// The header of the columns that are passed through.
    fn passed_names(&self) -> ByteRecord {
        self.columns.select(&self.header)
    }

    /// Reads the next rays, at most `limit`; none at the end of the file.
    fn read(&mut self, limit: usize) -> Result<Chunk> {
        let mut chunk = Chunk::default();
        let mut record = ByteRecord::new();
        while chunk.rays.len() < limit && self.reader.read_byte_record(&mut record).map_err(|e| csv_error(&self.path, e))? {
            let ray = self.columns.ray(&record).map_err(|complaint| bad_field(&self.path, record.position(), complaint))?;
            chunk.rays.push(ray);
            chunk.passed.push(self.columns.select(&record));
        }
        Ok(chunk)
    }
}

/// The error of a field; its column counts fields.
fn bad_field(path: &Path, position: Option<&Position>, (column, reason): Complaint) -> Error {
    Error::Scene { path: path.into(), line: line_of(path, position), column: column + 1, reason }
}

fn csv_error(path: &Path, error: csv::Error) -> Error {
    let position = error.position().cloned();
    match error.into_kind() {
        csv::ErrorKind::Io(source) => Error::Io { path: path.into(), source },
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            let reason = format!("found {len} fields, expected {expected_len} as in the header");
            bad_field(path, position.as_ref(), (len.min(expected_len) as usize, reason))
        }
        other => Error::Asset { path: path.into(), reason: format!("cannot be read as CSV: {other:?}") },
    }
}

/// Line, from 1, of the record at `position`. The reader's own count lags behind after CRLF and blank lines (rust-csv issues 395, 208).
fn line_of(path: &Path, position: Option<&Position>) -> usize {
    let Some(position) = position else { return 1 };
    // A pipe cannot be read again.
    if !std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
        return position.line() as usize;
    }
    File::open(path)
        .map_or(position.line() as usize, |file| line_at(BufReader::new(file).bytes().map_while(|byte| byte.ok()), position.byte()))
}

/// Line, from 1, of the first byte at `start` or after it that ends no line.
fn line_at(bytes: impl Iterator<Item = u8>, start: u64) -> usize {
    let mut line = 1;
    let mut previous = 0;
    for (offset, byte) in (0u64..).zip(bytes) {
        let ends_line = matches!(byte, b'\r' | b'\n');
        if offset >= start && !ends_line {
            break;
        }
        line += usize::from(ends_line && !(byte == b'\n' && previous == b'\r'));
        previous = byte;
    }
    line
}

/// Where in a record the parts of a ray are.
struct Columns {
    names: Vec<String>,
    origin: [usize; 3],
    vector: [usize; 3],
    is_momentum: bool,
    trace: Option<usize>,
    side: Option<usize>,
    /// Whether rays may start on the far side.
    two_sided: bool,
    /// The columns that are passed through.
    passed: Vec<usize>,
}

impl Columns {
    fn of(header: &ByteRecord, expected: &Expected) -> Checked<Columns> {
        let names: Vec<String> = header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
        let find = |name: &str| -> Checked<Option<usize>> {
            let mut found = (0..names.len()).filter(|&i| names[i] == name);
            let first = found.next();
            match found.next() {
                Some(second) => Err((second, format!("column `{name}` again, expected it once"))),
                None => Ok(first),
            }
        };
        let need = |name: &str| -> Checked<usize> {
            let missing = || (names.len(), format!("column `{name}` is missing, expected x,y,z and either dx,dy,dz or px,py,pz"));
            find(name)?.ok_or_else(missing)
        };
        let three = |of: [&str; 3]| -> Checked<[usize; 3]> { Ok([need(of[0])?, need(of[1])?, need(of[2])?]) };
        let any = |of: [&str; 3]| names.iter().position(|name| of.contains(&name.as_str()));

        let origin = three(POSITION)?;
        let is_momentum = any(MOMENTUM).is_some();
        if let (Some(_), Some(p)) = (any(DIRECTION), any(MOMENTUM)) {
            return Err((p, format!("column `{}` beside a direction, expected either dx,dy,dz or px,py,pz", names[p])));
        }
        if let (Some(p), Class::Flow) = (any(MOMENTUM), expected.class) {
            return Err((p, format!("column `{}`: rays of kind `{}` have no momentum, expected dx,dy,dz", names[p], expected.kind)));
        }
        let vector = three(if is_momentum { MOMENTUM } else { DIRECTION })?;
        let (trace, side) = (find("trace")?, find("side")?);
        let own: Vec<usize> = origin.into_iter().chain(vector).chain(trace).chain(side).collect();
        let passed = (0..names.len()).filter(|i| !own.contains(i)).collect();
        Ok(Columns { origin, vector, is_momentum, trace, side, two_sided: expected.two_sided, passed, names })
    }

    /// The fields that are passed through.
    fn select(&self, record: &ByteRecord) -> ByteRecord {
        self.passed.iter().map(|&i| &record[i]).collect()
    }

    /// The ray of a record.
    fn ray(&self, record: &ByteRecord) -> Checked<TraceRay> {
        let origin = self.numbers(record, self.origin)?;
        let vector = self.numbers(record, self.vector)?;
        // Below this its length is lost to underflow.
        if norm(vector) < 1e-150 {
            let [x, y, z] = self.vector.map(|i| &self.names[i]);
            return Err((self.vector[0], format!("columns `{x}`, `{y}`, `{z}`: found a zero vector, expected one of some length")));
        }
        let launch = if self.is_momentum { Launch::Momentum(vector) } else { Launch::Direction(vector) };
        let past = match self.trace.map(|i| (i, record[i].trim_ascii())) {
            None | Some((_, b"past")) => true,
            Some((_, b"future")) => false,
            Some((i, _)) => return Err(self.complaint(record, i, "`past` or `future`")),
        };
        let side = match self.side.map(|i| (i, self.number(record, i))) {
            None => 1,
            Some((_, Ok(1.0))) => 1,
            Some((_, Ok(-1.0))) if self.two_sided => -1,
            Some((i, _)) => return Err(self.complaint(record, i, if self.two_sided { "1 or -1" } else { "1: the scene has one side" })),
        };
        Ok(TraceRay { origin, launch, past, side })
    }

    fn numbers(&self, record: &ByteRecord, at: [usize; 3]) -> Checked<[f64; 3]> {
        Ok([self.number(record, at[0])?, self.number(record, at[1])?, self.number(record, at[2])?])
    }

    fn number(&self, record: &ByteRecord, i: usize) -> Checked<f64> {
        let value = std::str::from_utf8(&record[i]).ok().and_then(|text| text.trim().parse::<f64>().ok());
        value
            .filter(|v| v.abs() <= MAX_VALUE)
            .ok_or_else(|| self.complaint(record, i, &format!("a number between -{MAX_VALUE:e} and {MAX_VALUE:e}")))
    }

    /// What was found in a field, on one line, and what was expected there.
    fn complaint(&self, record: &ByteRecord, i: usize, expected: &str) -> Complaint {
        let found: String = String::from_utf8_lossy(&record[i]).chars().take(40).flat_map(char::escape_debug).collect();
        (i, format!("column `{}`: found `{found}`, expected {expected}", self.names[i]))
    }
}
