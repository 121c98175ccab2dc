//! Rays from launch to landing: straight ones one by one, curved ones as lanes of a register with finished lanes refilled.

use super::edges::*;
use super::ended::Ended;
use super::lanes::Lanes;
use super::solo::{Observed, Solo};
use super::step::*;
use super::waiting::Waiting;
use crate::backend::Stop;
use crate::kernels::bvh::{Hit, TraversalStack, closest_hit, hit_position};
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::surface::Arrival;
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
    let mut waiting = Waiting::none();
    let mut ended = Ended::none();
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
                let landed = Solo::at_hit(&lanes, i, s, hit);
                ended.add(course, &functions, &lanes, i, landed, STATUS_HIT);
                live &= !(1 << i);
                if ended.is_full() {
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
                if ended.is_full() {
                    ended.report(simd, course, &functions, &kernels, &mut land);
                }
            }
        }
    }
}

/// The first hit along the piece of lane `i`, and the share of the whole step at which it is.
#[inline(always)]
pub(super) fn meet<S: Simd, T: Scalar>(
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
