//! Exponential, logarithm, sine, cosine and arc tangent of all lanes of a register at once.
//!
//! The C library takes one number at a time, which cost half of the time of models that need these. Here they are polynomials after a
//! reduction of the argument, to a relative error of 1.5 epsilon (sine and cosine: of 1e-3 where they are smaller; `tests/lanes.rs`). Lanes
//! beyond the range that a reduction is made for, or that are not a number, come from the library: each is a function of its own argument alone.

use super::Lane;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, LOG2_E};

/// A register of numbers whose bits can be reached.
pub(super) trait Register: Lane {
    /// Proof that the instructions exist.
    fn token(self) -> Self::Token;
    /// 2 to the power of each lane, which must be a whole number among the exponents of normal numbers.
    fn power_of_two(self) -> Self;
    /// m and e with m 2^e the lane, which must be positive and normal; m is in [1/sqrt 2, sqrt 2).
    fn split_power(self) -> (Self, Self);
    /// `function` of each lane.
    fn each(self, function: fn(Self::Real) -> Self::Real) -> Self;
}

/// Whether the lanes are of single precision.
const fn single<L: Lane>() -> bool {
    size_of::<L::Real>() == 4
}

/// The number for single or for double precision.
#[inline(always)]
fn by_precision<L: Register>(x: L, numbers: [f64; 2]) -> L {
    L::constant(x.token(), numbers[usize::from(!single::<L>())])
}

/// `inside` where `x` is between two limits, `library` of it elsewhere.
#[inline(always)]
fn within<L: Register>(x: L, low: [f64; 2], high: [f64; 2], inside: L, library: fn(L::Real) -> L::Real) -> L {
    let mask = L::both(by_precision(x, low).lt(x), x.lt(by_precision(x, high)));
    if L::bits(mask) == (1 << L::LANES) - 1 { inside } else { L::select(mask, inside, x.each(library)) }
}

/// The polynomial with these coefficients, from the constant one on; single precision leaves out all from `enough` on.
#[inline(always)]
fn polynomial<L: Register>(x: L, coefficients: &[f64], enough: usize) -> L {
    let used = if single::<L>() { &coefficients[..enough] } else { coefficients };
    let mut sum = L::constant(x.token(), used[used.len() - 1]);
    for &value in used[..used.len() - 1].iter().rev() {
        sum = sum.mul_add(x, L::constant(x.token(), value));
    }
    sum
}

/// What is left of x after whole numbers n of a length in parts.
#[inline(always)]
fn rest_after<L: Register, const N: usize>(x: L, n: L, length: &[[f64; 2]; N]) -> L {
    let mut rest = x;
    for &part in length {
        rest = n.mul_add(-by_precision(x, part), rest);
    }
    rest
}

/// ln 2 in two parts; products of the first with exponents are exact.
const LN_2: [[f64; 2]; 2] = [[0.693359375, 0.6931471803691238], [-0.00021219444005469057, 1.9082149292705877e-10]];

/// 1 / k!
const EXP: [f64; 14] = {
    let mut terms = [1.0; 14];
    let mut k = 1;
    while k < 14 {
        terms[k] = terms[k - 1] / k as f64;
        k += 1;
    }
    terms
};

/// e to the power of x, by the series of the rest after whole powers of two are taken out.
#[inline(always)]
pub(super) fn exp<L: Register>(x: L, library: fn(L::Real) -> L::Real) -> L {
    let c = |value: f64| L::constant(x.token(), value);
    let n = x.mul_add(c(LOG2_E), c(0.5)).floor();
    let rest = rest_after(x, n, &LN_2);
    within(x, [-87.0, -708.0], [88.0, 709.0], polynomial(rest, &EXP, 8) * n.power_of_two(), library)
}

/// 2 / (2 k + 3)
const LN: [f64; 12] = {
    let mut terms = [0.0; 12];
    let mut k = 0;
    while k < 12 {
        terms[k] = 2.0 / (2 * k + 3) as f64;
        k += 1;
    }
    terms
};

/// Natural logarithm: ln(1 + f) = 2 artanh(f / (2 + f)).
#[inline(always)]
pub(super) fn ln<L: Register>(x: L, library: fn(L::Real) -> L::Real) -> L {
    let (m, e) = x.split_power();
    let f = m - L::constant(x.token(), 1.0);
    let s = f / (f + L::constant(x.token(), 2.0));
    let z = s * s;
    let rest = z * polynomial(z, &LN, 5);
    let low = s.mul_add(rest - f, e * by_precision(x, LN_2[1]));
    let value = e.mul_add(by_precision(x, LN_2[0]), f + low);
    within(x, [f64::from(f32::MIN_POSITIVE), f64::MIN_POSITIVE], [f64::from(f32::MAX), f64::MAX], value, library)
}

/// pi / 2 in three parts, from Cephes' `sinf` and fdlibm's `rem_pio2`; products of the first two with whole numbers up to 2^13 (2^20) are exact.
const HALF_TURN: [[f64; 2]; 3] =
    [[1.5703125, 1.5707963267341256], [0.0004837512969970703, 6.077100506303966e-11], [7.54978995489188e-8, 2.0222662487959506e-21]];

/// (-1)^k / (2 k + first)!, from k = 1 on.
const fn alternating<const N: usize>(first: usize) -> [f64; N] {
    let mut terms = [0.0; N];
    let (mut term, mut at, mut k) = (1.0, first, 0);
    while k < N {
        term /= -((at + 1) as f64 * (at + 2) as f64);
        at += 2;
        terms[k] = term;
        k += 1;
    }
    terms
}
const SINE: [f64; 8] = alternating(1);
const COSINE: [f64; 8] = alternating(0);

/// Sine of x and a number of quarter turns.
#[inline(always)]
fn sine<L: Register>(x: L, quarters: f64, library: fn(L::Real) -> L::Real) -> L {
    let c = |value: f64| L::constant(x.token(), value);
    let n = x.mul_add(c(FRAC_2_PI), c(0.5)).floor();
    let rest = rest_after(x, n, &HALF_TURN);
    let z = rest * rest;
    let sine = (rest * z).mul_add(polynomial(z, &SINE, 4), rest);
    let cosine = z.mul_add(polynomial(z, &COSINE, 5), c(1.0));
    let quadrant = n + c(quarters);
    let halves = (quadrant * c(0.5)).floor();
    let odd = c(0.5).lt(quadrant - halves * c(2.0));
    let negative = c(0.25).lt(halves * c(0.5) - (halves * c(0.5)).floor());
    let value = L::select(odd, cosine, sine);
    within(x, [-8e3, -1e6], [8e3, 1e6], L::select(negative, -value, value), library)
}

/// Sine.
#[inline(always)]
pub(super) fn sin<L: Register>(x: L, library: fn(L::Real) -> L::Real) -> L {
    sine(x, 0.0, library)
}

/// Cosine.
#[inline(always)]
pub(super) fn cos<L: Register>(x: L, library: fn(L::Real) -> L::Real) -> L {
    sine(x, 1.0, library)
}

/// (atan(t) / t - 1) / t^2 as polynomials of t^2 up to tan(pi / 8)^2, by interpolation at Chebyshev's nodes: to 2e-9 and 5e-18 of atan(t).
const ATAN_SINGLE: [f64; 5] = [-0.3333333176116852, 0.19999540483648964, -0.1426395559798464, 0.10743731490791084, -0.06451928208121749];
const ATAN_DOUBLE: [f64; 11] = [
    -0.3333333333333333,
    0.1999999999999552,
    -0.14285714284666542,
    0.11111111015256361,
    -0.09090904578123903,
    0.07692183190826087,
    -0.06664511447381948,
    0.0585814891280221,
    -0.0508544973794026,
    0.03923165829558719,
    -0.01917688711906226,
];

/// pi / 2 and pi / 4 as rounded, and what rounding took; each in single and in double precision.
const TURNED: [[[f64; 2]; 2]; 2] = {
    const fn parts(value: f64) -> [[f64; 2]; 2] {
        let single = value as f32 as f64;
        // A double of pi / 2 lacks this much.
        [[single, value], [value - single, 6.123233995736766e-17 * (value / FRAC_PI_2)]]
    }
    let (half, quarter) = (parts(FRAC_PI_2), parts(FRAC_PI_4));
    [[half[0], quarter[0]], [half[1], quarter[1]]]
};

/// Arc tangent, by what is left after an eighth or a quarter turn.
#[inline(always)]
pub(super) fn atan<L: Register>(x: L) -> L {
    let c = |value: f64| L::constant(x.token(), value);
    let size = x.max(-x);
    let (steep, middle) = (c(1.0 + std::f64::consts::SQRT_2).lt(size), c(std::f64::consts::SQRT_2 - 1.0).lt(size));
    let part = |steep_value: L, middle_value: L, flat: L| L::select(steep, steep_value, L::select(middle, middle_value, flat));
    let t = part(c(-1.0), size - c(1.0), size) / part(size, size + c(1.0), c(1.0));
    let z = t * t;
    let series = polynomial(z, if single::<L>() { &ATAN_SINGLE } else { &ATAN_DOUBLE }, ATAN_SINGLE.len());
    let angle = |part: [[f64; 2]; 2]| L::select(steep, by_precision(x, part[0]), L::select(middle, by_precision(x, part[1]), c(0.0)));
    let value = angle(TURNED[0]) + ((t * z).mul_add(series, t) + angle(TURNED[1]));
    L::select(x.lt(c(0.0)), -value, value)
}
