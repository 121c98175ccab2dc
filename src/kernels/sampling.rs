//! Maps from the unit square to directions, and frames to put them in; over any number of lanes.

use crate::simd::{Lane, Vector, vector};

/// sin and cos of 2 pi `turns`, `turns` in [0, 1]; error below 2e-7. One polynomial for both backends, because Vulkan
/// lets `sin` and `cos` err by 2^-11.
#[inline(always)]
pub fn sin_cos_turns<L: Lane<Real = f32>>(token: L::Token, turns: L) -> [L; 2] {
    let c = |value: f32| L::splat(token, value);
    // Reduce to an eighth of a turn about the nearest quarter.
    let quarter = turns.mul_add(c(4.0), c(0.5)).floor();
    let x = (turns * c(4.0) - quarter) * c(1.570_796_4);
    let x2 = x * x;
    let s = c(2.752_552_3e-6).mul_add(x2, c(-1.984_090_7e-4)).mul_add(x2, c(8.333_331e-3)).mul_add(x2, c(-1.666_666_6e-1));
    let s = x * s.mul_add(x2, c(1.0));
    let cos = c(2.475_942_3e-5).mul_add(x2, c(-1.388_887_7e-3)).mul_add(x2, c(4.166_666_4e-2)).mul_add(x2, c(-0.5));
    let cos = cos.mul_add(x2, c(1.0));
    // The quarter modulo 4, and whether it is odd.
    let q = quarter - (quarter * c(0.25)).floor() * c(4.0);
    let half = q * c(0.5);
    let odd = half.floor().lt(half);
    let (sin_size, cos_size) = (L::select(odd, cos, s), L::select(odd, s, cos));
    let (beyond_first, beyond_second) = (c(0.5).lt(q), c(1.5).lt(q));
    let cos_negative = L::both(beyond_first, q.lt(c(2.5)));
    [L::select(beyond_second, -sin_size, sin_size), L::select(cos_negative, -cos_size, cos_size)]
}

/// Direction at height `cos_theta` and azimuth 2 pi `turns` about +Z.
#[inline(always)]
pub fn spherical_direction<L: Lane<Real = f32>>(token: L::Token, cos_theta: L, turns: L) -> Vector<L> {
    let sin_theta = (L::splat(token, 1.0) - cos_theta * cos_theta).max(L::splat(token, 0.0)).sqrt();
    let [sin, cos] = sin_cos_turns(token, turns);
    vector(cos * sin_theta, sin * sin_theta, cos_theta)
}

/// Cosine-distributed direction about +Z; its density is cos / pi (1/sr).
#[inline(always)]
pub fn sample_cosine<L: Lane<Real = f32>>(token: L::Token, u: [L; 2]) -> Vector<L> {
    spherical_direction(token, (L::splat(token, 1.0) - u[0]).sqrt(), u[1])
}

/// Point of the unit disc, uniform.
#[inline(always)]
pub fn sample_disc<L: Lane<Real = f32>>(token: L::Token, u: [L; 2]) -> [L; 2] {
    let [sin, cos] = sin_cos_turns(token, u[1]);
    [cos * u[0].sqrt(), sin * u[0].sqrt()]
}

/// First tangent of the frame about the unit vector `n` (Duff et al., JCGT 2017).
#[inline(always)]
pub fn frame_tangent<L: Lane<Real = f32>>(token: L::Token, n: Vector<L>) -> Vector<L> {
    let c = |value: f32| L::splat(token, value);
    let sign = L::select(n.z.lt(c(0.0)), c(-1.0), c(1.0));
    let a = c(-1.0) / (sign + n.z);
    vector((sign * n.x * n.x).mul_add(a, c(1.0)), sign * n.x * n.y * a, -(sign * n.x))
}

/// World direction of `v`, given in the frame about `n`.
#[inline(always)]
pub fn world_from_frame<L: Lane<Real = f32>>(token: L::Token, n: Vector<L>, v: Vector<L>) -> Vector<L> {
    let t = frame_tangent(token, n);
    let b = n.cross(t);
    t * v.x + b * v.y + n * v.z
}

/// `v` in the frame about `n`.
#[inline(always)]
pub fn frame_from_world<L: Lane<Real = f32>>(token: L::Token, n: Vector<L>, v: Vector<L>) -> Vector<L> {
    let t = frame_tangent(token, n);
    let b = n.cross(t);
    vector(v.dot(t), v.dot(b), v.dot(n))
}
