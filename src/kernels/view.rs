//! What kernels read of a world, through the same accessors as `shaders/bindings.glsl`.

use super::constants::{CHILD_BLOCK, CHILD_INDEX, CHILD_PRIMITIVE};
use super::layout::*;
use glam::{Vec2, Vec4};
#[cfg(target_arch = "x86_64")]
use std::hint::select_unpredictable;

/// Of so few nodes (1 MB) most that are visited are in a cache: to ask for them took form A of the benchmark 1.5% longer.
#[cfg(target_arch = "x86_64")]
const SMALL_TREE: usize = 4096;

/// Borrowed arrays of a world.
#[derive(Clone, Copy)]
pub struct SceneView<'a> {
    /// Everything that is not an array.
    pub scene: &'a SceneParameters,
    /// Nodes of the BVH, the root first.
    pub nodes: &'a [BvhNode],
    /// Triangles in groups of eight.
    pub blocks: &'a [TriangleBlock],
    /// Attributes of triangles.
    pub triangles: &'a [Triangle],
    /// Attributes of vertices.
    pub vertices: &'a [Vertex],
    /// Analytic primitives.
    pub primitives: &'a [Primitive],
    /// Material of each object.
    pub objects: &'a [u32],
    /// Materials.
    pub materials: &'a [Material],
    /// Images.
    pub textures: &'a [Texture],
    /// Pool of texels, RGBA half floats.
    pub texels: &'a [[u16; 4]],
    /// Emitters.
    pub lights: &'a [Light],
    /// By how much each light appears to be shifted and by what share larger, by level, cell and light.
    pub aims: &'a [[f32; 4]],
    /// Cumulative distribution of the environment: rows, then the columns of each row.
    pub environment_cdf: &'a [f32],
    /// Distance to the nearest geometry by level and cell, in quarters of a cell of that level.
    pub clearance: &'a [u8],
    /// Directional albedo of GGX by roughness (rows) and cosine.
    pub albedo: &'a [f32],
    /// Black bodies by temperature: linear sRGB of luminance 1, logarithm of the luminance.
    pub black_bodies: &'a [[f32; 4]],
    /// Profiles of accretion discs: temperature as a share of the highest, coordinate angular velocity.
    pub profiles: &'a [[f32; 2]],
}

impl SceneView<'_> {
    /// The root of the BVH of one side of a wormhole, or of the whole scene, as a child reference.
    #[inline(always)]
    pub fn scene_root(&self, side: u32) -> u32 {
        if side == 0 { 0 } else { self.scene.far_root }
    }
    /// A node.
    #[inline(always)]
    pub fn node(&self, index: u32) -> &BvhNode {
        &self.nodes[index as usize]
    }
    /// Asks for the memory of a child that will be visited soon, unless the tree is small.
    #[inline(always)]
    pub fn prefetch(&self, child: u32) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            if self.nodes.len() < SMALL_TREE {
                return;
            }
            // Primitives are few, and the end is nowhere: both ask for the first node, which is at hand.
            let index = select_unpredictable(child & CHILD_PRIMITIVE == 0, child & CHILD_INDEX, 0) as usize;
            let node = self.nodes.as_ptr().wrapping_add(index).cast::<i8>();
            let block = self.blocks.as_ptr().wrapping_add(index).cast::<i8>();
            let start = select_unpredictable(child & (CHILD_BLOCK | CHILD_PRIMITIVE) == CHILD_BLOCK, block, node);
            // A node may lie in as many lines as a block.
            for line in (0..size_of::<TriangleBlock>()).step_by(64) {
                // SAFETY: a prefetch reads nothing that a program can see and does not fault, whatever the address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(line)) };
            }
        }
    }
    /// Eight triangles.
    #[inline(always)]
    pub fn block(&self, index: u32) -> &TriangleBlock {
        &self.blocks[index as usize]
    }
    /// A triangle.
    #[inline(always)]
    pub fn triangle(&self, index: u32) -> &Triangle {
        &self.triangles[index as usize]
    }
    /// A vertex.
    #[inline(always)]
    pub fn vertex(&self, index: u32) -> &Vertex {
        &self.vertices[index as usize]
    }
    /// An analytic primitive.
    #[inline(always)]
    pub fn primitive(&self, index: u32) -> &Primitive {
        &self.primitives[index as usize]
    }
    /// Material of an object.
    #[inline(always)]
    pub fn material(&self, object: u32) -> &Material {
        &self.materials[self.objects[object as usize] as usize]
    }
    /// An image.
    #[inline(always)]
    pub fn texture_at(&self, index: u32) -> Texture {
        self.textures[index as usize]
    }
    /// A texel, linear.
    #[inline(always)]
    pub fn texel(&self, index: u32) -> Vec4 {
        let half = self.texels[index as usize];
        Vec4::from(half.map(|h| half::f16::from_bits(h).to_f32()))
    }
    /// An emitter.
    #[inline(always)]
    pub fn light(&self, index: u32) -> &Light {
        &self.lights[index as usize]
    }
    /// An entry of the table of apparent lights.
    #[inline(always)]
    pub fn aim(&self, index: u32) -> Vec4 {
        Vec4::from(self.aims[index as usize])
    }
    /// An entry of the environment's distribution.
    #[inline(always)]
    pub fn environment_cdf(&self, index: u32) -> f32 {
        self.environment_cdf[index as usize]
    }
    /// An entry of the albedo table.
    #[inline(always)]
    pub fn albedo(&self, index: u32) -> f32 {
        self.albedo[index as usize]
    }
    /// An entry of the table of black bodies.
    #[inline(always)]
    pub fn black_body_entry(&self, index: u32) -> Vec4 {
        Vec4::from(self.black_bodies[index as usize])
    }
    /// An entry of a disc's profile.
    #[inline(always)]
    pub fn profile_entry(&self, index: u32) -> Vec2 {
        Vec2::from(self.profiles[index as usize])
    }
}
