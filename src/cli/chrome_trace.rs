//! A profile as trace events, which Perfetto and chrome://tracing open: frames, what the host did, what every worker ran.

use super::trace_output::through_temporary;
use crate::error::{Error, Result};
use crate::profile::Profile;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Processes and threads of the trace. No two threads have the same number, whatever their process.
const HOST: u32 = 1;
const BACKEND: u32 = 2;
const FRAMES: usize = 11;
const SUBMISSIONS: usize = 12;
const FIRST_WORKER: usize = 100;

/// Writes the trace of all timed passes.
pub fn write_chrome_trace(path: &Path, profile: &Profile) -> Result<()> {
    through_temporary(path, |to| {
        let fail = |source| Error::Io { path: path.into(), source };
        let mut out = BufWriter::new(File::create(to).map_err(fail)?);
        write_events(&mut out, profile).and_then(|()| out.flush()).map_err(fail)
    })
}

fn write_events(out: &mut impl Write, profile: &Profile) -> io::Result<()> {
    out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
    let mut separator = "";
    let mut emit = |event: Value| {
        let written = write!(out, "{separator}{event}");
        separator = ",\n";
        written
    };
    let named = |what: &str, process: u32, thread: usize, name: &str| {
        let arguments = json!({ "name": name });
        json!({ "ph": "M", "name": what, "pid": process, "tid": thread, "args": arguments })
    };
    emit(named("process_name", HOST, FRAMES, "host"))?;
    emit(named("thread_name", HOST, FRAMES, "frames"))?;
    emit(named("thread_name", HOST, SUBMISSIONS, "submissions"))?;
    emit(named("process_name", BACKEND, FIRST_WORKER, &profile.backend))?;
    let worker = profile.passes.first().map_or("", |p| p.timings.worker);
    for i in 0..profile.workers() as usize {
        emit(named("thread_name", BACKEND, FIRST_WORKER + i, &format!("{worker} {i}")))?;
    }

    let origin = profile.passes.first().map_or(0, |p| p.start);
    let complete = |process: u32, thread: usize, name: &str, start: u64, duration: u64, arguments: Value| {
        let (ts, dur) = (start.saturating_sub(origin) as f64 / 1e3, duration as f64 / 1e3);
        json!({ "ph": "X", "name": name, "pid": process, "tid": thread, "ts": ts, "dur": dur, "args": arguments })
    };
    for pass in &profile.passes {
        emit(complete(HOST, FRAMES, "frame", pass.start, pass.wall, json!({ "sample": pass.sample })))?;
        for s in &pass.timings.submissions {
            if s.submit > 0 {
                emit(complete(HOST, SUBMISSIONS, "submit", s.start, s.submit, json!({})))?;
            }
            emit(complete(HOST, SUBMISSIONS, "wait", s.start + s.submit, s.wait, json!({})))?;
        }
        for d in &pass.timings.dispatches {
            let arguments = d.round.map_or_else(|| json!({}), |round| json!({ "bounce": round }));
            emit(complete(BACKEND, FIRST_WORKER + d.worker, &d.kernel, d.start, d.duration, arguments))?;
        }
    }
    out.write_all(b"\n]}\n")
}
