//! One vertex of a path: what was hit, what it emits, where the path goes on.
//!
//! The next direction is drawn from a mixture of the surface's lobes and of directions towards lights, and weighted by the
//! density of the whole mixture over directions (with many lights: given the light that was chosen, as unbiased). Emission is
//! therefore always counted in full where a path meets it, and nothing needs to know whether the ray in between was straight.

use super::bvh::Hit;
use super::camera::{camera_ray, sample_filter};
use super::constants::*;
use super::layout::{Aov, Material, Vertex};
use super::light::{choose_light, environment_radiance, lights_pdf, sample_light};
use super::material::{Bsdf, evaluate_bsdf, ggx_albedo, is_delta, light_share, sample_bsdf};
use super::primitive::{primitive_normal, primitive_uv};
use super::rng::{pixel_seed, random_pair};
use super::sampling::{frame_from_world, world_from_frame};
use super::texture::sample_texture;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2, vec3};

/// A path between two rays.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    /// Where the next ray starts.
    pub origin: Vec3,
    /// Width of the ray's cone there.
    pub width: f32,
    /// Unit direction of the next ray.
    pub direction: Vec3,
    /// Growth of the cone (radians).
    pub spread: f32,
    /// Factor on whatever the path meets.
    pub throughput: Vec3,
    /// Scattering events so far.
    pub bounce: u32,
    /// Radiance gathered so far.
    pub radiance: Vec3,
    /// Dielectrics the path is inside of: material + 1 in 16-bit fields, the innermost lowest.
    pub media: [u32; 2],
    /// Frequency on the film over frequency at the start of the next ray, for the Eulerian observer there.
    pub frequency_ratio: f32,
    /// Side of a wormhole the path is on: 0 or 1.
    pub side: u32,
}

/// Where a ray ended.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// End point.
    pub position: Vec3,
    /// What was hit, see [`super::bvh::Hit`].
    pub primitive: u32,
    /// Unit direction of travel at the end, or at infinity if escaped.
    pub direction: Vec3,
    /// `STATUS_*`.
    pub status: u32,
    /// Surface coordinate of the hit.
    pub u: f32,
    /// Surface coordinate of the hit.
    pub v: f32,
    /// Coordinate length of the ray.
    pub path_length: f32,
    /// Frequency at the start over frequency at the end, for Eulerian observers and light travelling back along the ray.
    pub redshift: f32,
    /// Integration steps.
    pub steps: u32,
    /// Chords that were handed to the BVH.
    pub chords: u32,
    /// Relative drift of the conserved Hamiltonian.
    pub constraint_error: f32,
    /// Diagonal of the local frame L at a hit; see [`super::integrator::Model::frame`].
    pub frame_diagonal: Vec3,
    /// Its entries xy, xz, yz.
    pub frame_mixed: Vec3,
    /// Frequency at the end over that which orbiting matter there emits: 1 but for accretion discs.
    pub doppler: f32,
    /// Side of a wormhole the ray ended on.
    pub side: u32,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Position, recomputed on the surface itself.
    pub position: Vec3,
    /// Outward unit normal of the geometry.
    pub normal_geometric: Vec3,
    /// Interpolated unit normal.
    pub normal_shading: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Index into the objects.
    pub object: u32,
}

/// A camera path for sample `sample_index` of pixel (x, y).
#[inline(always)]
pub fn start_path(view: &SceneView, x: u32, y: u32, sample_index: u32) -> PathState {
    let scene = view.scene;
    let seed = pixel_seed(x, y);
    let offset = sample_filter(scene.filter_kind, random_pair(seed, 0, sample_index));
    let film = vec2(x as f32 + 0.5, y as f32 + 0.5) + offset;
    let lens = if scene.aperture_radius > 0.0 { random_pair(seed, 1, sample_index) } else { Vec2::ZERO };
    let (origin, direction, frequency_ratio) = camera_ray(scene, film, lens);
    PathState {
        origin,
        width: scene.cone_width,
        direction,
        spread: scene.pixel_spread,
        throughput: Vec3::ONE,
        bounce: 0,
        radiance: Vec3::ZERO,
        media: [0; 2],
        frequency_ratio,
        side: 0,
    }
}

#[inline(always)]
fn vertex_normal(vertex: &Vertex) -> Vec3 {
    Vec3::from(vertex.normal)
}

#[inline(always)]
fn vertex_uv(vertex: &Vertex) -> Vec2 {
    Vec2::from(vertex.uv)
}

/// A surface normal (a covector) as the local observer sees it: L n, normalised.
#[inline(always)]
pub fn local_normal(normal: Vec3, arrival: &Arrival) -> Vec3 {
    let (d, m) = (arrival.frame_diagonal, arrival.frame_mixed);
    let n = normal;
    vec3(d.x * n.x + m.x * n.y + m.y * n.z, m.x * n.x + d.y * n.y + m.z * n.z, m.y * n.x + m.z * n.y + d.z * n.z).normalize()
}

/// Geometry at a hit.
#[inline(always)]
pub fn surface_at(view: &SceneView, arrival: &Arrival) -> Surface {
    let (u, v) = (arrival.u, arrival.v);
    if arrival.primitive & HIT_PRIMITIVE != 0 {
        let primitive = view.primitive(arrival.primitive & CHILD_INDEX);
        let normal = primitive_normal(primitive, arrival.position);
        let mut uv = Vec2::ZERO;
        if (view.material(primitive.object).flags & MATERIAL_TEXTURED) != 0 {
            uv = primitive_uv(primitive, arrival.position, vec2(u, v));
        }
        // A far hit on a sphere has lost digits: put it back on the sphere.
        let d = &primitive.data;
        let position = if primitive.kind == PRIMITIVE_SPHERE { vec3(d[0], d[1], d[2]) + normal * d[3] } else { arrival.position };
        return Surface { position, normal_geometric: normal, normal_shading: normal, uv, object: primitive.object };
    }
    let block = view.block(arrival.primitive / 8);
    let lane = (arrival.primitive % 8) as usize;
    let at = |a: &[[f32; 8]; 3]| vec3(a[0][lane], a[1][lane], a[2][lane]);
    let (edge1, edge2) = (at(&block.edge1), at(&block.edge2));
    let triangle = view.triangle(block.triangle[lane]);
    let corners = triangle.vertices.map(|i| *view.vertex(i));
    let w = 1.0 - u - v;
    let geometric = edge1.cross(edge2).normalize();
    let mut shading = vertex_normal(&corners[0]) * w + vertex_normal(&corners[1]) * u + vertex_normal(&corners[2]) * v;
    let length2 = shading.length_squared();
    shading = if length2 > 1e-12 { shading * (1.0 / length2.sqrt()) } else { geometric };
    Surface {
        position: at(&block.vertex) + edge1 * u + edge2 * v,
        normal_geometric: geometric,
        normal_shading: shading,
        uv: vertex_uv(&corners[0]) * w + vertex_uv(&corners[1]) * u + vertex_uv(&corners[2]) * v,
        object: triangle.object,
    }
}

/// Innermost dielectric: its object material + 1, 0 in vacuum.
#[inline(always)]
pub fn media_top(media: [u32; 2]) -> u32 {
    media[0] & 0xffff
}

/// Enters dielectric `id`; the outermost of more than four is forgotten.
#[inline(always)]
pub fn media_push(media: [u32; 2], id: u32) -> [u32; 2] {
    [(media[0] << 16) | id, (media[1] << 16) | (media[0] >> 16)]
}

/// Leaves dielectric `id`, wherever in the stack it is.
#[inline(always)]
pub fn media_remove(media: [u32; 2], id: u32) -> [u32; 2] {
    let below = [(media[0] >> 16) | (media[1] << 16), media[1] >> 16];
    if media[0] & 0xffff == id {
        return below;
    }
    if media[0] >> 16 == id {
        return [(media[0] & 0xffff) | (media[1] << 16), media[1] >> 16];
    }
    if media[1] & 0xffff == id {
        return [media[0], media[1] >> 16];
    }
    if media[1] >> 16 == id {
        return [media[0], media[1] & 0xffff];
    }
    media
}

/// Refractive index of dielectric `id`, 1 for vacuum.
#[inline(always)]
pub fn media_ior(view: &SceneView, id: u32) -> f32 {
    if id == 0 { 1.0 } else { view.materials[id as usize - 1].ior }
}

/// Colour of a material at `uv`.
#[inline(always)]
pub fn base_color_at(view: &SceneView, material: &Material, uv: Vec2) -> Vec3 {
    let color = Vec3::from(material.base_color);
    if material.base_texture == NO_INDEX {
        return color;
    }
    let texel = sample_texture(view, material.base_texture, uv);
    color * vec3(texel.x, texel.y, texel.z)
}

/// Roughness of a material at `uv` (the green channel of its texture, as in glTF).
#[inline(always)]
pub fn roughness_at(view: &SceneView, material: &Material, uv: Vec2) -> f32 {
    if material.roughness_texture == NO_INDEX {
        return material.roughness;
    }
    material.roughness * sample_texture(view, material.roughness_texture, uv).y
}

/// Radiance of a black body of `temperature` (kelvin), in units in which the luminance at 6500 K is 1.
#[inline(always)]
pub fn black_body(view: &SceneView, temperature: f32) -> Vec3 {
    if temperature < BLACK_BODY_MIN {
        return Vec3::ZERO;
    }
    let last = (BLACK_BODY_SIZE - 1) as f32;
    let at = (temperature / BLACK_BODY_MIN).ln() / (BLACK_BODY_MAX / BLACK_BODY_MIN).ln() * last;
    let index = at.min(last - 1.0).floor();
    let low = view.black_body_entry(index as u32);
    let high = view.black_body_entry(index as u32 + 1);
    let entry = low + (high - low) * (at - index).min(1.0);
    // Beyond the table radiance grows in proportion to temperature (Rayleigh and Jeans).
    vec3(entry.x, entry.y, entry.z) * (entry.w.exp() * (temperature / BLACK_BODY_MAX).max(1.0))
}

/// Radiance a material emits at `uv`, its spectrum shifted by `frequency_ratio` (seen over emitted) if it is thermal: a black body
/// of temperature T is seen as one of temperature g T exactly.
#[inline(always)]
pub fn emission_at(view: &SceneView, material: &Material, uv: Vec2, frequency_ratio: f32) -> Vec3 {
    let mut emission = Vec3::from(material.emission);
    if material.temperature > 0.0 {
        emission *= black_body(view, material.temperature * frequency_ratio);
    }
    if material.emission_texture == NO_INDEX {
        return emission;
    }
    let texel = sample_texture(view, material.emission_texture, uv);
    emission * vec3(texel.x, texel.y, texel.z)
}

/// Temperature (as a share of the highest) and angular velocity of an accretion disc at `radius` from its center.
#[inline(always)]
pub fn disc_profile(view: &SceneView, material: &Material, radius: f32) -> Vec2 {
    let last = (DISC_PROFILE_SIZE - 1) as f32;
    let at = (radius - material.inner_radius) / (material.outer_radius - material.inner_radius) * last;
    let index = at.floor().clamp(0.0, last - 1.0);
    let low = view.profile_entry(material.profile + index as u32);
    let high = view.profile_entry(material.profile + index as u32 + 1);
    low + (high - low) * (at - index).clamp(0.0, 1.0)
}

/// Coordinate velocity dx/dt of the orbiting matter that was hit, if it was an accretion disc.
#[inline(always)]
pub fn matter_velocity(view: &SceneView, hit: &Hit, position: Vec3) -> Option<Vec3> {
    if hit.primitive == NO_INDEX || hit.primitive & HIT_PRIMITIVE == 0 {
        return None;
    }
    let primitive = view.primitive(hit.primitive & CHILD_INDEX);
    let material = view.material(primitive.object);
    if material.kind != MATERIAL_ACCRETION {
        return None;
    }
    let d = &primitive.data;
    let omega = disc_profile(view, material, hit.u).y;
    Some(vec3(d[4], d[5], d[6]).cross(position - vec3(d[0], d[1], d[2])) * omega)
}

/// Adds what the sky sends along an escaped ray.
#[inline(always)]
pub fn escape(view: &SceneView, path: &mut PathState, arrival: &Arrival) {
    if arrival.status == STATUS_ESCAPED {
        let environment = &view.scene.environment[arrival.side as usize];
        let mut radiance = environment_radiance(view, environment, arrival.direction);
        if environment.temperature > 0.0 {
            radiance *= black_body(view, environment.temperature * path.frequency_ratio * arrival.redshift);
        }
        path.radiance += path.throughput * radiance;
    }
}

/// Handles the hit at the end of a ray: emission, scattering, roulette. Returns whether the path goes on.
#[inline(always)]
pub fn shade(view: &SceneView, seed: u32, sample_index: u32, surface: &Surface, path: &mut PathState, arrival: &Arrival) -> bool {
    let scene = view.scene;
    let material_id = view.objects[surface.object as usize];
    let material = view.material(surface.object);

    // Absorb inside the dielectric that the ray crossed.
    let inside = media_top(path.media);
    if inside != 0 {
        let absorption = Vec3::from(view.materials[inside as usize - 1].absorption);
        path.throughput *= (-absorption * arrival.path_length).exp();
    }

    // See the surface in the frame of the local observer.
    let (mut outward, mut shading) = (surface.normal_geometric, surface.normal_shading);
    if scene.local_frames != 0 {
        outward = local_normal(outward, arrival);
        shading = local_normal(shading, arrival);
    }
    path.frequency_ratio *= arrival.redshift;
    path.side = arrival.side;

    // Count emission, on the outer side or on both.
    let wo = -arrival.direction;
    let outside = outward.dot(wo) > 0.0;
    let offset = ORIGIN_OFFSET * surface.position.abs().max_element() + scene.origin_offset;
    if material.kind == MATERIAL_ACCRETION {
        let hottest = material.temperature * disc_profile(view, material, arrival.u).x;
        let thermal = black_body(view, hottest * path.frequency_ratio * arrival.doppler);
        path.radiance += path.throughput * Vec3::from(material.emission) * thermal;
        if (material.flags & MATERIAL_OPAQUE) != 0 {
            return false;
        }
        // Light from behind passes as it came.
        path.origin = surface.position + surface.normal_geometric * if outside { -offset } else { offset };
        path.direction = arrival.direction;
        path.width += path.spread * arrival.path_length;
        return true;
    }
    if outside || (material.flags & MATERIAL_TWO_SIDED) != 0 {
        path.radiance += path.throughput * emission_at(view, material, surface.uv, path.frequency_ratio);
    }
    if material.kind == MATERIAL_EMISSIVE || path.bounce >= scene.max_depth {
        return false;
    }

    // Turn the normals to the side the ray came from.
    let geometric = if outside { outward } else { -outward };
    let mut normal = shading;
    normal = if normal.dot(geometric) < 0.0 { -normal } else { normal };
    normal = if normal.dot(wo) < 1e-4 { geometric } else { normal };
    let wo_local = frame_from_world(normal, wo);

    // Resolve the surface's scattering.
    let roughness = roughness_at(view, material, surface.uv);
    let mut bsdf = Bsdf {
        color: base_color_at(view, material, surface.uv),
        kind: material.kind,
        alpha: (roughness * roughness).max(MIN_ALPHA),
        eta: 1.0,
        albedo: 1.0,
    };
    let media_beyond = if outside { media_push(path.media, material_id + 1) } else { media_remove(path.media, material_id + 1) };
    if material.kind == MATERIAL_METALLIC {
        bsdf.albedo = ggx_albedo(view, wo_local.z, roughness);
    }
    if material.kind == MATERIAL_DIELECTRIC {
        let before = if outside { media_ior(view, inside) } else { material.ior };
        bsdf.eta = media_ior(view, media_top(media_beyond)) / before;
        // A boundary between equal indices is not there.
        bsdf.alpha = if roughness == 0.0 || bsdf.eta == 1.0 { 0.0 } else { bsdf.alpha };
    }

    // Draw a direction from the mixture.
    let first = CAMERA_PAIRS + path.bounce * BOUNCE_PAIRS;
    let direction = random_pair(seed, first + 1, sample_index);
    let roulette = path.bounce + 1 >= ROULETTE_BOUNCE;
    let mut lobe = Vec2::ZERO;
    if roulette || material.kind == MATERIAL_DIELECTRIC {
        lobe = random_pair(seed, first + 2, sample_index);
    }
    let share = if scene.light_count == 0 || is_delta(&bsdf) { 0.0 } else { light_share(&bsdf, scene.light_share) };
    let drawn = sample_bsdf(&bsdf, wo_local, direction, lobe.x);
    let mut wi = world_from_frame(normal, drawn.wi);
    let mut weight = drawn.weight;
    if share > 0.0 {
        let strategy = random_pair(seed, first, sample_index);
        let chosen = choose_light(view, strategy.y);
        if strategy.x < share {
            wi = sample_light(view, view.light(chosen), surface.position, direction);
        }
        let (value, pdf) = evaluate_bsdf(&bsdf, wo_local, frame_from_world(normal, wi));
        let density = share * lights_pdf(view, chosen, surface.position, wi) + (1.0 - share) * pdf;
        weight = if density > 0.0 { value * (1.0 / density) } else { Vec3::ZERO };
    }

    // The geometry must agree on whether the direction reflects or transmits.
    let reflects = wi.dot(normal) > 0.0;
    if (wi.dot(geometric) > 0.0) != reflects {
        return false;
    }
    let importance = (path.throughput * bsdf.color).max_element();
    path.throughput *= weight;
    let strongest = path.throughput.max_element();
    if strongest.is_nan() || strongest <= 0.0 {
        return false;
    }

    // Russian roulette, by what the path brings in all directions: towards a small light it brings little, but meets much. What a
    // dielectric compresses it gives back.
    if roulette {
        let index = media_ior(view, inside);
        let survival = (importance * index * index).clamp(MIN_SURVIVAL, MAX_SURVIVAL);
        if lobe.y >= survival {
            return false;
        }
        path.throughput *= 1.0 / survival;
    }

    // Leave the surface.
    if !reflects {
        path.media = media_beyond;
    }
    path.origin = surface.position + surface.normal_geometric * if reflects == outside { offset } else { -offset };
    path.direction = wi;
    path.width += path.spread * arrival.path_length;
    let scatter = if material.kind == MATERIAL_DIFFUSE { 1.0 } else { bsdf.alpha.min(1.0) };
    path.spread = path.spread.max(DIFFUSE_SPREAD * scatter);
    path.bounce += 1;
    true
}

/// AOVs of a camera ray that met a surface.
#[inline(always)]
pub fn hit_aov(view: &SceneView, surface: &Surface, arrival: &Arrival) -> Aov {
    let mut aov = miss_aov(arrival);
    aov.albedo = base_color_at(view, view.material(surface.object), surface.uv).into();
    aov.normal = surface.normal_shading.into();
    aov.position = surface.position.into();
    aov.object = surface.object + 1;
    aov
}

/// AOVs of a camera ray that met nothing.
#[inline(always)]
pub fn miss_aov(arrival: &Arrival) -> Aov {
    Aov {
        redshift: arrival.redshift * arrival.doppler,
        distance: arrival.path_length,
        constraint_error: arrival.constraint_error,
        status: arrival.status,
        steps: arrival.steps,
        chords: arrival.chords,
        ..Aov::default()
    }
}
