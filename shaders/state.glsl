// Paths in memory: nine words of four numbers for the path and its ray's end, two for the frame there, six for a ray in flight.

// A path whose ray has ended. Where that began, and on which side, is not loaded: what shading stores has a new ray.
PathState load_path(uint slot) {
    uvec4 throughput = load_word(slot, WORD_THROUGHPUT);
    uvec4 radiance = load_word(slot, WORD_RADIANCE);
    uvec4 cone = load_word(slot, WORD_CONE);
    return PathState(vec3(0.0), uintBitsToFloat(cone.x), vec3(0.0), uintBitsToFloat(cone.y), uintBitsToFloat(throughput.xyz), throughput.w,
        uintBitsToFloat(radiance.xyz), uvec2(radiance.w, cone.w), uintBitsToFloat(cone.z), 0u);
}

void store_radiance(uint slot, PathState path) {
    store_word(slot, WORD_RADIANCE, path.radiance, path.media.x);
}

// A path whose next ray has not started.
void store_path(uint slot, PathState path) {
    store_vector(slot, WORD_ORIGIN, path.origin);
    store_word(slot, WORD_DIRECTION, path.direction, path.side);
    store_word(slot, WORD_THROUGHPUT, path.throughput, path.bounce);
    store_radiance(slot, path);
    store_word(slot, WORD_CONE, vec3(path.width, path.spread, path.frequency_ratio), path.media.y);
    store_fresh(slot);
}

Arrival load_arrival(uint slot) {
    uvec4 position = load_word(slot, WORD_POSITION);
    uvec4 travel = load_word(slot, WORD_TRAVEL);
    vec4 surface = uintBitsToFloat(load_word(slot, WORD_SURFACE));
    uvec4 ledger = load_word(slot, WORD_LEDGER);
    vec3 diagonal = vec3(1.0), mixed = vec3(0.0);
#ifdef KERNEL_SHADE
    if (LOCAL_FRAMES) {
        diagonal = uintBitsToFloat(load_word(slot, WORD_DIAGONAL).xyz);
        mixed = uintBitsToFloat(load_word(slot, WORD_MIXED).xyz);
    }
#endif
    return Arrival(uintBitsToFloat(position.xyz), position.w, uintBitsToFloat(travel.xyz), travel.w % SIDE_UNIT, surface.x, surface.y, surface.z,
        surface.w, ledger.x, ledger.y, uintBitsToFloat(ledger.z), diagonal, mixed, uintBitsToFloat(ledger.w), travel.w / SIDE_UNIT);
}

void store_arrival(uint slot, Arrival arrival) {
    store_word(slot, WORD_POSITION, arrival.position, arrival.primitive);
    store_word(slot, WORD_TRAVEL, arrival.direction, arrival.status + arrival.side * SIDE_UNIT);
    store_word(slot, WORD_SURFACE, floatBitsToUint(vec4(arrival.u, arrival.v, arrival.path_length, arrival.redshift)));
    store_word(slot, WORD_LEDGER, uvec4(arrival.steps, arrival.chords, floatBitsToUint(arrival.constraint_error), floatBitsToUint(arrival.doppler)));
#ifdef METRIC
    store_vector(slot, WORD_DIAGONAL, arrival.frame_diagonal);
    store_vector(slot, WORD_MIXED, arrival.frame_mixed);
#endif
}

Aov miss_aov(Arrival arrival) {
    return Aov(vec3(0.0), arrival.redshift * arrival.doppler, vec3(0.0), arrival.path_length, vec3(0.0), arrival.constraint_error, 0u, arrival.status, arrival.steps, arrival.chords);
}

void store_aov(uvec3 pixel, Aov aov) {
    push.aovs.items[pixel.y * SCENE.film_width + pixel.x] = aov;
}
