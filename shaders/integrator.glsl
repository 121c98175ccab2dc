// Steps along curved rays; documented in src/kernels/integrator.rs. `real` is float or double.

struct Flight {
    real3 x;
    real3 p;
    real3 a;
};

real3 along(real3 a, real3 b, real f) {
    return fma(b, real3(f), a);
}

real3 force(real3 x, real energy) {
    real3 gradient;
    real n = medium(x, energy, gradient);
    return gradient * n;
}

void nystrom_step(real energy, inout Flight flight, real h, out real error) {
    real h2 = h * h;
    real3 k0 = flight.a;
    real3 x1 = along(along(flight.x, flight.p, h * RKN_C1), k0, h2 * RKN_A10);
    real3 k1 = force(x1, energy);
    real3 x2 = along(along(along(flight.x, flight.p, h * RKN_C2), k0, h2 * RKN_A20), k1, h2 * RKN_A21);
    real3 k2 = force(x2, energy);
    real3 x = along(along(along(along(flight.x, flight.p, h), k0, h2 * RKN_B0), k1, h2 * RKN_B1), k2, h2 * RKN_B2);
    real3 k3 = force(x, energy);
    real3 p = along(along(along(along(flight.p, k0, h * RKN_V0), k1, h * RKN_V1), k2, h * RKN_V2), k3, h * RKN_V3);
    real3 ex = along(along(along(k0 * RKN_E0, k1, RKN_E1), k2, RKN_E2), k3, RKN_E3);
    real3 ep = along(along(along(k0 * RKN_F0, k1, RKN_F1), k2, RKN_F2), k3, RKN_F3);
    error = sqrt(dot(ex, ex) + dot(ep, ep)) * h2;
    flight = Flight(x, p, k3);
}

real step_factor(real error, real tolerance) {
    real ratio = tolerance / max(error, tolerance * real(1e-4));
    real factor = clamp(sqrt(sqrt(ratio)) * STEP_SAFETY, STEP_SHRINK, STEP_GROW);
    return error < tolerance * real(1e30) ? factor : STEP_SHRINK;
}

real first_step(real index, real3 a, real safe_length) {
    real bend = max(sqrt(dot(a, a)), real(1e-12));
    real len = min(index * index / bend * FIRST_STEP, safe_length);
    return len / index;
}

void euler_step(real energy, inout Flight flight, real h, real kick) {
    real3 gradient;
    medium(flight.x, energy, gradient);
    real speed = sqrt(dot(flight.p, flight.p));
    flight.x = along(flight.x, flight.p, h / speed);
    flight.p = along(flight.p, gradient, kick);
}

real arc_length(Flight from, Flight to, real h) {
    real3 middle = along((to.x - from.x) * real(1.5), from.p + to.p, real(-0.25) * h);
    real size = sqrt(dot(from.p, from.p)) + sqrt(dot(to.p, to.p));
    real inner = sqrt(dot(middle, middle));
    inner = h < real(0.0) ? -inner : inner;
    return (size * h + inner * real(4.0)) / real(6.0);
}

real enter_sphere(real3 x, real3 d, real3 center, real radius) {
    real3 f = x - center;
    real c = dot(f, f) - radius * radius;
    if (c < real(0.0)) {
        return real(0.0);
    }
    real b = dot(f, d) / dot(d, d);
    real3 nearest = along(f, d, -b);
    real discriminant = radius * radius - dot(nearest, nearest);
    if (real(0.0) < b || discriminant < real(0.0)) {
        return real(-1.0);
    }
    return -b - sqrt(discriminant / dot(d, d));
}

real3 asymptote(real3 x, real3 d, real strength) {
    real r = sqrt(dot(x, x));
    real s = dot(x, d);
    real3 offset = along(x, d, -s);
    return normalize(along(d, offset, -(strength / (r * (r + s)))));
}
