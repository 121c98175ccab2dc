//! Gravity centers and lines (Groeller 1995; Knowles 2019, section 4.2.2), any number at once.
//!
//! The thesis kicks a ray's velocity by g M d(r) along the *unit* vector to the source, with the falloff
//! d(r) = 2 (r/R)^3 - 3 (r/R)^2 + 1 inside the radius of influence R. As an equation of motion (`form = "ode"`):
//! dX/ds = V/|V|, dV/ds = -grad Phi. Since |V| + Phi is conserved along a ray, this is *exactly* an index medium
//! n = E - Phi with E = |V0| + Phi(X0), and V = n t: one potential states the model. An inverse power n of the distance
//! replaces the constant force in `law = "power"`. The literal recurrence of the thesis (a kick without a step length) is the
//! integrator `euler` with `form = "literal"`.
//!
//! Every source is a segment P + t u, t in [low, high]: a center has low = high = 0, an infinite line none.

use super::{Medium, NoParameters, Scalar, Vec3, parameters, step_past_center};

/// `law = "thesis"`: a constant force with falloff.
pub struct ThesisGravity;
/// `law = "power"`: a force falling as an inverse power of the distance.
pub struct PowerGravity;

parameters! {
    /// A source of the thesis' law. Phi = ((c4 r + c3) r^2 + c1) r + c0 with r cut off at `radius`.
    ThesisSource {
        /// Position.
        px, py, pz,
        /// Unit direction of the line.
        ux, uy, uz,
        /// Extent along the direction.
        low, high,
        /// Radius of influence, and the length below which its distance no longer limits steps.
        radius, core,
        /// Coefficients of the potential by power of r.
        c0, c1, c3, c4
    }
}

parameters! {
    /// A source of the power law. Phi = c0 + cl ln r + c1 r^e1 + c3 r^e3 + c4 r^e4 with r cut off at `radius`.
    PowerSource {
        /// Position.
        px, py, pz,
        /// Unit direction of the line.
        ux, uy, uz,
        /// Extent along the direction.
        low, high,
        /// Radius of influence, and the length below which its distance no longer limits steps.
        radius, core,
        /// Constant and coefficient of the logarithm.
        c0, cl,
        /// Coefficients of the powers of r.
        c1, c3, c4,
        /// Exponents of the powers of r.
        e1, e3, e4
    }
}

/// Rays are captured where a source's index has grown to this many times the launch speed.
pub const CAPTURE_INDEX: f64 = 100.0;

/// To `x` from the nearest point of the segment p + t u, low <= t <= high (`u` of length 1).
fn from_segment<S: Scalar>(x: Vec3<S>, p: Vec3<S>, u: Vec3<S>, low: S, high: S) -> Vec3<S> {
    let from_point = x - p;
    let along = from_point.dot(u).max(low).min(high);
    from_point - u * along
}

/// A step that cannot jump over the ball (or tube) of a source: the distance to it, plus inside a share of the distance to its
/// middle, and more for rays that go away from that.
fn step_past_source<S: Scalar>(from_source: Vec3<S>, d: Vec3<S>, radius: S, core: S) -> S {
    let distance = from_source.length_or_zero();
    (distance - radius).max(S::constant(0.0)) + step_past_center(from_source, distance.min(radius).max(core), d, 0.3)
}

macro_rules! from_source {
    ($source:expr, $x:expr) => {
        from_segment($x, Vec3($source.px, $source.py, $source.pz), Vec3($source.ux, $source.uy, $source.uz), $source.low, $source.high)
    };
}

impl Medium for ThesisGravity {
    type Global<S: Scalar> = NoParameters;
    type Source<S: Scalar> = ThesisSource<S>;

    fn source_potential<S: Scalar>(source: &ThesisSource<S>, x: Vec3<S>) -> S {
        let r = from_source!(source, x).length_or_zero().min(source.radius);
        ((source.c4 * r + source.c3) * r * r + source.c1) * r + source.c0
    }

    fn index<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, energy: S) -> S {
        energy - potential
    }

    fn energy<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, speed: S) -> S {
        speed + potential
    }

    fn source_safe_step<S: Scalar>(source: &ThesisSource<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_source(from_source!(source, x), d, source.radius, source.core)
    }
}

impl Medium for PowerGravity {
    type Global<S: Scalar> = NoParameters;
    type Source<S: Scalar> = PowerSource<S>;

    fn source_potential<S: Scalar>(source: &PowerSource<S>, x: Vec3<S>) -> S {
        let log_r = from_source!(source, x).length_or_zero().min(source.radius).max(S::constant(1e-15)).ln();
        source.c0
            + source.cl * log_r
            + source.c1 * (source.e1 * log_r).exp()
            + source.c3 * (source.e3 * log_r).exp()
            + source.c4 * (source.e4 * log_r).exp()
    }

    fn index<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, energy: S) -> S {
        energy - potential
    }

    fn energy<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S, speed: S) -> S {
        speed + potential
    }

    fn capture_distance<S: Scalar>(_: &NoParameters, _: Vec3<S>, potential: S) -> S {
        potential + S::constant(CAPTURE_INDEX)
    }

    fn source_safe_step<S: Scalar>(source: &PowerSource<S>, x: Vec3<S>, d: Vec3<S>) -> S {
        step_past_source(from_source!(source, x), d, source.radius, source.core)
    }
}

/// A source as scene files state it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// A point of the source.
    pub position: [f64; 3],
    /// Unit direction of a line; ignored for a center.
    pub direction: [f64; 3],
    /// Extent of the source along `direction`: (0, 0) for a center.
    pub extent: (f64, f64),
    /// Strength g M (the kappa of the ODE form); negative repels.
    pub strength: f64,
    /// Radius of influence, or infinity.
    pub radius: f64,
}

/// Largest number that stands for infinity in f32 parameter blocks.
const UNBOUNDED: f64 = 1e12;

impl Source {
    /// Parameter block: power `exponent` of the force (0 in the thesis) integrated to the potential
    /// strength * (F(1-n) - 3 F(3-n)/R^2 + 2 F(4-n)/R^3), F(e) = r^e / e or ln r, shifted to vanish at the radius of influence.
    fn coefficients(&self, exponent: f64) -> (f64, f64, [(f64, f64); 3]) {
        let inverse_radius = if self.radius.is_finite() { 1.0 / self.radius } else { 0.0 };
        let weights = [1.0, -3.0 * inverse_radius.powi(2), 2.0 * inverse_radius.powi(3)];
        let mut log = 0.0;
        let powers = [1.0, 3.0, 4.0].map(|p| p - exponent);
        let mut terms = [(0.0, 1.0); 3];
        for ((term, weight), power) in terms.iter_mut().zip(weights).zip(powers) {
            if power.abs() < 1e-9 {
                log += self.strength * weight;
            } else {
                *term = (self.strength * weight / power, power);
            }
        }
        let at_radius = if self.radius.is_finite() {
            log * self.radius.ln() + terms.iter().map(|(c, e)| c * self.radius.powf(*e)).sum::<f64>()
        } else {
            0.0
        };
        (-at_radius, log, terms)
    }

    fn geometry(&self) -> [f64; 10] {
        let [px, py, pz] = self.position;
        let [ux, uy, uz] = self.direction;
        let bound = |v: f64| v.clamp(-UNBOUNDED, UNBOUNDED);
        // The error estimate sees the smooth inside of a ball; around a center of unbounded force steps shrink with the distance.
        let core = if self.radius.is_finite() { self.radius } else { 0.0 };
        [px, py, pz, ux, uy, uz, bound(self.extent.0), bound(self.extent.1), bound(self.radius), core]
    }

    /// Values of a [`ThesisSource`], in its order.
    pub fn thesis_parameters(&self) -> Vec<f64> {
        let (c0, _, [c1, c3, c4]) = self.coefficients(0.0);
        self.geometry().into_iter().chain([c0, c1.0, c3.0, c4.0]).collect()
    }

    /// Values of a [`PowerSource`], in its order.
    pub fn power_parameters(&self, exponent: f64) -> Vec<f64> {
        let (c0, cl, [c1, c3, c4]) = self.coefficients(exponent);
        self.geometry().into_iter().chain([c0, cl, c1.0, c3.0, c4.0, c1.1, c3.1, c4.1]).collect()
    }
}
