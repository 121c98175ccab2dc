#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Ends rays that met nothing: adds the sky to those that escaped.

#define KERNEL_ESCAPE
#include "bindings.glsl"
#include "sampling.glsl"
#include "texture.glsl"
#include "primitive.glsl"
#include "light.glsl"
#include "surface.glsl"
#include "path.glsl"
#include "state.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counters[COUNT_ESCAPE + 3]) {
        return;
    }
    uint slot = queue[queue_escape() + i];
    uvec3 pixel = slot_pixel(slot);
    PathState path = load_path(slot);
    Arrival arrival = load_arrival(slot);
    if (path.bounce == 0 && pixel.z == push.aov_sample) {
        store_aov(pixel, miss_aov(arrival));
    }
    if (arrival.status == STATUS_EXHAUSTED) {
        atomicAdd(counters[COUNT_EXHAUSTED], 1);
    }
    escape(path, arrival);
    store_radiance(slot, path);
}
