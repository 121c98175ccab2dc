// What is where a ray ended; documented in src/kernels/surface.rs.

struct Arrival {
    vec3 position;
    uint primitive;
    vec3 direction;
    uint status;
    float u;
    float v;
    float path_length;
    float redshift;
    uint steps;
    uint chords;
    float constraint_error;
    vec3 frame_diagonal;
    vec3 frame_mixed;
    float doppler;
    uint side;
};

struct Surface {
    vec3 position;
    vec3 normal_geometric;
    vec3 normal_shading;
    vec2 uv;
    uint object;
};

#if defined(KERNEL_SHADE) || defined(KERNEL_ESCAPE)
vec3 black_body(float temperature) {
    if (temperature < BLACK_BODY_MIN) {
        return vec3(0.0);
    }
    float last = float(BLACK_BODY_SIZE - 1);
    float at = log(temperature / BLACK_BODY_MIN) / log(BLACK_BODY_MAX / BLACK_BODY_MIN) * last;
    float index = floor(min(at, last - 1.0));
    vec4 low = black_body_entry(uint(index));
    vec4 high = black_body_entry(uint(index) + 1);
    vec4 entry = low + (high - low) * min(at - index, 1.0);
    return entry.xyz * (exp(entry.w) * max(temperature / BLACK_BODY_MAX, 1.0));
}
#endif

#ifdef KERNEL_SHADE
vec3 local_normal(vec3 n, Arrival arrival) {
    vec3 d = arrival.frame_diagonal, m = arrival.frame_mixed;
    return normalize(vec3(d.x * n.x + m.x * n.y + m.y * n.z, m.x * n.x + d.y * n.y + m.z * n.z, m.y * n.x + m.z * n.y + d.z * n.z));
}

vec3 vertex_normal(uint index) {
    Vertex v = vertex_at(index);
    return vec3(v.normal[0], v.normal[1], v.normal[2]);
}

vec2 vertex_uv(uint index) {
    Vertex v = vertex_at(index);
    return vec2(v.uv[0], v.uv[1]);
}

Surface surface_at(Arrival arrival) {
    float u = arrival.u, v = arrival.v;
    if ((arrival.primitive & HIT_PRIMITIVE) != 0) {
        Primitive primitive = primitive_at(arrival.primitive & CHILD_INDEX);
        vec3 normal = primitive_normal(primitive, arrival.position);
        vec2 uv = vec2(0.0);
        if ((material_at(object_material(primitive.object)).flags & MATERIAL_TEXTURED) != 0) {
            uv = primitive_uv(primitive, arrival.position, vec2(u, v));
        }
        vec3 position = arrival.position;
        if (primitive.kind == PRIMITIVE_SPHERE) {
            position = vec3(primitive.data[0], primitive.data[1], primitive.data[2]) + normal * primitive.data[3];
        }
        return Surface(position, normal, normal, uv, primitive.object);
    }
    uint block = arrival.primitive / 8;
    uint lane = arrival.primitive % 8;
    vec3 edge1 = block_vector(block, 3, lane), edge2 = block_vector(block, 6, lane);
    Triangle triangle = triangle_at(block_triangle(block, lane));
    uvec3 corners = uvec3(triangle.vertices[0], triangle.vertices[1], triangle.vertices[2]);
    float w = 1.0 - u - v;
    vec3 geometric = normalize(cross(edge1, edge2));
    vec3 shading = vertex_normal(corners.x) * w + vertex_normal(corners.y) * u + vertex_normal(corners.z) * v;
    float length2 = dot(shading, shading);
    shading = length2 > 1e-12 ? shading * (1.0 / sqrt(length2)) : geometric;
    vec3 position = block_vector(block, 0, lane) + edge1 * u + edge2 * v;
    vec2 uv = vertex_uv(corners.x) * w + vertex_uv(corners.y) * u + vertex_uv(corners.z) * v;
    return Surface(position, geometric, shading, uv, triangle.object);
}

vec3 textured(vec3 color, uint index, vec2 uv) {
    return index == NO_INDEX ? color : color * sample_texture(index, uv).xyz;
}

vec3 base_color_at(Material material, vec2 uv) {
    return textured(material.base_color, material.base_texture, uv);
}

float roughness_at(Material material, vec2 uv) {
    return material.roughness_texture == NO_INDEX ? material.roughness : material.roughness * sample_texture(material.roughness_texture, uv).y;
}

vec3 emission_at(Material material, vec2 uv, float frequency_ratio) {
    vec3 emission = material.emission;
    if (material.temperature > 0.0) {
        emission *= black_body(material.temperature * frequency_ratio);
    }
    return textured(emission, material.emission_texture, uv);
}
#endif

#if defined(KERNEL_SHADE) || defined(KERNEL_ADVANCE)
vec2 disc_profile(Material material, float radius) {
    float last = float(DISC_PROFILE_SIZE - 1);
    float at = (radius - material.inner_radius) / (material.outer_radius - material.inner_radius) * last;
    float index = clamp(floor(at), 0.0, last - 1.0);
    vec2 low = profile_entry(material.profile + uint(index));
    vec2 high = profile_entry(material.profile + uint(index) + 1);
    return low + (high - low) * clamp(at - index, 0.0, 1.0);
}
#endif

#ifdef KERNEL_ADVANCE
bool matter_velocity(Hit hit, vec3 position, out vec3 velocity) {
    velocity = vec3(0.0);
    if (hit.primitive == NO_INDEX || (hit.primitive & HIT_PRIMITIVE) == 0) {
        return false;
    }
    Primitive primitive = primitive_at(hit.primitive & CHILD_INDEX);
    Material material = material_at(object_material(primitive.object));
    if (material.kind != MATERIAL_ACCRETION) {
        return false;
    }
    float omega = disc_profile(material, hit.u).y;
    vec3 center = vec3(primitive.data[0], primitive.data[1], primitive.data[2]);
    velocity = cross(vec3(primitive.data[4], primitive.data[5], primitive.data[6]), position - center) * omega;
    return true;
}
#endif
