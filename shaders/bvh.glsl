// Closest hit of a straight or curved segment; documented in src/kernels/bvh.rs.

struct Curve {
    vec3 start;
    vec3 c1;
    vec3 c2;
    vec3 c3;
    uint chords;
    float tolerance;
};

struct Hit {
    float t;
    uint primitive;
    float u;
    float v;
};

Curve straight(vec3 origin, vec3 direction) {
    return Curve(origin, direction, vec3(0.0), vec3(0.0), 1u, 0.0);
}

Curve hermite(vec3 start, vec3 end, vec3 tangent0, vec3 tangent1) {
    vec3 chord = end - start;
    vec3 c2 = chord * 3.0 - tangent0 * 2.0 - tangent1;
    vec3 c3 = tangent0 + tangent1 - chord * 2.0;
    return Curve(start, tangent0, c2, c3, 1u, 0.0);
}

vec3 curve_point(Curve curve, float s) {
    return curve.start + (curve.c1 + (curve.c2 + curve.c3 * s) * s) * s;
}

vec3 curve_tangent(Curve curve, float s) {
    return curve.c1 + (curve.c2 * 2.0 + curve.c3 * (3.0 * s)) * s;
}

Curve cut_span(Curve curve, float from, float to, float tolerance) {
    float w = to - from;
    vec3 c1 = curve_tangent(curve, from) * w;
    vec3 c2 = (curve.c2 + curve.c3 * (3.0 * from)) * (w * w);
    vec3 c3 = curve.c3 * (w * w * w);
    vec3 c2_end = c2 + c3 * 3.0;
    // The sagitta of a chord is an eighth of the largest second derivative.
    float sagitta = sqrt(max(dot(c2, c2), dot(c2_end, c2_end))) * 0.25;
    float chords = clamp(ceil(sqrt(sagitta / tolerance)), 1.0, float(MAX_CHORDS));
    return Curve(curve_point(curve, from), c1, c2, c3, uint(chords), tolerance);
}

void deviation(Curve curve, out vec3 down, out vec3 up) {
    vec3 first = curve.c2 + curve.c3, last = curve.c2 + curve.c3 * 2.0;
    down = max(max(first, last), 0.0) * 0.25 + curve.tolerance;
    up = max(-min(first, last), 0.0) * 0.25 + curve.tolerance;
}

vec3 whole_chord(Curve curve) {
    return curve.c1 + curve.c2 + curve.c3;
}

vec3 hit_position(Curve curve, float t) {
    if (curve.chords == 1) {
        return curve.start + whole_chord(curve) * t;
    }
    float count = float(curve.chords);
    float j = min(floor(t * count), count - 1.0);
    vec3 from = curve_point(curve, j / count);
    vec3 to = curve_point(curve, (j + 1.0) / count);
    return from + (to - from) * (t * count - j);
}

bool intersect_chord(uint child, vec3 origin, vec3 direction, float j, float count, float t_max, inout Hit hit) {
    uint index = child & CHILD_INDEX;
    if (COUNTING) {
        work.primitives += (child & CHILD_BLOCK) == 0 ? 1u : 0u;
        work.blocks += (child & CHILD_BLOCK) == 0 ? 0u : 1u;
    }
    if ((child & CHILD_BLOCK) == 0) {
        vec3 found = intersect_primitive(primitive_at(index), origin, direction, t_max);
        if (found.x > 0.0) {
            hit = Hit((j + found.x) / count, HIT_PRIMITIVE | index, found.y, found.z);
            return true;
        }
        return false;
    }
    bool any_hit = false;
    for (uint part = 0; part < 2; ++part) {
        vec4 t, u, v;
        bvec4 met = intersect_triangle(origin, direction, block_rows(index, 0, part), block_rows(index, 3, part), block_rows(index, 6, part), t_max, t, u, v);
        for (uint lane = 0; lane < 4; ++lane) {
            if (met[lane] && t[lane] < t_max) {
                hit = Hit((j + t[lane]) / count, 8 * index + 4 * part + lane, u[lane], v[lane]);
                t_max = t[lane];
                any_hit = true;
            }
        }
    }
    return any_hit;
}

void intersect_leaf(Curve curve, uint child, float enter, float exit, inout Hit hit) {
    float count = float(curve.chords);
    float first = clamp(floor(enter * count), 0.0, count - 1.0);
    float last = clamp(floor(min(exit, hit.t) * count), 0.0, count - 1.0);
    bool single = curve.chords == 1;
    vec3 from = curve_point(curve, first / count);
    for (float j = first; j <= last; j += 1.0) {
        vec3 to = curve_point(curve, (j + 1.0) / count);
        vec3 direction = single ? whole_chord(curve) : to - from;
        float t_max = single ? hit.t : min(hit.t * count - j, 1.0 + CHORD_SLACK);
        if (intersect_chord(child, from, direction, j, count, t_max, hit)) {
            return;
        }
        from = to;
    }
}

uvec3 traversal_stack[STACK_SIZE];

void closest_hit(Curve curve, uint side, inout Hit hit) {
    if (COUNTING) {
        ++work.chords;
    }
    vec3 chord = whole_chord(curve);
    bvec3 forward = greaterThanEqual(chord, vec3(0.0));
    vec3 size = max(abs(chord), vec3(MIN_DIRECTION));
    vec3 inverse_chord = 1.0 / mix(-size, size, forward);
    vec3 down, up;
    deviation(curve, down, up);
    vec3 near_origin = curve.start + mix(-down, up, forward);
    vec3 far_origin = curve.start + mix(up, -down, forward);
    uvec3 near_plane = uvec3(0, 2, 4) + mix(uvec3(1), uvec3(0), forward);

    uint top = 0;
    uint child = scene_root(side);
    float enter = 0.0;
    float exit = hit.t;
    while (true) {
        if (child < CHILD_PRIMITIVE) {
            if (COUNTING) {
                ++work.nodes;
            }
            uint bottom = top;
            for (uint part = 0; part < 2; ++part) {
                vec4 near = vec4(0.0), far = vec4(hit.t);
                for (uint axis = 0; axis < 3; ++axis) {
                    near = max(near, (node_bounds(child, near_plane[axis], part) - near_origin[axis]) * inverse_chord[axis]);
                    far = min(far, (node_bounds(child, near_plane[axis] ^ 1, part) - far_origin[axis]) * inverse_chord[axis]);
                }
                uvec4 children = node_children(child, part);
                for (uint lane = 0; lane < 4; ++lane) {
                    if (near[lane] <= far[lane] * (1.0 + 4.0 * 1.1920929e-7)) {
                        // Insert so that the nearest child ends on top.
                        uint at = top;
                        while (at > bottom && uintBitsToFloat(traversal_stack[at - 1].y) < near[lane]) {
                            traversal_stack[at] = traversal_stack[at - 1];
                            --at;
                        }
                        traversal_stack[at] = uvec3(children[lane], floatBitsToUint(near[lane]), floatBitsToUint(far[lane]));
                        ++top;
                    }
                }
            }
        } else {
            intersect_leaf(curve, child, enter, exit, hit);
        }
        do {
            if (top == 0) {
                return;
            }
            --top;
            child = traversal_stack[top].x;
            enter = uintBitsToFloat(traversal_stack[top].y);
            exit = uintBitsToFloat(traversal_stack[top].z);
        } while (enter > hit.t);
    }
}
