// A table of three functions as a bicubic B-spline; documented in src/kernels/table.rs.

void spline_weights(real f, out real weights[4], out real slopes[4]) {
    real f2 = f * f, g = real(1.0) - f;
    real f3 = f2 * f;
    real sixth = real(1.0) / real(6.0);
    weights[0] = g * g * g * sixth;
    weights[1] = (real(3.0) * f3 - real(6.0) * f2 + real(4.0)) * sixth;
    weights[2] = (real(3.0) * (f2 - f3 + f) + real(1.0)) * sixth;
    weights[3] = f3 * sixth;
    slopes[0] = real(-0.5) * g * g;
    slopes[1] = real(1.5) * f2 - real(2.0) * f;
    slopes[2] = f + real(0.5) - real(1.5) * f2;
    slopes[3] = real(0.5) * f2;
}

void table_lookup(real u, real v, out real3 value, out real3 by_u, out real3 by_v) {
    real cells_u = real(TABLE_ROWS - 3), cells_v = real(TABLE_COLUMNS - 3);
    real s = u * cells_u, t = v * cells_v;
    real i = floor(clamp(s, real(0.0), cells_u - real(1.0)));
    real j = floor(clamp(t, real(0.0), cells_v - real(1.0)));
    real weight_u[4], slope_u[4], weight_v[4], slope_v[4];
    spline_weights(s - i, weight_u, slope_u);
    spline_weights(t - j, weight_v, slope_v);
    value = real3(0.0);
    by_u = real3(0.0);
    by_v = real3(0.0);
    for (uint a = 0; a < 4; ++a) {
        for (uint b = 0; b < 4; ++b) {
            real3 control = model_table((uint(i) + a) * TABLE_COLUMNS + uint(j) + b);
            value += control * (weight_u[a] * weight_v[b]);
            by_u += control * (slope_u[a] * weight_v[b] * cells_u);
            by_v += control * (weight_u[a] * slope_v[b] * cells_v);
        }
    }
}
