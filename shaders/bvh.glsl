// Closest hit of a segment; documented in src/kernels/bvh.rs.

struct Hit {
    float t;
    uint primitive;
    float u;
    float v;
};

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

// The whole chord of a curve, prepared for slab tests against boxes that are extended by how far its pieces stray from it.
struct Slabs {
    vec3 inverse;
    vec3 near;
    vec3 far;
};

Slabs slabs(Curve curve) {
    vec3 chord = whole_chord(curve);
    vec3 size = 1.0 / max(abs(chord), vec3(MIN_DIRECTION));
    bvec3 backward = lessThan(chord, vec3(0.0));
    vec3 down, up;
    deviation(curve, down, up);
    vec3 inverse = mix(size, -size, backward);
    vec3 middle = -(curve.start * inverse);
    // Of pieces the ends are rounded too.
    float rounding_of_ends = curve.chords > 1 ? BOX_ROUNDING : 0.0;
    vec3 slack = (abs(curve.start) + (down + up)) * BOX_ROUNDING + abs(chord) * rounding_of_ends;
    return Slabs(inverse, middle - (mix(up, down, backward) + slack) * size, middle + (mix(down, up, backward) + slack) * size);
}

// Where the boxes of four children are entered and left.
void intersect_node(uint node, uint part, Slabs ray, uvec3 near_plane, float t_max, out vec4 near, out vec4 far) {
    near = vec4(0.0);
    far = vec4(t_max);
    for (uint axis = 0; axis < 3; ++axis) {
        near = max(near, fma(node_bounds(node, near_plane[axis], part), vec4(ray.inverse[axis]), vec4(ray.near[axis])));
        far = min(far, fma(node_bounds(node, near_plane[axis] ^ 1, part), vec4(ray.inverse[axis]), vec4(ray.far[axis])));
    }
}

// What is still to be visited: a child, and where it is entered and left, as the upper halves of two floats, of which the first
// is rounded down and the second up. They sort by where they are entered.
uvec2 traversal_stack[STACK_SIZE];
const uvec2 NO_ENTRY = uvec2(NO_INDEX, 0u);

uvec2 stack_entry(uint child, float enter, float exit) {
    bool met = enter <= exit * (1.0 + BOX_ROUNDING);
    return met ? uvec2(child, (floatBitsToUint(enter) & 0xffff0000u) | ((floatBitsToUint(exit) >> 16) + 1u)) : NO_ENTRY;
}

float entry_start(uvec2 entry) {
    return uintBitsToFloat(entry.y & 0xffff0000u);
}

float entry_end(uvec2 entry) {
    return uintBitsToFloat(entry.y << 16);
}

void order_entries(inout uvec2 a, inout uvec2 b) {
    bool swapped = b.y < a.y;
    uvec2 first = swapped ? b : a;
    b = swapped ? a : b;
    a = first;
}

// Batcher's network: first what is not met, then from the nearest to the farthest.
void sort_entries(inout uvec2 a, inout uvec2 b, inout uvec2 c, inout uvec2 d, inout uvec2 e, inout uvec2 f, inout uvec2 g, inout uvec2 h) {
    order_entries(a, b), order_entries(c, d), order_entries(e, f), order_entries(g, h);
    order_entries(a, c), order_entries(b, d), order_entries(e, g), order_entries(f, h);
    order_entries(b, c), order_entries(f, g);
    order_entries(a, e), order_entries(b, f), order_entries(c, g), order_entries(d, h);
    order_entries(c, e), order_entries(d, f);
    order_entries(b, c), order_entries(d, e), order_entries(f, g);
}

void closest_hit(Curve curve, uint side, inout Hit hit) {
    if (COUNTING) {
        ++work.chords;
    }
    Slabs ray = slabs(curve);
    uvec3 near_plane = uvec3(0, 2, 4) + uvec3(lessThan(ray.inverse, vec3(0.0)));

    uint top = 0;
    uvec2 current = uvec2(scene_root(side), 0u);
    while (true) {
        uvec2 next = NO_ENTRY;
        if (current.x < CHILD_PRIMITIVE) {
            if (COUNTING) {
                ++work.nodes;
            }
            vec4 near0, far0, near1, far1;
            intersect_node(current.x, 0, ray, near_plane, hit.t, near0, far0);
            intersect_node(current.x, 1, ray, near_plane, hit.t, near1, far1);
            uvec4 child0 = node_children(current.x, 0), child1 = node_children(current.x, 1);
            // Variables, because an array that is indexed in a loop is kept in memory.
            uvec2 a = stack_entry(child0.x, near0.x, far0.x), b = stack_entry(child0.y, near0.y, far0.y);
            uvec2 c = stack_entry(child0.z, near0.z, far0.z), d = stack_entry(child0.w, near0.w, far0.w);
            uvec2 e = stack_entry(child1.x, near1.x, far1.x), f = stack_entry(child1.y, near1.y, far1.y);
            uvec2 g = stack_entry(child1.z, near1.z, far1.z), h = stack_entry(child1.w, near1.w, far1.w);
            sort_entries(a, b, c, d, e, f, g, h);
            // All but the nearest wait, the farthest the longest.
            while (g.x != NO_INDEX) {
                traversal_stack[top] = h;
                ++top;
                h = g, g = f, f = e, e = d, d = c, c = b, b = a, a = NO_ENTRY;
            }
            next = h;
        } else {
            intersect_leaf(curve, current.x, entry_start(current), entry_end(current), hit);
        }
        // What waits behind the hit need not be visited.
        do {
            if (next.x == NO_INDEX) {
                if (top == 0) {
                    return;
                }
                --top;
                next = traversal_stack[top];
            }
            next = entry_start(next) > hit.t ? NO_ENTRY : next;
        } while (next.x == NO_INDEX);
        current = next;
    }
}
