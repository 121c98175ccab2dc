//! What segments meet in the BVH: boxes of nodes, and what leaves hold; `traverser` follows them through it.
//!
//! A curved segment is traversed once, as its whole chord with all boxes extended by how far the chords of its pieces stray from that at
//! equal s, along each axis and to each side by itself: a curve that bends down needs boxes to reach up. So if one of them is inside a box
//! at s, the whole chord is inside the extended box at the same s. At a leaf only those that overlap the box in s are tested.

use super::constants::*;
use super::curve::{Curve, curve_point, deviation, whole_chord};
use super::layout::BvhNode;
use super::primitive::intersect_primitive;
use super::triangle::intersect_triangle;
use super::view::SceneView;
use crate::simd::{Lane, MAX_LANES, Real, load3, splat3};
use bytemuck::Zeroable;
use fearless_simd::{Simd, SimdBase, SimdMask as _, SimdSplit as _, f32x8, mask32x8};
use glam::Vec3;
use std::hint::select_unpredictable;

/// The closest meeting point so far.
#[derive(Clone, Copy, Debug, Zeroable)]
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

/// The whole chord of a curve, prepared for slab tests against boxes that are extended by how far its pieces stray from it, one or one per
/// lane.
///
/// A plane is met at plane * inverse + offset: one operation where (plane - origin) * inverse takes two. The offsets are widened by
/// their rounding error, so that no box is lost.
#[derive(Clone, Copy, Debug, Zeroable)]
pub struct Slabs<L> {
    /// Reciprocal of the chord.
    pub inverse: [L; 3],
    /// Offsets of the planes that are met first.
    pub near: [L; 3],
    /// Offsets of the planes that are met last.
    pub far: [L; 3],
}

/// Prepares the whole chord of `curve`.
#[inline(always)]
pub fn slabs<L: Lane>(token: L::Token, curve: &Curve<L>) -> Slabs<L> {
    let chord = whole_chord(curve);
    let smallest = L::constant(token, f64::from(MIN_DIRECTION));
    let rounding = L::constant(token, f64::from(BOX_ROUNDING));
    // Of pieces the ends are rounded too.
    let rounding_of_ends = L::select(L::constant(token, 1.0).lt(curve.chords), rounding, L::constant(token, 0.0));
    let (down, up) = deviation(token, curve);
    let mut slabs = Slabs { inverse: chord, near: chord, far: chord };
    for (i, c) in chord.into_iter().enumerate() {
        let reach = c.max(-c);
        let size = L::constant(token, 1.0) / reach.max(smallest);
        let (origin, backward) = (curve.start[i], c.lt(L::constant(token, 0.0)));
        slabs.inverse[i] = L::select(backward, -size, size);
        let middle = -(origin * slabs.inverse[i]);
        let slack = (origin.max(-origin) + (down[i] + up[i])) * rounding + reach * rounding_of_ends;
        slabs.near[i] = middle - (L::select(backward, down[i], up[i]) + slack) * size;
        slabs.far[i] = middle + (L::select(backward, up[i], down[i]) + slack) * size;
    }
    slabs
}

/// Where the chords of a register meet the children of the scene's root.
#[derive(Zeroable)]
#[repr(align(64))]
pub struct RootSpans<T> {
    /// Where the box of each child is entered, a row of lanes for each.
    start: [[T; MAX_LANES]; NODE_CHILDREN],
    /// Where it is left.
    end: [[T; MAX_LANES]; NODE_CHILDREN],
    /// Lanes that meet each child, as bits.
    met: [u32; NODE_CHILDREN],
    /// Lanes that meet a single child, as bits.
    pub single: u32,
}

impl<T: Real> RootSpans<T> {
    /// The child of the root that a lane meets, and where its box is entered and left; none if it meets several.
    #[inline(always)]
    pub fn single_child(&self, view: &SceneView, lane: usize) -> Option<(u32, (f32, f32))> {
        if self.single >> lane & 1 == 0 {
            return None;
        }
        let child = self.met.iter().position(|met| met >> lane & 1 == 1)?;
        let span = (self.start[child][lane].to_f32(), self.end[child][lane].to_f32());
        Some((view.node(view.scene_root(0)).child[child], span))
    }
}

/// Most children of a node.
pub(super) const NODE_CHILDREN: usize = 8;

/// Tests chords against the children of the scene's root; returns the lanes that may meet one.
#[inline(always)]
pub fn enter_root<L: Lane>(token: L::Token, view: &SceneView, slabs: &Slabs<L>, spans: &mut RootSpans<L::Real>) -> u32 {
    let root = view.node(view.scene_root(0));
    let (mut once, mut again) = (0, 0);
    for i in 0..NODE_CHILDREN {
        if root.child[i] == NO_INDEX {
            spans.met[i] = 0;
            continue;
        }
        let (mut near, mut far) = (L::constant(token, 0.0), L::constant(token, 1.0));
        for axis in 0..3 {
            let low = L::constant(token, f64::from(root.bounds[2 * axis][i])) * slabs.inverse[axis];
            let high = L::constant(token, f64::from(root.bounds[2 * axis + 1][i])) * slabs.inverse[axis];
            near = near.max(low.min(high) + slabs.near[axis]);
            far = far.min(low.max(high) + slabs.far[axis]);
        }
        let met = !L::bits((far * L::constant(token, BOX_SLACK)).lt(near));
        near.store(&mut spans.start[i]);
        far.store(&mut spans.end[i]);
        spans.met[i] = met;
        again |= once & met;
        once |= met;
    }
    spans.single = once & !again;
    once
}

/// What the end of an interval is multiplied with before it is compared with the start.
const BOX_SLACK: f64 = 1.0 + BOX_ROUNDING as f64;

/// Parameters at which the extended boxes of a node's children are entered and left, and those that are met before `t_max`.
#[inline(always)]
pub(super) fn intersect_node<S: Simd>(
    simd: S,
    node: &BvhNode,
    slabs: &Slabs<f32>,
    near_plane: [u32; 3],
    t_max: f32,
) -> (f32x8<S>, f32x8<S>, mask32x8<S>) {
    // Not 0, so that entries are normal doubles, which are in order whatever a processor makes of others.
    let mut near = <f32x8<S> as Lane>::splat(simd, f32::MIN_POSITIVE);
    let mut far = <f32x8<S> as Lane>::splat(simd, t_max);
    for (axis, first) in near_plane.into_iter().enumerate() {
        let first = first as usize;
        let entry = <f32x8<S> as Lane>::load(simd, &node.bounds[first]);
        let exit = <f32x8<S> as Lane>::load(simd, &node.bounds[first ^ 1]);
        let splat = |value: f32| <f32x8<S> as Lane>::splat(simd, value);
        near = Lane::max(near, Lane::mul_add(entry, splat(slabs.inverse[axis]), splat(slabs.near[axis])));
        far = Lane::min(far, Lane::mul_add(exit, splat(slabs.inverse[axis]), splat(slabs.far[axis])));
    }
    let slack = <f32x8<S> as Lane>::constant(simd, BOX_SLACK);
    (near, far, !(far * slack).lt(near))
}

/// Tests the chords of `curve` that overlap [enter, exit] against what the leaf holds; returns how many it tested.
#[inline(always)]
pub(super) fn intersect_leaf<S: Simd>(
    simd: S,
    view: &SceneView,
    curve: &Curve<f32>,
    child: u32,
    enter: f32,
    exit: f32,
    hit: &mut Hit,
) -> u64 {
    let count = curve.chords;
    if count == 1.0 {
        let bends = curve.c2 != [0.0; 3];
        intersect_chord(simd, view, child, curve.start.into(), whole_chord(curve).into(), 0.0, 1.0, bends, hit.t, hit);
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
        if intersect_chord(simd, view, child, from, to - from, j, count, true, t_max, hit) {
            break;
        }
        from = to;
        j += 1.0;
    }
    tested
}

/// Tests one chord, number `j` of `count`; returns whether it hit. That a chord which `mostly_misses` does
/// so again can be foreseen; what a straight ray does cannot, and is decided without a branch.
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
    mostly_misses: bool,
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
    let met = <f32x8<S> as Lane>::bits(found.mask);
    if mostly_misses && met == 0 {
        return false;
    }
    let (t, lane) = nearest(Lane::select(found.mask, found.t, Lane::splat(simd, FAR)));
    let [mut u, mut v] = [[0.0; 8]; 2];
    found.u.store(&mut u);
    found.v.store(&mut v);
    let closer = Hit { t: (j + t) / count, primitive: 8 * index + lane as u32, u: u[lane], v: v[lane] };
    *hit = select_unpredictable(met != 0, closer, *hit);
    met != 0
}

/// The least of eight numbers, and the first lane that has it.
#[inline(always)]
fn nearest<S: Simd>(t: f32x8<S>) -> (f32, usize) {
    let (low, high) = t.split();
    let [a, b, c, d] = SimdBase::min(low, high).to_array();
    let least = Lane::min(Lane::min(a, b), Lane::min(c, d));
    (least, t.simd_eq(least).to_bitmask().trailing_zeros() as usize % 8)
}
