//! Closest hit of a straight or curved segment with the scene.
//!
//! A curved segment is a cubic x(s) = start + c1 s + c2 s^2 + c3 s^3, s in [0, 1] (the dense output of one integration step). It is
//! traversed once, as its chord with all boxes extended by how far the curve strays from the chord at equal s, along each axis and to
//! each side by itself: a curve that bends down needs boxes to reach up. So if the curve is inside a box at s, the chord is inside the
//! extended box at the same s. At a leaf the curve is cut into `chords` pieces and only those that overlap the box in s are tested.

use super::constants::*;
use super::integrator::along;
use super::layout::BvhNode;
use super::primitive::intersect_primitive;
use super::triangle::{dot, intersect_triangle};
use super::view::SceneView;
use super::work::Work;
use crate::simd::{Lane, load3, splat3};
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

/// A straight ray (`chords` = 1, c2 = c3 = 0) or a curved step, one or one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Curve<L> {
    /// Start point.
    pub start: [L; 3],
    /// Coefficient of s.
    pub c1: [L; 3],
    /// Coefficient of s^2.
    pub c2: [L; 3],
    /// Coefficient of s^3.
    pub c3: [L; 3],
    /// Pieces the curve is cut into, a whole number.
    pub chords: L,
    /// Distance between the curve and those pieces' chords at equal s that is wanted; more if there may not be so many pieces. Boxes are
    /// extended by it too, so that a flat one has some thickness.
    pub tolerance: L,
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
pub fn straight(origin: Vec3, direction: Vec3) -> Curve<f32> {
    Curve { start: origin.into(), c1: direction.into(), c2: [0.0; 3], c3: [0.0; 3], chords: 1.0, tolerance: 0.0 }
}

/// The cubic with end points `start` and `end` and end tangents `tangent0` and `tangent1` (derivatives by s), not cut yet.
#[inline(always)]
pub fn hermite<L: Lane>(token: L::Token, start: [L; 3], end: [L; 3], tangent0: [L; 3], tangent1: [L; 3]) -> Curve<L> {
    let (two, three) = (L::constant(token, 2.0), L::constant(token, 3.0));
    let mut curve =
        Curve { start, c1: tangent0, c2: start, c3: start, chords: L::constant(token, 1.0), tolerance: L::constant(token, 0.0) };
    for i in 0..3 {
        let chord = end[i] - start[i];
        curve.c2[i] = chord * three - tangent0[i] * two - tangent1[i];
        curve.c3[i] = tangent0[i] + tangent1[i] - chord * two;
    }
    curve
}

/// Point of the curve at parameter `s`.
#[inline(always)]
pub fn curve_point<L: Lane>(curve: &Curve<L>, s: L) -> [L; 3] {
    along(curve.start, along(curve.c1, along(curve.c2, curve.c3, s), s), s)
}

/// Derivative of the curve at parameter `s`.
#[inline(always)]
pub fn curve_tangent<L: Lane>(token: L::Token, curve: &Curve<L>, s: L) -> [L; 3] {
    let [x, y, z] = curve.c2;
    let twice = [x + x, y + y, z + z];
    along(curve.c1, along(twice, curve.c3, s * L::constant(token, 3.0)), s)
}

/// From the start of the curve to its end.
#[inline(always)]
pub fn whole_chord<L: Lane>(curve: &Curve<L>) -> [L; 3] {
    let Curve { c1, c2, c3, .. } = curve;
    [c1[0] + c2[0] + c3[0], c1[1] + c2[1] + c3[1], c1[2] + c2[2] + c3[2]]
}

/// The part of the curve from `from` to `to`, cut so that no chord strays from it by more than `tolerance`, into `MAX_CHORDS` at most.
#[inline(always)]
pub fn cut_span<L: Lane>(token: L::Token, curve: &Curve<L>, from: L, to: L, tolerance: L) -> Curve<L> {
    let (one, three) = (L::constant(token, 1.0), L::constant(token, 3.0));
    let w = to - from;
    let (mut c1, mut c2, mut c3) = (curve_tangent(token, curve, from), along(curve.c2, curve.c3, from * three), curve.c3);
    for i in 0..3 {
        c1[i] = c1[i] * w;
        c2[i] = c2[i] * (w * w);
        c3[i] = c3[i] * (w * w * w);
    }
    let c2_end = along(c2, c3, three);
    // The sagitta of a chord is an eighth of the largest second derivative.
    let sagitta = dot(c2, c2).max(dot(c2_end, c2_end)).sqrt() * L::constant(token, 0.25);
    let chords = -(-(sagitta / tolerance).sqrt()).floor();
    let chords = chords.max(one).min(L::constant(token, f64::from(MAX_CHORDS)));
    Curve { start: curve_point(curve, from), c1, c2, c3, chords, tolerance }
}

/// Point where the chords of the curve were hit at parameter `t`.
#[inline(always)]
pub fn hit_position(curve: &Curve<f32>, t: f32) -> Vec3 {
    if curve.chords == 1.0 {
        return Vec3::from(curve.start) + Vec3::from(whole_chord(curve)) * t;
    }
    let count = curve.chords;
    let j = (t * count).floor().min(count - 1.0);
    let from = Vec3::from(curve_point(curve, j / count));
    let to = Vec3::from(curve_point(curve, (j + 1.0) / count));
    from + (to - from) * (t * count - j)
}

/// How far the curve strays from its chord at equal s, down and up along each axis. The difference is -s (1 - s) (c2 + c3 (1 + s)).
#[inline(always)]
pub fn deviation<L: Lane>(token: L::Token, curve: &Curve<L>) -> ([L; 3], [L; 3]) {
    let (zero, two, quarter) = (L::constant(token, 0.0), L::constant(token, 2.0), L::constant(token, 0.25));
    let (mut down, mut up) = (curve.c2, curve.c2);
    for i in 0..3 {
        let first = curve.c2[i] + curve.c3[i];
        let last = curve.c3[i].mul_add(two, curve.c2[i]);
        down[i] = first.max(last).max(zero).mul_add(quarter, curve.tolerance);
        up[i] = (-first.min(last)).max(zero).mul_add(quarter, curve.tolerance);
    }
    (down, up)
}

/// A chord prepared for slab tests against boxes that are extended by how far the curve strays, one or one per lane.
///
/// A plane is met at plane * inverse + offset: one operation where (plane - origin) * inverse takes two. The offsets are widened by
/// their rounding error, so that no box is lost.
#[derive(Clone, Copy, Debug)]
pub struct Slabs<L> {
    /// Reciprocal of the chord.
    pub inverse: [L; 3],
    /// Offsets of the planes that are met first.
    pub near: [L; 3],
    /// Offsets of the planes that are met last.
    pub far: [L; 3],
}

/// Prepares the chord of `curve`.
#[inline(always)]
pub fn slabs<L: Lane>(token: L::Token, curve: &Curve<L>) -> Slabs<L> {
    let chord = whole_chord(curve);
    let smallest = L::constant(token, f64::from(MIN_DIRECTION));
    let rounding = L::constant(token, f64::from(BOX_ROUNDING));
    let (down, up) = deviation(token, curve);
    let mut slabs = Slabs { inverse: chord, near: chord, far: chord };
    for (i, c) in chord.into_iter().enumerate() {
        let size = L::constant(token, 1.0) / c.max(-c).max(smallest);
        let (origin, backward) = (curve.start[i], c.lt(L::constant(token, 0.0)));
        slabs.inverse[i] = L::select(backward, -size, size);
        let middle = -(origin * slabs.inverse[i]);
        let slack = (origin.max(-origin) + (down[i] + up[i])) * rounding;
        slabs.near[i] = middle - (L::select(backward, down[i], up[i]) + slack) * size;
        slabs.far[i] = middle + (L::select(backward, up[i], down[i]) + slack) * size;
    }
    slabs
}

/// Lanes whose chord may meet a child of the scene's root.
#[inline(always)]
pub fn meets_root<L: Lane>(token: L::Token, view: &SceneView, slabs: &Slabs<L>) -> u32 {
    let root = view.node(view.scene_root(0));
    let mut met = 0;
    for lane in (0..8).take_while(
        #[inline(always)]
        |&lane| root.child[lane] != NO_INDEX,
    ) {
        let (mut near, mut far) = (L::constant(token, 0.0), L::constant(token, 1.0));
        for axis in 0..3 {
            let low = L::constant(token, f64::from(root.bounds[2 * axis][lane])) * slabs.inverse[axis];
            let high = L::constant(token, f64::from(root.bounds[2 * axis + 1][lane])) * slabs.inverse[axis];
            near = near.max(low.min(high) + slabs.near[axis]);
            far = far.min(low.max(high) + slabs.far[axis]);
        }
        met |= !L::bits((far * L::constant(token, BOX_SLACK)).lt(near));
    }
    met
}

/// What the end of an interval is multiplied with before it is compared with the start.
const BOX_SLACK: f64 = 1.0 + BOX_ROUNDING as f64;

/// Parameters at which the extended boxes of a node's children are entered (left), and the mask of those met before `t_max`.
#[inline(always)]
fn intersect_node<S: Simd>(simd: S, node: &BvhNode, ray: &SlabRay<S>, t_max: f32) -> ([f32; 8], [f32; 8], u32) {
    let mut near = <f32x8<S> as Lane>::splat(simd, 0.0);
    let mut far = <f32x8<S> as Lane>::splat(simd, t_max);
    for axis in 0..3 {
        let entry = <f32x8<S> as Lane>::load(simd, &node.bounds[ray.near_plane[axis]]);
        let exit = <f32x8<S> as Lane>::load(simd, &node.bounds[ray.near_plane[axis] ^ 1]);
        near = Lane::max(near, Lane::mul_add(entry, ray.slabs.inverse[axis], ray.slabs.near[axis]));
        far = Lane::min(far, Lane::mul_add(exit, ray.slabs.inverse[axis], ray.slabs.far[axis]));
    }
    let slack = <f32x8<S> as Lane>::constant(simd, BOX_SLACK);
    let missed = <f32x8<S> as Lane>::bits((far * slack).lt(near));
    let mut nears = [0.0; 8];
    let mut fars = [0.0; 8];
    near.store(&mut nears);
    far.store(&mut fars);
    (nears, fars, !missed & 0xff)
}

/// Slabs in every lane, and the plane of each axis that is met first.
struct SlabRay<S: Simd> {
    near_plane: [usize; 3],
    slabs: Slabs<f32x8<S>>,
}

impl<S: Simd> SlabRay<S> {
    #[inline(always)]
    fn new(simd: S, slabs: &Slabs<f32>) -> Self {
        let Slabs { inverse, near, far } = *slabs;
        let near_plane = [usize::from(inverse[0] < 0.0), 2 + usize::from(inverse[1] < 0.0), 4 + usize::from(inverse[2] < 0.0)];
        SlabRay { near_plane, slabs: Slabs { inverse: splat3(simd, inverse), near: splat3(simd, near), far: splat3(simd, far) } }
    }
}

/// Scratch space of traversals, and what they have done.
pub struct TraversalStack {
    /// Children waiting to be visited: what, and the interval of the curve parameter in which its box is met.
    waiting: [(u32, f32, f32); STACK_SIZE as usize],
    /// What was done with this stack.
    pub work: Work,
}

/// Entries are counted modulo the size, which is a power of two: an index that cannot be out of range needs no check.
const TOP: usize = STACK_SIZE as usize - 1;
const _: () = assert!(STACK_SIZE.is_power_of_two());

/// An empty stack; its first entry is the sentinel that ends a traversal.
pub const EMPTY_STACK: TraversalStack =
    TraversalStack { waiting: [(NO_INDEX, 0.0, 0.0); STACK_SIZE as usize], work: Work::from_counts([0; 6]) };

/// Finds the closest hit of `curve`, whose chord is prepared as `slabs`, before `hit.t`, on one side of a wormhole. For a curved step
/// `hit.t` starts at 1.
///
/// `stack` is scratch space, [`EMPTY_STACK`] at first; the caller keeps it because clearing it costs as much as a short ray.
#[inline(always)]
pub fn closest_hit<S: Simd>(
    simd: S,
    view: &SceneView,
    curve: &Curve<f32>,
    slabs: &Slabs<f32>,
    side: u32,
    stack: &mut TraversalStack,
    hit: &mut Hit,
) {
    let TraversalStack { waiting: stack, work } = stack;
    work.chords += 1;
    let ray = SlabRay::new(simd, slabs);
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
                    while at > bottom && stack[(at - 1) & TOP].1 < entry.1 {
                        stack[at & TOP] = stack[(at - 1) & TOP];
                        at -= 1;
                    }
                    stack[at & TOP] = entry;
                    view.prefetch(entry.0);
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
            (child, enter, exit) = stack[top & TOP];
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
fn intersect_leaf<S: Simd>(simd: S, view: &SceneView, curve: &Curve<f32>, child: u32, enter: f32, exit: f32, hit: &mut Hit) -> u64 {
    let count = curve.chords;
    if count == 1.0 {
        intersect_chord(simd, view, child, curve.start.into(), whole_chord(curve).into(), 0.0, 1.0, hit.t, hit);
        return 1;
    }
    let first = (enter * count).floor().clamp(0.0, count - 1.0);
    let last = (exit.min(hit.t) * count).floor().clamp(0.0, count - 1.0);
    let mut j = first;
    let mut from = Vec3::from(curve_point(curve, j / count));
    let mut tested = 0;
    while j <= last {
        tested += 1;
        let to = Vec3::from(curve_point(curve, (j + 1.0) / count));
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
