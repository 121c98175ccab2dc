//! What `nullray trace` leaves behind: a row for each ray, the vertices of paths, a line on how far it is and one on what came of it.
//!
//! Numbers are written with the fewest digits that read back exactly. The drift of millions of rays is kept as a histogram over the
//! leading bits of its floating-point numbers, which are in the order of the numbers themselves.

use super::print_line;
use crate::backend::TraceResult;
use crate::error::{Error, Result};
use crate::film::write_atomically;
use crate::kernels::constants::*;
use crate::scene::Scene;
use csv::ByteRecord;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use std::fmt::{Arguments, Write as _};
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Columns of every result.
const RESULT_COLUMNS: [&str; 18] = [
    "status",
    "x",
    "y",
    "z",
    "dx",
    "dy",
    "dz",
    "vx",
    "vy",
    "vz",
    "length",
    "side",
    "steps",
    "chords",
    "constraint_error",
    "frequency_ratio",
    "object",
    "material",
];
/// Columns of crossings: how many, and where the first ones are.
const CROSSING_COLUMNS: [&str; 10] = ["crossings", "c1_x", "c1_y", "c1_z", "c2_x", "c2_y", "c2_z", "c3_x", "c3_y", "c3_z"];
/// Crossings that have columns.
const SHOWN_CROSSINGS: usize = 3;
/// Rows that one thread writes at a time.
const ROWS: usize = 4096;

/// How rays end, by name.
const STATUSES: [(u32, &str); 5] = [
    (STATUS_HIT, "hit"),
    (STATUS_ESCAPED, "escaped"),
    (STATUS_CAPTURED, "captured"),
    (STATUS_EXHAUSTED, "exhausted"),
    (STATUS_STOPPED, "stopped"),
];

/// A ray at its end.
pub struct Traced {
    /// The end.
    pub result: TraceResult,
    /// Where it crossed the plane.
    pub crossings: Vec<[f64; 3]>,
}

/// A point of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Position.
    pub position: [f64; 3],
    /// Coordinate length from the start.
    pub length: f64,
    /// Side of a wormhole: 1 or -1.
    pub side: i32,
}

impl Vertex {
    /// Where a ray ended.
    pub fn of(end: &TraceResult) -> Vertex {
        Vertex { position: end.position, length: end.length, side: end.side }
    }
}

/// Lets `write` fill a temporary file that becomes `path` once all went well; a pipe or a device is written straight.
pub fn through_temporary(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    match std::fs::metadata(path) {
        Ok(m) if m.is_dir() => Err(Error::Io { path: path.into(), source: io::ErrorKind::IsADirectory.into() }),
        Ok(m) if !m.is_file() => write(path),
        _ => write_atomically(path, write),
    }
}

/// Writes the results of rays as CSV.
pub struct RowWriter {
    /// Where they go for now.
    pub to: PathBuf,
    /// Where they will be.
    pub path: PathBuf,
    /// Whether crossings of a plane have columns.
    pub crossings: bool,
}

/// An open file of results.
pub struct RowFile {
    file: File,
    /// Material of each object.
    materials: Vec<String>,
}

impl RowWriter {
    /// Creates the file and writes its header: the columns that are passed through, then those of results.
    pub fn create(&self, scene: &Scene, passed: &ByteRecord) -> Result<RowFile> {
        let materials = scene.shapes.iter().map(|shape| scene.materials[shape.material].name.clone()).collect();
        let header = || -> io::Result<File> {
            let mut file = File::create(&self.to)?;
            let mut writer = csv::Writer::from_writer(Vec::new());
            writer.write_record(column_names(passed, self.crossings))?;
            file.write_all(&writer.into_inner().map_err(|e| e.into_error())?)?;
            Ok(file)
        };
        let file = header().map_err(|e| self.error(e))?;
        Ok(RowFile { file, materials })
    }

    /// Appends the rows of some rays.
    pub fn write(&self, out: &mut RowFile, passed: &[ByteRecord], traced: &[Traced]) -> Result<()> {
        let materials = &out.materials;
        let pieces: Vec<io::Result<Vec<u8>>> =
            passed.par_chunks(ROWS).zip(traced.par_chunks(ROWS)).map(|(p, t)| rows(p, t, materials, self.crossings)).collect();
        for piece in pieces {
            piece.and_then(|bytes| out.file.write_all(&bytes)).map_err(|e| self.error(e))?;
        }
        Ok(())
    }

    fn error(&self, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), source }
    }
}

/// The header of the output. A column that is passed through gives way to one of the results of the same name.
fn column_names(passed: &ByteRecord, crossings: bool) -> Vec<Vec<u8>> {
    let results: Vec<&str> = RESULT_COLUMNS.iter().chain(CROSSING_COLUMNS.iter().filter(|_| crossings)).copied().collect();
    let mut names: Vec<Vec<u8>> = Vec::with_capacity(passed.len() + results.len());
    for name in passed {
        let mut own = name.to_vec();
        while results.iter().any(|r| r.as_bytes() == own) || (own != name && passed.iter().any(|p| p == own)) {
            own = [b"in_".as_slice(), &own].concat();
        }
        names.push(own);
    }
    names.extend(results.iter().map(|r| r.as_bytes().to_vec()));
    names
}

/// Fields of CSV, written without an allocation for each.
struct Fields {
    writer: csv::Writer<Vec<u8>>,
    text: String,
}

impl Fields {
    fn bytes(&mut self, field: &[u8]) -> io::Result<()> {
        self.writer.write_field(field).map_err(io::Error::from)
    }

    fn shown(&mut self, value: Arguments<'_>) -> io::Result<()> {
        self.text.clear();
        // Writing to a string does not fail.
        let _ = self.text.write_fmt(value);
        self.writer.write_field(&self.text).map_err(io::Error::from)
    }

    fn numbers(&mut self, values: &[f64]) -> io::Result<()> {
        values.iter().try_for_each(|v| self.shown(format_args!("{v:?}")))
    }
}

/// Rows of CSV for some rays.
fn rows(passed: &[ByteRecord], traced: &[Traced], materials: &[String], crossings: bool) -> io::Result<Vec<u8>> {
    let mut out = Fields { writer: csv::Writer::from_writer(Vec::with_capacity(traced.len() * 320)), text: String::new() };
    for (passed, ray) in passed.iter().zip(traced) {
        let r = &ray.result;
        for field in passed {
            out.bytes(field)?;
        }
        out.bytes(status_name(r.status).as_bytes())?;
        out.numbers(&r.position)?;
        out.numbers(&r.direction)?;
        out.numbers(&r.momentum)?;
        out.numbers(&[r.length])?;
        out.shown(format_args!("{}", r.side))?;
        out.shown(format_args!("{}", r.steps))?;
        out.shown(format_args!("{}", r.chords))?;
        out.numbers(&[r.constraint_error, r.frequency_ratio])?;
        match r.object {
            Some(object) => {
                out.shown(format_args!("{object}"))?;
                out.bytes(materials.get(object as usize).map_or("", String::as_str).as_bytes())?;
            }
            None => {
                out.bytes(b"")?;
                out.bytes(b"")?;
            }
        }
        if crossings {
            out.shown(format_args!("{}", ray.crossings.len()))?;
            for i in 0..SHOWN_CROSSINGS {
                match ray.crossings.get(i) {
                    Some(place) => out.numbers(place)?,
                    None => (0..3).try_for_each(|_| out.bytes(b""))?,
                }
            }
        }
        out.writer.write_record(None::<&[u8]>)?;
    }
    out.writer.into_inner().map_err(|e| e.into_error())
}

fn status_name(status: u32) -> &'static str {
    STATUSES.iter().find(|(s, _)| *s == status).map_or("unknown", |(_, name)| name)
}

/// Format of a file of paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathsFormat {
    /// A row for each vertex.
    Csv,
    /// VTK's XML PolyData, a polyline for each ray.
    Vtp,
}

/// Writes the vertices of paths.
pub struct PathsWriter {
    /// Where they go for now.
    pub to: PathBuf,
    /// Where they will be.
    pub path: PathBuf,
    /// How they are written.
    pub format: PathsFormat,
}

impl PathsWriter {
    /// Format that the name of a file asks for.
    pub fn format_of(path: &Path) -> Result<PathsFormat> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(PathsFormat::Csv),
            Some("vtp") => Ok(PathsFormat::Vtp),
            _ => Err(Error::Usage {
                argument: format!("--paths {}", path.display()),
                reason: "expected a file name ending in .csv or .vtp".into(),
            }),
        }
    }

    /// Creates the file.
    pub fn create(&self) -> Result<File> {
        File::create(&self.to).map_err(|e| self.error(e))
    }

    /// Writes all paths.
    pub fn write(&self, file: &mut File, lines: &[Vec<Vertex>]) -> Result<()> {
        let mut out = BufWriter::new(file);
        match self.format {
            PathsFormat::Csv => write_csv(&mut out, lines),
            PathsFormat::Vtp => write_vtp(&mut out, lines),
        }
        .and_then(|()| out.flush())
        .map_err(|e| self.error(e))
    }

    fn error(&self, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), source }
    }
}

fn write_csv(out: &mut impl Write, lines: &[Vec<Vertex>]) -> io::Result<()> {
    writeln!(out, "ray,vertex,x,y,z,length,side")?;
    for (ray, line) in lines.iter().enumerate() {
        for (i, Vertex { position: [x, y, z], length, side }) in line.iter().enumerate() {
            writeln!(out, "{ray},{i},{x:?},{y:?},{z:?},{length:?},{side}")?;
        }
    }
    Ok(())
}

/// A polyline for each ray, as text, with its arrays on the points.
fn write_vtp(out: &mut impl Write, lines: &[Vec<Vertex>]) -> io::Result<()> {
    let points: usize = lines.iter().map(Vec::len).sum();
    let vertices = || lines.iter().flatten();
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(out, "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">")?;
    writeln!(out, "<PolyData>")?;
    let others = "NumberOfVerts=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\"";
    writeln!(out, "<Piece NumberOfPoints=\"{points}\" NumberOfLines=\"{}\" {others}>", lines.len())?;
    writeln!(out, "<PointData>")?;
    data_array(out, "type=\"Float64\" Name=\"length\"", vertices(), |out, v| writeln!(out, "{:?}", v.length))?;
    data_array(out, "type=\"Int32\" Name=\"side\"", vertices(), |out, v| writeln!(out, "{}", v.side))?;
    let rays = lines.iter().enumerate().flat_map(|(ray, line)| std::iter::repeat_n(ray, line.len()));
    data_array(out, "type=\"Int64\" Name=\"ray\"", rays, |out, ray| writeln!(out, "{ray}"))?;
    writeln!(out, "</PointData>")?;
    writeln!(out, "<Points>")?;
    data_array(out, "type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"", vertices(), |out, v| {
        let [x, y, z] = v.position;
        writeln!(out, "{x:?} {y:?} {z:?}")
    })?;
    writeln!(out, "</Points>")?;
    writeln!(out, "<Lines>")?;
    data_array(out, "type=\"Int64\" Name=\"connectivity\"", 0..points, |out, i| writeln!(out, "{i}"))?;
    let ends = lines.iter().scan(0, |end, line| {
        *end += line.len();
        Some(*end)
    });
    data_array(out, "type=\"Int64\" Name=\"offsets\"", ends, |out, end| writeln!(out, "{end}"))?;
    writeln!(out, "</Lines>")?;
    writeln!(out, "</Piece>")?;
    writeln!(out, "</PolyData>")?;
    writeln!(out, "</VTKFile>")
}

fn data_array<W: Write, T>(
    out: &mut W,
    attributes: &str,
    values: impl Iterator<Item = T>,
    mut write: impl FnMut(&mut W, T) -> io::Result<()>,
) -> io::Result<()> {
    writeln!(out, "<DataArray {attributes} format=\"ascii\">")?;
    for value in values {
        write(out, value)?;
    }
    writeln!(out, "</DataArray>")
}

/// Leading bits of a number that choose its bin: the exponent and eight of the fraction.
const BIN_SHIFT: u32 = 44;

/// What came of all rays.
pub struct Tally {
    /// Rays traced.
    pub rays: u64,
    /// Time the backend took for them, without that for paths.
    pub tracing: Duration,
    start: Instant,
    statuses: [u64; STATUSES.len()],
    steps: u64,
    max_drift: f64,
    /// Rays by the leading bits of their drift.
    drifts: Vec<u64>,
}

impl Tally {
    /// Of no rays.
    pub fn new() -> Tally {
        Tally {
            rays: 0,
            tracing: Duration::ZERO,
            start: Instant::now(),
            statuses: [0; STATUSES.len()],
            steps: 0,
            max_drift: 0.0,
            drifts: vec![0; 1 << (63 - BIN_SHIFT)],
        }
    }

    /// Adds some rays.
    pub fn count(&mut self, traced: &[Traced]) {
        for ray in traced {
            let r = &ray.result;
            self.rays += 1;
            self.steps += u64::from(r.steps);
            for (count, (status, _)) in self.statuses.iter_mut().zip(STATUSES) {
                *count += u64::from(status == r.status);
            }
            // What is not a number has drifted as far as there is.
            let drift = if r.constraint_error.is_nan() { f64::INFINITY } else { r.constraint_error.abs() };
            self.max_drift = self.max_drift.max(drift);
            self.drifts[(drift.to_bits() >> BIN_SHIFT) as usize] += 1;
        }
    }

    /// Drift that the share `q` of the rays does not exceed, to 0.4 percent of itself.
    fn drift_quantile(&self, q: f64) -> f64 {
        let rank = (q * self.rays as f64).ceil() as u64;
        let mut below = 0;
        let bin = self.drifts.iter().position(|count| {
            below += count;
            below >= rank
        });
        f64::from_bits((bin.unwrap_or(0) as u64) << BIN_SHIFT)
    }

    /// One line on stderr; with `json` an object on stdout.
    pub fn report(&self, output: &Path, paths: Option<&Path>, json: bool) -> Result<()> {
        let tracing = self.tracing.as_secs_f64();
        let per_second = |count: u64| if tracing > 0.0 { count as f64 / tracing } else { 0.0 };
        let counts: Vec<String> = STATUSES.iter().zip(self.statuses).map(|((_, name), n)| format!("{n} {name}")).collect();
        let exhausted = STATUSES.iter().zip(self.statuses).find(|((status, _), _)| *status == STATUS_EXHAUSTED).map_or(0, |(_, n)| n);
        if exhausted > 0 {
            eprintln!("nullray: {exhausted} of {} rays ran out of steps; raise integrator.max_steps", self.rays);
        }
        eprintln!(
            "nullray: {} rays, {:.4e} rays/s, {:.4e} steps/s: {}: {}",
            self.rays,
            per_second(self.rays),
            per_second(self.steps),
            counts.join(", "),
            output.display()
        );
        if !json {
            return Ok(());
        }
        let status: serde_json::Map<String, serde_json::Value> =
            STATUSES.iter().zip(self.statuses).map(|((_, name), n)| ((*name).to_owned(), serde_json::Value::from(n))).collect();
        let summary = serde_json::json!({
            "output": output.display().to_string(),
            "paths": paths.map(|p| p.display().to_string()),
            "rays": self.rays,
            "status": status,
            "seconds": self.start.elapsed().as_secs_f64(),
            "tracing_seconds": tracing,
            "rays_per_second": per_second(self.rays),
            "steps_per_second": per_second(self.steps),
            "steps_per_ray": self.steps as f64 / self.rays.max(1) as f64,
            "max_constraint_error": self.max_drift,
            "constraint_error_p99.9": self.drift_quantile(0.999),
        });
        print_line(&summary.to_string())
    }
}

/// A bar on a terminal, a line every few seconds elsewhere.
pub struct Progress {
    bar: Option<ProgressBar>,
    /// Size of the input.
    bytes: u64,
    start: Instant,
    last: Instant,
}

impl Progress {
    /// Of a file of so many bytes; 0 if that is not known.
    pub fn new(bytes: u64) -> Progress {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(bytes.max(1));
            if let Ok(style) = ProgressStyle::with_template("{wide_bar} {msg}") {
                bar.set_style(style);
            }
            bar
        });
        Progress { bar, bytes, start: Instant::now(), last: Instant::now() }
    }

    /// After so many rays, at this byte of the input.
    pub fn report(&mut self, rays: u64, byte: u64) {
        let rate = rays as f64 / self.start.elapsed().as_secs_f64().max(1e-9);
        let share = if self.bytes > 0 { format!(", {:.0}%", 100.0 * byte as f64 / self.bytes as f64) } else { String::new() };
        let text = format!("{rays} rays{share}, {rate:.0}/s");
        match &self.bar {
            Some(bar) => {
                bar.set_position(byte);
                bar.set_message(text);
            }
            None if self.last.elapsed() > Duration::from_secs(5) => {
                self.last = Instant::now();
                eprintln!("nullray: {text}");
            }
            None => {}
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
