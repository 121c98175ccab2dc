#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Adds the radiance of all samples of a pixel to the film.

#include "bindings.glsl"
#include "film.glsl"

void main() {
    uint pixel = gl_GlobalInvocationID.x;
    uint pixels = push.row_count * SCENE.film_width;
    // Paths that are still under way resolve after a later submission.
    if (pixel >= pixels || counters[COUNT_ADVANCE + 3] != 0) {
        return;
    }
    uint at = 2 * (push.first_row * SCENE.film_width + pixel);
    uvec4 red_green = push.sums.items[at];
    uvec4 blue_moment = push.sums.items[at + 1];
    for (uint slot = pixel; slot < push.slot_count; slot += pixels) {
        vec3 radiance = uintBitsToFloat(load_word(slot, WORD_RADIANCE).xyz);
        if (any(isnan(radiance)) || any(isinf(radiance))) {
            atomicAdd(counters[COUNT_INVALID], 1);
            continue;
        }
        radiance = clamp(radiance, vec3(0.0), vec3(MAX_RADIANCE));
        float luminance = min(0.2126 * radiance.x + 0.7152 * radiance.y + 0.0722 * radiance.z, MAX_MOMENT_LUMINANCE);
        add_fixed(red_green.xy, fixed_from_float(radiance.x));
        add_fixed(red_green.zw, fixed_from_float(radiance.y));
        add_fixed(blue_moment.xy, fixed_from_float(radiance.z));
        add_fixed(blue_moment.zw, fixed_from_float(luminance * luminance));
    }
    push.sums.items[at] = red_green;
    push.sums.items[at + 1] = blue_moment;
}
