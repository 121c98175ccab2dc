//! What is seen at a pixel, and the way its light came.

use super::lane::Lane;
use super::model::Pick;
use crate::backend::path::trace_path;
use crate::backend::{Stop, TraceOptions, TraceRay};
use crate::error::Result;
use crate::kernels::camera::camera_ray;
use crate::kernels::constants::{STATUS_CAPTURED, STATUS_ESCAPED, STATUS_EXHAUSTED, STATUS_HIT};
use crate::scene::{Geometry, Scene};
use glam::{DVec3, Vec3, vec2};

/// Points of a path: more would not be seen, and every one costs a ray.
const POINTS: u32 = 96;
/// Where paths of rays that escape are left, in distances of the target.
const FAR: f64 = 50.0;
/// Least error allowed per step, in scene units.
const LEAST_TOLERANCE: f64 = 1e-6;

/// Follows the ray through the middle of a pixel of a window of this size; its path ends early once `go_on` says no.
pub fn pick(lane: &mut Lane, pixel: (u32, u32), (width, height): (u32, u32), go_on: impl FnMut() -> bool) -> Result<Option<Pick>> {
    let Some((backend, scene, world)) = lane.parts() else { return Ok(None) };
    let mut parameters = world.parameters_for(scene)?;
    // The ray through the middle of the lens.
    parameters.aperture_radius = 0.0;
    let film = vec2(parameters.film_width as f32, parameters.film_height as f32);
    let at = vec2(pixel.0 as f32 + 0.5, pixel.1 as f32 + 0.5) / vec2(width as f32, height as f32) * film;
    let (origin, direction, _) = camera_ray((), &parameters, at.to_array(), [0.5; 2]);
    let (origin, direction) = (Vec3::from(origin).as_dvec3(), Vec3::from(direction).as_dvec3());
    // The error that a pixel of the window allows at the distance of the target.
    let width_there = f64::from(parameters.pixel_spread) * f64::from(film.y) / f64::from(height) * scene.camera.focus_distance;
    let tolerance = (scene.integrator.tolerance * width_there).max(LEAST_TOLERANCE);
    let options = TraceOptions { tolerance, stop: Stop::Never, max_steps: Some(scene.integrator.max_steps) };
    let ray = TraceRay::looking(origin.to_array(), direction.to_array());
    let Some((end, mut path)) = trace_path(backend, &ray, options, POINTS, go_on)? else { return Ok(None) };
    if end.status == STATUS_ESCAPED && path.last() == Some(&end.position) {
        // It ends where light no longer bends: straight on to where any map is left.
        let far = FAR * scene.camera.focus_distance;
        path.retain(|p| DVec3::from(*p).distance(origin) <= far);
        let last = path.last().map_or(origin, |p| DVec3::from(*p));
        path.push((last + DVec3::from(end.direction) * far).to_array());
    }
    let finite = |v: f64| if v.is_finite() { v } else { 0.0 };
    let shape = end.object.and_then(|object| scene.shapes.get(object as usize));
    Ok(Some(Pick {
        pixel,
        status: end.status,
        object: end.object,
        object_name: shape.map_or_else(|| place(end.status, end.side), |shape| form(&shape.geometry)).into(),
        material: shape.map_or_else(String::new, |shape| material_name(scene, shape.material)),
        redshift: finite(1.0 / end.frequency_ratio),
        steps: end.steps,
        chords: end.chords,
        length: finite(end.length),
        position: end.position.map(finite),
        path,
    }))
}

/// Where a ray ended that hit nothing.
fn place(status: u32, side: i32) -> &'static str {
    match status {
        STATUS_HIT => "surface",
        STATUS_ESCAPED if side < 0 => "sky of the far side",
        STATUS_ESCAPED => "sky",
        STATUS_CAPTURED => "horizon",
        STATUS_EXHAUSTED => "ran out of steps",
        _ => "nothing",
    }
}

fn form(geometry: &Geometry) -> &'static str {
    match geometry {
        Geometry::Sphere { .. } => "sphere",
        Geometry::Box { .. } => "box",
        Geometry::Quad { .. } => "quad",
        Geometry::Disc { .. } => "disc",
        Geometry::AccretionDisc(_) => "accretion disc",
        Geometry::Mesh(_) => "mesh",
    }
}

fn material_name(scene: &Scene, material: usize) -> String {
    scene.materials.get(material).map_or_else(String::new, |m| m.name.clone())
}
