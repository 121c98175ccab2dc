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

/// How much coarser than the window a picture may be, each way.
const REDUCTIONS: [u32; 5] = [1, 2, 4, 8, 16];
/// Fewer samples of pixels tell what a call costs by itself, not what a pixel does.
const LEAST_SAMPLES: u64 = 256;

/// What a sample of a pixel costs, measured, so that a picture that is watched while it is made answers in time.
#[derive(Clone, Debug, Default)]
pub struct Interactive {
    /// Seconds for a sample of a pixel at each reduction; finer pictures cost less per pixel, because every call has its own cost.
    costs: [Option<f64>; REDUCTIONS.len()],
}

impl Interactive {
    /// The least reduction of a picture of this size at which a sample of it takes no longer than `budget`.
    pub fn reduction(&self, width: u32, height: u32, budget: Duration) -> u32 {
        let fits = |level: &usize| {
            let (w, h) = reduced(width, height, REDUCTIONS[*level]);
            self.cost(*level) * f64::from(w) * f64::from(h) <= budget.as_secs_f64()
        };
        let level = (0..REDUCTIONS.len()).find(fits).unwrap_or(REDUCTIONS.len() - 1);
        REDUCTIONS[level]
    }

    /// Measured cost, or that of the nearest reduction that was.
    fn cost(&self, level: usize) -> f64 {
        let measured = (0..REDUCTIONS.len()).filter_map(|i| Some((i.abs_diff(level), self.costs[i]?)));
        measured.min_by_key(|(distance, _)| *distance).map_or(f64::INFINITY, |(_, cost)| cost)
    }

    /// Takes note that so many samples of pixels took this time.
    fn measured(&mut self, level: usize, samples: u64, time: Duration) {
        if samples < LEAST_SAMPLES {
            return;
        }
        let cost = time.as_secs_f64().max(1e-7) / samples as f64;
        let Some(before) = self.costs[level] else {
            self.costs[level] = Some(cost);
            return;
        };
        // Follow the measurement, but not its noise. Where the view has become dearer here, it has elsewhere too.
        let change = 0.5 + 0.5 * cost / before;
        self.costs.iter_mut().flatten().for_each(|c| *c *= change);
    }
}

/// Size of a picture that is coarser by a factor each way.
pub fn reduced(width: u32, height: u32, reduction: u32) -> (u32, u32) {
    (width.div_ceil(reduction).max(1), height.div_ceil(reduction).max(1))
}

/// A film that is filled bit by bit, each bit in about the time of a frame.
#[derive(Clone, Debug)]
pub struct Refinement {
    width: u32,
    height: u32,
    reduction: u32,
    goal: u32,
    /// Samples in every pixel.
    done: u32,
    /// Samples in each pixel of the pass that is under way.
    batch: u32,
    /// Rows of that pass.
    row: u32,
    /// Time it has taken.
    spent: Duration,
    /// Seconds for a sample of a pixel in the last rows: the cost of a whole pass says little about that of a few rows.
    recent: Option<f64>,
}

impl Refinement {
    /// An empty film of a picture of `width` and `height` at a reduction, for `goal` samples per pixel.
    pub fn new(width: u32, height: u32, reduction: u32, goal: u32) -> Refinement {
        let (width, height) = reduced(width, height, reduction);
        Refinement { width, height, reduction, goal, done: 0, batch: 1, row: 0, spent: Duration::ZERO, recent: None }
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Pixels of the window along one of its own.
    pub fn reduction(&self) -> u32 {
        self.reduction
    }

    /// Samples in every pixel.
    pub fn samples(&self) -> u32 {
        self.done
    }

    /// Whether no pass is under way.
    pub fn is_even(&self) -> bool {
        self.row == 0
    }

    /// Whether it has all its samples.
    pub fn is_complete(&self) -> bool {
        self.done >= self.goal
    }

    /// Renders about as much as `budget` allows, at least a row; returns the samples of pixels that this added.
    pub fn advance(&mut self, backend: &mut dyn Backend, pace: &mut Interactive, budget: Duration) -> Result<u64> {
        if self.is_complete() {
            return Ok(0);
        }
        let row_time = self.recent.unwrap_or_else(|| pace.cost(self.level())) * f64::from(self.width);
        // Nothing measured yet: a few rows tell.
        let affordable = if row_time.is_finite() { (budget.as_secs_f64() / row_time) as u32 } else { 4 };
        if self.row == 0 {
            self.batch = (affordable / self.height).clamp(1, MAX_SAMPLES_PER_CALL).min(self.goal - self.done);
        }
        let rows = (affordable / self.batch).clamp(1, self.height - self.row);
        let start = Instant::now();
        backend.accumulate(self.row..self.row + rows, self.done..self.done + self.batch)?;
        let time = start.elapsed();
        let samples = u64::from(rows) * u64::from(self.width) * u64::from(self.batch);
        self.recent = Some(time.as_secs_f64().max(1e-6) / samples as f64);
        self.spent += time;
        self.row += rows;
        if self.row == self.height {
            pace.measured(self.level(), self.pass_samples(), self.spent);
            self.done += self.batch;
            (self.row, self.spent) = (0, Duration::ZERO);
        }
        Ok(samples)
    }

    /// Takes note of a pass that will not be finished, if it has cost more already than all of it should have.
    pub fn give_up(&self, pace: &mut Interactive) {
        if self.spent.as_secs_f64() > pace.cost(self.level()) * self.pass_samples() as f64 {
            pace.measured(self.level(), self.pass_samples(), self.spent);
        }
    }

    fn level(&self) -> usize {
        REDUCTIONS.iter().position(|r| *r == self.reduction).unwrap_or(0)
    }

    /// Samples of pixels of the pass that is under way.
    fn pass_samples(&self) -> u64 {
        u64::from(self.height) * u64::from(self.width) * u64::from(self.batch)
    }
}
