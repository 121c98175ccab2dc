//! Segments on their way through the BVH, many at once.
//!
//! A segment alone keeps a processor waiting: for the memory of the next node, and for branches that nobody can foresee. So many are under
//! way at once, each asks for the memory it needs next and lets the others go on, and what was met is sorted without a branch.

use super::bvh::{Hit, NODE_CHILDREN, Slabs, intersect_leaf, intersect_node, slabs};
use super::constants::*;
use super::curve::{Curve, straight};
use super::view::SceneView;
use super::work::Work;
use bytemuck::Zeroable;
use fearless_simd::{Bytes as _, Select as _, Simd, SimdBase, SimdMask as _, SimdSplit as _, f32x8, f64x2, mask32x8, u32x8, u64x2};
use glam::Vec3;

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
        let limit = u64::from(self.hit.t.to_bits() | END_ROUNDING) << 32 | u64::from(NO_INDEX);
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
