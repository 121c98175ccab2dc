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
    return Curve((curve.start - SCENE.grid_focus) * scale, curve.c1 * scale, curve.c2 * scale, curve.c3 * scale, curve.chords, curve.inflation);
}

vec2 occupied_span(Curve curve) {
    vec3 inner = curve.c1 + curve.c2;
    vec3 chord = inner + curve.c3;
    float first_length = length(curve.c1);
    float last_length = length(inner + curve.c2 + curve.c3 * 3.0);
    float polygon = first_length + last_length + length(chord);
    if (clearance_at(curve.start + chord * 0.5) >= 0.5 * polygon) {
        return vec2(1.0, 1.0);
    }
    float rate = 1.0 / max(max(first_length, length(inner)), last_length);
    float from = 0.0, to = 1.0;
    for (uint i = 0; i < MARCH_STEPS; ++i) {
        float gain = clearance_at(curve_point(curve, from)) * rate;
        from = gain < MARCH_GAIN ? from : min(from + gain, 1.0);
        float loss = clearance_at(curve_point(curve, to)) * rate;
        to = loss < MARCH_GAIN ? to : to - loss;
    }
    return vec2(from, max(to, from));
}
