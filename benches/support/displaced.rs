//! A scene to trace rays through, and the rays: six displaced icospheres in a ring above a displaced ground, empty in the middle.
//!
//! Camera rays come in tiles of 4 x 4 pixels, so that eight in a row make a coherent packet; diffuse rays bounce off what the camera
//! rays hit, and are as incoherent as those of a path tracer.

use fearless_simd::{Level, Simd, dispatch};
use glam::{Vec3, vec3};
use nullray::kernels::bvh::Hit;
use nullray::kernels::constants::NO_INDEX;
use nullray::kernels::rng::{hash, unit_float};
use nullray::kernels::sampling::{sample_cosine, world_from_frame};
use nullray::kernels::traverser::{Query, Traverser};
use nullray::kernels::view::SceneView;
use nullray::scene::mesh::Mesh;
use nullray::scene::{Geometry, Scene, Shape, parse_scene};
use std::collections::HashMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// How finely the scene is cut.
#[derive(Clone, Copy)]
pub struct Detail {
    /// Times each face of an icosahedron is cut into four.
    pub subdivisions: u32,
    /// Cells of the ground along each side.
    pub ground_cells: u32,
}

impl fmt::Display for Detail {
    /// The number of triangles.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", SPHERES * 20 * 4u32.pow(self.subdivisions) + 2 * self.ground_cells * self.ground_cells)
    }
}

/// 524,288 triangles.
pub const FULL: Detail = Detail { subdivisions: 6, ground_cells: 128 };

/// Spheres in the ring, its radius, and theirs.
const SPHERES: u32 = 6;
const RING_RADIUS: f32 = 7.0;
const SPHERE_RADIUS: f32 = 2.0;
/// Half a side of the ground, and its height.
const GROUND_HALF: f32 = 10.0;
const GROUND_HEIGHT: f32 = -2.4;

/// The pinhole camera: size of the film, side of a tile, place, and tangent of half the vertical field of view (45 degrees).
const WIDTH: u32 = 480;
const HEIGHT: u32 = 272;
const TILE: u32 = 4;
const CAMERA: Vec3 = vec3(2.0, 5.0, -17.0);
const LOOK_AT: Vec3 = vec3(0.0, -0.5, 0.0);
const TAN_HALF_FOV: f32 = std::f32::consts::SQRT_2 - 1.0;
/// Distance of a diffuse ray's origin from the surface.
const OFFSET: f32 = 1e-4;

/// The scene around a mesh, with the camera of [`primary_rays`]; `spacetime` has the keys of its `[spacetime]`, none for straight light.
pub fn displaced_scene(mesh: &Arc<Mesh>, spacetime: &str) -> Scene {
    let [position, look_at] = [CAMERA, LOOK_AT].map(|p| p.to_array());
    let fov_degrees = 2.0 * f64::from(TAN_HALF_FOV).atan().to_degrees();
    let text = format!(
        "[camera]\nposition = {position:?}\nlook_at = {look_at:?}\nfov_degrees = {fov_degrees}\n\
         [film]\nwidth = {WIDTH}\nheight = {HEIGHT}\n[spacetime]\n{spacetime}\n"
    );
    let mut scene = parse_scene(Path::new("displaced"), &text, &[]).expect("the text is a scene");
    scene.shapes.push(Shape { material: 0, side: 0, geometry: Geometry::Mesh(mesh.clone()) });
    scene
}

/// All triangles as one mesh.
pub fn displaced_mesh(detail: Detail) -> Mesh {
    let mut mesh = Mesh::default();
    let (points, faces) = icosphere(detail.subdivisions);
    for k in 0..SPHERES {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / SPHERES as f32).sin_cos();
        let center = vec3(cos, 0.0, sin) * RING_RADIUS;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(points.iter().map(|&p| (center + p * (SPHERE_RADIUS * (1.0 + bump(p + center)))).to_array()));
        mesh.indices.extend(faces.iter().map(|f| f.map(|i| first + i)));
    }
    add_ground(&mut mesh, detail.ground_cells);
    mesh
}

/// Relative displacement of a sphere: broad dents with fine ones on them.
fn bump(p: Vec3) -> f32 {
    let wave = |p: Vec3| p.x.sin() * p.y.sin() * p.z.sin();
    0.08 * wave(p * 5.0) + 0.01 * wave(p * 27.0)
}

/// Unit vectors and triangles of an icosahedron whose faces are cut into four again and again.
fn icosphere(subdivisions: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5.0f32.sqrt()) / 2.0;
    #[rustfmt::skip]
    let corners = [
        [-1.0, g, 0.0], [1.0, g, 0.0], [-1.0, -g, 0.0], [1.0, -g, 0.0], [0.0, -1.0, g], [0.0, 1.0, g],
        [0.0, -1.0, -g], [0.0, 1.0, -g], [g, 0.0, -1.0], [g, 0.0, 1.0], [-g, 0.0, -1.0], [-g, 0.0, 1.0],
    ];
    #[rustfmt::skip]
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
        [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ];
    let mut points: Vec<Vec3> = corners.iter().map(|&c| Vec3::from(c).normalize()).collect();
    for _ in 0..subdivisions {
        // Neighbours share the middle of their edge.
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut cut = Vec::with_capacity(4 * faces.len());
        for &[a, b, c] in &faces {
            let [d, e, f] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    let middle = (points[p as usize] + points[q as usize]).normalize();
                    points.push(middle);
                    points.len() as u32 - 1
                })
            });
            cut.extend([[a, d, f], [d, b, e], [f, e, c], [d, e, f]]);
        }
        faces = cut;
    }
    (points, faces)
}

/// A wavy square below the spheres.
fn add_ground(mesh: &mut Mesh, cells: u32) {
    let first = mesh.positions.len() as u32;
    let side = cells + 1;
    let coordinate = |i: u32| GROUND_HALF * (2.0 * i as f32 / cells as f32 - 1.0);
    for i in 0..side * side {
        let (x, z) = (coordinate(i % side), coordinate(i / side));
        let height = 0.2 * (0.9 * x).sin() * (1.1 * z).sin() + 0.03 * (7.0 * x).sin() * (6.0 * z).sin();
        mesh.positions.push([x, GROUND_HEIGHT + height, z]);
    }
    for i in 0..cells * cells {
        let a = first + i / cells * side + i % cells;
        let (b, c, d) = (a + 1, a + side, a + side + 1);
        mesh.indices.extend([[a, c, b], [b, c, d]]);
    }
}

/// A ray to trace.
#[derive(Clone, Copy)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

/// Camera rays through the centers of the pixels, tile by tile.
pub fn primary_rays() -> Vec<Ray> {
    let forward = (LOOK_AT - CAMERA).normalize();
    let right = forward.cross(Vec3::Y).normalize();
    let up = right.cross(forward);
    let scale = 2.0 * TAN_HALF_FOV / HEIGHT as f32;
    let tiles_across = WIDTH / TILE;
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let (tile, inside) = (i / (TILE * TILE), i % (TILE * TILE));
            let x = (tile % tiles_across * TILE + inside % TILE) as f32 + 0.5 - 0.5 * WIDTH as f32;
            let y = (tile / tiles_across * TILE + inside / TILE) as f32 + 0.5 - 0.5 * HEIGHT as f32;
            Ray { origin: CAMERA, direction: (forward + right * (x * scale) - up * (y * scale)).normalize() }
        })
        .collect()
}

/// One cosine-distributed bounce off every hit, in the order of the rays; a last packet that is not full is left out.
pub fn diffuse_rays(mesh: &Mesh, view: &SceneView, rays: &[Ray], hits: &[Hit]) -> Vec<Ray> {
    let mut bounced = Vec::new();
    for (i, (ray, hit)) in rays.iter().zip(hits).enumerate() {
        if hit.primitive == NO_INDEX {
            continue;
        }
        let triangle = view.block(hit.primitive / 8).triangle[hit.primitive as usize % 8];
        let [a, b, c] = mesh.indices[triangle as usize].map(|i| Vec3::from(mesh.positions[i as usize]));
        let outward = (b - a).cross(c - a).normalize();
        let normal = if outward.dot(ray.direction) > 0.0 { -outward } else { outward };
        let u = [unit_float(hash(2 * i as u32)), unit_float(hash(2 * i as u32 + 1))];
        let origin = ray.origin + ray.direction * hit.t + normal * OFFSET;
        bounced.push(Ray { origin, direction: world_from_frame((), normal.into(), sample_cosine((), u)).into() });
    }
    bounced.truncate(bounced.len() / 8 * 8);
    bounced
}

/// Finds the closest hit of every straight ray.
pub fn closest_hits(level: Level, view: &SceneView, rays: &[Ray], hits: &mut [Hit]) {
    dispatch!(level, simd => trace_all(simd, view, rays, hits));
}

/// [`closest_hits`] on the registers of one instruction set.
#[inline(always)]
fn trace_all<S: Simd>(simd: S, view: &SceneView, rays: &[Ray], hits: &mut [Hit]) {
    let queries = rays.iter().map(|ray| Query::straight(ray.origin, ray.direction, view.scene_root(0))).enumerate();
    Traverser::new().closest_hits(simd, view, queries, |i, _, hit| hits[i] = hit);
}
