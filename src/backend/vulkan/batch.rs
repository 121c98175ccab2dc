//! Batches of paths: what is recorded for them, round by round, and how many paths the next one has. They are sized by measured time, so
//! that one takes about 80 ms.

use super::{COUNTERS, Kernels, Loaded, Purpose, VulkanBackend};
use crate::backend::{Profiling, RoundCounts};
use crate::error::Result;
use crate::film::Statistics;
use crate::kernels::constants::*;
use crate::kernels::work::Work;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Time a batch should take.
const BATCH_TIME: Duration = Duration::from_millis(80);
/// Most rounds in one submission.
const MAX_ROUNDS: u32 = 64;
/// How often the film is copied to the host, so that a lost device does not lose it.
const SNAPSHOT_INTERVAL: Duration = Duration::from_secs(10);
/// The first of the words of the counter buffer that count what following rays took: six counts of two words.
const WORK: usize = 20;

/// Push constants of every kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Push {
    pub(super) stop_high: [f32; 4],
    pub(super) stop_low: [f32; 4],
    pub(super) sums: u64,
    pub(super) aovs: u64,
    pub(super) first_row: u32,
    pub(super) row_count: u32,
    pub(super) first_sample: u32,
    pub(super) slot_count: u32,
    pub(super) aov_sample: u32,
    pub(super) parity: u32,
    pub(super) stage: u32,
    pub(super) capacity: u32,
    pub(super) stop: u32,
    /// Fills the last eight bytes.
    pub(super) unused: u32,
}

/// What the counters say after a submission.
pub(super) struct Counts {
    pub(super) remaining: u32,
    statistics: Statistics,
}

impl VulkanBackend {
    /// Push constants for what is loaded, without rays.
    pub(super) fn push(&self, loaded: &Loaded) -> Push {
        Push {
            sums: loaded.film.sums.address(),
            aovs: loaded.film.aovs.address(),
            aov_sample: loaded.film.first_sample,
            capacity: self.capacity,
            ..Zeroable::zeroed()
        }
    }

    /// Renders one batch: as many rows and samples as `push` says.
    fn run_batch(&mut self, loaded: &mut Loaded, mut push: Push) -> Result<()> {
        let groups = push.slot_count.div_ceil(WORKGROUP_SIZE);
        let pixels = push.row_count * loaded.parameters.film_width;
        let mut rounds = loaded.parameters.max_depth + 1;
        let counts = self.commands.profiling() == Profiling::Counters;
        let purpose = if counts { Purpose::Counting } else { Purpose::Rendering };
        let mut first = true;
        let mut started = 0;
        loop {
            self.commands.begin()?;
            if first {
                self.commands.clear(&self.counters);
                self.commands.barrier();
                self.commands.dispatch(&self.layout, &loaded.kernels.generate, bytemuck::bytes_of(&push), groups);
                self.commands.barrier();
                self.commands.dispatch(&self.layout, &loaded.kernels.prepare, bytemuck::bytes_of(&push), 1);
                self.commands.barrier();
            }
            let recorded = started..started + rounds.clamp(1, MAX_ROUNDS);
            for round in recorded.clone() {
                push.parity = round % 2;
                self.record_round(&loaded.kernels, purpose, push, round)?;
            }
            started = recorded.end;
            // Does nothing while paths are left.
            self.commands.dispatch(&self.layout, &loaded.kernels.resolve, bytemuck::bytes_of(&push), pixels.div_ceil(WORKGROUP_SIZE));
            let counts = self.finish_submission()?;
            self.count_rounds(recorded, push.slot_count)?;
            if counts.remaining == 0 {
                loaded.film.statistics.add(counts.statistics);
                return Ok(());
            }
            first = false;
            rounds = 8;
        }
    }

    /// Records one round: flight, then shading of what it met.
    pub(super) fn record_round(&mut self, kernels: &Kernels, purpose: Purpose, mut push: Push, round: u32) -> Result<()> {
        let indirect = |word: u64| word * 4;
        let (layout, counters) = (&self.layout, &self.counters);
        self.commands.begin_round(round);
        self.commands.dispatch_indirect(layout, kernels.advance_for(purpose)?, bytemuck::bytes_of(&push), counters, indirect(0));
        self.commands.barrier();
        push.stage = 1;
        self.commands.dispatch(layout, &kernels.prepare, bytemuck::bytes_of(&push), 1);
        self.commands.barrier();
        if purpose == Purpose::Counting {
            // Put the counters aside and let those of the work begin anew.
            self.commands.copy(counters, 0, &self.readback, counters_of(round), COUNTERS * 4);
            self.commands.barrier();
            self.commands.clear_range(counters, WORK as u64 * 4, (COUNTERS - WORK as u64) * 4);
            self.commands.barrier();
        }
        if purpose != Purpose::Tracing {
            self.commands.dispatch_indirect(layout, &kernels.shade, bytemuck::bytes_of(&push), counters, indirect(4));
            self.commands.barrier();
            self.commands.dispatch_indirect(layout, &kernels.escape, bytemuck::bytes_of(&push), counters, indirect(8));
            self.commands.barrier();
        }
        push.stage = 2;
        self.commands.dispatch(layout, &kernels.prepare, bytemuck::bytes_of(&push), 1);
        self.commands.barrier();
        self.commands.end_round();
        Ok(())
    }

    /// Submits, waits, and reads the counters.
    pub(super) fn finish_submission(&mut self) -> Result<Counts> {
        self.commands.barrier();
        self.commands.copy(&self.counters, 0, &self.readback, 0, COUNTERS * 4);
        self.commands.submit()?;
        let words = self.read_counters(0)?;
        Ok(Counts {
            remaining: words[3],
            statistics: Statistics {
                exhausted: u64::from(words[14]),
                invalid: u64::from(words[15]),
                rays: u64::from(words[16]) | u64::from(words[17]) << 32,
            },
        })
    }

    /// Counters that a submission has copied to `offset` of the readback buffer.
    fn read_counters(&mut self, offset: u64) -> Result<Vec<u32>> {
        let offset = offset as usize;
        Ok(bytemuck::pod_collect_to_vec(&self.readback.mapped()?[offset..offset + COUNTERS as usize * 4]))
    }

    /// Takes the counters that `record_round` has put aside in each of `rounds`.
    fn count_rounds(&mut self, rounds: Range<u32>, slots: u32) -> Result<()> {
        if self.commands.profiling() != Profiling::Counters {
            return Ok(());
        }
        for round in rounds {
            let words = self.read_counters(counters_of(round))?;
            let [rays, hits, misses] = [3, 7, 11].map(|i| u64::from(words[i]));
            if rays > 0 {
                let work = std::array::from_fn(|i| u64::from(words[WORK + 2 * i]) | u64::from(words[WORK + 2 * i + 1]) << 32);
                let work = Work::from_counts(work);
                self.commands.count(round, &RoundCounts { slots: u64::from(slots), rays, hits, misses, work });
            }
        }
        Ok(())
    }

    /// Adds `samples` of each pixel of `rows` to the film, in batches.
    pub(super) fn accumulate_in(&mut self, loaded: &mut Loaded, rows: Range<u32>, samples: Range<u32>) -> Result<()> {
        let _span = tracing::debug_span!("accumulate", ?rows, ?samples).entered();
        if self.commands.profiling() == Profiling::Counters && loaded.kernels.counting.is_none() {
            let counting = self.advance(loaded.world.model, loaded.precision, &loaded.parameters, Purpose::Counting)?;
            loaded.kernels.counting = Some(counting);
        }
        let width = loaded.parameters.film_width;
        let mut row = rows.start;
        while row < rows.end {
            let row_count = (self.slots / width).clamp(1, rows.end - row);
            let mut sample = samples.start;
            while sample < samples.end {
                let per_pixel = (self.slots / (width * row_count)).clamp(1, samples.end - sample);
                let push = Push {
                    first_row: row,
                    row_count,
                    first_sample: sample,
                    slot_count: width * row_count * per_pixel,
                    ..self.push(loaded)
                };
                let start = Instant::now();
                self.run_batch(loaded, push)?;
                let scale = BATCH_TIME.as_secs_f64() / start.elapsed().as_secs_f64().max(1e-6);
                // A short last batch says little about a full one, unless it took too long.
                if push.slot_count > self.slots / 2 || scale < 1.0 {
                    let wanted = f64::from(push.slot_count) * scale.clamp(0.25, 2.0);
                    self.slots = (wanted as u32).clamp(width, self.capacity);
                }
                sample += per_pixel;
            }
            loaded.film.count(row..row + row_count, samples.len() as u32);
            row += row_count;
        }
        if self.takes_snapshots && loaded.snapshot_at.elapsed() > SNAPSHOT_INTERVAL {
            loaded.snapshot = Some(loaded.film.read(&mut self.commands, &mut self.readback)?);
            loaded.snapshot_at = Instant::now();
        }
        Ok(())
    }
}

/// Where the counters of a round are put aside in the readback buffer, behind those of the whole submission.
fn counters_of(round: u32) -> u64 {
    (1 + u64::from(round % MAX_ROUNDS)) * COUNTERS * 4
}
