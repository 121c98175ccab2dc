// Paths in memory: eleven words of four numbers for the path and its ray's end, six more for a ray in flight.

PathState load_path(uint slot) {
    uvec4 origin = load_word(slot, WORD_ORIGIN);
    uvec4 direction = load_word(slot, WORD_DIRECTION);
    uvec4 throughput = load_word(slot, WORD_THROUGHPUT);
    uvec4 radiance = load_word(slot, WORD_RADIANCE);
    uint outer_media = load_word(slot, WORD_LEDGER).w;
    uvec4 ratio = load_word(slot, WORD_RATIO);
    return PathState(uintBitsToFloat(origin.xyz), uintBitsToFloat(origin.w), uintBitsToFloat(direction.xyz), uintBitsToFloat(direction.w),
        uintBitsToFloat(throughput.xyz), throughput.w, uintBitsToFloat(radiance.xyz), uvec2(radiance.w, outer_media), uintBitsToFloat(ratio.x), ratio.y);
}

void store_path(uint slot, PathState path) {
    store_word(slot, WORD_ORIGIN, path.origin, path.width);
    store_word(slot, WORD_DIRECTION, path.direction, path.spread);
    store_word(slot, WORD_THROUGHPUT, path.throughput, path.bounce);
    store_word(slot, WORD_RADIANCE, path.radiance, path.media.x);
    store_word(slot, WORD_LEDGER, uvec4(0, 0, 0, path.media.y));
    store_word(slot, WORD_LAUNCH, uvec4(0, 0, FRESH, 0));
    store_word(slot, WORD_RATIO, uvec4(floatBitsToUint(path.frequency_ratio), path.side, 0, 0));
}

Arrival load_arrival(uint slot) {
    uvec4 position = load_word(slot, WORD_POSITION);
    uvec4 travel = load_word(slot, WORD_TRAVEL);
    vec4 surface = uintBitsToFloat(load_word(slot, WORD_SURFACE));
    uvec4 ledger = load_word(slot, WORD_LEDGER);
    uvec4 diagonal = load_word(slot, WORD_DIAGONAL);
    uvec4 mixed = load_word(slot, WORD_MIXED);
    return Arrival(uintBitsToFloat(position.xyz), position.w, uintBitsToFloat(travel.xyz), travel.w, surface.x, surface.y, surface.z,
        surface.w, ledger.x, ledger.y, uintBitsToFloat(ledger.z), uintBitsToFloat(diagonal.xyz), uintBitsToFloat(mixed.xyz),
        uintBitsToFloat(diagonal.w), mixed.w);
}

void store_arrival(uint slot, Arrival arrival) {
    store_word(slot, WORD_POSITION, arrival.position, arrival.primitive);
    store_word(slot, WORD_TRAVEL, arrival.direction, arrival.status);
    store_word(slot, WORD_SURFACE, floatBitsToUint(vec4(arrival.u, arrival.v, arrival.path_length, arrival.redshift)));
    uint outer_media = load_word(slot, WORD_LEDGER).w;
    store_word(slot, WORD_LEDGER, uvec4(arrival.steps, arrival.chords, floatBitsToUint(arrival.constraint_error), outer_media));
    store_word(slot, WORD_DIAGONAL, arrival.frame_diagonal, arrival.doppler);
    store_word(slot, WORD_MIXED, arrival.frame_mixed, arrival.side);
}

Aov miss_aov(Arrival arrival) {
    return Aov(vec3(0.0), arrival.redshift * arrival.doppler, vec3(0.0), arrival.path_length, vec3(0.0), arrival.constraint_error, 0u, arrival.status, arrival.steps, arrival.chords);
}

void store_aov(uvec3 pixel, Aov aov) {
    push.aovs.items[pixel.y * SCENE.film_width + pixel.x] = aov;
}
