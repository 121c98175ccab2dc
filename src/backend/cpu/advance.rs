//! Rays from launch to landing: straight ones one by one, curved ones as lanes of a register with finished lanes refilled.

use super::edges::*;
use super::step::*;
use crate::backend::Stop;
use crate::kernels::bvh::{Hit, TraversalStack, closest_hit, hit_position, slabs, straight};
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::path::{Arrival, matter_velocity};
use crate::kernels::triangle::dot;
use crate::simd::Real;
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
        let mut flight = Solo::new(&ray);
        let status = flight.cross(simd, course, stack, T::from_f64(f64::from(FAR))).unwrap_or(STATUS_ESCAPED);
        land(index, flight.landing(status, &Observed::flat()));
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
    fn new(ray: &Launch<T>) -> Self {
        let zero = T::from_f64(0.0);
        Solo {
            x: ray.origin,
            d: ray.direction,
            p: ray.direction,
            parameter: zero,
            length: zero,
            steps: 0,
            chords: 0,
            side: ray.side,
            hit: None,
        }
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

    /// Goes straight for `distance`, or to a hit.
    #[inline(always)]
    fn cross<S: Simd>(&mut self, simd: S, course: &Course<T>, stack: &mut TraversalStack, distance: T) -> Option<u32> {
        let curve = straight(to_vec3(self.x), to_vec3(self.d));
        let mut hit = Hit::none(distance.to_f32());
        self.chords += 1;
        closest_hit(simd, &course.view, &curve, &slabs((), &curve), self.side, stack, &mut hit);
        if hit.primitive != NO_INDEX {
            self.length = self.length + T::from_f64(f64::from(hit.t));
            self.hit = Some((hit, hit_position(&curve, hit.t)));
            return Some(STATUS_HIT);
        }
        if distance.to_f32() < FAR {
            self.x = along(self.x, self.d, distance);
            self.length = self.length + distance;
        }
        None
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
        self.cross(simd, course, stack, T::from_f64(f64::from(FAR))).unwrap_or(STATUS_ESCAPED)
    }

    fn landing(&self, status: u32, observed: &Observed<T>) -> Landing<T> {
        let (hit, position) = match self.hit {
            Some((hit, position)) => (hit, position),
            None => (Hit::none(0.0), to_vec3(self.x)),
        };
        let exact = self.hit.is_none();
        let from32 = |v: Vec3| v.to_array().map(|c| T::from_f64(f64::from(c)));
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
            position: if exact { self.x } else { from32(position) },
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
    let mut waiting = Waiting { lanes: Lanes::idle(), count: 0, taken: 0, next: 0 };
    let mut live = 0u32;
    let stops = course.stop != Stop::Never;
    loop {
        // Fill the lanes that are free.
        let mut free = !live & ((1u32 << T::WIDTH) - 1);
        while free != 0 {
            if waiting.taken == waiting.count && !waiting.fill(simd, course, &functions, &kernels, stack, count, &launch, &mut land) {
                break;
            }
            let lane = free.trailing_zeros() as usize;
            free &= free - 1;
            lanes.take(lane, &waiting.lanes, waiting.taken);
            waiting.taken += 1;
            live |= 1 << lane;
        }
        if live == 0 {
            return;
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
        let missed = u64::from((looked_up & !met).count_ones());
        stack.work.chords += missed;
        stack.work.nodes += missed;

        // Look for hits along the steps that may meet something.
        let mut todo = met;
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let (from, to) = (lanes.next.from[i].to_f32(), lanes.next.to[i].to_f32());
            let (curve, slabs) = lanes.next.pieces.of_lane(i);
            let mut hit = Hit::none(1.0);
            closest_hit(simd, &course.view, &curve, &slabs, lanes.side[i], stack, &mut hit);
            if hit.primitive != NO_INDEX {
                let s = from + (to - from) * hit.t;
                let landed = land_on_surface(&lanes, i, s, (hit, hit_position(&curve, hit.t)));
                finish(course, &functions, &lanes, i, landed, STATUS_HIT, &mut land);
                live &= !(1 << i);
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
            let ended = if is(reached) {
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
            if let Some(status) = ended {
                let solo = solo.unwrap_or_else(|| Solo::of_lane(&lanes, i));
                finish(course, &functions, &lanes, i, solo, status, &mut land);
                live &= !(1 << i);
            }
        }
    }
}

/// Lane `i` where it met a surface at the share `s` of its step: momentum from the cubic through both ends.
#[inline(always)]
fn land_on_surface<T: Scalar>(lanes: &Lanes<T>, i: usize, s: f32, hit: (Hit, Vec3)) -> Solo<T> {
    let mut solo = Solo::of_lane(lanes, i);
    let s = T::from_f64(f64::from(s));
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

/// Reports the end of lane `i`.
#[inline(always)]
fn finish<T: Scalar>(
    course: &Course<T>,
    functions: &PointFunctions<T>,
    lanes: &Lanes<T>,
    i: usize,
    solo: Solo<T>,
    status: u32,
    land: &mut impl FnMut(usize, Landing<T>),
) {
    let model = course.model;
    let x = solo.hit.map_or(solo.x, |(_, position)| position.to_array().map(|c| T::from_f64(f64::from(c))));
    let (energy, sense) = (lanes.energy[i], lanes.sense[i]);
    let (direction, frequency, _) = (functions.observe)((), model, x, solo.p, energy, sense, solo.parameter);
    let drift = if course.drift {
        let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
        (functions.observe)((), model, at(&lanes.x), at(&lanes.p), energy, sense, lanes.parameter[i]).2.to_f32().abs()
    } else {
        0.0
    };
    let escaped = status == STATUS_ESCAPED;
    let end = if escaped { (functions.far_frequency)((), model, solo.p, energy) } else { frequency };
    let mut frame = [[1.0; 3], [0.0; 3]];
    if solo.hit.is_some() && course.kind.class() == Class::Metric {
        let (diagonal, mixed) = (functions.frame)((), model, x);
        frame = [diagonal.map(Real::to_f32), mixed.map(Real::to_f32)];
    }
    let mut doppler = 1.0;
    if let Some((hit, position)) = solo.hit
        && let Some(velocity) = matter_velocity(&course.view, &hit, position)
    {
        let velocity = velocity.to_array().map(|c| T::from_f64(f64::from(c)));
        let emitted = (functions.matter_frequency)((), model, x, solo.p, energy, sense, velocity);
        doppler = (frequency / emitted).to_f32();
    }
    let observed = Observed {
        // An escaped ray has its asymptotic direction already, unless the chart moves.
        direction: if escaped && !course.kind.moves_at_infinity() { None } else { Some(direction) },
        redshift: (lanes.frequency[i] / end).to_f32(),
        constraint_error: drift,
        frame,
        doppler,
    };
    land(lanes.index[i], solo.landing(status, &observed));
}

/// Rays that were launched together and wait for lanes that are free.
struct Waiting<T> {
    lanes: Lanes<T>,
    /// How many there are.
    count: usize,
    /// How many have gone.
    taken: usize,
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
        let scene = course.scene;
        let center = region_center(course);
        let radius = T::from_f64(f64::from(scene.region_radius));
        let lanes = &mut self.lanes;
        (self.count, self.taken) = (0, 0);
        while self.count < T::WIDTH && self.next < count {
            let index = self.next;
            self.next += 1;
            let ray = launch(index);
            let mut solo = Solo::new(&ray);
            let entry = enter_sphere(solo.x, solo.d, center, radius);
            if entry.to_f64() != 0.0 {
                // The ray starts outside: it goes straight to the region, or past it.
                let margin = 1.0 + T::REGION_MARGIN;
                let distance = if entry.to_f64() < 0.0 { T::from_f64(f64::from(FAR)) } else { T::from_f64(entry.to_f64() * margin) };
                let ended = solo.cross(simd, course, stack, distance);
                let status = if entry.to_f64() < 0.0 { Some(ended.unwrap_or(STATUS_ESCAPED)) } else { ended };
                if let Some(status) = status {
                    land(index, solo.landing(status, &Observed::flat()));
                    continue;
                }
            }
            let i = self.count;
            self.count += 1;
            for axis in 0..3 {
                lanes.x[axis][i] = solo.x[axis];
                lanes.p[axis][i] = solo.d[axis];
            }
            lanes.energy[i] = ray.speed;
            lanes.sense[i] = ray.sense;
            lanes.width[i] = T::from_f64(f64::from(ray.width));
            lanes.spread[i] = T::from_f64(f64::from(ray.spread));
            lanes.length[i] = solo.length;
            lanes.until[i] = stop_distance(course, functions, solo.x, solo.length, T::from_f64(0.0));
            lanes.index[i] = index;
            lanes.chords[i] = solo.chords;
            lanes.side[i] = ray.side;
        }
        if self.count > 0 {
            (kernels.launch)(simd, course, lanes);
        }
        self.count > 0
    }
}
