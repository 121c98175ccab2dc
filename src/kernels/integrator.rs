//! Steps along curved rays, over any number of lanes and in either precision.
//!
//! A ray obeys x' = p, p' = n grad n with |p| = n(x) (an isotropic medium with dl = ds / n, so that the force depends on x only).
//! The default step is the Runge-Kutta-Nystroem pair RKN4(3)4FM of Dormand, El-Mikkawy and Prince (IMA J. Numer. Anal. 7, 1987):
//! three evaluations of the force for order 4 with an error estimate. `euler` is the recurrence of the thesis.

use super::constants::*;
use super::triangle::dot;
use crate::simd::{Lane, Real};
use crate::spacetime::ModelKind;

/// Run-time parameters of a model in the precision of the integrator.
#[derive(Clone, Debug, Default)]
pub struct ModelBlock<T> {
    /// Origin of the model in the world.
    pub origin: [T; 3],
    /// Step length of `euler`.
    pub step: T,
    /// Values of the model's parameters.
    pub global: Vec<T>,
    /// Values of its sources, one after another.
    pub sources: Vec<T>,
}

/// A bending model as the integrator sees it. Implemented by generated code for every entry of the list of models.
pub trait Model: Send + Sync + 'static {
    /// Which model this is.
    const KIND: ModelKind;
    /// Refractive index and its gradient.
    fn medium<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3], energy: L) -> (L, [L; 3]);
    /// Conserved energy of a ray launched with velocity of length `speed`.
    fn launch_energy<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3], speed: L) -> L;
    /// Lapse of the static observer.
    fn lapse<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]) -> L;
    /// Negative where a ray is captured.
    fn capture_distance<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]) -> L;
    /// Largest coordinate length of a step.
    fn safe_step<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]) -> L;
}

#[allow(clippy::let_and_return, reason = "generated code names every result")]
mod generated {
    use super::{Lane, Model, ModelBlock};
    include!(concat!(env!("OUT_DIR"), "/models.rs"));
}

/// Position, momentum and force of a ray.
#[derive(Clone, Copy)]
pub struct Flight<L> {
    /// Position.
    pub x: [L; 3],
    /// Momentum x'; its length is the refractive index.
    pub p: [L; 3],
    /// Force p' = n grad n at `x`.
    pub a: [L; 3],
}

/// a + b f.
#[inline(always)]
pub fn along<L: Lane>(a: [L; 3], b: [L; 3], f: L) -> [L; 3] {
    [b[0].mul_add(f, a[0]), b[1].mul_add(f, a[1]), b[2].mul_add(f, a[2])]
}

/// Force p' = n grad n.
#[inline(always)]
pub fn force<M: Model, L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, x: [L; 3], energy: L) -> [L; 3] {
    let (n, gradient) = M::medium(token, model, x, energy);
    [gradient[0] * n, gradient[1] * n, gradient[2] * n]
}

/// One RKN4(3) step of length `h`; returns the new state and the local error of position and of h times momentum.
#[inline(always)]
pub fn nystrom_step<M: Model, L: Lane>(
    token: L::Token,
    model: &ModelBlock<L::Real>,
    energy: L,
    flight: &Flight<L>,
    h: L,
) -> (Flight<L>, L) {
    let h2 = h * h;
    let k0 = flight.a;
    let x1 = along(along(flight.x, flight.p, h * L::constant(token, RKN_C1)), k0, h2 * L::constant(token, RKN_A10));
    let k1 = force::<M, L>(token, model, x1, energy);
    let x2 = along(
        along(along(flight.x, flight.p, h * L::constant(token, RKN_C2)), k0, h2 * L::constant(token, RKN_A20)),
        k1,
        h2 * L::constant(token, RKN_A21),
    );
    let k2 = force::<M, L>(token, model, x2, energy);
    let x = along(
        along(along(along(flight.x, flight.p, h), k0, h2 * L::constant(token, RKN_B0)), k1, h2 * L::constant(token, RKN_B1)),
        k2,
        h2 * L::constant(token, RKN_B2),
    );
    let k3 = force::<M, L>(token, model, x, energy);
    let p = along(
        along(
            along(along(flight.p, k0, h * L::constant(token, RKN_V0)), k1, h * L::constant(token, RKN_V1)),
            k2,
            h * L::constant(token, RKN_V2),
        ),
        k3,
        h * L::constant(token, RKN_V3),
    );
    let zero = [L::constant(token, 0.0); 3];
    let ex = along(
        along(along(along(zero, k0, L::constant(token, RKN_E0)), k1, L::constant(token, RKN_E1)), k2, L::constant(token, RKN_E2)),
        k3,
        L::constant(token, RKN_E3),
    );
    let ep = along(
        along(along(along(zero, k0, L::constant(token, RKN_F0)), k1, L::constant(token, RKN_F1)), k2, L::constant(token, RKN_F2)),
        k3,
        L::constant(token, RKN_F3),
    );
    let error = (dot(ex, ex) + dot(ep, ep)).sqrt() * h2;
    (Flight { x, p, a: k3 }, error)
}

/// Factor for the next step length after a step whose error is `error` where `tolerance` is allowed.
#[inline(always)]
pub fn step_factor<L: Lane>(token: L::Token, error: L, tolerance: L) -> L {
    let ratio = tolerance / error.max(tolerance * L::constant(token, 1e-4));
    let factor = ratio.sqrt().sqrt() * L::constant(token, STEP_SAFETY);
    let factor = factor.max(L::constant(token, STEP_SHRINK)).min(L::constant(token, STEP_GROW));
    // A step into a singularity has no error estimate.
    L::select(error.lt(tolerance * L::constant(token, 1e30)), factor, L::constant(token, STEP_SHRINK))
}

/// First step length: the safe step, or a share of the local radius of curvature n / |grad n| = n^2 / |force|.
#[inline(always)]
pub fn first_step<L: Lane>(token: L::Token, index: L, a: [L; 3], safe_step: L) -> L {
    let bend = dot(a, a).sqrt().max(L::constant(token, 1e-12));
    let length = (index * index / bend * L::constant(token, FIRST_STEP)).min(safe_step);
    length / index
}

/// The thesis' recurrence: X += h V/|V|, V += kick grad n, both from the old state. `kick` is h for the equation of motion
/// and 1 for the literal text, in which the strength acts per step.
#[inline(always)]
pub fn euler_step<M: Model, L: Lane>(
    token: L::Token,
    model: &ModelBlock<L::Real>,
    energy: L,
    flight: &Flight<L>,
    h: L,
    kick: L,
) -> Flight<L> {
    let (_, gradient) = M::medium(token, model, flight.x, energy);
    let speed = dot(flight.p, flight.p).sqrt();
    Flight { x: along(flight.x, flight.p, h / speed), p: along(flight.p, gradient, kick), a: flight.a }
}

/// Arc length of a step: Simpson's rule on |x'|, its middle taken from the dense output.
#[inline(always)]
pub fn arc_length<L: Lane>(token: L::Token, from: &Flight<L>, to: &Flight<L>, h: L) -> L {
    let chord = [to.x[0] - from.x[0], to.x[1] - from.x[1], to.x[2] - from.x[2]];
    let ends = along(from.p, to.p, L::constant(token, 1.0));
    let scale = L::constant(token, -0.25) * h;
    let c = L::constant(token, 1.5);
    let middle = along([chord[0] * c, chord[1] * c, chord[2] * c], ends, scale);
    let size = dot(from.p, from.p).sqrt() + dot(to.p, to.p).sqrt();
    let inner = dot(middle, middle).sqrt();
    let inner = L::select(h.lt(L::constant(token, 0.0)), -inner, inner);
    (size * h + inner * L::constant(token, 4.0)) * L::constant(token, 1.0 / 6.0)
}

/// Ray parameter at which the straight ray enters the sphere, 0 if it starts inside, -1 if it misses.
#[inline(always)]
pub fn enter_sphere<L: Lane<Mask = bool, Token = ()>>(x: [L; 3], d: [L; 3], center: [L; 3], radius: L) -> L {
    let zero = L::constant((), 0.0);
    let f = [x[0] - center[0], x[1] - center[1], x[2] - center[2]];
    let c = dot(f, f) - radius * radius;
    if c.lt(zero) {
        return zero;
    }
    let b = dot(f, d) / dot(d, d);
    let nearest = along(f, d, -b);
    let discriminant = radius * radius - dot(nearest, nearest);
    if zero.lt(b) || discriminant.lt(zero) {
        return L::constant((), -1.0);
    }
    -b - (discriminant / dot(d, d)).sqrt()
}

/// Unit direction at infinity of a ray that leaves the region at `x` (relative to its center) along the unit vector `d`:
/// the far field n = 1 + A / r turns it by (A / b)(1 - s / r) towards the center, b the impact parameter and s = x . d.
#[inline(always)]
pub fn asymptote<L: Lane<Mask = bool, Token = ()>>(x: [L; 3], d: [L; 3], strength: L) -> [L; 3] {
    let r = dot(x, x).sqrt();
    let s = dot(x, d);
    let offset = along(x, d, -s);
    let turned = along(d, offset, -(strength / (r * (r + s))));
    let length = dot(turned, turned).sqrt();
    [turned[0] / length, turned[1] / length, turned[2] / length]
}

/// A position or direction in single precision.
#[inline(always)]
pub fn to_vec3<T: Real>(v: [T; 3]) -> glam::Vec3 {
    glam::vec3(v[0].to_f32(), v[1].to_f32(), v[2].to_f32())
}
