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
