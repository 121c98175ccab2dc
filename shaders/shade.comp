#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Handles the hit at the end of a ray and starts the next one.

#define KERNEL_SHADE
#include "bindings.glsl"
#include "rng.glsl"
#include "sampling.glsl"
#include "texture.glsl"
#include "primitive.glsl"
#include "light.glsl"
#include "material.glsl"
#include "surface.glsl"
#include "path.glsl"
#include "state.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counters[COUNT_SHADE + 3]) {
        return;
    }
    uint slot = queue[queue_shade() + i];
    uvec3 pixel = slot_pixel(slot);
    PathState path = load_path(slot);
    Arrival arrival = load_arrival(slot);
    Surface surface = surface_at(arrival);
    if (path.bounce == 0 && pixel.z == push.aov_sample) {
        Aov aov = miss_aov(arrival);
        aov.albedo = base_color_at(material_at(object_material(surface.object)), surface.uv);
        aov.normal = surface.normal_shading;
        aov.position = surface.position;
        aov.object = surface.object + 1;
        store_aov(pixel, aov);
    }
    Encounter at;
    uint meeting = meet_surface(surface, path, arrival, at);
    bool goes_on = meeting == MEETING_PASSES;
    if (meeting == MEETING_SCATTERS) {
        uint seed = pixel_seed(pixel.x, pixel.y);
        uint first = CAMERA_PAIRS + path.bounce * BOUNCE_PAIRS;
        vec2 lobe = vec2(0.0);
        if (path.bounce + 1 >= ROULETTE_BOUNCE || at.scattering.bsdf.kind == MATERIAL_DIELECTRIC) {
            lobe = random_pair(seed, first + 1, pixel.z);
        }
        Draw draw = draw_direction(at.scattering, seed, first, pixel.z, lobe.x);
        goes_on = leave_surface(path, at, draw, lobe.y);
    }
    if (goes_on) {
        store_path(slot, path);
        queue[queue_advance(1 - push.parity) + atomicAdd(counters[COUNT_NEXT], 1)] = slot;
    } else {
        store_radiance(slot, path);
    }
}
