//! One step of all rays in flight, as lanes of registers: the integration, compiled for each model, and what is the same for all.

use super::edges::region_center;
use super::lanes::{Ends, Lanes, Pieces, Row};
use crate::backend::Stop;
use crate::kernels::bvh::{enter_root, slabs};
use crate::kernels::clearance::{grid_curve, occupied_span};
use crate::kernels::constants::*;
use crate::kernels::curve::{Curve, cut_span, hermite};
use crate::kernels::integrator::*;
use crate::kernels::layout::SceneParameters;
use crate::kernels::triangle::dot;
use crate::kernels::view::SceneView;
use crate::simd::{Lane, Real, load3, splat3, store3};
use crate::spacetime::{Class, ModelKind};
use fearless_simd::{Simd, f32x16, f64x8};

/// A real number that is also a lane of its own, for the parts of a ray that are handled alone.
pub trait Scalar: Real + Lane<Real = Self, Mask = bool, Token = ()> {
    /// Smallest tolerance as a share of the coordinates.
    const TOLERANCE_FLOOR: f64;
    /// How far inside the bending region a ray that enters it is put, as a share of the way to it.
    const REGION_MARGIN: f64;
    /// How near a rim counts as on it, as a share of its radius.
    const RIM_SLACK: f64;
    /// Rays that are stepped at once.
    const WIDTH: usize;
    /// The register that holds them.
    type Register<S: Simd>: Lane<Real = Self, Token = S>;
}

impl Scalar for f32 {
    const TOLERANCE_FLOOR: f64 = TOLERANCE_FLOOR_F32;
    const REGION_MARGIN: f64 = REGION_MARGIN_F32;
    const RIM_SLACK: f64 = RIM_SLACK_F32;
    const WIDTH: usize = 16;
    type Register<S: Simd> = f32x16<S>;
}

impl Scalar for f64 {
    const TOLERANCE_FLOOR: f64 = TOLERANCE_FLOOR_F64;
    const REGION_MARGIN: f64 = REGION_MARGIN_F64;
    const RIM_SLACK: f64 = RIM_SLACK_F64;
    const WIDTH: usize = 8;
    type Register<S: Simd> = f64x8<S>;
}

/// What is compiled for each model, on registers of instruction set `S`.
pub struct ModelKernels<S, T> {
    /// Gives all lanes momenta, energies, frequencies, velocities, forces and first steps. Before, the momentum of a lane is its unit
    /// direction in the local frame, the energy its launch speed.
    pub launch: fn(S, &Course<T>, &mut Lanes<T>),
    /// Takes all lanes one step along: `next.x`, `next.p`, `next.v`, `next.a`, the errors and the safe steps there; returns the lanes that
    /// are captured there, as bits.
    pub integrate: fn(S, &Course<T>, &mut Lanes<T>) -> u32,
    /// What local observers see of rays that ended.
    pub observe: fn(S, &Course<T>, &mut Ends<T>),
}

impl<S: Simd, T: Scalar> ModelKernels<S, T> {
    /// The kernels of a model.
    pub fn of(kind: ModelKind) -> Self {
        fn launch<M: Model, S: Simd, T: Scalar>(simd: S, course: &Course<T>, lanes: &mut Lanes<T>) {
            simd.vectorize(
                #[inline(always)]
                || launch_lanes::<M, T::Register<S>, T>(simd, course, lanes),
            )
        }
        fn integrate<M: Model, S: Simd, T: Scalar>(simd: S, course: &Course<T>, lanes: &mut Lanes<T>) -> u32 {
            simd.vectorize(
                #[inline(always)]
                || integrate_lanes::<M, T::Register<S>, T>(simd, course, lanes),
            )
        }
        fn observe<M: Model, S: Simd, T: Scalar>(simd: S, course: &Course<T>, ends: &mut Ends<T>) {
            simd.vectorize(
                #[inline(always)]
                || observe_lanes::<M, T::Register<S>, T>(simd, course, ends),
            )
        }
        macro_rules! choose {
            ($(($name:ident, $stem:ident, $class:ident)),+ $(,)?) => {
                match kind {
                    $(ModelKind::$name => ModelKernels {
                        launch: launch::<crate::spacetime::$name, S, T>,
                        integrate: integrate::<crate::spacetime::$name, S, T>,
                        observe: observe::<crate::spacetime::$name, S, T>,
                    }),+
                }
            };
        }
        crate::for_each_model!(choose)
    }
}

/// What all rays of a batch share.
pub struct Course<'a, T> {
    /// The world.
    pub view: SceneView<'a>,
    /// Parameters, which may differ from the view's for traced rays.
    pub scene: &'a SceneParameters,
    /// The model.
    pub model: &'a ModelBlock<T>,
    /// Which model.
    pub kind: ModelKind,
    /// Where traced rays end.
    pub stop: Stop,
    /// Whether the drift of the Hamiltonian is wanted.
    pub drift: bool,
}

impl<T: Scalar> Course<'_, T> {
    /// Error that steps from `x` may have, see [`step_tolerance`].
    #[inline(always)]
    fn tolerance<L: Lane<Real = T>>(&self, token: L::Token, x: [L; 3], cone: L, detail: L) -> L {
        let share = L::constant(token, f64::from(self.scene.tolerance));
        step_tolerance(token, x, cone, share, detail, L::constant(token, T::TOLERANCE_FLOOR))
    }
}

/// Lanes by what became of their step, as bits.
#[derive(Clone, Copy, Debug)]
pub struct Masks {
    /// The step's error was small enough.
    pub accepted: u32,
    /// The accepted step is looked up in the BVH, as geometry may be near.
    pub occupied: u32,
    /// It meets a box below the root.
    pub met: u32,
    /// The step ends outside the bending region, on the way out.
    pub outside: u32,
    /// The step ends beyond the throat of a wormhole.
    pub crossed: u32,
}

/// Whether the method's steps are of fixed length.
pub fn fixed_step<T: Real>(scene: &SceneParameters, model: &ModelBlock<T>) -> bool {
    matches!(scene.method, METHOD_EULER | METHOD_SYMPLECTIC | METHOD_LEAPFROG)
        || (scene.method >= METHOD_RUNGE_KUTTA && model.tableau[1].to_f64() == 0.0)
}

/// Launches every lane into the model `M`.
#[inline(always)]
fn launch_lanes<M: Model, L: Lane<Real = T>, T: Scalar>(token: L::Token, course: &Course<T>, lanes: &mut Lanes<T>) {
    let (scene, model) = (course.scene, course.model);
    let (x, direction) = (load3(token, &lanes.x), load3(token, &lanes.p));
    let sense = L::load(token, &lanes.sense);
    let (p, energy, frequency) = M::launch::<L>(token, model, x, direction, L::load(token, &lanes.energy), sense);
    let (v, a) = M::rate::<L>(token, model, x, p, energy, sense, L::constant(token, 0.0));
    let (safe, detail) = safe_step_of::<M, L>(token, model, x, v);
    let h = if !fixed_step(scene, model) {
        let flight = Flight { x, p, v, a };
        let longest = longest_first_step(token, &flight, safe);
        let charge = Charge { energy, sense };
        let end = rate_at::<M, L>(token, model, &charge, along(x, v, longest), along(p, a, longest), longest);
        let cone = L::load(token, &lanes.spread).mul_add(L::load(token, &lanes.length), L::load(token, &lanes.width));
        first_step(token, &flight, end.a, longest, course.tolerance(token, x, cone, detail))
    } else if scene.method >= METHOD_RUNGE_KUTTA {
        L::splat(token, model.step) / dot(v, v).sqrt()
    } else {
        L::splat(token, model.step)
    };
    store3(p, &mut lanes.p);
    store3(v, &mut lanes.v);
    store3(a, &mut lanes.a);
    energy.store(&mut lanes.energy);
    frequency.store(&mut lanes.frequency);
    h.store(&mut lanes.h);
    detail.store(&mut lanes.detail);
}

/// Observes every end in the model `M`.
#[inline(always)]
fn observe_lanes<M: Model, L: Lane<Real = T>, T: Scalar>(token: L::Token, course: &Course<T>, ends: &mut Ends<T>) {
    let model = course.model;
    let (x, p, energy) = (load3(token, &ends.x), load3(token, &ends.p), L::load(token, &ends.energy));
    let (sense, parameter) = (L::load(token, &ends.sense), L::load(token, &ends.parameter));
    let (direction, frequency, _) = M::observe::<L>(token, model, x, p, energy, sense, parameter);
    store3(direction, &mut ends.direction);
    frequency.store(&mut ends.frequency);
    M::far_frequency::<L>(token, model, p, energy).store(&mut ends.far_frequency);
    if matches!(M::KIND.class(), Class::Metric) {
        let (diagonal, mixed) = M::frame::<L>(token, model, x);
        store3(diagonal, &mut ends.frame_diagonal);
        store3(mixed, &mut ends.frame_mixed);
    }
}

/// Steps every lane once through the model `M`.
#[inline(always)]
fn integrate_lanes<M: Model, L: Lane<Real = T>, T: Scalar>(token: L::Token, course: &Course<T>, lanes: &mut Lanes<T>) -> u32 {
    let (scene, model) = (course.scene, course.model);
    let flight = lanes.flight::<L>(token);
    let charge = Charge { energy: L::load(token, &lanes.energy), sense: L::load(token, &lanes.sense) };
    let h = L::load(token, &lanes.h);
    let parameter = L::load(token, &lanes.parameter);
    let medium = matches!(M::KIND.class(), Class::Medium);
    let (moved, error, stray) = if scene.method == METHOD_NYSTROM && medium {
        let (moved, error) = nystrom_step::<M, L>(token, model, &charge, &flight, h);
        (moved, error, L::constant(token, 0.0))
    } else {
        runge_kutta_step::<M, L>(token, model, &charge, &flight, parameter, h)
    };
    let frequency = L::load(token, &lanes.frequency);
    let captured = M::capture_distance::<L>(token, model, moved.x, moved.p, frequency, charge.sense).lt(L::constant(token, 0.0));
    let next = &mut lanes.next;
    let (safe, detail) = safe_step_of::<M, L>(token, model, moved.x, moved.v);
    safe.store(&mut next.safe);
    detail.store(&mut next.detail);
    error.store(&mut next.error);
    stray.store(&mut next.stray);
    store3(moved.x, &mut next.x);
    store3(moved.p, &mut next.p);
    store3(moved.v, &mut next.v);
    store3(moved.a, &mut next.a);
    L::bits(captured)
}

/// Steps every lane once by a method of fixed steps, one by one: these are there to be compared with, and a copy of each for every
/// model and instruction set would cost more time to build than it saves.
pub fn integrate_alone<T: Scalar>(course: &Course<T>, functions: &PointFunctions<T>, lanes: &mut Lanes<T>) -> u32 {
    let (scene, model) = (course.scene, course.model);
    let mut captured = 0;
    for i in 0..T::WIDTH {
        let (energy, sense, h, parameter) = (lanes.energy[i], lanes.sense[i], lanes.h[i], lanes.parameter[i]);
        let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
        let flight = Flight { x: at(&lanes.x), p: at(&lanes.p), v: at(&lanes.v), a: at(&lanes.a) };
        let rate_at = |x: [T; 3], p: [T; 3], parameter: T| {
            let (v, a) = (functions.rate)((), model, x, p, energy, sense, parameter);
            Flight { x, p, v, a }
        };
        let moved = match scene.method {
            METHOD_EULER => {
                let kick = if scene.literal_kick == 1 { T::from_f64(1.0) } else { h };
                euler_step((functions.index_gradient)((), model, flight.x, energy), &flight, h, kick)
            }
            METHOD_LEAPFROG => leapfrog_step((), rate_at, &flight, parameter, h),
            _ => symplectic_step(rate_at, &flight, parameter, h),
        };
        let alive = (functions.capture_distance)((), model, moved.x, moved.p, lanes.frequency[i], sense);
        captured |= u32::from(alive.to_f64() < 0.0) << i;
        let next = &mut lanes.next;
        // Of given length, whatever is safe or exact; what follows from that is not read.
        (next.safe[i], next.error[i], next.stray[i]) = (T::from_f64(0.0), T::from_f64(0.0), T::from_f64(0.0));
        for axis in 0..3 {
            next.x[axis][i] = moved.x[axis];
            next.p[axis][i] = moved.p[axis];
            next.v[axis][i] = moved.v[axis];
            next.a[axis][i] = moved.a[axis];
        }
    }
    captured
}

/// Judges the step that was taken: whether its error will do, how long the next one may be, where it ends, and how much of it may meet
/// geometry.
#[inline(always)]
pub fn judge_lanes<L: Lane<Real = T>, T: Scalar>(token: L::Token, course: &Course<T>, lanes: &mut Lanes<T>, live: u32) -> Masks {
    let (scene, model) = (course.scene, course.model);
    let (zero, one) = (L::constant(token, 0.0), L::constant(token, 1.0));
    let fixed = fixed_step(scene, model);
    let flight = lanes.flight::<L>(token);
    let h = L::load(token, &lanes.h);
    let length = L::load(token, &lanes.length);
    let next = &lanes.next;
    let moved: Flight<L> =
        Flight { x: load3(token, &next.x), p: load3(token, &next.p), v: load3(token, &next.v), a: load3(token, &next.a) };
    let error = L::load(token, &next.error);
    let cone = L::load(token, &lanes.spread).mul_add(length, L::load(token, &lanes.width));
    let tolerance = course.tolerance(token, flight.x, cone, L::load(token, &lanes.detail));
    let good = error.lt(tolerance);
    let mut accepted = if fixed { u32::MAX } else { L::bits(good) };

    let margin = step_margin(token, error, tolerance);
    let ideal = ideal_step(token, h, error, tolerance);

    // Choose the next step length, inside what the model allows at the place it starts from.
    let straight = scene.method == METHOD_EULER && course.kind.class() == Class::Medium;
    let mut next_h = if fixed {
        if scene.method >= METHOD_RUNGE_KUTTA { L::splat(token, model.step) / dot(moved.v, moved.v).sqrt() } else { h }
    } else {
        let trend = step_trend(token, ideal, L::load(token, &lanes.ideal));
        let proposed = h * step_factor(token, margin, L::select(good, trend, one));
        L::select(good, proposed.min(L::load(token, &next.safe)), proposed)
    };

    // See where the step ends.
    let from_center = along(moved.x, splat3(token, region_center(course)), L::constant(token, -1.0));
    let radius = L::constant(token, f64::from(scene.region_radius));
    let outside = L::both((radius * radius).lt(dot(from_center, from_center)), zero.lt(dot(from_center, moved.v)));
    let mut crossed = 0;
    if model.throat.to_f64() > 0.0 {
        let from_origin = along(moved.x, splat3(token, model.origin), L::constant(token, -1.0));
        crossed = L::bits(dot(from_origin, from_origin).lt(L::splat(token, model.throat * model.throat)));
    }
    // The thesis' steps have the length they are given, and are straight.
    let travelled = if straight { h } else { arc_length(token, &flight, &moved, h) };

    // Look for geometry along the way.
    let (tangent0, tangent1) = if straight {
        let chord = along(moved.x, flight.x, L::constant(token, -1.0));
        (chord, chord)
    } else {
        let none = [zero; 3];
        (along(none, flight.v, h), along(none, moved.v, h))
    };
    let curve = hermite(token, flight.x, moved.x, tangent0, tangent1);
    let room = L::load(token, &lanes.room);
    let (from, to, end_room) = occupied_span(token, &course.view, &grid_curve(token, &course.view, &curve), room, live & accepted);
    let next = &mut lanes.next;
    let mut occupied = L::bits(from.lt(to)) & live & accepted;
    let mut met = occupied;
    if occupied != 0 {
        // Where something may be met, the way between the ends must be as exact as they are, and as the hits: these are single.
        let stray = L::load(token, &next.stray);
        let allowed = tolerance.max(largest_coordinate(flight.x) * L::constant(token, TOLERANCE_FLOOR_F32));
        let strays = if fixed { 0 } else { L::bits(allowed.lt(stray)) & occupied };
        if strays != 0 {
            let shorter = h * step_factor(token, step_margin(token, stray, allowed), one);
            next_h = L::select(L::mask(token, strays), shorter, next_h);
            accepted &= !strays;
            occupied &= !strays;
            met = occupied;
        }
        met &= prepare_pieces(token, course, &curve, (from, to), cone, &mut next.pieces);
    }
    ideal.store(&mut next.ideal);
    end_room.store(&mut next.room);
    next_h.store(&mut next.h);
    travelled.store(&mut next.travelled);
    from.store(&mut next.from);
    to.store(&mut next.to);
    Masks { accepted, occupied, met, outside: L::bits(outside), crossed }
}

/// Cuts the spans of curves into chords and prepares them for traversal; returns the lanes that may meet a child of the scene's root.
#[inline(always)]
pub fn prepare_pieces<L: Lane<Real = T>, T: Scalar>(
    token: L::Token,
    course: &Course<T>,
    curve: &Curve<L>,
    (from, to): (L, L),
    cone: L,
    pieces: &mut Pieces<T>,
) -> u32 {
    let piece = cut_span(token, curve, from, to, cone * L::constant(token, f64::from(course.scene.chord_tolerance)));
    let prepared = slabs(token, &piece);
    pieces.store(&piece, &prepared);
    if course.scene.far_root == 0 { enter_root(token, &course.view, &prepared, &mut pieces.root) } else { u32::MAX }
}
