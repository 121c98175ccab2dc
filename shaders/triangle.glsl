// Ray against four triangles, a coordinate of all four in each column; documented in src/kernels/triangle.rs.

mat3x4 lanes(vec3 v) {
    return mat3x4(vec4(v.x), vec4(v.y), vec4(v.z));
}

vec4 lanes_dot(mat3x4 a, mat3x4 b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

mat3x4 lanes_cross(mat3x4 a, mat3x4 b) {
    return mat3x4(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]);
}

bvec4 intersect_triangle(vec3 origin, vec3 direction, mat3x4 vertex, mat3x4 edge1, mat3x4 edge2, float t_max, out vec4 t, out vec4 u, out vec4 v) {
    mat3x4 d = lanes(direction);
    mat3x4 p = lanes_cross(d, edge2);
    vec4 inverse_det = 1.0 / lanes_dot(edge1, p);
    mat3x4 s = lanes(origin) - vertex;
    u = lanes_dot(s, p) * inverse_det;
    mat3x4 q = lanes_cross(s, edge1);
    v = lanes_dot(d, q) * inverse_det;
    t = lanes_dot(edge2, q) * inverse_det;
    bvec4 met;
    for (uint lane = 0; lane < 4; ++lane) {
        bool inside = u[lane] > -TRIANGLE_SLACK && v[lane] > -TRIANGLE_SLACK && u[lane] + v[lane] < 1.0 + TRIANGLE_SLACK;
        met[lane] = inside && t[lane] > 0.0 && t[lane] < t_max;
    }
    return met;
}
