//! A scene compiled to the flat arrays that both backends read.

mod aim;
pub mod bvh;
mod clearance;
mod emitters;
mod region;
mod trace;

pub use region::{Reach, Region, sees};
pub use trace::{Stop, TraceOptions};

use crate::error::{Error, Result};
use crate::kernels::constants::*;
use crate::kernels::integrator::ModelBlock;
use crate::kernels::layout::*;
use crate::kernels::material::integrate_ggx_albedo;
use crate::kernels::tableau;
use crate::kernels::view::SceneView;
use crate::scene::file::MaterialKind;
use crate::scene::{AccretionDisc, CameraKind, Environment, Filter, Geometry, Hole, Method, Scene, Sky, Spacetime};
use crate::simd::Real;
use crate::spacetime::thermal::{black_body_table, disc_temperatures, keplerian};
use crate::spacetime::{Class, ModelKind};
use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Everything a backend needs of a scene, and nothing it does not.
#[derive(Clone, Debug)]
pub struct World {
    /// Everything that is not an array.
    pub scene: SceneParameters,
    /// Nodes of the BVH, the root first.
    pub nodes: Vec<BvhNode>,
    /// Triangles in groups of eight.
    pub blocks: Vec<TriangleBlock>,
    /// Attributes of triangles.
    pub triangles: Vec<Triangle>,
    /// Attributes of vertices.
    pub vertices: Vec<Vertex>,
    /// Analytic primitives.
    pub primitives: Vec<Primitive>,
    /// Material of each object.
    pub objects: Vec<u32>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Images.
    pub textures: Vec<Texture>,
    /// Pool of texels.
    pub texels: Vec<[u16; 4]>,
    /// Emitters.
    pub lights: Vec<Light>,
    /// By how much each light appears to be shifted and by what share larger, by level, cell and light; empty where space is straight, and
    /// where nothing is known.
    pub aims: Vec<[f32; 4]>,
    /// Cumulative distribution of the environment.
    pub environment_cdf: Vec<f32>,
    /// Clearance grid, the coarsest level first.
    pub clearance: Vec<u8>,
    /// Directional albedo of GGX.
    pub albedo: Vec<f32>,
    /// Black bodies by temperature.
    pub black_bodies: Vec<[f32; 4]>,
    /// Profiles of accretion discs: temperature as a share of the highest, angular velocity.
    pub profiles: Vec<[f32; 2]>,
    /// Which model bends the light.
    pub model: ModelKind,
    /// Whether the method of integration was left to the program.
    pub auto_method: bool,
    /// Its parameters.
    pub parameters: ModelBlock<f64>,
    /// The model as the scene states it.
    pub spacetime: Spacetime,
    /// Bounds of all geometry.
    pub bounds: (Vec3, Vec3),
    /// Whether nothing in the scene emits light.
    pub dark: bool,
}

impl World {
    /// Compiles a scene. Fails if it asks for more than the layout holds or puts the camera where no ray lives.
    pub fn compile(scene: &Scene) -> Result<World> {
        let _span = tracing::info_span!("compile", scene = %scene.path.display()).entered();
        // First, because all that follows takes its time.
        region::check_camera(scene)?;
        let mut world = World {
            scene: scene_parameters(scene),
            nodes: vec![],
            blocks: vec![],
            triangles: vec![],
            vertices: vec![],
            primitives: vec![],
            objects: scene.shapes.iter().map(|s| s.material as u32).collect(),
            materials: scene.materials.iter().map(compile_material).collect(),
            textures: vec![],
            texels: vec![],
            lights: vec![],
            aims: vec![],
            environment_cdf: vec![],
            // One cell on each level, without clearance, so that the grid is never an empty array.
            clearance: vec![0; GRID_LEVELS as usize],
            albedo: ALBEDO.clone(),
            black_bodies: BLACK_BODIES.clone(),
            profiles: vec![],
            model: scene.spacetime.model,
            auto_method: scene.integrator.auto,
            parameters: ModelBlock {
                step: scene.integrator.step,
                tableau: tableau::packed(method_number(scene)).to_vec(),
                ..region::block_of(&scene.spacetime)
            },
            spacetime: scene.spacetime.clone(),
            bounds: (Vec3::ZERO, Vec3::ZERO),
            dark: false,
        };
        if world.materials.len() >= 0xffff {
            return Err(Error::World(format!("{} materials, expected fewer than 65535", world.materials.len())));
        }
        for image in &scene.images {
            world.textures.push(Texture { first_index: world.texels.len() as u32, width: image.width, height: image.height });
            world.texels.extend_from_slice(&image.texels);
        }
        if world.texels.len() >= u32::MAX as usize {
            return Err(Error::World("more than 2^32 texels".into()));
        }
        let corners = world.add_shapes(scene)?;
        let sides: Vec<u32> = scene.shapes.iter().map(|s| s.side).collect();
        let bounds = bvh::build(&mut world, &corners, &sides)?;
        world.bounds = bounds;
        let region = region::of(&scene.spacetime, bounds, scene.camera.position.as_vec3());
        let camera_to_scene = (bounds.0.max(bounds.1) - bounds.0).length().min(1e6);
        world.scene.set_region(&region);
        world.scene.origin_offset = 1e-7 * camera_to_scene;
        if world.model != ModelKind::Flat {
            clearance::build(&mut world, &corners, bounds, &region);
        }
        drop(corners);
        emitters::add(&mut world, scene);
        aim::build(&mut world);
        Ok(world)
    }

    /// The parameters for another camera, another film or other tolerances of the same scene; the arrays stay, and with them the
    /// skies, the lights and the method of integration. Fails where no ray can start.
    pub fn parameters_for(&self, scene: &Scene) -> Result<SceneParameters> {
        let (width, height) = (scene.film.width, scene.film.height);
        if width == 0 || height == 0 {
            return Err(Error::World(format!("a film of {width} x {height} pixels, expected at least one")));
        }
        region::check_camera(scene)?;
        let own = &self.scene;
        let mut parameters = SceneParameters {
            far_root: own.far_root,
            environment: own.environment,
            grid_focus: own.grid_focus,
            grid_inverse_cell: own.grid_inverse_cell,
            grid_size: own.grid_size,
            grid_focus_cell: own.grid_focus_cell,
            grid_reach_low: own.grid_reach_low,
            grid_reach_high: own.grid_reach_high,
            bounds_low: own.bounds_low,
            bounds_high: own.bounds_high,
            aim_focus: own.aim_focus,
            aim_scale: own.aim_scale,
            origin_offset: own.origin_offset,
            method: own.method,
            literal_kick: own.literal_kick,
            local_frames: own.local_frames,
            light_count: own.light_count,
            light_share: own.light_share,
            ..scene_parameters(scene)
        };
        parameters.set_region(&region::of(&self.spacetime, self.bounds, scene.camera.position.as_vec3()));
        Ok(parameters)
    }

    /// The arrays, borrowed.
    pub fn view(&self) -> SceneView<'_> {
        SceneView {
            scene: &self.scene,
            nodes: &self.nodes,
            blocks: &self.blocks,
            triangles: &self.triangles,
            vertices: &self.vertices,
            primitives: &self.primitives,
            objects: &self.objects,
            materials: &self.materials,
            textures: &self.textures,
            texels: &self.texels,
            lights: &self.lights,
            aims: &self.aims,
            environment_cdf: &self.environment_cdf,
            clearance: &self.clearance,
            albedo: &self.albedo,
            black_bodies: &self.black_bodies,
            profiles: &self.profiles,
        }
    }

    /// The model's parameters in the precision of the integrator.
    pub fn model_block<T: Real>(&self) -> ModelBlock<T> {
        let convert = |values: &[f64]| values.iter().map(|&v| T::from_f64(v)).collect();
        ModelBlock {
            origin: self.parameters.origin.map(T::from_f64),
            throat: T::from_f64(self.parameters.throat),
            rim: T::from_f64(self.parameters.rim),
            step: T::from_f64(self.parameters.step),
            tableau: convert(&self.parameters.tableau),
            global: convert(&self.parameters.global),
            sources: convert(&self.parameters.sources),
            table: convert(&self.parameters.table),
        }
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        use std::mem::size_of_val;
        size_of_val(&self.nodes[..])
            + size_of_val(&self.blocks[..])
            + size_of_val(&self.triangles[..])
            + size_of_val(&self.vertices[..])
            + size_of_val(&self.primitives[..])
            + size_of_val(&self.texels[..])
            + size_of_val(&self.lights[..])
            + size_of_val(&self.aims[..])
            + size_of_val(&self.environment_cdf[..])
            + self.clearance.len()
    }

    /// Appends primitives, triangles and vertices; returns the corners of every triangle.
    fn add_shapes(&mut self, scene: &Scene) -> Result<Vec<[Vec3; 3]>> {
        let mut corners = Vec::new();
        for (object, shape) in scene.shapes.iter().enumerate() {
            let object = object as u32;
            let mut data = [0.0f32; 12];
            let kind = match &shape.geometry {
                Geometry::Sphere { center, radius } => {
                    data[..3].copy_from_slice(&center.as_vec3().to_array());
                    data[3] = *radius as f32;
                    PRIMITIVE_SPHERE
                }
                Geometry::Quad { corner, u, v } => {
                    for (i, vector) in [corner, u, v].into_iter().enumerate() {
                        data[3 * i..3 * i + 3].copy_from_slice(&vector.as_vec3().to_array());
                    }
                    data[9..].copy_from_slice(&u.cross(*v).normalize_or_zero().as_vec3().to_array());
                    PRIMITIVE_QUAD
                }
                Geometry::Box { world_from_unit } => {
                    let unit_from_world: DMat4 = world_from_unit.inverse();
                    for (i, value) in data.iter_mut().enumerate() {
                        *value = unit_from_world.row(i / 4)[i % 4] as f32;
                    }
                    PRIMITIVE_BOX
                }
                Geometry::Disc { center, normal, inner_radius, outer_radius } => {
                    data[..8].copy_from_slice(&disc_data(*center, *normal, *inner_radius, *outer_radius));
                    PRIMITIVE_DISC
                }
                Geometry::AccretionDisc(disc) => {
                    self.add_disc(disc, shape.material, scene.spacetime.hole, &mut data);
                    PRIMITIVE_DISC
                }
                Geometry::Mesh(mesh) => {
                    let first = self.vertices.len();
                    if first + mesh.positions.len() >= u32::MAX as usize
                        || self.triangles.len() + mesh.indices.len() >= CHILD_INDEX as usize
                    {
                        return Err(Error::World("more triangles than 2^30".into()));
                    }
                    let attribute = |values: &[[f32; 3]], i: usize| values.get(i).copied().unwrap_or([0.0; 3]);
                    self.vertices.extend(
                        (0..mesh.positions.len())
                            .map(|i| Vertex { normal: attribute(&mesh.normals, i), uv: mesh.uvs.get(i).copied().unwrap_or([0.0; 2]) }),
                    );
                    for t in &mesh.indices {
                        corners.push(t.map(|i| Vec3::from(mesh.positions[i as usize])));
                        self.triangles.push(Triangle { vertices: t.map(|i| i + first as u32), object });
                    }
                    continue;
                }
            };
            self.primitives.push(Primitive { data, kind, object, unused: [0; 2] });
        }
        Ok(corners)
    }
}

impl World {
    /// Fills in a disc's geometry, its material's numbers and its profile: uniform in the chart's distance from the axis.
    fn add_disc(&mut self, disc: &AccretionDisc, material: usize, hole: Option<Hole>, data: &mut [f32; 12]) {
        // Without a hole (light made straight by an option) the disc stays where it is.
        let hole = hole.unwrap_or(Hole { mass: 0.0, spin: 0.0, axis: disc.normal, isotropic: false });
        let (inner, outer) = (hole.chart_radius(disc.inner_radius), hole.chart_radius(disc.outer_radius));
        data[..8].copy_from_slice(&disc_data(disc.center, disc.normal, inner, outer));
        let last = f64::from(DISC_PROFILE_SIZE - 1);
        let spin = hole.spin_about(disc.normal);
        let radii: Vec<f64> =
            (0..DISC_PROFILE_SIZE).map(|i| hole.circumferential_radius(inner + (outer - inner) * f64::from(i) / last)).collect();
        let temperatures = if hole.mass > 0.0 { disc_temperatures(hole.mass, spin, &radii) } else { vec![1.0; radii.len()] };
        let target = &mut self.materials[material];
        target.profile = self.profiles.len() as u32;
        target.inner_radius = inner as f32;
        target.outer_radius = outer as f32;
        target.flags = MATERIAL_TWO_SIDED | if disc.opaque { MATERIAL_OPAQUE } else { 0 };
        self.profiles.extend(radii.iter().zip(temperatures).map(|(r, t)| [t, keplerian(*r, hole.mass, spin) as f32]));
    }
}

/// Data of a disc primitive.
fn disc_data(center: DVec3, normal: DVec3, inner: f64, outer: f64) -> [f32; 8] {
    let (c, n) = (center.as_vec3(), normal.as_vec3());
    [c.x, c.y, c.z, inner as f32, n.x, n.y, n.z, outer as f32]
}

impl SceneParameters {
    fn set_region(&mut self, region: &Region) {
        self.region_center = region.center.to_array();
        self.region_radius = region.radius;
        self.region_strength = region.strength;
        self.region_sharp = u32::from(region.sharp);
    }
}

fn compile_material(m: &crate::scene::Material) -> Material {
    let index = |t: Option<usize>| t.map_or(NO_INDEX, |i| i as u32);
    Material {
        base_color: m.base_color,
        kind: match m.kind {
            MaterialKind::Diffuse => MATERIAL_DIFFUSE,
            MaterialKind::Metallic => MATERIAL_METALLIC,
            MaterialKind::Dielectric => MATERIAL_DIELECTRIC,
            MaterialKind::Emissive => MATERIAL_EMISSIVE,
            MaterialKind::Accretion => MATERIAL_ACCRETION,
        },
        emission: m.emission,
        roughness: m.roughness,
        absorption: m.absorption,
        ior: m.ior,
        base_texture: index(m.textures[0]),
        roughness_texture: index(m.textures[1]),
        emission_texture: index(m.textures[2]),
        flags: if m.two_sided { MATERIAL_TWO_SIDED } else { 0 }
            | if m.textures.iter().any(Option::is_some) { MATERIAL_TEXTURED } else { 0 },
        temperature: m.temperature,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// Share of the distance to the target at which a camera ray's cone has its starting width.
const NEAR_SHARE: f64 = 0.05;

fn scene_parameters(scene: &Scene) -> SceneParameters {
    let camera = &scene.camera;
    let film = &scene.film;
    let single = |v: glam::DVec3| v.as_vec3().to_array();
    let tan_half_fov = (camera.fov_radians / 2.0).tan();
    let spread = match camera.kind {
        CameraKind::Perspective => 2.0 * tan_half_fov / f64::from(film.height),
        CameraKind::Panorama => std::f64::consts::PI / f64::from(film.height),
    };
    SceneParameters {
        camera_position: single(camera.position),
        tan_half_fov: tan_half_fov as f32,
        camera_right: single(camera.right),
        aspect: film.width as f32 / film.height as f32,
        camera_up: single(camera.up),
        aperture_radius: camera.aperture_radius as f32,
        camera_forward: single(camera.forward),
        focus_distance: camera.focus_distance as f32,
        camera_kind: if camera.kind == CameraKind::Panorama { CAMERA_PANORAMA } else { CAMERA_PERSPECTIVE },
        filter_kind: if film.filter == Filter::Box { FILTER_BOX } else { FILTER_GAUSSIAN },
        film_width: film.width,
        film_height: film.height,
        pixel_spread: spread as f32,
        cone_width: (spread * NEAR_SHARE * camera.focus_distance) as f32,
        tolerance: scene.integrator.tolerance as f32,
        chord_tolerance: scene.integrator.chord_tolerance as f32,
        max_steps: scene.integrator.max_steps,
        method: method_number(scene),
        literal_kick: u32::from(scene.spacetime.literal),
        local_frames: u32::from(scene.spacetime.model.class() == Class::Metric),
        camera_velocity: single(camera.velocity),
        max_depth: film.max_depth,
        environment: [environment_parameters(&scene.environment[0]), environment_parameters(&scene.environment[1])],
        light_share: if scene.spacetime.model == ModelKind::Flat { LIGHT_SHARE } else { BENT_LIGHT_SHARE },
        // Without a grid every lookup is in a cell without clearance, and anything may be met anywhere.
        grid_inverse_cell: 1.0,
        grid_size: [1; 3],
        bounds_low: [-FAR; 3],
        bounds_high: [FAR; 3],
        ..bytemuck::Zeroable::zeroed()
    }
}

/// The kernel that runs a method: media have their own Euler, Nystroem and leapfrog, all else runs from a tableau.
fn method_number(scene: &Scene) -> u32 {
    let medium = scene.spacetime.model.class() == Class::Medium;
    match scene.integrator.method {
        Method::Euler if medium => METHOD_EULER,
        Method::Nystrom => METHOD_NYSTROM,
        Method::Symplectic => METHOD_SYMPLECTIC,
        Method::Leapfrog => METHOD_LEAPFROG,
        Method::Euler => METHOD_EXPLICIT_EULER,
        Method::Rk4 => METHOD_RK4,
        Method::BogackiShampine => METHOD_BOGACKI_SHAMPINE,
        Method::DormandPrince | Method::Auto => METHOD_DORMAND_PRINCE,
    }
}

fn environment_parameters(sky: &Sky) -> EnvironmentParameters {
    let mut p = EnvironmentParameters { texture_index: NO_INDEX, temperature: sky.temperature, ..bytemuck::Zeroable::zeroed() };
    match &sky.environment {
        Environment::Constant(color) => {
            p.kind = ENVIRONMENT_CONSTANT;
            p.color = *color;
        }
        Environment::Gradient { zenith, horizon, nadir } => {
            p.kind = ENVIRONMENT_GRADIENT;
            (p.color, p.horizon, p.nadir) = (*zenith, *horizon, *nadir);
        }
        Environment::Grid { line, north, south, spacing, width } => {
            p.kind = ENVIRONMENT_GRID;
            (p.color, p.horizon, p.nadir) = (*line, *north, *south);
            (p.angle, p.scale) = (*spacing as f32, *width as f32);
        }
        Environment::Image { image, scale, rotation } => {
            p.kind = ENVIRONMENT_IMAGE;
            p.texture_index = *image as u32;
            (p.scale, p.angle) = (*scale, *rotation as f32);
        }
    }
    p
}

/// The same in every world.
static ALBEDO: LazyLock<Vec<f32>> = LazyLock::new(albedo_table);
static BLACK_BODIES: LazyLock<Vec<[f32; 4]>> =
    LazyLock::new(|| black_body_table(BLACK_BODY_SIZE as usize, f64::from(BLACK_BODY_MIN), f64::from(BLACK_BODY_MAX)));

/// Directional albedo of GGX with reflectance 1: rows of perceptual roughness, columns of the root of the cosine of the
/// viewing angle, because the albedo is steep at grazing angles.
fn albedo_table() -> Vec<f32> {
    let last = (ALBEDO_SIZE - 1) as f32;
    (0..ALBEDO_SIZE * ALBEDO_SIZE)
        .into_par_iter()
        .map(|i| {
            let roughness = (i / ALBEDO_SIZE) as f32 / last;
            integrate_ggx_albedo(((i % ALBEDO_SIZE) as f32 / last).powi(2), (roughness * roughness).max(MIN_ALPHA))
        })
        .collect()
}
