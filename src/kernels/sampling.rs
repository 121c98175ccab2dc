//! Maps from the unit square to directions, and frames to put them in.

use glam::{Vec2, Vec3, vec2, vec3};

/// sin and cos of 2 pi `turns`, `turns` in [0, 1]; error below 2e-7. One polynomial for both backends, because Vulkan
/// lets `sin` and `cos` err by 2^-11.
#[inline(always)]
pub fn sin_cos_turns(turns: f32) -> Vec2 {
    // Reduce to an eighth of a turn about the nearest quarter.
    let quarter = (turns * 4.0 + 0.5).floor();
    let x = (turns * 4.0 - quarter) * 1.570_796_4;
    let x2 = x * x;
    let s = x * (1.0 + x2 * (-1.666_666_6e-1 + x2 * (8.333_331e-3 + x2 * (-1.984_090_7e-4 + x2 * 2.752_552_3e-6))));
    let c = 1.0 + x2 * (-0.5 + x2 * (4.166_666_4e-2 + x2 * (-1.388_887_7e-3 + x2 * 2.475_942_3e-5)));
    let q = (quarter as i32) & 3;
    let swapped = (q & 1) != 0;
    let sin_sign = if q >= 2 { -1.0 } else { 1.0 };
    let cos_sign = if q == 1 || q == 2 { -1.0 } else { 1.0 };
    vec2(if swapped { c } else { s } * sin_sign, if swapped { s } else { c } * cos_sign)
}

/// Direction at height `cos_theta` and azimuth 2 pi `turns` about +Z.
#[inline(always)]
pub fn spherical_direction(cos_theta: f32, turns: f32) -> Vec3 {
    let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    let sin_cos = sin_cos_turns(turns);
    vec3(sin_cos.y * sin_theta, sin_cos.x * sin_theta, cos_theta)
}

/// Cosine-distributed direction about +Z; its density is cos / pi (1/sr).
#[inline(always)]
pub fn sample_cosine(u: Vec2) -> Vec3 {
    spherical_direction((1.0 - u.x).sqrt(), u.y)
}

/// Point of the unit disc, uniform.
#[inline(always)]
pub fn sample_disc(u: Vec2) -> Vec2 {
    let sin_cos = sin_cos_turns(u.y);
    vec2(sin_cos.y, sin_cos.x) * u.x.sqrt()
}

/// First tangent of the frame about the unit vector `n` (Duff et al., JCGT 2017).
#[inline(always)]
pub fn frame_tangent(n: Vec3) -> Vec3 {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    vec3(1.0 + sign * n.x * n.x * a, sign * n.x * n.y * a, -sign * n.x)
}

/// World direction of `v`, given in the frame about `n`.
#[inline(always)]
pub fn world_from_frame(n: Vec3, v: Vec3) -> Vec3 {
    let t = frame_tangent(n);
    let b = n.cross(t);
    t * v.x + b * v.y + n * v.z
}

/// `v` in the frame about `n`.
#[inline(always)]
pub fn frame_from_world(n: Vec3, v: Vec3) -> Vec3 {
    let t = frame_tangent(n);
    let b = n.cross(t);
    vec3(v.dot(t), v.dot(b), v.dot(n))
}
