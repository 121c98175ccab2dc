// Scattering at surfaces; documented in src/kernels/material.rs.

struct Bsdf {
    vec3 color;
    uint kind;
    float alpha;
    float eta;
    float albedo;
};

struct BsdfSample {
    vec3 wi;
    vec3 weight;
};

float fresnel_dielectric(float cos_i, float eta) {
    float sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if (sin2_t >= 1.0) {
        return 1.0;
    }
    float cos_t = sqrt(1.0 - sin2_t);
    float parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    float perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

vec3 fresnel_schlick(vec3 f0, float cos_i) {
    float m = clamp(1.0 - cos_i, 0.0, 1.0);
    float m2 = m * m;
    return f0 + (vec3(1.0) - f0) * (m2 * m2 * m);
}

float ggx_distribution(vec3 m, float alpha) {
    float a2 = alpha * alpha;
    float d = (m.x * m.x + m.y * m.y) / a2 + m.z * m.z;
    return INV_PI / (a2 * d * d);
}

float ggx_lambda(vec3 w, float alpha) {
    float tan2 = (w.x * w.x + w.y * w.y) / max(w.z * w.z, 1e-20);
    return 0.5 * (sqrt(1.0 + alpha * alpha * tan2) - 1.0);
}

vec3 sample_visible_normal(vec3 wo, float alpha, vec2 u) {
    vec3 v = normalize(vec3(wo.x * alpha, wo.y * alpha, wo.z));
    float length2 = v.x * v.x + v.y * v.y;
    vec3 t1 = length2 > 1e-14 ? vec3(-v.y, v.x, 0.0) * (1.0 / sqrt(length2)) : vec3(1.0, 0.0, 0.0);
    vec3 t2 = cross(v, t1);
    float r = sqrt(u.x);
    vec2 sin_cos = sin_cos_turns(u.y);
    float p1 = r * sin_cos.y;
    float s = 0.5 * (1.0 + v.z);
    float p2 = (1.0 - s) * sqrt(max(1.0 - p1 * p1, 0.0)) + s * r * sin_cos.x;
    vec3 m = t1 * p1 + t2 * p2 + v * sqrt(max(1.0 - p1 * p1 - p2 * p2, 0.0));
    return normalize(vec3(m.x * alpha, m.y * alpha, max(m.z, 1e-7)));
}

float ggx_albedo(float cos_o, float roughness) {
    float last = float(ALBEDO_SIZE - 1);
    float x = sqrt(clamp(cos_o, 0.0, 1.0)) * last;
    float y = clamp(roughness, 0.0, 1.0) * last;
    float x0 = min(floor(x), last - 1.0);
    float y0 = min(floor(y), last - 1.0);
    float fx = x - x0, fy = y - y0;
    uint at = uint(y0) * ALBEDO_SIZE + uint(x0);
    float lower = albedo(at) * (1.0 - fx) + albedo(at + 1) * fx;
    float upper = albedo(at + ALBEDO_SIZE) * (1.0 - fx) + albedo(at + ALBEDO_SIZE + 1) * fx;
    return lower * (1.0 - fy) + upper * fy;
}

vec3 energy_compensation(Bsdf bsdf) {
    return vec3(1.0) + bsdf.color * ((1.0 - bsdf.albedo) / bsdf.albedo);
}

bool is_delta(Bsdf bsdf) {
    return bsdf.kind == MATERIAL_DIELECTRIC && bsdf.alpha == 0.0;
}

float light_share(Bsdf bsdf, float most) {
    if (bsdf.kind == MATERIAL_DIFFUSE) {
        return most;
    }
    float share = most * min(bsdf.alpha / LIGHT_ALPHA, 1.0);
    return bsdf.alpha < 10.0 * MIN_ALPHA ? 0.0 : share;
}

vec3 evaluate_bsdf(Bsdf bsdf, vec3 wo, vec3 wi, out float pdf) {
    pdf = 0.0;
    if (bsdf.kind == MATERIAL_DIFFUSE) {
        float cosine = max(wi.z, 0.0);
        pdf = cosine * INV_PI;
        return bsdf.color * pdf;
    }
    if (is_delta(bsdf) || wo.z <= 0.0) {
        return vec3(0.0);
    }
    float lambda_o = ggx_lambda(wo, bsdf.alpha);
    float lambda_i = ggx_lambda(wi, bsdf.alpha);
    if (wi.z > 0.0) {
        vec3 m = normalize(wo + wi);
        float d = ggx_distribution(m, bsdf.alpha);
        float value = d / (4.0 * wo.z * (1.0 + lambda_o + lambda_i));
        pdf = d / (4.0 * wo.z * (1.0 + lambda_o));
        if (bsdf.kind == MATERIAL_METALLIC) {
            return fresnel_schlick(bsdf.color, dot(wo, m)) * energy_compensation(bsdf) * value;
        }
        float f = fresnel_dielectric(dot(wo, m), bsdf.eta);
        pdf *= f;
        return vec3(f * value);
    }
    if (bsdf.kind == MATERIAL_METALLIC || wi.z == 0.0) {
        return vec3(0.0);
    }
    vec3 m = normalize(wo + wi * bsdf.eta);
    if (m.z < 0.0) {
        m = -m;
    }
    float cos_o = dot(wo, m);
    float cos_i = dot(wi, m);
    if (cos_o <= 0.0 || cos_i >= 0.0) {
        return vec3(0.0);
    }
    float f = fresnel_dielectric(cos_o, bsdf.eta);
    float d = ggx_distribution(m, bsdf.alpha);
    float denominator = cos_o + bsdf.eta * cos_i;
    float common_factor = (1.0 - f) * d * cos_o * -cos_i / (wo.z * denominator * denominator);
    float value = common_factor / (1.0 + lambda_o + lambda_i);
    pdf = common_factor * bsdf.eta * bsdf.eta / (1.0 + lambda_o);
    return bsdf.color * value;
}

vec3 refract_at(vec3 wo, vec3 m, float eta) {
    float cos_o = dot(wo, m);
    float cos2_t = 1.0 - (1.0 - cos_o * cos_o) / (eta * eta);
    if (cos2_t <= 0.0) {
        return vec3(0.0);
    }
    return m * (cos_o / eta - sqrt(cos2_t)) - wo * (1.0 / eta);
}

BsdfSample sample_bsdf(Bsdf bsdf, vec3 wo, vec2 u, float lobe) {
    BsdfSample nothing = BsdfSample(vec3(0.0, 0.0, 1.0), vec3(0.0));
    if (bsdf.kind == MATERIAL_DIFFUSE) {
        return BsdfSample(sample_cosine(u), bsdf.color);
    }
    if (wo.z <= 0.0) {
        return nothing;
    }
    bool delta = is_delta(bsdf);
    vec3 m = delta ? vec3(0.0, 0.0, 1.0) : sample_visible_normal(wo, bsdf.alpha, u);
    float cos_o = dot(wo, m);
    float lambda_o = ggx_lambda(wo, bsdf.alpha);
    vec3 wi = m * (2.0 * cos_o) - wo;
    float f = fresnel_dielectric(cos_o, bsdf.eta);
    bool metallic = bsdf.kind == MATERIAL_METALLIC;
    bool reflects = metallic || lobe < f;
    if (!reflects) {
        wi = refract_at(wo, m, bsdf.eta);
    }
    if (reflects ? wi.z <= 0.0 : wi.z >= 0.0) {
        return nothing;
    }
    float shadowing = delta ? 1.0 : (1.0 + lambda_o) / (1.0 + lambda_o + ggx_lambda(wi, bsdf.alpha));
    vec3 weight = vec3(shadowing);
    if (metallic) {
        weight *= fresnel_schlick(bsdf.color, cos_o) * energy_compensation(bsdf);
    } else if (!reflects) {
        weight *= bsdf.color / (bsdf.eta * bsdf.eta);
    }
    return BsdfSample(wi, weight);
}
