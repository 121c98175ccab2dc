//! Which samples to render next, how much at a time, and when to stop. Knows only the [`Backend`] trait.

use crate::backend::Backend;
use crate::error::Result;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long one call to the backend should take: short enough for progress several times a second and for Ctrl-C.
const CALL_TIME: Duration = Duration::from_millis(200);
/// Most samples of a pixel in one call.
const MAX_SAMPLES_PER_CALL: u32 = 64;
/// Samples before the noise is first estimated.
const NOISE_SAMPLES: u32 = 16;

/// When a rendering is done: at the first of the given limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Index of the first sample.
    pub first_sample: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// Wall time.
    pub time: Option<Duration>,
    /// Relative error of the film, see [`crate::film::Film::relative_error`].
    pub noise: Option<f64>,
}

/// How far a rendering has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Samples done in every pixel.
    pub samples: u32,
    /// Share of the pass that is under way.
    pub pass: f64,
    /// Samples per pixel asked for.
    pub goal: u32,
    /// Time since the start.
    pub elapsed: Duration,
    /// Last estimate of the relative error.
    pub noise: Option<f64>,
}

/// Why a rendering ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All samples were rendered.
    Complete,
    /// The time was up.
    TimeUp,
    /// The noise target was reached.
    NoiseReached,
    /// `cancel` was set.
    Cancelled,
}

/// Renders until a limit of `goal` or `cancel`; `report` is called after every call to the backend.
///
/// Rows per call follow the measured cost, and once whole frames are cheap, several samples are rendered per call.
pub fn render(
    backend: &mut dyn Backend,
    height: u32,
    goal: &Goal,
    cancel: &AtomicBool,
    mut report: impl FnMut(Progress),
) -> Result<Ending> {
    let start = Instant::now();
    let mut rows_per_call = 16u32.min(height);
    let mut done = 0;
    let mut noise = None;
    let mut next_estimate = NOISE_SAMPLES;
    while done < goal.samples {
        // A frame so cheap that several fit into one call is sampled several times.
        let mut samples = if rows_per_call > height { (rows_per_call / height).min(MAX_SAMPLES_PER_CALL) } else { 1 };
        samples = samples.min(goal.samples - done);
        if goal.noise.is_some() {
            samples = samples.min(next_estimate.saturating_sub(done).max(1));
        }
        let first = goal.first_sample + done;
        let mut row = 0;
        while row < height {
            let end = (row + rows_per_call.div_ceil(samples).max(1)).min(height);
            let before = Instant::now();
            backend.accumulate(row..end, first..first + samples)?;
            let work = (end - row) * samples;
            let rate = f64::from(work) / before.elapsed().as_secs_f64().max(1e-6);
            let wanted = (rate * CALL_TIME.as_secs_f64()).clamp(1.0, f64::from(height) * f64::from(MAX_SAMPLES_PER_CALL));
            // Follow the measurement, but not its noise.
            rows_per_call = (0.5 * f64::from(rows_per_call) + 0.5 * wanted).ceil() as u32;
            row = end;
            report(Progress {
                samples: done,
                pass: f64::from(row) / f64::from(height) * f64::from(samples),
                goal: goal.samples,
                elapsed: start.elapsed(),
                noise,
            });
            if cancel.load(Ordering::Relaxed) {
                return Ok(Ending::Cancelled);
            }
            if goal.time.is_some_and(|t| start.elapsed() >= t) && (done > 0 || row == height) {
                return Ok(Ending::TimeUp);
            }
        }
        done += samples;
        if let Some(target) = goal.noise
            && done >= next_estimate
        {
            let error = backend.film()?.relative_error();
            noise = Some(error);
            if error <= target {
                return Ok(Ending::NoiseReached);
            }
            next_estimate = done + (done / 4).max(NOISE_SAMPLES);
        }
    }
    Ok(Ending::Complete)
}
