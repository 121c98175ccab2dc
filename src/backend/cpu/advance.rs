//! Rays from launch to landing: straight ones one by one, curved ones as lanes of a register with finished lanes refilled.

use super::edges::*;
use super::lanes::{Ends, Lanes, Row};
use super::step::*;
use crate::backend::Stop;
use crate::kernels::bvh::{Curve, Hit, TraversalStack, closest_hit, hit_position, slabs, straight};
use crate::kernels::clearance::{grid_curve, occupied_span};
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::surface::{Arrival, matter_velocity};
use crate::kernels::triangle::dot;
use crate::simd::{Lane, load3, splat3, store3};
use crate::spacetime::Class;
use fearless_simd::Simd;
use glam::Vec3;

/// A ray to trace.
#[derive(Clone, Copy)]
pub struct Launch<T> {
    /// Start.
    pub origin: [T; 3],
    /// Unit direction of travel in the local frame.
    pub direction: [T; 3],
    /// Length of the launch velocity.
    pub speed: T,
    /// -1 to follow light into its past, as a camera does, +1 into its future.
    pub sense: T,
    /// Side of a wormhole: 0 or 1.
    pub side: u32,
    /// Width of its cone.
    pub width: f32,
    /// Growth of its cone.
    pub spread: f32,
}

/// A ray that ended.
#[derive(Clone, Copy)]
pub struct Landing<T> {
    /// The end as shading sees it.
    pub arrival: Arrival,
    /// End point.
    pub position: [T; 3],
    /// Unit direction in the local frame, at infinity if escaped.
    pub direction: [T; 3],
    /// Velocity or momentum of the model.
    pub momentum: [T; 3],
    /// The model's parameter.
    pub parameter: T,
    /// Coordinate length.
    pub length: T,
}

/// Traces `count` rays through flat space.
#[inline(always)]
pub fn advance_straight<S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    stack: &mut TraversalStack,
    count: usize,
    launch: impl Fn(usize) -> Launch<T>,
    mut land: impl FnMut(usize, Landing<T>),
) {
    for index in 0..count {
        let ray = launch(index);
        let mut solo = Solo::new(ray.origin, ray.direction, ray.side);
        let status = solo.cross(simd, course, stack);
        land(index, solo.landing(status, &Observed::flat()));
    }
}

/// The scalar part of a ray: its place, and what it has met.
struct Solo<T> {
    x: [T; 3],
    /// Coordinate direction while straight, else unit velocity.
    d: [T; 3],
    p: [T; 3],
    parameter: T,
    length: T,
    steps: u32,
    chords: u32,
    side: u32,
    hit: Option<(Hit, Vec3)>,
}

/// What the local observer sees of a ray's end.
struct Observed<T> {
    direction: Option<[T; 3]>,
    redshift: f32,
    constraint_error: f32,
    frame: [[f32; 3]; 2],
    doppler: f32,
}

impl<T> Observed<T> {
    fn flat() -> Self {
        Observed { direction: None, redshift: 1.0, constraint_error: 0.0, frame: [[1.0; 3], [0.0; 3]], doppler: 1.0 }
    }
}

impl<T: Scalar> Solo<T> {
    fn new(x: [T; 3], d: [T; 3], side: u32) -> Self {
        let zero = T::from_f64(0.0);
        Solo { x, d, p: d, parameter: zero, length: zero, steps: 0, chords: 0, side, hit: None }
    }

    fn of_lane(lanes: &Lanes<T>, i: usize) -> Self {
        let take = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
        let v = take(&lanes.v);
        let speed = dot(v, v).sqrt();
        Solo {
            x: take(&lanes.x),
            d: [v[0] / speed, v[1] / speed, v[2] / speed],
            p: take(&lanes.p),
            parameter: lanes.parameter[i],
            length: lanes.length[i],
            steps: lanes.steps[i],
            chords: lanes.chords[i],
            side: lanes.side[i],
            hit: None,
        }
    }

    /// Goes straight to a hit, or away.
    #[inline(always)]
    fn cross<S: Simd>(&mut self, simd: S, course: &Course<T>, stack: &mut TraversalStack) -> u32 {
        let curve = straight(to_vec3(self.x), to_vec3(self.d));
        let mut hit = Hit::none(FAR);
        self.chords += 1;
        closest_hit(simd, &course.view, &curve, &slabs((), &curve), self.side, stack, &mut hit);
        if hit.primitive == NO_INDEX {
            return STATUS_ESCAPED;
        }
        self.length = self.length + T::from_f64(f64::from(hit.t));
        self.hit = Some((hit, hit_position(&curve, hit.t)));
        STATUS_HIT
    }

    /// Where the ray ended.
    #[inline(always)]
    fn end(&self) -> [T; 3] {
        self.hit.map_or(self.x, |(_, position)| from_vec3(position))
    }

    /// Leaves the region outward: straight on past whatever is there, or along the asymptote of the far field.
    #[inline(always)]
    fn leave<S: Simd>(&mut self, simd: S, course: &Course<T>, stack: &mut TraversalStack) -> u32 {
        let scene = course.scene;
        if scene.region_strength != 0.0 {
            let center = region_center::<T>(course);
            let from_center = [self.x[0] - center[0], self.x[1] - center[1], self.x[2] - center[2]];
            self.d = asymptote(from_center, self.d, T::from_f64(f64::from(scene.region_strength)));
            return STATUS_ESCAPED;
        }
        self.cross(simd, course, stack)
    }

    #[inline(always)]
    fn landing(&self, status: u32, observed: &Observed<T>) -> Landing<T> {
        let (hit, position) = match self.hit {
            Some((hit, position)) => (hit, position),
            None => (Hit::none(0.0), to_vec3(self.x)),
        };
        let direction = observed.direction.unwrap_or(self.d);
        Landing {
            arrival: Arrival {
                position,
                primitive: hit.primitive,
                direction: to_vec3(direction),
                status,
                u: hit.u,
                v: hit.v,
                path_length: self.length.to_f32(),
                redshift: observed.redshift,
                steps: self.steps,
                chords: self.chords,
                constraint_error: observed.constraint_error,
                frame_diagonal: observed.frame[0].into(),
                frame_mixed: observed.frame[1].into(),
                doppler: observed.doppler,
                side: self.side,
            },
            position: self.end(),
            direction,
            momentum: self.p,
            parameter: self.parameter,
            length: self.length,
        }
    }
}

/// Traces `count` rays through the world's model, `T::WIDTH` at a time.
#[inline(always)]
pub fn advance_curved<S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    stack: &mut TraversalStack,
    count: usize,
    launch: impl Fn(usize) -> Launch<T>,
    mut land: impl FnMut(usize, Landing<T>),
) {
    let scene = course.scene;
    let functions = PointFunctions::<T>::of(course.kind);
    let kernels = ModelKernels::<S, T>::of(course.kind);
    let medium = course.kind.class() == Class::Medium;
    let euler = scene.method == METHOD_EULER && medium;
    let one_by_one = euler || matches!(scene.method, METHOD_SYMPLECTIC | METHOD_LEAPFROG);
    let mut lanes = Lanes::<T>::idle();
    let mut waiting = Waiting { lanes: Lanes::idle(), ready: 0, next: 0 };
    let mut ended = Ended { ends: Ends::idle(), rays: Vec::with_capacity(T::WIDTH) };
    let mut live = 0u32;
    let stops = course.stop != Stop::Never;
    loop {
        // Fill the lanes that are free.
        let mut free = !live & ((1u32 << T::WIDTH) - 1);
        while free != 0 {
            if waiting.ready == 0 && !waiting.fill(simd, course, &functions, &kernels, stack, count, &launch, &mut land) {
                break;
            }
            let (lane, from) = (free.trailing_zeros() as usize, waiting.ready.trailing_zeros() as usize);
            free &= free - 1;
            waiting.ready &= waiting.ready - 1;
            lanes.take(lane, &waiting.lanes, from);
            live |= 1 << lane;
        }
        if live == 0 {
            return ended.report(simd, course, &functions, &kernels, &mut land);
        }
        let captured =
            if one_by_one { integrate_alone(course, &functions, &mut lanes) } else { (kernels.integrate)(simd, course, &mut lanes) };
        let masks = judge_lanes::<T::Register<S>, T>(simd, course, &mut lanes, live);
        let mut accepted = masks.accepted & live;
        let mut crossing = 0;
        if course.model.rim.to_f64() > 0.0 && !fixed_step(scene, course.model) {
            crossing = meet_rim(course, &functions, &mut lanes, live, &mut accepted);
        }
        let mut reached = 0;
        if stops {
            for i in 0..T::WIDTH {
                if accepted >> i & 1 == 1 {
                    match approach_stop(course, &functions, &mut lanes, i, euler, crossing >> i & 1 == 1) {
                        Approach::Before => {}
                        Approach::Reached => reached |= 1 << i,
                        Approach::Beyond => accepted &= !(1 << i),
                    }
                }
            }
        }
        if scene.region_sharp != 0 {
            accepted &= !beyond_edge(course, &mut lanes, masks.outside & accepted);
        }
        stack.work.steps += u64::from(live.count_ones());
        stack.work.skips += u64::from((accepted & !masks.occupied).count_ones());
        let (looked_up, met) = (masks.occupied & accepted, masks.met & accepted);
        for i in 0..T::WIDTH {
            lanes.steps[i] += 1;
            lanes.chords[i] += looked_up >> i & 1;
        }
        stack.work.pass_root(looked_up & !met);

        // Look for hits along the steps that may meet something.
        let mut todo = met;
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            if let Some((s, hit)) = meet(simd, course, stack, &lanes, i) {
                let landed = land_on_surface(&lanes, i, s, hit);
                ended.add(course, &functions, &lanes, i, landed, STATUS_HIT);
                live &= !(1 << i);
                if ended.rays.len() == T::WIDTH {
                    ended.report(simd, course, &functions, &kernels, &mut land);
                }
            }
        }
        lanes.commit::<T::Register<S>>(simd, accepted & live);
        if course.model.throat.to_f64() > 0.0 {
            let mut todo = masks.crossed & accepted & live;
            while todo != 0 {
                let i = todo.trailing_zeros() as usize;
                todo &= todo - 1;
                cross_throat(course, &functions, &mut lanes, i);
            }
        }

        // See which rays are over.
        let mut worn_out = 0;
        for i in 0..T::WIDTH {
            worn_out |= u32::from(lanes.steps[i] >= scene.max_steps) << i;
        }
        let moved = accepted & live;
        let mut todo = moved & (captured | masks.outside | reached) | live & worn_out;
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let is = |mask: u32| (moved & mask) >> i & 1 == 1;
            let mut solo = None;
            let status = if is(reached) {
                Some(STATUS_STOPPED)
            } else if is(captured) {
                Some(STATUS_CAPTURED)
            } else if is(masks.outside) && masks.crossed >> i & 1 == 0 {
                let mut leaving = Solo::of_lane(&lanes, i);
                let status = leaving.leave(simd, course, stack);
                solo = Some(leaving);
                Some(status)
            } else if worn_out >> i & 1 == 1 {
                Some(STATUS_EXHAUSTED)
            } else {
                None
            };
            if let Some(status) = status {
                let solo = solo.unwrap_or_else(|| Solo::of_lane(&lanes, i));
                ended.add(course, &functions, &lanes, i, solo, status);
                live &= !(1 << i);
                if ended.rays.len() == T::WIDTH {
                    ended.report(simd, course, &functions, &kernels, &mut land);
                }
            }
        }
    }
}

/// The first hit along the piece of lane `i`, and the share of the whole step at which it is.
#[inline(always)]
fn meet<S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    stack: &mut TraversalStack,
    lanes: &Lanes<T>,
    i: usize,
) -> Option<(T, (Hit, Vec3))> {
    let (from, to) = (lanes.next.from[i].to_f32(), lanes.next.to[i].to_f32());
    let (curve, slabs) = lanes.next.pieces.of_lane(i);
    let mut hit = Hit::none(1.0);
    closest_hit(simd, &course.view, &curve, &slabs, lanes.side[i], stack, &mut hit);
    let share = T::from_f64(f64::from(from + (to - from) * hit.t));
    (hit.primitive != NO_INDEX).then(|| (share, (hit, hit_position(&curve, hit.t))))
}

/// Lane `i` where it met a surface at the share `s` of its step: momentum from the cubic through both ends.
#[inline(always)]
fn land_on_surface<T: Scalar>(lanes: &Lanes<T>, i: usize, s: T, hit: (Hit, Vec3)) -> Solo<T> {
    let mut solo = Solo::of_lane(lanes, i);
    let h = lanes.h[i];
    let (one, two, three) = (T::from_f64(1.0), T::from_f64(2.0), T::from_f64(3.0));
    let rest = one - s;
    for axis in 0..3 {
        let (p0, p1) = (lanes.p[axis][i], lanes.next.p[axis][i]);
        let (a0, a1) = (lanes.a[axis][i] * h, lanes.next.a[axis][i] * h);
        solo.p[axis] = rest * rest * (p0 * (one + two * s) + a0 * s) + s * s * (p1 * (three - two * s) - a1 * rest);
    }
    solo.parameter = solo.parameter + h * s;
    solo.length = solo.length + lanes.next.travelled[i] * s;
    solo.hit = Some(hit);
    solo
}

/// Rays that ended and are not reported yet, so that what is observed there is computed for many at once.
struct Ended<T> {
    ends: Ends<T>,
    rays: Vec<EndedRay<T>>,
}

struct EndedRay<T> {
    index: usize,
    solo: Solo<T>,
    status: u32,
    /// Frequency at the start.
    frequency: T,
    drift: f32,
}

impl<T: Scalar> Ended<T> {
    /// Adds the end of lane `i`; there must be room.
    #[inline(always)]
    fn add(&mut self, course: &Course<T>, functions: &PointFunctions<T>, lanes: &Lanes<T>, i: usize, solo: Solo<T>, status: u32) {
        let (energy, sense) = (lanes.energy[i], lanes.sense[i]);
        let drift = if course.drift {
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            let (x, p) = (at(&lanes.x), at(&lanes.p));
            (functions.observe)((), course.model, x, p, energy, sense, lanes.parameter[i]).2.to_f32().abs()
        } else {
            0.0
        };
        let (to, ends) = (self.rays.len(), &mut self.ends);
        for (axis, x) in solo.end().into_iter().enumerate() {
            (ends.x[axis][to], ends.p[axis][to]) = (x, solo.p[axis]);
        }
        (ends.energy[to], ends.sense[to], ends.parameter[to]) = (energy, sense, solo.parameter);
        self.rays.push(EndedRay { index: lanes.index[i], solo, status, frequency: lanes.frequency[i], drift });
    }

    /// Reports them all.
    fn report<S: Simd>(
        &mut self,
        simd: S,
        course: &Course<T>,
        functions: &PointFunctions<T>,
        kernels: &ModelKernels<S, T>,
        land: &mut impl FnMut(usize, Landing<T>),
    ) {
        if self.rays.is_empty() {
            return;
        }
        (kernels.observe)(simd, course, &mut self.ends);
        let ends = &self.ends;
        for (i, ray) in self.rays.drain(..).enumerate() {
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            let frequency = ends.frequency[i];
            let escaped = ray.status == STATUS_ESCAPED;
            let end = if escaped { ends.far_frequency[i] } else { frequency };
            let mut frame = [[1.0; 3], [0.0; 3]];
            let mut doppler = 1.0;
            if let Some((hit, position)) = ray.solo.hit {
                if course.kind.class() == Class::Metric {
                    frame = [to_vec3(at(&ends.frame_diagonal)).into(), to_vec3(at(&ends.frame_mixed)).into()];
                }
                if let Some(velocity) = matter_velocity(&course.view, &hit, position) {
                    let (x, p, energy, sense) = (at(&ends.x), at(&ends.p), ends.energy[i], ends.sense[i]);
                    let emitted = (functions.matter_frequency)((), course.model, x, p, energy, sense, from_vec3(velocity));
                    doppler = (frequency / emitted).to_f32();
                }
            }
            let observed = Observed {
                // An escaped ray has its asymptotic direction already, unless the chart moves.
                direction: if escaped && !course.kind.moves_at_infinity() { None } else { Some(at(&ends.direction)) },
                redshift: (ray.frequency / end).to_f32(),
                constraint_error: ray.drift,
                frame,
                doppler,
            };
            land(ray.index, ray.solo.landing(ray.status, &observed));
        }
    }
}

/// Rays that were launched together and wait for lanes that are free.
struct Waiting<T> {
    lanes: Lanes<T>,
    /// Lanes whose ray waits, as bits.
    ready: u32,
    /// The ray to be launched next.
    next: usize,
}

impl<T: Scalar> Waiting<T> {
    /// Launches the next rays that have to be integrated; rays that end before are reported. False when none is left.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "the state of one loop, split so that it can be read")]
    fn fill<S: Simd>(
        &mut self,
        simd: S,
        course: &Course<T>,
        functions: &PointFunctions<T>,
        kernels: &ModelKernels<S, T>,
        stack: &mut TraversalStack,
        count: usize,
        launch: &impl Fn(usize) -> Launch<T>,
        land: &mut impl FnMut(usize, Landing<T>),
    ) -> bool {
        while self.ready == 0 && self.next < count {
            let lanes = &mut self.lanes;
            for i in 0..T::WIDTH.min(count - self.next) {
                let ray = launch(self.next);
                for axis in 0..3 {
                    (lanes.x[axis][i], lanes.p[axis][i]) = (ray.origin[axis], ray.direction[axis]);
                }
                (lanes.energy[i], lanes.sense[i]) = (ray.speed, ray.sense);
                (lanes.width[i], lanes.spread[i]) = (T::from_f64(f64::from(ray.width)), T::from_f64(f64::from(ray.spread)));
                (lanes.length[i], lanes.chords[i], lanes.side[i]) = (T::from_f64(0.0), 0, ray.side);
                lanes.index[i] = self.next;
                self.ready |= 1 << i;
                self.next += 1;
            }
            self.approach::<T::Register<S>, S>(simd, course, stack, land);
        }
        if self.ready == 0 {
            return false;
        }
        (kernels.launch)(simd, course, &mut self.lanes);
        if course.stop != Stop::Never {
            let lanes = &mut self.lanes;
            for i in 0..T::WIDTH {
                let x = [lanes.x[0][i], lanes.x[1][i], lanes.x[2][i]];
                lanes.until[i] = stop_distance(course, functions, x, lanes.length[i], T::from_f64(0.0));
            }
        }
        true
    }

    /// Takes rays that start outside of the bending region straight there, or past it; those that end on the way are reported.
    #[inline(always)]
    fn approach<L: Lane<Real = T, Token = S>, S: Simd>(
        &mut self,
        simd: S,
        course: &Course<T>,
        stack: &mut TraversalStack,
        land: &mut impl FnMut(usize, Landing<T>),
    ) {
        let lanes = &mut self.lanes;
        let zero = L::constant(simd, 0.0);
        zero.store(&mut lanes.room);
        let (x, d) = (load3(simd, &lanes.x), load3(simd, &lanes.p));
        let radius = L::constant(simd, f64::from(course.scene.region_radius));
        let entry = enter_sphere(simd, x, d, splat3(simd, region_center(course)), radius);
        let passing = L::bits(entry.lt(zero)) & self.ready;
        let entering = L::bits(zero.lt(entry)) & self.ready;
        if passing | entering == 0 {
            return;
        }
        let way = (entry * L::constant(simd, 1.0 + T::REGION_MARGIN)).max(zero);
        let across = [d[0] * way, d[1] * way, d[2] * way];
        let curve = Curve { start: x, c1: across, c2: [zero; 3], c3: [zero; 3], chords: L::constant(simd, 1.0), tolerance: zero };
        let (from, to, end_room) = occupied_span(simd, &course.view, &grid_curve(simd, &course.view, &curve), zero, entering);
        L::select(zero.lt(entry), end_room, zero).store(&mut lanes.room);
        let occupied = L::bits(from.lt(to)) & entering;
        let mut met = 0;
        if occupied != 0 {
            // A straight way is its own chord, and needs next to no tolerance.
            let thin = L::constant(simd, f64::from(MIN_DIRECTION));
            met = occupied & prepare_pieces(simd, course, &curve, (from, to), thin, &mut lanes.next.pieces);
            stack.work.pass_root(occupied & !met);
        }
        from.store(&mut lanes.next.from);
        to.store(&mut lanes.next.to);
        way.store(&mut lanes.length);
        let mut todo = met | passing;
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            let mut solo = Solo::new(at(&lanes.x), at(&lanes.p), lanes.side[i]);
            let status = if passing >> i & 1 == 1 {
                solo.cross(simd, course, stack)
            } else if let Some((s, hit)) = meet(simd, course, stack, lanes, i) {
                (solo.length, solo.chords, solo.hit) = (lanes.length[i] * s, 1, Some(hit));
                STATUS_HIT
            } else {
                continue;
            };
            land(lanes.index[i], solo.landing(status, &Observed::flat()));
            self.ready &= !(1 << i);
        }
        for (i, chords) in lanes.chords.iter_mut().enumerate() {
            *chords += occupied >> i & 1;
        }
        store3(along(x, d, way), &mut lanes.x);
    }
}
