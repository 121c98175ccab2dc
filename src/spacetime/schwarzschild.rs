//! Black holes at rest, neutral and charged, in isotropic coordinates.
//!
//! Schwarzschild: ds^2 = -((1-u)/(1+u))^2 dt^2 + (1+u)^4 dx.dx with u = M / (2 rho); light sees the index n = (1+u)^3 / (1-u).
//! Reissner-Nordstroem: with s = (1+u)^2 - (Q / 2 rho)^2 the areal radius is rho s, the lapse (1 - (M^2 - Q^2) / 4 rho^2) / s.
//! Space is conformally flat in this chart, so coordinate angles are the angles a static observer measures. The horizon is at
//! rho = sqrt(M^2 - Q^2) / 2; without charge the photon sphere is at rho = (2 + sqrt 3) M / 2.

use super::{Medium, NoParameters, Scalar, Vec3, parameters, step_past_center};

/// Schwarzschild's vacuum as an optical medium.
pub struct Schwarzschild;
/// The charged hole as an optical medium.
pub struct ReissnerNordstrom;

parameters! {
    /// A hole at the origin of the model.
    Hole {
        /// Mass M, a length (G = c = 1).
        mass
    }
}

parameters! {
    /// A charged hole at the origin of the model.
    ChargedHole {
        /// Mass M, a length.
        mass,
        /// Charge Q, a length of at most M.
        charge
    }
}

/// Rays that come below this many horizon radii are captured.
pub const CAPTURE_RADIUS: f64 = 1.01;

impl Medium for Schwarzschild {
    type Global<S: Scalar> = Hole<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(hole: &Hole<S>, x: Vec3<S>, _: S, _: S) -> S {
        let one = S::constant(1.0);
        let u = hole.mass * S::constant(0.5) / x.length();
        (one + u).cube() / (one - u)
    }

    fn lapse<S: Scalar>(hole: &Hole<S>, x: Vec3<S>, _: S) -> S {
        let one = S::constant(1.0);
        let u = hole.mass * S::constant(0.5) / x.length();
        (one - u) / (one + u)
    }

    fn capture_distance<S: Scalar>(hole: &Hole<S>, x: Vec3<S>, _: S) -> S {
        x.length() - hole.mass * S::constant(0.5 * CAPTURE_RADIUS)
    }

    fn safe_step<S: Scalar>(_: &Hole<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_center(x, x.length(), d, 0.7)
    }
}

impl<S: Scalar> ChargedHole<S> {
    /// Areal over isotropic radius, and lapse, at isotropic radius `rho`.
    fn scale_and_lapse(&self, rho: S) -> (S, S) {
        let one = S::constant(1.0);
        let half = S::constant(0.5) / rho;
        let charge2 = (self.charge * half).square();
        let mass = self.mass * half;
        let scale = (one + mass).square() - charge2;
        (scale, (one - mass.square() + charge2) / scale)
    }
}

impl Medium for ReissnerNordstrom {
    type Global<S: Scalar> = ChargedHole<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(hole: &ChargedHole<S>, x: Vec3<S>, _: S, _: S) -> S {
        let (scale, lapse) = hole.scale_and_lapse(x.length());
        scale / lapse
    }

    fn lapse<S: Scalar>(hole: &ChargedHole<S>, x: Vec3<S>, _: S) -> S {
        hole.scale_and_lapse(x.length()).1
    }

    fn capture_distance<S: Scalar>(hole: &ChargedHole<S>, x: Vec3<S>, _: S) -> S {
        // Of an extremal hole the horizon is the origin: its throat is cut off where no light comes back.
        let horizon2 = (hole.mass.square() - hole.charge.square()).max(hole.mass.square() * S::constant(1e-4));
        x.length() - horizon2.sqrt() * S::constant(0.5 * CAPTURE_RADIUS)
    }

    fn safe_step<S: Scalar>(_: &ChargedHole<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        // An extremal hole's index grows as r^-2: at its present speed a ray is at the center after a third of the distance.
        step_past_center(x, x.length(), d, 0.25)
    }
}
