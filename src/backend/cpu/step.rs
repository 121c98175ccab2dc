//! One step of all rays in flight, as lanes of registers: the integration, compiled for each model, and what is the same for all.

use crate::backend::Stop;
use crate::kernels::bvh::{Curve, Slabs, cut_span, hermite, meets_root, slabs};
use crate::kernels::clearance::{grid_curve, occupied_span};
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::layout::SceneParameters;
use crate::kernels::triangle::dot;
use crate::kernels::view::SceneView;
use crate::simd::{Lane, MAX_LANES, Real, load3, splat3};
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
        macro_rules! choose {
            ($(($name:ident, $stem:ident, $class:ident)),+ $(,)?) => {
                match kind {
                    $(ModelKind::$name => ModelKernels {
                        launch: launch::<crate::spacetime::$name, S, T>,
                        integrate: integrate::<crate::spacetime::$name, S, T>,
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

/// A number per lane.
pub type Row<T> = [T; MAX_LANES];

/// State of the rays in flight, and where the step in hand leads.
#[repr(align(64))]
pub struct Lanes<T> {
    /// Positions.
    pub x: [Row<T>; 3],
    /// Momenta.
    pub p: [Row<T>; 3],
    /// Velocities.
    pub v: [Row<T>; 3],
    /// Forces.
    pub a: [Row<T>; 3],
    /// Step lengths, in the model's parameter.
    pub h: Row<T>,
    /// Parameters so far.
    pub parameter: Row<T>,
    /// Conserved energies.
    pub energy: Row<T>,
    /// Senses.
    pub sense: Row<T>,
    /// Frequencies at the start.
    pub frequency: Row<T>,
    /// Widths of the cones at the start.
    pub width: Row<T>,
    /// Growth of the cones.
    pub spread: Row<T>,
    /// Lengths by which the errors of the steps are measured.
    pub detail: Row<T>,
    /// Coordinate lengths so far.
    pub length: Row<T>,
    /// Signed distances from where the rays are to stop: negative before it.
    pub until: Row<T>,
    /// State at the end of the step.
    pub next: Next<T>,
    /// Which ray is in each lane.
    pub index: [usize; MAX_LANES],
    /// Steps of each ray.
    pub steps: [u32; MAX_LANES],
    /// Chords of each ray.
    pub chords: [u32; MAX_LANES],
    /// Side of the wormhole each ray is on: 0 or 1.
    pub side: [u32; MAX_LANES],
}

/// State at the end of a step.
#[repr(align(64))]
pub struct Next<T> {
    /// Positions.
    pub x: [Row<T>; 3],
    /// Momenta.
    pub p: [Row<T>; 3],
    /// Velocities.
    pub v: [Row<T>; 3],
    /// Forces.
    pub a: [Row<T>; 3],
    /// Local errors of the steps.
    pub error: Row<T>,
    /// How far the cubics through both ends stray from the rays between.
    pub stray: Row<T>,
    /// Coordinate lengths that the model allows the next steps.
    pub safe: Row<T>,
    /// Lengths by which their errors are measured.
    pub detail: Row<T>,
    /// Lengths of the next steps.
    pub h: Row<T>,
    /// Coordinate lengths of the steps.
    pub travelled: Row<T>,
    /// Where geometry may be met first along each step.
    pub from: Row<T>,
    /// Where it may be met last.
    pub to: Row<T>,
    /// The steps between these, cut into chords; valid where geometry may be met.
    pub pieces: Pieces<T>,
}

/// Pieces of steps as [`Curve`]s, and their chords as [`Slabs`].
#[repr(align(64))]
pub struct Pieces<T> {
    start: [Row<T>; 3],
    c1: [Row<T>; 3],
    c2: [Row<T>; 3],
    c3: [Row<T>; 3],
    chords: Row<T>,
    inflation: Row<T>,
    inverse: [Row<T>; 3],
    near: [Row<T>; 3],
    far: [Row<T>; 3],
}

impl<T: Scalar> Pieces<T> {
    #[inline(always)]
    fn store<L: Lane<Real = T>>(&mut self, curve: &Curve<L>, slabs: &Slabs<L>) {
        let mut all = [
            (&mut self.start, curve.start),
            (&mut self.c1, curve.c1),
            (&mut self.c2, curve.c2),
            (&mut self.c3, curve.c3),
            (&mut self.inverse, slabs.inverse),
            (&mut self.near, slabs.near),
            (&mut self.far, slabs.far),
        ];
        for (rows, values) in &mut all {
            for axis in 0..3 {
                values[axis].store(&mut rows[axis]);
            }
        }
        curve.chords.store(&mut self.chords);
        curve.inflation.store(&mut self.inflation);
    }

    /// The piece of lane `i`.
    #[inline(always)]
    pub fn of_lane(&self, i: usize) -> (Curve<f32>, Slabs<f32>) {
        let [start, c1, c2, c3, inverse, near, far] = [&self.start, &self.c1, &self.c2, &self.c3, &self.inverse, &self.near, &self.far]
            .map(
                #[inline(always)]
                |rows| [rows[0][i].to_f32(), rows[1][i].to_f32(), rows[2][i].to_f32()],
            );
        let (chords, inflation) = (self.chords[i].to_f32(), self.inflation[i].to_f32());
        (Curve { start, c1, c2, c3, chords, inflation }, Slabs { inverse, near, far })
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

impl<T: Scalar> Lanes<T> {
    /// Lanes without rays, far from everything.
    pub fn idle() -> Self {
        let row = |value: f64| [T::from_f64(value); MAX_LANES];
        let (zero, one) = (row(0.0), row(1.0));
        Lanes {
            x: [row(1e6); 3],
            p: [one; 3],
            v: [one; 3],
            a: [zero; 3],
            h: zero,
            parameter: zero,
            energy: one,
            sense: one,
            frequency: one,
            width: one,
            spread: zero,
            detail: one,
            length: zero,
            until: zero,
            next: Next {
                x: [zero; 3],
                p: [zero; 3],
                v: [zero; 3],
                a: [zero; 3],
                error: zero,
                stray: zero,
                safe: zero,
                detail: zero,
                h: zero,
                travelled: zero,
                from: zero,
                to: zero,
                pieces: Pieces {
                    start: [zero; 3],
                    c1: [zero; 3],
                    c2: [zero; 3],
                    c3: [zero; 3],
                    chords: one,
                    inflation: zero,
                    inverse: [one; 3],
                    near: [zero; 3],
                    far: [zero; 3],
                },
            },
            index: [0; MAX_LANES],
            steps: [0; MAX_LANES],
            chords: [0; MAX_LANES],
            side: [0; MAX_LANES],
        }
    }

    /// State and derivatives at the start of the step.
    #[inline(always)]
    fn flight<L: Lane<Real = T>>(&self, token: L::Token) -> Flight<L> {
        Flight { x: load3(token, &self.x), p: load3(token, &self.p), v: load3(token, &self.v), a: load3(token, &self.a) }
    }

    /// Moves the lanes of `accepted` to the end of their step.
    #[inline(always)]
    pub fn commit<L: Lane<Real = T>>(&mut self, token: L::Token, accepted: u32) {
        let moves = L::mask(token, accepted);
        let next = &self.next;
        // A row chosen from itself and another becomes a masked store, which takes some processors twenty times as long as a whole one;
        // so the compiler does not get to see that it is itself.
        let hidden = |row: &Row<T>| std::hint::black_box(L::load(token, row));
        for axis in 0..3 {
            for (row, moved) in [
                (&mut self.x[axis], &next.x[axis]),
                (&mut self.p[axis], &next.p[axis]),
                (&mut self.v[axis], &next.v[axis]),
                (&mut self.a[axis], &next.a[axis]),
            ] {
                L::select(moves, L::load(token, moved), hidden(row)).store(row);
            }
        }
        L::select(moves, L::load(token, &next.detail), hidden(&self.detail)).store(&mut self.detail);
        for (row, gain) in [(&mut self.parameter, &self.h), (&mut self.length, &next.travelled)] {
            let before = hidden(row);
            L::select(moves, before + L::load(token, gain), before).store(row);
        }
        self.h = next.h;
    }

    /// Puts the ray in lane `from` of `other` into lane `to`.
    #[inline(always)]
    pub fn take(&mut self, to: usize, other: &Lanes<T>, from: usize) {
        for axis in 0..3 {
            self.x[axis][to] = other.x[axis][from];
            self.p[axis][to] = other.p[axis][from];
            self.v[axis][to] = other.v[axis][from];
            self.a[axis][to] = other.a[axis][from];
        }
        self.h[to] = other.h[from];
        self.parameter[to] = other.parameter[from];
        self.energy[to] = other.energy[from];
        self.sense[to] = other.sense[from];
        self.frequency[to] = other.frequency[from];
        self.width[to] = other.width[from];
        self.spread[to] = other.spread[from];
        self.detail[to] = other.detail[from];
        self.length[to] = other.length[from];
        self.until[to] = other.until[from];
        self.index[to] = other.index[from];
        self.steps[to] = other.steps[from];
        self.chords[to] = other.chords[from];
        self.side[to] = other.side[from];
    }
}

/// Whether the method's steps are of fixed length.
pub fn fixed_step<T: Real>(scene: &SceneParameters, model: &ModelBlock<T>) -> bool {
    matches!(scene.method, METHOD_EULER | METHOD_SYMPLECTIC | METHOD_LEAPFROG)
        || (scene.method == METHOD_RUNGE_KUTTA && model.tableau[1].to_f64() == 0.0)
}

/// Launches every lane into the model `M`.
#[inline(always)]
fn launch_lanes<M: Model, L: Lane<Real = T>, T: Scalar>(token: L::Token, course: &Course<T>, lanes: &mut Lanes<T>) {
    let (scene, model) = (course.scene, course.model);
    let (x, direction) = (load3(token, &lanes.x), load3(token, &lanes.p));
    let sense = L::load(token, &lanes.sense);
    let (p, energy, frequency) = M::launch::<L>(token, model, x, direction, L::load(token, &lanes.energy), sense);
    let (v, a) = M::rate::<L>(token, model, x, p, energy, sense, L::constant(token, 0.0));
    let (safe, detail) = M::safe_step::<L>(token, model, x);
    let h = if !fixed_step(scene, model) {
        first_step(token, &Flight { x, p, v, a }, safe)
    } else if scene.method == METHOD_RUNGE_KUTTA {
        L::splat(token, model.step) / dot(v, v).sqrt()
    } else {
        L::splat(token, model.step)
    };
    for axis in 0..3 {
        p[axis].store(&mut lanes.p[axis]);
        v[axis].store(&mut lanes.v[axis]);
        a[axis].store(&mut lanes.a[axis]);
    }
    energy.store(&mut lanes.energy);
    frequency.store(&mut lanes.frequency);
    h.store(&mut lanes.h);
    detail.store(&mut lanes.detail);
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
    let (safe, detail) = M::safe_step::<L>(token, model, moved.x);
    safe.store(&mut next.safe);
    detail.store(&mut next.detail);
    error.store(&mut next.error);
    stray.store(&mut next.stray);
    for axis in 0..3 {
        moved.x[axis].store(&mut next.x[axis]);
        moved.p[axis].store(&mut next.p[axis]);
        moved.v[axis].store(&mut next.v[axis]);
        moved.a[axis].store(&mut next.a[axis]);
    }
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
        (next.safe[i], next.detail[i]) = (functions.safe_step)((), model, moved.x);
        (next.error[i], next.stray[i]) = (T::from_f64(0.0), T::from_f64(0.0));
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
    let zero = L::constant(token, 0.0);
    let fixed = fixed_step(scene, model);
    let flight = lanes.flight::<L>(token);
    let h = L::load(token, &lanes.h);
    let length = L::load(token, &lanes.length);
    let next = &lanes.next;
    let moved: Flight<L> =
        Flight { x: load3(token, &next.x), p: load3(token, &next.p), v: load3(token, &next.v), a: load3(token, &next.a) };
    let error = L::load(token, &next.error);
    let cone = L::load(token, &lanes.spread).mul_add(length, L::load(token, &lanes.width));
    let size = flight.x[0].max(-flight.x[0]).max(flight.x[1].max(-flight.x[1])).max(flight.x[2].max(-flight.x[2]));
    let floor = size * L::constant(token, T::TOLERANCE_FLOOR);
    let cap = L::load(token, &lanes.detail) * L::constant(token, DETAIL_TOLERANCE);
    let tolerance = (cone * L::constant(token, f64::from(scene.tolerance))).min(cap).max(floor);
    let good = error.lt(tolerance);
    let mut accepted = if fixed { u32::MAX } else { L::bits(good) };

    // Choose the next step length, inside what the model allows at the place it starts from.
    let straight = scene.method == METHOD_EULER && course.kind.class() == Class::Medium;
    let speed = dot(moved.v, moved.v).sqrt();
    let mut next_h = if fixed {
        if scene.method == METHOD_RUNGE_KUTTA { L::splat(token, model.step) / speed } else { h }
    } else {
        let proposed = h * step_factor(token, error, tolerance);
        L::select(good, proposed.min(L::load(token, &next.safe) / speed), proposed)
    };

    // See where the step ends.
    let from_center = along(moved.x, splat3(token, scene.region_center.map(|c| T::from_f64(f64::from(c)))), L::constant(token, -1.0));
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
    let (from, to) = occupied_span(token, &course.view, &grid_curve(token, &course.view, &curve), live & accepted);
    let next = &mut lanes.next;
    let mut occupied = L::bits(from.lt(to)) & live & accepted;
    let mut met = occupied;
    if occupied != 0 {
        // Where something may be met, the way between the ends must be as exact as they are, and as the hits: these are single.
        let stray = L::load(token, &next.stray);
        let allowed = tolerance.max(size * L::constant(token, TOLERANCE_FLOOR_F32));
        let strays = if fixed { 0 } else { L::bits(allowed.lt(stray)) & occupied };
        if strays != 0 {
            next_h = L::select(L::mask(token, strays), h * step_factor(token, stray, allowed), next_h);
            accepted &= !strays;
            occupied &= !strays;
            met = occupied;
        }
        let piece = cut_span(token, &curve, from, to, cone * L::constant(token, f64::from(scene.chord_tolerance)));
        let prepared = slabs(token, &piece);
        if scene.far_root == 0 {
            met &= meets_root(token, &course.view, &prepared);
        }
        next.pieces.store(&piece, &prepared);
    }
    next_h.store(&mut next.h);
    travelled.store(&mut next.travelled);
    from.store(&mut next.from);
    to.store(&mut next.to);
    Masks { accepted, occupied, met, outside: L::bits(outside), crossed }
}
