//! Analytic primitives: sphere, parallelogram, box under an affine map.

use super::constants::*;
use super::layout::Primitive;
use super::sampling::frame_from_world;
use crate::simd::{Lane, Vector, vector};
use glam::{Vec2, Vec3, vec2, vec3};

/// Ray parameter in (0, t_max) where the ray meets the sphere, or -1 (Haines et al., Ray Tracing Gems, chapter 7).
#[inline(always)]
pub fn intersect_sphere(origin: Vec3, direction: Vec3, center: Vec3, radius: f32, t_max: f32) -> f32 {
    let f = origin - center;
    let a = direction.dot(direction);
    let inverse_a = 1.0 / a;
    let b = -f.dot(direction);
    let nearest = f + direction * (b * inverse_a);
    let discriminant = radius * radius - nearest.dot(nearest);
    if discriminant < 0.0 {
        return -1.0;
    }
    let c = f.dot(f) - radius * radius;
    let root = (a * discriminant).sqrt();
    let q = if b < 0.0 { b - root } else { b + root };
    let (first, second) = (c / q, q * inverse_a);
    let (near, far) = (first.min(second), first.max(second));
    let t = if near > 0.0 { near } else { far };
    if t > 0.0 && t < t_max { t } else { -1.0 }
}

/// Ray parameter in (0, t_max) and coordinates along `edge_u` and `edge_v` where the ray meets the parallelogram; t = -1 elsewhere.
#[inline(always)]
pub fn intersect_quad<L: Lane<Real = f32>>(
    token: L::Token,
    origin: Vector<L>,
    direction: Vector<L>,
    corner: Vector<L>,
    edge_u: Vector<L>,
    edge_v: Vector<L>,
    t_max: L,
) -> Vector<L> {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    let normal = edge_u.cross(edge_v);
    let t = normal.dot(corner - origin) / normal.dot(direction);
    let p = origin + direction * t - corner;
    let scale = one / normal.dot(normal);
    let u = p.cross(edge_v).dot(normal) * scale;
    let v = edge_u.cross(p).dot(normal) * scale;
    // The least distance from an edge: not negative on it, and a number.
    let margin = u.min(one - u).min(v.min(one - v));
    let inside = L::splat(token, -f32::MIN_POSITIVE).lt(margin);
    let ahead = L::both(zero.lt(t), t.lt(t_max));
    Vector::select(L::both(inside, ahead), vector(t, u, v), vector(-one, zero, zero))
}

/// Row `i` of an affine map applied to a point (`w` = 1) or a vector (`w` = 0).
#[inline(always)]
pub fn affine_row(primitive: &Primitive, i: usize, v: Vec3, w: f32) -> f32 {
    let d = &primitive.data;
    d[4 * i] * v.x + d[4 * i + 1] * v.y + d[4 * i + 2] * v.z + d[4 * i + 3] * w
}

/// Ray parameter in (0, t_max) where the ray meets the box, or -1.
#[inline(always)]
pub fn intersect_box(origin: Vec3, direction: Vec3, primitive: &Primitive, t_max: f32) -> f32 {
    let mut near = -FAR;
    let mut far = FAR;
    for i in 0..3 {
        let o = affine_row(primitive, i, origin, 1.0);
        let d = affine_row(primitive, i, direction, 0.0);
        let inverse = 1.0 / if d.abs() < MIN_DIRECTION { MIN_DIRECTION } else { d };
        let t0 = -o * inverse;
        let t1 = (1.0 - o) * inverse;
        near = near.max(t0.min(t1));
        far = far.min(t0.max(t1));
    }
    let t = if near > 0.0 { near } else { far };
    if near <= far && t > 0.0 && t < t_max { t } else { -1.0 }
}

/// Ray parameter (or -1) where the ray meets an annulus, and the distance from its center there.
#[inline(always)]
pub fn intersect_disc(origin: Vec3, direction: Vec3, primitive: &Primitive, t_max: f32) -> Vec3 {
    let d = &primitive.data;
    let from_center = origin - vec3(d[0], d[1], d[2]);
    let normal = vec3(d[4], d[5], d[6]);
    let t = -from_center.dot(normal) / direction.dot(normal);
    let radius = (from_center + direction * t).length();
    if t > 0.0 && t < t_max && radius >= d[3] && radius <= d[7] { vec3(t, radius, 0.0) } else { vec3(-1.0, 0.0, 0.0) }
}

/// Ray parameter (or -1) and surface coordinates where the ray meets `primitive`.
#[inline(always)]
pub fn intersect_primitive(primitive: &Primitive, origin: Vec3, direction: Vec3, t_max: f32) -> Vec3 {
    let d = &primitive.data;
    let first = vec3(d[0], d[1], d[2]);
    if primitive.kind == PRIMITIVE_SPHERE {
        return vec3(intersect_sphere(origin, direction, first, d[3], t_max), 0.0, 0.0);
    }
    if primitive.kind == PRIMITIVE_QUAD {
        let (edge_u, edge_v) = (vector(d[3], d[4], d[5]), vector(d[6], d[7], d[8]));
        return intersect_quad((), origin.into(), direction.into(), first.into(), edge_u, edge_v, t_max).into();
    }
    if primitive.kind == PRIMITIVE_DISC {
        return intersect_disc(origin, direction, primitive, t_max);
    }
    vec3(intersect_box(origin, direction, primitive, t_max), 0.0, 0.0)
}

/// Axis of the box face nearest to the unit-cube point, and its side: 2 * axis + (1 at the far face).
#[inline(always)]
pub fn box_face(local: Vec3) -> usize {
    let offset = local - Vec3::splat(0.5);
    let size = offset.abs();
    let axis = if size.x > size.y && size.x > size.z {
        0
    } else if size.y > size.z {
        1
    } else {
        2
    };
    2 * axis + (offset[axis] > 0.0) as usize
}

/// Outward unit normal at a point of the surface.
#[inline(always)]
pub fn primitive_normal(primitive: &Primitive, position: Vec3) -> Vec3 {
    let d = &primitive.data;
    if primitive.kind == PRIMITIVE_SPHERE {
        return (position - vec3(d[0], d[1], d[2])).normalize();
    }
    if primitive.kind == PRIMITIVE_QUAD {
        return vec3(d[9], d[10], d[11]);
    }
    if primitive.kind == PRIMITIVE_DISC {
        return vec3(d[4], d[5], d[6]);
    }
    let face = box_face(box_local(primitive, position));
    let row = 4 * (face / 2);
    let normal = vec3(d[row], d[row + 1], d[row + 2]).normalize();
    if face % 2 == 1 { normal } else { -normal }
}

/// A point of the world in the box's unit cube.
#[inline(always)]
pub fn box_local(primitive: &Primitive, position: Vec3) -> Vec3 {
    vec3(affine_row(primitive, 0, position, 1.0), affine_row(primitive, 1, position, 1.0), affine_row(primitive, 2, position, 1.0))
}

/// Texture coordinates at a point of the surface; `uv` are those of the intersection.
#[inline(always)]
pub fn primitive_uv(primitive: &Primitive, position: Vec3, uv: Vec2) -> Vec2 {
    if primitive.kind == PRIMITIVE_SPHERE {
        let n = primitive_normal(primitive, position);
        return vec2(0.5 + n.x.atan2(n.z) / TAU, 1.0 - n.y.clamp(-1.0, 1.0).acos() * INV_PI);
    }
    if primitive.kind == PRIMITIVE_QUAD {
        return uv;
    }
    if primitive.kind == PRIMITIVE_DISC {
        // Around the normal from an arbitrary direction, and outward.
        let d = &primitive.data;
        let local = frame_from_world((), vector(d[4], d[5], d[6]), (position - vec3(d[0], d[1], d[2])).into());
        return vec2(0.5 + local.y.atan2(local.x) / TAU, (uv.x - d[3]) / (d[7] - d[3]));
    }
    let local = box_local(primitive, position);
    let axis = box_face(local) / 2;
    if axis == 0 {
        vec2(local.z, local.y)
    } else if axis == 1 {
        vec2(local.x, local.z)
    } else {
        vec2(local.x, local.y)
    }
}
