//! The clearance grid: how far a ray may go before it can meet anything.

use super::bvh::{Curve, curve_point};
use super::constants::*;
use super::integrator::along;
use super::triangle::dot;
use super::view::SceneView;
use crate::simd::Lane;

/// Lower bound of the distance from a point to the nearest geometry, both in cells of the grid: what the cell says, or outside of the
/// grid the distance to the box that holds all geometry.
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
    let found = L::select(inside, index.gather(view.clearance) * L::constant(token, 0.25), zero);
    if L::bits(outside) == 0 { found } else { L::select(outside, bounds_distance(token, view, cell), found) }
}

/// Largest distance along an axis from a point to the box that holds all geometry, 0 inside.
#[inline(always)]
pub fn bounds_distance<L: Lane>(token: L::Token, view: &SceneView, cell: [L; 3]) -> L {
    let mut distance = L::constant(token, 0.0);
    for (i, c) in cell.into_iter().enumerate() {
        let low = L::constant(token, f64::from(view.scene.bounds_low[i]));
        let high = L::constant(token, f64::from(view.scene.bounds_high[i]));
        distance = distance.max(low - c).max(c - high);
    }
    distance
}

/// A curve in cells of the grid.
#[inline(always)]
pub fn grid_curve<L: Lane>(token: L::Token, view: &SceneView, curve: &Curve<L>) -> Curve<L> {
    let scale = L::constant(token, f64::from(view.scene.grid_inverse_cell));
    let mut scaled = *curve;
    for i in 0..3 {
        scaled.start[i] = (curve.start[i] - L::constant(token, f64::from(view.scene.grid_min[i]))) * scale;
        scaled.c1[i] = curve.c1[i] * scale;
        scaled.c2[i] = curve.c2[i] * scale;
        scaled.c3[i] = curve.c3[i] * scale;
    }
    scaled
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
pub fn occupied_span<L: Lane>(token: L::Token, view: &SceneView, curve: &Curve<L>, wanted: u32) -> (L, L) {
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
        let gain = clearance_at(token, view, curve_point(curve, from)) * rate;
        from = L::select(gain.lt(least), from, (from + gain).min(one));
        let loss = clearance_at(token, view, curve_point(curve, to)) * rate;
        to = L::select(loss.lt(least), to, to - loss);
    }
    (L::select(blocked, from, one), to.max(from))
}
