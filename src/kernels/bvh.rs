//! Closest hits of segments with the scene.
//!
//! A curved segment is traversed once, as its chord with all boxes extended by how far the curve strays from the chord at equal s, along
//! each axis and to each side by itself: a curve that bends down needs boxes to reach up. So if the curve is inside a box at s, the chord
//! is inside the extended box at the same s. At a leaf only those of its pieces that overlap the box in s are tested.
//!
//! A segment alone keeps a processor waiting: for the memory of the next node, and for branches that nobody can foresee. So many are under
//! way at once, each asks for the memory it needs next and lets the others go on, and what was met is sorted without a branch.

use super::constants::*;
use super::curve::{Curve, curve_point, deviation, straight, whole_chord};
use super::layout::BvhNode;
use super::primitive::intersect_primitive;
use super::triangle::intersect_triangle;
use super::view::SceneView;
use super::work::Work;
use crate::simd::{Lane, MAX_LANES, Real, load3, splat3};
use bytemuck::Zeroable;
use fearless_simd::{Bytes as _, Select as _, Simd, SimdBase, SimdMask as _, SimdSplit as _, f32x8, f64x2, mask32x8, u32x8, u64x2};
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

/// A chord prepared for slab tests against boxes that are extended by how far the curve strays, one or one per lane.
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
const NODE_CHILDREN: usize = 8;

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
fn intersect_node<S: Simd>(
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

/// What is visited next: a child of a node, and where its box is entered (rounded down) and left (rounded up), as the upper halves of two
/// floats above it. So entries sort by where they are entered, as whole numbers and, if that is not 0, as doubles; 0 is none.
type StackEntry = u64;

/// The bits of a float that an entry keeps of where a box is entered, and by how much that where it is left is rounded up. The sign of
/// -0 would lead entries astray.
const START_BITS: u32 = 0x7fff_0000;
const END_ROUNDING: u32 = 0xffff;

/// The entry of a child whose box is met from `start`, which must not be negative, to `end`.
#[inline(always)]
fn stack_entry(child: u32, start: f32, end: f32) -> StackEntry {
    u64::from((start.to_bits() & START_BITS) | (end.to_bits().wrapping_add(END_ROUNDING) >> 16)) << 32 | u64::from(child)
}

/// The upper words of eight entries.
#[inline(always)]
fn entry_spans<S: Simd>(start: f32x8<S>, end: f32x8<S>) -> u32x8<S> {
    let (start, end): (u32x8<S>, u32x8<S>) = (start.bitcast(), end.bitcast());
    (start & START_BITS) | ((end + END_ROUNDING) >> 16)
}

/// The child of an entry.
#[inline(always)]
fn entry_child(entry: StackEntry) -> u32 {
    entry as u32
}

/// Where the box of an entry is entered.
#[inline(always)]
fn entry_start(entry: StackEntry) -> f32 {
    f32::from_bits((entry >> 32) as u32 & START_BITS)
}

/// Where it is left.
#[inline(always)]
fn entry_end(entry: StackEntry) -> f32 {
    f32::from_bits(((entry >> 32) as u32) << 16)
}

/// The entries of the children that are met, in the order of the children; 0 fills up.
#[inline(always)]
fn met_entries<S: Simd>(simd: S, spans: u32x8<S>, children: u32x8<S>, met: mask32x8<S>) -> [f64x2<S>; 4] {
    let entries = |spans: u32x8<S>, children: u32x8<S>| {
        let (spans, children) = (spans.split(), children.split());
        let ((a, b), (c, d)) = (children.0.interleave(spans.0), children.1.interleave(spans.1));
        [a.bitcast::<f64x2<S>>(), b.bitcast(), c.bitcast(), d.bitcast()]
    };
    // Where registers are shorter there is no instruction to bring lanes together.
    if <S::f32s as SimdBase<S>>::LEN >= NODE_CHILDREN {
        return entries(spans.compress(met), children.compress(met));
    }
    let none = <u32x8<S> as SimdBase<S>>::splat(simd, 0);
    let [mut all, mut kept] = [[0.0; NODE_CHILDREN]; 2];
    for (pair, to) in entries(met.select(spans, none), met.select(children, none)).into_iter().zip(all.chunks_exact_mut(2)) {
        pair.store_slice(to);
    }
    let (bits, mut count) = (met.to_bitmask() as usize, 0);
    for (i, entry) in all.into_iter().enumerate() {
        kept[count] = entry;
        count += bits >> i & 1;
    }
    let pair = |i: usize| f64x2::from_slice(simd, &kept[2 * i..2 * i + 2]);
    [pair(0), pair(1), pair(2), pair(3)]
}

/// Sorts four entries, the farthest first.
#[inline(always)]
fn sort_entries<S: Simd>(a: f64x2<S>, b: f64x2<S>) -> [f64x2<S>; 2] {
    // The farther and the nearer of two pairs; side by side, those pairs crosswise; then only the middle two may be out of order.
    let (far, near) = (SimdBase::max(a, b), SimdBase::min(a, b));
    let (first, second) = far.interleave(near);
    let (far, near) = (SimdBase::max(first, second), SimdBase::min(first, second));
    let middle = far.zip_high(far);
    [far.zip_low(SimdBase::max(near, middle)), SimdBase::min(near, middle)]
}

/// A segment to be looked up.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// The segment.
    pub curve: Curve<f32>,
    /// Its chord, prepared.
    pub slabs: Slabs<f32>,
    /// The node or leaf it is looked up in, as a child reference.
    pub child: u32,
    /// Parameters at which the box of that is entered and left.
    pub span: (f32, f32),
    /// Only hits before this parameter are taken: 1 for a curved step.
    pub t_max: f32,
}

impl Query {
    /// The straight ray origin + t direction, t below `FAR`, from a root of the tree on.
    #[inline(always)]
    pub fn straight(origin: Vec3, direction: Vec3, root: u32) -> Self {
        let curve = straight(origin, direction);
        Query { curve, slabs: slabs((), &curve), child: root, span: (0.0, FAR), t_max: FAR }
    }
}

/// Room above the stack for the entries that every visit writes, met or not.
const OVERHANG: usize = NODE_CHILDREN;
/// Entries are counted modulo the size of the stack, which is a power of two: an index that cannot be out of range needs no check.
const TOP_MASK: usize = STACK_SIZE as usize - 1;
const _: () = assert!(STACK_SIZE.is_power_of_two());

/// A segment on its way down the tree. What a visit of a node reads comes first, in as few cache lines as there may be.
#[repr(C, align(64))]
#[derive(Clone, Copy, Zeroable)]
struct Descent {
    slabs: Slabs<f32>,
    /// The plane of each axis that is met first.
    near_plane: [u32; 3],
    /// What is visited next; its child is `NO_INDEX` at the end.
    next: StackEntry,
    /// Entries that wait.
    top: usize,
    /// Number of the segment.
    index: usize,
    hit: Hit,
    curve: Curve<f32>,
    /// What waits, of each node the nearest on top, above an entry of `NO_INDEX`.
    stack: [StackEntry; STACK_SIZE as usize + OVERHANG],
}

impl Descent {
    #[inline(always)]
    fn start(&mut self, index: usize, query: &Query) {
        let inverse = query.slabs.inverse;
        self.slabs = query.slabs;
        self.near_plane = [u32::from(inverse[0] < 0.0), 2 + u32::from(inverse[1] < 0.0), 4 + u32::from(inverse[2] < 0.0)];
        self.next = stack_entry(query.child, query.span.0, query.span.1);
        self.stack[0] = NO_INDEX.into();
        self.top = 1;
        self.index = index;
        self.hit = Hit::none(query.t_max);
        self.curve = query.curve;
    }

    /// Whether it is at a node, and not at a leaf or its end.
    #[inline(always)]
    fn at_node(&self) -> bool {
        entry_child(self.next) < CHILD_PRIMITIVE
    }

    /// Whether there is nothing left to visit.
    #[inline(always)]
    fn is_over(&self) -> bool {
        entry_child(self.next) == NO_INDEX
    }

    /// Tests the children of the node it is at; those met wait, and the nearest of all that wait is next.
    #[inline(always)]
    fn visit_node<S: Simd>(&mut self, simd: S, view: &SceneView) {
        let node = view.node(entry_child(self.next));
        let (start, end, met) = intersect_node(simd, node, &self.slabs, self.near_plane, self.hit.t);
        let count = met.to_bitmask().count_ones() as usize;
        let [a, b, c, d] = met_entries(simd, entry_spans(start, end), u32x8::from_slice(simd, &node.child), met);
        let put = |to: &mut [StackEntry], [a, b]: [f64x2<S>; 2]| {
            a.bitcast::<u64x2<S>>().store_slice(&mut to[..2]);
            b.bitcast::<u64x2<S>>().store_slice(&mut to[2..4]);
        };
        let top = self.top & TOP_MASK;
        let above = &mut self.stack[top..top + OVERHANG];
        put(above, sort_entries(a, b));
        // More than four are rare.
        if count > 4 {
            put(&mut above[4..], [c, d]);
            for i in 4..count {
                let mut at = i;
                while at > 0 && above[at - 1] < above[at] {
                    above.swap(at - 1, at);
                    at -= 1;
                }
            }
        }
        self.top += count;
        self.take_next(view);
    }

    /// Tests what the leaf it is at holds; the nearest of all that wait is next. Counts what was tested.
    #[inline(always)]
    fn visit_leaf<S: Simd>(&mut self, simd: S, view: &SceneView, work: &mut Work) {
        let child = entry_child(self.next);
        let tested = intersect_leaf(simd, view, &self.curve, child, entry_start(self.next), entry_end(self.next), &mut self.hit);
        if child & CHILD_BLOCK == 0 {
            work.primitives += tested;
        } else {
            work.blocks += tested;
        }
        self.take_next(view);
    }

    /// Takes the nearest entry that still may hold a closer hit, and asks for its memory.
    #[inline(always)]
    fn take_next(&mut self, view: &SceneView) {
        // All that are entered before the hit, or at it to the precision of an entry.
        let limit = u64::from(self.hit.t.to_bits() | 0xffff) << 32 | u64::from(NO_INDEX);
        loop {
            self.top -= 1;
            self.next = self.stack[self.top & TOP_MASK];
            if self.next <= limit {
                break;
            }
        }
        view.prefetch(entry_child(self.next));
    }
}

/// Segments under way at once.
const DESCENTS: usize = 32;

/// Looks segments up in the BVH.
pub struct Traverser {
    descents: Box<[Descent; DESCENTS]>,
    /// What was done.
    pub work: Work,
}

impl Traverser {
    /// One that has done nothing yet.
    pub fn new() -> Self {
        Traverser { descents: bytemuck::zeroed_box(), work: Work::default() }
    }

    /// Finds the closest hit of each of `queries`, which come with a number, and hands it to `found` with that number, in any order.
    #[inline(always)]
    pub fn closest_hits<S: Simd>(
        &mut self,
        simd: S,
        view: &SceneView,
        queries: impl Iterator<Item = (usize, Query)>,
        mut found: impl FnMut(usize, &Curve<f32>, Hit),
    ) {
        let Traverser { descents, work } = self;
        let mut queries = queries.fuse();
        // Descents that are at a node, and those that are at a leaf or at their end.
        let (mut at_nodes, mut at_leaves) = ([0u8; DESCENTS], [0u8; DESCENTS]);
        let (mut nodes, mut leaves) = (0, 0);
        macro_rules! line_up {
            ($slot:expr, $descent:expr) => {
                // Written to both, counted in one: which cannot be foreseen.
                (at_nodes[nodes % DESCENTS], at_leaves[leaves % DESCENTS]) = ($slot, $slot);
                let at_node = usize::from($descent.at_node());
                nodes += at_node;
                leaves += 1 - at_node;
            };
        }
        for (slot, (index, query)) in queries.by_ref().take(DESCENTS).enumerate() {
            let descent = &mut descents[slot];
            descent.start(index, &query);
            line_up!(slot as u8, descent);
        }
        work.chords += (nodes + leaves) as u64;
        while nodes + leaves > 0 {
            work.nodes += nodes as u64;
            for i in 0..std::mem::take(&mut nodes) {
                let slot = at_nodes[i % DESCENTS];
                let descent = &mut descents[usize::from(slot) % DESCENTS];
                descent.visit_node(simd, view);
                line_up!(slot, descent);
            }
            for i in 0..std::mem::take(&mut leaves) {
                let slot = at_leaves[i % DESCENTS];
                let descent = &mut descents[usize::from(slot) % DESCENTS];
                if descent.is_over() {
                    found(descent.index, &descent.curve, descent.hit);
                    let Some((index, query)) = queries.next() else { continue };
                    descent.start(index, &query);
                    work.chords += 1;
                } else {
                    descent.visit_leaf(simd, view, work);
                }
                line_up!(slot, descent);
            }
        }
    }
}

impl Default for Traverser {
    fn default() -> Self {
        Self::new()
    }
}

/// Tests the chords of `curve` that overlap [enter, exit] against what the leaf holds; returns how many it tested.
#[inline(always)]
fn intersect_leaf<S: Simd>(simd: S, view: &SceneView, curve: &Curve<f32>, child: u32, enter: f32, exit: f32, hit: &mut Hit) -> u64 {
    let count = curve.chords;
    if count == 1.0 {
        intersect_chord(simd, view, child, curve.start.into(), whole_chord(curve).into(), 0.0, 1.0, curve.tolerance > 0.0, hit.t, hit);
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

/// Tests one chord, number `j` of `count`; returns whether it hit. Most pieces of a curve miss, which can be foreseen; whether a straight
/// ray does cannot.
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
    curved: bool,
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
    if curved && met == 0 {
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
