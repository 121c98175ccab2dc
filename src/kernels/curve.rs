//! A segment of a ray: a cubic x(s) = start + c1 s + c2 s^2 + c3 s^3, s in [0, 1], the dense output of one integration step, or a straight
//! ray.
//!
//! A cubic is met by surfaces as the chords of `chords` equal pieces.

use super::constants::MAX_CHORDS;
use super::integrator::along;
use super::triangle::dot;
use crate::simd::Lane;
use bytemuck::Zeroable;
use glam::Vec3;

/// A straight ray (`chords` = 1, c2 = c3 = 0) or a curved step, one or one per lane.
#[derive(Clone, Copy, Debug, Zeroable)]
pub struct Curve<L> {
    /// Start point.
    pub start: [L; 3],
    /// Coefficient of s.
    pub c1: [L; 3],
    /// Coefficient of s^2.
    pub c2: [L; 3],
    /// Coefficient of s^3.
    pub c3: [L; 3],
    /// Pieces the curve is cut into, a whole number.
    pub chords: L,
}

/// The straight ray origin + s direction.
#[inline(always)]
pub fn straight(origin: Vec3, direction: Vec3) -> Curve<f32> {
    Curve { start: origin.into(), c1: direction.into(), c2: [0.0; 3], c3: [0.0; 3], chords: 1.0 }
}

/// The cubic with end points `start` and `end` and end tangents `tangent0` and `tangent1` (derivatives by s), not cut yet.
#[inline(always)]
pub fn hermite<L: Lane>(token: L::Token, start: [L; 3], end: [L; 3], tangent0: [L; 3], tangent1: [L; 3]) -> Curve<L> {
    let (two, three) = (L::constant(token, 2.0), L::constant(token, 3.0));
    let mut curve = Curve { start, c1: tangent0, c2: start, c3: start, chords: L::constant(token, 1.0) };
    for i in 0..3 {
        let chord = end[i] - start[i];
        curve.c2[i] = chord * three - tangent0[i] * two - tangent1[i];
        curve.c3[i] = tangent0[i] + tangent1[i] - chord * two;
    }
    curve
}

/// Point of the curve at parameter `s`.
#[inline(always)]
pub fn curve_point<L: Lane>(curve: &Curve<L>, s: L) -> [L; 3] {
    along(curve.start, along(curve.c1, along(curve.c2, curve.c3, s), s), s)
}

/// Derivative of the curve at parameter `s`.
#[inline(always)]
pub fn curve_tangent<L: Lane>(token: L::Token, curve: &Curve<L>, s: L) -> [L; 3] {
    let [x, y, z] = curve.c2;
    let twice = [x + x, y + y, z + z];
    along(curve.c1, along(twice, curve.c3, s * L::constant(token, 3.0)), s)
}

/// From the start of the curve to its end.
#[inline(always)]
pub fn whole_chord<L: Lane>(curve: &Curve<L>) -> [L; 3] {
    let Curve { c1, c2, c3, .. } = curve;
    [c1[0] + c2[0] + c3[0], c1[1] + c2[1] + c3[1], c1[2] + c2[2] + c3[2]]
}

/// The part of the curve from `from` to `to`, cut so that no chord strays from it by more than `tolerance`, into `MAX_CHORDS` at most.
#[inline(always)]
pub fn cut_span<L: Lane>(token: L::Token, curve: &Curve<L>, from: L, to: L, tolerance: L) -> Curve<L> {
    let (one, three) = (L::constant(token, 1.0), L::constant(token, 3.0));
    let w = to - from;
    let (mut c1, mut c2, mut c3) = (curve_tangent(token, curve, from), along(curve.c2, curve.c3, from * three), curve.c3);
    for i in 0..3 {
        c1[i] = c1[i] * w;
        c2[i] = c2[i] * (w * w);
        c3[i] = c3[i] * (w * w * w);
    }
    let c2_end = along(c2, c3, three);
    // The sagitta of a chord is an eighth of the largest second derivative.
    let sagitta = dot(c2, c2).max(dot(c2_end, c2_end)).sqrt() * L::constant(token, 0.25);
    let chords = -(-(sagitta / tolerance).sqrt()).floor();
    let chords = chords.max(one).min(L::constant(token, f64::from(MAX_CHORDS)));
    Curve { start: curve_point(curve, from), c1, c2, c3, chords }
}

/// Point where the chords of the curve were hit at parameter `t`.
#[inline(always)]
pub fn hit_position(curve: &Curve<f32>, t: f32) -> Vec3 {
    if curve.chords == 1.0 {
        return Vec3::from(curve.start) + Vec3::from(whole_chord(curve)) * t;
    }
    let count = curve.chords;
    let j = (t * count).floor().min(count - 1.0);
    let from = Vec3::from(curve_point(curve, j / count));
    let to = Vec3::from(curve_point(curve, (j + 1.0) / count));
    from + (to - from) * (t * count - j)
}

/// How far the chords of the curve stray from its whole chord at equal s, down and up along each axis: not at all if there is only one.
/// Their ends are on the curve, and nowhere do they stray farther than these. The curve is -s (1 - s) (c2 + c3 (1 + s)) from its chord.
#[inline(always)]
pub fn deviation<L: Lane>(token: L::Token, curve: &Curve<L>) -> ([L; 3], [L; 3]) {
    let (zero, two) = (L::constant(token, 0.0), L::constant(token, 2.0));
    let quarter = L::select(L::constant(token, 1.0).lt(curve.chords), L::constant(token, 0.25), zero);
    let (mut down, mut up) = (curve.c2, curve.c2);
    for i in 0..3 {
        let first = curve.c2[i] + curve.c3[i];
        let last = curve.c3[i].mul_add(two, curve.c2[i]);
        down[i] = first.max(last).max(zero) * quarter;
        up[i] = (-first.min(last)).max(zero) * quarter;
    }
    (down, up)
}
