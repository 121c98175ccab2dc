// Steps along curved rays; documented in src/kernels/integrator.rs. `real` is float or double.

#include "tableau.glsl"

// The method is known when the pipeline is built.
layout(constant_id = 1) const uint METHOD = METHOD_DORMAND_PRINCE;

struct Flight {
    real3 x;
    real3 p;
    real3 v;
    real3 a;
};

struct Charge {
    real energy;
    real sense;
};

real3 along(real3 a, real3 b, real f) {
    return fma(b, real3(f), a);
}

Flight rate_at(Charge charge, real3 x, real3 p, real parameter) {
    real3 v, a;
    rate(x, p, charge.energy, charge.sense, parameter, v, a);
    return Flight(x, p, v, a);
}

real3 nystrom_force(Charge charge, real3 x, real3 p) {
    return rate_at(charge, x, p, real(0.0)).a;
}

void nystrom_step(Charge charge, inout Flight flight, real h, out real error) {
    real h2 = h * h;
    real3 k0 = flight.a;
    real3 x1 = along(along(flight.x, flight.p, h * RKN_C1), k0, h2 * RKN_A10);
    real3 k1 = nystrom_force(charge, x1, flight.p);
    real3 x2 = along(along(along(flight.x, flight.p, h * RKN_C2), k0, h2 * RKN_A20), k1, h2 * RKN_A21);
    real3 k2 = nystrom_force(charge, x2, flight.p);
    real3 x = along(along(along(along(flight.x, flight.p, h), k0, h2 * RKN_B0), k1, h2 * RKN_B1), k2, h2 * RKN_B2);
    real3 k3 = nystrom_force(charge, x, flight.p);
    real3 p = along(along(along(along(flight.p, k0, h * RKN_V0), k1, h * RKN_V1), k2, h * RKN_V2), k3, h * RKN_V3);
    real3 ex = along(along(along(k0 * RKN_E0, k1, RKN_E1), k2, RKN_E2), k3, RKN_E3);
    real3 ep = along(along(along(k0 * RKN_F0, k1, RKN_F1), k2, RKN_F2), k3, RKN_F3);
    error = sqrt(dot(ex, ex) + dot(ep, ep)) * h2;
    flight = Flight(x, p, p, k3);
}

// An entry of the method's tableau.
real tableau(uint i) {
    uint method = METHOD < METHOD_RUNGE_KUTTA ? METHOD_DORMAND_PRINCE : METHOD;
    return tableau_entry((method - METHOD_RUNGE_KUTTA) * TABLEAU_SIZE + i);
}

// Rates at the stages of a step.
real3 stage_v[MAX_STAGES];
real3 stage_a[MAX_STAGES];

void take_stage(uint i, Charge charge, Flight flight, real parameter, real h, inout Flight state) {
    stage_v[i] = stage_a[i] = real3(0.0);
    if (i < uint(tableau(0))) {
        real3 x = flight.x, p = flight.p;
        for (uint j = 0; j < i; ++j) {
            real weight = h * tableau(2 + (3 + i) * MAX_STAGES + j);
            x = along(x, stage_v[j], weight);
            p = along(p, stage_a[j], weight);
        }
        state = rate_at(charge, x, p, fma(h, tableau(2 + i), parameter));
        stage_v[i] = state.v;
        stage_a[i] = state.a;
    }
}

void runge_kutta_step(Charge charge, inout Flight flight, real parameter, real h, out real error, out real stray) {
    Flight state = flight;
    stage_v[0] = flight.v;
    stage_a[0] = flight.a;
    // Not a loop: stages that are picked by a variable would be kept in memory.
    take_stage(1, charge, flight, parameter, h, state);
    take_stage(2, charge, flight, parameter, h, state);
    take_stage(3, charge, flight, parameter, h, state);
    take_stage(4, charge, flight, parameter, h, state);
    take_stage(5, charge, flight, parameter, h, state);
    take_stage(6, charge, flight, parameter, h, state);
    real3 ex = real3(0.0), ep = real3(0.0), quartic = real3(0.0);
    for (uint j = 0; j < MAX_STAGES; ++j) {
        real weight = tableau(2 + MAX_STAGES + j);
        ex = along(ex, stage_v[j], weight);
        ep = along(ep, stage_a[j], weight);
        quartic = along(quartic, stage_v[j], tableau(2 + 2 * MAX_STAGES + j));
    }
    real turn = h * h * dot(flight.v, flight.v) / dot(flight.p, flight.p);
    error = sqrt(dot(ex, ex) + dot(ep, ep) * turn) * abs(h);
    stray = sqrt(dot(quartic, quartic)) * abs(h) / real(16.0);
    flight = state;
}

void symplectic_step(Charge charge, inout Flight flight, real parameter, real h) {
    Flight at = flight;
    for (uint i = 0; i < SYMPLECTIC_ITERATIONS; ++i) {
        at = rate_at(charge, flight.x, along(flight.p, at.a, h), parameter);
    }
    flight = rate_at(charge, along(flight.x, at.v, h), at.p, parameter + h);
}

void leapfrog_step(Charge charge, inout Flight flight, real parameter, real h) {
    real half_step = h * real(0.5);
    real3 p = along(flight.p, flight.a, half_step);
    flight = rate_at(charge, along(flight.x, p, h), p, parameter + h);
    flight.p = along(p, flight.a, half_step);
    flight.v = flight.p;
}

real largest_coordinate(real3 x) {
    real3 size = abs(x);
    return max(size.x, max(size.y, size.z));
}

real step_tolerance(real3 x, real cone, real share, real detail, real floor_share) {
    return max(min(cone * share, detail * DETAIL_TOLERANCE), largest_coordinate(x) * floor_share);
}

real step_margin(real error, real tolerance) {
    real ratio = tolerance / max(error, tolerance * LEAST_ERROR);
    return error < tolerance * real(1e30) ? sqrt(sqrt(ratio)) : STEP_SHRINK;
}

real ideal_step(real h, real error, real tolerance) {
    return tolerance * LEAST_ERROR < error ? abs(h) * step_margin(error, tolerance) : real(0.0);
}

real step_trend(real ideal, real before) {
    return real(0.0) < min(ideal, before) ? ideal / before : real(1.0);
}

real step_factor(real margin, real trend) {
    return clamp(margin * STEP_SAFETY * max(min(real(1.0), trend), STEP_SHRINK), STEP_SHRINK, STEP_GROW);
}

void safe_step_of(real3 x, real3 v, out real safe, out real detail) {
    real slowness = real(1.0) / sqrt(max(dot(v, v), real(1e-30)));
    safe_step(x, v * slowness, safe, detail);
    safe *= slowness;
}

real longest_first_step(Flight flight, real safe) {
    real bend = max(sqrt(dot(flight.a, flight.a)), real(1e-12));
    return min(sqrt(dot(flight.p, flight.p)) / bend * FIRST_STEP, safe);
}

real first_step(Flight flight, real3 end_force, real longest, real tolerance) {
    real3 change = end_force - flight.a;
    real turn = longest * longest * sqrt(dot(flight.v, flight.v) / dot(flight.p, flight.p));
    return longest * min(step_margin(sqrt(dot(change, change)) * turn * FIRST_ERROR, tolerance), real(1.0));
}

void euler_step(real3 gradient, inout Flight flight, real h, real kick) {
    real speed = sqrt(dot(flight.p, flight.p));
    flight.x = along(flight.x, flight.p, h / speed);
    flight.p = along(flight.p, gradient, kick);
    flight.v = flight.p;
}

real arc_length(Flight from, Flight to, real h) {
    real3 middle = along((to.x - from.x) * real(1.5), from.v + to.v, real(-0.25) * h);
    real size = sqrt(dot(from.v, from.v)) + sqrt(dot(to.v, to.v));
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
    return max(-b - sqrt(discriminant / dot(d, d)), real(0.0));
}

void invert_through(inout real3 x, inout real3 p, real throat) {
    real share = throat * throat / dot(x, x);
    real radial = real(-2.0) * dot(x, p) / dot(x, x);
    p = along(p, x, radial) / share;
    x *= share;
}

real3 asymptote(real3 x, real3 d, real strength) {
    real r = sqrt(dot(x, x));
    real s = dot(x, d);
    real3 offset = along(x, d, -s);
    return normalize(along(d, offset, -(strength / (r * (r + s)))));
}
