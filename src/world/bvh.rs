//! Builds the eight-wide BVH: `obvhs` builds a binary tree over triangles and another over primitives, both are joined and collapsed.

use super::World;
use crate::error::{Error, Result};
use crate::kernels::constants::*;
use crate::kernels::layout::{BvhNode, Primitive, TriangleBlock};
use glam::{DMat4, DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::{Boundable, BvhBuildParams};
use smallvec::SmallVec;
use std::time::Duration;

/// Triangles per leaf: one block.
const LEAF_SIZE: u32 = 8;
/// From this many triangles on the builder is told to hurry.
const LARGE: usize = 1_000_000;

struct Box3(Aabb);

impl Boundable for Box3 {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// One tree of the forest: nodes of `obvhs`, and what its leaves hold.
struct Tree {
    bvh: Bvh2,
    blocks: bool,
    /// Triangle or primitive behind each index the tree was built over.
    ids: Vec<u32>,
}

/// A subtree waiting to become a child.
#[derive(Clone, Copy)]
struct Subtree {
    tree: usize,
    node: usize,
}

/// Bounds of a primitive, widened by a rounding error.
pub fn primitive_bounds(primitive: &Primitive) -> (Vec3, Vec3) {
    let d = &primitive.data;
    let at = |i: usize| Vec3::new(d[i], d[i + 1], d[i + 2]);
    let (min, max) = match primitive.kind {
        PRIMITIVE_SPHERE => (at(0) - Vec3::splat(d[3]), at(0) + Vec3::splat(d[3])),
        PRIMITIVE_QUAD => hull(&[at(0), at(0) + at(3), at(0) + at(6), at(0) + at(3) + at(6)]),
        PRIMITIVE_DISC => {
            let reach = (Vec3::ONE - at(4) * at(4)).max(Vec3::ZERO).map(f32::sqrt) * d[7];
            (at(0) - reach, at(0) + reach)
        }
        _ => hull(&box_corners(primitive)),
    };
    let slack = Vec3::splat(1e-6) * min.abs().max(max.abs()).max(max - min);
    (min - slack, max + slack)
}

/// Smallest box around points.
pub fn hull(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

/// Corners of a box primitive: bit i of the index is the side on axis i.
pub fn box_corners(primitive: &Primitive) -> [Vec3; 8] {
    let d = primitive.data.map(f64::from);
    let unit_from_world =
        DMat4::from_cols_array_2d(&[[d[0], d[1], d[2], d[3]], [d[4], d[5], d[6], d[7]], [d[8], d[9], d[10], d[11]], [0.0, 0.0, 0.0, 1.0]])
            .transpose();
    let world_from_unit = unit_from_world.inverse();
    std::array::from_fn(|i| {
        let corner = DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
        world_from_unit.transform_point3(corner).as_vec3()
    })
}

/// Builds a tree for each side of a wormhole that `sides` (one entry per object) names, or one for all; returns the bounds of
/// the scene (empty bounds are a point at the origin).
pub fn build(world: &mut World, corners: &[[Vec3; 3]], sides: &[u32]) -> Result<(Vec3, Vec3)> {
    let _span = tracing::info_span!("bvh", triangles = corners.len(), primitives = world.primitives.len()).entered();
    let near = build_side(world, corners, sides, 0)?;
    let far = if world.parameters.throat > 0.0 {
        world.scene.far_root = world.nodes.len() as u32;
        build_side(world, corners, sides, 1)?
    } else {
        None
    };
    let bounds = [near, far].into_iter().flatten().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    Ok(bounds.unwrap_or((Vec3::ZERO, Vec3::ZERO)))
}

fn build_side(world: &mut World, corners: &[[Vec3; 3]], sides: &[u32], side: u32) -> Result<Option<(Vec3, Vec3)>> {
    let here = |object: u32| sides[object as usize] == side;
    let triangles: Vec<u32> = (0..corners.len() as u32).filter(|&i| here(world.triangles[i as usize].object)).collect();
    let primitives: Vec<u32> = (0..world.primitives.len() as u32).filter(|&i| here(world.primitives[i as usize].object)).collect();
    let mut trees = Vec::new();
    if !triangles.is_empty() {
        let boxes: Vec<Box3> = triangles.iter().map(|&i| aabb(hull(&corners[i as usize]))).collect();
        let preset = if boxes.len() > LARGE { BvhBuildParams::fast_build() } else { BvhBuildParams::medium_build() };
        let params = BvhBuildParams { max_prims_per_leaf: LEAF_SIZE, ..preset };
        trees.push(Tree { bvh: build_bvh2(&boxes, params, &mut Duration::default()), blocks: true, ids: triangles });
    }
    if !primitives.is_empty() {
        let boxes: Vec<Box3> = primitives.iter().map(|&i| aabb(primitive_bounds(&world.primitives[i as usize]))).collect();
        let params = BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() };
        trees.push(Tree { bvh: build_bvh2(&boxes, params, &mut Duration::default()), blocks: false, ids: primitives });
    }
    if trees.is_empty() {
        world.nodes.push(empty_node());
        return Ok(None);
    }
    let roots: Vec<Subtree> = (0..trees.len()).map(|tree| Subtree { tree, node: 0 }).collect();
    let bounds = roots.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), r| {
        let b = node_of(&trees, *r).aabb;
        (low.min(b.min.into()), high.max(b.max.into()))
    });
    collapse(world, &trees, roots, corners)?;
    Ok(Some(bounds))
}

fn aabb((min, max): (Vec3, Vec3)) -> Box3 {
    Box3(Aabb { min: Vec3A::from(min), max: Vec3A::from(max) })
}

fn node_of(trees: &[Tree], subtree: Subtree) -> &Bvh2Node {
    &trees[subtree.tree].bvh.nodes[subtree.node]
}

fn empty_node() -> BvhNode {
    let mut bounds = [[0.0; 8]; 6];
    for (plane, values) in bounds.iter_mut().enumerate() {
        *values = [if plane % 2 == 0 { f32::INFINITY } else { f32::NEG_INFINITY }; 8];
    }
    BvhNode { bounds, child: [NO_INDEX; 8] }
}

/// Turns the binary trees into nodes of eight: a node opens its largest inner child until it has eight children.
fn collapse(world: &mut World, trees: &[Tree], roots: Vec<Subtree>, corners: &[[Vec3; 3]]) -> Result<()> {
    let root = world.nodes.len();
    world.nodes.push(empty_node());
    // (node index, its subtrees, entries on the traversal stack above it)
    let mut todo = vec![(root, roots, 1usize)];
    let mut deepest = 0;
    while let Some((index, mut children, depth)) = todo.pop() {
        while children.len() < 8 {
            let largest = (0..children.len())
                .filter(|&i| node_of(trees, children[i]).prim_count == 0)
                .max_by(|&a, &b| node_of(trees, children[a]).aabb.half_area().total_cmp(&node_of(trees, children[b]).aabb.half_area()));
            let Some(largest) = largest else { break };
            let opened = children.swap_remove(largest);
            let first = node_of(trees, opened).first_index as usize;
            children.push(Subtree { node: first, ..opened });
            children.push(Subtree { node: first + 1, ..opened });
        }
        deepest = deepest.max(depth + children.len());
        for (lane, &child) in children.iter().enumerate() {
            let source = *node_of(trees, child);
            let (min, max) = (source.aabb.min.to_array(), source.aabb.max.to_array());
            for axis in 0..3 {
                world.nodes[index].bounds[2 * axis][lane] = min[axis];
                world.nodes[index].bounds[2 * axis + 1][lane] = max[axis];
            }
            let tree = &trees[child.tree];
            world.nodes[index].child[lane] = if source.prim_count == 0 {
                let first = source.first_index as usize;
                let next = world.nodes.len();
                world.nodes.push(empty_node());
                let halves = vec![Subtree { node: first, ..child }, Subtree { node: first + 1, ..child }];
                todo.push((next, halves, depth + children.len() - 1));
                next as u32
            } else {
                let range = source.first_index as usize..(source.first_index + source.prim_count) as usize;
                let held: SmallVec<[u32; 8]> = tree.bvh.primitive_indices[range].iter().map(|&i| tree.ids[i as usize]).collect();
                if tree.blocks {
                    world.blocks.push(block(&held, corners));
                    CHILD_BLOCK | (world.blocks.len() as u32 - 1)
                } else {
                    CHILD_PRIMITIVE | held[0]
                }
            };
        }
    }
    if deepest > STACK_SIZE as usize {
        return Err(Error::World(format!(
            "the geometry needs a traversal stack of {deepest} entries, expected at most {STACK_SIZE}; are many triangles in one place?"
        )));
    }
    Ok(())
}

fn block(held: &[u32], corners: &[[Vec3; 3]]) -> TriangleBlock {
    let mut block: TriangleBlock = bytemuck::Zeroable::zeroed();
    for lane in 0..8 {
        let id = held[lane.min(held.len() - 1)];
        let [a, b, c] = corners[id as usize];
        let (edge1, edge2) = (b - a, c - a);
        for axis in 0..3 {
            block.vertex[axis][lane] = a[axis];
            block.edge1[axis][lane] = edge1[axis];
            block.edge2[axis][lane] = edge2[axis];
        }
        block.triangle[lane] = if lane < held.len() { id } else { NO_INDEX };
    }
    block
}
