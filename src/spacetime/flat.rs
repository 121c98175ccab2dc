//! Flat space: light travels straight. The reference every curved picture is compared with.

use super::{Medium, NoParameters, Scalar, Vec3};

/// Refractive index 1 everywhere.
pub struct Flat;

impl Medium for Flat {
    type Global<S: Scalar> = NoParameters;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(_: &NoParameters, _: Vec3<S>, _: S, _: S) -> S {
        S::constant(1.0)
    }
}
