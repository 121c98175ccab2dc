//! Where light bends, and how rays end: the sphere outside which space is straight or has a closed-form asymptote.

use crate::error::{Error, Result};
use crate::kernels::integrator::{ModelBlock, PointFunctions};
use crate::scene::{Extent, Scene, Spacetime};
use glam::{DVec3, Vec3};

/// The sphere rays are integrated in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Center.
    pub center: Vec3,
    /// Radius.
    pub radius: f32,
    /// Coefficient A of the far field n = 1 + A / r outside; 0 where space is straight.
    pub strength: f32,
    /// Whether light bends up to the edge, so that rays must be taken there and not beyond.
    pub sharp: bool,
}

/// How far out rays are integrated where the field has no end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// Far enough that the asymptote errs by less than 1e-4 radians: for pictures.
    Picture,
    /// Far enough for 1e-11 radians: for traced rays in f64.
    Exact,
}

impl Reach {
    /// Radius in units of the far field's length scale L. The asymptote's error is about (L / 2r)^2.
    fn radii(self) -> f64 {
        match self {
            Reach::Picture => 150.0,
            Reach::Exact => 2e5,
        }
    }
}

/// The region of a spacetime around a scene with `bounds`, for pictures.
pub(super) fn of(spacetime: &Spacetime, bounds: (Vec3, Vec3), camera: Vec3) -> Region {
    region(spacetime, bounds.0.min(camera), bounds.1.max(camera), Reach::Picture)
}

/// The region of a spacetime that holds at least the box `low..high` if the field has no end.
pub fn region(spacetime: &Spacetime, low: Vec3, high: Vec3, reach: Reach) -> Region {
    let around = |center: Vec3| (1.01 * (low - center).abs().max((high - center).abs()).length()).max(1.0);
    match spacetime.extent {
        Extent::Nowhere => Region { center: Vec3::ZERO, radius: 0.0, strength: 0.0, sharp: false },
        Extent::Ball(center, radius) => {
            let center = center.as_vec3();
            let radius = radius as f32 * 1.000_001;
            // The literal recurrence counts its steps from the ray's origin, so they must not start at the ball.
            Region { center, radius: if spacetime.literal { radius.max(around(center)) } else { radius }, strength: 0.0, sharp: false }
        }
        Extent::Field { center, strength, scale } => {
            let center = center.as_vec3();
            Region { center, radius: around(center).max((reach.radii() * scale) as f32), strength: strength as f32, sharp: false }
        }
        Extent::Scenes(times) => {
            let center = spacetime.position.as_vec3();
            Region { center, radius: around(center) * times as f32, strength: 0.0, sharp: true }
        }
    }
}

/// The model's parameters as its spacetime states them, without a method of integration.
pub(super) fn block_of(spacetime: &Spacetime) -> ModelBlock<f64> {
    ModelBlock {
        origin: spacetime.position.to_array(),
        throat: spacetime.throat,
        rim: spacetime.rim,
        global: spacetime.global.clone(),
        sources: spacetime.sources.clone(),
        table: spacetime.table.clone(),
        ..ModelBlock::default()
    }
}

/// Whether rays can start at a point: outside of horizons, captures and the throat.
pub fn sees(spacetime: &Spacetime, camera: DVec3) -> bool {
    let (block, x) = (block_of(spacetime), camera.to_array());
    let functions = PointFunctions::<f64>::of(spacetime.model);
    let (p, energy, frequency) = (functions.launch)((), &block, x, [0.0, 0.0, 1.0], 1.0, -1.0);
    let alive = (functions.capture_distance)((), &block, x, p, frequency, -1.0);
    let above_throat = spacetime.throat == 0.0 || camera.distance(spacetime.position) > spacetime.throat;
    alive > 0.0 && above_throat && energy.is_finite() && p.iter().all(|c| c.is_finite())
}

/// Refuses a camera from which no ray can start.
pub(super) fn check_camera(scene: &Scene) -> Result<()> {
    if sees(&scene.spacetime, scene.camera.position) {
        return Ok(());
    }
    Err(Error::World(format!(
        "{}: the camera at {:?} is where no ray of kind `{}` lives (inside its horizon, capture radius or throat), expected a position outside",
        scene.path.display(),
        scene.camera.position.to_array(),
        scene.spacetime.kind
    )))
}
