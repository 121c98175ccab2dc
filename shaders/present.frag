#version 460
#extension GL_EXT_buffer_reference : require
// Shows a canvas: pixel for pixel if it is as large as the window, else stretched over it.

layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer Canvas { uint items[]; };

layout(push_constant) uniform Push {
    Canvas canvas;
    uvec2 canvas_size;
    uvec2 window_size;
} push;

layout(location = 0) out vec4 color;

vec4 canvas_pixel(ivec2 at) {
    uvec2 inside = uvec2(clamp(at, ivec2(0), ivec2(push.canvas_size) - 1));
    return unpackUnorm4x8(push.canvas.items[inside.y * push.canvas_size.x + inside.x]);
}

void main() {
    if (push.canvas_size == push.window_size) {
        color = canvas_pixel(ivec2(gl_FragCoord.xy));
        return;
    }
    vec2 at = gl_FragCoord.xy * vec2(push.canvas_size) / vec2(push.window_size) - 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 share = at - vec2(low);
    vec4 top = mix(canvas_pixel(low), canvas_pixel(low + ivec2(1, 0)), share.x);
    vec4 bottom = mix(canvas_pixel(low + ivec2(0, 1)), canvas_pixel(low + ivec2(1, 1)), share.x);
    color = mix(top, bottom, share.y);
}
