// Random numbers; documented in src/kernels/rng.rs.

uint hash(uint value) {
    uint state = value * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
    return (word >> 22) ^ word;
}

uint pixel_seed(uint x, uint y) {
    return hash(x ^ hash(y ^ 0x9e3779b9u));
}

uint laine_karras(uint value, uint seed) {
    uint x = value;
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

uint pascal(uint index) {
    uint x = index;
    x ^= (x >> 16) & 0x0000ffffu;
    x ^= (x >> 8) & 0x00ff00ffu;
    x ^= (x >> 4) & 0x0f0f0f0fu;
    x ^= (x >> 2) & 0x33333333u;
    x ^= (x >> 1) & 0x55555555u;
    return x;
}

float unit_float(uint bits) {
    return float(bits >> 8) * (1.0 / 16777216.0);
}

vec2 random_pair(uint seed, uint pair, uint sample_index) {
    uint key = hash(seed ^ hash(pair));
    uint index = bitfieldReverse(laine_karras(bitfieldReverse(sample_index), key));
    uint first = bitfieldReverse(laine_karras(index, hash(key ^ 0x68bc21ebu)));
    uint second = bitfieldReverse(laine_karras(pascal(index), hash(key ^ 0x02e5be93u)));
    return vec2(unit_float(first), unit_float(second));
}
