//! The seam between what is rendered and what renders it.

pub mod cpu;
pub mod vulkan;

use crate::error::Result;
use crate::film::Film;
use crate::kernels::path::Arrival;
use crate::simd::Real;
use crate::world::World;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

/// Precision of the curve integration. Geometry and shading are in single precision either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Single.
    #[default]
    F32,
    /// Double.
    F64,
}

impl Precision {
    /// Suffix of shader names.
    pub fn suffix(self) -> &'static str {
        match self {
            Precision::F32 => "f32",
            Precision::F64 => "f64",
        }
    }
}

/// A ray to be traced on its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceRay {
    /// Start point.
    pub origin: [f64; 3],
    /// Direction of travel; its length is the launch speed of `gravity` and ignored elsewhere.
    pub direction: [f64; 3],
}

/// Where a traced ray ended.
#[derive(Clone, Copy, Debug)]
pub struct TraceResult {
    /// The end of the ray, in single precision.
    pub arrival: Arrival,
    /// End point.
    pub position: [f64; 3],
    /// Unit direction of travel there, at infinity if escaped.
    pub direction: [f64; 3],
    /// Unnormalised velocity (momentum) there.
    pub velocity: [f64; 3],
}

/// How rays are traced on their own, where pixels do not set the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceOptions {
    /// Error allowed per step, in scene units.
    pub tolerance: f64,
    /// End after this coordinate length.
    pub length: Option<f64>,
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

/// A device that turns a world into a film.
pub trait Backend: Send {
    /// What it is and what it runs on, for people.
    fn name(&self) -> String;

    /// Takes a world and starts an empty film whose first sample will be `first_sample`.
    fn upload(&mut self, world: Arc<World>, precision: Precision, first_sample: u32) -> Result<()>;

    /// Adds `samples` (indices) to every pixel of `rows`; returns when they are in the film.
    fn accumulate(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()>;

    /// The film so far.
    fn film(&mut self) -> Result<Film>;

    /// Traces rays on their own through the uploaded world, in the precision it was uploaded for.
    fn trace(&mut self, rays: &[TraceRay], options: TraceOptions) -> Result<Vec<TraceResult>>;

    /// Times of every kernel since the last call.
    fn timings(&mut self) -> Vec<KernelTiming>;
}

/// The entries of a vector in double precision.
fn widen<T: Real>(v: [T; 3]) -> [f64; 3] {
    v.map(Real::to_f64)
}
