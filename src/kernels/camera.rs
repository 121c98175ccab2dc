//! Camera rays: pinhole, thin lens, panorama; importance-sampled pixel filter; over any number of lanes.

use super::constants::*;
use super::layout::SceneParameters;
use super::sampling::{sample_disc, sin_cos_turns};
use crate::simd::{Lane, Vector};

/// Offset of a film sample from the pixel's center (pixels), distributed as the filter.
#[inline(always)]
pub fn sample_filter<L: Lane<Real = f32>>(token: L::Token, kind: u32, u: [L; 2]) -> [L; 2] {
    let c = |value: f32| L::splat(token, value);
    if kind == FILTER_BOX {
        return [u[0] - c(0.5), u[1] - c(0.5)];
    }
    let cut = 1.0 - (-0.5 * (FILTER_RADIUS / FILTER_SIGMA) * (FILTER_RADIUS / FILTER_SIGMA)).exp();
    let radius = c(FILTER_SIGMA) * (c(-2.0) * (c(1.0) - u[0] * c(cut)).ln()).sqrt();
    let [sin, cos] = sin_cos_turns(token, u[1]);
    [cos * radius, sin * radius]
}

/// Unit direction through the film point `film` (pixels, y down).
#[inline(always)]
pub fn film_direction<L: Lane<Real = f32>>(token: L::Token, scene: &SceneParameters, film: [L; 2]) -> Vector<L> {
    let c = |value: f32| L::splat(token, value);
    let right = Vector::constant(token, scene.camera_right);
    let up = Vector::constant(token, scene.camera_up);
    let forward = Vector::constant(token, scene.camera_forward);
    let s = film[0] / c(scene.film_width as f32);
    let t = film[1] / c(scene.film_height as f32);
    if scene.camera_kind == CAMERA_PANORAMA {
        let [sin_around, cos_around] = sin_cos_turns(token, s.max(c(0.0)).min(c(1.0)));
        let [sin_down, cos_down] = sin_cos_turns(token, t.max(c(0.0)).min(c(1.0)) * c(0.5));
        return up * cos_down - (right * sin_around + forward * cos_around) * sin_down;
    }
    let x = (s + s - c(1.0)) * c(scene.tan_half_fov * scene.aspect);
    let y = (c(1.0) - (t + t)) * c(scene.tan_half_fov);
    (right * x + up * y + forward).normalize(token)
}

/// A viewing direction of an observer who moves with `velocity` (in units of light's) as the observer at rest has it, and the
/// frequency the moving one sees over that of the one at rest: aberration and Doppler shift of light that arrives from there.
#[inline(always)]
pub fn aberrate<L: Lane<Real = f32>>(token: L::Token, direction: Vector<L>, velocity: [f32; 3]) -> (Vector<L>, L) {
    let c = |value: f32| L::splat(token, value);
    let [vx, vy, vz] = velocity;
    let speed2 = vx * vx + vy * vy + vz * vz;
    if speed2 == 0.0 {
        return (direction, c(1.0));
    }
    let velocity = Vector::constant(token, velocity);
    let gamma = 1.0 / (1.0 - speed2).sqrt();
    let along = direction.dot(velocity);
    // Energy and viewing direction of a photon of unit energy in the moving frame, boosted back.
    let ratio = c(1.0) / (c(gamma) * (c(1.0) - along));
    let boosted = direction + velocity * (along * c((gamma - 1.0) / speed2) - c(gamma));
    (boosted * ratio, ratio)
}

/// Origin and unit direction of the camera ray through `film` (pixels), `lens` uniform in the unit square; and the frequency on the
/// film over that for the Eulerian observer at the camera.
#[inline(always)]
pub fn camera_ray<L: Lane<Real = f32>>(token: L::Token, scene: &SceneParameters, film: [L; 2], lens: [L; 2]) -> (Vector<L>, Vector<L>, L) {
    let mut origin = Vector::constant(token, scene.camera_position);
    let mut direction = film_direction(token, scene, film);
    if scene.aperture_radius > 0.0 && scene.camera_kind != CAMERA_PANORAMA {
        let depth = direction.dot(Vector::constant(token, scene.camera_forward));
        let focus = direction * (L::splat(token, scene.focus_distance) / depth);
        let [x, y] = sample_disc(token, lens);
        let on_lens = Vector::constant(token, scene.camera_right) * x + Vector::constant(token, scene.camera_up) * y;
        let offset = on_lens * L::splat(token, scene.aperture_radius);
        origin = origin + offset;
        direction = (focus - offset).normalize(token);
    }
    let (seen, ratio) = aberrate(token, direction, scene.camera_velocity);
    (origin, seen, ratio)
}
