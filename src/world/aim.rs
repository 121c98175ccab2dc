//! Where lights appear: the table that light sampling aims by where space is bent.
//!
//! A point P that is seen from x in the direction w appears at x + w |P - x|. For each light the table has by how much its center appears
//! to be shifted, and by what share the light appears to be larger, so that where it appears is covered. Both are averages over the cells
//! of a nested grid, each level half as large as the one before about the focus, of what rays from the light find there: first rays from
//! its center, then from all over it. They are a guess: whatever they say, the density of the directions drawn is known exactly
//! (`kernels/light.rs`). What stands in the way is not asked.

use super::World;
use super::bvh::primitive_bounds;
use crate::kernels::constants::*;
use crate::kernels::integrator::{ModelBlock, PointFunctions};
use crate::kernels::layout::Light;
use crate::kernels::light::light_center;
use crate::kernels::rng::random_pair;
use crate::spacetime::{Class, ModelKind};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::{Add, Div};

/// Rays for the shifts of all lights together, and most of one; as many again for their extent.
const RAYS: usize = 4096;
const MOST_RAYS: usize = 2048;
/// Most steps of a ray.
const STEPS: usize = 512;
/// Steps as shares of the cell they are in and of what the model allows, and the least as a share of the cell.
const CELL_SHARE: f64 = 0.5;
const SAFE_SHARE: f64 = 0.3;
const LEAST_SHARE: f64 = 1e-3;
/// Distance of the faces of the coarsest level from the focus, as a multiple of that of the furthest light or middle of a primitive, and
/// the least as a share of that of the furthest geometry. A light far away from all else makes the cells coarse for all.
const ROOM: f64 = 1.5;
const LEAST_ROOM: f64 = 0.1;
/// Of several images the one whose light came the shorter way is taken, if it is shorter by this factor.
const SHORTER: f64 = 0.8;
/// Shifts in a cell that differ by more than this share of the distance are of different images.
const ALIKE: f64 = 0.3;
/// How many cells far a shift is taken to where no ray came.
const REACH: usize = 3;
/// Growth of a light for each growth of the mean square of its extent, and the most there is.
const MARGIN: f64 = 1.5;
const MOST_GROWTH: f64 = 3.0;

const SIDE: usize = AIM_SIDE as usize;
const CELLS: usize = SIDE * SIDE * SIDE;

/// What rays from a light's center found in a cell.
#[derive(Clone, Copy, Default)]
struct Found {
    /// Sum of the shifts, and how many they are.
    sum: DVec3,
    count: f64,
    /// Length of the way to the first.
    length: f64,
}

/// What rays from all over a light found in a cell: sums of the squares of their distances from its center across the ray, where they
/// appear to come from and where they do.
#[derive(Clone, Copy, Default)]
struct Spread {
    apparent: f64,
    actual: f64,
}

/// A point on the way of a ray from a light.
struct Sighting {
    /// Where, and in which direction the light appears from there.
    x: DVec3,
    direction: DVec3,
    /// Length of the way.
    length: f64,
}

/// A light as rays start from it.
struct Source<'a> {
    functions: &'a PointFunctions<f64>,
    block: &'a ModelBlock<f64>,
    light: Light,
    center: DVec3,
}

/// The grid about its focus, `half` of its coarsest level from there to each face.
struct Grid {
    focus: DVec3,
    half: f64,
}

/// Fills the table, if there are lights to aim at and rays can be followed from them backwards.
pub(super) fn build(world: &mut World) {
    let (model, scene) = (world.model, &world.scene);
    let few = (1..=MAX_SUMMED_LIGHTS as usize).contains(&world.lights.len());
    let reversible = model.class() != Class::Flow && !model.moves_at_infinity() && world.parameters.throat == 0.0;
    if model == ModelKind::Flat || !few || !reversible || scene.region_radius <= 0.0 {
        return;
    }
    let _span = tracing::info_span!("aim", lights = world.lights.len()).entered();
    let focus = Vec3::from(scene.region_center).as_dvec3();
    // The sky has none.
    let center = |light: &Light| (light.kind != LIGHT_ENVIRONMENT).then(|| light_center(light).as_dvec3());
    let centers: Vec<Option<DVec3>> = world.lights.iter().map(center).collect();
    if centers.iter().all(Option::is_none) {
        return;
    }
    let furthest = |points: &mut dyn Iterator<Item = DVec3>| points.map(|p| (p - focus).abs().max_element()).fold(0.0, f64::max);
    let middles = world.primitives.iter().map(primitive_bounds).map(|(low, high)| (low + high).as_dvec3() / 2.0);
    let corners = [world.bounds.0, world.bounds.1].map(Vec3::as_dvec3);
    let least = LEAST_ROOM * furthest(&mut corners.into_iter());
    let half = (ROOM * furthest(&mut centers.iter().flatten().copied().chain(middles))).max(least);
    let grid = Grid { focus, half };
    let (functions, block) = (PointFunctions::<f64>::of(model), world.model_block::<f64>());
    let rays = (RAYS / world.lights.len()).min(MOST_RAYS);
    let tables: Vec<Vec<[f32; 4]>> = world
        .lights
        .par_iter()
        .zip(centers)
        .map(|(light, center)| match center {
            Some(center) => grid.table(&Source { functions: &functions, block: &block, light: *light, center }, rays),
            None => vec![[0.0; 4]; AIM_LEVELS as usize * CELLS],
        })
        .collect();
    world.aims = (0..AIM_LEVELS as usize * CELLS).flat_map(|cell| tables.iter().map(move |table| table[cell])).collect();
    world.scene.aim_focus = focus.as_vec3().into();
    world.scene.aim_scale = (1.0 / half) as f32;
}

impl Grid {
    /// The entries of one light, level after level.
    fn table(&self, source: &Source, rays: usize) -> Vec<[f32; 4]> {
        let mut found = vec![Found::default(); AIM_LEVELS as usize * CELLS];
        for i in 0..rays {
            source.follow(self, source.center, lattice(i, rays), |at| {
                let distance = at.x.distance(source.center);
                let shift = at.x + at.direction * distance - source.center;
                self.cells_of(at.x, |cell, size| found[cell].add(shift, at.length, ALIKE * distance + size));
            });
        }
        let shifts = complete(found.iter().map(|f| (f.count > 0.0).then(|| f.sum / f.count)).collect());
        let mut spreads = vec![Spread::default(); AIM_LEVELS as usize * CELLS];
        for i in 0..rays {
            let direction = lattice(i, rays);
            let offset = source.offset(i as u32, direction);
            source.follow(self, source.center + offset, direction, |at| {
                let distance = at.x.distance(source.center + offset);
                self.cells_of(at.x, |cell, size| {
                    let apart = across(at.x + at.direction * distance - source.center - shifts[cell], at.direction);
                    if apart.length() < ALIKE * distance + size {
                        spreads[cell].apparent += apart.length_squared();
                        spreads[cell].actual += across(offset, at.direction).length_squared();
                    }
                });
            });
        }
        let growth = |s: &Spread| (s.actual > 0.0).then(|| (MARGIN * ((s.apparent / s.actual).sqrt() - 1.0)).clamp(0.0, MOST_GROWTH));
        let growths = complete(spreads.iter().map(growth).collect());
        shifts.iter().zip(growths).map(|(shift, growth)| shift.as_vec3().extend(growth as f32).to_array()).collect()
    }

    /// Calls `visit` with the number and the size of the cell of every level that holds a point.
    fn cells_of(&self, x: DVec3, mut visit: impl FnMut(usize, f64)) {
        let from_focus = (x - self.focus) / self.half;
        for level in 0..AIM_LEVELS as usize {
            let p = from_focus * (1 << level) as f64;
            if p.abs().max_element() < 1.0 {
                let [i, j, k] = ((p * 0.5 + 0.5) * SIDE as f64).to_array().map(|c| (c as usize).min(SIDE - 1));
                visit(level * CELLS + (k * SIDE + j) * SIDE + i, self.cell(level));
            }
        }
    }

    /// Size of the cells of a level.
    fn cell(&self, level: usize) -> f64 {
        2.0 * self.half / (SIDE << level) as f64
    }
}

/// Direction number `i` of a Fibonacci lattice of so many.
fn lattice(i: usize, count: usize) -> DVec3 {
    let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let (sin, cos) = (PI * (3.0 - 5f64.sqrt()) * i as f64).sin_cos();
    let r = (1.0 - y * y).sqrt();
    DVec3::new(r * cos, y, r * sin)
}

/// The part of a vector across a unit vector.
fn across(v: DVec3, direction: DVec3) -> DVec3 {
    v - direction * v.dot(direction)
}

/// What a cell holds.
trait Value: Copy + Default + Add<Output = Self> + Div<f64, Output = Self> {}
impl<T: Copy + Default + Add<Output = T> + Div<f64, Output = T>> Value for T {}

/// Fills the cells where no ray came: from their neighbours, further off from the level before.
fn complete<T: Value>(mut values: Vec<Option<T>>) -> Vec<T> {
    for level in 0..AIM_LEVELS as usize {
        let (coarser, this) = values.split_at_mut(level * CELLS);
        let this = &mut this[..CELLS];
        for _ in 0..REACH {
            spread(this);
        }
        for (cell, value) in this.iter_mut().enumerate().filter(|(_, v)| v.is_none()) {
            // The cell's place on the level before, whose cells are twice as large.
            let [x, y, z] = place(cell).map(|i| (i + SIDE / 2) / 2);
            *value = coarser.len().checked_sub(CELLS).and_then(|first| coarser[first + (z * SIDE + y) * SIDE + x]);
        }
    }
    values.into_iter().map(Option::unwrap_or_default).collect()
}

impl Source<'_> {
    /// Point number `i` of the light from its center: on a sphere's disc across `direction`, or anywhere on a quad or a triangle.
    fn offset(&self, i: u32, direction: DVec3) -> DVec3 {
        let u = random_pair(0, 0, i).as_dvec2();
        let [edge_u, edge_v] = [self.light.edge_u, self.light.edge_v].map(|v| Vec3::from(v).as_dvec3());
        match self.light.kind {
            LIGHT_SPHERE => {
                let (right, up) = direction.any_orthonormal_pair();
                let (sin, cos) = (2.0 * PI * u.y).sin_cos();
                (right * cos + up * sin) * (u.x.sqrt() * f64::from(self.light.size))
            }
            LIGHT_TRIANGLE => {
                let root = u.x.sqrt();
                edge_u * (2.0 / 3.0 - root) + edge_v * (u.y * root - 1.0 / 3.0)
            }
            _ => edge_u * (u.x - 0.5) + edge_v * (u.y - 0.5),
        }
    }

    /// Follows a ray from a point of the light, and calls `sight` at the start of each of its steps.
    fn follow(&self, grid: &Grid, start: DVec3, direction: DVec3, mut sight: impl FnMut(&Sighting)) {
        let (functions, block) = (self.functions, self.block);
        let sense = 1.0;
        let (p, energy, frequency) = (functions.launch)((), block, start.to_array(), direction.to_array(), 1.0, sense);
        let (mut x, mut p) = (start, DVec3::from(p));
        let (mut parameter, mut length) = (0.0, 0.0);
        for _ in 0..STEPS {
            let alive = (functions.capture_distance)((), block, x.to_array(), p.to_array(), frequency, sense) >= 0.0;
            let (mut inside, mut cell) = (false, 0.0);
            grid.cells_of(x, |_, size| (inside, cell) = (true, size));
            if !alive || !inside || !x.is_finite() {
                return;
            }
            let (seen, ..) = (functions.observe)((), block, x.to_array(), p.to_array(), energy, sense, parameter);
            let direction = -DVec3::from(seen);
            if direction.is_finite() {
                sight(&Sighting { x, direction, length });
            }
            // A step of the classical Runge-Kutta method.
            let rate = |x: DVec3, p: DVec3, parameter: f64| {
                let (v, a) = (functions.rate)((), block, x.to_array(), p.to_array(), energy, sense, parameter);
                (DVec3::from(v), DVec3::from(a))
            };
            let (v1, a1) = rate(x, p, parameter);
            let (safe, _) = (functions.safe_step)((), block, x.to_array(), v1.normalize().to_array());
            let step = (CELL_SHARE * cell).min(SAFE_SHARE * safe).max(LEAST_SHARE * cell);
            let h = step / v1.length();
            let (v2, a2) = rate(x + v1 * (0.5 * h), p + a1 * (0.5 * h), parameter + 0.5 * h);
            let (v3, a3) = rate(x + v2 * (0.5 * h), p + a2 * (0.5 * h), parameter + 0.5 * h);
            let (v4, a4) = rate(x + v3 * h, p + a3 * h, parameter + h);
            x += (v1 + (v2 + v3) * 2.0 + v4) * (h / 6.0);
            p += (a1 + (a2 + a3) * 2.0 + a4) * (h / 6.0);
            parameter += h;
            length += step;
        }
    }
}

impl Found {
    /// Adds a shift, unless it is another image's than those found before; a clearly shorter way takes their place.
    fn add(&mut self, shift: DVec3, length: f64, alike: f64) {
        if self.count == 0.0 || length < SHORTER * self.length {
            *self = Found { sum: shift, count: 1.0, length };
        } else if shift.distance(self.sum / self.count) < alike {
            self.sum += shift;
            self.count += 1.0;
        }
    }
}

/// Column, row and layer of a cell.
fn place(cell: usize) -> [usize; 3] {
    [cell % SIDE, cell / SIDE % SIDE, cell / (SIDE * SIDE)]
}

/// Gives cells without a value the mean of their neighbours'.
fn spread<T: Value>(values: &mut [Option<T>]) {
    let before = values.to_vec();
    for (cell, value) in values.iter_mut().enumerate().filter(|(_, v)| v.is_none()) {
        let (mut sum, mut count) = (T::default(), 0.0);
        for (axis, i) in place(cell).into_iter().enumerate() {
            let stride = SIDE.pow(axis as u32);
            for neighbour in [(i > 0).then(|| cell - stride), (i + 1 < SIDE).then(|| cell + stride)].into_iter().flatten() {
                if let Some(known) = before[neighbour] {
                    sum = sum + known;
                    count += 1.0;
                }
            }
        }
        *value = (count > 0.0).then(|| sum / count);
    }
}
