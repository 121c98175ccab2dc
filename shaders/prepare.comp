#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Turns queue counts into indirect dispatches: before the first round, after flight, after shading.

#include "bindings.glsl"

void set_dispatch(uint at, uint count) {
    counters[at] = (count + WORKGROUP_SIZE - 1) / WORKGROUP_SIZE;
    counters[at + 1] = 1;
    counters[at + 2] = 1;
    counters[at + 3] = count;
}

void add_rays(uint count) {
    uint before = counters[COUNT_RAYS];
    counters[COUNT_RAYS] = before + count;
    counters[COUNT_RAYS + 1] += before + count < before ? 1 : 0;
}

void main() {
    if (gl_GlobalInvocationID.x != 0) {
        return;
    }
    if (push.stage == 0) {
        set_dispatch(COUNT_ADVANCE, push.slot_count);
        add_rays(push.slot_count);
    } else if (push.stage == 1) {
        set_dispatch(COUNT_SHADE, counters[COUNT_SHADE + 3]);
        set_dispatch(COUNT_ESCAPE, counters[COUNT_ESCAPE + 3]);
        counters[COUNT_FLYING] = counters[COUNT_NEXT];
        return;
    } else {
        add_rays(counters[COUNT_NEXT] - counters[COUNT_FLYING]);
        set_dispatch(COUNT_ADVANCE, counters[COUNT_NEXT]);
    }
    counters[COUNT_SHADE + 3] = 0;
    counters[COUNT_ESCAPE + 3] = 0;
    counters[COUNT_NEXT] = 0;
}
