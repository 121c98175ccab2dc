//! What a backend measures of its own work: how long every dispatch and submission took, and what the kernels did.

use crate::kernels::work::Work;
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// Most dispatches, and most submissions, that are kept until somebody takes them.
const MAX_RECORDS: usize = 1 << 18;

/// Nanoseconds since this was first asked: the clock of all records.
pub fn now() -> u64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_nanos() as u64
}

/// How much a backend measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profiling {
    /// The total time of every kernel.
    #[default]
    Off,
    /// Also every dispatch and submission on its own.
    Times,
    /// Also what the kernels did, which slows them down.
    Counters,
}

/// How long one kernel ran since timings were last taken.
#[derive(Clone, Debug, PartialEq)]
pub struct KernelTiming {
    /// Name of the kernel or stage.
    pub kernel: String,
    /// Dispatches.
    pub count: u64,
    /// Total time.
    pub time: Duration,
}

/// One run of a kernel on a device, or of a stage over a batch of paths on a thread.
#[derive(Clone, Debug, PartialEq)]
pub struct Dispatch {
    /// Name of the kernel or stage.
    pub kernel: Arc<str>,
    /// Round of its batch; none for what comes before and after the rounds.
    pub round: Option<u32>,
    /// Which worker ran it: 0 for a device's queue, else the number of the thread.
    pub worker: usize,
    /// When it started, on the clock of [`now`]. A device's own clock gives the distances within a submission, whose last dispatch is
    /// taken to end when the host saw the end.
    pub start: u64,
    /// How long it ran, in nanoseconds.
    pub duration: u64,
}

/// Work handed to a device, or to the threads, and waited for. All times in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submission {
    /// When the host began to record it, on the clock of [`now`].
    pub start: u64,
    /// How long the host recorded and submitted.
    pub submit: u64,
    /// How long it then waited for the end.
    pub wait: u64,
    /// From the start of the first dispatch to the end of the last one; 0 without dispatches.
    pub span: u64,
}

/// What the kernels did in one round, summed over the batches that still had rays in it.
///
/// On the CPU a round is a bounce. On Vulkan a ray that is not at its end after 64 pieces of its way goes on in the next round, so
/// that late pieces of long rays share a round with the next bounces of others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RoundCounts {
    /// Paths of those batches, whether they go on or are over.
    pub slots: u64,
    /// Rays that were followed: those that started, and those still under way.
    pub rays: u64,
    /// Rays that ended on a surface.
    pub hits: u64,
    /// Rays that ended elsewhere: escaped, captured or out of steps.
    pub misses: u64,
    /// What following them took.
    pub work: Work,
}

impl RoundCounts {
    /// Adds the counts of other batches or rounds.
    pub fn add(&mut self, other: &RoundCounts) {
        self.slots += other.slots;
        self.rays += other.rays;
        self.hits += other.hits;
        self.misses += other.misses;
        self.work.add(&other.work);
    }

    /// Share of the paths that had a ray to follow: what compaction saves.
    pub fn occupancy(&self) -> f64 {
        self.rays as f64 / self.slots.max(1) as f64
    }
}

/// What a backend measured since timings were last taken.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    /// What runs the dispatches: `queue` or `thread`.
    pub worker: &'static str,
    /// How many of them there are.
    pub workers: u32,
    /// Every dispatch, if that was asked for.
    pub dispatches: Vec<Dispatch>,
    /// Every submission, if that was asked for.
    pub submissions: Vec<Submission>,
    /// What the kernels did in each round, if that was asked for.
    pub rounds: Vec<RoundCounts>,
    /// Dispatches and submissions that should be in the lists and are not, because there were too many, by name.
    pub lost: BTreeMap<String, u64>,
    totals: Vec<KernelTiming>,
}

impl Timings {
    /// Dispatches and time of every kernel, exact whatever was asked for; the time of several threads is divided among them.
    pub fn totals(&self) -> &[KernelTiming] {
        &self.totals
    }
}

/// Where a backend writes what it measures.
pub(super) struct Recorder {
    profiling: Profiling,
    timings: Timings,
}

impl Recorder {
    /// A recorder for so many workers.
    pub(super) fn new(worker: &'static str, workers: u32) -> Recorder {
        Recorder { profiling: Profiling::Off, timings: Timings { worker, workers, ..Timings::default() } }
    }

    /// How much is to be measured.
    pub(super) fn profiling(&self) -> Profiling {
        self.profiling
    }

    /// Sets how much is to be measured from now on.
    pub(super) fn set_profiling(&mut self, profiling: Profiling) {
        self.profiling = profiling;
    }

    /// Adds a dispatch.
    pub(super) fn dispatch(&mut self, dispatch: Dispatch) {
        let totals = &mut self.timings.totals;
        let at = totals.iter().position(|t| *t.kernel == *dispatch.kernel).unwrap_or_else(|| {
            totals.push(KernelTiming { kernel: dispatch.kernel.to_string(), count: 0, time: Duration::ZERO });
            totals.len() - 1
        });
        totals[at].count += 1;
        totals[at].time += Duration::from_nanos(dispatch.duration);
        if self.profiling == Profiling::Off {
            return;
        }
        if self.timings.dispatches.len() < MAX_RECORDS {
            self.timings.dispatches.push(dispatch);
        } else {
            self.lose(&dispatch.kernel);
        }
    }

    /// Adds a submission.
    pub(super) fn submission(&mut self, submission: Submission) {
        if self.profiling == Profiling::Off {
            return;
        }
        if self.timings.submissions.len() < MAX_RECORDS {
            self.timings.submissions.push(submission);
        } else {
            self.lose("submission");
        }
    }

    /// Adds what the kernels did in a round of a batch.
    pub(super) fn count(&mut self, round: u32, counts: &RoundCounts) {
        let rounds = &mut self.timings.rounds;
        rounds.resize(rounds.len().max(round as usize + 1), RoundCounts::default());
        rounds[round as usize].add(counts);
    }

    /// Notes that something is missing from the lists.
    pub(super) fn lose(&mut self, name: &str) {
        *self.timings.lost.entry(name.to_owned()).or_default() += 1;
    }

    /// Everything since the last call.
    pub(super) fn take(&mut self) -> Timings {
        let Timings { worker, workers, .. } = self.timings;
        let mut taken = std::mem::replace(&mut self.timings, Timings { worker, workers, ..Timings::default() });
        for total in &mut taken.totals {
            total.time /= workers.max(1);
        }
        taken
    }
}
