// The clearance grid; documented in src/kernels/clearance.rs.

float clearance_at(vec3 position) {
    vec3 cell = (position - SCENE.grid_min) / SCENE.grid_cell;
    bool inside = all(greaterThanEqual(cell, vec3(0.0))) && all(lessThan(cell, vec3(SCENE.grid_size)));
    if (!inside) {
        return 0.0;
    }
    uvec3 at = uvec3(cell);
    uint index = (at.z * SCENE.grid_size.y + at.y) * SCENE.grid_size.x + at.x;
    return clearance(index) * SCENE.grid_cell * 0.25;
}

vec2 occupied_span(Curve curve) {
    float rate = 1.0 / curve_speed(curve);
    float from = 0.0;
    for (uint i = 0; i < MARCH_STEPS; ++i) {
        float gain = clearance_at(curve_point(curve, from)) * rate;
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
        float gain = clearance_at(curve_point(curve, to)) * rate;
        if (gain < MARCH_GAIN || to <= from) {
            break;
        }
        to -= gain;
    }
    return vec2(from, to);
}
