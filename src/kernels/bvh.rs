//! Closest hit of a straight or curved segment with the scene.
//!
//! A curved segment is a cubic x(s) = start + c1 s + c2 s^2 + c3 s^3, s in [0, 1] (the dense output of one integration step). It is
//! traversed once, as its chord with all boxes inflated by the largest distance between curve and chord at equal s; so
//! if the curve is inside a box at s, the chord is inside the inflated box at the same s. At a leaf the curve is cut into `chords`
//! pieces and only those that overlap the box in s are tested.

use super::constants::*;
use super::layout::BvhNode;
use super::primitive::intersect_primitive;
use super::triangle::intersect_triangle;
use super::view::SceneView;
use super::work::Work;
use crate::simd::{Lane, load3, splat3};
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

/// A straight ray (`chords` = 1, c2 = c3 = 0) or a curved step.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    /// Start point.
    pub start: Vec3,
    /// Coefficient of s.
    pub c1: Vec3,
    /// Coefficient of s^2.
    pub c2: Vec3,
    /// Coefficient of s^3.
    pub c3: Vec3,
    /// Pieces the curve is cut into.
    pub chords: u32,
    /// Largest distance between curve and chord at equal s, plus the chord tolerance.
    pub inflation: f32,
}

/// The closest meeting point so far.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Curve parameter; only closer hits are taken.
    pub t: f32,
    /// `HIT_PRIMITIVE` | primitive, or 8 * block + lane, or `NO_INDEX`.
    pub primitive: u32,
    /// Barycentric or surface coordinate.
    pub u: f32,
    /// Barycentric or surface coordinate.
    pub v: f32,
}

impl Hit {
    /// No hit before parameter `t_max`.
    #[inline(always)]
    pub fn none(t_max: f32) -> Self {
        Hit { t: t_max, primitive: NO_INDEX, u: 0.0, v: 0.0 }
    }
}

/// The straight ray origin + s direction.
#[inline(always)]
pub fn straight(origin: Vec3, direction: Vec3) -> Curve {
    Curve { start: origin, c1: direction, c2: Vec3::ZERO, c3: Vec3::ZERO, chords: 1, inflation: 0.0 }
}

/// The cubic with end points `start` and `end` and end tangents `tangent0` and `tangent1` (derivatives by s), not cut yet.
#[inline(always)]
pub fn hermite(start: Vec3, end: Vec3, tangent0: Vec3, tangent1: Vec3) -> Curve {
    let chord = end - start;
    let c2 = chord * 3.0 - tangent0 * 2.0 - tangent1;
    let c3 = tangent0 + tangent1 - chord * 2.0;
    Curve { start, c1: tangent0, c2, c3, chords: 1, inflation: 0.0 }
}

/// Point of the curve at parameter `s`.
#[inline(always)]
pub fn curve_point(curve: &Curve, s: f32) -> Vec3 {
    curve.start + (curve.c1 + (curve.c2 + curve.c3 * s) * s) * s
}

/// Derivative of the curve at parameter `s`.
#[inline(always)]
pub fn curve_tangent(curve: &Curve, s: f32) -> Vec3 {
    curve.c1 + (curve.c2 * 2.0 + curve.c3 * (3.0 * s)) * s
}

/// The part of the curve from `from` to `to`, cut so that no chord strays from it by more than `tolerance`.
#[inline(always)]
pub fn cut_span(curve: &Curve, from: f32, to: f32, tolerance: f32) -> Curve {
    let w = to - from;
    let c1 = curve_tangent(curve, from) * w;
    let c2 = (curve.c2 + curve.c3 * (3.0 * from)) * (w * w);
    let c3 = curve.c3 * (w * w * w);
    let bend = c2.length_squared().max((c2 + c3 * 3.0).length_squared()).sqrt() * 2.0;
    let chords = (bend / (8.0 * tolerance)).sqrt().ceil().clamp(1.0, MAX_CHORDS as f32);
    let deviation = 0.25 * (c2 + c3).length_squared().max((c2 + c3 * 2.0).length_squared()).sqrt();
    Curve { start: curve_point(curve, from), c1, c2, c3, chords: chords as u32, inflation: deviation + tolerance }
}

/// Point where the chords of the curve were hit at parameter `t`.
#[inline(always)]
pub fn hit_position(curve: &Curve, t: f32) -> Vec3 {
    if curve.chords == 1 {
        return curve.start + (curve.c1 + curve.c2 + curve.c3) * t;
    }
    let count = curve.chords as f32;
    let j = (t * count).floor().min(count - 1.0);
    let from = curve_point(curve, j / count);
    let to = curve_point(curve, (j + 1.0) / count);
    from + (to - from) * (t * count - j)
}

/// Parameters at which the inflated boxes of a node's children are entered (left), and the mask of those met before `t_max`.
#[inline(always)]
fn intersect_node<S: Simd>(simd: S, node: &BvhNode, ray: &SlabRay<S>, t_max: f32) -> ([f32; 8], [f32; 8], u32) {
    let mut near = <f32x8<S> as Lane>::splat(simd, 0.0);
    let mut far = <f32x8<S> as Lane>::splat(simd, t_max);
    for axis in 0..3 {
        let entry = <f32x8<S> as Lane>::load(simd, &node.bounds[ray.near_plane[axis]]);
        let exit = <f32x8<S> as Lane>::load(simd, &node.bounds[ray.near_plane[axis] ^ 1]);
        near = Lane::max(near, Lane::mul_add(entry, ray.inverse[axis], ray.near_offset[axis]));
        far = Lane::min(far, Lane::mul_add(exit, ray.inverse[axis], ray.far_offset[axis]));
    }
    // Rounding must not lose a box that is grazed.
    let slack = <f32x8<S> as Lane>::splat(simd, 1.0 + 4.0 * f32::EPSILON);
    let missed = <f32x8<S> as Lane>::bits((far * slack).lt(near));
    let mut nears = [0.0; 8];
    let mut fars = [0.0; 8];
    near.store(&mut nears);
    far.store(&mut fars);
    (nears, fars, !missed & 0xff)
}

/// A chord prepared for slab tests against inflated boxes.
///
/// A plane is met at plane * inverse + offset: one operation where (plane - origin) * inverse takes two. The offsets are widened by
/// their rounding error, so that no box is lost.
struct SlabRay<S: Simd> {
    near_plane: [usize; 3],
    near_offset: [f32x8<S>; 3],
    far_offset: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
}

impl<S: Simd> SlabRay<S> {
    #[inline(always)]
    fn new(simd: S, origin: Vec3, direction: Vec3, inflation: f32) -> Self {
        let mut near_plane = [0; 3];
        let mut near = [0.0; 3];
        let mut far = [0.0; 3];
        let mut inverse = [0.0; 3];
        for axis in 0..3 {
            let d = direction[axis];
            let forward = d >= 0.0;
            near_plane[axis] = 2 * axis + !forward as usize;
            let outward = if forward { inflation } else { -inflation };
            let size = d.abs().max(MIN_DIRECTION);
            inverse[axis] = 1.0 / if forward { size } else { -size };
            let slack = 4.0 * f32::EPSILON * ((origin[axis].abs() + inflation) * inverse[axis]).abs();
            near[axis] = -(origin[axis] + outward) * inverse[axis] - slack;
            far[axis] = -(origin[axis] - outward) * inverse[axis] + slack;
        }
        SlabRay { near_plane, near_offset: splat3(simd, near), far_offset: splat3(simd, far), inverse: splat3(simd, inverse) }
    }
}

/// Scratch space of traversals, and what they have done.
pub struct TraversalStack {
    /// Children waiting to be visited: what, and the interval of the curve parameter in which its box is met.
    waiting: [(u32, f32, f32); STACK_SIZE as usize],
    /// What was done with this stack.
    pub work: Work,
}

/// An empty stack; its first entry is the sentinel that ends a traversal.
pub const EMPTY_STACK: TraversalStack =
    TraversalStack { waiting: [(NO_INDEX, 0.0, 0.0); STACK_SIZE as usize], work: Work::from_counts([0; 6]) };

/// Finds the closest hit of `curve` before `hit.t`, on one side of a wormhole. For a curved step `hit.t` starts at 1.
///
/// `stack` is scratch space, [`EMPTY_STACK`] at first; the caller keeps it because clearing it costs as much as a short ray.
#[inline(always)]
pub fn closest_hit<S: Simd>(simd: S, view: &SceneView, curve: &Curve, side: u32, stack: &mut TraversalStack, hit: &mut Hit) {
    let TraversalStack { waiting: stack, work } = stack;
    work.chords += 1;
    let chord = curve.c1 + curve.c2 + curve.c3;
    let ray = SlabRay::new(simd, curve.start, chord, curve.inflation);
    let mut top = 1;
    let mut child = view.scene_root(side);
    let mut enter = 0.0f32;
    let mut exit = hit.t;
    loop {
        if child < CHILD_PRIMITIVE {
            work.nodes += 1;
            let (nears, fars, mut mask) = intersect_node(simd, view.node(child), &ray, hit.t);
            if mask != 0 {
                let node = view.node(child);
                let first = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let mut nearest = (node.child[first], nears[first], fars[first]);
                // Keep the nearest child in hand, the others on the stack with the nearest on top.
                let bottom = top;
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let mut entry = (node.child[lane], nears[lane], fars[lane]);
                    if entry.1 < nearest.1 {
                        std::mem::swap(&mut entry, &mut nearest);
                    }
                    let mut at = top;
                    while at > bottom && stack[at - 1].1 < entry.1 {
                        stack[at] = stack[at - 1];
                        at -= 1;
                    }
                    stack[at] = entry;
                    top += 1;
                }
                (child, enter, exit) = nearest;
                continue;
            }
        } else {
            let tested = intersect_leaf(simd, view, curve, child, enter, exit, hit);
            if child & CHILD_BLOCK == 0 {
                work.primitives += tested;
            } else {
                work.blocks += tested;
            }
        }
        // Take the nearest waiting child that still may hold a closer hit.
        loop {
            top -= 1;
            (child, enter, exit) = stack[top];
            if child == NO_INDEX {
                return;
            }
            if enter <= hit.t {
                break;
            }
        }
    }
}

/// Tests the chords of `curve` that overlap [enter, exit] against what the leaf holds; returns how many it tested.
#[inline(always)]
fn intersect_leaf<S: Simd>(simd: S, view: &SceneView, curve: &Curve, child: u32, enter: f32, exit: f32, hit: &mut Hit) -> u64 {
    if curve.chords == 1 {
        let direction = curve.c1 + curve.c2 + curve.c3;
        intersect_chord(simd, view, child, curve.start, direction, 0.0, 1.0, hit.t, hit);
        return 1;
    }
    let count = curve.chords as f32;
    let first = (enter * count).floor().clamp(0.0, count - 1.0);
    let last = (exit.min(hit.t) * count).floor().clamp(0.0, count - 1.0);
    let mut j = first;
    let mut from = curve_point(curve, j / count);
    let mut tested = 0;
    while j <= last {
        tested += 1;
        let to = curve_point(curve, (j + 1.0) / count);
        let t_max = (hit.t * count - j).min(1.0 + CHORD_SLACK);
        if intersect_chord(simd, view, child, from, to - from, j, count, t_max, hit) {
            break;
        }
        from = to;
        j += 1.0;
    }
    tested
}

/// Tests one chord, number `j` of `count`; returns whether it hit.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one call site per traversal; a struct would only rename them")]
fn intersect_chord<S: Simd>(
    simd: S,
    view: &SceneView,
    child: u32,
    origin: Vec3,
    direction: Vec3,
    j: f32,
    count: f32,
    t_max: f32,
    hit: &mut Hit,
) -> bool {
    let index = child & CHILD_INDEX;
    if child & CHILD_BLOCK == 0 {
        let found = intersect_primitive(view.primitive(index), origin, direction, t_max);
        if found.x > 0.0 {
            *hit = Hit { t: (j + found.x) / count, primitive: HIT_PRIMITIVE | index, u: found.y, v: found.z };
            return true;
        }
        return false;
    }
    let block = view.block(index);
    let found = intersect_triangle::<f32x8<S>>(
        simd,
        splat3(simd, origin.to_array()),
        splat3(simd, direction.to_array()),
        load3(simd, &block.vertex),
        load3(simd, &block.edge1),
        load3(simd, &block.edge2),
        Lane::splat(simd, t_max),
    );
    let mut mask = <f32x8<S> as Lane>::bits(found.mask);
    if mask == 0 {
        return false;
    }
    let [mut t, mut u, mut v] = [[0.0; 8]; 3];
    found.t.store(&mut t);
    found.u.store(&mut u);
    found.v.store(&mut v);
    let mut best = mask.trailing_zeros() as usize;
    mask &= mask - 1;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        if t[lane] < t[best] {
            best = lane;
        }
    }
    *hit = Hit { t: (j + t[best]) / count, primitive: 8 * index + best as u32, u: u[best], v: v[best] };
    true
}
