//! The clearance grid: how far a ray may go before it can meet anything.

use super::bvh::{Curve, curve_point, curve_speed};
use super::constants::*;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2};

/// Lower bound of the distance from `position` to the nearest geometry; 0 where nothing is known.
#[inline(always)]
pub fn clearance_at(view: &SceneView, position: Vec3) -> f32 {
    let scene = view.scene;
    let cell = (position - Vec3::from(scene.grid_min)) / scene.grid_cell;
    let [nx, ny, nz] = scene.grid_size;
    let inside = cell.x >= 0.0
        && cell.y >= 0.0
        && cell.z >= 0.0
        && cell.x < nx as f32
        && cell.y < ny as f32
        && cell.z < nz as f32;
    if !inside {
        return 0.0;
    }
    let index = (cell.z as u32 * ny + cell.y as u32) * nx + cell.x as u32;
    view.clearance(index) * scene.grid_cell * 0.25
}

/// The span (from, to) of the curve parameter outside which nothing can be met; empty (from >= to) if that is everywhere.
///
/// Marches from both ends: at every point the curve may go on by the clearance there before it can meet anything.
#[inline(always)]
pub fn occupied_span(view: &SceneView, curve: &Curve) -> Vec2 {
    let rate = 1.0 / curve_speed(curve);
    let mut from = 0.0;
    for _ in 0..MARCH_STEPS {
        let gain = clearance_at(view, curve_point(curve, from)) * rate;
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
        let gain = clearance_at(view, curve_point(curve, to)) * rate;
        if gain < MARCH_GAIN || to <= from {
            break;
        }
        to -= gain;
    }
    vec2(from, to)
}
