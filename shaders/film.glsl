// Fixed-point sums of the film; documented in src/film/mod.rs.

// A non-negative number below 2^25 in units of 2^-24, as low and high words, truncated.
uvec2 fixed_from_float(float value) {
    uint bits = floatBitsToUint(value);
    int exponent = int((bits >> 23) & 0xffu) - 127;
    uint mantissa = (bits & 0x7fffffu) | 0x800000u;
    int shift = exponent - 23 + int(FILM_FRACTION_BITS);
    if (shift <= -24) {
        return uvec2(0);
    }
    if (shift <= 0) {
        return uvec2(mantissa >> -shift, 0);
    }
    return uvec2(mantissa << shift, mantissa >> (32 - shift));
}

// The number a fixed-point sum stands for.
float float_from_fixed(uvec2 sum) {
    return ldexp(float(sum.y), 32 - int(FILM_FRACTION_BITS)) + ldexp(float(sum.x), -int(FILM_FRACTION_BITS));
}

void add_fixed(inout uvec2 sum, uvec2 value) {
    uint carry;
    sum.x = uaddCarry(sum.x, value.x, carry);
    sum.y += value.y + carry;
}
