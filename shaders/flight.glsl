// A ray's flight through a bending model: straight up to the region, steps inside it, straight or along the asymptote behind it.
// One loop with one traversal, because every call site is a copy of the code. Twin of src/backend/cpu/advance.rs.

// Iterations of one dispatch; a ray that needs more goes on in the next round.
const uint ITERATIONS = 64;

const uint MODE_APPROACH = 0;
const uint MODE_STEP = 1;
const uint MODE_LEAVE = 2;

struct Ray {
    real3 x;
    real3 p;
    real energy;
    real h;
    // Sense times frequency at the start.
    float clock;
    real len;
    real parameter;
    uint steps;
    uint chords;
    uint side;
};

#ifdef REAL64
uvec4 pack_reals(double a, double b) {
    return uvec4(unpackDouble2x32(a), unpackDouble2x32(b));
}

void store_ray(uint slot, Ray ray) {
    store_word(slot, WORD_FLIGHT, pack_reals(ray.x.x, ray.x.y));
    store_word(slot, WORD_FLIGHT + 1, pack_reals(ray.x.z, ray.energy));
    store_word(slot, WORD_FLIGHT + 2, pack_reals(ray.p.x, ray.p.y));
    store_word(slot, WORD_FLIGHT + 3, pack_reals(ray.p.z, ray.h));
    store_word(slot, WORD_LAUNCH, uvec4(floatBitsToUint(ray.clock), ray.side, ray.steps, ray.chords));
    store_word(slot, WORD_LENGTH, pack_reals(ray.len, ray.parameter));
}

Ray load_ray(uint slot) {
    uvec4 a = load_word(slot, WORD_FLIGHT);
    uvec4 b = load_word(slot, WORD_FLIGHT + 1);
    uvec4 c = load_word(slot, WORD_FLIGHT + 2);
    uvec4 d = load_word(slot, WORD_FLIGHT + 3);
    uvec4 e = load_word(slot, WORD_LAUNCH);
    uvec4 f = load_word(slot, WORD_LENGTH);
    return Ray(dvec3(packDouble2x32(a.xy), packDouble2x32(a.zw), packDouble2x32(b.xy)),
        dvec3(packDouble2x32(c.xy), packDouble2x32(c.zw), packDouble2x32(d.xy)), packDouble2x32(b.zw), packDouble2x32(d.zw),
        uintBitsToFloat(e.x), packDouble2x32(f.xy), packDouble2x32(f.zw), e.z, e.w, e.y);
}
#else
void store_ray(uint slot, Ray ray) {
    store_word(slot, WORD_FLIGHT, ray.x, ray.energy);
    store_word(slot, WORD_FLIGHT + 2, ray.p, ray.h);
    store_word(slot, WORD_LAUNCH, uvec4(floatBitsToUint(ray.clock), ray.side, ray.steps, ray.chords));
    store_word(slot, WORD_LENGTH, uvec4(floatBitsToUint(ray.len), floatBitsToUint(ray.parameter), 0, 0));
}

Ray load_ray(uint slot) {
    vec4 a = uintBitsToFloat(load_word(slot, WORD_FLIGHT));
    vec4 c = uintBitsToFloat(load_word(slot, WORD_FLIGHT + 2));
    uvec4 e = load_word(slot, WORD_LAUNCH);
    vec4 f = uintBitsToFloat(load_word(slot, WORD_LENGTH));
    return Ray(a.xyz, c.xyz, a.w, c.w, uintBitsToFloat(e.x), f.x, f.y, e.z, e.w, e.y);
}
#endif

void land(uint slot, Arrival arrival);

Charge charge_of(Ray ray) {
    return Charge(ray.energy, ray.clock < 0.0 ? real(-1.0) : real(1.0));
}

// Reports the end of a ray that has the momentum `p` there. A traced ray also keeps its end in full precision. A ray that never
// entered the region was not launched and has no momentum.
void end_flight(uint slot, Ray ray, real3 d, Hit hit, Curve curve, uint status, bool launched, real3 p) {
    bool found = status == STATUS_HIT;
    vec3 position = found ? hit_position(curve, hit.t) : vec3(ray.x);
    Charge charge = charge_of(ray);
    real3 direction = d;
    float redshift = 1.0, drift = 0.0, doppler = 1.0;
    real3 diagonal = real3(1.0), mixed = real3(0.0);
    if (launched) {
        real3 seen, end = real3(position);
        real frequency, ignored, constraint_error;
        observe(ray.x, ray.p, charge.energy, charge.sense, ray.parameter, seen, frequency, constraint_error);
        drift = abs(float(constraint_error));
        observe(found ? end : ray.x, p, charge.energy, charge.sense, ray.parameter, seen, frequency, ignored);
        bool escaped = status == STATUS_ESCAPED;
#ifdef MOVING_FRAME
        direction = seen;
#else
        direction = escaped ? d : seen;
#endif
        redshift = abs(ray.clock) / float(escaped ? far_frequency(p, ray.energy) : frequency);
        vec3 velocity;
        if (found && matter_velocity(hit, position, velocity)) {
            doppler = float(frequency / matter_frequency(end, p, charge.energy, charge.sense, real3(velocity)));
        }
#ifdef METRIC
        if (found) {
            frame(end, diagonal, mixed);
        }
#endif
    }
    land(slot, Arrival(position, hit.primitive, vec3(direction), status, hit.u, hit.v, float(ray.len), redshift, ray.steps, ray.chords, drift,
        vec3(diagonal), vec3(mixed), doppler, ray.side));
    if (push.tracing != 0) {
        ray.x = found ? real3(position) : ray.x;
        ray.p = direction;
        store_ray(slot, ray);
        // The momentum goes where a path has its throughput.
#ifdef REAL64
        store_word(slot, WORD_THROUGHPUT, pack_reals(p.x, p.y));
        store_word(slot, WORD_RADIANCE, pack_reals(p.z, 0.0lf));
#else
        store_word(slot, WORD_THROUGHPUT, uvec4(floatBitsToUint(p), 0));
#endif
    }
}

real stop_value(uint i) {
    return real(push.stop_high[i]) + real(push.stop_low[i]);
}

// Signed distance of a point of a ray from where it is to stop: negative before it, for a plane on one side of it.
real stop_distance(real3 x, real len, real parameter) {
    if (push.stop == STOP_LENGTH) {
        return len - stop_value(0);
    }
    if (push.stop == STOP_PARAMETER) {
        return parameter - stop_value(0);
    }
    if (push.stop == STOP_SPHERE) {
        return coordinate_radius(x) - stop_value(0);
    }
    return dot(real3(stop_value(0), stop_value(1), stop_value(2)), x) - stop_value(3);
}

void advance(uint slot) {
    vec4 cone_origin = uintBitsToFloat(load_word(slot, WORD_ORIGIN));
    vec4 cone_direction = uintBitsToFloat(load_word(slot, WORD_DIRECTION));
    float width = cone_origin.w, spread = cone_direction.w;
    real3 center = real3(SCENE.region_center);
    real radius = real(SCENE.region_radius);
    bool fixed_step = SCENE.method == METHOD_EULER || SCENE.method == METHOD_SYMPLECTIC || SCENE.method == METHOD_LEAPFROG;
    fixed_step = fixed_step || (SCENE.method == METHOD_RUNGE_KUTTA && model_tableau(1) == real(0.0));
#ifdef MEDIUM
    bool euler = SCENE.method == METHOD_EULER;
#else
    bool euler = false;
#endif

    // Take the ray up where it is: before its launch, or in flight.
    Ray ray = load_ray(slot);
    real3 d = real3(0.0);
    real entry = real(0.0);
    uint mode = MODE_STEP;
    bool launched = true;
    real speed = real(1.0);
    if (ray.steps == FRESH || ray.steps == FRESH_TRACED) {
        launched = false;
        bool traced = ray.steps == FRESH_TRACED;
        d = traced ? ray.p : real3(cone_direction.xyz);
        speed = traced ? ray.energy : real(1.0);
        ray.x = traced ? ray.x : real3(cone_origin.xyz);
        ray.p = d;
        ray.clock = traced ? ray.clock : -1.0;
        ray.side = traced ? ray.side : load_word(slot, WORD_RATIO).y;
        ray.steps = 0;
        ray.chords = 0;
        ray.len = real(0.0);
        ray.parameter = real(0.0);
        entry = enter_sphere(ray.x, d, center, radius);
        mode = MODE_APPROACH;
    }
    Charge charge = charge_of(ray);
    Flight flight = Flight(ray.x, ray.p, ray.p, real3(0.0));
    real before = real(0.0);
    real safe = real(0.0), detail = real(0.0);
    if (launched) {
        safe_step(ray.x, safe, detail);
        flight = rate_at(charge, ray.x, ray.p, ray.parameter);
        if (ray.h == real(0.0)) {
            mode = MODE_LEAVE;
            d = normalize(flight.v);
        }
        before = push.stop == STOP_NONE ? real(0.0) : stop_distance(ray.x, ray.len, ray.parameter);
    }
    Flight moved = flight;
    real error, tolerance;
    float cone = 0.0;

    for (uint iteration = 0; iteration < ITERATIONS; ++iteration) {
        // Lay out the next piece of the path.
        Curve curve = straight(vec3(ray.x), vec3(d));
        Hit hit = Hit(FAR, NO_INDEX, 0.0, 0.0);
        bool look = true;
        vec2 span = vec2(0.0, 1.0);
        real piece = real(1.0);
        bool reached = false;
        if (mode == MODE_APPROACH) {
            look = entry != real(0.0);
            hit.t = entry < real(0.0) ? FAR : float(entry * (real(1.0) + REGION_MARGIN));
        } else if (mode == MODE_STEP) {
            moved = flight;
            cone = spread * float(ray.len) + width;
            vec3 size = abs(vec3(ray.x));
            tolerance = max(min(real(cone * SCENE.tolerance), detail * DETAIL_TOLERANCE), real(max(size.x, max(size.y, size.z))) * TOLERANCE_FLOOR);
            error = real(0.0);
#ifdef MEDIUM
            if (SCENE.method == METHOD_NYSTROM) {
                nystrom_step(charge, moved, ray.h, error);
            } else if (SCENE.method == METHOD_EULER) {
                euler_step(index_gradient(moved.x, ray.energy), moved, ray.h, SCENE.literal_kick == 1 ? real(1.0) : ray.h);
            } else if (SCENE.method == METHOD_LEAPFROG) {
                leapfrog_step(charge, moved, ray.parameter, ray.h);
            } else
#endif
            if (SCENE.method == METHOD_SYMPLECTIC) {
                symplectic_step(charge, moved, ray.parameter, ray.h);
            } else {
                runge_kutta_step(charge, moved, ray.parameter, ray.h, error);
            }
            ++ray.steps;
            if (COUNTING) {
                ++work.steps;
            }
            bool accepted = fixed_step || error < tolerance;
            real again = ray.h * step_factor(error, tolerance);
            piece = euler ? ray.h : arc_length(flight, moved, ray.h);
            bool crossing = false;
#ifdef RIM
            if (!fixed_step) {
                // No step goes across the rim: one that would ends a little before it, and the ray is put on the other side.
                real3 from_origin = moved.x - model_origin();
                real reach = length(from_origin);
                real near = length(flight.x - model_origin()) - model_rim(), far = reach - model_rim();
                real slack = RIM_SLACK * model_rim();
                real approach = dot(from_origin, moved.v) * (near < real(0.0) ? real(1.0) : real(-1.0));
                if (near * far < real(0.0) && abs(near) > slack) {
                    accepted = false;
                    again = ray.h * ((near - real(0.5) * sign(near) * slack) / (near - far));
                } else if (accepted && near * far > real(0.0) && abs(far) <= slack && approach > real(0.0)) {
                    real size = length(moved.v);
                    real jump = (abs(far) + real(0.5) * slack) / max(approach / (reach * size), RIM_COSINE);
                    moved = rate_at(charge, moved.x + moved.v * (jump / size), moved.p, ray.parameter + ray.h);
                    piece += jump;
                    crossing = true;
                }
            }
#endif
            if (accepted && push.stop != STOP_NONE) {
                // A step beyond the stop is taken again, to where the chord of the distances says it is.
                real after = stop_distance(moved.x, ray.len + piece, ray.parameter + ray.h);
                vec3 there = abs(vec3(moved.x));
                real scale = max(max(real(max(there.x, max(there.y, there.z))), real(1.0)), abs(stop_value(push.stop == STOP_PLANE ? 3 : 0)));
                real slack = real(100.0) * TOLERANCE_FLOOR * scale;
                bool armed = push.stop == STOP_PLANE ? abs(before) > slack : before < real(0.0);
                if (euler && push.stop == STOP_LENGTH) {
                    reached = -after < real(0.5) * ray.h;
                } else {
                    reached = armed && (abs(after) <= slack || (crossing && before * after < real(0.0)));
                    if (armed && !reached && before * after < real(0.0)) {
                        accepted = false;
                        again = ray.h * (before / (before - after));
                    }
                }
                before = accepted ? after : before;
            }
            if (accepted && SCENE.region_sharp != 0) {
                // A step past a sharp edge of the region is taken again, to a little past it.
                real inside = length(flight.x - center), beyond = length(moved.x - center);
                if (inside < radius && beyond > radius * (real(1.0) + EDGE_SLACK) && dot(moved.x - center, moved.v) > real(0.0)) {
                    accepted = false;
                    again = ray.h * ((radius * (real(1.0) + real(0.5) * EDGE_SLACK) - inside) / (beyond - inside));
                }
            }
            if (!accepted) {
                ray.h = again;
                if (ray.steps >= SCENE.max_steps) {
                    end_flight(slot, ray, d, hit, curve, STATUS_EXHAUSTED, true, ray.p);
                    return;
                }
                continue;
            }
            vec3 start = vec3(ray.x), end = vec3(moved.x);
            vec3 tangent0 = euler ? end - start : vec3(flight.v) * float(ray.h);
            vec3 tangent1 = euler ? end - start : vec3(moved.v) * float(ray.h);
            span = occupied_span(grid_curve(start, end, tangent0, tangent1));
            look = span.x < span.y;
            if (COUNTING && !look) {
                ++work.skips;
            }
            curve = cut_span(hermite(start, end, tangent0, tangent1), span.x, span.y, SCENE.chord_tolerance * cone);
            hit.t = 1.0;
        }
        float t_max = hit.t;
        if (look) {
            ++ray.chords;
            closest_hit(curve, ray.side, hit);
        }

        // See what it met and whether the ray is over.
        if (hit.primitive != NO_INDEX) {
            real s = real(span.x + (span.y - span.x) * hit.t);
            ray.len += piece * s;
            real3 p = ray.p;
            if (mode == MODE_STEP) {
                // Momentum from the cubic through both ends.
                real rest = real(1.0) - s;
                p = rest * rest * (flight.p * (real(1.0) + real(2.0) * s) + flight.a * (ray.h * s))
                    + s * s * (moved.p * (real(3.0) - real(2.0) * s) - moved.a * (ray.h * rest));
                ray.parameter += ray.h * s;
            }
            end_flight(slot, ray, d, hit, curve, STATUS_HIT, launched, p);
            return;
        }
        if (mode == MODE_LEAVE || (mode == MODE_APPROACH && entry < real(0.0))) {
            end_flight(slot, ray, d, hit, curve, STATUS_ESCAPED, launched, ray.p);
            return;
        }
        if (mode == MODE_APPROACH) {
            if (look) {
                ray.x += d * (entry * (real(1.0) + REGION_MARGIN));
                ray.len += real(t_max);
            }
            real3 p;
            real frequency;
            launch(ray.x, d, speed, charge.sense, p, ray.energy, frequency);
            ray.p = p;
            ray.clock = float(charge.sense * frequency);
            charge = charge_of(ray);
            flight = rate_at(charge, ray.x, ray.p, ray.parameter);
            safe_step(ray.x, safe, detail);
            if (!fixed_step) {
                ray.h = first_step(flight, safe);
            } else {
                ray.h = SCENE.method == METHOD_RUNGE_KUTTA ? model_step() / sqrt(dot(flight.v, flight.v)) : model_step();
            }
            before = push.stop == STOP_NONE ? real(0.0) : stop_distance(ray.x, ray.len, ray.parameter);
            launched = true;
            mode = MODE_STEP;
            continue;
        }
        flight = moved;
        ray.x = moved.x;
        ray.p = moved.p;
        ray.len += piece;
        ray.parameter += ray.h;
        real size = sqrt(dot(flight.v, flight.v));
        safe_step(ray.x, safe, detail);
        if (!fixed_step) {
            ray.h = min(ray.h * step_factor(error, tolerance), safe / size);
        } else if (SCENE.method == METHOD_RUNGE_KUTTA) {
            ray.h = model_step() / size;
        }
        bool crossed = false;
#ifdef THROAT
        real3 from_origin = ray.x - model_origin();
        if (dot(from_origin, from_origin) < model_throat() * model_throat()) {
            crossed = true;
            invert_through(from_origin, ray.p, model_throat());
            ray.x = from_origin + model_origin();
            flight = rate_at(charge, ray.x, ray.p, ray.parameter);
            real stretched = sqrt(dot(flight.v, flight.v));
            ray.h *= size / stretched;
            size = stretched;
            ray.side ^= 1u;
            before = push.stop == STOP_NONE ? real(0.0) : stop_distance(ray.x, ray.len, ray.parameter);
        }
#endif
        d = flight.v / size;
        real3 from_center = ray.x - center;
        bool outside = !crossed && dot(from_center, from_center) > radius * radius && dot(from_center, flight.v) > real(0.0);
        uint status = STATUS_FLYING;
        if (reached) {
            status = STATUS_STOPPED;
        } else if (capture_distance(ray.x, ray.p, real(abs(ray.clock)), charge.sense) < real(0.0)) {
            status = STATUS_CAPTURED;
        } else if (outside) {
            if (SCENE.region_strength != 0.0) {
                d = asymptote(from_center, d, real(SCENE.region_strength));
                status = STATUS_ESCAPED;
            } else {
                mode = MODE_LEAVE;
            }
        } else if (ray.steps >= SCENE.max_steps) {
            status = STATUS_EXHAUSTED;
        }
        if (status != STATUS_FLYING) {
            end_flight(slot, ray, d, hit, curve, status, true, ray.p);
            return;
        }
    }

    // Out of iterations: go on in the next round. A step length of 0 marks a ray that is about to leave.
    if (!launched) {
        ray.steps = FRESH;
    }
    ray.h = mode == MODE_LEAVE ? real(0.0) : ray.h;
    store_ray(slot, ray);
    queue[queue_advance(1 - push.parity) + atomicAdd(counters[COUNT_NEXT], 1)] = slot;
}
