// One vertex of a path; documented in src/kernels/path.rs.

struct PathState {
    vec3 origin;
    float width;
    vec3 direction;
    float spread;
    vec3 throughput;
    uint bounce;
    vec3 radiance;
    uvec2 media;
    float frequency_ratio;
    uint side;
};

#ifdef KERNEL_GENERATE
PathState start_path(uint x, uint y, uint sample_index) {
    uint seed = pixel_seed(x, y);
    vec2 offset = sample_filter(SCENE.filter_kind, random_pair(seed, 0, sample_index));
    vec2 film = vec2(float(x) + 0.5, float(y) + 0.5) + offset;
    vec3 origin, direction;
    float frequency_ratio;
    vec2 lens = SCENE.aperture_radius > 0.0 ? random_pair(seed, 1, sample_index) : vec2(0.0);
    camera_ray(film, lens, origin, direction, frequency_ratio);
    return PathState(origin, SCENE.cone_width, direction, SCENE.pixel_spread, vec3(1.0), 0u, vec3(0.0), uvec2(0), frequency_ratio, 0u);
}
#endif

#ifdef KERNEL_SHADE
uint media_top(uvec2 media) {
    return media.x & 0xffffu;
}

uvec2 media_push(uvec2 media, uint id) {
    return uvec2((media.x << 16) | id, (media.y << 16) | (media.x >> 16));
}

uvec2 media_remove(uvec2 media, uint id) {
    uvec2 below = uvec2((media.x >> 16) | (media.y << 16), media.y >> 16);
    if ((media.x & 0xffffu) == id) {
        return below;
    }
    if (media.x >> 16 == id) {
        return uvec2((media.x & 0xffffu) | (media.y << 16), media.y >> 16);
    }
    if ((media.y & 0xffffu) == id) {
        return uvec2(media.x, media.y >> 16);
    }
    if (media.y >> 16 == id) {
        return uvec2(media.x, media.y & 0xffffu);
    }
    return media;
}

float media_ior(uint id) {
    return id == 0 ? 1.0 : material_at(id - 1).ior;
}
#endif

#ifdef KERNEL_ESCAPE
void escape(inout PathState path, Arrival arrival) {
    if (arrival.status == STATUS_ESCAPED) {
        EnvironmentParameters environment = SCENE.environment[arrival.side];
        vec3 radiance = environment_radiance(environment, arrival.direction);
        if (environment.temperature > 0.0) {
            radiance *= black_body(environment.temperature * path.frequency_ratio * arrival.redshift);
        }
        path.radiance += path.throughput * radiance;
    }
}
#endif

#ifdef KERNEL_SHADE
// Whether the model is a metric is known when the pipeline is built.
layout(constant_id = 0) const bool LOCAL_FRAMES = false;

// What a ray meets at its end.
const uint MEETING_ENDS = 0;
const uint MEETING_PASSES = 1;
const uint MEETING_SCATTERS = 2;

struct Scattering {
    vec3 position;
    vec3 outward;
    vec3 shading;
    vec3 wo;
    Bsdf bsdf;
};

struct Encounter {
    Scattering scattering;
    bool outside;
    vec3 offset;
    uvec2 media_beyond;
};

struct Draw {
    vec3 wi;
    vec3 weight;
};

uint meet_surface(Surface surface, inout PathState path, Arrival arrival, out Encounter at) {
    uint material_id = object_material(surface.object);
    Material material = material_at(material_id);

    // Absorb inside the dielectric that the ray crossed.
    uint inside = media_top(path.media);
    if (inside != 0) {
        path.throughput *= exp(-material_at(inside - 1).absorption * arrival.path_length);
    }

    // See the surface in the frame of the local observer.
    vec3 outward = surface.normal_geometric, shading = surface.normal_shading;
    if (LOCAL_FRAMES) {
        outward = local_normal(outward, arrival);
        shading = local_normal(shading, arrival);
    }
    path.frequency_ratio *= arrival.redshift;
    path.side = arrival.side;
    path.width += path.spread * arrival.path_length;

    // Count emission, on the outer side or on both.
    vec3 wo = -arrival.direction;
    bool outside = dot(outward, wo) > 0.0;
    vec3 extent = abs(surface.position);
    float distance = ORIGIN_OFFSET * max(extent.x, max(extent.y, extent.z)) + SCENE.origin_offset;
    vec3 offset = surface.normal_geometric * (outside ? distance : -distance);
    if (material.kind == MATERIAL_ACCRETION) {
        float hottest = material.temperature * disc_profile(material, arrival.u).x;
        vec3 thermal = black_body(hottest * path.frequency_ratio * arrival.doppler);
        path.radiance += path.throughput * material.emission * thermal;
        if ((material.flags & MATERIAL_OPAQUE) != 0) {
            return MEETING_ENDS;
        }
        // Light from behind passes as it came.
        path.origin = surface.position - offset;
        path.direction = arrival.direction;
        return MEETING_PASSES;
    }
    if (outside || (material.flags & MATERIAL_TWO_SIDED) != 0) {
        path.radiance += path.throughput * emission_at(material, surface.uv, path.frequency_ratio);
    }
    if (material.kind == MATERIAL_EMISSIVE || path.bounce >= SCENE.max_depth) {
        return MEETING_ENDS;
    }

    // Resolve the surface's scattering.
    float roughness = roughness_at(material, surface.uv);
    Bsdf bsdf = Bsdf(base_color_at(material, surface.uv), material.kind, max(roughness * roughness, MIN_ALPHA), 1.0, 1.0);
    uvec2 media_beyond = outside ? media_push(path.media, material_id + 1) : media_remove(path.media, material_id + 1);
    if (material.kind == MATERIAL_DIELECTRIC) {
        float before = outside ? media_ior(inside) : material.ior;
        bsdf.eta = media_ior(media_top(media_beyond)) / before;
        bsdf.alpha = roughness == 0.0 || bsdf.eta == 1.0 ? 0.0 : bsdf.alpha;
    }
    at = Encounter(Scattering(surface.position, outward, shading, wo, bsdf), outside, offset, media_beyond);
    return MEETING_SCATTERS;
}

// The random numbers are the pairs of `seed` from `first` on; of these, `lobe` is drawn already.
Draw draw_direction(Scattering at, uint seed, uint first, uint sample_index, float lobe) {
    // Turn the normals to the side the path came from.
    vec3 geometric = dot(at.outward, at.wo) > 0.0 ? at.outward : -at.outward;
    vec3 facing = dot(at.shading, geometric) < 0.0 ? -at.shading : at.shading;
    vec3 normal = dot(facing, at.wo) < 1e-4 ? geometric : facing;
    vec3 wo = frame_from_world(normal, at.wo);
    Bsdf bsdf = at.bsdf;
    if (bsdf.kind == MATERIAL_METALLIC) {
        bsdf.albedo = ggx_albedo(wo.z, sqrt(bsdf.alpha));
    }

    // One pair says whether to aim at a light, at which of a few, and the direction: so the directions of each kind are as evenly spread
    // as the pairs are.
    float share = SCENE.light_count == 0 || is_delta(bsdf) ? 0.0 : light_share(bsdf, SCENE.light_share);
    vec2 u = random_pair(seed, first, sample_index);
    bool aimed = u.x < share;
    u.x = aimed ? u.x / share : (u.x - share) / (1.0 - share);
    BsdfSample drawn = sample_bsdf(bsdf, wo, u, lobe);
    vec3 wi = world_from_frame(normal, drawn.wi);
    vec3 weight = drawn.weight;
    if (share > 0.0) {
        bool many = SCENE.light_count > MAX_SUMMED_LIGHTS;
        uint chosen = choose_light(many ? random_pair(seed, first + 2, sample_index).x : u.x);
        AimCell cell = aim_cell(at.position);
        if (aimed) {
            Light light = light_at(chosen);
            float before = many || chosen == 0 ? 0.0 : light_at(chosen - 1).cumulative;
            u.x = many ? u.x : (u.x - before) / (light.cumulative - before);
            wi = sample_light(light, many ? at.position : apparent_position(cell, chosen, at.position), u);
        }
        float pdf;
        vec3 value = evaluate_bsdf(bsdf, wo, frame_from_world(normal, wi), pdf);
        float density = share * lights_pdf(chosen, cell, at.position, wi) + (1.0 - share) * pdf;
        weight = density > 0.0 ? value * (1.0 / density) : vec3(0.0);
    }

    // The geometry must agree on whether the direction reflects or transmits: the sign of one is that of the other.
    bool agree = dot(wi, normal) * dot(wi, geometric) > 0.0;
    return Draw(wi, agree ? weight : vec3(0.0));
}

bool leave_surface(inout PathState path, Encounter at, Draw draw, float chance) {
    vec3 brought = path.throughput * at.scattering.bsdf.color;
    float importance = max(brought.x, max(brought.y, brought.z));
    path.throughput *= draw.weight;
    float strongest = max(path.throughput.x, max(path.throughput.y, path.throughput.z));
    if (!(strongest > 0.0)) {
        return false;
    }

    // Russian roulette, by what the path brings in all directions: towards a small light it brings little, but meets much. What a
    // dielectric compresses it gives back.
    path.bounce += 1;
    if (path.bounce >= ROULETTE_BOUNCE) {
        float index = media_ior(media_top(path.media));
        float survival = clamp(importance * index * index, MIN_SURVIVAL, MAX_SURVIVAL);
        if (chance >= survival) {
            return false;
        }
        path.throughput *= 1.0 / survival;
    }

    // Leave the surface.
    bool reflects = (dot(draw.wi, at.scattering.outward) > 0.0) == at.outside;
    if (!reflects) {
        path.media = at.media_beyond;
    }
    path.origin = at.scattering.position + (reflects ? at.offset : -at.offset);
    path.direction = draw.wi;
    float scatter = at.scattering.bsdf.kind == MATERIAL_DIFFUSE ? 1.0 : min(at.scattering.bsdf.alpha, 1.0);
    path.spread = max(path.spread, DIFFUSE_SPREAD * scatter);
    return true;
}
#endif
