//! A black hole at rest, in isotropic coordinates.
//!
//! ds^2 = -((1-u)/(1+u))^2 dt^2 + (1+u)^4 dx.dx with u = M / (2 rho); light sees the index n = (1+u)^3 / (1-u).
//! Space is conformally flat in this chart, so coordinate angles are the angles a static observer measures.
//! The horizon is at rho = M/2, the photon sphere at rho = (2 + sqrt 3) M / 2.

use super::{Medium, NoParameters, Scalar, Vec3, parameters};

/// Schwarzschild's vacuum as an optical medium.
pub struct Schwarzschild;

parameters! {
    /// The hole, at the origin of the model.
    Hole {
        /// Mass M, a length (G = c = 1).
        mass
    }
}

/// Rays that come below this many masses (isotropic radius) are captured; the horizon is at 0.5.
pub const CAPTURE_RADIUS: f64 = 0.505;

impl Medium for Schwarzschild {
    type Global<S: Scalar> = Hole<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(hole: &Hole<S>, x: Vec3<S>, _: S, _: S) -> S {
        let one = S::constant(1.0);
        let u = hole.mass * S::constant(0.5) / x.length();
        (one + u).cube() / (one - u)
    }

    fn lapse<S: Scalar>(hole: &Hole<S>, x: Vec3<S>) -> S {
        let one = S::constant(1.0);
        let u = hole.mass * S::constant(0.5) / x.length();
        (one - u) / (one + u)
    }

    fn capture_distance<S: Scalar>(hole: &Hole<S>, x: Vec3<S>, _: S) -> S {
        x.length() - hole.mass * S::constant(CAPTURE_RADIUS)
    }

    fn safe_step<S: Scalar>(_: &Hole<S>, x: Vec3<S>) -> S {
        x.length() * S::constant(0.7)
    }
}
