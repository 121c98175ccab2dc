//! A ray alone: on its straight ways, and at its end.

use super::advance::Landing;
use super::edges::region_center;
use super::lanes::{Lanes, Row};
use super::step::*;
use crate::kernels::bvh::Hit;
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::surface::Arrival;
use crate::kernels::traverser::Query;
use crate::kernels::triangle::dot;
use crate::kernels::view::SceneView;
use glam::Vec3;

/// The scalar part of a ray: its place, and what it has met.
pub struct Solo<T> {
    /// Position.
    x: [T; 3],
    /// Coordinate direction while straight, else unit velocity.
    d: [T; 3],
    /// Momentum.
    pub p: [T; 3],
    /// The model's parameter.
    pub parameter: T,
    /// Coordinate length.
    pub length: T,
    /// Steps of the integration.
    steps: u32,
    /// Chords that were handed to the BVH.
    pub chords: u32,
    /// Side of a wormhole: 0 or 1.
    side: u32,
    /// What it met, and where.
    pub hit: Option<(Hit, Vec3)>,
}

/// What the local observer sees of a ray's end.
pub struct Observed<T> {
    /// Unit direction of travel, if it is not that of the coordinates.
    pub direction: Option<[T; 3]>,
    /// Frequency at the start over that at the end.
    pub redshift: f32,
    /// Relative drift of the conserved Hamiltonian.
    pub constraint_error: f32,
    /// Diagonal and mixed entries of the local frame.
    pub frame: [[f32; 3]; 2],
    /// Frequency at the end over that which orbiting matter there emits.
    pub doppler: f32,
}

impl<T> Observed<T> {
    /// In flat space.
    #[inline(always)]
    pub fn flat() -> Self {
        Observed { direction: None, redshift: 1.0, constraint_error: 0.0, frame: [[1.0; 3], [0.0; 3]], doppler: 1.0 }
    }
}

impl<T: Scalar> Solo<T> {
    /// A ray that starts.
    #[inline(always)]
    pub fn new(x: [T; 3], d: [T; 3], side: u32) -> Self {
        let zero = T::from_f64(0.0);
        Solo { x, d, p: d, parameter: zero, length: zero, steps: 0, chords: 0, side, hit: None }
    }

    /// Lane `i` at the start of its step.
    #[inline(always)]
    pub fn of_lane(lanes: &Lanes<T>, i: usize) -> Self {
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

    /// Lane `i` where the piece of its step met a surface: momentum from the cubic through both ends.
    #[inline(always)]
    pub fn at_hit(lanes: &Lanes<T>, i: usize, hit: (Hit, Vec3)) -> Self {
        let mut solo = Self::of_lane(lanes, i);
        let (h, s) = (lanes.h[i], lanes.share(i, hit.0.t));
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

    /// Its straight way from here on, to be looked up.
    #[inline(always)]
    pub fn straight_on(&self, view: &SceneView) -> Query {
        Query::straight(to_vec3(self.x), to_vec3(self.d), view.scene_root(self.side))
    }

    /// Goes straight to a hit, or away if there is none; returns how it ends.
    #[inline(always)]
    pub fn cross(&mut self, hit: Hit) -> u32 {
        self.chords += 1;
        if hit.primitive == NO_INDEX {
            return STATUS_ESCAPED;
        }
        self.length = self.length + T::from_f64(f64::from(hit.t));
        self.hit = Some((hit, to_vec3(self.x) + to_vec3(self.d) * hit.t));
        STATUS_HIT
    }

    /// Where the ray ended.
    #[inline(always)]
    pub fn end(&self) -> [T; 3] {
        self.hit.map_or(self.x, |(_, position)| from_vec3(position))
    }

    /// Leaves a region around which nothing is: along the asymptote of the far field.
    #[inline(always)]
    pub fn escape(&mut self, course: &Course<T>) {
        let center = region_center::<T>(course);
        let from_center = [self.x[0] - center[0], self.x[1] - center[1], self.x[2] - center[2]];
        self.d = asymptote(from_center, self.d, T::from_f64(f64::from(course.scene.region_strength)));
    }

    /// The ray as it ended.
    #[inline(always)]
    pub fn landing(&self, status: u32, observed: &Observed<T>) -> Landing<T> {
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
