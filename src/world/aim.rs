//! Where lights appear: the table that light sampling aims by where space is bent.
//!
//! A light at P that is seen from x in the direction w appears at x + w |P - x|, shifted by so much from where it is. The shifts are
//! averages over cells of a nested grid, each level half as large as the one before about the focus, of what rays from the light's center
//! find there. They are a guess: whatever they say, the density of the directions drawn is known exactly (`kernels/light.rs`).

use super::World;
use crate::kernels::constants::*;
use crate::kernels::integrator::{ModelBlock, PointFunctions};
use crate::kernels::layout::Light;
use crate::spacetime::{Class, ModelKind};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Rays from all lights together, and most from one.
const RAYS: usize = 8192;
const MOST_RAYS: usize = 4096;
/// Most steps of a ray.
const STEPS: usize = 512;
/// Steps as shares of the cell they are in, and of what the model allows.
const CELL_SHARE: f64 = 0.5;
const SAFE_SHARE: f64 = 0.3;
/// Room between the lights or the camera and the faces of the coarsest level, as a factor.
const ROOM: f64 = 1.25;
/// Of several images the one whose light came the shorter way is taken, if it is shorter by this factor.
const SHORTER: f64 = 0.8;
/// Shifts in a cell that differ by more than this share of the distance are of different images.
const ALIKE: f64 = 0.3;
/// How many cells far a shift is taken to where no ray came.
const REACH: usize = 3;

const SIDE: usize = AIM_SIDE as usize;
const CELLS: usize = SIDE * SIDE * SIDE;

/// What rays found in a cell.
#[derive(Clone, Copy, Default)]
struct Found {
    /// Sum of the shifts, and how many they are.
    sum: DVec3,
    count: f64,
    /// Length of the way to the first.
    length: f64,
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
    if model == ModelKind::Flat || !few || !reversible || scene.region_radius <= 0.0 || scene.light_share == 0.0 {
        return;
    }
    let _span = tracing::info_span!("aim", lights = world.lights.len()).entered();
    let focus = Vec3::from(scene.region_center).as_dvec3();
    let centers: Vec<Option<DVec3>> = world.lights.iter().map(center).collect();
    let seen = centers.iter().flatten().copied().chain([Vec3::from(scene.camera_position).as_dvec3()]);
    let half = seen.map(|p| (p - focus).abs().max_element()).fold(1e-3, f64::max) * ROOM;
    let grid = Grid { focus, half };
    let (functions, block) = (PointFunctions::<f64>::of(model), world.model_block::<f64>());
    let rays = (RAYS / world.lights.len()).min(MOST_RAYS);
    let tables: Vec<Vec<[f32; 4]>> = centers
        .par_iter()
        .map(|center| match center {
            Some(center) => grid.shifts(&functions, &block, *center, rays),
            None => vec![[0.0; 4]; AIM_LEVELS as usize * CELLS],
        })
        .collect();
    world.aims = tables.concat();
    world.scene.aim_focus = focus.as_vec3().into();
    world.scene.aim_scale = (1.0 / half) as f32;
}

/// The middle of a light; none of the sky.
fn center(light: &Light) -> Option<DVec3> {
    let [position, u, v] = [light.position, light.edge_u, light.edge_v].map(|v| Vec3::from(v).as_dvec3());
    match light.kind {
        LIGHT_SPHERE => Some(position),
        LIGHT_QUAD => Some(position + (u + v) / 2.0),
        LIGHT_TRIANGLE => Some(position + (u + v) / 3.0),
        _ => None,
    }
}

impl Grid {
    /// Shifts of the light around `center`, level after level.
    fn shifts(&self, functions: &PointFunctions<f64>, block: &ModelBlock<f64>, center: DVec3, rays: usize) -> Vec<[f32; 4]> {
        let mut found = vec![Found::default(); AIM_LEVELS as usize * CELLS];
        for i in 0..rays {
            // Directions of a Fibonacci lattice.
            let y = 1.0 - (2.0 * i as f64 + 1.0) / rays as f64;
            let (sin, cos) = (PI * (3.0 - 5f64.sqrt()) * i as f64).sin_cos();
            let r = (1.0 - y * y).sqrt();
            self.follow(functions, block, center, DVec3::new(r * cos, y, r * sin), &mut found);
        }
        let mut shifts: Vec<Option<DVec3>> = found.iter().map(|f| (f.count > 0.0).then(|| f.sum / f.count)).collect();
        for level in 0..AIM_LEVELS as usize {
            let (coarser, this) = shifts.split_at_mut(level * CELLS);
            let this = &mut this[..CELLS];
            for _ in 0..REACH {
                spread(this);
            }
            for (cell, shift) in this.iter_mut().enumerate() {
                if shift.is_none() {
                    // The cell's place on the level before, whose cells are twice as large.
                    let [x, y, z] = place(cell).map(|i| (i + SIDE / 2) / 2);
                    *shift = Some(coarser.len().checked_sub(CELLS).and_then(|first| coarser[first + (z * SIDE + y) * SIDE + x]).unwrap_or_default());
                }
            }
        }
        shifts.into_iter().map(|s| s.unwrap_or_default().as_vec3().extend(0.0).to_array()).collect()
    }

    /// Follows a ray from a light, and notes in the cells it passes where the light appears from there.
    fn follow(&self, functions: &PointFunctions<f64>, block: &ModelBlock<f64>, center: DVec3, direction: DVec3, found: &mut [Found]) {
        let sense = 1.0;
        let mut x = center.to_array();
        let (mut p, energy, frequency) = (functions.launch)((), block, x, direction.to_array(), 1.0, sense);
        let (mut parameter, mut length) = (0.0, 0.0);
        for _ in 0..STEPS {
            let at = DVec3::from(x);
            let out = (at - self.focus).abs().max_element() / self.half;
            let alive = (functions.capture_distance)((), block, x, p, frequency, sense) >= 0.0;
            if !alive || !out.is_finite() || out >= 1.0 {
                return;
            }
            let (seen, ..) = (functions.observe)((), block, x, p, energy, sense, parameter);
            let distance = at.distance(center);
            let shift = at - DVec3::from(seen) * distance - center;
            let mut cell = 2.0 * self.half / SIDE as f64;
            for level in 0..AIM_LEVELS {
                let scale = f64::from(1 << level);
                if out * scale < 1.0 {
                    cell = 2.0 * self.half / (SIDE as f64 * scale);
                    let [i, j, k] = (((at - self.focus) / self.half * scale * 0.5 + 0.5) * SIDE as f64).to_array().map(|c| (c as usize).min(SIDE - 1));
                    found[level as usize * CELLS + (k * SIDE + j) * SIDE + i].add(shift, length, ALIKE * distance + cell);
                }
            }
            // A step of the classical Runge-Kutta method.
            let rate = |x: DVec3, p: DVec3, parameter: f64| {
                let (v, a) = (functions.rate)((), block, x.to_array(), p.to_array(), energy, sense, parameter);
                (DVec3::from(v), DVec3::from(a))
            };
            let at_p = DVec3::from(p);
            let (v1, a1) = rate(at, at_p, parameter);
            let step = (CELL_SHARE * cell).min(SAFE_SHARE * (functions.safe_step)((), block, x).0).max(1e-3 * cell);
            let h = step / v1.length();
            let (v2, a2) = rate(at + v1 * (0.5 * h), at_p + a1 * (0.5 * h), parameter + 0.5 * h);
            let (v3, a3) = rate(at + v2 * (0.5 * h), at_p + a2 * (0.5 * h), parameter + 0.5 * h);
            let (v4, a4) = rate(at + v3 * h, at_p + a3 * h, parameter + h);
            x = (at + (v1 + (v2 + v3) * 2.0 + v4) * (h / 6.0)).to_array();
            p = (at_p + (a1 + (a2 + a3) * 2.0 + a4) * (h / 6.0)).to_array();
            parameter += h;
            length += step;
        }
    }
}

impl Found {
    /// Adds a shift, unless it is another image's than those found before; a clearly shorter way takes their place.
    fn add(&mut self, shift: DVec3, length: f64, alike: f64) {
        if !shift.is_finite() {
            return;
        }
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

/// Gives cells without a shift the mean of their neighbours'.
fn spread(shifts: &mut [Option<DVec3>]) {
    let before = shifts.to_vec();
    for (cell, shift) in shifts.iter_mut().enumerate().filter(|(_, s)| s.is_none()) {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (axis, i) in place(cell).into_iter().enumerate() {
            let stride = SIDE.pow(axis as u32);
            for neighbour in [(i > 0).then(|| cell - stride), (i + 1 < SIDE).then(|| cell + stride)].into_iter().flatten() {
                if let Some(known) = before[neighbour] {
                    sum += known;
                    count += 1.0;
                }
            }
        }
        *shift = (count > 0.0).then(|| sum / count);
    }
}
