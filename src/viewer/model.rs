//! What the window's thread and the panels tell each other.
//!
//! Each frame `panels::show(ui: &mut egui::Ui, state: &mut PanelState, view: &View<'_>) -> Vec<Action>` gets the root ui, which covers the
//! whole window; floating windows come from `ui.ctx()`. Actions of one frame are applied together, in order, before the scene is read
//! again, so that several `Remove` and `Set` may make one valid scene out of another. Keys of the document are those of `--set`:
//! `spacetime.mass`, `material.2.roughness`, `spacetime.center.0.strength`; the index one past the last entry appends.

use super::document::Document;
use super::history::History;
use crate::backend::{Channel, Development, KernelTiming};
use crate::film::Statistics;
use crate::scene::{Scene, ToneMap};

/// What a panel asks for.
#[derive(Clone, Debug)]
pub enum Action {
    /// Sets a value of the scene.
    Set {
        /// Where, as in `--set`.
        key: String,
        /// What.
        value: toml_edit::Value,
    },
    /// Takes a value, or an entry of a list, out of the scene.
    Remove {
        /// Where, as in `--set`.
        key: String,
    },
    /// Shows another value of the film.
    Channel(Channel),
    /// Develops with this exposure (stops).
    Exposure(f64),
    /// Develops with this tone curve.
    ToneMap(ToneMap),
    /// Bends light, or lets it go straight.
    Bending(bool),
    /// Straight light to the left of this share of the width; `None` is one picture.
    Split(Option<f64>),
    /// Speed of the observer along the viewing direction, in units of light's.
    Velocity(f64),
    /// Puts the camera back where the scene has it.
    ResetCamera,
    /// Writes the picture as a PNG.
    Screenshot,
    /// Writes the film as an EXR.
    SaveFilm,
    /// Writes the scene with its present state.
    SaveScene,
    /// Shows or hides the keys.
    Help(bool),
    /// Hides the panels.
    HidePanels,
    /// Forgets the clicked pixel.
    ClearPick,
}

/// What the panels show of the viewer, borrowed for a frame.
pub struct View<'a> {
    /// The scene as text that can be edited.
    pub document: &'a Document,
    /// The last good scene of it, with the camera where it is now.
    pub scene: &'a Scene,
    /// How the film is developed.
    pub development: &'a Development,
    /// Whether light bends.
    pub bending: bool,
    /// Where straight light ends, as a share of the width.
    pub split: Option<f64>,
    /// Speed of the observer along the viewing direction.
    pub velocity: f64,
    /// What is known about the newest picture.
    pub frame: Option<&'a FrameInfo>,
    /// Times of the last frames.
    pub history: &'a History,
    /// The clicked pixel.
    pub pick: Option<&'a Pick>,
    /// Why the scene as it is now cannot be rendered.
    pub error: Option<&'a str>,
    /// What was just done.
    pub message: Option<&'a str>,
    /// Whether the keys are shown.
    pub help: bool,
    /// Name of the device of the window.
    pub device: &'a str,
    /// Median time from an input to the picture that answers it.
    pub latency_ms: Option<f64>,
}

/// What the render thread says about a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameInfo {
    /// Number of the request it answers.
    pub revision: u64,
    /// Pixels of the film across and down.
    pub size: (u32, u32),
    /// Pixels of the window along one of the film's: 1 is full resolution.
    pub scale: u32,
    /// Samples in every pixel.
    pub samples: u32,
    /// Samples after which it rests.
    pub goal: u32,
    /// Rays per second, camera and bounce.
    pub rays_per_second: f64,
    /// Integration steps of camera rays per second.
    pub steps_per_second: f64,
    /// Times of the kernels that made it.
    pub timings: Vec<KernelTiming>,
    /// What happened to the rays of a small film of this view.
    pub statistics: Statistics,
    /// What renders.
    pub backend: String,
}

/// A clicked pixel, and the ray seen there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pick {
    /// Column and row of the window, in pixels.
    pub pixel: (u32, u32),
    /// `STATUS_*` of the ray.
    pub status: u32,
    /// Object that was hit.
    pub object: Option<u32>,
    /// What kind of thing it is.
    pub object_name: String,
    /// Name of its material.
    pub material: String,
    /// Frequency that arrives over the one that was sent, for static observers.
    pub redshift: f64,
    /// Integration steps.
    pub steps: u32,
    /// Chords that met the BVH.
    pub chords: u32,
    /// Coordinate length.
    pub length: f64,
    /// Where the ray ended.
    pub position: [f64; 3],
    /// Its path from the camera.
    pub path: Vec<[f64; 3]>,
}
