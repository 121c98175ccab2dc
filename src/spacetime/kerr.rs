//! Rotating black holes, neutral or charged, in ingoing Kerr-Schild coordinates.
//!
//! g = eta + f l l with f = r^2 (2 M r - Q^2) / (r^4 + a^2 z^2), l = (1, (r x + a x cross s + (a^2 z / r) s) / (r^2 + a^2)), s the spin axis,
//! z = x . s and r from (|x|^2 - z^2) / (r^2 + a^2) + z^2 / r^2 = 1. In 3+1 form: lapse (1 + f)^(-1/2), shift f / (1 + f) l,
//! gamma^ij = delta^ij - f / (1 + f) l^i l^j. The chart is regular at the horizon, so cameras may be inside.
//!
//! A photon followed into its future is captured at r = M + sqrt(M^2 - a^2 - Q^2). One followed into its past never crosses the
//! horizon inward in this chart: it is captured when its frequency has grown a thousandfold, which happens there only.

use super::{Dyadic, Metric, Scalar, Vec3, parameters};

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
        /// Unit axis of the spin.
        ax, ay, az
    }
}

/// Growth of frequency at which a photon followed into its past is captured.
const CAPTURE_BLUESHIFT: f64 = 1000.0;
/// Distance from the horizon, as a share of the mass, below which nothing gets finer: light orbits a spin of 0.998 there.
const LEAST_HEIGHT: f64 = 0.01;
/// Share of the horizon's radius that is cut out around the singularity.
const SINGULARITY: f64 = 0.02;

impl<S: Scalar> SpinningHole<S> {
    fn axis(&self) -> Vec3<S> {
        Vec3(self.ax, self.ay, self.az)
    }

    /// Boyer-Lindquist radius r and height z = x . s.
    fn radius(&self, x: Vec3<S>) -> (S, S) {
        let z = x.dot(self.axis());
        let w = x.dot(x) - self.spin.square();
        let product = (self.spin * z).square();
        let root = (w.square() + product * S::constant(4.0)).sqrt();
        // The other root of the same equation has no cancellation inside the ring.
        let tiny = S::constant(1e-30);
        let outside = (w + root) * S::constant(0.5);
        let inside = product * S::constant(2.0) / (root - w).max(tiny);
        let r2 = S::select_less(w, S::constant(0.0), inside, outside).max(tiny);
        (r2.sqrt(), z)
    }

    /// Radius of the outer horizon.
    fn horizon(&self) -> S {
        self.mass + (self.mass.square() - self.spin.square() - self.charge.square()).max(S::constant(0.0)).sqrt()
    }

    /// f / (1 + f), 1 + f, and l.
    fn kerr_schild(&self, x: Vec3<S>) -> (S, S, Vec3<S>) {
        let (r, z) = self.radius(x);
        let r2 = r.square();
        let a2 = self.spin.square();
        let f = r2 * (self.mass * r * S::constant(2.0) - self.charge.square()) / (r2.square() + a2 * z.square());
        let l = (x * r + x.cross(self.axis()) * self.spin + self.axis() * (a2 * z / r)) * (S::constant(1.0) / (r2 + a2));
        let one_plus = S::constant(1.0) + f;
        (f / one_plus, one_plus, l)
    }
}

impl Metric for KerrNewman {
    type Global<S: Scalar> = SpinningHole<S>;

    fn lapse<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> S {
        S::constant(1.0) / hole.kerr_schild(x).1.sqrt()
    }

    fn shift<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> Vec3<S> {
        let (share, _, l) = hole.kerr_schild(x);
        l * share
    }

    fn inverse_metric<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, _: [S; 3]) -> Dyadic<S> {
        let (share, _, l) = hole.kerr_schild(x);
        Dyadic { diagonal: S::constant(1.0), factor: -share, v: l }
    }

    fn coordinate_radius<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>) -> S {
        hole.radius(x).0
    }

    fn capture_distance<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>, blueshift: S, sense: S) -> S {
        let (r, _) = hole.radius(x);
        let horizon = hole.horizon();
        let past = (S::constant(CAPTURE_BLUESHIFT) - blueshift).min(r - horizon * S::constant(SINGULARITY));
        S::select_less(sense, S::constant(0.0), past, r - horizon)
    }

    fn safe_step<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>) -> S {
        hole.radius(x).0 * S::constant(0.7)
    }

    fn detail<S: Scalar>(hole: &SpinningHole<S>, x: Vec3<S>) -> S {
        // The closer to the horizon, on either side, the longer light orbits there and the more an error grows.
        let r = hole.radius(x).0;
        let above = r - hole.horizon();
        let height = above.max(-above).max(hole.mass * S::constant(LEAST_HEIGHT));
        (r * S::constant(0.7)).min(height * (height / hole.mass).sqrt() * S::constant(0.2))
    }
}
