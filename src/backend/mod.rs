//! The seam between what is rendered and what renders it.

pub mod cpu;
pub mod path;
pub mod timing;
pub mod vulkan;

use crate::error::Result;
use crate::film::Film;
pub use crate::film::{Channel, Development};
use crate::kernels::constants::STATUS_ESCAPED;
use crate::kernels::integrator::{ModelBlock, PointFunctions};
use crate::kernels::layout::SceneParameters;
use crate::simd::Real;
use crate::spacetime::{Class, ModelKind};
use crate::world::World;
pub use crate::world::{Stop, TraceOptions};
use std::ops::Range;
use std::sync::Arc;
pub use timing::{Dispatch, KernelTiming, Profiling, RoundCounts, Submission, Timings};
pub use vulkan::canvas::Canvas;

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

/// How a traced ray sets out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Launch {
    /// Along a direction of travel in the local orthonormal frame of the Eulerian observer; its length is the launch speed of
    /// `gravity` and ignored elsewhere.
    Direction([f64; 3]),
    /// With the covariant spatial momentum of the future-directed photon, of a metric or a medium.
    Momentum([f64; 3]),
}

/// A ray to be traced on its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceRay {
    /// Start point.
    pub origin: [f64; 3],
    /// Direction or momentum.
    pub launch: Launch,
    /// Whether the photon that *arrives* here is followed backward, as a camera does, rather than one emitted here forward.
    pub past: bool,
    /// Side of a wormhole it starts on: 1 or -1.
    pub side: i32,
}

impl TraceRay {
    /// A ray that looks along `direction` from `origin`.
    pub fn looking(origin: [f64; 3], direction: [f64; 3]) -> TraceRay {
        TraceRay { origin, launch: Launch::Direction(direction), past: true, side: 1 }
    }
}

/// Where a traced ray ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceResult {
    /// `STATUS_*`.
    pub status: u32,
    /// End point.
    pub position: [f64; 3],
    /// Unit direction of travel there in the local orthonormal frame, at infinity if escaped.
    pub direction: [f64; 3],
    /// Unnormalised velocity or covariant momentum of the ray there; of the future-directed photon if it was launched with one.
    pub momentum: [f64; 3],
    /// Coordinate length.
    pub length: f64,
    /// The model's parameter: coordinate time for metrics.
    pub parameter: f64,
    /// Side of a wormhole: 1 or -1.
    pub side: i32,
    /// Integration steps.
    pub steps: u32,
    /// Chords that met the BVH.
    pub chords: u32,
    /// Relative drift of the conserved Hamiltonian.
    pub constraint_error: f64,
    /// Frequency at the end over frequency at the start, for Eulerian observers (distant static ones if escaped).
    pub frequency_ratio: f64,
    /// Object that was hit.
    pub object: Option<u32>,
}

/// A traced ray ready for a backend: a unit direction in the local frame, and what its result is made of.
#[derive(Clone, Copy, Debug)]
struct Prepared {
    origin: [f64; 3],
    direction: [f64; 3],
    speed: f64,
    sense: f64,
    side: u32,
    /// Factor of the ray's momentum over the one that `direction` is launched with; negative for a photon followed backward.
    scale: f64,
}

/// What turns rays into launches and landings into results: the model in double precision.
struct Tracer<'a> {
    world: &'a World,
    functions: PointFunctions<f64>,
    block: ModelBlock<f64>,
}

/// The end of a ray as a backend reports it.
#[derive(Clone, Copy, Debug)]
struct RawLanding {
    status: u32,
    primitive: u32,
    position: [f64; 3],
    direction: [f64; 3],
    momentum: [f64; 3],
    length: f64,
    parameter: f64,
    side: u32,
    steps: u32,
    chords: u32,
}

impl<'a> Tracer<'a> {
    fn new(world: &'a World) -> Self {
        Tracer { world, functions: PointFunctions::of(world.model), block: world.model_block() }
    }

    fn prepare(&self, ray: &TraceRay) -> Prepared {
        let model = self.world.model;
        let sense = if ray.past { -1.0 } else { 1.0 };
        let (vector, is_momentum) = match ray.launch {
            Launch::Direction(d) => (d, false),
            Launch::Momentum(p) => (p.map(|c| c * sense), true),
        };
        let size = vector.iter().map(|c| c * c).sum::<f64>().sqrt();
        let gravity = matches!(model, ModelKind::ThesisGravity | ModelKind::PowerGravity);
        let (mut direction, speed) = (vector.map(|c| c / size), if gravity { size } else { 1.0 });
        let mut scale = if is_momentum { sense } else { 1.0 };
        if is_momentum && model.class() == Class::Metric {
            let (local, frequency, _) = (self.functions.observe)((), &self.block, ray.origin, vector, 1.0, sense, 0.0);
            direction = local;
            scale = sense * frequency;
        }
        Prepared { origin: ray.origin, direction, speed, sense, side: u32::from(ray.side < 0), scale }
    }

    /// The result of a ray; frequencies and drift are taken in double precision whatever the backend's.
    fn result(&self, ray: &Prepared, raw: &RawLanding) -> TraceResult {
        let (functions, block) = (&self.functions, &self.block);
        let (_, energy, frequency) = (functions.launch)((), block, ray.origin, ray.direction, ray.speed, ray.sense);
        let (_, seen, drift) = (functions.observe)((), block, raw.position, raw.momentum, energy, ray.sense, raw.parameter);
        let escaped = raw.status == STATUS_ESCAPED;
        let end = if escaped { (functions.far_frequency)((), block, raw.momentum, energy) } else { seen };
        TraceResult {
            status: raw.status,
            position: raw.position,
            direction: raw.direction,
            momentum: raw.momentum.map(|c| c * ray.scale),
            length: raw.length,
            parameter: raw.parameter,
            side: if raw.side == 0 { 1 } else { -1 },
            steps: raw.steps,
            chords: raw.chords,
            constraint_error: drift.abs(),
            frequency_ratio: end / frequency,
            object: self.world.object_of(raw.primitive),
        }
    }
}

/// A device that turns a world into a film.
pub trait Backend: Send {
    /// What it is and what it runs on, for people.
    fn name(&self) -> String;

    /// Takes a world and starts an empty film whose first sample will be `first_sample`.
    fn upload(&mut self, world: Arc<World>, precision: Precision, first_sample: u32) -> Result<()>;

    /// Replaces everything of the uploaded world that is not an array (see [`World::parameters_for`]) and starts an empty film.
    fn set_parameters(&mut self, parameters: &SceneParameters) -> Result<()>;

    /// Adds `samples` (indices) to every pixel of `rows`; returns when they are in the film.
    fn accumulate(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()>;

    /// The film so far.
    fn film(&mut self) -> Result<Film>;

    /// Develops the film so far into columns of a canvas of its size; pixels without samples are black.
    ///
    /// A canvas for Vulkan lies on the same device, one for the CPU is visible to the host.
    fn develop(&mut self, development: &Development, canvas: &mut Canvas) -> Result<()>;

    /// Traces rays on their own through the uploaded world, in the precision it was uploaded for.
    fn trace(&mut self, rays: &[TraceRay], options: TraceOptions) -> Result<Vec<TraceResult>>;

    /// Sets how much is measured from now on.
    fn set_profiling(&mut self, profiling: Profiling);

    /// What was measured since the last call.
    fn timings(&mut self) -> Timings;
}

/// The entries of a vector in double precision.
fn widen<T: Real>(v: [T; 3]) -> [f64; 3] {
    v.map(Real::to_f64)
}
