//! Where light bends, and how rays end: the sphere outside which space is straight or has a closed-form asymptote.

use super::World;
use crate::error::{Error, Result};
use crate::kernels::integrator::Model;
use crate::scene::{Scene, Spacetime};
use crate::spacetime::gravity::Source;
use crate::spacetime::{ModelKind, PowerGravity, Schwarzschild, ThesisGravity};
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
    /// Radius in units of the far field's strength. The asymptote's error is about (A / 2r)^2.
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
    let around = |center: DVec3, strength: f64| {
        let farthest = (low - center.as_vec3()).abs().max((high - center.as_vec3()).abs()).length();
        Region {
            center: center.as_vec3(),
            radius: (1.01 * farthest).max((reach.radii() * strength.abs()) as f32).max(1.0),
            strength: strength as f32,
        }
    };
    match spacetime {
        Spacetime::Flat => Region { center: Vec3::ZERO, radius: 0.0, strength: 0.0 },
        Spacetime::Schwarzschild { mass, position } => around(*position, 2.0 * mass),
        Spacetime::Gravity { sources, .. } if sources.is_empty() => Region { center: Vec3::ZERO, radius: 0.0, strength: 0.0 },
        Spacetime::Gravity { exponent, literal, sources } => {
            let bounded = sources.iter().all(|s| s.radius.is_finite() && s.extent.1.is_finite());
            if bounded {
                let ball = bounding_sphere(sources);
                // The literal recurrence counts its steps from the ray's origin, so they must not start at the ball.
                let around_scene = (low - ball.center).abs().max((high - ball.center).abs()).length() * 1.01;
                return Region { radius: if *literal { ball.radius.max(around_scene) } else { ball.radius }, ..ball };
            }
            let center = sources.iter().map(|s| DVec3::from(s.position)).sum::<DVec3>() / sources.len() as f64;
            // Only the potential of an inverse-square force has an asymptote in closed form; other fields end ten scenes away.
            let inverse_square = *exponent == Some(2.0) && sources.iter().all(|s| s.radius.is_infinite() && s.extent.1 == 0.0);
            if inverse_square {
                return around(center, sources.iter().map(|s| s.strength).sum());
            }
            let inner = around(center, 0.0);
            Region { radius: inner.radius * 10.0, ..inner }
        }
    }
}

fn bounding_sphere(sources: &[Source]) -> Region {
    let balls: Vec<(DVec3, f64)> = sources
        .iter()
        .flat_map(|s| [s.extent.0, s.extent.1].map(|t| (DVec3::from(s.position) + DVec3::from(s.direction) * t, s.radius)))
        .collect();
    let low = balls.iter().fold(DVec3::INFINITY, |a, (c, r)| a.min(*c - DVec3::splat(*r)));
    let high = balls.iter().fold(DVec3::NEG_INFINITY, |a, (c, r)| a.max(*c + DVec3::splat(*r)));
    let center = (low + high) / 2.0;
    let radius = balls.iter().map(|(c, r)| c.distance(center) + r).fold(0.0, f64::max);
    Region { center: center.as_vec3(), radius: radius as f32 * 1.000_001, strength: 0.0 }
}

/// Refuses a camera from which no ray can start.
pub(super) fn check_camera(world: &World, scene: &Scene) -> Result<()> {
    let x = scene.camera.position.to_array();
    let block = world.model_block::<f64>();
    let alive = match world.model {
        ModelKind::Flat => 1.0,
        ModelKind::ThesisGravity => ThesisGravity::capture_distance::<f64>((), &block, x),
        ModelKind::PowerGravity => PowerGravity::capture_distance::<f64>((), &block, x),
        ModelKind::Schwarzschild => Schwarzschild::capture_distance::<f64>((), &block, x),
    };
    if alive > 0.0 {
        return Ok(());
    }
    Err(Error::World(format!(
        "{}: the camera at {:?} is inside the horizon or capture radius of the model, expected a position outside",
        scene.path.display(),
        x
    )))
}
