//! The lane types kernels are generic over: one `f32` or `f64`, or a register of them.
//!
//! Registers come from `fearless_simd`, whose level (AVX-512, AVX2, SSE2, NEON, ...) is chosen at run time; the token that proves
//! the level travels with every constant. A scalar lane has the token `()` and is the reference the registers are tested against.
//!
//! What works on registers must be inlined into a function that is compiled for the level, or every operation is a call. Closures handed
//! to `fold`, to `map` of an array or to `from_fn` are not: with AVX2 a helix, all sines, took twice as long as with loops.

mod elementary;
mod vector;

pub use vector::{Vector, vector};

use elementary::Register;
use fearless_simd::{Bytes as _, Select as _, Simd, SimdBase, SimdCvtFloat as _, SimdCvtTruncate as _, SimdFloat, SimdMask};
use fearless_simd::{f32x8, f32x16, f64x8, i32x8, i32x16, i64x8, mask32x8, mask32x16, mask64x8};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Most lanes of any register.
pub const MAX_LANES: usize = 16;

/// A vector of real numbers, or a single one.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self> {
    /// Type of one entry.
    type Real: Real;
    /// One flag per entry.
    type Mask: Copy;
    /// Proof that the instructions exist.
    type Token: Copy;
    /// Entries.
    const LANES: usize;

    /// `value` in every lane.
    fn splat(token: Self::Token, value: Self::Real) -> Self;
    /// A literal in every lane.
    #[inline(always)]
    fn constant(token: Self::Token, value: f64) -> Self {
        Self::splat(token, Self::Real::from_f64(value))
    }
    /// The first `LANES` entries of `values`.
    fn load(token: Self::Token, values: &[Self::Real]) -> Self;
    /// Writes the lanes to the first `LANES` entries of `values`.
    fn store(self, values: &mut [Self::Real]);
    /// `self * factor + addend`, fused where the machine can.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// e to the power of each lane.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Sine.
    fn sin(self) -> Self;
    /// Cosine.
    fn cos(self) -> Self;
    /// Arc tangent.
    fn atan(self) -> Self;
    /// Largest whole number not above each lane.
    fn floor(self) -> Self;
    /// Entries of `table` at the whole numbers in the lanes, which must be indices of it and below 2^24. Panics if one is not.
    fn gather(self, table: &[u8]) -> Self;
    /// Smaller of two.
    fn min(self, other: Self) -> Self;
    /// Larger of two.
    fn max(self, other: Self) -> Self;
    /// Lanes where `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lanes whose bit is set, lane 0 lowest.
    fn mask(token: Self::Token, bits: u32) -> Self::Mask;
    /// `then` where the mask is set, `otherwise` elsewhere.
    fn select(mask: Self::Mask, then: Self, otherwise: Self) -> Self;
    /// Lanes set in both masks.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The mask as bits, lane 0 lowest.
    fn bits(mask: Self::Mask) -> u32;
}

/// Runs `$body` with `$simd` a token of the widest instruction set the machine has, of those the kernels are compiled for: AVX-512,
/// AVX2, and what the target always has. Each costs build time, so SSE4.2, which gains little over SSE2, is left out.
#[macro_export]
macro_rules! dispatch {
    ($level:expr, $simd:ident => $body:expr) => {{
        #[cfg(target_arch = "x86_64")]
        {
            use fearless_simd::Simd as _;
            if let Some($simd) = $level.as_avx512() {
                $simd.vectorize(#[inline(always)] || $body)
            } else if let Some($simd) = $level.as_avx2() {
                $simd.vectorize(#[inline(always)] || $body)
            } else if let Some($simd) = $level.as_sse2() {
                $simd.vectorize(#[inline(always)] || $body)
            } else {
                unreachable!("x86-64 has SSE2")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        fearless_simd::dispatch!($level, $simd => $body)
    }};
}

/// A number per lane, each by its own call.
#[inline(always)]
pub fn by_lane<L: Lane>(token: L::Token, mut of_lane: impl FnMut(usize) -> L::Real) -> L {
    let mut row = [L::Real::default(); MAX_LANES];
    for (lane, value) in row[..L::LANES].iter_mut().enumerate() {
        *value = of_lane(lane);
    }
    L::load(token, &row)
}

/// The lanes as numbers.
#[inline(always)]
pub fn store<L: Lane>(lanes: L) -> [L::Real; MAX_LANES] {
    let mut row = [L::Real::default(); MAX_LANES];
    lanes.store(&mut row);
    row
}

/// The same vector in every lane.
#[inline(always)]
pub fn splat3<L: Lane>(token: L::Token, v: [L::Real; 3]) -> [L; 3] {
    [L::splat(token, v[0]), L::splat(token, v[1]), L::splat(token, v[2])]
}

/// A vector per lane, from one array per component.
#[inline(always)]
pub fn load3<L: Lane, const N: usize>(token: L::Token, v: &[[L::Real; N]; 3]) -> [L; 3] {
    [L::load(token, &v[0]), L::load(token, &v[1]), L::load(token, &v[2])]
}

/// Writes a vector per lane to one array per component.
#[inline(always)]
pub fn store3<L: Lane, const N: usize>(v: [L; 3], rows: &mut [[L::Real; N]; 3]) {
    v[0].store(&mut rows[0]);
    v[1].store(&mut rows[1]);
    v[2].store(&mut rows[2]);
}

/// `f32` or `f64`, as the entry of a lane.
pub trait Real:
    Copy + PartialOrd + Default + Send + Sync + bytemuck::Pod + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// Rounds a double.
    fn from_f64(value: f64) -> Self;
    /// Widens to a double.
    fn to_f64(self) -> f64;
    /// Rounds to single precision.
    fn to_f32(self) -> f32;
}

macro_rules! scalar_lane {
    ($real:ident) => {
        impl Real for $real {
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $real
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn to_f32(self) -> f32 {
                self as f32
            }
        }

        impl Lane for $real {
            type Real = $real;
            type Mask = bool;
            type Token = ();
            const LANES: usize = 1;

            #[inline(always)]
            fn splat(_: (), value: $real) -> Self {
                value
            }
            #[inline(always)]
            fn load(_: (), values: &[$real]) -> Self {
                values[0]
            }
            #[inline(always)]
            fn store(self, values: &mut [$real]) {
                values[0] = self;
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, addend: Self) -> Self {
                self * factor + addend
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$real>::sqrt(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                <$real>::exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                <$real>::ln(self)
            }
            #[inline(always)]
            fn sin(self) -> Self {
                <$real>::sin(self)
            }
            #[inline(always)]
            fn cos(self) -> Self {
                <$real>::cos(self)
            }
            #[inline(always)]
            fn atan(self) -> Self {
                <$real>::atan(self)
            }
            #[inline(always)]
            fn floor(self) -> Self {
                <$real>::floor(self)
            }
            #[inline(always)]
            fn gather(self, table: &[u8]) -> Self {
                assert!(self >= 0.0, "an index beyond a table");
                $real::from(table[self as usize])
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn mask(_: (), bits: u32) -> bool {
                bits & 1 == 1
            }
            #[inline(always)]
            fn select(mask: bool, then: Self, otherwise: Self) -> Self {
                if mask { then } else { otherwise }
            }
            #[inline(always)]
            fn both(a: bool, b: bool) -> bool {
                a & b
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                mask as u32
            }
        }
    };
}
scalar_lane!(f32);
scalar_lane!(f64);

macro_rules! register_lane {
    ($vector:ident, $integers:ident, $integer:ident, $mask:ident, $real:ident, $lanes:literal) => {
        impl<S: Simd> Register for $vector<S> {
            #[inline(always)]
            fn token(self) -> S {
                fearless_simd::ExtractToken::token(&self)
            }
            #[inline(always)]
            fn power_of_two(self) -> Self {
                (($integers::truncate_from(self) + (<$real>::MAX_EXP - 1) as $integer) << (<$real>::MANTISSA_DIGITS - 1)).bitcast()
            }
            #[inline(always)]
            fn split_power(self) -> (Self, Self) {
                let least = <$real>::to_bits(std::f64::consts::FRAC_1_SQRT_2 as $real) as $integer;
                let above = self.bitcast::<$integers<S>>() - least;
                let mantissa = above & ((1 << (<$real>::MANTISSA_DIGITS - 1)) - 1);
                ((mantissa + least).bitcast(), Self::float_from(above >> (<$real>::MANTISSA_DIGITS - 1)))
            }
            #[cold]
            #[inline(never)]
            fn each(self, function: fn($real) -> $real) -> Self {
                let mut lanes = [0.0; $lanes];
                self.store(&mut lanes);
                Self::from_slice(self.token(), &lanes.map(function))
            }
        }

        impl<S: Simd> Lane for $vector<S> {
            type Real = $real;
            type Mask = $mask<S>;
            type Token = S;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn splat(token: S, value: $real) -> Self {
                SimdBase::splat(token, value)
            }
            #[inline(always)]
            fn load(token: S, values: &[$real]) -> Self {
                Self::from_slice(token, &values[..$lanes])
            }
            #[inline(always)]
            fn store(self, values: &mut [$real]) {
                self.store_slice(&mut values[..$lanes]);
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, addend: Self) -> Self {
                SimdFloat::mul_add(self, factor, addend)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                SimdFloat::sqrt(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                elementary::exp(self, <$real>::exp)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                elementary::ln(self, <$real>::ln)
            }
            #[inline(always)]
            fn sin(self) -> Self {
                elementary::sin(self, <$real>::sin)
            }
            #[inline(always)]
            fn cos(self) -> Self {
                elementary::cos(self, <$real>::cos)
            }
            #[inline(always)]
            fn atan(self) -> Self {
                elementary::atan(self)
            }
            #[inline(always)]
            fn floor(self) -> Self {
                SimdFloat::floor(self)
            }
            #[inline(always)]
            fn gather(self, table: &[u8]) -> Self {
                let token = self.token();
                // Whole numbers are exact in either precision up to here.
                let length = SimdBase::splat(token, table.len().min(1 << 24) as $real);
                let (below, negative) = (Lane::lt(self, length), Lane::lt(self, SimdBase::splat(token, 0.0)));
                assert!(Self::bits(below) == (1 << $lanes) - 1 && Self::bits(negative) == 0, "an index beyond a table");
                let mut entries = [0; $lanes];
                $integers::truncate_from(self).store_slice(&mut entries);
                for entry in &mut entries {
                    // SAFETY: all lanes were seen to be at least 0 and below the length.
                    *entry = unsafe { *table.get_unchecked(*entry as usize) }.into();
                }
                Self::float_from($integers::from_slice(token, &entries))
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                SimdBase::min(self, other)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                SimdBase::max(self, other)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask<S> {
                SimdBase::simd_lt(self, other)
            }
            #[inline(always)]
            fn mask(token: S, bits: u32) -> $mask<S> {
                $mask::from_bitmask(token, bits.into())
            }
            #[inline(always)]
            fn select(mask: $mask<S>, then: Self, otherwise: Self) -> Self {
                mask.select(then, otherwise)
            }
            #[inline(always)]
            fn both(a: $mask<S>, b: $mask<S>) -> $mask<S> {
                a & b
            }
            #[inline(always)]
            fn bits(mask: $mask<S>) -> u32 {
                mask.to_bitmask() as u32
            }
        }
    };
}
register_lane!(f32x8, i32x8, i32, mask32x8, f32, 8);
register_lane!(f32x16, i32x16, i32, mask32x16, f32, 16);
register_lane!(f64x8, i64x8, i64, mask64x8, f64, 8);
