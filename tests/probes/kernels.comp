#version 460
#extension GL_GOOGLE_include_directive : require
// Runs one kernel function, chosen by FUNCTION, over rows of sixteen numbers.

#include "constants.glsl"
#include "layout.glsl"

layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) readonly buffer Inputs { float inputs[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Outputs { float outputs[]; };
layout(push_constant) uniform Push { uint count; } push;

// The table of albedos is not under test here.
float albedo(uint index) {
    return float(index) / float(ALBEDO_SIZE * ALBEDO_SIZE);
}

#include "rng.glsl"
#include "sampling.glsl"
#include "triangle.glsl"
#include "primitive.glsl"
#include "material.glsl"
#include "film.glsl"

uint row;
float f(uint i) { return inputs[16 * row + i]; }
uint u(uint i) { return floatBitsToUint(f(i)); }
vec2 v2(uint i) { return vec2(f(i), f(i + 1)); }
vec3 v3(uint i) { return vec3(f(i), f(i + 1), f(i + 2)); }
void put(uint i, float value) { outputs[8 * row + i] = value; }
void put(uint i, uint value) { outputs[8 * row + i] = uintBitsToFloat(value); }
void put(uint i, vec2 value) { put(i, value.x); put(i + 1, value.y); }
void put(uint i, vec3 value) { put(i, value.x); put(i + 1, value.y); put(i + 2, value.z); }

void main() {
    row = gl_GlobalInvocationID.x;
    if (row >= push.count) {
        return;
    }
#if FUNCTION == 0
    // Integers travel as 24-bit numbers, so that no float rule touches them.
    uvec2 pixel = uvec2(uint(f(0) * 16777216.0), uint(f(1) * 16777216.0));
    uint seed = pixel_seed(pixel.x, pixel.y);
    put(0, random_pair(seed, pixel.x & 63, pixel.y));
    put(2, float(hash(seed) >> 8));
    put(3, float(pascal(seed) >> 8));
#elif FUNCTION == 1
    put(0, sin_cos_turns(f(0)));
    put(2, spherical_direction(2.0 * f(1) - 1.0, f(2)));
    put(5, sample_cosine(v2(3)));
#elif FUNCTION == 2
    vec3 n = normalize(v3(0) - 0.5);
    put(0, world_from_frame(n, v3(3)));
    put(3, frame_from_world(n, v3(3)));
#elif FUNCTION == 3
    // The triangle is the third of four; the others are nowhere.
    mat3x4 far = lanes(vec3(1e3));
    mat3x4 vertex = far, edge1 = far, edge2 = far;
    for (uint axis = 0; axis < 3; ++axis) {
        vertex[axis].z = v3(6)[axis];
        edge1[axis].z = v3(9)[axis] - 0.5;
        edge2[axis].z = v3(12)[axis] - 0.5;
    }
    vec4 t, a, b;
    bvec4 met = intersect_triangle(v3(0), v3(3) - 0.5, vertex, edge1, edge2, 10.0, t, a, b);
    bool hit = met.z && !any(met.xyw);
    put(0, hit ? 1.0 : 0.0);
    put(1, hit ? vec3(t.z, a.z, b.z) : vec3(0.0));
#elif FUNCTION == 4
    put(0, intersect_sphere(4.0 * v3(0) - 2.0, v3(3) - 0.5, v3(6), f(9) + 0.1, 100.0));
    put(1, intersect_quad(4.0 * v3(0) - 2.0, v3(3) - 0.5, v3(6), v3(9) - 0.3, v3(12) - 0.7, 100.0));
#elif FUNCTION == 5
    put(0, fresnel_dielectric(f(0), 0.4 + 2.0 * f(1)));
    put(1, fresnel_schlick(v3(2), f(0)));
    put(4, ggx_lambda(v3(5) + 0.01, f(8) + 0.001));
    put(5, ggx_distribution(normalize(v3(5) + 0.01), f(8) + 0.01));
    put(6, ggx_albedo(f(9), f(10)));
#elif FUNCTION == 6
    vec3 wo = normalize(vec3(v2(0) - 0.5, f(2) + 0.05));
    put(0, sample_visible_normal(wo, f(3) + 0.01, v2(4)));
#elif FUNCTION == 7
    vec3 wo = normalize(vec3(v2(0) - 0.5, f(2) + 0.05));
    Bsdf bsdf = Bsdf(v3(6), uint(f(9) * 3.0), f(3) + 0.05, f(10) < 0.5 ? 1.5 : 1.0 / 1.5, 0.9);
    BsdfSample drawn = sample_bsdf(bsdf, wo, v2(4), f(11));
    put(0, drawn.wi);
    put(3, drawn.weight);
#elif FUNCTION == 8
    vec3 wo = normalize(vec3(v2(0) - 0.5, f(2) + 0.05));
    Bsdf bsdf = Bsdf(v3(6), uint(f(9) * 3.0), f(3) + 0.05, f(10) < 0.5 ? 1.5 : 1.0 / 1.5, 0.9);
    float pdf;
    put(0, evaluate_bsdf(bsdf, wo, normalize(v3(12) - 0.5), pdf));
    put(3, pdf);
#elif FUNCTION == 9
    uvec2 fixed_point = fixed_from_float(ldexp(f(0), int(f(1) * 44.0) - 22));
    put(0, float(fixed_point.x >> 16));
    put(1, float(fixed_point.x & 0xffffu));
    put(2, float(fixed_point.y));
#endif
}
