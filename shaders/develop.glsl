// Colours of a developed film; documented in src/film/develop.rs.

vec3 tone_map(uint curve, vec3 c) {
    if (curve == TONE_REINHARD) {
        c *= 1.0 / (1.0 + (0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z));
    } else if (curve == TONE_ACES) {
        vec3 x = 0.6 * c;
        c = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
    }
    return clamp(c, vec3(0.0), vec3(1.0));
}

vec3 srgb_from_linear(vec3 c) {
    return mix(1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, c * 12.92, lessThanEqual(c, vec3(0.0031308)));
}

vec3 heat(float share) {
    float t = clamp(share, 0.0, 1.0);
    return vec3(sqrt(t), t * t * t, max(sin(TAU * min(t, 0.5)), 0.0));
}

vec3 shift_color(float ratio) {
    if (ratio <= 0.0) {
        return vec3(0.0);
    }
    float s = clamp(log2(ratio) / SHIFT_OCTAVES, -1.0, 1.0);
    return vec3(1.0 - max(s, 0.0), 1.0 - 0.7 * abs(s), 1.0 + min(s, 0.0));
}

vec3 status_color(uint status) {
    switch (status) {
    case STATUS_HIT:
        return vec3(0.75, 0.75, 0.75);
    case STATUS_ESCAPED:
        return vec3(0.2, 0.4, 0.8);
    case STATUS_CAPTURED:
        return vec3(0.45, 0.1, 0.55);
    case STATUS_EXHAUSTED:
        return vec3(0.95, 0.25, 0.1);
    }
    return vec3(0.0);
}

vec3 count_color(uint count) {
    return heat(log2(1.0 + float(count)) / HEAT_OCTAVES);
}

vec3 aov_color(uint channel, Aov aov) {
    switch (channel) {
    case CHANNEL_ALBEDO:
        return srgb_from_linear(clamp(aov.albedo, vec3(0.0), vec3(1.0)));
    case CHANNEL_NORMAL:
        return aov.object != 0 ? 0.5 + 0.5 * aov.normal : vec3(0.0);
    case CHANNEL_DISTANCE:
        return vec3(1.0 / (1.0 + aov.distance / HALF_DISTANCE));
    case CHANNEL_REDSHIFT:
        return shift_color(aov.redshift);
    case CHANNEL_STEPS:
        return count_color(aov.steps);
    case CHANNEL_CHORDS:
        return count_color(aov.chords);
    case CHANNEL_STATUS:
        return status_color(aov.status);
    case CHANNEL_CONSTRAINT_ERROR:
        return heat(1.0 + log2(max(aov.constraint_error, exp2(-ERROR_OCTAVES))) / ERROR_OCTAVES);
    case CHANNEL_COST:
        return count_color(aov.steps + aov.chords);
    }
    return vec3(0.0);
}

vec3 radiance_color(uint curve, vec3 exposed) {
    return srgb_from_linear(tone_map(curve, exposed));
}
