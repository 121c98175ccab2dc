// Maps from the unit square to directions; documented in src/kernels/sampling.rs.

vec2 sin_cos_turns(float turns) {
    float quarter = floor(turns * 4.0 + 0.5);
    float x = (turns * 4.0 - quarter) * 1.5707964;
    float x2 = x * x;
    float s = x * (1.0 + x2 * (-1.6666666e-1 + x2 * (8.333331e-3 + x2 * (-1.9840907e-4 + x2 * 2.7525523e-6))));
    float c = 1.0 + x2 * (-0.5 + x2 * (4.1666664e-2 + x2 * (-1.3888877e-3 + x2 * 2.4759423e-5)));
    int q = int(quarter) & 3;
    bool swapped = (q & 1) != 0;
    float sin_sign = q >= 2 ? -1.0 : 1.0;
    float cos_sign = (q == 1 || q == 2) ? -1.0 : 1.0;
    return vec2((swapped ? c : s) * sin_sign, (swapped ? s : c) * cos_sign);
}

vec3 spherical_direction(float cos_theta, float turns) {
    float sin_theta = sqrt(max(1.0 - cos_theta * cos_theta, 0.0));
    vec2 sin_cos = sin_cos_turns(turns);
    return vec3(sin_cos.y * sin_theta, sin_cos.x * sin_theta, cos_theta);
}

vec3 sample_cosine(vec2 u) {
    return spherical_direction(sqrt(1.0 - u.x), u.y);
}

vec2 sample_disc(vec2 u) {
    vec2 sin_cos = sin_cos_turns(u.y);
    return vec2(sin_cos.y, sin_cos.x) * sqrt(u.x);
}

vec3 frame_tangent(vec3 n) {
    float sign_z = n.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (sign_z + n.z);
    return vec3(1.0 + sign_z * n.x * n.x * a, sign_z * n.x * n.y * a, -sign_z * n.x);
}

vec3 world_from_frame(vec3 n, vec3 v) {
    vec3 t = frame_tangent(n);
    vec3 b = cross(n, t);
    return t * v.x + b * v.y + n * v.z;
}

vec3 frame_from_world(vec3 n, vec3 v) {
    vec3 t = frame_tangent(n);
    vec3 b = cross(n, t);
    return vec3(dot(v, t), dot(v, b), dot(v, n));
}
