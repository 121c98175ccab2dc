//! Rigidly rotating disc of dust (Neugebauer and Meinel 1995; Weiskopf 2000 looked at it).
//!
//! ds^2 = e^{2 alpha} (drho^2 + dzeta^2) + rho^2 e^{-2 nu} (dphi - omega dt)^2 - e^{2 nu} dt^2, in units of the disc's radius: lapse e^nu,
//! shift -omega (s cross x), gamma^ij = e^{-2 alpha} delta^ij + e^{2 nu} (1 - e^{-2 (alpha + nu)}) phi^i phi^j, s the axis and phi the unit
//! vector around it. nu = n c, omega = w c^3 and alpha + nu = rho^2 q c^4 with c = (1 + xi^2)^(-1/2); (n, w, q) come from a table over
//! s = xi / (1 + xi) and eta, oblate spheroidal coordinates rho = sqrt((1 + xi^2) (1 - eta^2)), |zeta| = xi eta. `solve` computes what `table` holds.

pub mod solve;
pub mod table;

use super::{Dyadic, Metric, Scalar, Scaled, Vec3, parameters};

/// The disc of dust.
pub struct DustDisc;

parameters! {
    /// A disc around the origin.
    DustParameters {
        /// Radius of its rim.
        radius,
        /// Unit axis of its rotation.
        ax, ay, az
    }
}

impl<S: Scalar> DustParameters<S> {
    fn axis(&self) -> Vec3<S> {
        Vec3(self.ax, self.ay, self.az)
    }

    /// Oblate spheroidal xi and eta of a point, and the square of its distance from the axis in radii.
    fn spheroidal(&self, x: Vec3<S>) -> (S, S, S) {
        let x = x * (S::constant(1.0) / self.radius);
        let (zero, half) = (S::constant(0.0), S::constant(0.5));
        let z = x.dot(self.axis());
        let height = z.max(-z);
        let r2 = x.dot(x);
        let excess = r2 - S::constant(1.0);
        let root = (excess.square() + height.square() * S::constant(4.0)).max(S::constant(1e-12)).sqrt();
        // Of the two the one that has no cancellation; the other follows from xi eta = |zeta|.
        let tiny = S::constant(1e-12);
        let large_xi = ((root + excess) * half).max(tiny).sqrt();
        let large_eta = ((root - excess) * half).max(tiny).sqrt();
        let xi = S::select_less(excess, zero, height / large_eta, large_xi);
        let eta = S::select_less(excess, zero, large_eta, height / large_xi).min(S::constant(1.0));
        (xi, eta, r2 - z.square())
    }

    /// nu, omega and (alpha + nu) / rho^2 from the table's entries at a point.
    fn functions(&self, xi: S, table: [S; 3]) -> (S, S, S) {
        let one = S::constant(1.0);
        let c2 = one / (one + xi.square());
        let c = c2.sqrt();
        (table[0] * c, table[1] * c * c2, table[2] * c2.square())
    }
}

impl Metric for DustDisc {
    type Global<S: Scalar> = DustParameters<S>;
    const HAS_TABLE: bool = true;

    fn table_point<S: Scalar>(disc: &DustParameters<S>, x: Vec3<S>) -> [S; 2] {
        let (xi, eta, _) = disc.spheroidal(x);
        [xi / (S::constant(1.0) + xi), eta]
    }

    fn lapse_squared<S: Scalar>(disc: &DustParameters<S>, x: Vec3<S>, table: [S; 3]) -> S {
        (disc.functions(disc.spheroidal(x).0, table).0 * S::constant(2.0)).exp()
    }

    fn shift<S: Scalar>(disc: &DustParameters<S>, x: Vec3<S>, table: [S; 3]) -> Scaled<S> {
        let omega = disc.functions(disc.spheroidal(x).0, table).1 / disc.radius;
        Scaled { factor: -omega, v: disc.axis().cross(x) }
    }

    fn inverse_metric<S: Scalar>(disc: &DustParameters<S>, x: Vec3<S>, table: [S; 3]) -> Dyadic<S> {
        let one = S::constant(1.0);
        let (xi, _, rho2) = disc.spheroidal(x);
        let (nu, _, kappa) = disc.functions(xi, table);
        let y = kappa * rho2 * S::constant(2.0);
        let meridional = (nu * S::constant(2.0) - y).exp();
        // (1 - e^-y) / y, by its series where the difference would lose its digits.
        let series = one - y * S::constant(0.5) * (one - y * S::constant(1.0 / 3.0) * (one - y * S::constant(0.25)));
        let near = y.max(-y);
        let divisor = S::select_less(near, S::constant(1e-2), one, y);
        let share = S::select_less(near, S::constant(1e-2), series, (one - (-y).exp()) / divisor);
        let around = (nu * S::constant(2.0)).exp() * share * kappa * S::constant(2.0) / disc.radius.square();
        Dyadic { diagonal: meridional, factor: around, v: disc.axis().cross(x) }
    }

    fn safe_step<S: Scalar>(disc: &DustParameters<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        disc.radius * (disc.spheroidal(x).0 * S::constant(0.3) + S::constant(0.05))
    }
}
