//! The clearance grid: how far a ray may go before it can meet anything.
//!
//! The grid is nested (a clipmap). All levels have the same number of cells; each is the one before halved about the focus, so cells are
//! small near it, where steps are short. A lookup takes the finest level that holds the point. Positions are given from the focus in
//! cells of the coarsest level: on level l they are 2^l times that, and the focus has the same place among the cells of every level.

use super::constants::*;
use super::curve::{Curve, curve_point};
use super::integrator::along;
use super::triangle::dot;
use super::view::SceneView;
use crate::simd::Lane;

/// Lower bound of the distance from a point to the nearest geometry, both in cells of the coarsest level: what the point's cell says,
/// or outside of the grid the distance to the box that holds all geometry.
#[inline(always)]
pub fn clearance_at<L: Lane>(token: L::Token, view: &SceneView, position: [L; 3]) -> L {
    let scene = view.scene;
    let (zero, one) = (L::constant(token, 0.0), L::constant(token, 1.0));

    // See how far out the point is, as a share of the coarsest level; each axis by itself, since what is not a number is outside.
    let mut shares = [zero; 3];
    for (i, p) in position.into_iter().enumerate() {
        let above = p * L::constant(token, f64::from(scene.grid_reach_high[i]));
        let below = p * L::constant(token, -f64::from(scene.grid_reach_low[i]));
        shares[i] = above.max(below);
    }
    let inside = L::both(L::both(shares[0].lt(one), shares[1].lt(one)), shares[2].lt(one));
    let share = shares[0].max(shares[1]).max(shares[2]);

    // Take the finest level that holds it.
    let [nx, ny, nz] = scene.grid_size;
    let size = [f64::from(nx), f64::from(ny), f64::from(nz)];
    let cells = f64::from(nx * ny * nz);
    let (mut first, mut scale, mut unit) = (zero, one, L::constant(token, 0.25));
    for level in 1..GRID_LEVELS {
        let ratio = f64::from(1u32 << level);
        let held = share.lt(L::constant(token, 1.0 / ratio));
        first = L::select(held, L::constant(token, f64::from(level) * cells), first);
        scale = L::select(held, L::constant(token, ratio), scale);
        unit = L::select(held, L::constant(token, 0.25 / ratio), unit);
    }

    // Look its cell up; rounding must not lead beyond the last one or the first.
    let mut cell = [zero; 3];
    for (i, p) in position.into_iter().enumerate() {
        let focus = L::constant(token, f64::from(scene.grid_focus_cell[i]));
        cell[i] = p.mul_add(scale, focus).floor().min(L::constant(token, size[i] - 1.0)).max(zero);
    }
    let row = cell[2].mul_add(L::constant(token, size[1]), cell[1]);
    let flat = row.mul_add(L::constant(token, size[0]), cell[0]) + first;
    let index = L::select(inside, flat, zero);
    let found = index.gather(view.clearance) * unit;
    if L::bits(inside) == (1 << L::LANES) - 1 { found } else { L::select(inside, found, bounds_distance(token, view, position)) }
}

/// Largest distance along an axis from a point to the box that holds all geometry, 0 inside; in cells of the coarsest level.
#[inline(always)]
pub fn bounds_distance<L: Lane>(token: L::Token, view: &SceneView, position: [L; 3]) -> L {
    let mut distance = L::constant(token, 0.0);
    for (i, p) in position.into_iter().enumerate() {
        let low = L::constant(token, f64::from(view.scene.bounds_low[i]));
        let high = L::constant(token, f64::from(view.scene.bounds_high[i]));
        distance = distance.max(low - p).max(p - high);
    }
    distance
}

/// A curve from the focus of the grid, in cells of its coarsest level.
#[inline(always)]
pub fn grid_curve<L: Lane>(token: L::Token, view: &SceneView, curve: &Curve<L>) -> Curve<L> {
    let scale = L::constant(token, f64::from(view.scene.grid_inverse_cell));
    let mut scaled = *curve;
    for i in 0..3 {
        scaled.start[i] = (curve.start[i] - L::constant(token, f64::from(view.scene.grid_focus[i]))) * scale;
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

/// The span (from, to) of the curve parameter outside which nothing can be met, empty (from >= to) if that is everywhere, and a lower
/// bound of the clearance at the end; `room` is one of that at the start. What a lane gets does not depend on the others.
///
/// First the middle: all of a curve lies within half its control polygon of the middle of its chord. Then both ends: from there the curve
/// may go on by the clearance before it can meet anything.
#[inline(always)]
pub fn occupied_span<L: Lane>(token: L::Token, view: &SceneView, curve: &Curve<L>, room: L, wanted: u32) -> (L, L, L) {
    let (zero, one) = (L::constant(token, 0.0), L::constant(token, 1.0));
    let inner = along(curve.c1, curve.c2, one);
    let chord = along(inner, curve.c3, one);
    let end_tangent = along(along(inner, curve.c2, one), curve.c3, L::constant(token, 3.0));
    // Three times the legs of the control polygon, which are also the control points of the derivative.
    let legs = [grid_length(curve.c1), grid_length(inner), grid_length(end_tangent)];
    let half_polygon = (legs[0] + legs[1] + legs[2]) * L::constant(token, (1.0 + f64::from(CHORD_SLACK)) / 6.0);
    let middle = clearance_at(token, view, along(curve.start, chord, L::constant(token, 0.5)));
    let blocked = middle.lt(half_polygon);
    let beside = (middle - half_polygon).max(zero);
    if L::bits(blocked) & wanted == 0 {
        return (one, one, beside);
    }
    let rate = one / legs[0].max(legs[1]).max(legs[2]);
    let least = L::constant(token, f64::from(LEAST_GAIN));
    let end_room = clearance_at(token, view, curve_point(curve, one));
    let (gain, loss) = (room * rate, end_room * rate);
    let from = L::select(gain.lt(least), zero, gain.min(one));
    let to = L::select(loss.lt(least), one, (one - loss).max(from));
    (L::select(blocked, from, one), to, L::select(blocked, end_room, beside))
}
