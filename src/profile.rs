//! Where the time of a frame goes: passes of one sample per pixel timed dispatch by dispatch, and what the kernels did in one of them.
//!
//! Counting slows the kernels down, so it has a pass of its own. A sample is a pure function of its index: the pass that counts
//! does again exactly what the first timed one did. Knows only the [`Backend`] trait.

use crate::backend::timing::now;
use crate::backend::{Backend, Profiling, RoundCounts, Timings};
use crate::error::Result;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Fewest and most passes that warm up: kernels are compiled when they first run, and the size of batches is found by trying.
const WARM_UP: (u32, u32) = (2, 8);
/// From this share of the time of the pass before on, a pass has nothing left to warm up.
const SETTLED: f64 = 0.9;
/// With so many dispatches no other pass begins: about 200 MB.
const MAX_DISPATCHES: usize = 1 << 22;

/// One sample of every pixel.
#[derive(Clone, Debug)]
pub struct Pass {
    /// Index of the sample.
    pub sample: u32,
    /// When it began, on the clock of [`now`].
    pub start: u64,
    /// How long it took, in nanoseconds.
    pub wall: u64,
    /// What the backend measured meanwhile.
    pub timings: Timings,
}

/// What was measured of a scene on a backend.
#[derive(Clone, Debug)]
pub struct Profile {
    /// The backend.
    pub backend: String,
    /// Passes before the first that was timed.
    pub warm_up: u32,
    /// The timed passes.
    pub passes: Vec<Pass>,
    /// What the kernels did in each round of the first timed pass.
    pub rounds: Vec<RoundCounts>,
}

/// How durations are spread, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// How many there are.
    pub count: usize,
    /// The shortest.
    pub min: u64,
    /// The one in the middle.
    pub median: u64,
    /// The one that 95% do not exceed.
    pub p95: u64,
    /// The longest.
    pub max: u64,
    /// All together.
    pub total: u64,
}

impl Spread {
    /// Statistics of durations; all zero without any.
    pub fn of(mut durations: Vec<u64>) -> Spread {
        durations.sort_unstable();
        let rank = |share: f64| {
            let place = (share * durations.len() as f64).ceil() as usize;
            durations.get(place.saturating_sub(1)).copied().unwrap_or(0)
        };
        Spread { count: durations.len(), min: rank(0.0), median: rank(0.5), p95: rank(0.95), max: rank(1.0), total: durations.iter().sum() }
    }
}

/// What one kernel takes, in one round or in all.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the kernel or stage.
    pub kernel: Arc<str>,
    /// The round; none for all rounds, or for what comes before and after them.
    pub round: Option<u32>,
    /// Durations of its dispatches in all timed passes.
    pub spread: Spread,
    /// Share of the wall time of the timed passes.
    pub share: f64,
    /// What it works on, per frame: paths of `generate` and `resolve`, rays of `advance`, ends of rays of `shade` and `escape`.
    pub items: Option<u64>,
    /// Items per second of its own time.
    pub items_per_second: Option<f64>,
    /// Integration steps per second of its own time.
    pub steps_per_second: Option<f64>,
}

/// Where the wall time of the timed passes went, in nanoseconds; workers side by side count once. All but `wait` add up to `wall`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balance {
    /// Wall time.
    pub wall: f64,
    /// Running kernels.
    pub kernels: f64,
    /// Inside submissions between kernels: barriers and copies on a device, threads with nothing left to do on the CPU.
    pub between: f64,
    /// Waiting before the first kernel of a submission and after the last one, and for submissions that only copy.
    pub latency: f64,
    /// Recording and submitting.
    pub submit: f64,
    /// The rest: reading counters, and what the backend does between submissions.
    pub outside: f64,
    /// The host's waiting for submissions, which kernels, gaps and latency share.
    pub wait: f64,
}

impl Balance {
    /// The parts that add up to the wall time.
    pub fn parts(&self) -> [(&'static str, f64); 5] {
        [
            ("kernels", self.kernels),
            ("between_dispatches", self.between),
            ("submission_latency", self.latency),
            ("host_submit", self.submit),
            ("outside", self.outside),
        ]
    }
}

impl Profile {
    /// Measures the world that was uploaded last, with 0 as its first sample, in so many timed passes, or fewer if these have
    /// very many dispatches.
    pub fn measure(backend: &mut dyn Backend, height: u32, frames: u32) -> Result<Profile> {
        let outcome = measure_passes(backend, height, frames);
        backend.set_profiling(Profiling::Off);
        outcome
    }

    /// Workers that ran side by side.
    pub fn workers(&self) -> u32 {
        self.passes.first().map_or(1, |p| p.timings.workers.max(1))
    }

    /// Every kernel in every round.
    pub fn rows(&self) -> Vec<Row> {
        self.grouped(true)
    }

    /// Every kernel in all rounds, the longest first.
    pub fn kernels(&self) -> Vec<Row> {
        let mut rows = self.grouped(false);
        rows.sort_by_key(|row| std::cmp::Reverse(row.spread.total));
        rows
    }

    /// How long the timed passes took.
    pub fn frame(&self) -> Spread {
        Spread::of(self.passes.iter().map(|p| p.wall).collect())
    }

    /// What the kernels did in all rounds together.
    pub fn counts(&self) -> RoundCounts {
        self.rounds.iter().fold(RoundCounts::default(), |mut sum, round| {
            sum.add(round);
            sum
        })
    }

    /// What could not be timed or was not kept, by name.
    pub fn lost(&self) -> BTreeMap<&str, u64> {
        let mut lost = BTreeMap::new();
        for (name, count) in self.passes.iter().flat_map(|p| &p.timings.lost) {
            *lost.entry(name.as_str()).or_default() += count;
        }
        lost
    }

    /// Where the wall time went.
    pub fn balance(&self) -> Balance {
        let mut balance = Balance::default();
        let mut spans = 0.0;
        for pass in &self.passes {
            balance.wall += pass.wall as f64;
            balance.kernels += pass.timings.dispatches.iter().map(|d| d.duration as f64).sum::<f64>() / f64::from(self.workers());
            for submission in &pass.timings.submissions {
                let (submit, wait, span) = (submission.submit, submission.wait, submission.span);
                spans += span as f64;
                balance.wait += wait as f64;
                balance.latency += wait.saturating_sub(span) as f64;
                // What the device does while the host is still submitting is not counted twice.
                balance.submit += submit.saturating_sub(span.saturating_sub(wait)) as f64;
            }
        }
        balance.between = spans - balance.kernels;
        balance.outside = balance.wall - spans - balance.latency - balance.submit;
        balance
    }

    fn grouped(&self, by_round: bool) -> Vec<Row> {
        let mut groups: BTreeMap<(Arc<str>, Option<u32>), Vec<u64>> = BTreeMap::new();
        for dispatch in self.passes.iter().flat_map(|p| &p.timings.dispatches) {
            let round = dispatch.round.filter(|_| by_round);
            groups.entry((dispatch.kernel.clone(), round)).or_default().push(dispatch.duration);
        }
        let escapes = groups.keys().any(|(kernel, _)| &**kernel == "escape");
        let workers = f64::from(self.workers());
        let wall = self.frame().total as f64;
        let rows = groups.into_iter().map(|((kernel, round), durations)| {
            let spread = Spread::of(durations);
            let time = spread.total as f64 / workers;
            let rounds: &[RoundCounts] = match round {
                Some(round) => self.rounds.get(round as usize..=round as usize).unwrap_or_default(),
                None => &self.rounds,
            };
            let per_second = self.passes.len() as f64 / time * 1e9;
            let rate = |count: u64| Some(count as f64 * per_second).filter(|r| r.is_finite());
            let items = self.items(&kernel, rounds, escapes);
            let steps: u64 = if kernel.starts_with("advance") { rounds.iter().map(|r| r.work.steps).sum() } else { 0 };
            Row {
                round,
                spread,
                share: time / wall.max(1.0),
                items,
                items_per_second: items.and_then(rate),
                steps_per_second: Some(steps).filter(|s| *s > 0).and_then(rate),
                kernel,
            }
        });
        rows.collect()
    }

    /// What a kernel works on in some rounds of a frame. Where no kernel is there for escaped rays, `shade` sees every end of a ray.
    fn items(&self, kernel: &str, rounds: &[RoundCounts], escapes: bool) -> Option<u64> {
        let of_round: fn(&RoundCounts) -> u64 = match kernel.split('_').next() {
            Some("generate" | "resolve") => return self.rounds.first().map(|r| r.slots),
            Some("advance") => |r: &RoundCounts| r.rays,
            Some("shade") if escapes => |r: &RoundCounts| r.hits,
            Some("shade") => |r: &RoundCounts| r.hits + r.misses,
            Some("escape") => |r: &RoundCounts| r.misses,
            _ => return None,
        };
        Some(rounds.iter().map(of_round).sum())
    }
}

fn measure_passes(backend: &mut dyn Backend, height: u32, frames: u32) -> Result<Profile> {
    backend.set_profiling(Profiling::Times);
    let mut warm_up = 0;
    let mut before = f64::INFINITY;
    loop {
        let wall = pass(backend, height, warm_up)?.wall as f64;
        warm_up += 1;
        if warm_up == WARM_UP.1 || (warm_up >= WARM_UP.0 && wall > SETTLED * before) {
            break;
        }
        before = wall;
    }
    let mut passes: Vec<Pass> = Vec::new();
    let mut dispatches = 0;
    while passes.len() < frames as usize && dispatches < MAX_DISPATCHES {
        let pass = pass(backend, height, warm_up + passes.len() as u32)?;
        dispatches += pass.timings.dispatches.len();
        passes.push(pass);
    }
    backend.set_profiling(Profiling::Counters);
    let rounds = pass(backend, height, warm_up)?.timings.rounds;
    Ok(Profile { backend: backend.name(), warm_up, passes, rounds })
}

/// Renders one sample of every pixel.
fn pass(backend: &mut dyn Backend, height: u32, sample: u32) -> Result<Pass> {
    backend.timings();
    let start = now();
    backend.accumulate(0..height, sample..sample + 1)?;
    let wall = now() - start;
    Ok(Pass { sample, start, wall, timings: backend.timings() })
}
