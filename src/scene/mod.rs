//! What the user describes: a scene file, its meshes and textures, read and validated.

mod assets;
pub mod edit;
pub mod file;
mod load;
pub mod mesh;
pub mod spacetime;
pub mod texture;
pub mod values;

pub use assets::Assets;
pub use file::{CameraKind, Filter, Form, Law, Method, ToneMap};
pub use load::{load_scene, parse_scene, parse_scene_with, read_scene};
pub use spacetime::{Extent, Hole, Spacetime};

use glam::{DMat4, DVec3};
use std::path::PathBuf;
use std::sync::Arc;
use texture::Image;

/// A validated scene. Lengths in scene units, colours in linear sRGB.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Where it was read from; `built-in` without a file.
    pub path: PathBuf,
    /// The eye.
    pub camera: Camera,
    /// Size of the picture and how it is developed.
    pub film: FilmSettings,
    /// What bends the light.
    pub spacetime: Spacetime,
    /// How rays are integrated.
    pub integrator: Integrator,
    /// What is seen where nothing is hit: on this side, and on the far side of a wormhole.
    pub environment: [Sky; 2],
    /// Materials by index; 0 is the default.
    pub materials: Vec<Material>,
    /// Textures by index.
    pub images: Vec<Arc<Image>>,
    /// Everything that can be hit.
    pub shapes: Vec<Shape>,
}

/// The camera.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Perspective or panorama.
    pub kind: CameraKind,
    /// Position of the eye.
    pub position: DVec3,
    /// Unit viewing direction.
    pub forward: DVec3,
    /// Unit direction to the right of the picture.
    pub right: DVec3,
    /// Unit direction to its top.
    pub up: DVec3,
    /// Vertical field of view (radians).
    pub fov_radians: f64,
    /// Radius of the lens.
    pub aperture_radius: f64,
    /// Distance of the plane in focus.
    pub focus_distance: f64,
    /// Velocity against the Eulerian observer, in units of light's.
    pub velocity: DVec3,
}

/// The film.
#[derive(Clone, Debug)]
pub struct FilmSettings {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Samples per pixel to render unless the command line says otherwise.
    pub samples: u32,
    /// Most scattering events of a path.
    pub max_depth: u32,
    /// Exposure in stops.
    pub exposure: f64,
    /// Tone curve of pictures.
    pub tone_map: ToneMap,
    /// Pixel filter.
    pub filter: Filter,
}

/// How rays are integrated.
#[derive(Clone, Debug)]
pub struct Integrator {
    /// Method, resolved from `auto`.
    pub method: Method,
    /// Whether it was `auto`.
    pub auto: bool,
    /// Error allowed per step (pixels).
    pub tolerance: f64,
    /// Error allowed per chord (pixels).
    pub chord_tolerance: f64,
    /// Step of the methods that do not choose their own: a length, or a difference of the model's parameter (symplectic, leapfrog).
    pub step: f64,
    /// Steps after which a ray is given up.
    pub max_steps: u32,
}

/// A sky.
#[derive(Clone, Debug)]
pub struct Sky {
    /// What it looks like.
    pub environment: Environment,
    /// Temperature of the black body whose radiance its colours scale (kelvin); 0 for plain colours.
    pub temperature: f32,
}

/// What a sky looks like.
#[derive(Clone, Debug)]
pub enum Environment {
    /// One radiance everywhere.
    Constant([f32; 3]),
    /// From zenith over the horizon to the nadir.
    Gradient {
        /// Straight up.
        zenith: [f32; 3],
        /// Level.
        horizon: [f32; 3],
        /// Straight down.
        nadir: [f32; 3],
    },
    /// Lines of equal altitude and azimuth, for looking at lensing.
    Grid {
        /// Colour of the lines.
        line: [f32; 3],
        /// Colour of the upper half.
        north: [f32; 3],
        /// Colour of the lower half.
        south: [f32; 3],
        /// Distance of lines (radians).
        spacing: f64,
        /// Width of lines (radians).
        width: f64,
    },
    /// An equirectangular image.
    Image {
        /// Texture.
        image: usize,
        /// Factor on its values.
        scale: f32,
        /// Rotation about the vertical (radians).
        rotation: f64,
    },
}

/// How a surface scatters and emits.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name.
    pub name: String,
    /// Diffuse, metallic, dielectric or emissive.
    pub kind: file::MaterialKind,
    /// Reflectance or tint.
    pub base_color: [f32; 3],
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
    /// Refractive index.
    pub ior: f32,
    /// Absorption (1/length).
    pub absorption: [f32; 3],
    /// Emitted radiance, or its factor on that of the black body.
    pub emission: [f32; 3],
    /// Temperature of a black body (kelvin), 0 without one.
    pub temperature: f32,
    /// Whether both sides emit.
    pub two_sided: bool,
    /// Textures of base colour, roughness and emission.
    pub textures: [Option<usize>; 3],
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: "default".into(),
            kind: file::MaterialKind::Diffuse,
            base_color: [0.8; 3],
            roughness: 0.0,
            ior: 1.5,
            absorption: [0.0; 3],
            emission: [0.0; 3],
            temperature: 0.0,
            two_sided: true,
            textures: [None; 3],
        }
    }
}

/// Something that can be hit.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Index of the material.
    pub material: usize,
    /// Side of a wormhole it is on: 0 the camera's, 1 the far one.
    pub side: u32,
    /// Its form.
    pub geometry: Geometry,
}

/// The form of a shape.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A sphere.
    Sphere {
        /// Center.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// A box under an affine map.
    Box {
        /// Map from the unit cube to the world.
        world_from_unit: DMat4,
    },
    /// A parallelogram.
    Quad {
        /// A corner.
        corner: DVec3,
        /// One edge from it.
        u: DVec3,
        /// The other.
        v: DVec3,
    },
    /// A flat disc or ring.
    Disc {
        /// Center.
        center: DVec3,
        /// Unit normal.
        normal: DVec3,
        /// Inner radius.
        inner_radius: f64,
        /// Outer radius.
        outer_radius: f64,
    },
    /// A disc of matter on circular orbits; its material, made for it, has its temperature.
    AccretionDisc(AccretionDisc),
    /// Triangles.
    Mesh(Arc<mesh::Mesh>),
}

/// A thin disc of matter on circular orbits around the hole of the model, after Novikov and Thorne.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccretionDisc {
    /// Center.
    pub center: DVec3,
    /// Unit normal; matter turns about it in the positive sense.
    pub normal: DVec3,
    /// Inner circumferential (areal, Boyer-Lindquist) radius.
    pub inner_radius: f64,
    /// Outer circumferential radius.
    pub outer_radius: f64,
    /// Whether it hides what is behind it.
    pub opaque: bool,
}
