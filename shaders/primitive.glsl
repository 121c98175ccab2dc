// Analytic primitives; documented in src/kernels/primitive.rs.

float intersect_sphere(vec3 origin, vec3 direction, vec3 center, float radius, float t_max) {
    vec3 f = origin - center;
    float a = dot(direction, direction);
    float inverse_a = 1.0 / a;
    float b = -dot(f, direction);
    vec3 nearest = f + direction * (b * inverse_a);
    float discriminant = radius * radius - dot(nearest, nearest);
    if (discriminant < 0.0) {
        return -1.0;
    }
    float c = dot(f, f) - radius * radius;
    float root = sqrt(a * discriminant);
    float q = b < 0.0 ? b - root : b + root;
    float first = c / q, second = q * inverse_a;
    float near = min(first, second), far = max(first, second);
    float t = near > 0.0 ? near : far;
    return t > 0.0 && t < t_max ? t : -1.0;
}

vec3 intersect_quad(vec3 origin, vec3 direction, vec3 corner, vec3 edge_u, vec3 edge_v, float t_max) {
    vec3 normal = cross(edge_u, edge_v);
    float t = dot(normal, corner - origin) / dot(normal, direction);
    vec3 p = origin + direction * t - corner;
    float scale = 1.0 / dot(normal, normal);
    float u = dot(cross(p, edge_v), normal) * scale;
    float v = dot(cross(edge_u, p), normal) * scale;
    bool inside = u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0;
    return inside && t > 0.0 && t < t_max ? vec3(t, u, v) : vec3(-1.0, 0.0, 0.0);
}

float affine_row(Primitive primitive, uint i, vec3 v, float w) {
    return primitive.data[4 * i] * v.x + primitive.data[4 * i + 1] * v.y + primitive.data[4 * i + 2] * v.z + primitive.data[4 * i + 3] * w;
}

float intersect_box(vec3 origin, vec3 direction, Primitive primitive, float t_max) {
    float near = -FAR;
    float far = FAR;
    for (uint i = 0; i < 3; ++i) {
        float o = affine_row(primitive, i, origin, 1.0);
        float d = affine_row(primitive, i, direction, 0.0);
        float inverse_d = 1.0 / (abs(d) < MIN_DIRECTION ? MIN_DIRECTION : d);
        float t0 = -o * inverse_d;
        float t1 = (1.0 - o) * inverse_d;
        near = max(near, min(t0, t1));
        far = min(far, max(t0, t1));
    }
    float t = near > 0.0 ? near : far;
    return near <= far && t > 0.0 && t < t_max ? t : -1.0;
}

vec3 intersect_disc(vec3 origin, vec3 direction, Primitive primitive, float t_max) {
    vec3 from_center = origin - vec3(primitive.data[0], primitive.data[1], primitive.data[2]);
    vec3 normal = vec3(primitive.data[4], primitive.data[5], primitive.data[6]);
    float t = -dot(from_center, normal) / dot(direction, normal);
    float radius = length(from_center + direction * t);
    bool met = t > 0.0 && t < t_max && radius >= primitive.data[3] && radius <= primitive.data[7];
    return met ? vec3(t, radius, 0.0) : vec3(-1.0, 0.0, 0.0);
}

vec3 intersect_primitive(Primitive primitive, vec3 origin, vec3 direction, float t_max) {
    vec3 first = vec3(primitive.data[0], primitive.data[1], primitive.data[2]);
    if (primitive.kind == PRIMITIVE_SPHERE) {
        return vec3(intersect_sphere(origin, direction, first, primitive.data[3], t_max), 0.0, 0.0);
    }
    if (primitive.kind == PRIMITIVE_QUAD) {
        vec3 edge_u = vec3(primitive.data[3], primitive.data[4], primitive.data[5]);
        vec3 edge_v = vec3(primitive.data[6], primitive.data[7], primitive.data[8]);
        return intersect_quad(origin, direction, first, edge_u, edge_v, t_max);
    }
    if (primitive.kind == PRIMITIVE_DISC) {
        return intersect_disc(origin, direction, primitive, t_max);
    }
    return vec3(intersect_box(origin, direction, primitive, t_max), 0.0, 0.0);
}

uint box_face(vec3 local) {
    vec3 offset = local - 0.5;
    vec3 size = abs(offset);
    if (size.x > size.y && size.x > size.z) {
        return offset.x > 0.0 ? 1u : 0u;
    }
    if (size.y > size.z) {
        return offset.y > 0.0 ? 3u : 2u;
    }
    return offset.z > 0.0 ? 5u : 4u;
}

vec3 box_local(Primitive primitive, vec3 position) {
    return vec3(affine_row(primitive, 0, position, 1.0), affine_row(primitive, 1, position, 1.0), affine_row(primitive, 2, position, 1.0));
}

vec3 primitive_normal(Primitive primitive, vec3 position) {
    vec3 first = vec3(primitive.data[0], primitive.data[1], primitive.data[2]);
    if (primitive.kind == PRIMITIVE_SPHERE) {
        return normalize(position - first);
    }
    if (primitive.kind == PRIMITIVE_QUAD) {
        return vec3(primitive.data[9], primitive.data[10], primitive.data[11]);
    }
    if (primitive.kind == PRIMITIVE_DISC) {
        return vec3(primitive.data[4], primitive.data[5], primitive.data[6]);
    }
    uint face = box_face(box_local(primitive, position));
    uint row = 4 * (face / 2);
    vec3 normal = normalize(vec3(primitive.data[row], primitive.data[row + 1], primitive.data[row + 2]));
    return face % 2 == 1 ? normal : -normal;
}

vec2 primitive_uv(Primitive primitive, vec3 position, vec2 uv) {
    if (primitive.kind == PRIMITIVE_SPHERE) {
        vec3 n = primitive_normal(primitive, position);
        return vec2(0.5 + atan(n.x, n.z) / TAU, 1.0 - acos(clamp(n.y, -1.0, 1.0)) * INV_PI);
    }
    if (primitive.kind == PRIMITIVE_QUAD) {
        return uv;
    }
    if (primitive.kind == PRIMITIVE_DISC) {
        vec3 center = vec3(primitive.data[0], primitive.data[1], primitive.data[2]);
        vec3 local = frame_from_world(vec3(primitive.data[4], primitive.data[5], primitive.data[6]), position - center);
        return vec2(0.5 + atan(local.y, local.x) / TAU, (uv.x - primitive.data[3]) / (primitive.data[7] - primitive.data[3]));
    }
    vec3 local = box_local(primitive, position);
    uint axis = box_face(local) / 2;
    if (axis == 0) {
        return local.zy;
    }
    return axis == 1 ? local.xz : local.xy;
}
