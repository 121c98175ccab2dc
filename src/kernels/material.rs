//! Scattering at surfaces: Lambert, GGX metal with energy compensation, smooth and rough dielectric.
//!
//! Directions point away from the surface, in the frame whose +Z is the shading normal on the side of `wo`. Values are
//! f * |cos wi| for radiance. GGX: Walter et al. 2007, visible normals sampled as Heitz (JCGT 2018). Metals regain the energy of
//! multiple scattering as in Turquin 2019, f (1 + F0 (1 - E) / E), E the directional albedo tabulated per scene. A smooth
//! dielectric is a delta lobe; its density is reported as 0 and it never mixes with light sampling.

use super::constants::*;
use super::sampling::{sample_cosine, sin_cos_turns};
use super::view::SceneView;
use crate::simd::{Lane, Vector, by_lane, store, vector};

/// A surface's scattering, with its textures resolved; or one per lane, all of one kind and all smooth or none.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf<L> {
    /// Reflectance or tint.
    pub color: Vector<L>,
    /// `MATERIAL_*`.
    pub kind: u32,
    /// GGX alpha; 0 is a smooth dielectric.
    pub alpha: L,
    /// Refractive index beyond the surface over that on the side of `wo`.
    pub eta: L,
    /// Directional albedo of the metal at `wo`.
    pub albedo: L,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample<L> {
    /// Direction the path goes on.
    pub wi: Vector<L>,
    /// Value over density, f |cos| / pdf; zero if nothing was sampled.
    pub weight: Vector<L>,
}

/// Reflectance of a dielectric interface for unpolarised light; `eta` is n beyond over n before. 1 beyond the critical angle.
#[inline(always)]
pub fn fresnel_dielectric<L: Lane<Real = f32>>(token: L::Token, cos_i: L, eta: L) -> L {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    let sin2_t = (one - cos_i * cos_i) / (eta * eta);
    let cos_t = (one - sin2_t).max(zero).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let reflected = L::splat(token, 0.5) * (parallel * parallel + perpendicular * perpendicular);
    L::select(sin2_t.lt(one), reflected, one)
}

/// Schlick's reflectance of a metal whose reflectance at normal incidence is `f0`.
#[inline(always)]
pub fn fresnel_schlick<L: Lane<Real = f32>>(token: L::Token, f0: Vector<L>, cos_i: L) -> Vector<L> {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    let m = (one - cos_i).max(zero).min(one);
    let m2 = m * m;
    f0 + (Vector::uniform(one) - f0) * (m2 * m2 * m)
}

/// GGX density of microfacet normals.
#[inline(always)]
pub fn ggx_distribution<L: Lane<Real = f32>>(token: L::Token, m: Vector<L>, alpha: L) -> L {
    let a2 = alpha * alpha;
    let d = (m.x * m.x + m.y * m.y) / a2 + m.z * m.z;
    L::splat(token, INV_PI) / (a2 * d * d)
}

/// Smith's Lambda for GGX.
#[inline(always)]
pub fn ggx_lambda<L: Lane<Real = f32>>(token: L::Token, w: Vector<L>, alpha: L) -> L {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z).max(L::splat(token, 1e-20));
    let one = L::splat(token, 1.0);
    L::splat(token, 0.5) * ((one + alpha * alpha * tan2).sqrt() - one)
}

/// Microfacet normal visible from `wo` (wo.z > 0), by its density G1 D max(0, wo.m) / wo.z.
#[inline(always)]
pub fn sample_visible_normal<L: Lane<Real = f32>>(token: L::Token, wo: Vector<L>, alpha: L, u: [L; 2]) -> Vector<L> {
    let c = |value: f32| L::splat(token, value);
    let (zero, one) = (c(0.0), c(1.0));
    let v = vector(wo.x * alpha, wo.y * alpha, wo.z).normalize(token);
    let length2 = v.x * v.x + v.y * v.y;
    let around = vector(-v.y, v.x, zero) * (one / length2.sqrt());
    let t1 = Vector::select(c(1e-14).lt(length2), around, vector(one, zero, zero));
    let t2 = v.cross(t1);
    let r = u[0].sqrt();
    let [sin, cos] = sin_cos_turns(token, u[1]);
    let p1 = r * cos;
    let s = c(0.5) * (one + v.z);
    let p2 = (one - s) * (one - p1 * p1).max(zero).sqrt() + s * r * sin;
    let m = t1 * p1 + t2 * p2 + v * (one - p1 * p1 - p2 * p2).max(zero).sqrt();
    vector(m.x * alpha, m.y * alpha, m.z.max(c(1e-7))).normalize(token)
}

/// Directional albedo of GGX with reflectance 1, from the table: columns by the root of the cosine, rows by roughness.
#[inline(always)]
pub fn ggx_albedo<L: Lane<Real = f32>>(token: L::Token, view: &SceneView, cos_o: L, roughness: L) -> L {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    let last = (ALBEDO_SIZE - 1) as f32;
    let x = cos_o.max(zero).min(one).sqrt() * L::splat(token, last);
    let y = roughness.max(zero).min(one) * L::splat(token, last);
    let x0 = x.floor().min(L::splat(token, last - 1.0));
    let y0 = y.floor().min(L::splat(token, last - 1.0));
    let (fx, fy) = (x - x0, y - y0);
    let at = store(y0 * L::splat(token, ALBEDO_SIZE as f32) + x0);
    let entry = |offset: u32| by_lane::<L>(token, |i| view.albedo(at[i] as u32 + offset));
    let lower = entry(0) * (one - fx) + entry(1) * fx;
    let upper = entry(ALBEDO_SIZE) * (one - fx) + entry(ALBEDO_SIZE + 1) * fx;
    lower * (one - fy) + upper * fy
}

/// Factor that gives a metal back its multiply scattered light.
#[inline(always)]
pub fn energy_compensation<L: Lane<Real = f32>>(token: L::Token, bsdf: &Bsdf<L>) -> Vector<L> {
    let one = L::splat(token, 1.0);
    Vector::uniform(one) + bsdf.color * ((one - bsdf.albedo) / bsdf.albedo)
}

/// Whether the surface scatters into a delta lobe only.
#[inline(always)]
pub fn is_delta<L: Lane<Real = f32>>(token: L::Token, bsdf: &Bsdf<L>) -> bool {
    bsdf.kind == MATERIAL_DIELECTRIC && L::bits(L::splat(token, 0.0).lt(bsdf.alpha)) == 0
}

/// Share of samples that go towards lights: none for mirrors, more for rougher lobes.
#[inline(always)]
pub fn light_share<L: Lane<Real = f32>>(token: L::Token, bsdf: &Bsdf<L>, most: f32) -> L {
    let most = L::splat(token, most);
    if bsdf.kind == MATERIAL_DIFFUSE {
        return most;
    }
    let share = most * (bsdf.alpha / L::splat(token, LIGHT_ALPHA)).min(L::splat(token, 1.0));
    L::select(bsdf.alpha.lt(L::splat(token, 10.0 * MIN_ALPHA)), L::splat(token, 0.0), share)
}

/// f |cos wi| and the density of `sample_bsdf` (1/sr) for a pair of directions.
#[inline(always)]
pub fn evaluate_bsdf<L: Lane<Real = f32>>(token: L::Token, bsdf: &Bsdf<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, L) {
    let c = |value: f32| L::splat(token, value);
    let (zero, one) = (c(0.0), c(1.0));
    if bsdf.kind == MATERIAL_DIFFUSE {
        let pdf = wi.z.max(zero) * c(INV_PI);
        return (bsdf.color * pdf, pdf);
    }
    if is_delta(token, bsdf) {
        return (Vector::uniform(zero), zero);
    }
    let seen = zero.lt(wo.z);
    let lambda_o = ggx_lambda(token, wo, bsdf.alpha);
    let lambda_i = ggx_lambda(token, wi, bsdf.alpha);
    let m = (wo + wi).normalize(token);
    let d = ggx_distribution(token, m, bsdf.alpha) / (c(4.0) * wo.z);
    let value = d / (one + lambda_o + lambda_i);
    let pdf = d / (one + lambda_o);
    let reflects = L::both(seen, zero.lt(wi.z));
    if bsdf.kind == MATERIAL_METALLIC {
        let reflectance = fresnel_schlick(token, bsdf.color, wo.dot(m)).scale(energy_compensation(token, bsdf));
        return (Vector::select(reflects, reflectance * value, Vector::uniform(zero)), L::select(reflects, pdf, zero));
    }
    let f = fresnel_dielectric(token, wo.dot(m), bsdf.eta);
    let reflected = (Vector::uniform(f * value), f * pdf);
    // Transmission: the half vector of Walter et al., turned to the side of wo.
    let half = (wo + wi * bsdf.eta).normalize(token);
    let m = Vector::select(half.z.lt(zero), -half, half);
    let cos_o = wo.dot(m);
    let cos_i = wi.dot(m);
    let f = fresnel_dielectric(token, cos_o, bsdf.eta);
    let d = ggx_distribution(token, m, bsdf.alpha);
    let denominator = cos_o + bsdf.eta * cos_i;
    let common = (one - f) * d * cos_o * -cos_i / (wo.z * denominator * denominator);
    let value = common / (one + lambda_o + lambda_i);
    let pdf = common * bsdf.eta * bsdf.eta / (one + lambda_o);
    let transmits = L::both(L::both(seen, wi.z.lt(zero)), L::both(zero.lt(cos_o), cos_i.lt(zero)));
    let transmitted = (Vector::select(transmits, bsdf.color * value, Vector::uniform(zero)), L::select(transmits, pdf, zero));
    (Vector::select(reflects, reflected.0, transmitted.0), L::select(reflects, reflected.1, transmitted.1))
}

/// Direction refracted at the facet `m`; zero beyond the critical angle.
#[inline(always)]
pub fn refract_at<L: Lane<Real = f32>>(token: L::Token, wo: Vector<L>, m: Vector<L>, eta: L) -> Vector<L> {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    let cos_o = wo.dot(m);
    let cos2_t = one - (one - cos_o * cos_o) / (eta * eta);
    let refracted = m * (cos_o / eta - cos2_t.sqrt()) - wo * (one / eta);
    Vector::select(zero.lt(cos2_t), refracted, Vector::uniform(zero))
}

/// Draws a direction by the surface's own lobes: `u` in the unit square, `lobe` chooses reflection or transmission.
#[inline(always)]
pub fn sample_bsdf<L: Lane<Real = f32>>(token: L::Token, bsdf: &Bsdf<L>, wo: Vector<L>, u: [L; 2], lobe: L) -> BsdfSample<L> {
    let (zero, one) = (L::splat(token, 0.0), L::splat(token, 1.0));
    if bsdf.kind == MATERIAL_DIFFUSE {
        return BsdfSample { wi: sample_cosine(token, u), weight: bsdf.color };
    }
    let up = vector(zero, zero, one);
    let delta = is_delta(token, bsdf);
    let metallic = bsdf.kind == MATERIAL_METALLIC;
    let m = if delta { up } else { sample_visible_normal(token, wo, bsdf.alpha, u) };
    let cos_o = wo.dot(m);
    let mut wi = m * (cos_o + cos_o) - wo;
    // Positive on the side where the direction must be.
    let mut height = wi.z;
    let mut tint = Vector::uniform(one);
    if metallic {
        tint = fresnel_schlick(token, bsdf.color, cos_o).scale(energy_compensation(token, bsdf));
    } else {
        let reflects = lobe.lt(fresnel_dielectric(token, cos_o, bsdf.eta));
        let refracted = refract_at(token, wo, m, bsdf.eta);
        height = L::select(reflects, wi.z, -refracted.z);
        wi = Vector::select(reflects, wi, refracted);
        // Radiance is compressed by the square of the relative index.
        tint = Vector::select(reflects, tint, bsdf.color * (one / (bsdf.eta * bsdf.eta)));
    }
    if !delta {
        let lambda_o = ggx_lambda(token, wo, bsdf.alpha);
        tint = tint * ((one + lambda_o) / (one + lambda_o + ggx_lambda(token, wi, bsdf.alpha)));
    }
    let drawn = L::both(zero.lt(wo.z), zero.lt(height));
    BsdfSample { wi: Vector::select(drawn, wi, up), weight: Vector::select(drawn, tint, Vector::uniform(zero)) }
}

/// Directional albedo of single-scattering GGX with reflectance 1, by quadrature over visible normals.
///
/// The light that is lost sits in the far tail of the normals (u.x near 1), so the rule u.x = 1 - t^3 is dense there.
pub fn integrate_ggx_albedo(cos_o: f32, alpha: f32) -> f32 {
    let cos_o = cos_o.max(1e-3);
    let wo = vector((1.0 - cos_o * cos_o).max(0.0).sqrt(), 0.0, cos_o);
    let (radii, turns) = (64, 16);
    let mut sum = 0.0;
    for i in 0..radii * turns {
        let t = ((i / turns) as f32 + 0.5) / radii as f32;
        let u = [1.0 - t * t * t, ((i % turns) as f32 + 0.5) / turns as f32];
        let m = sample_visible_normal((), wo, alpha, u);
        let wi = m * (2.0 * wo.dot(m)) - wo;
        if wi.z > 0.0 {
            let lambda_o = ggx_lambda((), wo, alpha);
            sum += 3.0 * t * t * (1.0 + lambda_o) / (1.0 + lambda_o + ggx_lambda((), wi, alpha));
        }
    }
    sum / (radii * turns) as f32
}
