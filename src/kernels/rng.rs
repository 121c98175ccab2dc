//! Random numbers: hashed Owen-scrambled Sobol pairs, padded over dimensions.
//!
//! A number is a pure function of (pixel, dimension, sample index). Scrambling is Laine and Karras' hash in the form of
//! Burley, "Practical Hash-based Owen Scrambling" (JCGT 2020); each pair of dimensions is a (0,2)-sequence of its own, shuffled
//! by a scramble of the index. The second Sobol dimension is the Pascal matrix, applied here in five shifts.

use crate::simd::{Lane, MAX_LANES};
use glam::{Vec2, vec2};

/// Integer hash (PCG-RXS-M-XS, O'Neill 2014).
#[inline(always)]
pub fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Seed of a pixel's sequence.
#[inline(always)]
pub fn pixel_seed(x: u32, y: u32) -> u32 {
    hash(x ^ hash(y ^ 0x9e37_79b9))
}

/// Laine and Karras' hash: each bit depends on the lower bits only, so it is an Owen scramble of reversed bits.
#[inline(always)]
pub fn laine_karras(value: u32, seed: u32) -> u32 {
    let mut x = value;
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x
}

/// Pascal's matrix modulo 2 on the bits of `index`: the second Sobol dimension, bits reversed.
#[inline(always)]
pub fn pascal(index: u32) -> u32 {
    let mut x = index;
    x ^= (x >> 16) & 0x0000_ffff;
    x ^= (x >> 8) & 0x00ff_00ff;
    x ^= (x >> 4) & 0x0f0f_0f0f;
    x ^= (x >> 2) & 0x3333_3333;
    x ^= (x >> 1) & 0x5555_5555;
    x
}

/// Uniform number in [0, 1) from the top 24 bits.
#[inline(always)]
pub fn unit_float(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Two uniform numbers in [0, 1) for pair number `pair` of sample `sample_index`.
#[inline(always)]
pub fn random_pair(seed: u32, pair: u32, sample_index: u32) -> Vec2 {
    let key = hash(seed ^ hash(pair));
    let index = laine_karras(sample_index.reverse_bits(), key).reverse_bits();
    let first = laine_karras(index, hash(key ^ 0x68bc_21eb)).reverse_bits();
    let second = laine_karras(pascal(index), hash(key ^ 0x02e5_be93)).reverse_bits();
    vec2(unit_float(first), unit_float(second))
}

/// [`random_pair`] for the seed and the pair of each lane.
#[inline(always)]
pub fn random_pairs<L: Lane<Real = f32>>(token: L::Token, seeds: &[u32; MAX_LANES], pairs: &[u32; MAX_LANES], sample_index: u32) -> [L; 2] {
    let mut rows = [[0.0; MAX_LANES]; 2];
    // Plain numbers in a plain loop: the compiler makes registers of it.
    for lane in 0..L::LANES {
        let pair = random_pair(seeds[lane], pairs[lane], sample_index);
        (rows[0][lane], rows[1][lane]) = (pair.x, pair.y);
    }
    [L::load(token, &rows[0]), L::load(token, &rows[1])]
}
