//! Wormholes: Ellis' (Morris and Thorne 1988) and the three-parameter one of James et al. (Am. J. Phys. 83, 486, 2015).
//!
//! ds^2 = -dt^2 + dl^2 + r(l)^2 dOmega^2, l > 0 on one side and l < 0 on the other. Both use the chart l = rho - b^2 / (4 rho), in which the
//! inversion rho -> b^2 / (4 rho) is the isometry l -> -l: a ray that comes below the throat rho = b/2 is inverted and goes on, on the
//! other side, in the same chart. Ellis' r^2 = l^2 + b^2 makes space conformally flat with index 1 + b^2 / (4 rho^2).
//! James': r = b for |l| < a, else b + m (x atan x - ln(1 + x^2) / 2) with x = 2 (|l| - a) / (pi m); the lensing width is W = 1.42953 m.

use super::{Dyadic, Medium, Metric, NoParameters, Scalar, Vec3, parameters, step_past_center};

/// Ellis' wormhole.
pub struct Ellis;
/// The wormhole with a throat of any length and lensing width.
pub struct Dneg;

parameters! {
    /// A throat around the origin.
    Throat {
        /// Radius b.
        radius
    }
}

parameters! {
    /// A throat around the origin.
    LongThroat {
        /// Radius b.
        radius,
        /// Half its length, a.
        half_length,
        /// The parameter m of the lensing width.
        mass
    }
}

/// Lensing width over the parameter m.
pub const LENSING_WIDTH: f64 = 1.42953;

impl Medium for Ellis {
    type Global<S: Scalar> = Throat<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(throat: &Throat<S>, x: Vec3<S>, _: S, _: S) -> S {
        S::constant(1.0) + throat.radius.square() * S::constant(0.25) / x.dot(x)
    }

    fn safe_step<S: Scalar>(_: &Throat<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_center(x, x.length(), d, 0.7)
    }
}

impl Metric for Dneg {
    type Global<S: Scalar> = LongThroat<S>;

    fn inverse_metric<S: Scalar>(throat: &LongThroat<S>, x: Vec3<S>, _: [S; 3]) -> Dyadic<S> {
        let one = S::constant(1.0);
        let rho2 = x.dot(x);
        let rho = rho2.sqrt();
        let inverted = throat.radius.square() * S::constant(0.25) / rho2;
        let l = rho * (one - inverted);
        let beyond = (l.max(-l) - throat.half_length).max(S::constant(0.0));
        let t = beyond * S::constant(std::f64::consts::FRAC_2_PI) / throat.mass;
        let rise = t * t.atan() - (one + t.square()).ln() * S::constant(0.5);
        let areal = throat.radius + throat.mass * rise;
        let across = rho2 / areal.square();
        let along = one / (one + inverted).square();
        Dyadic { diagonal: across, factor: (along - across) / rho2, v: x }
    }

    fn safe_step<S: Scalar>(throat: &LongThroat<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        let rho2 = x.dot(x);
        let l = rho2.sqrt() * (S::constant(1.0) - throat.radius.square() * S::constant(0.25) / rho2);
        let beyond = (l.max(-l) - throat.half_length).max(S::constant(0.0));
        // The profile bends on the scale of the lensing width, on either side of a kink at the throat's end: no step may leap both, outward
        // ones neither.
        (beyond + throat.mass + throat.half_length) * S::constant(0.3)
    }
}
