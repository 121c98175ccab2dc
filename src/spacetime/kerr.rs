//! Rotating black holes, neutral or charged, in ingoing Kerr-Schild coordinates.
//!
//! g = eta + f l l with f = (2 M r - Q^2) / Sigma, l = (1, (r x + a x cross s + (a^2 z / r) s) / (r^2 + a^2)), s the axis of the spin,
//! z = x . s, r from (|x|^2 - z^2) / (r^2 + a^2) + z^2 / r^2 = 1, and Sigma = r^2 + a^2 z^2 / r^2. In 3+1 form: lapse (1 + f)^(-1/2), shift
//! f / (1 + f) l, gamma^ij = delta^ij - f / (1 + f) l^i l^j. The chart is regular at the horizon, so cameras may be inside.
//!
//! A photon followed into its future is captured at r = M + sqrt(M^2 - a^2 - Q^2). One followed into its past never crosses the
//! horizon inward in this chart: it is captured when its frequency has grown a thousandfold, which happens there only.

use super::{Dyadic, Metric, Scalar, Scaled, Vec3, parameters, step_past_center};

/// The rotating, charged hole.
pub struct KerrNewman;

parameters! {
    /// A hole at the origin of the model.
    SpinningHole {
        /// Mass M, a length.
        mass,
        /// Spin a = J / M, a length.
        spin,
        /// Charge Q, a length.
        charge,
        /// Radius of the outer horizon, M + sqrt(M^2 - a^2 - Q^2).
        horizon,
        /// The spin along its axis: the vector a s.
        sx, sy, sz
    }
}

/// Growth of frequency at which a photon followed into its past is captured.
const CAPTURE_BLUESHIFT: f64 = 1000.0;
/// Distance from the horizon, as a share of the mass, below which nothing gets finer: light orbits a spin of 0.998 there.
const LEAST_HEIGHT: f64 = 0.01;
/// Share of the horizon's radius that is cut out around the singularity.
const SINGULARITY: f64 = 0.02;

impl<S: Scalar> SpinningHole<S> {
    /// Where `x` is in spheroidal coordinates about the ring.
    fn spheroidal(&self, x: Vec3<S>) -> Spheroidal<S> {
        let spin = Vec3(self.sx, self.sy, self.sz);
        let spin_height = x.dot(spin);
        let w = x.dot(x) - self.spin.square();
        let product = spin_height.square();
        // r^2 is the positive root of q^2 - w q - a^2 z^2, whose slope there is the root of its discriminant. A step of Newton's method
        // gives it back the digits it has lost inside the ring, and has its derivatives.
        let slope = (w.square() + product * S::constant(4.0)).sqrt().held();
        let root = ((w + slope) * S::constant(0.5)).held();
        let r2 = (root - (root * (root - w) - product) / slope).max(S::constant(1e-30));
        Spheroidal { spin, spin_height, r2, r: r2.sqrt(), sigma: r2 * S::constant(2.0) - w }
    }

    /// 1 / (1 + f), f / (1 + f), and l.
    fn kerr_schild(&self, x: Vec3<S>) -> (S, S, Vec3<S>) {
        let Spheroidal { spin, spin_height, r2, r, sigma } = self.spheroidal(x);
        let strength = self.mass * r * S::constant(2.0) - self.charge.square();
        let l = (x * r + x.cross(spin) + spin * (spin_height / r)) * (S::constant(1.0) / (r2 + self.spin.square()));
        let whole = sigma + strength;
        (sigma / whole, strength / whole, l)
    }
}

/// A point in spheroidal coordinates about the ring.
struct Spheroidal<S> {
    /// The spin along its axis, a s.
    spin: Vec3<S>,
    /// a z, with z = x . s.
    spin_height: S,
    /// The Boyer-Lindquist radius, squared; never zero.
    r2: S,
    /// The radius.
    r: S,
    /// Sigma.
    sigma: S,
}

impl Metric for KerrNewman {
    type Global<S: Scalar> = SpinningHole<S>;

    fn lapse_squared<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> S {
        hole.kerr_schild(x).0
    }

    fn shift<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> Scaled<S> {
        let (_, factor, v) = hole.kerr_schild(x);
        Scaled { factor, v }
    }

    fn inverse_metric<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> Dyadic<S> {
        let (_, share, v) = hole.kerr_schild(x);
        Dyadic { diagonal: S::constant(1.0), factor: -share, v }
    }

    fn coordinate_radius<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>) -> S {
        hole.spheroidal(x).r
    }

    fn capture_distance<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, blueshift: S, sense: S) -> S {
        let r = hole.spheroidal(x).r;
        let past = (S::constant(CAPTURE_BLUESHIFT) - blueshift).min(r - hole.horizon * S::constant(SINGULARITY));
        S::select_less(sense, S::constant(0.0), past, r - hole.horizon)
    }

    fn safe_step<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_center(x, hole.spheroidal(x).r, d, 0.5)
    }

    fn detail<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>) -> S {
        // The closer to the horizon, on either side, the longer light orbits there and the more an error grows.
        let r = hole.spheroidal(x).r;
        let above = r - hole.horizon;
        let height = above.max(-above).max(hole.mass * S::constant(LEAST_HEIGHT));
        (r * S::constant(0.7)).min(height * (height / hole.mass).sqrt() * S::constant(0.2))
    }
}
