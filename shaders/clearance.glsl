// The clearance grid; documented in src/kernels/clearance.rs.

float bounds_distance(vec3 position) {
    vec3 distance = max(SCENE.bounds_low - position, position - SCENE.bounds_high);
    return max(max(distance.x, distance.y), max(distance.z, 0.0));
}

float clearance_at(vec3 position) {
    vec3 shares = max(position * SCENE.grid_reach_high, -position * SCENE.grid_reach_low);
    float share = max(max(shares.x, shares.y), shares.z);
    if (!(share < 1.0)) {
        return bounds_distance(position);
    }
    uvec3 size = SCENE.grid_size;
    uint cells = size.x * size.y * size.z;
    uint first = 0;
    float scale = 1.0, unit = 0.25;
    for (uint level = 1; level < GRID_LEVELS; ++level) {
        bool held = share * float(1u << level) < 1.0;
        first = held ? level * cells : first;
        scale = held ? float(1u << level) : scale;
        unit = held ? unit * 0.5 : unit;
    }
    // Clamped as whole numbers, so that no rounding leads out of the grid.
    uvec3 at = min(uvec3(max(position * scale + SCENE.grid_focus_cell, vec3(0.0))), size - 1u);
    return clearance((at.z * size.y + at.y) * size.x + at.x + first) * unit;
}

Curve grid_curve(Curve curve) {
    float scale = SCENE.grid_inverse_cell;
    return Curve((curve.start - SCENE.grid_focus) * scale, curve.c1 * scale, curve.c2 * scale, curve.c3 * scale, curve.chords);
}

vec2 occupied_span(Curve curve, float room, out float end_room) {
    vec3 inner = curve.c1 + curve.c2;
    vec3 chord = inner + curve.c3;
    vec3 legs = vec3(length(curve.c1), length(inner), length(inner + curve.c2 + curve.c3 * 3.0));
    float half_polygon = (legs.x + legs.y + legs.z) * ((1.0 + CHORD_SLACK) / 6.0);
    float middle = clearance_at(curve.start + chord * 0.5);
    if (middle >= half_polygon) {
        end_room = middle - half_polygon;
        return vec2(1.0, 1.0);
    }
    float rate = 1.0 / max(max(legs.x, legs.y), legs.z);
    end_room = clearance_at(curve_point(curve, 1.0));
    float gain = room * rate, loss = end_room * rate;
    float from = gain < LEAST_GAIN ? 0.0 : min(gain, 1.0);
    return vec2(from, loss < LEAST_GAIN ? 1.0 : max(1.0 - loss, from));
}
