//! Directions towards emitters, and radiance of the environment.
//!
//! Light sampling chooses *directions* in which a light would appear if light went straight. The mixture with BSDF sampling
//! (`path.rs`) weights by density over directions, so it stays unbiased however the rays bend; bending only costs efficiency.

use super::constants::*;
use super::layout::{EnvironmentParameters, Light};
use super::primitive::intersect_quad;
use super::sampling::{sin_cos_turns, spherical_direction, world_from_frame};
use super::texture::sample_texture;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2, vec3};

/// Index of the light chosen by the uniform number `u`.
#[inline(always)]
pub fn choose_light(view: &SceneView, u: f32) -> u32 {
    let mut low = 0;
    let mut high = view.scene.light_count - 1;
    while low < high {
        let middle = (low + high) / 2;
        if u < view.light(middle).cumulative {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// 1 - cos of the half angle under which a sphere appears; 2 from inside.
#[inline(always)]
pub fn sphere_cap(light: &Light, position: Vec3) -> f32 {
    let distance2 = (Vec3::from(light.position) - position).length_squared();
    let sin2 = light.size * light.size / distance2;
    if sin2 >= 1.0 { 2.0 } else { sin2 / (1.0 + (1.0 - sin2).sqrt()) }
}

/// A direction towards the light, by `u` uniform in the unit square. Its density is `light_pdf`.
#[inline(always)]
pub fn sample_light(view: &SceneView, light: &Light, position: Vec3, u: Vec2) -> Vec3 {
    if light.kind == LIGHT_ENVIRONMENT {
        return sample_environment(view, u);
    }
    let origin = Vec3::from(light.position);
    if light.kind == LIGHT_SPHERE {
        let cap = sphere_cap(light, position);
        let local = spherical_direction(1.0 - u.x * cap, u.y);
        let to_center = origin - position;
        let axis = if cap == 2.0 { vec3(0.0, 0.0, 1.0) } else { to_center.normalize() };
        return world_from_frame(axis, local);
    }
    let mut s = u;
    if light.kind == LIGHT_TRIANGLE {
        let root = u.x.sqrt();
        s = vec2(1.0 - root, u.y * root);
    }
    let point = origin + Vec3::from(light.edge_u) * s.x + Vec3::from(light.edge_v) * s.y;
    (point - position).normalize()
}

/// Density of `sample_light` at `direction` (1/sr).
#[inline(always)]
pub fn light_pdf(view: &SceneView, light: &Light, position: Vec3, direction: Vec3) -> f32 {
    if light.kind == LIGHT_ENVIRONMENT {
        return environment_pdf(view, direction);
    }
    let origin = Vec3::from(light.position);
    if light.kind == LIGHT_SPHERE {
        let cap = sphere_cap(light, position);
        let to_center = origin - position;
        let distance2 = to_center.length_squared();
        let offset = to_center - direction * to_center.dot(direction);
        let inside = cap == 2.0;
        let towards = to_center.dot(direction) > 0.0 && offset.length_squared() <= light.size * light.size;
        return if inside || (towards && distance2 > 0.0) { 1.0 / (TAU * cap) } else { 0.0 };
    }
    let edge_u = Vec3::from(light.edge_u);
    let edge_v = Vec3::from(light.edge_v);
    let found = intersect_quad(position, direction, origin, edge_u, edge_v, FAR);
    if found.x <= 0.0 || (light.kind == LIGHT_TRIANGLE && found.y + found.z > 1.0) {
        return 0.0;
    }
    let normal = edge_u.cross(edge_v).normalize();
    found.x * found.x / (normal.dot(direction).abs() * light.size).max(1e-20)
}

/// Density (1/sr) with which light sampling draws `direction` when it has chosen light number `chosen`.
///
/// With few lights this is the density over all of them, so that none is left to the surface's lobes alone; with many it
/// is that of the chosen one, which is as unbiased and costs the same however many there are.
#[inline(always)]
pub fn lights_pdf(view: &SceneView, chosen: u32, position: Vec3, direction: Vec3) -> f32 {
    let count = view.scene.light_count;
    if count > MAX_SUMMED_LIGHTS {
        return light_pdf(view, view.light(chosen), position, direction);
    }
    let mut sum = 0.0;
    let mut before = 0.0;
    for i in 0..count {
        let light = view.light(i);
        sum += (light.cumulative - before) * light_pdf(view, light, position, direction);
        before = light.cumulative;
    }
    sum
}

/// Position of a direction on an equirectangular image, (0, 0) at the lower left.
#[inline(always)]
pub fn environment_uv(environment: &EnvironmentParameters, direction: Vec3) -> Vec2 {
    let azimuth = direction.x.atan2(-direction.z) + environment.angle;
    vec2(azimuth / TAU + 0.5, 1.0 - direction.y.clamp(-1.0, 1.0).acos() * INV_PI)
}

/// Radiance of a regular grid of lines on the sky.
#[inline(always)]
pub fn grid_radiance(environment: &EnvironmentParameters, direction: Vec3) -> Vec3 {
    let spacing = environment.angle;
    let polar = direction.y.clamp(-1.0, 1.0).acos() / spacing;
    let azimuth = direction.x.atan2(-direction.z) / spacing;
    let from_polar = (polar - (polar + 0.5).floor()).abs() * spacing;
    let from_azimuth = (azimuth - (azimuth + 0.5).floor()).abs() * spacing;
    let sin_polar = (1.0 - direction.y * direction.y).max(0.0).sqrt();
    let on_line = from_polar < 0.5 * environment.scale || from_azimuth * sin_polar < 0.5 * environment.scale;
    if on_line {
        return environment.color.into();
    }
    let north = Vec3::from(environment.horizon);
    let south = Vec3::from(environment.nadir);
    if direction.y > 0.0 { north } else { south }
}

/// Radiance that arrives from the unit direction at infinity of one side.
#[inline(always)]
pub fn environment_radiance(view: &SceneView, environment: &EnvironmentParameters, direction: Vec3) -> Vec3 {
    let color = Vec3::from(environment.color);
    if environment.kind == ENVIRONMENT_CONSTANT {
        return color;
    }
    if environment.kind == ENVIRONMENT_GRADIENT {
        let horizon = Vec3::from(environment.horizon);
        let end = if direction.y > 0.0 { color } else { Vec3::from(environment.nadir) };
        return horizon + (end - horizon) * direction.y.abs().sqrt();
    }
    if environment.kind == ENVIRONMENT_GRID {
        return grid_radiance(environment, direction);
    }
    let texel = sample_texture(view, environment.texture_index, environment_uv(environment, direction));
    vec3(texel.x, texel.y, texel.z) * environment.scale
}

/// Index of the interval of a cumulative table of `count` entries from `first` that holds `u`.
#[inline(always)]
pub fn search_cdf(view: &SceneView, first: u32, count: u32, u: f32) -> u32 {
    let mut low = 0;
    let mut high = count - 1;
    while low < high {
        let middle = (low + high) / 2;
        if u < view.environment_cdf(first + middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// Direction distributed as the brightness of the environment image of the near side.
#[inline(always)]
pub fn sample_environment(view: &SceneView, u: Vec2) -> Vec3 {
    let environment = &view.scene.environment[0];
    let (columns, rows) = (environment.columns, environment.rows);
    let row = search_cdf(view, 0, rows, u.y);
    let row_low = if row == 0 { 0.0 } else { view.environment_cdf(row - 1) };
    let row_high = view.environment_cdf(row);
    let first = rows + row * columns;
    let column = search_cdf(view, first, columns, u.x);
    let low = if column == 0 { 0.0 } else { view.environment_cdf(first + column - 1) };
    let high = view.environment_cdf(first + column);
    let s = (column as f32 + ((u.x - low) / (high - low)).clamp(0.0, 1.0)) / columns as f32;
    let t = (row as f32 + ((u.y - row_low) / (row_high - row_low)).clamp(0.0, 1.0)) / rows as f32;
    // Rows count from the zenith.
    let polar = sin_cos_turns(t * 0.5);
    let turns = s - 0.5 - environment.angle / TAU;
    let around = sin_cos_turns(turns - turns.floor());
    vec3(around.x * polar.x, polar.y, -around.y * polar.x)
}

/// Density of `sample_environment` (1/sr).
#[inline(always)]
pub fn environment_pdf(view: &SceneView, direction: Vec3) -> f32 {
    let environment = &view.scene.environment[0];
    let (columns, rows) = (environment.columns, environment.rows);
    let uv = environment_uv(environment, direction);
    let column = (((uv.x - uv.x.floor()) * columns as f32) as u32).min(columns - 1);
    let row = (((1.0 - uv.y) * rows as f32) as u32).min(rows - 1);
    let first = rows + row * columns;
    let of_row = view.environment_cdf(row) - if row == 0 { 0.0 } else { view.environment_cdf(row - 1) };
    let of_column = view.environment_cdf(first + column) - if column == 0 { 0.0 } else { view.environment_cdf(first + column - 1) };
    let sin_polar = (1.0 - direction.y * direction.y).max(1e-8).sqrt();
    of_row * of_column * (columns * rows) as f32 / (TAU * PI * sin_polar)
}
