//! The clearance grid: how far a ray may go before it can meet anything.

use super::bvh::{Curve, curve_point, curve_speed, curve_tangent};
use super::constants::*;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2};

/// Lower bound of the distance from a point to the nearest geometry, both in cells of the grid; 0 where nothing is known.
#[inline(always)]
pub fn clearance_at(view: &SceneView, cell: Vec3) -> f32 {
    let [nx, ny, nz] = view.scene.grid_size;
    // A negative coordinate turns into 0 in Rust and must not pass for the first cell.
    let low = cell.x.min(cell.y).min(cell.z);
    let (x, y, z) = (cell.x as u32, cell.y as u32, cell.z as u32);
    if low < 0.0 || x >= nx || y >= ny || z >= nz {
        return 0.0;
    }
    view.clearance((z * ny + y) * nx + x) * 0.25
}

/// The span (from, to) of the curve parameter outside which nothing can be met; empty (from >= to) if that is everywhere.
///
/// First the middle: all of a curve lies within half its control polygon of the middle of its chord. Then a march from
/// both ends: at every point the curve may go on by the clearance there before it can meet anything.
#[inline(always)]
pub fn occupied_span(view: &SceneView, curve: &Curve) -> Vec2 {
    let scale = view.scene.grid_inverse_cell;
    let mut grid_curve = *curve;
    grid_curve.start = (curve.start - Vec3::from(view.scene.grid_min)) * scale;
    grid_curve.c1 = curve.c1 * scale;
    grid_curve.c2 = curve.c2 * scale;
    grid_curve.c3 = curve.c3 * scale;
    let end = curve_point(&grid_curve, 1.0);
    let polygon = grid_curve.c1.length() + curve_tangent(&grid_curve, 1.0).length() + (end - grid_curve.start).length();
    if clearance_at(view, (grid_curve.start + end) * 0.5) >= 0.5 * polygon {
        return vec2(1.0, 1.0);
    }
    let rate = 1.0 / curve_speed(&grid_curve);
    let mut from = 0.0;
    for _ in 0..MARCH_STEPS {
        let gain = clearance_at(view, curve_point(&grid_curve, from)) * rate;
        if gain < MARCH_GAIN {
            break;
        }
        from += gain;
        if from >= 1.0 {
            return vec2(1.0, 1.0);
        }
    }
    let mut to = 1.0;
    for _ in 0..MARCH_STEPS {
        let gain = clearance_at(view, curve_point(&grid_curve, to)) * rate;
        if gain < MARCH_GAIN || to <= from {
            break;
        }
        to -= gain;
    }
    vec2(from, to)
}
