// A ray's flight through a bending model: straight up to the region, steps inside it, straight or along the asymptote behind it.
// The loop of the steps holds nothing else: what only few rays of a subgroup do there, all of them wait for. Twin of
// src/backend/cpu.

// Whether rays are traced on their own is known when the pipeline is built.
layout(constant_id = 2) const bool TRACING = false;

// Iterations of one dispatch; a ray that needs more goes on in the next round.
const uint ITERATIONS = 64;

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
    if (TRACING) {
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
    // Width at the start and growth of the cone.
    vec2 cone = uintBitsToFloat(load_word(slot, WORD_CONE).xy);
    real3 center = real3(SCENE.region_center);
    real radius = real(SCENE.region_radius);
    bool fixed_step = METHOD == METHOD_EULER || METHOD == METHOD_SYMPLECTIC || METHOD == METHOD_LEAPFROG;
    fixed_step = fixed_step || (METHOD >= METHOD_RUNGE_KUTTA && tableau(1) == real(0.0));
#ifdef MEDIUM
    bool euler = METHOD == METHOD_EULER;
#else
    bool euler = false;
#endif
    bool stops = TRACING && push.stop != STOP_NONE;

    // Bring a ray that starts to the region, and launch it there.
    Ray ray = load_ray(slot);
    bool fresh = ray.steps == FRESH;
    uint status = STATUS_FLYING;
    real3 d = real3(0.0);
    Curve curve = straight(vec3(0.0), vec3(0.0));
    Hit hit = Hit(FAR, NO_INDEX, 0.0, 0.0);
    if (fresh) {
        real speed = TRACING ? ray.energy : real(1.0);
        uvec4 direction = load_word(slot, WORD_DIRECTION);
        d = TRACING ? ray.p : real3(uintBitsToFloat(direction.xyz));
        ray = Ray(TRACING ? ray.x : real3(uintBitsToFloat(load_word(slot, WORD_ORIGIN).xyz)), d, real(0.0), real(0.0), TRACING ? ray.clock : -1.0,
            real(0.0), real(0.0), 0u, 0u, TRACING ? ray.side : direction.w);
        real entry = enter_sphere(ray.x, d, center, radius);
        if (entry != real(0.0)) {
            real way = entry * (real(1.0) + REGION_MARGIN);
            curve = straight(vec3(ray.x), vec3(d));
            hit.t = entry < real(0.0) ? FAR : float(way);
            float t_max = hit.t;
            ++ray.chords;
            closest_hit(curve, ray.side, hit);
            if (hit.primitive != NO_INDEX) {
                status = STATUS_HIT;
                ray.len = real(hit.t);
            } else if (entry < real(0.0)) {
                status = STATUS_ESCAPED;
            } else {
                ray.x += d * way;
                ray.len = real(t_max);
            }
        }
        if (status == STATUS_FLYING) {
            real3 p;
            real frequency;
            launch(ray.x, d, speed, ray.clock < 0.0 ? real(-1.0) : real(1.0), p, ray.energy, frequency);
            ray.p = p;
            ray.clock *= float(frequency);
        }
    }
    bool launched = status == STATUS_FLYING;
    Charge charge = charge_of(ray);
    Flight flight = rate_at(charge, ray.x, ray.p, ray.parameter);
    Flight moved = flight;
    real safe, detail;
    safe_step_of(ray.x, flight.v, safe, detail);
    if (fresh) {
        if (!fixed_step) {
            real longest = longest_first_step(flight, safe);
            real3 end_force = rate_at(charge, along(ray.x, flight.v, longest), along(ray.p, flight.a, longest), longest).a;
            float width = cone.y * float(ray.len) + cone.x;
            real tolerance = step_tolerance(ray.x, real(width), real(SCENE.tolerance), detail, TOLERANCE_FLOOR);
            ray.h = first_step(flight, end_force, longest, tolerance);
        } else {
            ray.h = METHOD >= METHOD_RUNGE_KUTTA ? model_step() / sqrt(dot(flight.v, flight.v)) : model_step();
        }
    }
    real before = stops ? stop_distance(ray.x, ray.len, ray.parameter) : real(0.0);

    bool leaving = false, look = false;
    vec2 span = vec2(0.0, 1.0);
    real piece = real(0.0);
    // Not kept from round to round: the length with which the last step would just have met its tolerance, or 0, and a lower bound of the
    // clearance where the ray is.
    real ideal = real(0.0);
    float room = 0.0;
    for (uint iteration = 0; iteration < ITERATIONS && launched; ++iteration) {
        moved = flight;
        float width = cone.y * float(ray.len) + cone.x;
        real tolerance = step_tolerance(ray.x, real(width), real(SCENE.tolerance), detail, TOLERANCE_FLOOR);
        real error = real(0.0), stray = real(0.0);
#ifdef MEDIUM
        if (METHOD == METHOD_NYSTROM) {
            nystrom_step(charge, moved, ray.h, error);
        } else if (METHOD == METHOD_EULER) {
            euler_step(index_gradient(moved.x, ray.energy), moved, ray.h, SCENE.literal_kick == 1 ? real(1.0) : ray.h);
        } else if (METHOD == METHOD_LEAPFROG) {
            leapfrog_step(charge, moved, ray.parameter, ray.h);
        } else
#endif
        if (METHOD == METHOD_SYMPLECTIC) {
            symplectic_step(charge, moved, ray.parameter, ray.h);
        } else {
            runge_kutta_step(charge, moved, ray.parameter, ray.h, error, stray);
        }
        ++ray.steps;
        if (COUNTING) {
            ++work.steps;
        }
        bool accepted = fixed_step || error < tolerance;
        real margin = step_margin(error, tolerance);
        real again = ray.h * step_factor(margin, real(1.0));
        piece = euler ? ray.h : arc_length(flight, moved, ray.h);
        bool crossing = false, reached = false;
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
        if (accepted && stops) {
            // A step beyond the stop is taken again, to where the chord of the distances says it is.
            real after = stop_distance(moved.x, ray.len + piece, ray.parameter + ray.h);
            real size = max(real(1.0), abs(stop_value(push.stop == STOP_PLANE ? 3 : 0)));
            real share = real(100.0) * TOLERANCE_FLOOR;
            real slack_before = share * max(size, largest_coordinate(ray.x)), slack = share * max(size, largest_coordinate(moved.x));
            bool armed = push.stop == STOP_PLANE ? abs(before) > slack_before : before < real(0.0);
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
        if (accepted) {
            vec3 start = vec3(ray.x), end = vec3(moved.x);
            vec3 tangent0 = euler ? end - start : vec3(flight.v) * float(ray.h);
            vec3 tangent1 = euler ? end - start : vec3(moved.v) * float(ray.h);
            Curve whole = hermite(start, end, tangent0, tangent1);
            float end_room;
            span = occupied_span(grid_curve(whole), room, end_room);
            look = span.x < span.y;
            real allowed = max(tolerance, largest_coordinate(ray.x) * TOLERANCE_FLOOR_F32);
            if (look && !fixed_step && allowed < stray) {
                // Where something may be met, the way between the ends must be as exact as they are, and as the hits: these are single.
                accepted = false;
                again = ray.h * step_factor(step_margin(stray, allowed), real(1.0));
            }
            room = accepted ? end_room : room;
            curve = cut_span(whole, span.x, span.y, SCENE.chord_tolerance * width);
        }
        if (!accepted) {
            ray.h = again;
            if (ray.steps >= SCENE.max_steps) {
                status = STATUS_EXHAUSTED;
                break;
            }
            continue;
        }
        if (COUNTING && !look) {
            ++work.skips;
        }
        if (look) {
            ++ray.chords;
            hit.t = 1.0;
            closest_hit(curve, ray.side, hit);
            if (hit.primitive != NO_INDEX) {
                status = STATUS_HIT;
                break;
            }
        }

        // The step is done; see whether the ray is over.
        flight = moved;
        ray.x = moved.x;
        ray.p = moved.p;
        ray.len += piece;
        ray.parameter += ray.h;
        safe_step_of(ray.x, flight.v, safe, detail);
        if (!fixed_step) {
            real ideal_before = ideal;
            ideal = ideal_step(ray.h, error, tolerance);
            ray.h = min(ray.h * step_factor(margin, step_trend(ideal, ideal_before)), safe);
            ideal = crossing ? real(0.0) : ideal;
        } else if (METHOD >= METHOD_RUNGE_KUTTA) {
            ray.h = model_step() / length(flight.v);
        }
        bool crossed = false;
#ifdef THROAT
        real3 from_origin = ray.x - model_origin();
        if (dot(from_origin, from_origin) < model_throat() * model_throat()) {
            crossed = true;
            invert_through(from_origin, ray.p, model_throat());
            ray.x = from_origin + model_origin();
            real speed = length(flight.v);
            flight = rate_at(charge, ray.x, ray.p, ray.parameter);
            ray.h *= speed / length(flight.v);
            ray.side ^= 1u;
            room = 0.0;
            ideal = real(0.0);
            before = stops ? stop_distance(ray.x, ray.len, ray.parameter) : real(0.0);
        }
#endif
        real3 from_center = ray.x - center;
        bool outside = !crossed && dot(from_center, from_center) > radius * radius && dot(from_center, flight.v) > real(0.0);
        if (reached) {
            status = STATUS_STOPPED;
        } else if (capture_distance(ray.x, ray.p, real(abs(ray.clock)), charge.sense) < real(0.0)) {
            status = STATUS_CAPTURED;
        } else if (!outside && ray.steps >= SCENE.max_steps) {
            status = STATUS_EXHAUSTED;
        }
        leaving = outside && status == STATUS_FLYING;
        if (leaving || status != STATUS_FLYING) {
            break;
        }
    }

    // Momentum at a hit: from the cubic through both ends of the step.
    real3 p = ray.p;
    if (launched && status == STATUS_HIT) {
        real s = real(span.x + (span.y - span.x) * hit.t);
        real rest = real(1.0) - s;
        p = rest * rest * (flight.p * (real(1.0) + real(2.0) * s) + flight.a * (ray.h * s))
            + s * s * (moved.p * (real(3.0) - real(2.0) * s) - moved.a * (ray.h * rest));
        ray.len += piece * s;
        ray.parameter += ray.h * s;
    }
    if (leaving) {
        d = normalize(flight.v);
        status = STATUS_ESCAPED;
        if (SCENE.region_strength != 0.0) {
            d = asymptote(ray.x - center, d, real(SCENE.region_strength));
        } else {
            curve = straight(vec3(ray.x), vec3(d));
            hit.t = FAR;
            ++ray.chords;
            closest_hit(curve, ray.side, hit);
            if (hit.primitive != NO_INDEX) {
                status = STATUS_HIT;
                ray.len += real(hit.t);
            }
        }
    }
    if (status != STATUS_FLYING) {
        end_flight(slot, ray, d, hit, curve, status, launched, p);
    } else {
        // Out of iterations: go on in the next round.
        store_ray(slot, ray);
        queue[queue_advance(1 - push.parity) + atomicAdd(counters[COUNT_NEXT], 1)] = slot;
    }
}
