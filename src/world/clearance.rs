//! Builds the clearance grid: for every cell a lower bound of the distance from any of its points to the nearest geometry.
//!
//! Geometry is rasterised conservatively into cells, squared distances between cell centers follow from the exact separable
//! transform of Felzenszwalb and Huttenlocher (2012), and a cell's diagonal is taken off.

use super::World;
use super::bvh::{box_corners, hull, primitive_bounds};
use super::region::Region;
use crate::kernels::constants::*;
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// About how many cells a grid has.
const CELLS: f32 = 600_000.0;
/// Most cells along an axis.
const MAX_SIDE: f32 = 512.0;

struct Grid {
    min: Vec3,
    cell: f32,
    size: UVec3,
    occupied: Vec<bool>,
}

/// Builds the grid over the part of the scene where light bends.
pub(super) fn build(world: &mut World, corners: &[[Vec3; 3]], bounds: (Vec3, Vec3), region: &Region) {
    let low = bounds.0.max(region.center - Vec3::splat(region.radius));
    let high = bounds.1.min(region.center + Vec3::splat(region.radius));
    if !(high - low).cmpge(Vec3::ZERO).all() || region.radius <= 0.0 {
        return;
    }
    // Some room around flat scenes, so that rays beside them can still skip.
    let margin = 0.1 * (high - low).max_element().max(1e-3);
    let (low, high) = (low - Vec3::splat(margin), high + Vec3::splat(margin));
    let _span = tracing::info_span!("clearance").entered();
    let extent = high - low;
    let cell = (extent.x * extent.y * extent.z / CELLS).cbrt().max(extent.max_element() / MAX_SIDE);
    let size = (extent / cell).ceil().max(Vec3::ONE).as_uvec3();
    let mut grid = Grid { min: low, cell, size, occupied: vec![false; (size.x * size.y * size.z) as usize] };
    for triangle in corners {
        grid.mark_triangle(triangle);
    }
    for primitive in &world.primitives {
        let d = &primitive.data;
        let at = |i: usize| Vec3::new(d[i], d[i + 1], d[i + 2]);
        match primitive.kind {
            PRIMITIVE_SPHERE => {
                let (low, high) = primitive_bounds(primitive);
                let (center, radius) = (at(0), d[3]);
                grid.mark(low, high, |p, half| ((p - center).length() - radius).abs() <= half);
            }
            PRIMITIVE_QUAD => grid.mark_quad(at(0), at(3), at(6)),
            PRIMITIVE_DISC => {
                let (low, high) = primitive_bounds(primitive);
                let (center, normal, inner, outer) = (at(0), at(4), d[3], d[7]);
                grid.mark(low, high, |p, half| {
                    let height = (p - center).dot(normal);
                    let radius = (p - center - normal * height).length();
                    height.abs() <= half && radius >= inner - half && radius <= outer + half
                });
            }
            _ => {
                let c = box_corners(primitive);
                for [o, u, v] in [[0, 2, 4], [1, 3, 5], [0, 1, 4], [2, 3, 6], [0, 1, 2], [4, 5, 6]] {
                    grid.mark_quad(c[o], c[u] - c[o], c[v] - c[o]);
                }
            }
        }
    }
    world.scene.grid_min = grid.min.into();
    world.scene.grid_inverse_cell = 1.0 / grid.cell;
    world.scene.grid_size = grid.size.to_array();
    world.scene.bounds_low = ((bounds.0 - grid.min) / grid.cell).into();
    world.scene.bounds_high = ((bounds.1 - grid.min) / grid.cell).into();
    world.clearance = grid.distances();
}

impl Grid {
    /// Marks the cells of a box whose center passes the test; the test gets the center and half a cell's diagonal.
    fn mark(&mut self, low: Vec3, high: Vec3, test: impl Fn(Vec3, f32) -> bool) {
        let last = self.size.as_vec3() - Vec3::ONE;
        if (high - self.min).min_element() < 0.0 || ((low - self.min) / self.cell - self.size.as_vec3()).max_element() > 0.0 {
            return;
        }
        // One cell more on each side covers rounding.
        let from = (((low - self.min) / self.cell).floor() - Vec3::ONE).clamp(Vec3::ZERO, last).as_uvec3();
        let to = (((high - self.min) / self.cell).floor() + Vec3::ONE).clamp(Vec3::ZERO, last).as_uvec3();
        let half = self.cell * 0.87;
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let center = self.min + (Vec3::new(x as f32, y as f32, z as f32) + Vec3::splat(0.5)) * self.cell;
                    if test(center, half) {
                        self.occupied[((z * self.size.y + y) * self.size.x + x) as usize] = true;
                    }
                }
            }
        }
    }

    fn mark_triangle(&mut self, corners: &[Vec3; 3]) {
        let (low, high) = hull(corners);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let origin = corners[0];
        self.mark(low, high, |p, half| (p - origin).dot(normal).abs() <= half);
    }

    fn mark_quad(&mut self, corner: Vec3, u: Vec3, v: Vec3) {
        let (low, high) = hull(&[corner, corner + u, corner + v, corner + u + v]);
        let normal = u.cross(v).normalize_or_zero();
        self.mark(low, high, |p, half| (p - corner).dot(normal).abs() <= half);
    }

    /// Lower bounds in quarters of a cell.
    fn distances(&self) -> Vec<u8> {
        let [nx, ny, nz] = self.size.to_array().map(|n| n as usize);
        let far = 1e12f32;
        let mut squared: Vec<f32> = self.occupied.iter().map(|&o| if o { 0.0 } else { far }).collect();
        squared.par_chunks_mut(nx).for_each(transform_line);
        squared.par_chunks_mut(nx * ny).for_each(|slice| transform_strided(slice, nx, nx, ny));
        // Along z the lines run through the whole array: transform a transposed copy of each xz slab.
        let columns: Vec<Vec<f32>> = (0..nx * ny)
            .into_par_iter()
            .map(|xy| {
                let mut line: Vec<f32> = (0..nz).map(|z| squared[z * nx * ny + xy]).collect();
                transform_line(&mut line);
                line
            })
            .collect();
        let diagonal = 3f32.sqrt();
        let mut result = vec![0u8; nx * ny * nz];
        result.par_chunks_mut(nx * ny).enumerate().for_each(|(z, slice)| {
            for (value, column) in slice.iter_mut().zip(&columns) {
                *value = ((column[z].sqrt() - diagonal).max(0.0) * 4.0).floor().min(255.0) as u8;
            }
        });
        result
    }
}

/// Transforms `count` interleaved lines of a slice with the given stride.
fn transform_strided(slice: &mut [f32], count: usize, stride: usize, length: usize) {
    let mut line = vec![0.0; length];
    for first in 0..count {
        for (i, v) in line.iter_mut().enumerate() {
            *v = slice[first + i * stride];
        }
        transform_line(&mut line);
        for (i, v) in line.iter().enumerate() {
            slice[first + i * stride] = *v;
        }
    }
}

/// One-dimensional squared distance transform: f(i) becomes min over j of f(j) + (i - j)^2.
fn transform_line(f: &mut [f32]) {
    let n = f.len();
    let mut vertex = vec![0usize; n];
    let mut boundary = vec![0.0f32; n + 1];
    let mut k = 0;
    boundary[0] = f32::NEG_INFINITY;
    boundary[1] = f32::INFINITY;
    let cross = |f: &[f32], q: usize, v: usize| ((f[q] + (q * q) as f32) - (f[v] + (v * v) as f32)) / (2.0 * (q as f32 - v as f32));
    for q in 1..n {
        let mut s = cross(f, q, vertex[k]);
        while s <= boundary[k] && k > 0 {
            k -= 1;
            s = cross(f, q, vertex[k]);
        }
        if s <= boundary[k] {
            vertex[k] = q;
        } else {
            k += 1;
            vertex[k] = q;
            boundary[k] = s;
        }
        boundary[k + 1] = f32::INFINITY;
    }
    let source = f.to_vec();
    k = 0;
    for (q, value) in f.iter_mut().enumerate() {
        while boundary[k + 1] < q as f32 {
            k += 1;
        }
        let offset = q as f32 - vertex[k] as f32;
        *value = offset * offset + source[vertex[k]];
    }
}
