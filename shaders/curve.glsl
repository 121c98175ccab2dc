// A segment of a ray; documented in src/kernels/curve.rs.

struct Curve {
    vec3 start;
    vec3 c1;
    vec3 c2;
    vec3 c3;
    uint chords;
};

Curve straight(vec3 origin, vec3 direction) {
    return Curve(origin, direction, vec3(0.0), vec3(0.0), 1u);
}

Curve hermite(vec3 start, vec3 end, vec3 tangent0, vec3 tangent1) {
    vec3 chord = end - start;
    vec3 c2 = chord * 3.0 - tangent0 * 2.0 - tangent1;
    vec3 c3 = tangent0 + tangent1 - chord * 2.0;
    return Curve(start, tangent0, c2, c3, 1u);
}

vec3 curve_point(Curve curve, float s) {
    return curve.start + (curve.c1 + (curve.c2 + curve.c3 * s) * s) * s;
}

vec3 curve_tangent(Curve curve, float s) {
    return curve.c1 + (curve.c2 * 2.0 + curve.c3 * (3.0 * s)) * s;
}

Curve cut_span(Curve curve, float from, float to, float tolerance) {
    float w = to - from;
    vec3 c1 = curve_tangent(curve, from) * w;
    vec3 c2 = (curve.c2 + curve.c3 * (3.0 * from)) * (w * w);
    vec3 c3 = curve.c3 * (w * w * w);
    vec3 c2_end = c2 + c3 * 3.0;
    // The sagitta of a chord is an eighth of the largest second derivative.
    float sagitta = sqrt(max(dot(c2, c2), dot(c2_end, c2_end))) * 0.25;
    float chords = clamp(ceil(sqrt(sagitta / tolerance)), 1.0, float(MAX_CHORDS));
    return Curve(curve_point(curve, from), c1, c2, c3, uint(chords));
}

void deviation(Curve curve, out vec3 down, out vec3 up) {
    vec3 first = curve.c2 + curve.c3, last = curve.c2 + curve.c3 * 2.0;
    float quarter = curve.chords > 1 ? 0.25 : 0.0;
    down = max(max(first, last), 0.0) * quarter;
    up = max(-min(first, last), 0.0) * quarter;
}

vec3 whole_chord(Curve curve) {
    return curve.c1 + curve.c2 + curve.c3;
}

vec3 hit_position(Curve curve, float t) {
    if (curve.chords == 1) {
        return curve.start + whole_chord(curve) * t;
    }
    float count = float(curve.chords);
    float j = min(floor(t * count), count - 1.0);
    vec3 from = curve_point(curve, j / count);
    vec3 to = curve_point(curve, (j + 1.0) / count);
    return from + (to - from) * (t * count - j);
}
