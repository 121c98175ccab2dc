// Ray against triangle; documented in src/kernels/triangle.rs.

bool intersect_triangle(vec3 origin, vec3 direction, vec3 vertex, vec3 edge1, vec3 edge2, float t_max, out float t, out float u, out float v) {
    vec3 p = cross(direction, edge2);
    float inverse_det = 1.0 / dot(edge1, p);
    vec3 s = origin - vertex;
    u = dot(s, p) * inverse_det;
    vec3 q = cross(s, edge1);
    v = dot(direction, q) * inverse_det;
    t = dot(edge2, q) * inverse_det;
    bool inside = u > -TRIANGLE_SLACK && v > -TRIANGLE_SLACK && u + v < 1.0 + TRIANGLE_SLACK;
    return inside && t > 0.0 && t < t_max;
}
