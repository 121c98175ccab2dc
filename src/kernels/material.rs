//! Scattering at surfaces: Lambert, GGX metal with energy compensation, smooth and rough dielectric.
//!
//! Directions point away from the surface, in the frame whose +Z is the shading normal on the side of `wo`. Values are
//! f * |cos wi| for radiance. GGX: Walter et al. 2007, visible normals sampled as Heitz (JCGT 2018). Metals regain the energy of
//! multiple scattering as in Turquin 2019, f (1 + F0 (1 - E) / E), E the directional albedo tabulated per scene. A smooth
//! dielectric is a delta lobe; its density is reported as 0 and it never mixes with light sampling.

use super::constants::*;
use super::sampling::sin_cos_turns;
use super::view::SceneView;
use glam::{Vec2, Vec3, vec2, vec3};

/// A surface's scattering, with its textures resolved.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    /// Reflectance or tint.
    pub color: Vec3,
    /// `MATERIAL_*`.
    pub kind: u32,
    /// GGX alpha; 0 is a smooth dielectric.
    pub alpha: f32,
    /// Refractive index beyond the surface over that on the side of `wo`.
    pub eta: f32,
    /// Directional albedo of the metal at `wo`.
    pub albedo: f32,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Direction the path goes on.
    pub wi: Vec3,
    /// Value over density, f |cos| / pdf; zero if nothing was sampled.
    pub weight: Vec3,
    /// Whether the direction comes from a delta lobe.
    pub delta: bool,
}

/// Reflectance of a dielectric interface for unpolarised light; `eta` is n beyond over n before. 1 beyond the critical angle.
#[inline(always)]
pub fn fresnel_dielectric(cos_i: f32, eta: f32) -> f32 {
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Schlick's reflectance of a metal whose reflectance at normal incidence is `f0`.
#[inline(always)]
pub fn fresnel_schlick(f0: Vec3, cos_i: f32) -> Vec3 {
    let m = (1.0 - cos_i).clamp(0.0, 1.0);
    let m2 = m * m;
    f0 + (Vec3::ONE - f0) * (m2 * m2 * m)
}

/// GGX density of microfacet normals.
#[inline(always)]
pub fn ggx_distribution(m: Vec3, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = (m.x * m.x + m.y * m.y) / a2 + m.z * m.z;
    INV_PI / (a2 * d * d)
}

/// Smith's Lambda for GGX.
#[inline(always)]
pub fn ggx_lambda(w: Vec3, alpha: f32) -> f32 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z).max(1e-20);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Microfacet normal visible from `wo` (wo.z > 0), by its density G1 D max(0, wo.m) / wo.z.
#[inline(always)]
pub fn sample_visible_normal(wo: Vec3, alpha: f32, u: Vec2) -> Vec3 {
    let v = vec3(wo.x * alpha, wo.y * alpha, wo.z).normalize();
    let length2 = v.x * v.x + v.y * v.y;
    let t1 = if length2 > 1e-14 { vec3(-v.y, v.x, 0.0) * (1.0 / length2.sqrt()) } else { vec3(1.0, 0.0, 0.0) };
    let t2 = v.cross(t1);
    let r = u.x.sqrt();
    let sin_cos = sin_cos_turns(u.y);
    let p1 = r * sin_cos.y;
    let s = 0.5 * (1.0 + v.z);
    let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * r * sin_cos.x;
    let m = t1 * p1 + t2 * p2 + v * (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
    vec3(m.x * alpha, m.y * alpha, m.z.max(1e-7)).normalize()
}

/// Directional albedo of GGX with reflectance 1, from the table: columns by the root of the cosine, rows by roughness.
#[inline(always)]
pub fn ggx_albedo(view: &SceneView, cos_o: f32, roughness: f32) -> f32 {
    let last = (ALBEDO_SIZE - 1) as f32;
    let x = cos_o.clamp(0.0, 1.0).sqrt() * last;
    let y = roughness.clamp(0.0, 1.0) * last;
    let x0 = x.floor().min(last - 1.0);
    let y0 = y.floor().min(last - 1.0);
    let (fx, fy) = (x - x0, y - y0);
    let at = y0 as u32 * ALBEDO_SIZE + x0 as u32;
    let lower = view.albedo(at) * (1.0 - fx) + view.albedo(at + 1) * fx;
    let upper = view.albedo(at + ALBEDO_SIZE) * (1.0 - fx) + view.albedo(at + ALBEDO_SIZE + 1) * fx;
    lower * (1.0 - fy) + upper * fy
}

/// Factor that gives a metal back its multiply scattered light.
#[inline(always)]
pub fn energy_compensation(bsdf: &Bsdf) -> Vec3 {
    Vec3::ONE + bsdf.color * ((1.0 - bsdf.albedo) / bsdf.albedo)
}

/// Whether the surface scatters into a delta lobe only.
#[inline(always)]
pub fn is_delta(bsdf: &Bsdf) -> bool {
    bsdf.kind == MATERIAL_DIELECTRIC && bsdf.alpha == 0.0
}

/// Share of samples that go towards lights: none for mirrors, more for rougher lobes.
#[inline(always)]
pub fn light_share(bsdf: &Bsdf, most: f32) -> f32 {
    if bsdf.kind == MATERIAL_DIFFUSE {
        return most;
    }
    let share = most * (bsdf.alpha / LIGHT_ALPHA).min(1.0);
    if bsdf.alpha < 10.0 * MIN_ALPHA { 0.0 } else { share }
}

/// f |cos wi| and the density of `sample_bsdf` (1/sr) for a pair of directions.
#[inline(always)]
pub fn evaluate_bsdf(bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
    if bsdf.kind == MATERIAL_DIFFUSE {
        let cosine = wi.z.max(0.0);
        return (bsdf.color * (cosine * INV_PI), cosine * INV_PI);
    }
    if is_delta(bsdf) || wo.z <= 0.0 {
        return (Vec3::ZERO, 0.0);
    }
    let lambda_o = ggx_lambda(wo, bsdf.alpha);
    let lambda_i = ggx_lambda(wi, bsdf.alpha);
    if wi.z > 0.0 {
        let m = (wo + wi).normalize();
        let d = ggx_distribution(m, bsdf.alpha);
        let value = d / (4.0 * wo.z * (1.0 + lambda_o + lambda_i));
        let pdf = d / (4.0 * wo.z * (1.0 + lambda_o));
        if bsdf.kind == MATERIAL_METALLIC {
            return (fresnel_schlick(bsdf.color, wo.dot(m)) * energy_compensation(bsdf) * value, pdf);
        }
        let f = fresnel_dielectric(wo.dot(m), bsdf.eta);
        return (Vec3::splat(f * value), f * pdf);
    }
    if bsdf.kind == MATERIAL_METALLIC || wi.z == 0.0 {
        return (Vec3::ZERO, 0.0);
    }
    // Transmission: the half vector of Walter et al., turned to the side of wo.
    let mut m = (wo + wi * bsdf.eta).normalize();
    if m.z < 0.0 {
        m = -m;
    }
    let cos_o = wo.dot(m);
    let cos_i = wi.dot(m);
    if cos_o <= 0.0 || cos_i >= 0.0 {
        return (Vec3::ZERO, 0.0);
    }
    let f = fresnel_dielectric(cos_o, bsdf.eta);
    let d = ggx_distribution(m, bsdf.alpha);
    let denominator = cos_o + bsdf.eta * cos_i;
    let common = (1.0 - f) * d * cos_o * -cos_i / (wo.z * denominator * denominator);
    let value = common / (1.0 + lambda_o + lambda_i);
    let pdf = common * bsdf.eta * bsdf.eta / (1.0 + lambda_o);
    (bsdf.color * value, pdf)
}

/// Direction refracted at the facet `m`; zero beyond the critical angle.
#[inline(always)]
pub fn refract_at(wo: Vec3, m: Vec3, eta: f32) -> Vec3 {
    let cos_o = wo.dot(m);
    let cos2_t = 1.0 - (1.0 - cos_o * cos_o) / (eta * eta);
    if cos2_t <= 0.0 {
        return Vec3::ZERO;
    }
    m * (cos_o / eta - cos2_t.sqrt()) - wo * (1.0 / eta)
}

/// Draws a direction by the surface's own lobes: `u` in the unit square, `lobe` chooses reflection or transmission.
#[inline(always)]
pub fn sample_bsdf(bsdf: &Bsdf, wo: Vec3, u: Vec2, lobe: f32) -> BsdfSample {
    let nothing = BsdfSample { wi: Vec3::Z, weight: Vec3::ZERO, delta: false };
    if bsdf.kind == MATERIAL_DIFFUSE {
        return BsdfSample { wi: super::sampling::sample_cosine(u), weight: bsdf.color, delta: false };
    }
    if wo.z <= 0.0 {
        return nothing;
    }
    let delta = is_delta(bsdf);
    let m = if delta { Vec3::Z } else { sample_visible_normal(wo, bsdf.alpha, u) };
    let cos_o = wo.dot(m);
    let lambda_o = ggx_lambda(wo, bsdf.alpha);
    let mut wi = m * (2.0 * cos_o) - wo;
    let f = fresnel_dielectric(cos_o, bsdf.eta);
    let metallic = bsdf.kind == MATERIAL_METALLIC;
    let reflects = metallic || lobe < f;
    if !reflects {
        wi = refract_at(wo, m, bsdf.eta);
    }
    if if reflects { wi.z <= 0.0 } else { wi.z >= 0.0 } {
        return nothing;
    }
    let shadowing = if delta { 1.0 } else { (1.0 + lambda_o) / (1.0 + lambda_o + ggx_lambda(wi, bsdf.alpha)) };
    let mut weight = Vec3::splat(shadowing);
    if metallic {
        weight *= fresnel_schlick(bsdf.color, cos_o) * energy_compensation(bsdf);
    } else if !reflects {
        // Radiance is compressed by the square of the relative index.
        weight *= bsdf.color / (bsdf.eta * bsdf.eta);
    }
    BsdfSample { wi, weight, delta }
}

/// Directional albedo of single-scattering GGX with reflectance 1, by quadrature over visible normals.
///
/// The light that is lost sits in the far tail of the normals (u.x near 1), so the rule u.x = 1 - t^3 is dense there.
pub fn integrate_ggx_albedo(cos_o: f32, alpha: f32) -> f32 {
    let cos_o = cos_o.max(1e-3);
    let wo = vec3((1.0 - cos_o * cos_o).max(0.0).sqrt(), 0.0, cos_o);
    let (radii, turns) = (64, 16);
    let mut sum = 0.0;
    for i in 0..radii * turns {
        let t = ((i / turns) as f32 + 0.5) / radii as f32;
        let u = vec2(1.0 - t * t * t, ((i % turns) as f32 + 0.5) / turns as f32);
        let m = sample_visible_normal(wo, alpha, u);
        let wi = m * (2.0 * wo.dot(m)) - wo;
        if wi.z > 0.0 {
            let lambda_o = ggx_lambda(wo, alpha);
            sum += 3.0 * t * t * (1.0 + lambda_o) / (1.0 + lambda_o + ggx_lambda(wi, alpha));
        }
    }
    sum / (radii * turns) as f32
}
