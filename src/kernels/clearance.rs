//! The clearance grid: how far a ray may go before it can meet anything.

use super::constants::*;
use super::integrator::along;
use super::triangle::dot;
use super::view::SceneView;
use crate::simd::Lane;

/// A cubic x(s) = start + c1 s + c2 s^2 + c3 s^3 per lane, in cells of the grid.
#[derive(Clone, Copy)]
pub struct GridCurve<L> {
    /// Start point.
    pub start: [L; 3],
    /// Coefficient of s.
    pub c1: [L; 3],
    /// Coefficient of s^2.
    pub c2: [L; 3],
    /// Coefficient of s^3.
    pub c3: [L; 3],
}

/// Lower bound of the distance from a point to the nearest geometry, both in cells of the grid; 0 where nothing is known.
#[inline(always)]
pub fn clearance_at<L: Lane>(token: L::Token, view: &SceneView, cell: [L; 3]) -> L {
    let zero = L::constant(token, 0.0);
    let size = view.scene.grid_size.map(|n| L::constant(token, f64::from(n)));
    let low = cell[0].min(cell[1]).min(cell[2]);
    let room = (size[0] - cell[0]).min(size[1] - cell[1]).min(size[2] - cell[2]);
    let flat = (cell[2].floor().mul_add(size[1], cell[1].floor())).mul_add(size[0], cell[0].floor());
    // One test for below 0 and for not below the size; what is not a number is outside too.
    let nearest = low.min(room - L::constant(token, 1e-6));
    let outside = nearest.lt(zero);
    let inside = L::constant(token, -1.0).lt(nearest);
    let index = L::select(outside, zero, L::select(inside, flat, zero));
    let found = index.gather(view.clearance) * L::constant(token, 0.25);
    L::select(outside, zero, L::select(inside, found, zero))
}

/// Point of the curve at parameter `s`.
#[inline(always)]
pub fn grid_point<L: Lane>(curve: &GridCurve<L>, s: L) -> [L; 3] {
    along(curve.start, along(curve.c1, along(curve.c2, curve.c3, s), s), s)
}

/// The curve from `start` to `end` with end tangents `tangent0` and `tangent1`, in cells of the grid.
#[inline(always)]
pub fn grid_curve<L: Lane>(
    token: L::Token,
    view: &SceneView,
    start: [L; 3],
    end: [L; 3],
    tangent0: [L; 3],
    tangent1: [L; 3],
) -> GridCurve<L> {
    let scale = L::constant(token, f64::from(view.scene.grid_inverse_cell));
    let mut curve = GridCurve { start, c1: tangent0, c2: start, c3: start };
    for i in 0..3 {
        let chord = (end[i] - start[i]) * scale;
        let (t0, t1) = (tangent0[i] * scale, tangent1[i] * scale);
        curve.start[i] = (start[i] - L::constant(token, f64::from(view.scene.grid_min[i]))) * scale;
        curve.c1[i] = t0;
        curve.c2[i] = chord * L::constant(token, 3.0) - t0 * L::constant(token, 2.0) - t1;
        curve.c3[i] = t0 + t1 - chord * L::constant(token, 2.0);
    }
    curve
}

/// Length of a vector per lane.
#[inline(always)]
pub fn grid_length<L: Lane>(v: [L; 3]) -> L {
    dot(v, v).sqrt()
}

/// The span (from, to) of the curve parameter outside which nothing can be met; empty (from >= to) if that is everywhere.
///
/// First the middle: all of a curve lies within half its control polygon of the middle of its chord. Then a march from
/// both ends: at every point the curve may go on by the clearance there before it can meet anything.
#[inline(always)]
pub fn occupied_span<L: Lane>(token: L::Token, view: &SceneView, curve: &GridCurve<L>, wanted: u32) -> (L, L) {
    let (zero, one) = (L::constant(token, 0.0), L::constant(token, 1.0));
    let half = L::constant(token, 0.5);
    let inner = along(curve.c1, curve.c2, one);
    let chord = along(inner, curve.c3, one);
    let end_tangent = along(along(inner, curve.c2, one), curve.c3, L::constant(token, 3.0));
    let first_length = grid_length(curve.c1);
    let last_length = grid_length(end_tangent);
    let polygon = first_length + last_length + grid_length(chord);
    let middle = clearance_at(token, view, along(curve.start, chord, half));
    let blocked = middle.lt(half * polygon);
    if L::bits(blocked) & wanted == 0 {
        return (one, one);
    }
    let rate = one / first_length.max(grid_length(inner)).max(last_length);
    let least = L::constant(token, f64::from(MARCH_GAIN));
    let (mut from, mut to) = (zero, one);
    for _ in 0..MARCH_STEPS {
        let gain = clearance_at(token, view, grid_point(curve, from)) * rate;
        from = L::select(gain.lt(least), from, (from + gain).min(one));
        let loss = clearance_at(token, view, grid_point(curve, to)) * rate;
        to = L::select(loss.lt(least), to, to - loss);
    }
    (L::select(blocked, from, one), to.max(from))
}
