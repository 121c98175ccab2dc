#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
// Follows rays for a bounded number of steps. Compiled once per bending model and precision.

#define KERNEL_ADVANCE
#include "bindings.glsl"
#include "work.glsl"
#include "math.glsl"
#include "triangle.glsl"
#include "sampling.glsl"
#include "primitive.glsl"
#include "curve.glsl"
#include "bvh.glsl"
#include "surface.glsl"
#include "path.glsl"
#include "state.glsl"
#ifndef FLAT
#include "clearance.glsl"
#include "table.glsl"
#include "model.glsl"
#include "integrator.glsl"
#include "flight.glsl"
#endif

void land(uint slot, Arrival arrival) {
    store_arrival(slot, arrival);
    if (arrival.status == STATUS_HIT) {
        queue[queue_shade() + atomicAdd(counters[COUNT_SHADE + 3], 1)] = slot;
    } else {
        queue[queue_escape() + atomicAdd(counters[COUNT_ESCAPE + 3], 1)] = slot;
    }
}

#ifdef FLAT
void advance(uint slot) {
    vec3 origin = uintBitsToFloat(load_word(slot, WORD_ORIGIN).xyz);
    uvec4 direction_side = load_word(slot, WORD_DIRECTION);
    vec3 direction = uintBitsToFloat(direction_side.xyz);
    uint side = direction_side.w;
    Curve curve = straight(origin, direction);
    Hit hit = Hit(FAR, NO_INDEX, 0.0, 0.0);
    closest_hit(curve, side, hit);
    bool found = hit.primitive != NO_INDEX;
    float travelled = found ? hit.t : 0.0;
    uint status = found ? STATUS_HIT : STATUS_ESCAPED;
    land(slot, Arrival(origin + direction * travelled, hit.primitive, direction, status, hit.u, hit.v, travelled, 1.0, 0u, 1u, 0.0,
        vec3(1.0), vec3(0.0), 1.0, side));
}
#endif

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counters[COUNT_ADVANCE + 3]) {
        return;
    }
    begin_work();
    advance(queue[queue_advance(push.parity) + i]);
    report_work();
}
