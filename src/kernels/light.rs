//! Directions towards emitters, and radiance of the environment.
//!
//! Light sampling chooses *directions* in which a light would appear if light went straight from where it appears to be, which a table
//! tells where space is bent (`world/aim.rs`). The mixture with BSDF sampling (`path.rs`) weights by density over directions, so it stays
//! unbiased however the rays bend; a table that is wrong only costs efficiency.

use super::constants::*;
use super::layout::{EnvironmentParameters, Light};
use super::primitive::intersect_quad;
use super::sampling::{sin_cos_turns, spherical_direction, world_from_frame};
use super::texture::sample_texture;
use super::view::SceneView;
use crate::simd::{Lane, MAX_LANES, Vector, by_lane, store, vector};
use glam::{Vec2, Vec3, Vec4, vec2, vec3};

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
pub fn sphere_cap<L: Lane<Real = f32>>(token: L::Token, light: &Light, position: Vector<L>) -> L {
    let one = L::splat(token, 1.0);
    let to_center = Vector::constant(token, light.position) - position;
    let sin2 = L::splat(token, light.size * light.size) / to_center.dot(to_center);
    L::select(sin2.lt(one), sin2 / (one + (one - sin2).sqrt()), L::splat(token, 2.0))
}

/// A direction towards the light, by `u` uniform in the unit square. Its density is `light_pdf`.
#[inline(always)]
pub fn sample_light<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, light: &Light, position: Vector<L>, u: [L; 2]) -> Vector<L> {
    let c = |value: f32| L::splat(token, value);
    if light.kind == LIGHT_ENVIRONMENT {
        let (u, v) = (store(u[0]), store(u[1]));
        return Vector::by_lane(token, |i| sample_environment(view, vec2(u[i], v[i])).into());
    }
    let origin = Vector::constant(token, light.position);
    if light.kind == LIGHT_SPHERE {
        let cap = sphere_cap(token, light, position);
        let local = spherical_direction(token, c(1.0) - u[0] * cap, u[1]);
        let outside = cap.lt(c(2.0));
        let axis = Vector::select(outside, (origin - position).normalize(token), vector(c(0.0), c(0.0), c(1.0)));
        return world_from_frame(token, axis, local);
    }
    let mut s = u;
    if light.kind == LIGHT_TRIANGLE {
        let root = u[0].sqrt();
        s = [c(1.0) - root, u[1] * root];
    }
    let point = origin + Vector::constant(token, light.edge_u) * s[0] + Vector::constant(token, light.edge_v) * s[1];
    (point - position).normalize(token)
}

/// Density of `sample_light` at `direction` (1/sr).
#[inline(always)]
pub fn light_pdf<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, light: &Light, position: Vector<L>, direction: Vector<L>) -> L {
    let c = |value: f32| L::splat(token, value);
    let zero = c(0.0);
    if light.kind == LIGHT_ENVIRONMENT {
        let [x, y, z] = direction.rows();
        return by_lane(token, |i| environment_pdf(view, vec3(x[i], y[i], z[i])));
    }
    let origin = Vector::constant(token, light.position);
    if light.kind == LIGHT_SPHERE {
        let cap = sphere_cap(token, light, position);
        let to_center = origin - position;
        let along = to_center.dot(direction);
        let offset = to_center - direction * along;
        let towards = L::both(zero.lt(along), offset.dot(offset).lt(c(light.size * light.size)));
        let density = c(1.0) / (c(TAU) * cap);
        return L::select(towards, density, L::select(cap.lt(c(2.0)), zero, density));
    }
    let edge_u = Vector::constant(token, light.edge_u);
    let edge_v = Vector::constant(token, light.edge_v);
    let found = intersect_quad(token, position, direction, origin, edge_u, edge_v, c(FAR));
    let mut met = zero.lt(found.x);
    if light.kind == LIGHT_TRIANGLE {
        met = L::both(met, (found.y + found.z).lt(c(1.0)));
    }
    let cosine = edge_u.cross(edge_v).normalize(token).dot(direction);
    let area = cosine.max(-cosine) * c(light.size);
    L::select(met, found.x * found.x / area.max(c(1e-20)), zero)
}

/// The middle of a sphere, a quad or a triangle.
#[inline(always)]
pub fn light_center(light: &Light) -> Vec3 {
    let edges = Vec3::from(light.edge_u) + Vec3::from(light.edge_v);
    Vec3::from(light.position) + edges * if light.kind == LIGHT_TRIANGLE { 1.0 / 3.0 } else { 0.5 }
}

/// Where a point is in the table of apparent lights.
#[derive(Clone, Copy, Debug)]
pub struct AimCell {
    /// Entry of the first light in the lowest of the eight cells around the point; `NO_INDEX` beyond the table.
    pub first: u32,
    /// Weight of the upper cells along each axis.
    pub upper: Vec3,
}

/// Finds a point in the finest level of the table that holds it.
#[inline(always)]
pub fn aim_cell(view: &SceneView, position: Vec3) -> AimCell {
    let scene = view.scene;
    let mut p = (position - Vec3::from(scene.aim_focus)) * scene.aim_scale;
    if scene.aim_scale == 0.0 || !p.abs().cmplt(Vec3::ONE).all() {
        return AimCell { first: NO_INDEX, upper: Vec3::ZERO };
    }
    let mut level = 0;
    while level + 1 < AIM_LEVELS && p.abs().max_element() < 0.5 {
        p *= 2.0;
        level += 1;
    }
    let side = AIM_SIDE as f32;
    let q = ((p * 0.5 + 0.5) * side - 0.5).clamp(Vec3::ZERO, Vec3::splat(side - 1.0));
    let lower = q.floor().min(Vec3::splat(side - 2.0));
    let cell = lower.as_uvec3();
    let number = ((level * AIM_SIDE + cell.z) * AIM_SIDE + cell.y) * AIM_SIDE + cell.x;
    AimCell { first: number * scene.light_count, upper: q - lower }
}

/// By how much light number `index` appears to be shifted (xyz), and by what share it appears to be larger (w).
#[inline(always)]
pub fn apparent_light(view: &SceneView, cell: &AimCell, index: u32) -> Vec4 {
    if cell.first == NO_INDEX {
        return Vec4::ZERO;
    }
    let stride = view.scene.light_count;
    let upper = cell.upper;
    let row = |at: u32| view.aim(at) * (1.0 - upper.x) + view.aim(at + stride) * upper.x;
    let layer = |at: u32| row(at) * (1.0 - upper.y) + row(at + stride * AIM_SIDE) * upper.y;
    let first = cell.first + index;
    layer(first) * (1.0 - upper.z) + layer(first + stride * AIM_SIDE * AIM_SIDE) * upper.z
}

/// A point that lights are seen from, or one per lane.
pub struct Vantage<L> {
    /// The point.
    pub position: Vector<L>,
    /// Where it is in the table of apparent lights.
    pub cells: [AimCell; MAX_LANES],
}

impl<L: Lane<Real = f32>> Vantage<L> {
    /// Finds the point in the table.
    #[inline(always)]
    pub fn new(view: &SceneView, position: Vector<L>) -> Self {
        let mut cells = [AimCell { first: NO_INDEX, upper: Vec3::ZERO }; MAX_LANES];
        if view.scene.aim_scale != 0.0 {
            let [x, y, z] = position.rows();
            for (lane, cell) in cells[..L::LANES].iter_mut().enumerate() {
                *cell = aim_cell(view, vec3(x[lane], y[lane], z[lane]));
            }
        }
        Vantage { position, cells }
    }
}

/// The point from which light number `index` would look as it does from `from`, if its light went straight: all of light sampling takes
/// place there. Only in the lanes that are `wanted`.
#[inline(always)]
pub fn apparent_position<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, index: u32, from: &Vantage<L>, wanted: u32) -> Vector<L> {
    if view.scene.aim_scale == 0.0 {
        return from.position;
    }
    let mut rows = [[0.0; MAX_LANES]; 4];
    for (lane, cell) in from.cells[..L::LANES].iter().enumerate() {
        if wanted >> lane & 1 == 1 {
            let apparent = apparent_light(view, cell, index);
            for (row, value) in rows.iter_mut().zip(apparent.to_array()) {
                row[lane] = value;
            }
        }
    }
    let center = Vector::constant(token, light_center(view.light(index)).into());
    let shift = vector(L::load(token, &rows[0]), L::load(token, &rows[1]), L::load(token, &rows[2]));
    let one = L::splat(token, 1.0);
    center + (from.position - shift - center) * (one / (one + L::load(token, &rows[3])))
}

/// A direction towards a light, by `u` uniform in the unit square; only in the lanes that are `wanted`, what the others get means nothing.
/// One of many is chosen by `choice`, uniform in [0, 1), one of a few by a share of `u`. Shaders choose a light first and call
/// `sample_light`.
#[inline(always)]
pub fn sample_lights<L: Lane<Real = f32>>(
    token: L::Token,
    view: &SceneView,
    wanted: L::Mask,
    choice: L,
    from: &Vantage<L>,
    u: [L; 2],
) -> Vector<L> {
    let count = view.scene.light_count;
    if count > MAX_SUMMED_LIGHTS {
        let (choice, [x, y, z], u, v) = (store(choice), from.position.rows(), store(u[0]), store(u[1]));
        let wanted = L::bits(wanted);
        return Vector::by_lane(token, |i| {
            if wanted >> i & 1 == 0 {
                return vector(0.0, 0.0, 1.0);
            }
            let light = view.light(choose_light(view, choice[i]));
            sample_light((), view, light, vector(x[i], y[i], z[i]), [u[i], v[i]])
        });
    }
    let (mut direction, mut todo, mut before) = (from.position, L::bits(wanted), 0.0);
    for i in 0..count {
        let light = view.light(i);
        let below = L::bits(u[0].lt(L::splat(token, light.cumulative)));
        if todo & below != 0 {
            let share = (u[0] - L::splat(token, before)) * L::splat(token, 1.0 / (light.cumulative - before));
            let position = apparent_position(token, view, i, from, todo & below);
            let towards = sample_light(token, view, light, position, [share, u[1]]);
            direction = Vector::select(L::mask(token, todo & below), towards, direction);
        }
        todo &= !below;
        before = light.cumulative;
    }
    direction
}

/// Density (1/sr) with which light sampling draws `direction` when it has chosen a light by `choice`; shaders hand on the light instead.
///
/// With few lights this is the density over all of them, so that none is left to the surface's lobes alone; with many it
/// is that of the chosen one, which is as unbiased and costs the same however many there are.
#[inline(always)]
pub fn lights_pdf<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, choice: L, from: &Vantage<L>, direction: Vector<L>) -> L {
    let count = view.scene.light_count;
    if count > MAX_SUMMED_LIGHTS {
        let (choice, [x, y, z], [dx, dy, dz]) = (store(choice), from.position.rows(), direction.rows());
        return by_lane(token, |i| {
            let light = view.light(choose_light(view, choice[i]));
            light_pdf((), view, light, vector(x[i], y[i], z[i]), vector(dx[i], dy[i], dz[i]))
        });
    }
    let mut sum = L::splat(token, 0.0);
    let mut before = 0.0;
    for i in 0..count {
        let light = view.light(i);
        let share = L::splat(token, light.cumulative - before);
        sum = light_pdf(token, view, light, apparent_position(token, view, i, from, u32::MAX), direction).mul_add(share, sum);
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
    let [sin_polar, cos_polar] = sin_cos_turns((), t * 0.5);
    let turns = s - 0.5 - environment.angle / TAU;
    let [sin_around, cos_around] = sin_cos_turns((), turns - turns.floor());
    vec3(sin_around * sin_polar, cos_polar, -cos_around * sin_polar)
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
