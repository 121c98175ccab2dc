//! The window: a scene to fly around in, and panels to change it.
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`worker`] | the render thread's two ends; what it does is in `renderer`, `loaded`, `lane`, `canvases`, `pick` |
//! | [`subject`] | what is looked at: [`document`], camera ([`navigation`]), development |
//! | [`panels`] | what is drawn over the picture, from [`parameters`], [`map`], [`help`]; [`model`] is what both sides share |
//! | `app`, `stage` | the event loop, and the one window it has; [`input`] is what hands do |

mod app;
mod canvases;
pub mod document;
pub mod help;
pub mod history;
pub mod input;
mod lane;
mod loaded;
pub mod map;
pub mod model;
pub mod navigation;
pub mod panels;
pub mod parameters;
mod pick;
mod renderer;
mod stage;
pub mod subject;
pub mod worker;

use crate::backend::Precision;
use crate::error::{Error, Result};
use crate::scene::{Assets, load_scene};
use app::App;
use document::Document;
use std::path::PathBuf;
use winit::event_loop::EventLoop;

/// What renders for the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RenderOn {
    /// The window's device if it is a real one, else the processor.
    #[default]
    Auto,
    /// The window's device.
    Vulkan,
    /// The processor.
    Cpu,
}

/// What a window is opened with.
#[derive(Clone, Debug, Default)]
pub struct ViewOptions {
    /// Scene file, or the built-in scene.
    pub scene: Option<PathBuf>,
    /// Assignments `key.path=value` to the scene.
    pub overrides: Vec<String>,
    /// Whether light goes straight at first.
    pub linear: bool,
    /// What renders.
    pub render_on: RenderOn,
    /// Device of the window, by number or part of its name.
    pub device: Option<String>,
    /// Precision of curves.
    pub precision: Precision,
    /// Threads of the processor's backend.
    pub threads: Option<usize>,
    /// Frames after which the window closes.
    pub frames: Option<u64>,
    /// PNG to write before it does.
    pub screenshot: Option<PathBuf>,
}

/// What came of a window that was closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Frames that were presented with a picture that was new or complete.
    pub frames: u64,
    /// Samples in every pixel of the last one.
    pub samples: u32,
    /// Inputs that were answered.
    pub answers: u64,
    /// Median and longest time until a picture answered an input (ms).
    pub latency_ms: Option<(f64, f64)>,
    /// What rendered.
    pub backend: String,
    /// Pixels of the window across and down.
    pub size: (u32, u32),
}

/// Opens the window and returns when it is closed.
pub fn run(options: ViewOptions) -> Result<Summary> {
    let document = Document::open(options.scene.as_deref(), &options.overrides)?;
    let mut assets = Assets::default();
    let scene = match document.to_scene(&mut assets) {
        Ok(scene) => scene,
        // An assignment that is to blame is named by the loader.
        Err(e) => load_scene(options.scene.as_deref(), &options.overrides).and(Err(e))?,
    };
    let world = loaded::compile(&scene)?;
    if world.dark {
        let name = document.name();
        eprintln!("nullray: warning: {}: nothing emits light and the environment is black, the picture will be too", name.display());
    }
    let event_loop = EventLoop::with_user_event().build().map_err(no_display)?;
    let mut app = App::new(options, app::Opening { document, scene, world, assets }, event_loop.create_proxy());
    event_loop.run_app(&mut app).map_err(|e| Error::Window(one_line(&e.to_string())))?;
    app.finish()
}

fn no_display(error: winit::error::EventLoopError) -> Error {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty()).map(|value| format!("{name}={value}"));
    Error::Window(match set("WAYLAND_DISPLAY").or_else(|| set("DISPLAY")) {
        Some(display) => format!("cannot connect to the display {display}: {}", one_line(&error.to_string())),
        None => "neither DISPLAY nor WAYLAND_DISPLAY is set; `nullray render` needs no display".into(),
    })
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
