//! Camera rays: pinhole, thin lens, panorama; importance-sampled pixel filter.

use super::constants::*;
use super::layout::SceneParameters;
use super::sampling::{sample_disc, sin_cos_turns};
use glam::{Vec2, Vec3, vec2};

/// Offset of a film sample from the pixel's center (pixels), distributed as the filter.
#[inline(always)]
pub fn sample_filter(kind: u32, u: Vec2) -> Vec2 {
    if kind == FILTER_BOX {
        return u - Vec2::splat(0.5);
    }
    let cut = 1.0 - (-0.5 * (FILTER_RADIUS / FILTER_SIGMA) * (FILTER_RADIUS / FILTER_SIGMA)).exp();
    let radius = FILTER_SIGMA * (-2.0 * (1.0 - u.x * cut).ln()).sqrt();
    let sin_cos = sin_cos_turns(u.y);
    vec2(sin_cos.y, sin_cos.x) * radius
}

/// Unit direction through the film point `film` (pixels, y down).
#[inline(always)]
pub fn film_direction(scene: &SceneParameters, film: Vec2) -> Vec3 {
    let right = Vec3::from(scene.camera_right);
    let up = Vec3::from(scene.camera_up);
    let forward = Vec3::from(scene.camera_forward);
    let s = film.x / scene.film_width as f32;
    let t = film.y / scene.film_height as f32;
    if scene.camera_kind == CAMERA_PANORAMA {
        let around = sin_cos_turns(s.clamp(0.0, 1.0));
        let down = sin_cos_turns(t.clamp(0.0, 1.0) * 0.5);
        return up * down.y - (right * around.x + forward * around.y) * down.x;
    }
    let x = (2.0 * s - 1.0) * scene.tan_half_fov * scene.aspect;
    let y = (1.0 - 2.0 * t) * scene.tan_half_fov;
    (right * x + up * y + forward).normalize()
}

/// A viewing direction of an observer who moves with `velocity` (in units of light's) as the observer at rest has it, and the
/// frequency the moving one sees over that of the one at rest: aberration and Doppler shift of light that arrives from there.
#[inline(always)]
pub fn aberrate(direction: Vec3, velocity: Vec3) -> (Vec3, f32) {
    let speed2 = velocity.dot(velocity);
    if speed2 == 0.0 {
        return (direction, 1.0);
    }
    let gamma = 1.0 / (1.0 - speed2).sqrt();
    let along = direction.dot(velocity);
    // Energy and viewing direction of a photon of unit energy in the moving frame, boosted back.
    let energy = gamma * (1.0 - along);
    let boosted = direction + velocity * ((gamma - 1.0) * along / speed2 - gamma);
    (boosted * (1.0 / energy), 1.0 / energy)
}

/// Origin and unit direction of the camera ray through `film` (pixels), `lens` uniform in the unit square; and the frequency on the
/// film over that for the Eulerian observer at the camera.
#[inline(always)]
pub fn camera_ray(scene: &SceneParameters, film: Vec2, lens: Vec2) -> (Vec3, Vec3, f32) {
    let mut origin = Vec3::from(scene.camera_position);
    let mut direction = film_direction(scene, film);
    if scene.aperture_radius > 0.0 && scene.camera_kind != CAMERA_PANORAMA {
        let focus = direction * (scene.focus_distance / direction.dot(Vec3::from(scene.camera_forward)));
        let disc = sample_disc(lens) * scene.aperture_radius;
        let offset = Vec3::from(scene.camera_right) * disc.x + Vec3::from(scene.camera_up) * disc.y;
        origin += offset;
        direction = (focus - offset).normalize();
    }
    let (seen, ratio) = aberrate(direction, scene.camera_velocity.into());
    (origin, seen, ratio)
}
