//! The number type a bending model is written over.
//!
//! A model is a formula over `Scalar`. With `f64` it evaluates, with [`super::expr::Expr`] it becomes a graph that is
//! differentiated and emitted for both backends, with a dual number (tests) it differentiates forward.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number a formula can be written over. Branches are written with [`Scalar::select_less`].
pub trait Scalar: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self> {
    /// The number `value`.
    fn constant(value: f64) -> Self;
    /// Square root of a number >= 0.
    fn sqrt(self) -> Self;
    /// e to the power `self`.
    fn exp(self) -> Self;
    /// Natural logarithm of a number > 0.
    fn ln(self) -> Self;
    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Arc tangent in radians.
    fn atan(self) -> Self;
    /// The smaller of two numbers.
    fn min(self, other: Self) -> Self;
    /// The larger of two numbers.
    fn max(self, other: Self) -> Self;
    /// `then` where `a < b`, `otherwise` elsewhere; both are evaluated.
    fn select_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self;
    /// The same number, which differentiation takes for a constant.
    fn held(self) -> Self;

    /// Hyperbolic tangent; saturated beyond 20, where it is 1 in double precision.
    fn tanh(self) -> Self {
        let limit = Self::constant(20.0);
        let doubled = (self.min(limit).max(-limit) * Self::constant(2.0)).exp();
        Self::constant(1.0) - Self::constant(2.0) / (doubled + Self::constant(1.0))
    }
    /// `self` squared.
    fn square(self) -> Self {
        self * self
    }
    /// `self` cubed.
    fn cube(self) -> Self {
        self * self * self
    }
}

impl Scalar for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn ln(self) -> Self {
        f64::ln(self)
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn atan(self) -> Self {
        f64::atan(self)
    }
    fn min(self, other: Self) -> Self {
        f64::min(self, other)
    }
    fn max(self, other: Self) -> Self {
        f64::max(self, other)
    }
    fn select_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
        if a < b { then } else { otherwise }
    }
    fn held(self) -> Self {
        self
    }
}

/// A point or a vector over [`Scalar`].
#[derive(Clone, Copy, Debug)]
pub struct Vec3<S>(pub S, pub S, pub S);

impl<S: Scalar> Vec3<S> {
    /// Scalar product.
    pub fn dot(self, other: Self) -> S {
        self.0 * other.0 + self.1 * other.1 + self.2 * other.2
    }
    /// Length of a vector that is never zero.
    pub fn length(self) -> S {
        self.dot(self).sqrt()
    }
    /// Length with a floor of 1e-15 that keeps the derivative finite (zero) at the origin.
    pub fn length_or_zero(self) -> S {
        self.dot(self).max(S::constant(1e-30)).sqrt()
    }
}

impl<S: Scalar> Vec3<S> {
    /// The vector (0, 0, 0).
    pub fn zero() -> Self {
        Vec3(S::constant(0.0), S::constant(0.0), S::constant(0.0))
    }
    /// Vector product.
    pub fn cross(self, other: Self) -> Self {
        Vec3(self.1 * other.2 - self.2 * other.1, self.2 * other.0 - self.0 * other.2, self.0 * other.1 - self.1 * other.0)
    }
}

/// The vector factor * v, whose product with another goes through v alone.
#[derive(Clone, Copy, Debug)]
pub struct Scaled<S> {
    /// The factor.
    pub factor: S,
    /// The vector.
    pub v: Vec3<S>,
}

impl<S: Scalar> Scaled<S> {
    /// Scalar product.
    pub fn dot(self, other: Vec3<S>) -> S {
        self.factor * self.v.dot(other)
    }
    /// The vector it is.
    pub fn vector(self) -> Vec3<S> {
        self.v * self.factor
    }
}

/// The symmetric matrix diagonal * identity + factor * v v^T: every spatial metric here has this form.
#[derive(Clone, Copy, Debug)]
pub struct Dyadic<S> {
    /// Factor of the identity, positive.
    pub diagonal: S,
    /// Factor of v v^T.
    pub factor: S,
    /// The vector.
    pub v: Vec3<S>,
}

impl<S: Scalar> Dyadic<S> {
    /// The identity.
    pub fn identity() -> Self {
        Dyadic { diagonal: S::constant(1.0), factor: S::constant(0.0), v: Vec3::zero() }
    }
    /// Matrix times vector.
    pub fn times(self, x: Vec3<S>) -> Vec3<S> {
        x * self.diagonal + self.v * (self.factor * self.v.dot(x))
    }
    /// Vector times matrix times vector.
    pub fn squared(self, x: Vec3<S>) -> S {
        self.diagonal * x.dot(x) + self.factor * self.v.dot(x).square()
    }
    /// The symmetric root of a positive definite matrix.
    pub fn root(self) -> Self {
        let diagonal = self.diagonal.sqrt();
        let along = (self.diagonal + self.factor * self.v.dot(self.v)).sqrt();
        Dyadic { diagonal, factor: self.factor / (along + diagonal), v: self.v }
    }
    /// The inverse of a positive definite matrix.
    pub fn inverse(self) -> Self {
        let along = self.diagonal + self.factor * self.v.dot(self.v);
        Dyadic { diagonal: S::constant(1.0) / self.diagonal, factor: -(self.factor / (self.diagonal * along)), v: self.v }
    }
    /// Its entries: xx, yy, zz, and xy, xz, yz.
    pub fn entries(self) -> (Vec3<S>, Vec3<S>) {
        let Vec3(x, y, z) = self.v;
        let scaled = self.v * self.factor;
        (
            Vec3(self.diagonal + scaled.0 * x, self.diagonal + scaled.1 * y, self.diagonal + scaled.2 * z),
            Vec3(scaled.0 * y, scaled.0 * z, scaled.1 * z),
        )
    }
}

impl<S: Scalar> Add for Vec3<S> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Vec3(self.0 + other.0, self.1 + other.1, self.2 + other.2)
    }
}

impl<S: Scalar> Sub for Vec3<S> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Vec3(self.0 - other.0, self.1 - other.1, self.2 - other.2)
    }
}

impl<S: Scalar> Mul<S> for Vec3<S> {
    type Output = Self;
    fn mul(self, factor: S) -> Self {
        Vec3(self.0 * factor, self.1 * factor, self.2 * factor)
    }
}
