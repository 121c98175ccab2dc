//! One vertex of a path: what was hit, what it emits, where the path goes on.
//!
//! The next direction is drawn from a mixture of the surface's lobes and of directions towards lights, and weighted by the
//! density of the whole mixture over directions (with many lights: given the light that was chosen, as unbiased). Emission is
//! therefore always counted in full where a path meets it, and nothing needs to know whether the ray in between was straight.

use super::camera::{camera_ray, sample_filter};
use super::constants::*;
use super::layout::Aov;
use super::light::{Vantage, environment_radiance, lights_pdf, sample_lights};
use super::material::{Bsdf, evaluate_bsdf, ggx_albedo, is_delta, light_share, sample_bsdf};
use super::rng::{pixel_seed, random_pairs};
use super::sampling::{frame_from_world, world_from_frame};
use super::surface::{Arrival, Surface, base_color_at, black_body, disc_profile, emission_at, local_normal, roughness_at};
use super::view::SceneView;
use crate::simd::{Lane, MAX_LANES, Vector, by_lane, store};
use glam::{Vec3, vec3};

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

/// What a ray meets at its end.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "it is taken apart at once")]
pub enum Meeting {
    /// The path ends here.
    Ends,
    /// The path goes on as it came.
    Passes,
    /// The path goes on in a direction that is to be drawn.
    Scatters(Encounter),
}

/// A path at a surface that scatters it, as the local observer sees it.
#[derive(Clone, Copy, Debug)]
pub struct Encounter {
    /// What the next direction depends on.
    pub scattering: Scattering<f32>,
    /// Whether the path came from outside.
    pub outside: bool,
    /// Way off the surface to the side the path came from, in the world.
    pub offset: Vec3,
    /// Dielectrics the path is inside of if it is transmitted.
    pub media_beyond: [u32; 2],
}

/// What the next direction of a path depends on, or of one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Scattering<L> {
    /// Position in the world.
    pub position: Vector<L>,
    /// Outward unit normal of the geometry.
    pub outward: Vector<L>,
    /// Interpolated unit normal.
    pub shading: Vector<L>,
    /// Unit direction back along the path.
    pub wo: Vector<L>,
    /// What scatters; the albedo is not known yet.
    pub bsdf: Bsdf<L>,
}

impl<L: Lane<Real = f32>> Scattering<L> {
    /// One per lane; their surfaces are of one kind, and all smooth or none.
    #[inline(always)]
    pub fn by_lane<'a>(token: L::Token, of_lane: impl Fn(usize) -> &'a Scattering<f32>) -> Self {
        Scattering {
            position: Vector::by_lane(token, |i| of_lane(i).position),
            outward: Vector::by_lane(token, |i| of_lane(i).outward),
            shading: Vector::by_lane(token, |i| of_lane(i).shading),
            wo: Vector::by_lane(token, |i| of_lane(i).wo),
            bsdf: Bsdf {
                color: Vector::by_lane(token, |i| of_lane(i).bsdf.color),
                kind: of_lane(0).bsdf.kind,
                alpha: by_lane(token, |i| of_lane(i).bsdf.alpha),
                eta: by_lane(token, |i| of_lane(i).bsdf.eta),
                albedo: by_lane(token, |i| of_lane(i).bsdf.albedo),
            },
        }
    }
}

/// Random numbers of a bounce.
#[derive(Clone, Copy, Debug)]
pub struct BouncePairs<L> {
    /// Whether to aim at a light, at which of a few, and the direction: shares of one pair, so that the directions of each kind are as
    /// evenly spread as the pairs are.
    pub direction: [L; 2],
    /// Reflection or transmission, and the path's survival.
    pub lobe: [L; 2],
    /// Which of many lights, see `MAX_SUMMED_LIGHTS`.
    pub choice: L,
}

/// A direction drawn, or one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Draw<L> {
    /// The unit direction the path takes.
    pub wi: Vector<L>,
    /// Factor on its throughput.
    pub weight: Vector<L>,
}

/// Camera paths for sample `sample_index` of the pixel of each lane, handed to `start` one by one.
#[inline(always)]
pub fn start_path<L: Lane<Real = f32>>(
    token: L::Token,
    view: &SceneView,
    pixel: impl Fn(usize) -> (u32, u32),
    sample_index: u32,
    mut start: impl FnMut(usize, PathState),
) {
    let scene = view.scene;
    let (mut seeds, mut corner) = ([0; MAX_LANES], [[0.0; MAX_LANES]; 2]);
    for lane in 0..L::LANES {
        let (x, y) = pixel(lane);
        seeds[lane] = pixel_seed(x, y);
        (corner[0][lane], corner[1][lane]) = (x as f32, y as f32);
    }
    let pairs = |pair| random_pairs::<L>(token, &seeds, &[pair; MAX_LANES], sample_index);
    let half = L::splat(token, 0.5);
    let offset = sample_filter(token, scene.filter_kind, pairs(0));
    let film = [L::load(token, &corner[0]) + half + offset[0], L::load(token, &corner[1]) + half + offset[1]];
    let lens = if scene.aperture_radius > 0.0 { pairs(1) } else { [L::splat(token, 0.0); 2] };
    let (origin, direction, frequency_ratio) = camera_ray(token, scene, film, lens);
    let (origin, direction, frequency_ratio) = (origin.rows(), direction.rows(), store(frequency_ratio));
    for lane in 0..L::LANES {
        let at = |rows: &[[f32; MAX_LANES]; 3]| vec3(rows[0][lane], rows[1][lane], rows[2][lane]);
        let path = PathState {
            origin: at(&origin),
            width: scene.cone_width,
            direction: at(&direction),
            spread: scene.pixel_spread,
            throughput: Vec3::ONE,
            bounce: 0,
            radiance: Vec3::ZERO,
            media: [0; 2],
            frequency_ratio: frequency_ratio[lane],
            side: 0,
        };
        start(lane, path);
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

/// Handles the hit at the end of a ray up to the scattering: absorption, emission, what lets light pass. The path goes on only if
/// what is met scatters, or lets it pass.
#[inline(always)]
pub fn meet_surface(view: &SceneView, surface: &Surface, path: &mut PathState, arrival: &Arrival) -> Meeting {
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
    path.width += path.spread * arrival.path_length;

    // Count emission, on the outer side or on both.
    let wo = -arrival.direction;
    let outside = outward.dot(wo) > 0.0;
    let distance = ORIGIN_OFFSET * surface.position.abs().max_element() + scene.origin_offset;
    let offset = surface.normal_geometric * if outside { distance } else { -distance };
    if material.kind == MATERIAL_ACCRETION {
        let hottest = material.temperature * disc_profile(view, material, arrival.u).x;
        let thermal = black_body(view, hottest * path.frequency_ratio * arrival.doppler);
        path.radiance += path.throughput * Vec3::from(material.emission) * thermal;
        if (material.flags & MATERIAL_OPAQUE) != 0 {
            return Meeting::Ends;
        }
        // Light from behind passes as it came.
        path.origin = surface.position - offset;
        path.direction = arrival.direction;
        return Meeting::Passes;
    }
    if outside || (material.flags & MATERIAL_TWO_SIDED) != 0 {
        path.radiance += path.throughput * emission_at(view, material, surface.uv, path.frequency_ratio);
    }
    if material.kind == MATERIAL_EMISSIVE || path.bounce >= scene.max_depth {
        return Meeting::Ends;
    }

    // Resolve the surface's scattering.
    let roughness = roughness_at(view, material, surface.uv);
    let mut bsdf = Bsdf {
        color: base_color_at(view, material, surface.uv).into(),
        kind: material.kind,
        alpha: (roughness * roughness).max(MIN_ALPHA),
        eta: 1.0,
        albedo: 1.0,
    };
    let media_beyond = if outside { media_push(path.media, material_id + 1) } else { media_remove(path.media, material_id + 1) };
    if material.kind == MATERIAL_DIELECTRIC {
        let before = if outside { media_ior(view, inside) } else { material.ior };
        bsdf.eta = media_ior(view, media_top(media_beyond)) / before;
        // A boundary between equal indices is not there.
        bsdf.alpha = if roughness == 0.0 || bsdf.eta == 1.0 { 0.0 } else { bsdf.alpha };
    }
    let scattering =
        Scattering { position: surface.position.into(), outward: outward.into(), shading: shading.into(), wo: wo.into(), bsdf };
    Meeting::Scatters(Encounter { scattering, outside, offset, media_beyond })
}

/// Draws a direction from the mixture, and the weight of the path in it: zero where the geometry does not let it go.
#[inline(always)]
pub fn draw_direction<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, at: &Scattering<L>, random: &BouncePairs<L>) -> Draw<L> {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    // Turn the normals to the side the path came from.
    let geometric = Vector::select(zero.lt(at.outward.dot(at.wo)), at.outward, -at.outward);
    let facing = Vector::select(at.shading.dot(geometric).lt(zero), -at.shading, at.shading);
    let normal = Vector::select(facing.dot(at.wo).lt(L::splat(token, 1e-4)), geometric, facing);
    let wo = frame_from_world(token, normal, at.wo);
    let mut bsdf = at.bsdf;
    if bsdf.kind == MATERIAL_METALLIC {
        bsdf.albedo = ggx_albedo(token, view, wo.z, bsdf.alpha.sqrt());
    }

    let lit = view.scene.light_count > 0 && !is_delta(token, &bsdf);
    let share = if lit { light_share(token, &bsdf, view.scene.light_share) } else { zero };
    let [x, y] = random.direction;
    let own = [(x - share) / (one - share), y];
    let drawn = sample_bsdf(token, &bsdf, wo, own, random.lobe[0]);
    let mut wi = world_from_frame(token, normal, drawn.wi);
    let mut weight = drawn.weight;
    if lit {
        let aimed = x.lt(share);
        let from = Vantage::new(view, at.position);
        wi = Vector::select(aimed, sample_lights(token, view, aimed, random.choice, &from, [x / share, y]), wi);
        let (value, pdf) = evaluate_bsdf(token, &bsdf, wo, frame_from_world(token, normal, wi));
        let density = share * lights_pdf(token, view, random.choice, &from, wi) + (one - share) * pdf;
        let mixed = Vector::select(zero.lt(density), value * (one / density), Vector::uniform(zero));
        weight = Vector::select(zero.lt(share), mixed, weight);
    }

    // The geometry must agree on whether the direction reflects or transmits: the sign of one is that of the other.
    let agree = zero.lt(wi.dot(normal) * wi.dot(geometric));
    Draw { wi, weight: Vector::select(agree, weight, Vector::uniform(zero)) }
}

/// Sends the path on in a direction that was drawn: roulette, by `chance` uniform in [0, 1), and the start of the next ray. Returns
/// whether it goes on.
#[inline(always)]
pub fn leave_surface(view: &SceneView, path: &mut PathState, at: &Encounter, draw: &Draw<f32>, chance: f32) -> bool {
    let importance = (path.throughput * Vec3::from(at.scattering.bsdf.color)).max_element();
    path.throughput *= Vec3::from(draw.weight);
    let strongest = path.throughput.max_element();
    if strongest.is_nan() || strongest <= 0.0 {
        return false;
    }

    // Russian roulette, by what the path brings in all directions: towards a small light it brings little, but meets much. What a
    // dielectric compresses it gives back.
    path.bounce += 1;
    if path.bounce >= ROULETTE_BOUNCE {
        let index = media_ior(view, media_top(path.media));
        let survival = (importance * index * index).clamp(MIN_SURVIVAL, MAX_SURVIVAL);
        if chance >= survival {
            return false;
        }
        path.throughput *= 1.0 / survival;
    }

    // Leave the surface.
    let reflects = (draw.wi.dot(at.scattering.outward) > 0.0) == at.outside;
    if !reflects {
        path.media = at.media_beyond;
    }
    path.origin = Vec3::from(at.scattering.position) + if reflects { at.offset } else { -at.offset };
    path.direction = draw.wi.into();
    let bsdf = &at.scattering.bsdf;
    let scatter = if bsdf.kind == MATERIAL_DIFFUSE { 1.0 } else { bsdf.alpha.min(1.0) };
    path.spread = path.spread.max(DIFFUSE_SPREAD * scatter);
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
