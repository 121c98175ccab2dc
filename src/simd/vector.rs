//! A vector of three lanes with the operators of a vector, for kernels that read like their GLSL twins.

use super::{Lane, MAX_LANES};
use glam::Vec3;
use std::ops::{Add, Mul, Neg, Sub};

/// A vector, or one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Vector<L> {
    /// First component.
    pub x: L,
    /// Second component.
    pub y: L,
    /// Third component.
    pub z: L,
}

/// The vector (x, y, z).
#[inline(always)]
pub fn vector<L>(x: L, y: L, z: L) -> Vector<L> {
    Vector { x, y, z }
}

impl<L: Lane> Vector<L> {
    /// The same vector in every lane.
    #[inline(always)]
    pub fn constant(token: L::Token, v: [f32; 3]) -> Self {
        vector(L::constant(token, v[0].into()), L::constant(token, v[1].into()), L::constant(token, v[2].into()))
    }
    /// The same number three times.
    #[inline(always)]
    pub fn uniform(value: L) -> Self {
        vector(value, value, value)
    }
    /// A vector per lane, by its number.
    #[inline(always)]
    pub fn by_lane(token: L::Token, mut of_lane: impl FnMut(usize) -> Vector<L::Real>) -> Self {
        let [mut x, mut y, mut z] = [[L::Real::default(); MAX_LANES]; 3];
        for lane in 0..L::LANES {
            let v = of_lane(lane);
            (x[lane], y[lane], z[lane]) = (v.x, v.y, v.z);
        }
        vector(L::load(token, &x), L::load(token, &y), L::load(token, &z))
    }
    /// One row of lanes per component.
    #[inline(always)]
    pub fn rows(self) -> [[L::Real; MAX_LANES]; 3] {
        let mut rows = [[L::Real::default(); MAX_LANES]; 3];
        self.x.store(&mut rows[0]);
        self.y.store(&mut rows[1]);
        self.z.store(&mut rows[2]);
        rows
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        self.x.mul_add(other.x, self.y.mul_add(other.y, self.z * other.z))
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let (a, b) = (self, other);
        vector(a.y.mul_add(b.z, -(a.z * b.y)), a.z.mul_add(b.x, -(a.x * b.z)), a.x.mul_add(b.y, -(a.y * b.x)))
    }
    /// The unit vector of the same direction.
    #[inline(always)]
    pub fn normalize(self, token: L::Token) -> Self {
        self * (L::constant(token, 1.0) / self.dot(self).sqrt())
    }
    /// Product of each component.
    #[inline(always)]
    pub fn scale(self, other: Self) -> Self {
        vector(self.x * other.x, self.y * other.y, self.z * other.z)
    }
    /// `then` where the mask is set, `otherwise` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, then: Self, otherwise: Self) -> Self {
        vector(L::select(mask, then.x, otherwise.x), L::select(mask, then.y, otherwise.y), L::select(mask, then.z, otherwise.z))
    }
}

impl<L: Lane> Add for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        vector(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl<L: Lane> Sub for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        vector(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl<L: Lane> Mul<L> for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        vector(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl<L: Lane> Neg for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        vector(-self.x, -self.y, -self.z)
    }
}

impl From<Vec3> for Vector<f32> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        vector(v.x, v.y, v.z)
    }
}

impl From<[f32; 3]> for Vector<f32> {
    #[inline(always)]
    fn from(v: [f32; 3]) -> Self {
        vector(v[0], v[1], v[2])
    }
}

impl From<Vector<f32>> for [f32; 3] {
    #[inline(always)]
    fn from(v: Vector<f32>) -> Self {
        [v.x, v.y, v.z]
    }
}

impl From<Vector<f32>> for Vec3 {
    #[inline(always)]
    fn from(v: Vector<f32>) -> Self {
        Vec3::new(v.x, v.y, v.z)
    }
}
