//! The CPU backend: a wavefront over bands of pixels on a pool of threads, registers of lanes inside.

pub mod advance;
pub mod edges;
mod ended;
pub mod lanes;
mod shade;
mod solo;
pub mod step;
mod waiting;

use super::timing::{Dispatch, Profiling, Recorder, RoundCounts, Submission, Timings, now};
use super::{Backend, Canvas, Development, Precision, Prepared, RawLanding, Stop, TraceOptions, TraceRay, TraceResult, Tracer, widen};
use crate::dispatch;
use crate::error::{Error, Result};
use crate::film::{Film, PixelSum, Statistics, add_sample};
use crate::kernels::constants::*;
use crate::kernels::integrator::ModelBlock;
use crate::kernels::layout::{Aov, SceneParameters};
use crate::kernels::path::PathState;
use crate::kernels::rng::pixel_seed;
use crate::kernels::surface::Arrival;
use crate::kernels::traverser::Traverser;
use crate::kernels::view::SceneView;
use crate::kernels::work::Work;
use crate::spacetime::ModelKind;
use crate::world::{Reach, World};
use advance::{Landing, Launch, advance_curved, advance_straight};
use fearless_simd::Level;
use rayon::prelude::*;
use shade::{Batch, Pixel, start};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use step::{Course, Scalar};

/// Pixels of one unit of work: their paths fit the second-level cache.
const BATCH: usize = 1024;
/// Most rows of a batch, so that its rays stay close together.
const BATCH_ROWS: usize = 8;
/// Least pixels of a band, so that lanes are seldom without a ray.
const BAND: usize = 512;
/// Bands of each thread, so that none waits long for the last.
const BANDS_PER_THREAD: usize = 32;

/// Names of the stages whose time is reported.
struct Stages {
    generate: Arc<str>,
    advance: Arc<str>,
    shade: Arc<str>,
    resolve: Arc<str>,
}

/// Renders on the processor.
pub struct CpuBackend {
    pool: rayon::ThreadPool,
    level: Level,
    world: Option<Arc<World>>,
    /// In place of those of the world.
    parameters: SceneParameters,
    models: (ModelBlock<f32>, ModelBlock<f64>),
    precision: Precision,
    film: Film,
    stages: Stages,
    recorder: Mutex<Recorder>,
}

/// Rays that can be advanced, in both precisions.
trait Advance: Scalar {
    fn model(models: &(ModelBlock<f32>, ModelBlock<f64>)) -> &ModelBlock<Self>;
}

impl Advance for f32 {
    fn model(models: &(ModelBlock<f32>, ModelBlock<f64>)) -> &ModelBlock<f32> {
        &models.0
    }
}

impl Advance for f64 {
    fn model(models: &(ModelBlock<f32>, ModelBlock<f64>)) -> &ModelBlock<f64> {
        &models.1
    }
}

/// Traces `count` rays through whatever model the world has, with the widest registers there are.
fn advance<T: Scalar>(
    level: Level,
    course: &Course<T>,
    traverser: &mut Traverser,
    count: usize,
    launch: impl Fn(usize) -> Launch<T>,
    land: impl FnMut(usize, Landing<T>),
) {
    if course.kind == ModelKind::Flat {
        dispatch!(level, simd => advance_straight(simd, course, traverser, count, launch, land))
    } else {
        dispatch!(level, simd => advance_curved(simd, course, traverser, count, launch, land))
    }
}

impl CpuBackend {
    /// A backend on `threads` threads, or on every core.
    pub fn new(threads: Option<usize>) -> Result<CpuBackend> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .build()
            .map_err(|e| Error::Usage { argument: "--threads".into(), reason: e.to_string() })?;
        let recorder = Recorder::new("thread", pool.current_num_threads() as u32);
        Ok(CpuBackend {
            pool,
            level: Level::new(),
            world: None,
            parameters: bytemuck::Zeroable::zeroed(),
            models: Default::default(),
            precision: Precision::F32,
            film: Film::new(0, 0, 0),
            stages: Stages { generate: "generate".into(), advance: "advance".into(), shade: "shade".into(), resolve: "resolve".into() },
            recorder: Mutex::new(recorder),
        })
    }

    fn world(&self) -> Result<Arc<World>> {
        self.world.clone().ok_or_else(|| Error::World("no scene was uploaded".into()))
    }

    fn accumulate_in<T: Advance>(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()> {
        let _span = tracing::debug_span!("accumulate", ?rows, ?samples).entered();
        let start = now();
        let world = self.world()?;
        let counting = lock(&self.recorder).profiling() == Profiling::Counters;
        let width = self.film.width as usize;
        let threads = self.pool.current_num_threads();
        let band_rows = (rows.len() / (BANDS_PER_THREAD * threads)).max(BAND.div_ceil(width));
        // A few rows are shared out among all threads.
        let band_rows = band_rows.min(rows.len().div_ceil(threads)).clamp(1, BATCH_ROWS);
        let band = band_rows * width;
        let span = rows.start as usize * width..rows.end as usize * width;
        let shared = Shared {
            view: SceneView { scene: &self.parameters, ..world.view() },
            kind: world.model,
            model: T::model(&self.models),
            level: self.level,
            width,
            first_sample: self.film.first_sample,
            samples,
            stages: &self.stages,
            counting,
            recorder: &self.recorder,
        };
        let film = &mut self.film;
        let (sums, counts, aovs) = (&mut film.sums[span.clone()], &mut film.counts[span.clone()], &mut film.aovs[span]);
        let statistics: Statistics = self.pool.install(|| {
            sums.par_chunks_mut(band)
                .zip(counts.par_chunks_mut(band))
                .zip(aovs.par_chunks_mut(band))
                .enumerate()
                .map(|(i, ((sums, counts), aovs))| shared.render_band(rows.start + (i * band_rows) as u32, sums, counts, aovs))
                .reduce(Statistics::default, |mut a, b| {
                    a.add(b);
                    a
                })
        });
        self.film.statistics.add(statistics);
        let time = now() - start;
        lock(&self.recorder).submission(Submission { start, submit: 0, wait: time, span: time });
        Ok(())
    }

    fn trace_in<T: Advance>(&mut self, rays: &[TraceRay], options: TraceOptions, reach: Reach) -> Result<Vec<TraceResult>> {
        let world = self.world()?;
        let origins: Vec<[f64; 3]> = rays.iter().map(|r| r.origin).collect();
        let scene: SceneParameters = world.trace_parameters(&origins, reach, options);
        let kind = world.traced_model(options.stop);
        let course = Course { view: world.view(), scene: &scene, model: T::model(&self.models), kind, stop: options.stop, drift: false };
        let (level, tracer) = (self.level, Tracer::new(&world));
        let trace_chunk = |rays: &[TraceRay]| {
            let prepared: Vec<Prepared> = rays.iter().map(|r| tracer.prepare(r)).collect();
            let mut results: Vec<Option<TraceResult>> = vec![None; rays.len()];
            let launch = |i: usize| {
                let p = &prepared[i];
                Launch {
                    origin: p.origin.map(T::from_f64),
                    direction: p.direction.map(T::from_f64),
                    speed: T::from_f64(p.speed),
                    sense: T::from_f64(p.sense),
                    side: p.side,
                    width: 1.0,
                    spread: 0.0,
                }
            };
            let mut traverser = Traverser::new();
            advance(level, &course, &mut traverser, rays.len(), launch, |i, landing| {
                let raw = RawLanding {
                    status: landing.arrival.status,
                    primitive: landing.arrival.primitive,
                    position: widen(landing.position),
                    direction: widen(landing.direction),
                    momentum: widen(landing.momentum),
                    length: landing.length.to_f64(),
                    parameter: landing.parameter.to_f64(),
                    side: landing.arrival.side,
                    steps: landing.arrival.steps,
                    chords: landing.arrival.chords,
                };
                results[i] = Some(tracer.result(&prepared[i], &raw));
            });
            results.into_iter().flatten().collect::<Vec<_>>()
        };
        Ok(self.pool.install(|| rays.par_chunks(BATCH).flat_map_iter(trace_chunk).collect()))
    }
}

/// What the workers of one call share.
struct Shared<'a, T> {
    view: SceneView<'a>,
    kind: ModelKind,
    model: &'a ModelBlock<T>,
    level: Level,
    width: usize,
    first_sample: u32,
    samples: Range<u32>,
    stages: &'a Stages,
    /// Whether what each bounce takes is wanted.
    counting: bool,
    recorder: &'a Mutex<Recorder>,
}

/// Scratch space of a worker.
struct Scratch {
    paths: Vec<PathState>,
    arrivals: Vec<Option<Arrival>>,
    traverser: Traverser,
}

impl<T: Advance> Shared<'_, T> {
    /// Renders all samples of one band of rows.
    fn render_band(&self, first_row: u32, sums: &mut [PixelSum], counts: &mut [u32], aovs: &mut [Aov]) -> Statistics {
        let mut statistics = Statistics::default();
        let rows = sums.len() / self.width;
        let columns = (BATCH / rows).max(1);
        let mut scratch = Scratch { paths: Vec::with_capacity(BATCH), arrivals: Vec::with_capacity(BATCH), traverser: Traverser::new() };
        for first in (0..self.width).step_by(columns) {
            let columns = columns.min(self.width - first);
            let pixels: Vec<Pixel> = (0..rows * columns)
                .map(|i| {
                    let (x, y) = ((first + i % columns) as u32, first_row + (i / columns) as u32);
                    Pixel { x, y, seed: pixel_seed(x, y) }
                })
                .collect();
            for sample in self.samples.clone() {
                self.render_batch(&pixels, sample, &mut scratch, &mut statistics, |i, radiance, aov| {
                    let at = (i / columns) * self.width + first + i % columns;
                    if let Some(aov) = aov {
                        aovs[at] = aov;
                    }
                    counts[at] += 1;
                    add_sample(&mut sums[at], radiance)
                });
            }
        }
        statistics
    }

    /// Renders one sample of each pixel and hands the radiance to `resolve`.
    fn render_batch(
        &self,
        pixels: &[Pixel],
        sample: u32,
        scratch: &mut Scratch,
        statistics: &mut Statistics,
        mut resolve: impl FnMut(usize, [f32; 3], Option<Aov>) -> bool,
    ) {
        let view = &self.view;
        let mut course = Course {
            view: *view,
            scene: view.scene,
            model: self.model,
            kind: self.kind,
            stop: Stop::Never,
            drift: sample == self.first_sample,
        };
        let stages = self.stages;
        let mut clock = StageClock::new();
        scratch.paths.clear();
        dispatch!(self.level, simd => start(simd, view, pixels, sample, &mut scratch.paths));
        clock.lap(&stages.generate, None);
        let mut bounce = 0;
        let mut active: Vec<u32> = (0..pixels.len() as u32).collect();
        let mut first_aovs: Vec<Option<Aov>> = Vec::new();
        let wants_aovs = sample == self.first_sample;
        while !active.is_empty() {
            statistics.rays += active.len() as u64;
            scratch.arrivals.clear();
            scratch.arrivals.resize(active.len(), None);
            let (paths, arrivals) = (&scratch.paths, &mut scratch.arrivals);
            let launch = |i: usize| {
                let path = &paths[active[i] as usize];
                let convert = |v: glam::Vec3| v.to_array().map(|c| T::from_f64(f64::from(c)));
                Launch {
                    origin: convert(path.origin),
                    direction: convert(path.direction),
                    speed: T::from_f64(1.0),
                    sense: T::from_f64(-1.0),
                    side: path.side,
                    width: path.width,
                    spread: path.spread,
                }
            };
            advance(self.level, &course, &mut scratch.traverser, active.len(), launch, |i, landing| {
                arrivals[i] = Some(landing.arrival);
            });
            course.drift = false;
            clock.lap(&stages.advance, Some(bounce));
            let work = std::mem::take(&mut scratch.traverser.work);
            if self.counting {
                self.count(bounce, pixels.len(), &scratch.arrivals, work);
            }
            let Scratch { paths, arrivals, .. } = scratch;
            let aovs = wants_aovs.then_some(&mut first_aovs);
            let mut batch = Batch { view, pixels, sample, paths, aovs };
            dispatch!(self.level, simd => batch.shade(simd, arrivals, &mut active, statistics));
            clock.lap(&stages.shade, Some(bounce));
            bounce += 1;
        }
        for (i, path) in scratch.paths.iter().enumerate() {
            let aov = first_aovs.get(i).copied().flatten();
            if !resolve(i, path.radiance.into(), aov) {
                statistics.invalid += 1;
            }
        }
        clock.lap(&stages.resolve, None);
        let mut recorder = lock(self.recorder);
        clock.laps.into_iter().for_each(|lap| recorder.dispatch(lap));
    }

    /// Records what a bounce of a batch of paths took.
    fn count(&self, bounce: u32, slots: usize, arrivals: &[Option<Arrival>], work: Work) {
        let hits = arrivals.iter().flatten().filter(|a| a.status == STATUS_HIT).count() as u64;
        let rays = arrivals.len() as u64;
        lock(self.recorder).count(bounce, &RoundCounts { slots: slots as u64, rays, hits, misses: rays - hits, work });
    }
}

/// The recorder, whatever became of a thread that held it.
fn lock(recorder: &Mutex<Recorder>) -> MutexGuard<'_, Recorder> {
    recorder.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Measures consecutive stages of a batch.
struct StageClock {
    worker: usize,
    last: u64,
    laps: Vec<Dispatch>,
}

impl StageClock {
    fn new() -> Self {
        StageClock { worker: rayon::current_thread_index().unwrap_or(0), last: now(), laps: Vec::with_capacity(32) }
    }

    /// Ends a stage; the next one begins.
    fn lap(&mut self, stage: &Arc<str>, round: Option<u32>) {
        let end = now();
        self.laps.push(Dispatch { kernel: stage.clone(), round, worker: self.worker, start: self.last, duration: end - self.last });
        self.last = end;
    }
}

impl Backend for CpuBackend {
    fn name(&self) -> String {
        format!("cpu, {} threads, {}", self.pool.current_num_threads(), level_name(self.level))
    }

    fn upload(&mut self, world: Arc<World>, precision: Precision, first_sample: u32) -> Result<()> {
        self.film = Film::new(world.scene.film_width, world.scene.film_height, first_sample);
        self.models = (world.model_block(), world.model_block());
        self.precision = precision;
        self.parameters = world.scene;
        self.world = Some(world);
        Ok(())
    }

    fn set_parameters(&mut self, parameters: &SceneParameters) -> Result<()> {
        self.world()?;
        self.parameters = *parameters;
        self.film.restart(parameters.film_width, parameters.film_height);
        Ok(())
    }

    fn accumulate(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()> {
        match self.precision {
            Precision::F32 => self.accumulate_in::<f32>(rows, samples),
            Precision::F64 => self.accumulate_in::<f64>(rows, samples),
        }
    }

    fn film(&mut self) -> Result<Film> {
        Ok(self.film.clone())
    }

    fn develop(&mut self, development: &Development, canvas: &mut Canvas) -> Result<()> {
        canvas.expect_size(self.film.width, self.film.height)?;
        let pixels = canvas.pixels_mut()?;
        self.pool.install(|| self.film.develop(development, pixels));
        Ok(())
    }

    fn trace(&mut self, rays: &[TraceRay], options: TraceOptions) -> Result<Vec<TraceResult>> {
        match self.precision {
            Precision::F32 => self.trace_in::<f32>(rays, options, Reach::Picture),
            Precision::F64 => self.trace_in::<f64>(rays, options, Reach::Exact),
        }
    }

    fn set_profiling(&mut self, profiling: Profiling) {
        lock(&self.recorder).set_profiling(profiling);
    }

    fn timings(&mut self) -> Timings {
        lock(&self.recorder).take()
    }
}

/// Instruction set in words.
fn level_name(level: Level) -> &'static str {
    dispatch!(level, simd => std::any::type_name_of_val(&simd)).rsplit("::").next().unwrap_or("scalar")
}
