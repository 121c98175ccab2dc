// The clearance grid; documented in src/kernels/clearance.rs.

struct GridCurve {
    vec3 start;
    vec3 c1;
    vec3 c2;
    vec3 c3;
};

float clearance_at(vec3 cell) {
    uvec3 size = SCENE.grid_size;
    float low = min(min(cell.x, cell.y), cell.z);
    float high = max(max(cell.x, cell.y), cell.z);
    if (low < 0.0 || high > 65536.0) {
        return 0.0;
    }
    uvec3 at = uvec3(cell);
    if (any(greaterThanEqual(at, size))) {
        return 0.0;
    }
    return clearance((at.z * size.y + at.y) * size.x + at.x) * 0.25;
}

vec3 grid_point(GridCurve curve, float s) {
    return curve.start + (curve.c1 + (curve.c2 + curve.c3 * s) * s) * s;
}

GridCurve grid_curve(vec3 start, vec3 end, vec3 tangent0, vec3 tangent1) {
    float scale = SCENE.grid_inverse_cell;
    vec3 chord = (end - start) * scale;
    vec3 t0 = tangent0 * scale, t1 = tangent1 * scale;
    return GridCurve((start - SCENE.grid_min) * scale, t0, chord * 3.0 - t0 * 2.0 - t1, t0 + t1 - chord * 2.0);
}

vec2 occupied_span(GridCurve curve) {
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
        float gain = clearance_at(grid_point(curve, from)) * rate;
        from = gain < MARCH_GAIN ? from : min(from + gain, 1.0);
        float loss = clearance_at(grid_point(curve, to)) * rate;
        to = loss < MARCH_GAIN ? to : to - loss;
    }
    return vec2(from, max(to, from));
}
