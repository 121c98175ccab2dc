#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Starts a camera path in every slot.

#define KERNEL_GENERATE
#include "bindings.glsl"
#include "rng.glsl"
#include "sampling.glsl"
#include "camera.glsl"
#include "surface.glsl"
#include "path.glsl"
#include "state.glsl"

void main() {
    uint slot = gl_GlobalInvocationID.x;
    if (slot >= push.slot_count) {
        return;
    }
    uvec3 pixel = slot_pixel(slot);
    store_path(slot, start_path(pixel.x, pixel.y, pixel.z));
    queue[queue_advance(0) + slot] = slot;
}
