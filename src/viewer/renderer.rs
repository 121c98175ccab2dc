//! What the render thread does: keeps lanes up to the newest request, refines, develops, publishes.

use super::canvases::Canvases;
use super::lane::Lane;
use super::loaded::{BENT, Loaded, STRAIGHT, compile};
use super::model::FrameInfo;
use super::pick::pick;
use super::worker::{Frame, Inbox, Job, Report, Request, Shared, Start};
use crate::backend::{Backend, Canvas, Development, KernelTiming, Precision};
use crate::error::Result;
use crate::film::{Film, Statistics, write_exr, write_pixels};
use crate::scene::{Assets, Scene, parse_scene_with};
use crate::scheduler::Refinement;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Quiet time after which finer pictures are begun.
const SETTLE: Duration = Duration::from_millis(150);
/// Least time between pictures that only gained samples.
const INTERVAL: Duration = Duration::from_millis(33);
/// Time after which a picture is shown although a pass is under way.
const PATIENCE: Duration = Duration::from_millis(250);
/// Time that the first picture of a still view may take: where all of it takes longer, finer ones lead up to it.
const FIRST_PICTURE: Duration = Duration::from_millis(500);
/// Longest that news waits for the first picture of another view.
const ENDURANCE: Duration = Duration::from_secs(2);
/// Pixels of a film that is looked through for what its rays cost.
const CENSUS_PIXELS: u64 = 1 << 18;

/// What a small film of the view tells about its rays.
#[derive(Clone, Copy, Debug, Default)]
struct Census {
    /// Rays per camera ray.
    rays: f64,
    /// Steps of a camera ray.
    steps: f64,
    statistics: Statistics,
}

impl Census {
    fn of(film: &Film) -> Census {
        let pixels = film.aovs.len().max(1) as f64;
        let camera_rays = film.counts.iter().map(|&c| f64::from(c)).sum::<f64>().max(1.0);
        Census {
            rays: film.statistics.rays as f64 / camera_rays,
            steps: film.aovs.iter().map(|a| f64::from(a.steps)).sum::<f64>() / pixels,
            statistics: film.statistics,
        }
    }
}

/// The render thread.
pub(super) struct Renderer {
    shared: Arc<Shared>,
    wake: Box<dyn Fn() + Send>,
    open: Box<dyn Fn() -> Result<Box<dyn Backend>> + Send>,
    precision: Precision,
    budget: Duration,
    canvases: Canvases,
    assets: Assets,
    /// The last scene that could be rendered.
    loaded: Loaded,
    /// Number of the newest text that was read, and its scene if that waits for a camera that can see it.
    read: (u64, Option<Scene>),
    /// From left to right, and which of them are shown.
    lanes: [Option<Lane>; 2],
    shown: [bool; 2],
    /// A backend that no lane has yet.
    spare: Option<Box<dyn Backend>>,
    request: Option<Request>,
    jobs: Vec<Job>,
    /// Why there is nothing to render.
    trouble: Option<String>,
    /// Why the newest scene cannot be.
    scene_trouble: Option<String>,
    /// What the window was told of both.
    told: Option<String>,
    changed_at: Instant,
    published_at: Instant,
    /// Samples of pixels since the last picture; whether that is another view, or is to be developed anew.
    added: u64,
    is_new: bool,
    is_dirty: bool,
    census: Option<Census>,
    /// Samples of pixels and the time they took since the rate was last taken.
    work: (u64, Duration),
    /// Samples of pixels per second.
    rate: f64,
}

impl Renderer {
    /// A thread that has not begun.
    pub fn new(start: Start, shared: Arc<Shared>) -> Renderer {
        Renderer {
            shared,
            wake: start.wake,
            open: start.open,
            precision: start.precision,
            budget: start.budget,
            canvases: start.canvases,
            assets: start.assets,
            loaded: Loaded::new(start.scene, start.world),
            read: (0, None),
            lanes: [None, None],
            shown: [false; 2],
            spare: Some(start.backend),
            request: None,
            jobs: vec![],
            trouble: None,
            scene_trouble: None,
            told: None,
            changed_at: Instant::now(),
            published_at: Instant::now(),
            added: 0,
            is_new: false,
            is_dirty: false,
            census: None,
            work: (0, Duration::ZERO),
            rate: 0.0,
        }
    }

    /// Works until it is time to quit.
    pub fn run(mut self) {
        while let Some(Inbox { request, jobs, .. }) = self.shared.take(self.rest()) {
            self.jobs.extend(jobs);
            let outcome = match request {
                Some(request) => self.adopt(request).and_then(|()| self.answer()).and_then(|()| self.work()),
                None if self.trouble.is_none() => self.work(),
                None => Ok(()),
            };
            if let Err(e) = outcome {
                self.trouble = Some(e.to_string());
            }
            self.do_jobs();
            self.tell_trouble();
        }
    }

    /// Until when there is nothing to do; `None` is until something comes in.
    fn rest(&self) -> Option<Instant> {
        let now = Some(Instant::now());
        if self.request.is_none() || self.trouble.is_some() {
            return None;
        }
        let waits_for_more = self.is_coarse() && !self.is_new && !self.is_dirty;
        if waits_for_more {
            return Some(self.changed_at + SETTLE);
        }
        let is_done = self.films_complete() && self.added == 0 && !self.is_new && !self.is_dirty && self.jobs.is_empty();
        if is_done { None } else { now }
    }

    /// Takes a request over the last one.
    fn adopt(&mut self, request: Request) -> Result<()> {
        let before = self.request.replace(request.clone());
        let was_stuck = self.trouble.take().is_some();
        if let Some((scene, loaded)) = self.read(&request) {
            let last = std::mem::replace(&mut self.loaded, loaded);
            let Err(e) = self.restart(&request) else {
                self.scene_trouble = None;
                self.census = None;
                self.report(Report::Loaded(request.source.number, Box::new(scene)));
                return Ok(());
            };
            self.scene_trouble = Some(e.to_string());
            self.loaded = last;
            return self.restart(&request);
        }
        // A film without a sample has nothing to be developed from.
        if was_stuck || self.samples() == 0 || !before.is_some_and(|b| b.same_view(&request)) {
            return self.restart(&request);
        }
        self.is_dirty = true;
        Ok(())
    }

    /// The scene of a request, as its text has it and ready to be rendered, if it is another one that can be.
    fn read(&mut self, request: &Request) -> Option<(Scene, Loaded)> {
        let source = &request.source;
        if source.number != self.read.0 {
            let parsed = parse_scene_with(&source.path, &source.text, &[], &mut self.assets);
            self.scene_trouble = parsed.as_ref().err().map(ToString::to_string);
            self.read = (source.number, parsed.ok());
        }
        let scene = self.read.1.take()?;
        // The camera is where the window has it, not where the file does.
        let mut seen = scene.clone();
        request.eye.apply(&mut seen.camera);
        match compile(&seen) {
            Ok(world) => Some((scene, Loaded::new(seen, world))),
            Err(e) => {
                self.scene_trouble = Some(e.to_string());
                // It may be the camera's place that does not do.
                self.read.1 = Some(scene);
                None
            }
        }
    }

    /// Starts films of another view, coarse enough to answer in time.
    fn restart(&mut self, request: &Request) -> Result<()> {
        self.shown = [false; 2];
        self.changed_at = Instant::now();
        let is_split = request.split.is_some();
        let wanted = [is_split || !request.bending, is_split || request.bending];
        let budget = self.budget / count(wanted);
        let mut reduction = 1;
        for light in [STRAIGHT, BENT].into_iter().filter(|&light| wanted[light]) {
            let lane = self.lane(light)?;
            reduction = reduction.max(lane.reduction(request.size, budget));
        }
        self.shown = wanted;
        self.start(request, reduction)
    }

    /// The lane of a kind of light, with the scene loaded.
    fn lane(&mut self, light: usize) -> Result<&mut Lane> {
        let world = self.loaded.world(light)?;
        let lane = match self.lanes[light].take() {
            Some(lane) => lane,
            None => {
                let backend = self.spare.take().map_or_else(&self.open, Ok)?;
                Lane::new(backend, self.precision)
            }
        };
        let lane = self.lanes[light].insert(lane);
        lane.load(&self.loaded.scenes[light], &world)?;
        Ok(lane)
    }

    /// Starts the films of all lanes that are shown.
    fn start(&mut self, request: &Request, reduction: u32) -> Result<()> {
        for lane in shown(&mut self.lanes, self.shown) {
            lane.start(&request.eye, request.size, reduction)?;
        }
        (self.added, self.is_new, self.is_dirty) = (0, true, false);
        Ok(())
    }

    /// Renders the first picture of another view before anything else is looked at: what keeps moving would never be seen.
    fn answer(&mut self) -> Result<()> {
        let start = Instant::now();
        while self.samples() == 0 && start.elapsed() < ENDURANCE && !self.shared.is_quitting() {
            self.advance()?;
        }
        Ok(())
    }

    /// Renders a slice, and shows what is due.
    fn work(&mut self) -> Result<()> {
        let Some(request) = self.request.clone() else { return Ok(()) };
        if self.is_coarse() && !self.is_new && !self.is_dirty && self.changed_at.elapsed() >= SETTLE {
            self.take_census()?;
            let reduction = self.finer(request.size);
            self.start(&request, reduction)?;
        }
        // What waits to be shown is, before more is added to it; coarse pictures get a single sample.
        if self.samples() == 0 || !(self.is_coarse() || self.is_new || self.is_dirty) {
            self.advance()?;
        }
        if self.census.is_none() && !self.is_coarse() && self.is_even() && self.samples() > 0 {
            self.take_census()?;
        }
        if self.is_due() {
            self.publish(&request)?;
        }
        Ok(())
    }

    /// Renders a slice of each film, but lets none go ahead.
    fn advance(&mut self) -> Result<()> {
        let (budget, least) = (self.budget / count(self.shown).max(1), self.samples());
        let start = Instant::now();
        for lane in shown(&mut self.lanes, self.shown).filter(|lane| lane.film().samples() == least) {
            let samples = lane.advance(budget)?;
            self.added += samples;
            self.work.0 += samples;
        }
        self.work.1 += start.elapsed();
        Ok(())
    }

    /// Whether a picture is to be shown now.
    fn is_due(&self) -> bool {
        if self.samples() == 0 {
            return false;
        }
        let age = self.published_at.elapsed();
        let is_whole = self.is_even() && (age >= INTERVAL || self.films_complete());
        self.is_new || self.is_dirty || (self.added > 0 && (is_whole || age >= PATIENCE))
    }

    fn publish(&mut self, request: &Request) -> Result<()> {
        let Some(size) = self.film_size() else { return Ok(()) };
        let lanes = &mut self.lanes;
        let canvas = self.canvases.painted(size, |canvas| develop(lanes, request, canvas))?;
        let info = self.info(request, size);
        self.published_at = Instant::now();
        (self.added, self.is_new, self.is_dirty) = (0, false, false);
        let frame = Frame { canvas, info };
        if self.shared.put(|out| out.frame = Some(frame)) {
            (self.wake)();
        }
        Ok(())
    }

    fn info(&mut self, request: &Request, size: (u32, u32)) -> FrameInfo {
        let mut timings: Vec<KernelTiming> = vec![];
        let mut backend = String::new();
        for lane in shown(&mut self.lanes, self.shown) {
            backend = lane.backend().name();
            for timing in lane.backend().timings().totals() {
                match timings.iter_mut().find(|t| t.kernel == timing.kernel) {
                    Some(sum) => (sum.count, sum.time) = (sum.count + timing.count, sum.time + timing.time),
                    None => timings.push(timing.clone()),
                }
            }
        }
        if self.work.1 > INTERVAL {
            let now = self.work.0 as f64 / self.work.1.as_secs_f64();
            self.rate = if self.rate > 0.0 { 0.5 * (self.rate + now) } else { now };
            self.work = (0, Duration::ZERO);
        }
        let census = self.census.unwrap_or_default();
        FrameInfo {
            revision: request.revision,
            size,
            scale: self.films().next().map_or(1, |f| f.reduction()),
            samples: self.samples(),
            goal: self.loaded.scenes[BENT].film.samples,
            rays_per_second: self.rate * census.rays,
            steps_per_second: self.rate * census.steps,
            timings,
            statistics: census.statistics,
            backend,
        }
    }

    /// The next reduction of a still view: at most half the present one, less if that is quick enough.
    fn finer(&self, size: (u32, u32)) -> u32 {
        let quick = self.shown_lanes().map(|lane| lane.reduction(size, FIRST_PICTURE)).max().unwrap_or(1);
        let present = self.films().map(Refinement::reduction).max().unwrap_or(1);
        quick.min(present / 2).max(1)
    }

    /// Looks through the film for what its rays cost: through a small one after every change, through a large one once.
    fn take_census(&mut self) -> Result<()> {
        let is_small = self.film_size().is_some_and(|(w, h)| u64::from(w) * u64::from(h) <= CENSUS_PIXELS);
        let lane = shown(&mut self.lanes, self.shown).next_back();
        if let Some(lane) = lane.filter(|_| is_small || self.census.is_none()) {
            self.census = Some(Census::of(&lane.backend().film()?));
        }
        Ok(())
    }

    /// Does what can be done by now.
    fn do_jobs(&mut self) {
        let Some(request) = self.request.as_ref().filter(|_| !self.jobs.is_empty()).cloned() else { return };
        let is_full = self.trouble.is_none() && !self.is_coarse() && self.samples() > 0 && self.is_even();
        for job in std::mem::take(&mut self.jobs) {
            match job {
                Job::Open(document) => {
                    let outcome = document.to_scene(&mut self.assets).map(drop);
                    self.report(Report::Opened(document, outcome));
                }
                Job::Pick(x, y) => self.pick(&request, (x, y)),
                Job::Screenshot(path) if is_full => {
                    let outcome = self.screenshot(&request, &path);
                    self.report(Report::Saved(path, outcome));
                }
                Job::Film(path) if is_full => {
                    let outcome = self.save_film(&path);
                    self.report(Report::Saved(path, outcome));
                }
                later => self.jobs.push(later),
            }
        }
    }

    fn pick(&mut self, request: &Request, pixel: (u32, u32)) {
        let is_left = request.split.is_some_and(|split| (f64::from(pixel.0) + 0.5) < split * f64::from(request.size.0));
        let mut lanes = shown(&mut self.lanes, self.shown);
        let Some(lane) = (if is_left { lanes.next() } else { lanes.next_back() }) else { return };
        let shared = &self.shared;
        let outcome = pick(lane, pixel, request.size, || !shared.has_news());
        drop(lanes);
        if let Some(picked) = outcome.transpose() {
            self.report(Report::Picked(request.revision, picked.map(Box::new)));
        }
    }

    fn screenshot(&mut self, request: &Request, path: &Path) -> Result<()> {
        let Some(size) = self.film_size() else { return Ok(()) };
        let lanes = &mut self.lanes;
        let pixels = self.canvases.pixels(size, |canvas| develop(lanes, request, canvas))?;
        write_pixels(path, size.0, size.1, &pixels)
    }

    fn save_film(&mut self, path: &Path) -> Result<()> {
        let Some(lane) = shown(&mut self.lanes, self.shown).next_back() else { return Ok(()) };
        let film = lane.backend().film()?;
        let mut metadata = vec![("version", env!("CARGO_PKG_VERSION").to_owned()), ("backend", lane.backend().name())];
        if let Some((_, scene, _)) = lane.parts() {
            metadata.extend([
                ("scene", scene.path.display().to_string()),
                ("camera", format!("{:?}", scene.camera)),
                ("film", format!("{:?}", scene.film)),
                ("spacetime", format!("{:?}", scene.spacetime)),
                ("integrator", format!("{:?}", scene.integrator)),
                ("environment", format!("{:?}", scene.environment)),
            ]);
        }
        let latin = |text: String| -> String { text.chars().filter(char::is_ascii).collect() };
        let metadata: Vec<(String, String)> = metadata.into_iter().map(|(key, text)| (key.to_owned(), latin(text))).collect();
        write_exr(path, &film, &metadata)
    }

    fn report(&self, report: Report) {
        if self.shared.put(|out| out.reports.push(report)) {
            (self.wake)();
        }
    }

    fn tell_trouble(&mut self) {
        let now = self.scene_trouble.clone().or_else(|| self.trouble.clone());
        if now != self.told {
            self.told.clone_from(&now);
            self.report(Report::Trouble(now));
        }
    }

    fn shown_lanes(&self) -> impl Iterator<Item = &Lane> {
        self.lanes.iter().zip(self.shown).filter(|(_, is_shown)| *is_shown).filter_map(|(lane, _)| lane.as_ref())
    }

    fn films(&self) -> impl Iterator<Item = &Refinement> {
        self.shown_lanes().map(Lane::film)
    }

    /// Samples in every pixel of every film.
    fn samples(&self) -> u32 {
        self.films().map(|f| f.samples()).min().unwrap_or(0)
    }

    fn film_size(&self) -> Option<(u32, u32)> {
        self.films().next().map(|f| f.size())
    }

    fn is_coarse(&self) -> bool {
        self.films().any(|f| f.reduction() > 1)
    }

    fn is_even(&self) -> bool {
        self.films().all(|f| f.is_even())
    }

    fn films_complete(&self) -> bool {
        self.films().all(|f| f.is_complete())
    }
}

fn count(lights: [bool; 2]) -> u32 {
    lights.into_iter().map(u32::from).sum()
}

/// The lanes that are shown, from left to right.
fn shown(lanes: &mut [Option<Lane>; 2], is_shown: [bool; 2]) -> impl DoubleEndedIterator<Item = &mut Lane> {
    lanes.iter_mut().zip(is_shown).filter(|(_, is_shown)| *is_shown).filter_map(|(lane, _)| lane.as_mut())
}

/// Develops every lane that is shown into its part of a canvas.
fn develop(lanes: &mut [Option<Lane>; 2], request: &Request, canvas: &mut Canvas) -> Result<()> {
    let width = canvas.width();
    let border = match (request.split, request.bending) {
        (Some(split), _) => (split.clamp(0.0, 1.0) * f64::from(width)).round() as u32,
        (None, true) => 0,
        (None, false) => width,
    };
    for (lane, columns) in lanes.iter_mut().zip([0..border, border..width]) {
        if let Some(lane) = lane.as_mut().filter(|_| !columns.is_empty()) {
            lane.develop(&Development { columns, ..request.development.clone() }, canvas)?;
        }
    }
    Ok(())
}
