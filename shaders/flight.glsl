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
    float lapse;
    real len;
    uint steps;
    uint chords;
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
    store_word(slot, WORD_LAUNCH, uvec4(floatBitsToUint(ray.lapse), 0, ray.steps, ray.chords));
    store_word(slot, WORD_LENGTH, pack_reals(ray.len, 0.0lf));
}

Ray load_ray(uint slot) {
    uvec4 a = load_word(slot, WORD_FLIGHT);
    uvec4 b = load_word(slot, WORD_FLIGHT + 1);
    uvec4 c = load_word(slot, WORD_FLIGHT + 2);
    uvec4 d = load_word(slot, WORD_FLIGHT + 3);
    uvec4 e = load_word(slot, WORD_LAUNCH);
    return Ray(dvec3(packDouble2x32(a.xy), packDouble2x32(a.zw), packDouble2x32(b.xy)),
        dvec3(packDouble2x32(c.xy), packDouble2x32(c.zw), packDouble2x32(d.xy)), packDouble2x32(b.zw), packDouble2x32(d.zw),
        uintBitsToFloat(e.x), packDouble2x32(load_word(slot, WORD_LENGTH).xy), e.z, e.w);
}
#else
void store_ray(uint slot, Ray ray) {
    store_word(slot, WORD_FLIGHT, ray.x, ray.energy);
    store_word(slot, WORD_FLIGHT + 2, ray.p, ray.h);
    store_word(slot, WORD_LAUNCH, uvec4(floatBitsToUint(ray.lapse), floatBitsToUint(ray.len), ray.steps, ray.chords));
}

Ray load_ray(uint slot) {
    vec4 a = uintBitsToFloat(load_word(slot, WORD_FLIGHT));
    vec4 c = uintBitsToFloat(load_word(slot, WORD_FLIGHT + 2));
    uvec4 e = load_word(slot, WORD_LAUNCH);
    return Ray(a.xyz, c.xyz, a.w, c.w, uintBitsToFloat(e.x), uintBitsToFloat(e.y), e.z, e.w);
}
#endif

void land(uint slot, Arrival arrival);

// Reports the end of a ray. A traced ray also keeps its end in full precision.
void end_flight(uint slot, inout Ray ray, real3 d, Hit hit, Curve curve, uint status, bool drifted) {
    bool found = status == STATUS_HIT;
    vec3 position = found ? hit_position(curve, hit.t) : vec3(ray.x);
    vec3 direction = found ? normalize(curve_tangent(curve, hit.t)) : vec3(d);
    float lapse_end = status == STATUS_ESCAPED ? 1.0 : float(lapse(real3(position)));
    float drift = 0.0;
    real size = sqrt(dot(ray.p, ray.p));
    if (drifted) {
        real3 gradient;
        drift = abs(float(size / medium(ray.x, ray.energy, gradient)) - 1.0);
    }
    land(slot, Arrival(position, hit.primitive, direction, status, hit.u, hit.v, float(ray.len), lapse_end / ray.lapse, ray.steps, ray.chords, drift));
    if (push.tracing != 0) {
        ray.x = found ? real3(position) : ray.x;
        ray.p = found ? real3(direction) : d;
        ray.h = size;
        store_ray(slot, ray);
    }
}

void advance(uint slot) {
    vec4 cone_origin = uintBitsToFloat(load_word(slot, WORD_ORIGIN));
    vec4 cone_direction = uintBitsToFloat(load_word(slot, WORD_DIRECTION));
    float width = cone_origin.w, spread = cone_direction.w;
    real3 center = real3(SCENE.region_center);
    real radius = real(SCENE.region_radius);
    bool euler = SCENE.method == METHOD_EULER;
    bool limited = push.length_limit < FAR;

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
        ray.steps = 0;
        ray.chords = 0;
        ray.len = real(0.0);
        ray.lapse = float(lapse(ray.x));
        entry = enter_sphere(ray.x, d, center, radius);
        mode = MODE_APPROACH;
    }
    real3 a = launched ? force(ray.x, ray.energy) : real3(0.0);
    Flight moved;
    real error, tolerance;
    float cone = 0.0;

    for (uint iteration = 0; iteration < ITERATIONS; ++iteration) {
        // Lay out the next piece of the path.
        Curve curve = straight(vec3(ray.x), vec3(d));
        Hit hit = Hit(FAR, NO_INDEX, 0.0, 0.0);
        bool look = true;
        vec2 span = vec2(0.0, 1.0);
        if (mode == MODE_APPROACH) {
            look = entry != real(0.0);
            hit.t = entry < real(0.0) ? FAR : float(entry * (real(1.0) + REGION_MARGIN));
        } else if (mode == MODE_STEP) {
            moved = Flight(ray.x, ray.p, a);
            cone = spread * float(ray.len) + width;
            vec3 size = abs(vec3(ray.x));
            tolerance = max(real(cone * SCENE.tolerance), real(max(size.x, max(size.y, size.z))) * TOLERANCE_FLOOR);
            error = real(0.0);
            if (euler) {
                euler_step(ray.energy, moved, ray.h, SCENE.literal_kick == 1 ? real(1.0) : ray.h);
            } else {
                nystrom_step(ray.energy, moved, ray.h, error);
            }
            ++ray.steps;
            if (!(error < tolerance)) {
                ray.h *= step_factor(error, tolerance);
                if (ray.steps >= SCENE.max_steps) {
                    end_flight(slot, ray, normalize(ray.p), hit, curve, STATUS_EXHAUSTED, true);
                    return;
                }
                continue;
            }
            vec3 start = vec3(ray.x), end = vec3(moved.x);
            vec3 tangent0 = euler ? end - start : vec3(ray.p) * float(ray.h);
            vec3 tangent1 = euler ? end - start : vec3(moved.p) * float(ray.h);
            Curve step_curve = hermite(start, end, tangent0, tangent1);
            span = occupied_span(step_curve);
            look = span.x < span.y;
            curve = cut_span(step_curve, span.x, span.y, SCENE.chord_tolerance * cone);
            hit.t = 1.0;
        }
        float t_max = hit.t;
        if (look) {
            ++ray.chords;
            closest_hit(curve, hit);
        }

        // See what it met and whether the ray is over.
        real piece = real(1.0);
        if (mode == MODE_STEP) {
            piece = euler ? ray.h : arc_length(Flight(ray.x, ray.p, a), moved, ray.h);
        }
        if (hit.primitive != NO_INDEX) {
            ray.len += piece * real(span.x + (span.y - span.x) * hit.t);
            if (mode == MODE_STEP) {
                ray.x = moved.x;
                ray.p = moved.p;
            }
            end_flight(slot, ray, d, hit, curve, STATUS_HIT, mode == MODE_STEP);
            return;
        }
        if (mode == MODE_LEAVE || (mode == MODE_APPROACH && entry < real(0.0))) {
            end_flight(slot, ray, d, hit, curve, STATUS_ESCAPED, launched);
            return;
        }
        if (mode == MODE_APPROACH) {
            if (look) {
                ray.x += d * (entry * (real(1.0) + REGION_MARGIN));
                ray.len += real(t_max);
            }
            ray.energy = launch_energy(ray.x, speed);
            real3 gradient;
            real n = medium(ray.x, ray.energy, gradient);
            a = gradient * n;
            ray.p = d * n;
            ray.h = euler ? model_step() : first_step(n, a, safe_step(ray.x));
            if (limited && !euler) {
                ray.h = min(ray.h, real(push.length_limit) / n);
            }
            launched = true;
            mode = MODE_STEP;
            continue;
        }
        ray.x = moved.x;
        ray.p = moved.p;
        a = moved.a;
        ray.len += piece;
        real size = sqrt(dot(ray.p, ray.p));
        if (!euler) {
            ray.h = min(ray.h * step_factor(error, tolerance), safe_step(ray.x) / size);
        }
        d = ray.p / size;
        real3 from_center = ray.x - center;
        bool outside = dot(from_center, from_center) > radius * radius && dot(from_center, ray.p) > real(0.0);
        uint status = STATUS_FLYING;
        if (capture_distance(ray.x) < real(0.0)) {
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
        real left = real(push.length_limit) - ray.len;
        bool reached = euler ? left < real(0.5) * ray.h : abs(left) <= real(100.0) * TOLERANCE_FLOOR * real(push.length_limit);
        bool over = limited && mode == MODE_STEP && reached;
        if (status != STATUS_FLYING || over) {
            end_flight(slot, ray, d, hit, curve, status, true);
            return;
        }
        if (limited && !euler) {
            // Near the end the rest is stepped exactly, back if the last step went too far.
            ray.h = min(ray.h, left / size);
        }
    }

    // Out of iterations: go on in the next round. A ray that is about to leave takes its last step again.
    if (!launched) {
        ray.steps = FRESH;
    }
    store_ray(slot, ray);
    queue[queue_advance(1 - push.parity) + atomicAdd(counters[COUNT_NEXT], 1)] = slot;
}
