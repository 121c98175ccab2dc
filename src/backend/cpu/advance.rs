//! Rays from launch to landing: straight ones one by one, curved ones as lanes of a register with finished lanes refilled.

use crate::kernels::bvh::{Hit, TraversalStack, closest_hit, curve_tangent, cut_span, hermite, hit_position, straight};
use crate::kernels::clearance::occupied_span;
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::layout::SceneParameters;
use crate::kernels::path::Arrival;
use crate::kernels::triangle::dot;
use crate::kernels::view::SceneView;
use crate::simd::{Lane, Real, load3};
use fearless_simd::Simd;
use glam::Vec3;

/// Most lanes of any register.
const MAX_LANES: usize = 16;

/// A real number that is also a lane of its own, for the parts of a ray that are handled alone.
pub trait Scalar: Real + Lane<Real = Self, Mask = bool, Token = ()> {
    /// Smallest tolerance as a share of the coordinates.
    const TOLERANCE_FLOOR: f64;
}
impl Scalar for f32 {
    const TOLERANCE_FLOOR: f64 = TOLERANCE_FLOOR_F32;
}
impl Scalar for f64 {
    const TOLERANCE_FLOOR: f64 = TOLERANCE_FLOOR_F64;
}

/// A ray to trace.
#[derive(Clone, Copy)]
pub struct Launch<T> {
    /// Start.
    pub origin: [T; 3],
    /// Unit direction of travel.
    pub direction: [T; 3],
    /// Length of the launch velocity.
    pub speed: T,
    /// Width and growth of its cone.
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
    /// Unit direction, at infinity if escaped.
    pub direction: [T; 3],
    /// Velocity of the model.
    pub velocity: [T; 3],
}

/// What all rays of a batch share.
pub struct Course<'a, T> {
    /// The world.
    pub view: SceneView<'a>,
    /// Parameters, which may differ from the view's for traced rays.
    pub scene: &'a SceneParameters,
    /// The model.
    pub model: &'a ModelBlock<T>,
    /// Coordinate length after which a ray ends.
    pub length: Option<f64>,
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
        let limit = course.length.map_or(FAR, |l| l as f32);
        let status = match flight.cross(simd, course, stack, T::from_f64(f64::from(limit))) {
            Some(status) => status,
            None if course.length.is_some() => STATUS_FLYING,
            None => STATUS_ESCAPED,
        };
        land(index, flight.landing(status, 1.0, 0.0));
    }
}

/// The scalar part of a ray: its place, and what it has met.
struct Solo<T> {
    x: [T; 3],
    d: [T; 3],
    p: [T; 3],
    length: f32,
    steps: u32,
    chords: u32,
    hit: Option<(Hit, Vec3, Vec3)>,
}

impl<T: Scalar> Solo<T> {
    fn new(ray: &Launch<T>) -> Self {
        Solo { x: ray.origin, d: ray.direction, p: ray.direction, length: 0.0, steps: 0, chords: 0, hit: None }
    }

    /// Goes straight for `distance`, or to a hit.
    #[inline(always)]
    fn cross<S: Simd>(&mut self, simd: S, course: &Course<T>, stack: &mut TraversalStack, distance: T) -> Option<u32> {
        let curve = straight(to_vec3(self.x), to_vec3(self.d));
        let mut hit = Hit::none(distance.to_f32());
        self.chords += 1;
        closest_hit(simd, &course.view, &curve, stack, &mut hit);
        if hit.primitive != NO_INDEX {
            self.length += hit.t;
            self.hit = Some((hit, hit_position(&curve, hit.t), curve.c1));
            return Some(STATUS_HIT);
        }
        if distance.to_f32() < FAR {
            self.x = along(self.x, self.d, distance);
            self.length += distance.to_f32();
        }
        None
    }

    fn landing(&self, status: u32, redshift: f32, constraint_error: f32) -> Landing<T> {
        let (hit, position, direction) = match self.hit {
            Some((hit, position, tangent)) => (hit, position, tangent.normalize()),
            None => (Hit::none(0.0), to_vec3(self.x), to_vec3(self.d)),
        };
        let exact = self.hit.is_none();
        let from32 = |v: Vec3| v.to_array().map(|c| T::from_f64(f64::from(c)));
        Landing {
            arrival: Arrival {
                position,
                primitive: hit.primitive,
                direction,
                status,
                u: hit.u,
                v: hit.v,
                path_length: self.length,
                redshift,
                steps: self.steps,
                chords: self.chords,
                constraint_error,
            },
            position: if exact { self.x } else { from32(position) },
            direction: if exact { self.d } else { from32(direction) },
            velocity: self.p,
        }
    }
}

/// Lane storage of the rays in flight.
struct Lanes<T> {
    x: [[T; MAX_LANES]; 3],
    p: [[T; MAX_LANES]; 3],
    a: [[T; MAX_LANES]; 3],
    h: [T; MAX_LANES],
    energy: [T; MAX_LANES],
    width: [T; MAX_LANES],
    spread: [T; MAX_LANES],
    length: [T; MAX_LANES],
    lapse: [T; MAX_LANES],
    index: [usize; MAX_LANES],
    steps: [u32; MAX_LANES],
    chords: [u32; MAX_LANES],
}

impl<T: Scalar> Lanes<T> {
    fn solo(&self, i: usize) -> Solo<T> {
        let p = [self.p[0][i], self.p[1][i], self.p[2][i]];
        let size = dot(p, p).sqrt();
        Solo {
            x: [self.x[0][i], self.x[1][i], self.x[2][i]],
            d: [p[0] / size, p[1] / size, p[2] / size],
            p,
            length: self.length[i].to_f32(),
            steps: self.steps[i],
            chords: self.chords[i],
            hit: None,
        }
    }
}

/// Traces `count` rays through the model `M`, `L::LANES` at a time.
#[inline(always)]
pub fn advance_curved<M: Model, L: Lane<Real = T>, S: Simd, T: Scalar>(
    simd: S,
    token: L::Token,
    course: &Course<T>,
    stack: &mut TraversalStack,
    count: usize,
    launch: impl Fn(usize) -> Launch<T>,
    mut land: impl FnMut(usize, Landing<T>),
) {
    let scene = course.scene;
    let zero = T::from_f64(0.0);
    let euler = scene.method == METHOD_EULER;
    let mut lanes = Lanes {
        x: [[T::from_f64(1e6); MAX_LANES]; 3],
        p: [[T::from_f64(1.0); MAX_LANES]; 3],
        a: [[zero; MAX_LANES]; 3],
        h: [zero; MAX_LANES],
        energy: [T::from_f64(1.0); MAX_LANES],
        width: [T::from_f64(1.0); MAX_LANES],
        spread: [zero; MAX_LANES],
        length: [zero; MAX_LANES],
        lapse: [T::from_f64(1.0); MAX_LANES],
        index: [0; MAX_LANES],
        steps: [0; MAX_LANES],
        chords: [0; MAX_LANES],
    };
    let mut next = 0;
    let mut live = 0u32;
    let center = region_center::<T>(scene);
    let radius = T::from_f64(f64::from(scene.region_radius));
    let limit = course.length.map(T::from_f64);
    loop {
        // Fill the lanes that are free.
        let mut free = !live & ((1u32 << L::LANES) - 1);
        while free != 0 && next < count {
            let lane = free.trailing_zeros() as usize;
            free &= free - 1;
            if refill::<M, S, T>(simd, course, stack, &mut lanes, lane, &mut next, count, &launch, &mut land) {
                live |= 1 << lane;
            }
        }
        if live == 0 {
            return;
        }

        // Step every lane.
        let flight = Flight { x: load3(token, &lanes.x), p: load3(token, &lanes.p), a: load3::<L, MAX_LANES>(token, &lanes.a) };
        let h = L::load(token, &lanes.h);
        let energy = L::load(token, &lanes.energy);
        let length = L::load(token, &lanes.length);
        let cone = L::load(token, &lanes.spread).mul_add(length, L::load(token, &lanes.width));
        let size = flight.x[0].max(-flight.x[0]).max(flight.x[1].max(-flight.x[1])).max(flight.x[2].max(-flight.x[2]));
        let floor = size * L::constant(token, T::TOLERANCE_FLOOR);
        let tolerance = (cone * L::constant(token, f64::from(scene.tolerance))).max(floor);
        let (moved, error) = if euler {
            let kick = if scene.literal_kick == 1 { L::constant(token, 1.0) } else { h };
            (euler_step::<M, L>(token, course.model, energy, &flight, h, kick), L::constant(token, 0.0))
        } else {
            nystrom_step::<M, L>(token, course.model, energy, &flight, h)
        };
        let accepted = L::bits(error.lt(tolerance));

        // Choose the next step length, inside what the model allows at the place it starts from.
        let speed = dot(moved.p, moved.p).sqrt();
        let safe = M::safe_step::<L>(token, course.model, moved.x) / speed;
        let proposed = h * step_factor(token, error, tolerance);
        let next_h = if euler { h } else { proposed.min(safe) };
        let alive = M::capture_distance::<L>(token, course.model, moved.x);
        let captured = L::bits(alive.lt(L::constant(token, 0.0)));
        let from_center =
            [moved.x[0] - L::splat(token, center[0]), moved.x[1] - L::splat(token, center[1]), moved.x[2] - L::splat(token, center[2])];
        let outside = L::both(
            L::splat(token, radius * radius).lt(dot(from_center, from_center)),
            L::constant(token, 0.0).lt(dot(from_center, moved.p)),
        );
        let outside = L::bits(outside);
        // The thesis' steps have the length they are given.
        let travelled = if euler { h } else { arc_length(token, &flight, &moved, h) };

        let mut x1 = [[zero; MAX_LANES]; 3];
        let mut p1 = [[zero; MAX_LANES]; 3];
        let mut a1 = [[zero; MAX_LANES]; 3];
        let [mut h1, mut rejected_h, mut travel, mut cones] = [[zero; MAX_LANES]; 4];
        for axis in 0..3 {
            moved.x[axis].store(&mut x1[axis]);
            moved.p[axis].store(&mut p1[axis]);
            moved.a[axis].store(&mut a1[axis]);
        }
        next_h.store(&mut h1);
        proposed.store(&mut rejected_h);
        travelled.store(&mut travel);
        cone.store(&mut cones);

        // Look for geometry along the accepted steps.
        let mut todo = live;
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            lanes.steps[i] += 1;
            if accepted >> i & 1 == 0 {
                lanes.h[i] = rejected_h[i];
                if lanes.steps[i] >= scene.max_steps {
                    finish::<M, T>(course, &lanes, i, lanes.solo(i), STATUS_EXHAUSTED, &mut land);
                    live &= !(1 << i);
                }
                continue;
            }
            let at = |v: &[[T; MAX_LANES]; 3]| Vec3::new(v[0][i].to_f32(), v[1][i].to_f32(), v[2][i].to_f32());
            let (start, end) = (at(&lanes.x), at(&x1));
            let scale = lanes.h[i].to_f32();
            let (tangent0, tangent1) = if euler { (end - start, end - start) } else { (at(&lanes.p) * scale, at(&p1) * scale) };
            let mut ended = None;
            let mut solo = None;
            let step = hermite(start, end, tangent0, tangent1);
            let span = occupied_span(&course.view, &step);
            if span.x < span.y {
                lanes.chords[i] += 1;
                let curve = cut_span(&step, span.x, span.y, scene.chord_tolerance * cones[i].to_f32());
                let mut hit = Hit::none(1.0);
                closest_hit(simd, &course.view, &curve, stack, &mut hit);
                if hit.primitive != NO_INDEX {
                    let mut landed = lanes.solo(i);
                    landed.length += travel[i].to_f32() * (span.x + (span.y - span.x) * hit.t);
                    landed.hit = Some((hit, hit_position(&curve, hit.t), curve_tangent(&curve, hit.t)));
                    ended = Some(STATUS_HIT);
                    solo = Some(landed);
                }
            }
            for axis in 0..3 {
                lanes.x[axis][i] = x1[axis][i];
                lanes.p[axis][i] = p1[axis][i];
                lanes.a[axis][i] = a1[axis][i];
            }
            lanes.length[i] = lanes.length[i] + travel[i];
            lanes.h[i] = h1[i];

            // See whether the ray is over.
            if ended.is_none() {
                if captured >> i & 1 == 1 {
                    ended = Some(STATUS_CAPTURED);
                } else if outside >> i & 1 == 1 {
                    let mut leaving = lanes.solo(i);
                    ended = Some(leaving.leave(simd, course, stack));
                    solo = Some(leaving);
                } else if lanes.steps[i] >= scene.max_steps {
                    ended = Some(STATUS_EXHAUSTED);
                } else if let Some(limit) = limit {
                    let left = limit - lanes.length[i];
                    let size = dot([p1[0][i], p1[1][i], p1[2][i]], [p1[0][i], p1[1][i], p1[2][i]]).sqrt();
                    let reached = if euler {
                        left.to_f64() < 0.5 * lanes.h[i].to_f64()
                    } else {
                        left.to_f64().abs() <= 100.0 * T::TOLERANCE_FLOOR * limit.to_f64()
                    };
                    if reached {
                        ended = Some(STATUS_FLYING);
                    } else if !euler {
                        // Near the end the rest is stepped exactly, back if the last step went too far.
                        lanes.h[i] = Lane::min(lanes.h[i], left / size);
                    }
                }
            }
            if let Some(status) = ended {
                let solo = solo.unwrap_or_else(|| lanes.solo(i));
                finish::<M, T>(course, &lanes, i, solo, status, &mut land);
                live &= !(1 << i);
            }
        }
    }
}

impl<T: Scalar> Solo<T> {
    /// Leaves the region outward: straight on past whatever is there, or along the asymptote of the far field.
    #[inline(always)]
    fn leave<S: Simd>(&mut self, simd: S, course: &Course<T>, stack: &mut TraversalStack) -> u32 {
        let scene = course.scene;
        if scene.region_strength != 0.0 {
            let center = region_center::<T>(scene);
            let from_center = [self.x[0] - center[0], self.x[1] - center[1], self.x[2] - center[2]];
            self.d = asymptote(from_center, self.d, T::from_f64(f64::from(scene.region_strength)));
            return STATUS_ESCAPED;
        }
        self.cross(simd, course, stack, T::from_f64(f64::from(FAR))).unwrap_or(STATUS_ESCAPED)
    }
}

/// Center of the bending region.
#[inline(always)]
fn region_center<T: Scalar>(scene: &SceneParameters) -> [T; 3] {
    let c = scene.region_center;
    [T::from_f64(f64::from(c[0])), T::from_f64(f64::from(c[1])), T::from_f64(f64::from(c[2]))]
}

/// Reports the end of lane `i`.
#[inline(always)]
fn finish<M: Model, T: Scalar>(
    course: &Course<T>,
    lanes: &Lanes<T>,
    i: usize,
    solo: Solo<T>,
    status: u32,
    land: &mut impl FnMut(usize, Landing<T>),
) {
    let lapse = if status == STATUS_ESCAPED {
        1.0
    } else {
        let end = solo.hit.map_or(solo.x, |(_, position, _)| position.to_array().map(|c| T::from_f64(f64::from(c))));
        M::lapse::<T>((), course.model, end).to_f64()
    };
    let (n, _) = M::medium::<T>((), course.model, [lanes.x[0][i], lanes.x[1][i], lanes.x[2][i]], lanes.energy[i]);
    let size = dot(solo.p, solo.p).sqrt();
    let drift = (size.to_f64() / n.to_f64() - 1.0).abs();
    let redshift = lapse / lanes.lapse[i].to_f64();
    land(lanes.index[i], solo.landing(status, redshift as f32, drift as f32));
}

/// Puts the next ray that has to be integrated into lane `i`; rays that end before are reported. False when none is left.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one loop, split so that it can be read")]
fn refill<M: Model, S: Simd, T: Scalar>(
    simd: S,
    course: &Course<T>,
    stack: &mut TraversalStack,
    lanes: &mut Lanes<T>,
    i: usize,
    next: &mut usize,
    count: usize,
    launch: &impl Fn(usize) -> Launch<T>,
    land: &mut impl FnMut(usize, Landing<T>),
) -> bool {
    let scene = course.scene;
    let center = region_center(scene);
    let radius = T::from_f64(f64::from(scene.region_radius));
    while *next < count {
        let index = *next;
        *next += 1;
        let ray = launch(index);
        let mut solo = Solo::new(&ray);
        let lapse = M::lapse::<T>((), course.model, ray.origin).to_f64();
        let entry = enter_sphere(solo.x, solo.d, center, radius);
        if entry.to_f64() != 0.0 {
            // The ray starts outside: it goes straight to the region, or past it.
            let margin = 1.0 + REGION_MARGIN;
            let distance = if entry.to_f64() < 0.0 { T::from_f64(f64::from(FAR)) } else { T::from_f64(entry.to_f64() * margin) };
            let ended = solo.cross(simd, course, stack, distance);
            let status = if entry.to_f64() < 0.0 { Some(ended.unwrap_or(STATUS_ESCAPED)) } else { ended };
            if let Some(status) = status {
                land(index, solo.landing(status, (1.0 / lapse) as f32, 0.0));
                continue;
            }
        }
        let energy = M::launch_energy::<T>((), course.model, solo.x, ray.speed);
        let (n, gradient) = M::medium::<T>((), course.model, solo.x, energy);
        let a = [gradient[0] * n, gradient[1] * n, gradient[2] * n];
        let safe = M::safe_step::<T>((), course.model, solo.x);
        let mut h = if scene.method == METHOD_EULER { course.model.step } else { first_step((), n, a, safe) };
        if let (Some(limit), false) = (course.length, scene.method == METHOD_EULER) {
            h = Lane::min(h, T::from_f64(limit) / n);
        }
        for (axis, force) in a.into_iter().enumerate() {
            lanes.x[axis][i] = solo.x[axis];
            lanes.p[axis][i] = solo.d[axis] * n;
            lanes.a[axis][i] = force;
        }
        lanes.h[i] = h;
        lanes.energy[i] = energy;
        lanes.width[i] = T::from_f64(f64::from(ray.width));
        lanes.spread[i] = T::from_f64(f64::from(ray.spread));
        lanes.length[i] = T::from_f64(f64::from(solo.length));
        lanes.lapse[i] = T::from_f64(lapse);
        lanes.index[i] = index;
        lanes.steps[i] = 0;
        lanes.chords[i] = solo.chords;
        return true;
    }
    false
}
