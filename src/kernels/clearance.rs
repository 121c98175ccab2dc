//! The clearance grid: how far a ray may go before it can meet anything.

use super::view::SceneView;
use glam::Vec3;

/// Lower bound of the distance from `position` to the nearest geometry; 0 where nothing is known.
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
