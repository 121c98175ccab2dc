//! Rays before their first step: a register of them is taken to the bending region and launched at once.

use super::advance::{Landing, Launch, meet};
use super::edges::{region_center, stop_distance};
use super::lanes::{Lanes, Row, lanes_of};
use super::solo::{Observed, Solo};
use super::step::*;
use crate::backend::Stop;
use crate::kernels::bvh::Hit;
use crate::kernels::clearance::{grid_curve, occupied_span};
use crate::kernels::constants::*;
use crate::kernels::curve::Curve;
use crate::kernels::integrator::*;
use crate::kernels::traverser::Traverser;
use crate::simd::{Lane, MAX_LANES, load3, splat3, store3};
use fearless_simd::Simd;

/// Rays that were launched together and wait for lanes that are free.
pub struct Waiting<T> {
    /// Where they start.
    pub lanes: Lanes<T>,
    /// Lanes whose ray waits, as bits.
    pub ready: u32,
    /// The ray to be launched next.
    next: usize,
}

impl<T: Scalar> Waiting<T> {
    /// None is launched yet.
    pub fn none() -> Self {
        Waiting { lanes: Lanes::idle(), ready: 0, next: 0 }
    }

    /// Launches the next rays that have to be integrated; rays that end before are reported. False when none is left.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "the state of one loop, split so that it can be read")]
    pub fn fill<S: Simd>(
        &mut self,
        simd: S,
        course: &Course<T>,
        functions: &PointFunctions<T>,
        kernels: &ModelKernels<S, T>,
        traverser: &mut Traverser,
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
            self.approach::<T::Register<S>, S>(simd, course, traverser, land);
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
        traverser: &mut Traverser,
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
        let curve = Curve { start: x, c1: across, c2: [zero; 3], c3: [zero; 3], chords: L::constant(simd, 1.0) };
        let (from, to, end_room) = occupied_span(simd, &course.view, &grid_curve(simd, &course.view, &curve), zero, entering);
        L::select(zero.lt(entry), end_room, zero).store(&mut lanes.room);
        let occupied = L::bits(from.lt(to)) & entering;
        let mut met = 0;
        if occupied != 0 {
            // Any width but 0: a straight way is its own chord.
            let cone = L::constant(simd, 1.0);
            met = occupied & prepare_pieces(simd, course, &curve, (from, to), cone, &mut lanes.next.pieces);
            traverser.work.pass_root(occupied & !met);
        }
        from.store(&mut lanes.next.from);
        to.store(&mut lanes.next.to);
        way.store(&mut lanes.length);
        let starting = |lanes: &Lanes<T>, i: usize| {
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            Solo::new(at(&lanes.x), at(&lanes.p), lanes.side[i])
        };
        let mut ways_past = [Hit::none(FAR); MAX_LANES];
        let ways = lanes_of(passing).map(|i| (i, starting(lanes, i).straight_on(&course.view)));
        traverser.closest_hits(simd, &course.view, ways, |i, _, hit| ways_past[i] = hit);
        let hits = meet(simd, course, traverser, lanes, met);
        for i in lanes_of(met | passing) {
            let mut solo = starting(lanes, i);
            let status = if passing >> i & 1 == 1 {
                solo.cross(ways_past[i])
            } else if let Some(hit) = hits[i] {
                (solo.length, solo.chords, solo.hit) = (lanes.length[i] * lanes.share(i, hit.0.t), 1, Some(hit));
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
