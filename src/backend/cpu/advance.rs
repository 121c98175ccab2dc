//! Rays from launch to landing: straight ones in one stream, curved ones as lanes of a register with finished lanes refilled.

use super::edges::*;
use super::ended::Ended;
use super::lanes::{Lanes, lanes_of};
use super::solo::{Observed, Solo};
use super::step::*;
use super::waiting::Waiting;
use crate::backend::Stop;
use crate::kernels::bvh::Hit;
use crate::kernels::constants::*;
use crate::kernels::curve::{Curve, hit_position};
use crate::kernels::integrator::*;
use crate::kernels::surface::Arrival;
use crate::kernels::traverser::{Query, Traverser};
use crate::simd::MAX_LANES;
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
    traverser: &mut Traverser,
    count: usize,
    launch: impl Fn(usize) -> Launch<T>,
    mut land: impl FnMut(usize, Landing<T>),
) {
    let ray = |index: usize| {
        let ray = launch(index);
        Solo::new(ray.origin, ray.direction, ray.side)
    };
    let ways = (0..count).map(|index| (index, ray(index).straight_on(&course.view)));
    traverser.closest_hits(simd, &course.view, ways, |index, _, hit| {
        let mut solo = ray(index);
        let status = solo.cross(hit);
        land(index, solo.landing(status, &Observed::flat()));
    });
}

/// Traces `count` rays through the world's model, `T::WIDTH` at a time.
#[inline(always)]
pub fn advance_curved<S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    traverser: &mut Traverser,
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
            if waiting.ready == 0 && !waiting.fill(simd, course, &functions, &kernels, traverser, count, &launch, &mut land) {
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
        traverser.work.steps += u64::from(live.count_ones());
        traverser.work.skips += u64::from((accepted & !masks.occupied).count_ones());
        let (looked_up, met) = (masks.occupied & accepted, masks.met & accepted);
        for i in 0..T::WIDTH {
            lanes.steps[i] += 1;
            lanes.chords[i] += looked_up >> i & 1;
        }
        traverser.work.pass_root(looked_up & !met);

        // Look for hits along the steps that may meet something.
        if met != 0 {
            let hits = meet(simd, course, traverser, &lanes, met);
            for i in lanes_of(met) {
                if let Some(hit) = hits[i] {
                    ended.add(course, &functions, &lanes, i, Solo::at_hit(&lanes, i, hit), STATUS_HIT);
                    live &= !(1 << i);
                    if ended.is_full() {
                        ended.report(simd, course, &functions, &kernels, &mut land);
                    }
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
        let leaving = moved & masks.outside & !masks.crossed & !(reached | captured);
        let over = moved & (captured | reached) | leaving | live & worn_out;
        if over == 0 {
            continue;
        }
        let mut ways_out = [Hit::none(FAR); MAX_LANES];
        if scene.region_strength == 0.0 {
            let ways = lanes_of(leaving).map(|i| (i, Solo::of_lane(&lanes, i).straight_on(&course.view)));
            traverser.closest_hits(simd, &course.view, ways, |i, _, hit| ways_out[i] = hit);
        }
        for i in lanes_of(over) {
            let is = |mask: u32| (moved & mask) >> i & 1 == 1;
            let mut solo = Solo::of_lane(&lanes, i);
            let status = if is(reached) {
                STATUS_STOPPED
            } else if is(captured) {
                STATUS_CAPTURED
            } else if is(leaving) && scene.region_strength == 0.0 {
                solo.cross(ways_out[i])
            } else if is(leaving) {
                solo.escape(course);
                STATUS_ESCAPED
            } else {
                STATUS_EXHAUSTED
            };
            ended.add(course, &functions, &lanes, i, solo, status);
            live &= !(1 << i);
            if ended.is_full() {
                ended.report(simd, course, &functions, &kernels, &mut land);
            }
        }
    }
}

/// The first hits along the pieces of the lanes of `met`, by lane, and where they are. Compiled once for all its callers.
#[inline(never)]
pub(super) fn meet<S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    traverser: &mut Traverser,
    lanes: &Lanes<T>,
    met: u32,
) -> [Option<(Hit, Vec3)>; MAX_LANES] {
    let (view, pieces) = (&course.view, &lanes.next.pieces);
    let mut hits = [None; MAX_LANES];
    // The way of most begins below the root, which has been tested.
    let below = if course.scene.far_root == 0 { met & pieces.root.single } else { 0 };
    traverser.work.nodes += u64::from(below.count_ones());
    let queries = lanes_of(met).map(|i| {
        let (curve, slabs) = pieces.of_lane(i);
        let entry = if below == 0 { None } else { pieces.root.single_child(view, i) };
        let (child, span) = entry.unwrap_or((view.scene_root(lanes.side[i]), (0.0, 1.0)));
        (i, Query { curve, slabs, child, span, t_max: 1.0 })
    });
    let found = |i: usize, curve: &Curve<f32>, hit: Hit| {
        if hit.primitive != NO_INDEX {
            hits[i] = Some((hit, hit_position(curve, hit.t)));
        }
    };
    simd.vectorize(
        #[inline(always)]
        || traverser.closest_hits(simd, view, queries, found),
    );
    hits
}
