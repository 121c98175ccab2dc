#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Develops columns of a film into a canvas of its size.

#define real float
#include "constants.glsl"
#include "layout.glsl"
#include "film.glsl"
#include "develop.glsl"

layout(local_size_x = 64) in;

layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer FilmSums { uvec4 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer FilmAovs { Aov items[]; };
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer RowCounts { uint items[]; };
layout(buffer_reference, std430, buffer_reference_align = 4) writeonly buffer Canvas { uint items[]; };

layout(push_constant) uniform Push {
    FilmSums sums;
    FilmAovs aovs;
    RowCounts row_counts;
    Canvas canvas;
    uint width;
    uint height;
    uint first_column;
    uint column_count;
    uint channel;
    uint curve;
    float gain;
    // Threads of the dispatch: each takes every so manieth pixel.
    uint stride;
} push;

vec3 radiance_at(uint pixel, uint count) {
    uvec4 red_green = push.sums.items[2 * pixel];
    uvec4 blue_moment = push.sums.items[2 * pixel + 1];
    return vec3(float_from_fixed(red_green.xy), float_from_fixed(red_green.zw), float_from_fixed(blue_moment.xy)) / float(count);
}

void main() {
    uint pixels = push.column_count * push.height;
    for (uint i = gl_GlobalInvocationID.x; i < pixels; i += push.stride) {
        uint row = i / push.column_count;
        uint pixel = row * push.width + push.first_column + i % push.column_count;
        uint count = push.row_counts.items[row];
        vec3 color = vec3(0.0);
        if (count != 0 && push.channel == CHANNEL_RADIANCE) {
            color = radiance_color(push.curve, radiance_at(pixel, count) * push.gain);
        } else if (count != 0) {
            color = aov_color(push.channel, push.aovs.items[pixel]);
        }
        push.canvas.items[pixel] = packUnorm4x8(vec4(color, 1.0));
    }
}
