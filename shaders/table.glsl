// A table of three functions as a bicubic B-spline; documented in src/kernels/table.rs.

void spline_weights(real f, out real4 weights, out real4 slopes) {
    real f2 = f * f, g = real(1.0) - f;
    real f3 = f2 * f;
    real sixth = real(1.0) / real(6.0);
    weights = real4(g * g * g, real(3.0) * f3 - real(6.0) * f2 + real(4.0), real(3.0) * (f2 - f3 + f) + real(1.0), f3) * sixth;
    slopes = real4(real(-0.5) * g * g, real(1.5) * f2 - real(2.0) * f, f + real(0.5) - real(1.5) * f2, real(0.5) * f2);
}

void table_row(uint first, real4 weights, real4 slopes, out real3 value, out real3 change) {
    real3 a = model_table(first), b = model_table(first + 1), c = model_table(first + 2), d = model_table(first + 3);
    value = a * weights.x + b * weights.y + c * weights.z + d * weights.w;
    change = a * slopes.x + b * slopes.y + c * slopes.z + d * slopes.w;
}

void table_lookup(real u, real v, out real3 value, out real3 by_u, out real3 by_v) {
    real cells_u = real(TABLE_ROWS - 3), cells_v = real(TABLE_COLUMNS - 3);
    real s = u * cells_u, t = v * cells_v;
    real i = floor(clamp(s, real(0.0), cells_u - real(1.0)));
    real j = floor(clamp(t, real(0.0), cells_v - real(1.0)));
    real4 weights_u, slopes_u, weights_v, slopes_v;
    spline_weights(s - i, weights_u, slopes_u);
    spline_weights(t - j, weights_v, slopes_v);
    uint first = uint(i) * TABLE_COLUMNS + uint(j);
    value = by_u = by_v = real3(0.0);
    for (uint row = 0; row < 4; ++row) {
        real3 along, change;
        table_row(first + row * TABLE_COLUMNS, weights_v, slopes_v, along, change);
        value += along * weights_u[row];
        by_u += along * (slopes_u[row] * cells_u);
        by_v += change * (weights_u[row] * cells_v);
    }
}
