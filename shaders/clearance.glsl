// The clearance grid; documented in src/kernels/clearance.rs.

float bounds_distance(vec3 cell) {
    vec3 distance = max(SCENE.bounds_low - cell, cell - SCENE.bounds_high);
    return max(max(distance.x, distance.y), max(distance.z, 0.0));
}

float clearance_at(vec3 cell) {
    uvec3 size = SCENE.grid_size;
    float low = min(min(cell.x, cell.y), cell.z);
    float high = max(max(cell.x, cell.y), cell.z);
    if (low < 0.0 || high > 65536.0) {
        return bounds_distance(cell);
    }
    uvec3 at = uvec3(cell);
    if (any(greaterThanEqual(at, size))) {
        return bounds_distance(cell);
    }
    return clearance((at.z * size.y + at.y) * size.x + at.x) * 0.25;
}

Curve grid_curve(Curve curve) {
    float scale = SCENE.grid_inverse_cell;
    return Curve((curve.start - SCENE.grid_min) * scale, curve.c1 * scale, curve.c2 * scale, curve.c3 * scale, curve.chords, curve.inflation);
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
