//! What the render thread does: keeps lanes up to the newest request, refines, develops, publishes.

use super::canvases::Canvases;
use super::lane::Lane;
use super::model::FrameInfo;
use super::pick::pick;
use super::worker::{Frame, Inbox, Job, Report, Request, Shared, Start};
use crate::backend::{Backend, Canvas, Development, KernelTiming, Precision};
use crate::error::Result;
use crate::film::{Film, Statistics, write_exr, write_pixels};
use crate::scene::{Assets, Scene, Spacetime, parse_scene_with};
use crate::scheduler::Refinement;
use crate::world::World;
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
/// Pixels of a film that is looked through for what its rays cost.
const CENSUS_PIXELS: u64 = 1 << 18;

/// Lanes by the kind of light.
const BENT: usize = 0;
const STRAIGHT: usize = 1;

/// The last scene that could be rendered.
struct Loaded {
    number: u64,
    /// The scene with bent light and with straight.
    scenes: [Scene; 2],
    /// Their worlds, compiled when they are first asked for.
    worlds: [Option<Arc<World>>; 2],
}

impl Loaded {
    fn new(number: u64, scene: Scene, world: World) -> Loaded {
        let straight = Scene { spacetime: Spacetime::flat(), ..scene.clone() };
        Loaded { number, scenes: [scene, straight], worlds: [Some(Arc::new(world)), None] }
    }

    fn world(&mut self, light: usize) -> Result<Arc<World>> {
        if let Some(world) = &self.worlds[light] {
            return Ok(world.clone());
        }
        let world = Arc::new(compile(&self.scenes[light])?);
        self.worlds[light] = Some(world.clone());
        Ok(world)
    }
}

/// A scene compiled for backends that start with a film of a single pixel: the window's comes later.
pub(super) fn compile(scene: &Scene) -> Result<World> {
    let mut world = World::compile(scene)?;
    (world.scene.film_width, world.scene.film_height) = (1, 1);
    Ok(world)
}

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
    loaded: Loaded,
    lanes: [Option<Lane>; 2],
    /// A backend that no lane has yet.
    spare: Option<Box<dyn Backend>>,
    request: Option<Request>,
    jobs: Vec<Job>,
    /// Lanes that are shown, from left to right.
    shown: Vec<usize>,
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
            loaded: Loaded::new(0, start.scene, start.world),
            lanes: [None, None],
            spare: Some(start.backend),
            request: None,
            jobs: vec![],
            shown: vec![],
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
                Some(request) => self.adopt(request).and_then(|()| self.work()),
                None if self.trouble.is_none() => self.work(),
                None => Ok(()),
            };
            if let Err(e) = outcome {
                self.trouble = Some(e.to_string());
            }
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
        let reloaded = self.load(&request);
        let same_view = before.is_some_and(|b| {
            (b.eye, b.size, b.bending, b.split.is_some()) == (request.eye, request.size, request.bending, request.split.is_some())
        });
        // A film without a sample has nothing to be developed from.
        if self.trouble.take().is_some() || reloaded || !same_view || self.samples() == 0 {
            return self.restart(&request);
        }
        self.is_dirty = true;
        Ok(())
    }

    /// Reads the scene of a request if it is another; says whether there is a new one to render.
    fn load(&mut self, request: &Request) -> bool {
        let source = &request.source;
        if source.number == self.loaded.number {
            return false;
        }
        let read = parse_scene_with(&source.path, &source.text, &[], &mut self.assets).and_then(|scene| {
            // The camera is where the window has it, not where the file does.
            let mut seen = scene.clone();
            request.eye.apply(&mut seen.camera);
            let world = compile(&seen)?;
            Ok((scene, seen, world))
        });
        match read {
            Ok((scene, seen, world)) => {
                self.loaded = Loaded::new(source.number, seen, world);
                self.scene_trouble = None;
                self.census = None;
                self.report(Report::Loaded(source.number, Box::new(scene)));
                true
            }
            Err(e) => {
                self.scene_trouble = Some(e.to_string());
                false
            }
        }
    }

    /// Starts films of another view, coarse enough to answer in time.
    fn restart(&mut self, request: &Request) -> Result<()> {
        self.shown.clear();
        self.changed_at = Instant::now();
        let wanted: &[usize] = match (request.split, request.bending) {
            (Some(_), _) => &[STRAIGHT, BENT],
            (None, true) => &[BENT],
            (None, false) => &[STRAIGHT],
        };
        let budget = self.budget / wanted.len() as u32;
        let mut reduction = 1;
        for &light in wanted {
            let lane = self.lane(light)?;
            reduction = reduction.max(lane.reduction(request.size, budget));
        }
        self.shown.extend(wanted);
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
        for lane in shown(&mut self.lanes, &self.shown) {
            lane.start(&request.eye, request.size, reduction)?;
        }
        (self.added, self.is_new, self.is_dirty) = (0, true, false);
        Ok(())
    }

    /// Renders a slice, and shows what is due.
    fn work(&mut self) -> Result<()> {
        let Some(request) = self.request.clone() else { return Ok(()) };
        if self.is_coarse() && !self.is_new && self.changed_at.elapsed() >= SETTLE {
            self.take_census()?;
            let reduction = self.finer(request.size);
            self.start(&request, reduction)?;
        }
        if !self.is_coarse() || self.is_new {
            self.advance()?;
        }
        if self.census.is_none() && !self.is_coarse() && self.is_even() && self.samples() > 0 {
            self.take_census()?;
        }
        if self.is_due() {
            self.publish(&request)?;
        }
        self.do_jobs(&request)
    }

    fn advance(&mut self) -> Result<()> {
        let budget = self.budget / self.shown.len().max(1) as u32;
        let start = Instant::now();
        for lane in shown(&mut self.lanes, &self.shown) {
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
        let (lanes, order) = (&mut self.lanes, &self.shown);
        let canvas = self.canvases.painted(size, |canvas| develop(lanes, order, request, canvas))?;
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
        for lane in shown(&mut self.lanes, &self.shown) {
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
        let lanes = self.shown.iter().filter_map(|&light| self.lanes[light].as_ref());
        let quick = lanes.map(|lane| lane.reduction(size, FIRST_PICTURE)).max().unwrap_or(1);
        let present = self.films().map(Refinement::reduction).max().unwrap_or(1);
        quick.min(present / 2).max(1)
    }

    /// Looks through the film for what its rays cost: through a small one after every change, through a large one once.
    fn take_census(&mut self) -> Result<()> {
        let is_small = self.film_size().is_some_and(|(w, h)| u64::from(w) * u64::from(h) <= CENSUS_PIXELS);
        // The lane on the right is the bent one.
        let lane = lane_of(&mut self.lanes, self.shown.last());
        if let Some(lane) = lane.filter(|_| is_small || self.census.is_none()) {
            self.census = Some(Census::of(&lane.backend().film()?));
        }
        Ok(())
    }

    /// Does what can be done by now.
    fn do_jobs(&mut self, request: &Request) -> Result<()> {
        let is_full = !self.is_coarse() && self.samples() > 0 && self.is_even();
        for job in std::mem::take(&mut self.jobs) {
            match job {
                Job::Pick(x, y) => self.pick(request, (x, y))?,
                Job::Screenshot(path) if is_full => {
                    let outcome = self.screenshot(request, &path);
                    self.report(Report::Saved(path, outcome));
                }
                Job::Film(path) if is_full => {
                    let outcome = self.save_film(&path);
                    self.report(Report::Saved(path, outcome));
                }
                later => self.jobs.push(later),
            }
        }
        Ok(())
    }

    fn pick(&mut self, request: &Request, pixel: (u32, u32)) -> Result<()> {
        let is_left = request.split.is_some_and(|split| (f64::from(pixel.0) + 0.5) < split * f64::from(request.size.0));
        let lane = lane_of(&mut self.lanes, if is_left { self.shown.first() } else { self.shown.last() });
        if let Some(lane) = lane
            && let Some(picked) = pick(lane, pixel, request.size)?
        {
            self.report(Report::Picked(Box::new(picked)));
        }
        Ok(())
    }

    fn screenshot(&mut self, request: &Request, path: &Path) -> Result<()> {
        let Some(size) = self.film_size() else { return Ok(()) };
        let (lanes, order) = (&mut self.lanes, &self.shown);
        let pixels = self.canvases.pixels(size, |canvas| develop(lanes, order, request, canvas))?;
        write_pixels(path, size.0, size.1, &pixels)
    }

    fn save_film(&mut self, path: &Path) -> Result<()> {
        let Some(lane) = lane_of(&mut self.lanes, self.shown.last()) else { return Ok(()) };
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

    fn films(&self) -> impl Iterator<Item = &Refinement> {
        self.shown.iter().filter_map(move |&light| self.lanes[light].as_ref()).map(Lane::film)
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

/// The lane of a kind of light.
fn lane_of<'a>(lanes: &'a mut [Option<Lane>; 2], light: Option<&usize>) -> Option<&'a mut Lane> {
    lanes[*light?].as_mut()
}

/// The lanes that are shown, from left to right.
fn shown<'a>(lanes: &'a mut [Option<Lane>; 2], order: &[usize]) -> impl Iterator<Item = &'a mut Lane> {
    // Straight light is on the left.
    let wanted = [BENT, STRAIGHT].map(|light| order.contains(&light));
    lanes.iter_mut().zip(wanted).rev().filter(|(_, wanted)| *wanted).filter_map(|(lane, _)| lane.as_mut())
}

/// Develops every lane that is shown into its part of a canvas.
fn develop(lanes: &mut [Option<Lane>; 2], order: &[usize], request: &Request, canvas: &mut Canvas) -> Result<()> {
    let width = canvas.width();
    let border = request.split.map_or(0, |split| (split.clamp(0.0, 1.0) * f64::from(width)).round() as u32);
    let count = order.len();
    for (i, lane) in shown(lanes, order).enumerate() {
        let columns = match (count, i) {
            (1, _) => 0..width,
            (_, 0) => 0..border,
            _ => border..width,
        };
        lane.develop(&Development { columns, ..request.development.clone() }, canvas)?;
    }
    Ok(())
}
