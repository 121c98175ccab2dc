//! Builds the clearance grid: for every cell a lower bound of the distance from any of its points to the nearest geometry.
//!
//! The grid is nested, a clipmap (Tanner, Migdal and Jones 1998): steps are short near the center of the bending region, so cells are
//! small there. Every level has the same number of cells; its box is that of the level before, halved about the focus.
//!
//! On each level geometry is rasterised conservatively into cells, squared distances between cell centers follow from the exact
//! separable transform of Felzenszwalb and Huttenlocher (2012), and a cell's diagonal is taken off. A level does not see what lies
//! beyond its box, but that is no nearer than the face it lies behind; and what the next coarser level says of a place holds for all
//! geometry, so the larger of both bounds is taken.

use super::World;
use super::bvh::{box_corners, hull, primitive_bounds};
use super::region::Region;
use crate::kernels::constants::*;
use crate::kernels::layout::Primitive;
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// About how many cells a level has.
const CELLS: f32 = 200_000.0;
/// Most cells along an axis.
const MAX_SIDE: f32 = 512.0;
/// Least room between the focus and the faces of the coarsest level, as a share of its extent.
const FOCUS_ROOM: f32 = 0.05;
/// Diagonal of a cell, and a little for rounding, in cells.
const DIAGONAL: f32 = 1.74;
/// Rounding error of a cell's number that the next coarser level is asked with, in its cells.
const CELL_SLACK: f32 = 1e-3;
/// Rounding error of a distance to a primitive, as a share of its radius.
const RADIUS_SLACK: f32 = 1e-6;

/// One level of the grid.
struct Level {
    low: Vec3,
    cell: f32,
    size: UVec3,
    occupied: Vec<bool>,
}

/// What the cells of one layer across an axis have in common.
struct Layer {
    /// Cells from the layer to the nearest face across the axis that geometry may lie behind.
    border: f32,
    /// First and last layer of the next coarser level that it touches.
    coarser: [usize; 2],
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
    assert!(GRID_LEVELS * size.element_product() < 1 << 24, "single precision holds the index of every cell");
    let focus = region.center.clamp(low + extent * FOCUS_ROOM, high - extent * FOCUS_ROOM);
    let focus_cell = (focus - low) / cell;
    let primitives = &world.primitives;
    let levels: Vec<Level> = (0..GRID_LEVELS)
        .into_par_iter()
        .map(|level| {
            let cell = cell / (1u32 << level) as f32;
            let occupied = vec![false; size.element_product() as usize];
            let mut level = Level { low: focus - focus_cell * cell, cell, size, occupied };
            level.mark_scene(corners, primitives);
            level
        })
        .collect();
    let mut clearance: Vec<u8> = vec![];
    for level in &levels {
        // The level before; none before the first.
        let coarser = &clearance[clearance.len().saturating_sub(level.occupied.len())..];
        let distances = level.distances(coarser, focus_cell, bounds);
        clearance.extend(distances);
    }
    world.clearance = clearance;
    let scene = &mut world.scene;
    scene.grid_focus = focus.into();
    scene.grid_inverse_cell = 1.0 / cell;
    scene.grid_size = size.to_array();
    scene.grid_focus_cell = focus_cell.into();
    scene.grid_reach_low = focus_cell.recip().into();
    scene.grid_reach_high = (size.as_vec3() - focus_cell).recip().into();
    scene.bounds_low = ((bounds.0 - focus) / cell).into();
    scene.bounds_high = ((bounds.1 - focus) / cell).into();
}

impl Level {
    fn mark_scene(&mut self, corners: &[[Vec3; 3]], primitives: &[Primitive]) {
        for triangle in corners {
            let [a, b, c] = *triangle;
            self.mark_flat(triangle, b - a, c - a);
        }
        for primitive in primitives {
            let Some(cells) = self.touched(primitive_bounds(primitive)) else { continue };
            let d = &primitive.data;
            let at = |i: usize| Vec3::new(d[i], d[i + 1], d[i + 2]);
            match primitive.kind {
                PRIMITIVE_SPHERE => {
                    let (center, radius) = (at(0), d[3]);
                    let slack = RADIUS_SLACK * radius;
                    self.mark(cells, |p, half| ((p - center).length() - radius).abs() <= half + slack);
                }
                PRIMITIVE_QUAD => self.mark_quad(at(0), at(3), at(6)),
                PRIMITIVE_DISC => {
                    let (center, normal, inner, outer) = (at(0), at(4), d[3], d[7]);
                    let slack = RADIUS_SLACK * outer;
                    self.mark(cells, |p, half| {
                        let reach = half + slack;
                        let height = (p - center).dot(normal);
                        let radius = (p - center - normal * height).length();
                        height.abs() <= reach && radius >= inner - reach && radius <= outer + reach
                    });
                }
                _ => {
                    let c = box_corners(primitive);
                    for [o, u, v] in [[0, 2, 4], [1, 3, 5], [0, 1, 4], [2, 3, 6], [0, 1, 2], [4, 5, 6]] {
                        self.mark_quad(c[o], c[u] - c[o], c[v] - c[o]);
                    }
                }
            }
        }
    }

    fn mark_quad(&mut self, corner: Vec3, u: Vec3, v: Vec3) {
        self.mark_flat(&[corner, corner + u, corner + v, corner + u + v], u, v);
    }

    /// Marks the cells of a triangle or a parallelogram, whose edges from the first corner are u and v.
    fn mark_flat(&mut self, corners: &[Vec3], u: Vec3, v: Vec3) {
        let Some(cells) = self.touched(hull(corners)) else { return };
        let normal = u.cross(v).normalize_or_zero();
        let origin = corners[0];
        // Rounding tilts the plane of a sliver, but no corner is further from it than this.
        let slack = normal.dot(u).abs() + normal.dot(v).abs();
        self.mark(cells, |p, half| (p - origin).dot(normal).abs() <= half + slack);
    }

    /// First and last cell along each axis that a box may touch; none if it is beside the level.
    fn touched(&self, (low, high): (Vec3, Vec3)) -> Option<(UVec3, UVec3)> {
        let last = self.size.as_vec3() - Vec3::ONE;
        // One cell more on each side covers rounding.
        let beyond = self.low + (self.size.as_vec3() + Vec3::ONE) * self.cell;
        if high.cmplt(self.low - Vec3::splat(self.cell)).any() || low.cmpgt(beyond).any() {
            return None;
        }
        let from = (((low - self.low) / self.cell).floor() - Vec3::ONE).clamp(Vec3::ZERO, last).as_uvec3();
        let to = (((high - self.low) / self.cell).floor() + Vec3::ONE).clamp(Vec3::ZERO, last).as_uvec3();
        Some((from, to))
    }

    /// Marks those of the cells whose center passes the test; the test gets the center and half a cell's diagonal.
    fn mark(&mut self, (from, to): (UVec3, UVec3), test: impl Fn(Vec3, f32) -> bool) {
        let half = 0.5 * DIAGONAL * self.cell;
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let center = self.low + (Vec3::new(x as f32, y as f32, z as f32) + Vec3::splat(0.5)) * self.cell;
                    if test(center, half) {
                        self.occupied[((z * self.size.y + y) * self.size.x + x) as usize] = true;
                    }
                }
            }
        }
    }

    /// Lower bounds in quarters of a cell, given those of the next coarser level, of which the first level has none.
    fn distances(&self, coarser: &[u8], focus_cell: Vec3, bounds: (Vec3, Vec3)) -> Vec<u8> {
        let [nx, ny, nz] = self.size.to_array().map(|n| n as usize);
        let columns = self.squared_distances();
        let layers = [0, 1, 2].map(|axis| self.layers(axis, focus_cell, bounds));
        let mut result = vec![0u8; nx * ny * nz];
        result.par_chunks_mut(nx * ny).enumerate().for_each(|(z, slice)| {
            for (xy, value) in slice.iter_mut().enumerate() {
                let at = [&layers[0][xy % nx], &layers[1][xy / nx], &layers[2][z]];
                let border = at[0].border.min(at[1].border).min(at[2].border);
                let nearest = (columns[xy][z].sqrt() - DIAGONAL).min(border).max(0.0);
                let known = if coarser.is_empty() { 0 } else { least(coarser, [nx, ny], at.map(|layer| layer.coarser)) };
                // Conversion rounds down and saturates.
                *value = ((nearest * 4.0) as u8).max(known.saturating_mul(2));
            }
        });
        result
    }

    /// The layers of cells across an axis.
    fn layers(&self, axis: usize, focus_cell: Vec3, bounds: (Vec3, Vec3)) -> Vec<Layer> {
        let (count, focus) = (self.size[axis], focus_cell[axis]);
        let last = (count - 1) as f32;
        let (low, high) = (self.low[axis], self.low[axis] + count as f32 * self.cell);
        (0..count)
            .map(|i| {
                let i = i as f32;
                let below = if bounds.0[axis] < low { i } else { f32::INFINITY };
                let above = if bounds.1[axis] > high { last - i } else { f32::INFINITY };
                // What is c cells from the corner of a level is (c + focus) / 2 cells from that of the next coarser one.
                let ends = [(i + focus) / 2.0 - CELL_SLACK, (i + 1.0 + focus) / 2.0 + CELL_SLACK];
                Layer { border: below.min(above), coarser: ends.map(|c| c.floor().clamp(0.0, last) as usize) }
            })
            .collect()
    }

    /// Squared distances in cells between centers, from each cell to the nearest marked one: along z for every x and y.
    fn squared_distances(&self) -> Vec<Vec<f32>> {
        let [nx, ny, nz] = self.size.to_array().map(|n| n as usize);
        let far = 1e12f32;
        let mut squared: Vec<f32> = self.occupied.iter().map(|&o| if o { 0.0 } else { far }).collect();
        squared.par_chunks_mut(nx).for_each(transform_line);
        squared.par_chunks_mut(nx * ny).for_each(|slice| transform_strided(slice, nx, nx, ny));
        // Along z the lines run through the whole array: transform copies of them.
        (0..nx * ny)
            .into_par_iter()
            .map(|xy| {
                let mut line: Vec<f32> = (0..nz).map(|z| squared[z * nx * ny + xy]).collect();
                transform_line(&mut line);
                line
            })
            .collect()
    }
}

/// Least value of the coarser level over the given first and last layers of each axis.
fn least(coarser: &[u8], [nx, ny]: [usize; 2], [xs, ys, zs]: [[usize; 2]; 3]) -> u8 {
    let mut least = u8::MAX;
    for z in zs[0]..=zs[1] {
        for y in ys[0]..=ys[1] {
            for x in xs[0]..=xs[1] {
                least = least.min(coarser[(z * ny + y) * nx + x]);
            }
        }
    }
    least
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
