//! The render thread: takes the newest request, renders it in slices, and hands pictures to the window.
//!
//! After every change a coarse picture is shown that the budget allows; once nothing has changed for a moment, finer ones are begun, up
//! to the full one. A slice is about as long as the budget, so a new request is never far from being looked at; only the first picture
//! of a view is finished before.

use super::canvases::Canvases;
use super::document::Document;
use super::model::{FrameInfo, Pick};
use super::navigation::Eye;
use super::renderer::Renderer;
use crate::backend::{Backend, Canvas, Development, Precision};
use crate::error::{Error, Result};
use crate::scene::{Assets, Scene};
use crate::world::World;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The text of a scene.
#[derive(Clone, Debug)]
pub struct Source {
    /// Counts its changes, from 0 for the scene that the thread starts with.
    pub number: u64,
    /// What its files are relative to, and what errors name.
    pub path: PathBuf,
    /// The text.
    pub text: Arc<str>,
}

/// What is to be shown.
#[derive(Clone, Debug)]
pub struct Request {
    /// Counts requests.
    pub revision: u64,
    /// The scene.
    pub source: Source,
    /// The camera, in place of the scene's.
    pub eye: Eye,
    /// Pixels of the window across and down.
    pub size: (u32, u32),
    /// How the film is developed; of its columns nothing is asked.
    pub development: Development,
    /// Whether light bends.
    pub bending: bool,
    /// Where straight light ends, as a share of the width.
    pub split: Option<f64>,
}

impl Request {
    /// Whether films of the other request serve this one, if both are of the same scene.
    pub fn same_view(&self, other: &Request) -> bool {
        let view = |r: &Request| (r.eye, r.size, r.bending, r.split.is_some());
        view(self) == view(other)
    }
}

/// What is to be done once.
#[derive(Clone, Debug)]
pub enum Job {
    /// Find out whether a document describes a scene.
    Open(Box<Document>),
    /// Follow the ray of a pixel of the window.
    Pick(u32, u32),
    /// Write the picture, as shown and in full resolution, to a PNG.
    Screenshot(PathBuf),
    /// Write the film to an EXR.
    Film(PathBuf),
}

/// What happened.
#[derive(Debug)]
pub enum Report {
    /// The text with this number was read.
    Loaded(u64, Box<Scene>),
    /// What is wrong now, or that nothing is any more.
    Trouble(Option<String>),
    /// Whether the document describes a scene.
    Opened(Box<Document>, Result<()>),
    /// A ray of the request with this number was followed.
    Picked(u64, Result<Box<Pick>>),
    /// A file was to be written.
    Saved(PathBuf, Result<()>),
}

/// A picture.
pub struct Frame {
    /// Its pixels.
    pub canvas: Arc<Canvas>,
    /// What is known about it.
    pub info: FrameInfo,
}

/// What the render thread starts with.
pub struct Start {
    /// The scene, with number 0.
    pub scene: Scene,
    /// The same, compiled for bent light.
    pub world: World,
    /// Files it names.
    pub assets: Assets,
    /// The first backend, ...
    pub backend: Box<dyn Backend>,
    /// ... and what opens another.
    pub open: Box<dyn Fn() -> Result<Box<dyn Backend>> + Send>,
    /// Precision of curves.
    pub precision: Precision,
    /// Canvases of the window.
    pub canvases: Canvases,
    /// Time that a picture may take while things move.
    pub budget: Duration,
    /// Tells the window that there is something to collect.
    pub wake: Box<dyn Fn() + Send>,
}

/// What came in and was not looked at.
#[derive(Default)]
pub(super) struct Inbox {
    pub request: Option<Request>,
    pub jobs: Vec<Job>,
    quit: bool,
}

/// What goes out and was not collected.
#[derive(Default)]
pub(super) struct Outbox {
    pub frame: Option<Frame>,
    pub reports: Vec<Report>,
}

/// What both threads reach.
#[derive(Default)]
pub(super) struct Shared {
    inbox: Mutex<Inbox>,
    news: Condvar,
    outbox: Mutex<Outbox>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// What came in, or nothing at `until`; `None` when it is time to quit. Waits for ever without a time.
    pub fn take(&self, until: Option<Instant>) -> Option<Inbox> {
        let mut inbox = lock(&self.inbox);
        while inbox.request.is_none() && inbox.jobs.is_empty() && !inbox.quit {
            let left = until.map(|t| t.saturating_duration_since(Instant::now()));
            inbox = match left {
                None => self.news.wait(inbox).unwrap_or_else(PoisonError::into_inner),
                Some(left) if left.is_zero() => break,
                Some(left) => self.news.wait_timeout(inbox, left).unwrap_or_else(PoisonError::into_inner).0,
            };
        }
        let taken = std::mem::take(&mut *inbox);
        inbox.quit = taken.quit;
        if taken.quit { None } else { Some(taken) }
    }

    /// Whether something came in that was not looked at.
    pub fn has_news(&self) -> bool {
        let inbox = lock(&self.inbox);
        inbox.request.is_some() || !inbox.jobs.is_empty() || inbox.quit
    }

    /// Whether it is time to quit.
    pub fn is_quitting(&self) -> bool {
        lock(&self.inbox).quit
    }

    /// Puts something out; says whether there was nothing before.
    pub fn put(&self, put: impl FnOnce(&mut Outbox)) -> bool {
        let mut outbox = lock(&self.outbox);
        let was_empty = outbox.frame.is_none() && outbox.reports.is_empty();
        put(&mut outbox);
        was_empty
    }
}

/// The render thread, as the window sees it. Dropping it ends the thread.
pub struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread.
    pub fn start(start: Start) -> Result<Worker> {
        let shared = Arc::new(Shared::default());
        let renderer = Renderer::new(start, shared.clone());
        let thread = std::thread::Builder::new()
            .name("render".into())
            .spawn(move || renderer.run())
            .map_err(|e| Error::Window(format!("no thread to render on: {e}")))?;
        Ok(Worker { shared, thread: Some(thread) })
    }

    /// Asks for something else to be shown; only the newest request counts.
    pub fn send(&self, request: Request) {
        lock(&self.shared.inbox).request = Some(request);
        self.shared.news.notify_one();
    }

    /// Asks for something to be done.
    pub fn ask(&self, job: Job) {
        lock(&self.shared.inbox).jobs.push(job);
        self.shared.news.notify_one();
    }

    /// Whether the thread still runs: it ends early only if it panics.
    pub fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// The newest picture since the last call, and what happened.
    pub fn collect(&self) -> (Option<Frame>, Vec<Report>) {
        let outbox = std::mem::take(&mut *lock(&self.shared.outbox));
        (outbox.frame, outbox.reports)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        lock(&self.shared.inbox).quit = true;
        self.shared.news.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
