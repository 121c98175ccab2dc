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
    /// The smaller of two numbers.
    fn min(self, other: Self) -> Self;
    /// The larger of two numbers.
    fn max(self, other: Self) -> Self;
    /// `then` where `a < b`, `otherwise` elsewhere; both are evaluated.
    fn select_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self;

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
    fn min(self, other: Self) -> Self {
        f64::min(self, other)
    }
    fn max(self, other: Self) -> Self {
        f64::max(self, other)
    }
    fn select_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
        if a < b { then } else { otherwise }
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
