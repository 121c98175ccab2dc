//! Ray against triangle (Moeller and Trumbore 1997), over any number of lanes.

use super::constants::TRIANGLE_SLACK;
use crate::simd::Lane;

/// Distance and barycentric coordinates of the meeting point, valid where the mask is set.
pub struct TriangleHit<L: Lane> {
    /// Ray parameter.
    pub t: L,
    /// Weight of the second vertex.
    pub u: L,
    /// Weight of the third vertex.
    pub v: L,
    /// Lanes that hit.
    pub mask: L::Mask,
}

/// Scalar product.
#[inline(always)]
pub fn dot<L: Lane>(a: [L; 3], b: [L; 3]) -> L {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Vector product.
#[inline(always)]
pub fn cross<L: Lane>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1].mul_add(b[2], -(a[2] * b[1])), a[2].mul_add(b[0], -(a[0] * b[2])), a[0].mul_add(b[1], -(a[1] * b[0]))]
}

/// Meets the triangle (vertex, vertex + edge1, vertex + edge2) for ray parameters in (0, t_max).
#[inline(always)]
pub fn intersect_triangle<L: Lane<Real = f32>>(
    token: L::Token,
    origin: [L; 3],
    direction: [L; 3],
    vertex: [L; 3],
    edge1: [L; 3],
    edge2: [L; 3],
    t_max: L,
) -> TriangleHit<L> {
    let p = cross(direction, edge2);
    let inverse = L::splat(token, 1.0) / dot(edge1, p);
    let s = [origin[0] - vertex[0], origin[1] - vertex[1], origin[2] - vertex[2]];
    let u = dot(s, p) * inverse;
    let q = cross(s, edge1);
    let v = dot(direction, q) * inverse;
    let t = dot(edge2, q) * inverse;
    let low = L::splat(token, -TRIANGLE_SLACK);
    let high = L::splat(token, 1.0 + TRIANGLE_SLACK);
    let inside = L::both(L::both(low.lt(u), low.lt(v)), (u + v).lt(high));
    let ahead = L::both(L::splat(token, 0.0).lt(t), t.lt(t_max));
    TriangleHit { t, u, v, mask: L::both(inside, ahead) }
}
