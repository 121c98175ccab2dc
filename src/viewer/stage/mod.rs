//! The window with everything in it: what happens there goes to the subject, the panels or the render thread, and their answers are
//! shown. Nothing in here waits for rendering.

mod hands;
mod pictures;

use crate::backend::Backend;
use crate::backend::cpu::CpuBackend;
use crate::backend::vulkan::VulkanBackend;
use crate::backend::vulkan::presenter::Presenter;
use crate::error::{Error, Result};
use crate::viewer::app::{Opening, Wake};
use crate::viewer::canvases::Canvases;
use crate::viewer::document::Document;
use crate::viewer::history::History;
use crate::viewer::input::{Drag, Flight, Latency};
use crate::viewer::model::{Action, Pick};
use crate::viewer::panels::PanelState;
use crate::viewer::subject::Subject;
use crate::viewer::worker::{Frame, Job, Report, Request, Start, Worker};
use crate::viewer::{RenderOn, Summary, ViewOptions};
use egui::ViewportId;
use glam::DVec2;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tracing::debug;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::ModifiersState;
use winit::window::Window;

/// Time a picture may take while things move: on a graphics processor, and elsewhere.
const BUDGETS: [Duration; 2] = [Duration::from_millis(16), Duration::from_millis(60)];
/// How often the scene file is looked at.
const POLL: Duration = Duration::from_millis(500);
/// How often a flight moves on.
const FLIGHT: Duration = Duration::from_millis(8);
/// How long messages stay.
const MESSAGE: Duration = Duration::from_secs(4);

/// The window with everything in it.
pub(super) struct Stage {
    worker: Worker,
    subject: Subject,
    panels: PanelState,
    shows_panels: bool,
    shows_help: bool,
    /// The newest picture, and whether it has not been shown.
    frame: Option<Frame>,
    is_new: bool,
    frame_at: Instant,
    history: History,
    latency: Latency,
    pick: Option<Box<Pick>>,
    /// What the render thread cannot do.
    trouble: Option<String>,
    message: Option<(String, Instant)>,
    flight: Flight,
    drag: Option<Drag>,
    cursor: DVec2,
    modifiers: ModifiersState,
    /// Number of the last request, whether it is out of date, and the first input since.
    revision: u64,
    is_stale: bool,
    input_at: Option<Instant>,
    /// The last request, and the number of the first one of the same view.
    sent: Option<Request>,
    viewed_since: u64,
    next_poll: Instant,
    next_redraw: Option<Instant>,
    /// Frames that were presented, of how many, and what is written then.
    presented: u64,
    frames: Option<u64>,
    screenshot: Option<PathBuf>,
    is_leaving: bool,
    is_done: bool,
    size: (u32, u32),
    device: String,
    egui: egui_winit::State,
    presenter: Presenter,
    window: Arc<Window>,
}

impl Stage {
    /// Opens the window and starts rendering.
    pub fn open(event_loop: &ActiveEventLoop, options: &ViewOptions, opening: Opening, proxy: EventLoopProxy<Wake>) -> Result<Stage> {
        let Opening { document, scene, world, assets } = opening;
        let attributes = Window::default_attributes()
            .with_title(title(&document.name().display().to_string()))
            .with_inner_size(window_size(event_loop, scene.film.width, scene.film.height));
        let window = Arc::new(event_loop.create_window(attributes).map_err(|e| Error::Window(e.to_string()))?);
        let presenter = Presenter::new(window.clone(), options.device.as_deref())?;
        let device = presenter.device().clone();
        let is_software = device.report.is_software();
        let on_device = match options.render_on {
            RenderOn::Auto => !is_software || options.device.is_some(),
            RenderOn::Vulkan => true,
            RenderOn::Cpu => false,
        };
        let (shared_device, threads) = (device.clone(), options.threads);
        let open = move || -> Result<Box<dyn Backend>> {
            if on_device { Ok(Box::new(VulkanBackend::on_device(shared_device.clone())?)) } else { Ok(Box::new(CpuBackend::new(threads)?)) }
        };
        let worker = Worker::start(Start {
            scene: scene.clone(),
            world,
            assets,
            backend: open()?,
            open: Box::new(open),
            precision: options.precision,
            canvases: Canvases::new(device.clone(), !on_device),
            budget: BUDGETS[usize::from(is_software || !on_device)],
            wake: Box::new(move || {
                // A window that is gone has nothing to be told.
                let _ = proxy.send_event(Wake);
            }),
        })?;
        let context = egui::Context::default();
        let scale = window.scale_factor() as f32;
        let egui = egui_winit::State::new(context, ViewportId::ROOT, &*window, Some(scale), window.theme(), None);
        let size = window.inner_size();
        let subject = Subject::new(document, scene, !options.linear);
        Ok(Stage {
            worker,
            subject,
            panels: PanelState::default(),
            shows_panels: true,
            shows_help: false,
            frame: None,
            is_new: false,
            frame_at: Instant::now(),
            history: History::default(),
            latency: Latency::default(),
            pick: None,
            trouble: None,
            message: None,
            flight: Flight::default(),
            drag: None,
            cursor: DVec2::ZERO,
            modifiers: ModifiersState::empty(),
            revision: 0,
            is_stale: true,
            input_at: None,
            sent: None,
            viewed_since: 0,
            next_poll: Instant::now() + POLL,
            next_redraw: None,
            presented: 0,
            frames: options.frames,
            screenshot: options.screenshot.clone(),
            is_leaving: false,
            is_done: false,
            size: (size.width, size.height),
            device: device.report.name.clone(),
            egui,
            presenter,
            window,
        })
    }

    /// What came of it.
    pub fn summary(&self) -> Summary {
        let info = self.frame.as_ref().map(|f| &f.info);
        Summary {
            frames: self.presented,
            samples: info.map_or(0, |i| i.samples),
            answers: self.latency.count(),
            latency_ms: self.latency.median().zip(self.latency.max()),
            backend: info.map_or_else(String::new, |i| i.backend.clone()),
            size: self.size,
        }
    }

    /// Takes what the render thread has put out.
    pub fn collect(&mut self) -> Result<()> {
        let (frame, reports) = self.worker.collect();
        if let Some(frame) = frame {
            self.history.push(self.frame_at.elapsed(), &frame.info.timings);
            self.frame_at = Instant::now();
            self.frame = Some(frame);
            self.is_new = true;
        }
        for report in reports {
            match report {
                Report::Loaded(number, scene) => {
                    debug!(number, "scene reloaded");
                    self.is_stale |= self.subject.loaded(number, *scene);
                }
                Report::Trouble(trouble) => {
                    if let Some(reason) = &trouble {
                        debug!(reason, "scene failed");
                        // Nobody is there to see it.
                        if self.frames.is_some() {
                            return Err(Error::CheckFailed(reason.clone()));
                        }
                    }
                    self.trouble = trouble;
                }
                Report::Opened(document, Ok(())) => {
                    self.window.set_title(&title(&document.name().display().to_string()));
                    self.subject.open(*document);
                    self.is_stale = true;
                }
                Report::Opened(_, Err(e)) => self.say(format!("Not opened: {e}")),
                // What was seen in another view is no longer there.
                Report::Picked(revision, _) if revision < self.viewed_since => {}
                Report::Picked(_, Err(e)) => self.say(format!("Not followed: {e}")),
                Report::Picked(_, Ok(pick)) => {
                    debug!(pixel = ?pick.pixel, object = pick.object_name, material = pick.material, "pixel picked");
                    self.pick = Some(pick);
                }
                Report::Saved(path, Ok(())) => {
                    debug!(path = %path.display(), "file written");
                    self.is_done |= self.is_leaving;
                    self.say(format!("Saved {}", path.display()));
                }
                Report::Saved(_, Err(e)) if self.is_leaving => return Err(e),
                Report::Saved(_, Err(e)) => self.say(format!("Not saved: {e}")),
            }
        }
        self.window.request_redraw();
        Ok(())
    }

    /// Does what is due before the next event.
    pub fn tick(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        if !self.worker.is_alive() {
            return Err(Error::Window("the render thread has ended".into()));
        }
        let now = Instant::now();
        if self.flight.is_on() {
            self.fly();
        }
        if now >= self.next_poll {
            self.next_poll = now + POLL;
            if self.subject.reload_if_changed() {
                if let Some(reason) = self.subject.trouble() {
                    debug!(reason, "scene failed");
                }
                self.is_stale = true;
                self.window.request_redraw();
            }
        }
        if self.message.as_ref().is_some_and(|(_, until)| now >= *until) {
            self.message = None;
            self.window.request_redraw();
        }
        if self.next_redraw.is_some_and(|at| now >= at) {
            self.next_redraw = None;
            self.window.request_redraw();
        }
        self.send_request();
        let flight = self.flight.is_on().then_some(now + FLIGHT);
        let times = [Some(self.next_poll), self.next_redraw, self.message.as_ref().map(|(_, until)| *until), flight];
        event_loop.set_control_flow(ControlFlow::WaitUntil(times.into_iter().flatten().min().unwrap_or(self.next_poll)));
        if self.is_done {
            event_loop.exit();
        }
        Ok(())
    }

    /// Takes an event of the window.
    pub fn window_event(&mut self, event: &WindowEvent) -> Result<()> {
        match event {
            WindowEvent::RedrawRequested => return self.redraw(),
            WindowEvent::CloseRequested => self.is_done = true,
            WindowEvent::Resized(size) => {
                self.size = (size.width, size.height);
                self.presenter.resize(size.width, size.height);
                self.is_stale = true;
                self.window.request_redraw();
            }
            WindowEvent::ModifiersChanged(modifiers) => self.modifiers = modifiers.state(),
            WindowEvent::Focused(false) => {
                self.flight.land();
                self.drag = None;
            }
            WindowEvent::DroppedFile(path) => match Document::open(Some(path), &[]) {
                Ok(document) => self.worker.ask(Job::Open(Box::new(document))),
                Err(e) => self.say(format!("Not opened: {e}")),
            },
            WindowEvent::KeyboardInput { event: key, .. } if key.state == ElementState::Released => self.flight.release(key.physical_key),
            // Presses made up for keys that were down when the window got the focus are none.
            WindowEvent::KeyboardInput { event: key, is_synthetic: false, .. } => {
                let context = self.egui.egui_ctx();
                let is_for_panels = self.shows_overlay() && (context.text_edit_focused() || context.any_popup_open());
                if !is_for_panels && self.key(key) {
                    return Ok(());
                }
            }
            _ => {}
        }
        let response = self.egui.on_window_event(&self.window, event);
        let is_shown = self.shows_overlay();
        if !is_shown {
            // Nobody would ever take them.
            self.egui.egui_input_mut().events.clear();
        } else if response.repaint {
            self.window.request_redraw();
        }
        self.mouse(event, response.consumed && is_shown);
        Ok(())
    }

    /// Whether egui has anything to draw.
    fn shows_overlay(&self) -> bool {
        self.shows_panels || self.shows_help || self.error().is_some() || self.message.is_some()
    }

    fn error(&self) -> Option<&str> {
        self.subject.trouble().or(self.trouble.as_deref())
    }

    fn say(&mut self, text: String) {
        self.message = Some((text, Instant::now() + MESSAGE));
        self.window.request_redraw();
    }

    fn show_panels(&mut self, show: bool) {
        self.shows_panels = show;
        debug!("panels {}", if show { "shown" } else { "hidden" });
        self.window.request_redraw();
    }

    /// Does what panels and keys ask for.
    fn act(&mut self, actions: Vec<Action>) {
        if actions.is_empty() {
            return;
        }
        let (was_bending, was_split) = (self.subject.bending(), self.subject.split().is_some());
        let count = actions.len();
        let others = self.subject.apply(actions);
        self.is_stale |= others.len() < count;
        let (bending, split) = (self.subject.bending(), self.subject.split().is_some());
        if bending != was_bending {
            debug!(bending, "bending toggled");
        }
        if split != was_split {
            debug!(split, "split toggled");
        }
        for action in others {
            match action {
                Action::Screenshot => self.worker.ask(Job::Screenshot(self.numbered("png"))),
                Action::SaveFilm => self.worker.ask(Job::Film(self.numbered("exr"))),
                Action::SaveScene => self.save_scene(),
                Action::Help(show) => self.shows_help = show,
                Action::HidePanels => self.show_panels(false),
                Action::ClearPick => self.pick = None,
                // The subject takes all others.
                _ => {}
            }
        }
        self.window.request_redraw();
    }

    fn save_scene(&mut self) {
        let new = self.numbered("toml");
        match self.subject.save(|| new) {
            Ok(path) => {
                debug!(path = %path.display(), "file written");
                self.window.set_title(&title(&path.display().to_string()));
                self.say(format!("Saved {}", path.display()));
            }
            Err(e) => self.say(format!("Not saved: {e}")),
        }
    }

    /// A file here that does not exist, named after the scene.
    fn numbered(&self, extension: &str) -> PathBuf {
        let name = self.subject.document().name();
        let stem = name.file_stem().map_or_else(|| "nullray".into(), |s| s.to_string_lossy());
        let mut number = 1;
        loop {
            let path = PathBuf::from(format!("{stem}-{number:04}.{extension}"));
            if !path.exists() {
                return path;
            }
            number += 1;
        }
    }
}

fn title(scene: &str) -> String {
    format!("nullray: {scene}")
}

/// The film's size, or what of it fits the screen, in its shape.
fn window_size(event_loop: &ActiveEventLoop, width: u32, height: u32) -> PhysicalSize<u32> {
    let monitor = event_loop.primary_monitor().or_else(|| event_loop.available_monitors().next());
    let screen = monitor.map(|m| m.size()).filter(|s| s.width > 0 && s.height > 0);
    let share = |screen: u32, film: u32| f64::from(screen) / f64::from(film);
    let scale = screen.map_or(1.0, |s| share(s.width, width).min(share(s.height, height)).min(1.0));
    let scaled = |film: u32| ((f64::from(film) * scale).round() as u32).max(1);
    PhysicalSize::new(scaled(width), scaled(height))
}
