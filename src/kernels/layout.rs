//! Structures both backends read, laid out as std430. Twin of `shaders/layout.glsl`; `tests/structure.rs` compares the offsets.
//!
//! Every three-vector is followed by a scalar that means something, so there is no padding.

use super::constants::{BLOCK_WORDS, LIGHT_WORDS, MATERIAL_WORDS, NODE_WORDS, PRIMITIVE_WORDS};
use bytemuck::{Pod, Zeroable};
use std::mem::offset_of;

/// A node of the eight-wide BVH: bounds of its children, and what they are (`CHILD_*`, or a node index).
///
/// An unused child has `NO_INDEX` and inverted bounds, which no ray meets.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BvhNode {
    /// min x, max x, min y, max y, min z, max z of the eight children.
    pub bounds: [[f32; 8]; 6],
    /// What each child is.
    pub child: [u32; 8],
}

/// Up to eight triangles, tested together. An unused lane repeats a used one and has `NO_INDEX`.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TriangleBlock {
    /// First vertex.
    pub vertex: [[f32; 8]; 3],
    /// Second vertex minus first.
    pub edge1: [[f32; 8]; 3],
    /// Third vertex minus first.
    pub edge2: [[f32; 8]; 3],
    /// Index into the triangles.
    pub triangle: [u32; 8],
}

/// What shading needs of a triangle beyond its corners.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Triangle {
    /// Indices into the vertices.
    pub vertices: [u32; 3],
    /// Index into the objects.
    pub object: u32,
}

/// Attributes of a mesh vertex. A zero normal means that the mesh has none there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Vertex {
    /// Unit shading normal.
    pub normal: [f32; 3],
    /// Texture coordinates.
    pub uv: [f32; 2],
}

/// An analytic primitive.
///
/// `data` is, by `kind`: sphere: center and radius; quad: corner, u, v and unit normal; box: rows of the affine map from the
/// world to the unit cube; disc: center, inner radius, unit normal, outer radius, start of its profile.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Primitive {
    /// Geometry.
    pub data: [f32; 12],
    /// `PRIMITIVE_*`.
    pub kind: u32,
    /// Index into the objects.
    pub object: u32,
    /// Fills a cache line.
    pub unused: [u32; 2],
}

/// A material. Textures multiply the value beside them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Material {
    /// Reflectance of a diffuse or metallic surface, tint of a dielectric one; linear sRGB.
    pub base_color: [f32; 3],
    /// `MATERIAL_*`.
    pub kind: u32,
    /// Emitted radiance.
    pub emission: [f32; 3],
    /// Perceptual roughness; GGX alpha is its square.
    pub roughness: f32,
    /// Absorption coefficient inside a dielectric (1/length).
    pub absorption: [f32; 3],
    /// Refractive index of a dielectric.
    pub ior: f32,
    /// Texture of `base_color`, or `NO_INDEX`.
    pub base_texture: u32,
    /// Texture of `roughness`, or `NO_INDEX`.
    pub roughness_texture: u32,
    /// Texture of `emission`, or `NO_INDEX`.
    pub emission_texture: u32,
    /// `MATERIAL_TWO_SIDED`, `MATERIAL_TEXTURED`, `MATERIAL_OPAQUE`.
    pub flags: u32,
    /// Temperature of a black body whose radiance `emission` scales, the hottest one of an accretion disc (kelvin); 0 for plain emission.
    pub temperature: f32,
    /// Start of an accretion disc's profile.
    pub profile: u32,
    /// Inner radius of an accretion disc.
    pub inner_radius: f32,
    /// Outer radius of an accretion disc.
    pub outer_radius: f32,
}

/// An image in the pool of texels (RGBA, half floats, linear).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Texture {
    /// Index of the first texel.
    pub first_index: u32,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
}

/// An emitter that directions are sampled towards.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Light {
    /// Center of a sphere, corner of a quad or triangle.
    pub position: [f32; 3],
    /// `LIGHT_*`.
    pub kind: u32,
    /// First edge of a quad or triangle.
    pub edge_u: [f32; 3],
    /// Radius of a sphere, area of a quad or triangle.
    pub size: f32,
    /// Second edge of a quad or triangle.
    pub edge_v: [f32; 3],
    /// Sum of the selection probabilities up to and including this light.
    pub cumulative: f32,
}

// Shaders read these as words of 16 bytes (`bindings.glsl`).
const _: () = assert!(size_of::<BvhNode>() == 16 * NODE_WORDS as usize && offset_of!(BvhNode, child) == 16 * 12);
const _: () = assert!(size_of::<TriangleBlock>() == 16 * BLOCK_WORDS as usize && offset_of!(TriangleBlock, triangle) == 16 * 18);
const _: () = assert!(size_of::<Triangle>() == 16 && size_of::<Vertex>() == 20 && size_of::<Primitive>() == 16 * PRIMITIVE_WORDS as usize);
const _: () = assert!(size_of::<Material>() == 16 * MATERIAL_WORDS as usize && size_of::<Light>() == 16 * LIGHT_WORDS as usize);

/// One sky. A wormhole has two.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct EnvironmentParameters {
    /// Constant colour, or the colour at the zenith, or the grid's lines.
    pub color: [f32; 3],
    /// `ENVIRONMENT_*`.
    pub kind: u32,
    /// Colour at the horizon, or the grid's ground.
    pub horizon: [f32; 3],
    /// Factor on an image; line width of a grid in radians.
    pub scale: f32,
    /// Colour at the nadir.
    pub nadir: [f32; 3],
    /// Rotation about the vertical (radians); spacing of a grid's lines (radians).
    pub angle: f32,
    /// Texture of an image, or `NO_INDEX`.
    pub texture_index: u32,
    /// Columns of the table directions are sampled from; 0 if they are not.
    pub columns: u32,
    /// Rows of that table.
    pub rows: u32,
    /// Temperature of the black body whose radiance the colours scale (kelvin); 0 for plain colours.
    pub temperature: f32,
}

/// Everything about a scene that is not an array.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SceneParameters {
    /// Camera position.
    pub camera_position: [f32; 3],
    /// Tangent of half the vertical field of view.
    pub tan_half_fov: f32,
    /// Camera axes, unit length.
    pub camera_right: [f32; 3],
    /// Width over height of the film.
    pub aspect: f32,
    /// Up axis.
    pub camera_up: [f32; 3],
    /// Radius of the lens; 0 is a pinhole.
    pub aperture_radius: f32,
    /// Viewing direction.
    pub camera_forward: [f32; 3],
    /// Distance of the plane in focus.
    pub focus_distance: f32,
    /// Velocity of the observer at the camera against the Eulerian one, in units of light's.
    pub camera_velocity: [f32; 3],
    /// Root of the BVH on the far side of a wormhole.
    pub far_root: u32,
    /// The skies of both sides.
    pub environment: [EnvironmentParameters; 2],
    /// Center of the region that bends light.
    pub region_center: [f32; 3],
    /// Its radius.
    pub region_radius: f32,
    /// Point that the levels of the clearance grid shrink towards.
    pub grid_focus: [f32; 3],
    /// Cells of the coarsest level per length.
    pub grid_inverse_cell: f32,
    /// Cells of every level along each axis; without a grid a single one, without clearance, that reaches everywhere.
    pub grid_size: [u32; 3],
    /// Coefficient A of the far field n = 1 + A / r outside the region; 0 if space is straight there.
    pub region_strength: f32,
    /// Lowest corner of the box that holds all geometry, from the focus in cells of the coarsest level.
    pub bounds_low: [f32; 3],
    /// `CAMERA_*`.
    pub camera_kind: u32,
    /// Highest corner of that box.
    pub bounds_high: [f32; 3],
    /// `FILTER_*`.
    pub filter_kind: u32,
    /// The focus in cells from the lowest corner, the same for every level.
    pub grid_focus_cell: [f32; 3],
    /// Film width in pixels.
    pub film_width: u32,
    /// 1 over the cells from the focus down to the faces of a level.
    pub grid_reach_low: [f32; 3],
    /// Film height in pixels.
    pub film_height: u32,
    /// 1 over the cells from the focus up to the faces of a level.
    pub grid_reach_high: [f32; 3],
    /// Angle of a pixel, radians.
    pub pixel_spread: f32,
    /// Point that the levels of the table of apparent lights shrink towards.
    pub aim_focus: [f32; 3],
    /// 1 over the distance from there to the faces of the coarsest; 0 without a table.
    pub aim_scale: f32,
    /// Width of a camera ray's cone at its origin.
    pub cone_width: f32,
    /// Offset of ray origins at the world's origin.
    pub origin_offset: f32,
    /// Error allowed per step, as a share of the ray's width.
    pub tolerance: f32,
    /// Sagitta allowed per chord, as a share of the ray's width.
    pub chord_tolerance: f32,
    /// Steps after which a ray is exhausted.
    pub max_steps: u32,
    /// `METHOD_*`.
    pub method: u32,
    /// 1 if `euler` kicks the velocity without the step length, as the thesis prints it.
    pub literal_kick: u32,
    /// Most scattering events of a path.
    pub max_depth: u32,
    /// Lights in the list; the environment, if sampled, is the last.
    pub light_count: u32,
    /// 1 if light bends up to the edge of the region, so that rays must be taken there and not beyond.
    pub region_sharp: u32,
    /// 1 if space is not conformally flat, so that surfaces must be seen in the local frame.
    pub local_frames: u32,
    /// Largest share of samples that go towards lights (0 switches light sampling off).
    pub light_share: f32,
}

/// First-sample values of a pixel, for the film's AOVs.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Aov {
    /// Base colour of the first surface.
    pub albedo: [f32; 3],
    /// Frequency at the film over frequency at the first surface or in the environment (static observers).
    pub redshift: f32,
    /// Shading normal of the first surface.
    pub normal: [f32; 3],
    /// Coordinate length of the camera ray.
    pub distance: f32,
    /// Position of the first surface.
    pub position: [f32; 3],
    /// Relative drift of the Hamiltonian constraint along the camera ray.
    pub constraint_error: f32,
    /// Object index plus one, 0 without a hit.
    pub object: u32,
    /// `STATUS_*` of the camera ray.
    pub status: u32,
    /// Integration steps of the camera ray.
    pub steps: u32,
    /// Chords of the camera ray that met the BVH.
    pub chords: u32,
}
