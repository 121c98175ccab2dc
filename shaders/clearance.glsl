// The clearance grid; documented in src/kernels/clearance.rs.

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

vec2 occupied_span(Curve curve) {
    float scale = SCENE.grid_inverse_cell;
    Curve grid_curve = Curve((curve.start - SCENE.grid_min) * scale, curve.c1 * scale, curve.c2 * scale, curve.c3 * scale, 1u, 0.0);
    vec3 end = curve_point(grid_curve, 1.0);
    float polygon = length(grid_curve.c1) + length(curve_tangent(grid_curve, 1.0)) + length(end - grid_curve.start);
    if (clearance_at((grid_curve.start + end) * 0.5) >= 0.5 * polygon) {
        return vec2(1.0, 1.0);
    }
    float rate = 1.0 / curve_speed(grid_curve);
    float from = 0.0;
    for (uint i = 0; i < MARCH_STEPS; ++i) {
        float gain = clearance_at(curve_point(grid_curve, from)) * rate;
        if (gain < MARCH_GAIN) {
            break;
        }
        from += gain;
        if (from >= 1.0) {
            return vec2(1.0, 1.0);
        }
    }
    float to = 1.0;
    for (uint i = 0; i < MARCH_STEPS; ++i) {
        float gain = clearance_at(curve_point(grid_curve, to)) * rate;
        if (gain < MARCH_GAIN || to <= from) {
            break;
        }
        to -= gain;
    }
    return vec2(from, to);
}
