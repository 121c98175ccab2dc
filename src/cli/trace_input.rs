//! Rays of `nullray trace`, read from a CSV file.

use super::trace::norm;
use crate::backend::{Launch, TraceRay};
use crate::error::{Error, Result};
use crate::spacetime::Class;
use csv::{ByteRecord, Position};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Largest number a column may hold.
const MAX_VALUE: f64 = 1e9;

const POSITION: [&str; 3] = ["x", "y", "z"];
const DIRECTION: [&str; 3] = ["dx", "dy", "dz"];
const MOMENTUM: [&str; 3] = ["px", "py", "pz"];

/// A column, from 0, and what is wrong with it.
type Complaint = (usize, String);
type Checked<T> = std::result::Result<T, Complaint>;

/// What a file of rays may ask for, by the scene they go through.
pub struct Expected {
    pub kind: &'static str,
    pub class: Class,
    pub two_sided: bool,
}

/// Rays, and the fields beside each that are passed through.
#[derive(Default)]
pub struct Chunk {
    pub rays: Vec<TraceRay>,
    pub passed: Vec<ByteRecord>,
}

/// Reads rays from a CSV file.
pub struct RayReader {
    pub path: PathBuf,
    pub reader: csv::Reader<File>,
    header: ByteRecord,
    columns: Columns,
    /// Size of the file; 0 if it has none.
    pub bytes: u64,
}

impl RayReader {
    /// Opens a file and reads its header.
    pub fn open(path: &Path, expected: &Expected) -> Result<RayReader> {
        let file = File::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
        let bytes = file.metadata().map_or(0, |m| m.len());
        let mut reader = csv::ReaderBuilder::new().buffer_capacity(1 << 16).from_reader(file);
        let header = reader.byte_headers().map_err(|e| csv_error(path, e))?.clone();
        let columns = Columns::of(&header, expected).map_err(|complaint| bad_field(path, header.position(), complaint))?;
        Ok(RayReader { path: path.into(), reader, header, columns, bytes })
    }

    /// The header of the columns that are passed through.
    pub fn passed_names(&self) -> ByteRecord {
        self.columns.select(&self.header)
    }

    /// Reads the next rays, at most `limit`; none at the end of the file.
    pub fn read(&mut self, limit: usize) -> Result<Chunk> {
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
