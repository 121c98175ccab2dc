//! What is where a ray ended: the surface, its look there and what it emits.

use super::bvh::Hit;
use super::constants::*;
use super::layout::{Material, Vertex};
use super::primitive::{primitive_normal, primitive_uv};
use super::texture::sample_texture;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2, vec3};

/// Where a ray ended.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// End point.
    pub position: Vec3,
    /// What was hit, see [`super::bvh::Hit`].
    pub primitive: u32,
    /// Unit direction of travel at the end, or at infinity if escaped.
    pub direction: Vec3,
    /// `STATUS_*`.
    pub status: u32,
    /// Surface coordinate of the hit.
    pub u: f32,
    /// Surface coordinate of the hit.
    pub v: f32,
    /// Coordinate length of the ray.
    pub path_length: f32,
    /// Frequency at the start over frequency at the end, for Eulerian observers and light travelling back along the ray.
    pub redshift: f32,
    /// Integration steps.
    pub steps: u32,
    /// Chords that were handed to the BVH.
    pub chords: u32,
    /// Relative drift of the conserved Hamiltonian.
    pub constraint_error: f32,
    /// Diagonal of the local frame L at a hit; see [`super::integrator::Model::frame`].
    pub frame_diagonal: Vec3,
    /// Its entries xy, xz, yz.
    pub frame_mixed: Vec3,
    /// Frequency at the end over that which orbiting matter there emits: 1 but for accretion discs.
    pub doppler: f32,
    /// Side of a wormhole the ray ended on.
    pub side: u32,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Position, recomputed on the surface itself.
    pub position: Vec3,
    /// Outward unit normal of the geometry.
    pub normal_geometric: Vec3,
    /// Interpolated unit normal.
    pub normal_shading: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Index into the objects.
    pub object: u32,
}

#[inline(always)]
fn vertex_normal(vertex: &Vertex) -> Vec3 {
    Vec3::from(vertex.normal)
}

#[inline(always)]
fn vertex_uv(vertex: &Vertex) -> Vec2 {
    Vec2::from(vertex.uv)
}

/// A surface normal (a covector) as the local observer sees it: L n, normalised.
#[inline(always)]
pub fn local_normal(normal: Vec3, arrival: &Arrival) -> Vec3 {
    let (d, m) = (arrival.frame_diagonal, arrival.frame_mixed);
    let n = normal;
    vec3(d.x * n.x + m.x * n.y + m.y * n.z, m.x * n.x + d.y * n.y + m.z * n.z, m.y * n.x + m.z * n.y + d.z * n.z).normalize()
}

/// Geometry at a hit.
#[inline(always)]
pub fn surface_at(view: &SceneView, arrival: &Arrival) -> Surface {
    let (u, v) = (arrival.u, arrival.v);
    if arrival.primitive & HIT_PRIMITIVE != 0 {
        let primitive = view.primitive(arrival.primitive & CHILD_INDEX);
        let normal = primitive_normal(primitive, arrival.position);
        let mut uv = Vec2::ZERO;
        if (view.material(primitive.object).flags & MATERIAL_TEXTURED) != 0 {
            uv = primitive_uv(primitive, arrival.position, vec2(u, v));
        }
        // A far hit on a sphere has lost digits: put it back on the sphere.
        let d = &primitive.data;
        let position = if primitive.kind == PRIMITIVE_SPHERE { vec3(d[0], d[1], d[2]) + normal * d[3] } else { arrival.position };
        return Surface { position, normal_geometric: normal, normal_shading: normal, uv, object: primitive.object };
    }
    let block = view.block(arrival.primitive / 8);
    let lane = (arrival.primitive % 8) as usize;
    let at = |a: &[[f32; 8]; 3]| vec3(a[0][lane], a[1][lane], a[2][lane]);
    let (edge1, edge2) = (at(&block.edge1), at(&block.edge2));
    let triangle = view.triangle(block.triangle[lane]);
    let corners = triangle.vertices.map(|i| *view.vertex(i));
    let w = 1.0 - u - v;
    let geometric = edge1.cross(edge2).normalize();
    let mut shading = vertex_normal(&corners[0]) * w + vertex_normal(&corners[1]) * u + vertex_normal(&corners[2]) * v;
    let length2 = shading.length_squared();
    shading = if length2 > 1e-12 { shading * (1.0 / length2.sqrt()) } else { geometric };
    Surface {
        position: at(&block.vertex) + edge1 * u + edge2 * v,
        normal_geometric: geometric,
        normal_shading: shading,
        uv: vertex_uv(&corners[0]) * w + vertex_uv(&corners[1]) * u + vertex_uv(&corners[2]) * v,
        object: triangle.object,
    }
}

/// `color` times what a texture, or none (`NO_INDEX`), has at `uv`.
#[inline(always)]
pub fn textured(view: &SceneView, color: Vec3, texture: u32, uv: Vec2) -> Vec3 {
    if texture == NO_INDEX {
        return color;
    }
    color * sample_texture(view, texture, uv).truncate()
}

/// Colour of a material at `uv`.
#[inline(always)]
pub fn base_color_at(view: &SceneView, material: &Material, uv: Vec2) -> Vec3 {
    textured(view, material.base_color.into(), material.base_texture, uv)
}

/// Roughness of a material at `uv` (the green channel of its texture, as in glTF).
#[inline(always)]
pub fn roughness_at(view: &SceneView, material: &Material, uv: Vec2) -> f32 {
    if material.roughness_texture == NO_INDEX {
        return material.roughness;
    }
    material.roughness * sample_texture(view, material.roughness_texture, uv).y
}

/// Radiance of a black body of `temperature` (kelvin), in units in which the luminance at 6500 K is 1.
#[inline(always)]
pub fn black_body(view: &SceneView, temperature: f32) -> Vec3 {
    if temperature < BLACK_BODY_MIN {
        return Vec3::ZERO;
    }
    let last = (BLACK_BODY_SIZE - 1) as f32;
    let at = (temperature / BLACK_BODY_MIN).ln() / (BLACK_BODY_MAX / BLACK_BODY_MIN).ln() * last;
    let index = at.min(last - 1.0).floor();
    let low = view.black_body_entry(index as u32);
    let high = view.black_body_entry(index as u32 + 1);
    let entry = low + (high - low) * (at - index).min(1.0);
    // Beyond the table radiance grows in proportion to temperature (Rayleigh and Jeans).
    vec3(entry.x, entry.y, entry.z) * (entry.w.exp() * (temperature / BLACK_BODY_MAX).max(1.0))
}

/// Radiance a material emits at `uv`, its spectrum shifted by `frequency_ratio` (seen over emitted) if it is thermal: a black body
/// of temperature T is seen as one of temperature g T exactly.
#[inline(always)]
pub fn emission_at(view: &SceneView, material: &Material, uv: Vec2, frequency_ratio: f32) -> Vec3 {
    let mut emission = Vec3::from(material.emission);
    if material.temperature > 0.0 {
        emission *= black_body(view, material.temperature * frequency_ratio);
    }
    textured(view, emission, material.emission_texture, uv)
}

/// Temperature (as a share of the highest) and angular velocity of an accretion disc at `radius` from its center.
#[inline(always)]
pub fn disc_profile(view: &SceneView, material: &Material, radius: f32) -> Vec2 {
    let last = (DISC_PROFILE_SIZE - 1) as f32;
    let at = (radius - material.inner_radius) / (material.outer_radius - material.inner_radius) * last;
    let index = at.floor().clamp(0.0, last - 1.0);
    let low = view.profile_entry(material.profile + index as u32);
    let high = view.profile_entry(material.profile + index as u32 + 1);
    low + (high - low) * (at - index).clamp(0.0, 1.0)
}

/// Coordinate velocity dx/dt of the orbiting matter that was hit, if it was an accretion disc.
#[inline(always)]
pub fn matter_velocity(view: &SceneView, hit: &Hit, position: Vec3) -> Option<Vec3> {
    if hit.primitive == NO_INDEX || hit.primitive & HIT_PRIMITIVE == 0 {
        return None;
    }
    let primitive = view.primitive(hit.primitive & CHILD_INDEX);
    let material = view.material(primitive.object);
    if material.kind != MATERIAL_ACCRETION {
        return None;
    }
    let d = &primitive.data;
    let omega = disc_profile(view, material, hit.u).y;
    Some(vec3(d[4], d[5], d[6]).cross(position - vec3(d[0], d[1], d[2])) * omega)
}
