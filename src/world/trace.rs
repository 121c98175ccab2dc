//! Rays traced on their own through a world: where they stop, and what changes against a picture.

use super::{Reach, World, region};
use crate::kernels::constants::*;
use crate::kernels::layout::SceneParameters;
use crate::spacetime::ModelKind;
use glam::Vec3;

/// Below this tolerance (scene units) a method of order five takes a ray through a medium in fewer steps than the usual one of order four,
/// if its index is smooth. At equal tolerance its error may be the larger: 5.2e-10 against 3.3e-11 through a fish-eye at 1e-12.
const FINE_TOLERANCE: f64 = 1e-7;

/// What ends a traced ray, other than a hit, capture or escape.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Stop {
    /// Nothing.
    #[default]
    Never,
    /// A coordinate length.
    Length(f64),
    /// A value of the model's parameter: coordinate time for metrics.
    Parameter(f64),
    /// Leaving this radius of the model's own radial coordinate.
    Sphere(f64),
    /// Crossing the plane normal . x = d; one it starts on is left first.
    Plane([f64; 3], f64),
}

impl Stop {
    /// Size of the numbers it is stated in.
    pub fn size(self) -> f64 {
        match self {
            Stop::Never => 1.0,
            Stop::Length(v) | Stop::Parameter(v) | Stop::Sphere(v) | Stop::Plane(_, v) => v.abs().max(1.0),
        }
    }
}

/// How rays are traced on their own, where pixels do not set the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceOptions {
    /// Error allowed per step, in scene units.
    pub tolerance: f64,
    /// What ends them.
    pub stop: Stop,
    /// Steps after which they are given up, if not the scene's.
    pub max_steps: Option<u32>,
}

impl World {
    /// Scene parameters for tracing `origins` on their own: the region reaches around all of them, tolerances are absolute.
    ///
    /// A ray that is to stop somewhere is integrated all along, wherever it is.
    pub fn trace_parameters(&self, origins: &[[f64; 3]], reach: Reach, options: TraceOptions) -> SceneParameters {
        let around = origins.iter().map(|o| Vec3::from(o.map(|v| v as f32)));
        let (low, high) = around.fold(self.bounds, |(low, high), o| (low.min(o), high.max(o)));
        let mut scene = self.scene;
        let region = region::region(&self.spacetime, low, high, reach);
        scene.set_region(&region);
        if options.stop != Stop::Never {
            let size = (high - low).length().max(high.abs().max(low.abs()).length()).max(options.stop.size() as f32);
            scene.region_radius = match options.stop {
                Stop::Length(_) | Stop::Parameter(_) => 1e12,
                _ => region.radius.max(10.0 * size),
            };
        }
        if self.auto_method && !self.model.has_kinks() && scene.method == METHOD_NYSTROM && options.tolerance < FINE_TOLERANCE {
            scene.method = METHOD_DORMAND_PRINCE;
        }
        scene.max_steps = options.max_steps.unwrap_or(scene.max_steps);
        scene.tolerance = options.tolerance as f32;
        scene.chord_tolerance = (options.tolerance as f32).max(1e-6);
        scene
    }

    /// The model that traces rays up to `stop`: straight light that has to stop goes through a gravity field without sources.
    pub fn traced_model(&self, stop: Stop) -> ModelKind {
        if self.model == ModelKind::Flat && stop != Stop::Never { ModelKind::ThesisGravity } else { self.model }
    }

    /// Object behind the `primitive` of a hit.
    pub fn object_of(&self, primitive: u32) -> Option<u32> {
        if primitive == NO_INDEX {
            return None;
        }
        if primitive & HIT_PRIMITIVE != 0 {
            return self.primitives.get((primitive & CHILD_INDEX) as usize).map(|p| p.object);
        }
        let block = self.blocks.get(primitive as usize / 8)?;
        self.triangles.get(block.triangle[primitive as usize % 8] as usize).map(|t| t.object)
    }
}
