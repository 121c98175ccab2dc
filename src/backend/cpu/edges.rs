//! Where steps have to end: the edge of the region, the rim of a lens, the throat of a wormhole, the place where a traced ray stops.

use super::lanes::{Lanes, Row};
use super::step::*;
use crate::backend::Stop;
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::triangle::dot;
use crate::simd::Real;

/// Shortens the steps of the lanes of `outside` that go past the region's edge, by the chord of the distances; returns those lanes.
pub fn beyond_edge<T: Scalar>(course: &Course<T>, lanes: &mut Lanes<T>, outside: u32) -> u32 {
    let center = region_center(course);
    let radius = f64::from(course.scene.region_radius);
    let distance = |v: &[Row<T>; 3], i: usize| (0..3).map(|a| (v[a][i] - center[a]).to_f64().powi(2)).sum::<f64>().sqrt();
    let mut shortened = 0;
    for i in (0..T::WIDTH).filter(|i| outside >> i & 1 == 1) {
        let (before, after) = (distance(&lanes.x, i), distance(&lanes.next.x, i));
        if before < radius && after > radius * (1.0 + EDGE_SLACK) {
            // Aim a little past the edge, so that the next try ends there and not before.
            let share = (radius * (1.0 + 0.5 * EDGE_SLACK) - before) / (after - before);
            lanes.next.h[i] = lanes.h[i] * T::from_f64(share);
            shortened |= 1 << i;
        }
    }
    shortened
}

/// No step goes across the rim, where the gradient of the index jumps: one of `live` that would is taken again, to a little before it, and
/// one that ends there is put on the other side. Returns the lanes that were.
pub fn meet_rim<T: Scalar>(course: &Course<T>, functions: &PointFunctions<T>, lanes: &mut Lanes<T>, live: u32, accepted: &mut u32) -> u32 {
    let model = course.model;
    let rim = model.rim.to_f64();
    let slack = T::RIM_SLACK * rim;
    let mut crossing = 0;
    for i in (0..T::WIDTH).filter(|i| live >> i & 1 == 1) {
        let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
        let from_origin = |x: [T; 3]| [0, 1, 2].map(|axis| (x[axis] - model.origin[axis]).to_f64());
        let length = |v: [f64; 3]| dot(v, v).sqrt();
        let (x, v) = (at(&lanes.next.x), at(&lanes.next.v));
        let there = from_origin(x);
        let (near, far) = (length(from_origin(at(&lanes.x))) - rim, length(there) - rim);
        let velocity = v.map(Real::to_f64);
        let speed = length(velocity);
        let cosine = -near.signum() * dot(there, velocity) / (length(there) * speed);
        if near * far < 0.0 && near.abs() > slack {
            lanes.next.h[i] = lanes.h[i] * T::from_f64((near - 0.5 * near.signum() * slack) / (near - far));
            *accepted &= !(1 << i);
        } else if *accepted >> i & 1 == 1 && near * far > 0.0 && far.abs() <= slack && cosine > 0.0 {
            let jump = (far.abs() + 0.5 * slack) / cosine.max(RIM_COSINE);
            let x = along(x, v, T::from_f64(jump / speed));
            let (v, a) =
                (functions.rate)((), model, x, at(&lanes.next.p), lanes.energy[i], lanes.sense[i], lanes.parameter[i] + lanes.h[i]);
            for axis in 0..3 {
                (lanes.next.x[axis][i], lanes.next.v[axis][i], lanes.next.a[axis][i]) = (x[axis], v[axis], a[axis]);
            }
            lanes.next.travelled[i] = lanes.next.travelled[i] + T::from_f64(jump);
            (lanes.next.room[i], lanes.next.ideal[i]) = (T::from_f64(0.0), T::from_f64(0.0));
            crossing |= 1 << i;
        }
    }
    crossing
}

/// Where a step ends with respect to where the ray is to stop.
pub enum Approach {
    /// Short of it.
    Before,
    /// There.
    Reached,
    /// Past it: the step is to be taken again, shorter.
    Beyond,
}

/// Signed distance of a point of a ray from where it is to stop: negative before it, for a plane on one side of it.
pub fn stop_distance<T: Scalar>(course: &Course<T>, functions: &PointFunctions<T>, x: [T; 3], length: T, parameter: T) -> T {
    let value = |v: f64| T::from_f64(v);
    match course.stop {
        Stop::Never => value(-1.0),
        Stop::Length(s) => length - value(s),
        Stop::Parameter(t) => parameter - value(t),
        Stop::Sphere(radius) => (functions.coordinate_radius)((), course.model, x) - value(radius),
        Stop::Plane(normal, d) => dot(normal.map(value), x) - value(d),
    }
}

/// Judges the accepted step of lane `i` by the stop; a step beyond is shortened to where the chord of the distances says it is, unless it
/// is `crossing` the rim.
#[inline(always)]
pub fn approach_stop<T: Scalar>(
    course: &Course<T>,
    functions: &PointFunctions<T>,
    lanes: &mut Lanes<T>,
    i: usize,
    euler: bool,
    crossing: bool,
) -> Approach {
    let x = [lanes.next.x[0][i], lanes.next.x[1][i], lanes.next.x[2][i]];
    let (length, parameter) = (lanes.length[i] + lanes.next.travelled[i], lanes.parameter[i] + lanes.h[i]);
    let before = lanes.until[i];
    let after = stop_distance(course, functions, x, length, parameter);
    let slack = |x: [T; 3]| 100.0 * T::TOLERANCE_FLOOR * largest_coordinate(x).to_f64().max(course.stop.size());
    let start = [lanes.x[0][i], lanes.x[1][i], lanes.x[2][i]];
    let plane = matches!(course.stop, Stop::Plane(..));
    let armed = if plane { before.to_f64().abs() > slack(start) } else { before.to_f64() < 0.0 };
    if euler && matches!(course.stop, Stop::Length(_)) {
        // A recurrence is not cut: it stops after the step that ends nearest.
        lanes.until[i] = after;
        return if -after.to_f64() < 0.5 * lanes.h[i].to_f64() { Approach::Reached } else { Approach::Before };
    }
    let passed = armed && before.to_f64() * after.to_f64() < 0.0;
    if armed && after.to_f64().abs() <= slack(x) || passed && crossing {
        return Approach::Reached;
    }
    if passed {
        lanes.next.h[i] = lanes.h[i] * (before / (before - after));
        return Approach::Beyond;
    }
    lanes.until[i] = after;
    Approach::Before
}

/// Inverts lane `i`, which came below the throat of a wormhole, to the other side.
pub fn cross_throat<T: Scalar>(course: &Course<T>, functions: &PointFunctions<T>, lanes: &mut Lanes<T>, i: usize) {
    let model = course.model;
    let x = [0, 1, 2].map(|axis| lanes.x[axis][i] - model.origin[axis]);
    let p = [lanes.p[0][i], lanes.p[1][i], lanes.p[2][i]];
    let (x, p) = invert_through(x, p, model.throat);
    let x = [0, 1, 2].map(|axis| x[axis] + model.origin[axis]);
    let (v, a) = (functions.rate)((), model, x, p, lanes.energy[i], lanes.sense[i], lanes.parameter[i]);
    let before = [lanes.v[0][i], lanes.v[1][i], lanes.v[2][i]];
    // Coordinates are stretched differently where the ray comes out; its steps are as long there as here.
    lanes.h[i] = lanes.h[i] * (dot(before, before) / dot(v, v)).sqrt();
    for axis in 0..3 {
        (lanes.x[axis][i], lanes.p[axis][i]) = (x[axis], p[axis]);
        (lanes.v[axis][i], lanes.a[axis][i]) = (v[axis], a[axis]);
    }
    lanes.side[i] ^= 1;
    (lanes.room[i], lanes.ideal[i]) = (T::from_f64(0.0), T::from_f64(0.0));
    lanes.until[i] = stop_distance(course, functions, x, lanes.length[i], lanes.parameter[i]);
}

/// Center of the bending region.
#[inline(always)]
pub fn region_center<T: Scalar>(course: &Course<T>) -> [T; 3] {
    let [x, y, z] = course.scene.region_center;
    [T::from_f64(x.into()), T::from_f64(y.into()), T::from_f64(z.into())]
}
