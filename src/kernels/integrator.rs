//! Steps along curved rays, over any number of lanes and in either precision.
//!
//! A ray obeys x' = velocity(x, p), p' = force(x, p), which the model gives. In a medium x' = p and the force depends on x only: there the
//! default step is the Runge-Kutta-Nystroem pair RKN4(3)4FM of Dormand, El-Mikkawy and Prince (IMA J. Numer. Anal. 7, 1987), three
//! evaluations for order 4 with an error estimate. Elsewhere it is a Runge-Kutta pair given by its tableau. `euler` is the recurrence of
//! the thesis, `symplectic` and `leapfrog` those of Satoh (2003).

use super::constants::*;
use super::triangle::dot;
use crate::simd::{Lane, Real};
use crate::spacetime::ModelKind;

/// Run-time parameters of a model in the precision of the integrator.
#[derive(Clone, Debug, Default)]
pub struct ModelBlock<T> {
    /// Origin of the model in the world.
    pub origin: [T; 3],
    /// Radius of the throat below which a ray is inverted to the other side of a wormhole; 0 if there is none.
    pub throat: T,
    /// Radius at which the gradient of the index jumps, where steps end; 0 if there is none.
    pub rim: T,
    /// Step of the methods that do not choose their own.
    pub step: T,
    /// The Runge-Kutta method, packed as [`super::tableau`] does it.
    pub tableau: Vec<T>,
    /// Values of the model's parameters.
    pub global: Vec<T>,
    /// Values of its sources, one after another.
    pub sources: Vec<T>,
    /// Its table, see [`super::table`]; empty without one.
    pub table: Vec<T>,
}

/// A bending model as the integrator sees it. Implemented by generated code for every entry of the list of models.
///
/// A ray has a position, a momentum, a conserved energy, a sense (-1 if it is followed into its past) and a parameter: affine for a
/// medium, coordinate time for a metric, length for a flow.
pub trait Model: Send + Sync + 'static {
    /// Which model this is.
    const KIND: ModelKind;
    /// Velocity and force: derivatives of position and momentum by the parameter.
    fn rate<L: Lane>(
        token: L::Token,
        model: &ModelBlock<L::Real>,
        position: [L; 3],
        momentum: [L; 3],
        energy: L,
        sense: L,
        parameter: L,
    ) -> ([L; 3], [L; 3]);
    /// Momentum, energy and frequency of a ray launched along the unit vector `direction` of the local frame.
    fn launch<L: Lane>(
        token: L::Token,
        model: &ModelBlock<L::Real>,
        position: [L; 3],
        direction: [L; 3],
        speed: L,
        sense: L,
    ) -> ([L; 3], L, L);
    /// Unit direction of travel in the local frame, frequency there, and relative error of the conserved Hamiltonian.
    fn observe<L: Lane>(
        token: L::Token,
        model: &ModelBlock<L::Real>,
        position: [L; 3],
        momentum: [L; 3],
        energy: L,
        sense: L,
        parameter: L,
    ) -> ([L; 3], L, L);
    /// Local frame of the Eulerian observer: the symmetric root L of gamma^ij up to a factor, as (xx, yy, zz) and (xy, xz, yz). Of all
    /// orthonormal frames it is the one turned least against the coordinate axes.
    fn frame<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]) -> ([L; 3], [L; 3]);
    /// Frequency of an escaped ray for a distant static observer.
    fn far_frequency<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, momentum: [L; 3], energy: L) -> L;
    /// Negative where a ray launched with `frequency` is captured.
    fn capture_distance<L: Lane>(
        token: L::Token,
        model: &ModelBlock<L::Real>,
        position: [L; 3],
        momentum: [L; 3],
        frequency: L,
        sense: L,
    ) -> L;
    /// Largest coordinate length of a step along the unit vector `direction`, and the length by which its error is measured.
    fn safe_step<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3], direction: [L; 3]) -> (L, L);
    /// Frequency seen by matter of coordinate velocity `velocity` dx/dt.
    fn matter_frequency<L: Lane>(
        token: L::Token,
        model: &ModelBlock<L::Real>,
        position: [L; 3],
        momentum: [L; 3],
        energy: L,
        sense: L,
        velocity: [L; 3],
    ) -> L;
    /// The model's own radial coordinate.
    fn coordinate_radius<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]) -> L;
    /// Gradient of the refractive index of a medium; zero for other models.
    fn index_gradient<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3], energy: L) -> [L; 3];
}

#[allow(clippy::let_and_return, clippy::approx_constant, reason = "generated code names every result and writes every number out")]
mod generated {
    use super::{Lane, Model, ModelBlock};
    include!(concat!(env!("OUT_DIR"), "/models.rs"));
}

/// The functions of one model for single rays, see [`Model`].
#[allow(clippy::type_complexity, reason = "the signatures are those of the trait")]
pub struct PointFunctions<T> {
    /// [`Model::rate`].
    pub rate: fn((), &ModelBlock<T>, [T; 3], [T; 3], T, T, T) -> ([T; 3], [T; 3]),
    /// [`Model::launch`].
    pub launch: fn((), &ModelBlock<T>, [T; 3], [T; 3], T, T) -> ([T; 3], T, T),
    /// [`Model::observe`].
    pub observe: fn((), &ModelBlock<T>, [T; 3], [T; 3], T, T, T) -> ([T; 3], T, T),
    /// [`Model::far_frequency`].
    pub far_frequency: fn((), &ModelBlock<T>, [T; 3], T) -> T,
    /// [`Model::matter_frequency`].
    pub matter_frequency: fn((), &ModelBlock<T>, [T; 3], [T; 3], T, T, [T; 3]) -> T,
    /// [`Model::capture_distance`].
    pub capture_distance: fn((), &ModelBlock<T>, [T; 3], [T; 3], T, T) -> T,
    /// [`Model::coordinate_radius`].
    pub coordinate_radius: fn((), &ModelBlock<T>, [T; 3]) -> T,
    /// [`Model::index_gradient`].
    pub index_gradient: fn((), &ModelBlock<T>, [T; 3], T) -> [T; 3],
    /// [`Model::safe_step`].
    pub safe_step: fn((), &ModelBlock<T>, [T; 3], [T; 3]) -> (T, T),
}

impl<T: Lane<Real = T, Mask = bool, Token = ()>> PointFunctions<T> {
    /// The functions of a model.
    pub fn of(kind: ModelKind) -> Self {
        macro_rules! choose {
            ($(($name:ident, $stem:ident, $class:ident)),+ $(,)?) => {
                match kind { $(ModelKind::$name => Self::of_model::<crate::spacetime::$name>()),+ }
            };
        }
        crate::for_each_model!(choose)
    }

    fn of_model<M: Model>() -> Self {
        PointFunctions {
            rate: M::rate::<T>,
            launch: M::launch::<T>,
            observe: M::observe::<T>,
            far_frequency: M::far_frequency::<T>,
            matter_frequency: M::matter_frequency::<T>,
            capture_distance: M::capture_distance::<T>,
            coordinate_radius: M::coordinate_radius::<T>,
            index_gradient: M::index_gradient::<T>,
            safe_step: M::safe_step::<T>,
        }
    }
}

/// State of a ray and its derivatives by the parameter.
#[derive(Clone, Copy)]
pub struct Flight<L> {
    /// Position.
    pub x: [L; 3],
    /// Momentum.
    pub p: [L; 3],
    /// Velocity x'.
    pub v: [L; 3],
    /// Force p'.
    pub a: [L; 3],
}

/// What stays the same along a ray.
#[derive(Clone, Copy)]
pub struct Charge<L> {
    /// Conserved energy.
    pub energy: L,
    /// +1 into the future, -1 into the past.
    pub sense: L,
}

/// Most stages of a Runge-Kutta method, as an array's length.
pub const STAGES: usize = MAX_STAGES as usize;

/// a + b f.
#[inline(always)]
pub fn along<L: Lane>(a: [L; 3], b: [L; 3], f: L) -> [L; 3] {
    [b[0].mul_add(f, a[0]), b[1].mul_add(f, a[1]), b[2].mul_add(f, a[2])]
}

/// Velocity and force at a point of a ray.
#[inline(always)]
pub fn rate_at<M: Model, L: Lane>(
    token: L::Token,
    model: &ModelBlock<L::Real>,
    charge: &Charge<L>,
    x: [L; 3],
    p: [L; 3],
    parameter: L,
) -> Flight<L> {
    let (v, a) = M::rate(token, model, x, p, charge.energy, charge.sense, parameter);
    Flight { x, p, v, a }
}

/// Force of a medium, which depends on the position only.
#[inline(always)]
pub fn nystrom_force<M: Model, L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, charge: &Charge<L>, x: [L; 3], p: [L; 3]) -> [L; 3] {
    rate_at::<M, L>(token, model, charge, x, p, L::constant(token, 0.0)).a
}

/// One RKN4(3) step of length `h` through a medium, whose force depends on the position only; returns the new state and the local
/// error of position and of h times momentum.
#[inline(always)]
pub fn nystrom_step<M: Model, L: Lane>(
    token: L::Token,
    model: &ModelBlock<L::Real>,
    charge: &Charge<L>,
    flight: &Flight<L>,
    h: L,
) -> (Flight<L>, L) {
    let h2 = h * h;
    let k0 = flight.a;
    let x1 = along(along(flight.x, flight.p, h * L::constant(token, RKN_C1)), k0, h2 * L::constant(token, RKN_A10));
    let k1 = nystrom_force::<M, L>(token, model, charge, x1, flight.p);
    let x2 = along(
        along(along(flight.x, flight.p, h * L::constant(token, RKN_C2)), k0, h2 * L::constant(token, RKN_A20)),
        k1,
        h2 * L::constant(token, RKN_A21),
    );
    let k2 = nystrom_force::<M, L>(token, model, charge, x2, flight.p);
    let x = along(
        along(along(along(flight.x, flight.p, h), k0, h2 * L::constant(token, RKN_B0)), k1, h2 * L::constant(token, RKN_B1)),
        k2,
        h2 * L::constant(token, RKN_B2),
    );
    let k3 = nystrom_force::<M, L>(token, model, charge, x, flight.p);
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
    (Flight { x, p, v: p, a: k3 }, error)
}

/// One step of the Runge-Kutta method that `model.tableau` holds. Its last stage is evaluated at the new state, so a step costs one
/// evaluation fewer than it has stages. Returns the new state, the local error (of position, and of direction times length), and how far the
/// cubic through both ends strays from the method's own dense output, which is in the middle.
#[inline(always)]
pub fn runge_kutta_step<M: Model, L: Lane>(
    token: L::Token,
    model: &ModelBlock<L::Real>,
    charge: &Charge<L>,
    flight: &Flight<L>,
    parameter: L,
    h: L,
) -> (Flight<L>, L, L) {
    let tableau = &model.tableau;
    let stages = tableau[0].to_f64() as usize;
    let mut v = [flight.v; STAGES];
    let mut a = [flight.a; STAGES];
    let mut state = *flight;
    for i in 1..stages {
        let row = 2 + 3 * STAGES + i * STAGES;
        let (mut x, mut p) = (flight.x, flight.p);
        for j in 0..i {
            let weight = h * L::splat(token, tableau[row + j]);
            x = along(x, v[j], weight);
            p = along(p, a[j], weight);
        }
        state = rate_at::<M, L>(token, model, charge, x, p, h.mul_add(L::splat(token, tableau[2 + i]), parameter));
        v[i] = state.v;
        a[i] = state.a;
    }
    let zero = [L::constant(token, 0.0); 3];
    let (mut ex, mut ep, mut quartic) = (zero, zero, zero);
    for j in 0..stages {
        let weight = L::splat(token, tableau[2 + STAGES + j]);
        ex = along(ex, v[j], weight);
        ep = along(ep, a[j], weight);
        quartic = along(quartic, v[j], L::splat(token, tableau[2 + 2 * STAGES + j]));
    }
    let turn = h * h * dot(flight.v, flight.v) / dot(flight.p, flight.p);
    let length = h.max(-h);
    let error = (dot(ex, ex) + dot(ep, ep) * turn).sqrt() * length;
    (state, error, dot(quartic, quartic).sqrt() * length * L::constant(token, 1.0 / 16.0))
}

/// Symplectic Euler (Satoh 2003): p += h force(x, p), implicitly, then x += h velocity(x, p) with the new p. Where the force depends on
/// the momentum the fixed point is iterated `SYMPLECTIC_ITERATIONS` times. `rate_at` evaluates at (x, p, parameter).
#[inline(always)]
pub fn symplectic_step<L: Lane>(rate_at: impl Fn([L; 3], [L; 3], L) -> Flight<L>, flight: &Flight<L>, parameter: L, h: L) -> Flight<L> {
    let mut at = *flight;
    for _ in 0..SYMPLECTIC_ITERATIONS {
        at = rate_at(flight.x, along(flight.p, at.a, h), parameter);
    }
    rate_at(along(flight.x, at.v, h), at.p, parameter + h)
}

/// Leapfrog through a medium: half a kick, a drift, half a kick (Stoermer and Verlet).
#[inline(always)]
pub fn leapfrog_step<L: Lane>(
    token: L::Token,
    rate_at: impl Fn([L; 3], [L; 3], L) -> Flight<L>,
    flight: &Flight<L>,
    parameter: L,
    h: L,
) -> Flight<L> {
    let half = h * L::constant(token, 0.5);
    let p = along(flight.p, flight.a, half);
    let mut to = rate_at(along(flight.x, p, h), p, parameter + h);
    to.p = along(p, to.a, half);
    to.v = to.p;
    to
}

/// Error that a step from `x` may have: what pixels allow, `share` of the width of the ray's `cone` there, but no more than a share of the
/// length `detail` over which rays change their way, and no less than rounding, `floor` of the coordinates.
#[inline(always)]
pub fn step_tolerance<L: Lane>(token: L::Token, x: [L; 3], cone: L, share: L, detail: L, floor: L) -> L {
    (cone * share).min(detail * L::constant(token, DETAIL_TOLERANCE)).max(largest_coordinate(x) * floor)
}

/// Largest coordinate of a point, without its sign.
#[inline(always)]
pub fn largest_coordinate<L: Lane>(x: [L; 3]) -> L {
    x[0].max(-x[0]).max(x[1].max(-x[1])).max(x[2].max(-x[2]))
}

/// How many times as long a step whose error is `error` could have been to have that of `tolerance`, by an error of order four.
#[inline(always)]
pub fn step_margin<L: Lane>(token: L::Token, error: L, tolerance: L) -> L {
    let ratio = tolerance / error.max(tolerance * L::constant(token, LEAST_ERROR));
    // A step into a singularity has no error estimate.
    L::select(error.lt(tolerance * L::constant(token, 1e30)), ratio.sqrt().sqrt(), L::constant(token, STEP_SHRINK))
}

/// Length with which a step of length `h` would just have met the tolerance; 0 if its error is too small to tell.
#[inline(always)]
pub fn ideal_step<L: Lane>(token: L::Token, h: L, error: L, tolerance: L) -> L {
    let told = (tolerance * L::constant(token, LEAST_ERROR)).lt(error);
    L::select(told, h.max(-h) * step_margin(token, error, tolerance), L::constant(token, 0.0))
}

/// Ratio of the ideal length of a step to that of the one before; 1 where either is not known.
#[inline(always)]
pub fn step_trend<L: Lane>(token: L::Token, ideal: L, before: L) -> L {
    L::select(L::constant(token, 0.0).lt(ideal.min(before)), ideal / before, L::constant(token, 1.0))
}

/// Factor for the next step after one with `margin`. If the ideal lengths of steps shrink along a ray by `trend` from the one before to this,
/// they are expected to shrink by it again (Gustafsson, ACM Trans. Math. Softw. 20, 1994).
#[inline(always)]
pub fn step_factor<L: Lane>(token: L::Token, margin: L, trend: L) -> L {
    let [shrink, grow, one] = [L::constant(token, STEP_SHRINK), L::constant(token, STEP_GROW), L::constant(token, 1.0)];
    (margin * L::constant(token, STEP_SAFETY) * one.min(trend).max(shrink)).max(shrink).min(grow)
}

/// Largest step of a ray at `x` with velocity `v`, in the parameter, and the length by which its error is measured.
#[inline(always)]
pub fn safe_step_of<M: Model, L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, x: [L; 3], v: [L; 3]) -> (L, L) {
    // In some charts light may stand still.
    let slowness = L::constant(token, 1.0) / dot(v, v).max(L::constant(token, 1e-30)).sqrt();
    let (length, detail) = M::safe_step::<L>(token, model, x, [v[0] * slowness, v[1] * slowness, v[2] * slowness]);
    (length * slowness, detail)
}

/// Longest first step that is worth a try, in the parameter: the safe step, or a share of |p| / |force|, the local radius of curvature
/// over the speed.
#[inline(always)]
pub fn longest_first_step<L: Lane>(token: L::Token, flight: &Flight<L>, safe: L) -> L {
    let bend = dot(flight.a, flight.a).sqrt().max(L::constant(token, 1e-12));
    (dot(flight.p, flight.p).sqrt() / bend * L::constant(token, FIRST_STEP)).min(safe)
}

/// First step: `longest`, or shorter if the force changes much along it, from `flight.a` to `end_force`. The error of a step is about
/// `FIRST_ERROR` of what that change moves the ray.
#[inline(always)]
pub fn first_step<L: Lane>(token: L::Token, flight: &Flight<L>, end_force: [L; 3], longest: L, tolerance: L) -> L {
    let change = along(end_force, flight.a, L::constant(token, -1.0));
    let turn = longest * longest * (dot(flight.v, flight.v) / dot(flight.p, flight.p)).sqrt();
    let margin = step_margin(token, dot(change, change).sqrt() * turn * L::constant(token, FIRST_ERROR), tolerance);
    longest * margin.min(L::constant(token, 1.0))
}

/// The thesis' recurrence through a medium: X += h V/|V|, V += kick grad n, both from the old state. `kick` is h for the equation of
/// motion and 1 for the literal text, in which the strength acts per step. Velocity and force are not evaluated anew.
#[inline(always)]
pub fn euler_step<L: Lane>(gradient: [L; 3], flight: &Flight<L>, h: L, kick: L) -> Flight<L> {
    let speed = dot(flight.p, flight.p).sqrt();
    let p = along(flight.p, gradient, kick);
    Flight { x: along(flight.x, flight.p, h / speed), p, v: p, a: flight.a }
}

/// Arc length of a step: Simpson's rule on |x'|, its middle taken from the dense output.
#[inline(always)]
pub fn arc_length<L: Lane>(token: L::Token, from: &Flight<L>, to: &Flight<L>, h: L) -> L {
    let chord = [to.x[0] - from.x[0], to.x[1] - from.x[1], to.x[2] - from.x[2]];
    let ends = along(from.v, to.v, L::constant(token, 1.0));
    let scale = L::constant(token, -0.25) * h;
    let c = L::constant(token, 1.5);
    let middle = along([chord[0] * c, chord[1] * c, chord[2] * c], ends, scale);
    let size = dot(from.v, from.v).sqrt() + dot(to.v, to.v).sqrt();
    let inner = dot(middle, middle).sqrt();
    let inner = L::select(h.lt(L::constant(token, 0.0)), -inner, inner);
    (size * h + inner * L::constant(token, 4.0)) * L::constant(token, 1.0 / 6.0)
}

/// Ray parameter at which the straight ray enters the sphere, 0 if it starts inside, -1 if it misses.
#[inline(always)]
pub fn enter_sphere<L: Lane>(token: L::Token, x: [L; 3], d: [L; 3], center: [L; 3], radius: L) -> L {
    let zero = L::constant(token, 0.0);
    let f = along(x, center, L::constant(token, -1.0));
    let inside = dot(f, f).lt(radius * radius);
    let b = dot(f, d) / dot(d, d);
    let nearest = along(f, d, -b);
    let discriminant = radius * radius - dot(nearest, nearest);
    // Rounding must not make an entry just ahead a miss.
    let entry = (-b - (discriminant.max(zero) / dot(d, d)).sqrt()).max(zero);
    let miss = L::constant(token, -1.0);
    let missed = L::select(zero.lt(b), miss, L::select(discriminant.lt(zero), miss, entry));
    L::select(inside, zero, missed)
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

/// Isometry of a wormhole's chart that swaps its sides: inversion of `x` (relative to its center) through the sphere of radius
/// `throat`, and of the momentum with it.
#[inline(always)]
pub fn invert_through<L: Lane<Mask = bool, Token = ()>>(x: [L; 3], p: [L; 3], throat: L) -> ([L; 3], [L; 3]) {
    let share = throat * throat / dot(x, x);
    let radial = L::constant((), -2.0) * dot(x, p) / dot(x, x);
    let reflected = along(p, x, radial);
    let inverse = L::constant((), 1.0) / share;
    ([x[0] * share, x[1] * share, x[2] * share], [reflected[0] * inverse, reflected[1] * inverse, reflected[2] * inverse])
}

/// A position or direction in single precision.
#[inline(always)]
pub fn to_vec3<T: Real>(v: [T; 3]) -> glam::Vec3 {
    glam::vec3(v[0].to_f32(), v[1].to_f32(), v[2].to_f32())
}

/// A position or direction in the precision of the integrator.
#[inline(always)]
pub fn from_vec3<T: Real>(v: glam::Vec3) -> [T; 3] {
    [T::from_f64(f64::from(v.x)), T::from_f64(f64::from(v.y)), T::from_f64(f64::from(v.z))]
}
