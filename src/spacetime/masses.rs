//! Many point masses at once: exact for extremally charged holes, approximate for weak ones.
//!
//! Majumdar and Papapetrou: ds^2 = -U^-2 dt^2 + U^2 dx.dx with U = 1 + sum m / r, holes in balance because each carries a charge equal
//! to its mass; light sees n = U^2. Weak fields: n = 1 + 2 sum m / r, the first order of general relativity in m / r.

use super::{Medium, NoParameters, Scalar, Vec3, parameters, step_past_center};

/// Extremal holes in balance.
pub struct MajumdarPapapetrou;
/// Masses whose fields are weak wherever light is followed.
pub struct WeakLens;

parameters! {
    /// One mass.
    PointMass {
        /// Position.
        px, py, pz,
        /// Mass, a length.
        mass
    }
}

/// Rays are captured where the sum of m / r has grown to this.
const CAPTURE_POTENTIAL: f64 = 100.0;

/// Largest step towards a mass as a share of the distance to it. A ray that falls towards one gathers speed as r^-2 and would be there
/// after a third of the distance at its present speed.
const FALL: f64 = 0.25;

impl<S: Scalar> PointMass<S> {
    fn distance(&self, x: Vec3<S>) -> S {
        self.offset(x).length_or_zero()
    }

    fn offset(&self, x: Vec3<S>) -> Vec3<S> {
        x - Vec3(self.px, self.py, self.pz)
    }

    fn safe_step(&self, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_center(self.offset(x), self.distance(x), d, FALL)
    }
}

impl Medium for MajumdarPapapetrou {
    type Global<S: Scalar> = NoParameters;
    type Source<S: Scalar> = PointMass<S>;

    fn source_potential<S: Scalar>(source: &PointMass<S>, x: Vec3<S>) -> S {
        source.mass / source.distance(x)
    }

    fn index<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, _: S) -> S {
        (S::constant(1.0) + potential).square()
    }

    fn lapse<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S) -> S {
        S::constant(1.0) / (S::constant(1.0) + potential)
    }

    fn capture_distance<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S) -> S {
        S::constant(CAPTURE_POTENTIAL) - potential
    }

    fn source_safe_step<S: Scalar>(source: &PointMass<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        source.safe_step(x, d)
    }
}

impl Medium for WeakLens {
    type Global<S: Scalar> = NoParameters;
    type Source<S: Scalar> = PointMass<S>;

    fn source_potential<S: Scalar>(source: &PointMass<S>, x: Vec3<S>) -> S {
        source.mass / source.distance(x)
    }

    fn index<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, _: S) -> S {
        S::constant(1.0) + potential * S::constant(2.0)
    }

    fn lapse<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S) -> S {
        // exp(-U) is 1 - U to first order and stays positive.
        (-potential).exp()
    }

    fn capture_distance<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S) -> S {
        S::constant(CAPTURE_POTENTIAL) - potential
    }

    fn source_safe_step<S: Scalar>(source: &PointMass<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        source.safe_step(x, d)
    }
}
