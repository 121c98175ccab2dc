//! Numbers with a range, so that a scene file cannot hold one that makes no sense.

use serde::Deserialize;
use serde::de::{Deserializer, Error, Unexpected, Visitor};
use std::fmt;

macro_rules! number {
    ($(#[$meta:meta])* $name:ident, $expected:literal, $check:expr) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name(pub f64);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Check;
                impl Visitor<'_> for Check {
                    type Value = $name;
                    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                        f.write_str($expected)
                    }
                    fn visit_f64<E: Error>(self, value: f64) -> Result<$name, E> {
                        let check: fn(f64) -> bool = $check;
                        if value.is_finite() && value.abs() <= LARGEST && check(value) {
                            Ok($name(value))
                        } else {
                            Err(E::invalid_value(Unexpected::Float(value), &self))
                        }
                    }
                    fn visit_i64<E: Error>(self, value: i64) -> Result<$name, E> {
                        self.visit_f64(value as f64)
                    }
                    fn visit_u64<E: Error>(self, value: u64) -> Result<$name, E> {
                        self.visit_f64(value as f64)
                    }
                }
                deserializer.deserialize_any(Check)
            }
        }
    };
}

/// Largest magnitude a scene may state, so that squares and volumes stay finite in single precision.
const LARGEST: f64 = 1e9;

number!(
    /// Any number.
    Finite, "a number of at most 1e9 in size", |_| true
);
number!(
    /// A number above 0.
    Positive, "a number above 0 and at most 1e9", |v| v > 0.0
);
number!(
    /// A number not below 0.
    NonNegative, "a number from 0 to 1e9", |v| v >= 0.0
);
number!(
    /// A share.
    Unit, "a number from 0 to 1", |v| (0.0..=1.0).contains(&v)
);
number!(
    /// A vertical field of view in degrees.
    FieldOfView, "an angle above 0 and below 180 degrees", |v| v > 0.0 && v < 180.0
);
number!(
    /// A refractive index.
    Index, "a refractive index from 1 to 10", |v| (1.0..=10.0).contains(&v)
);

/// A whole number in `MIN..=MAX`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Whole<const MIN: u32, const MAX: u32>(pub u32);

impl<'de, const MIN: u32, const MAX: u32> Deserialize<'de> for Whole<MIN, MAX> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Check<const MIN: u32, const MAX: u32>;
        impl<const MIN: u32, const MAX: u32> Visitor<'_> for Check<MIN, MAX> {
            type Value = Whole<MIN, MAX>;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                write!(f, "a whole number from {MIN} to {MAX}")
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
                match u32::try_from(value) {
                    Ok(v) if (MIN..=MAX).contains(&v) => Ok(Whole(v)),
                    _ => Err(E::invalid_value(Unexpected::Signed(value), &self)),
                }
            }
        }
        deserializer.deserialize_any(Check)
    }
}

/// A point or vector.
pub type Vector = [Finite; 3];

/// A colour in linear sRGB, not negative.
pub type Color = [NonNegative; 3];

/// The plain numbers of a vector.
pub fn numbers(v: Vector) -> [f64; 3] {
    v.map(|c| c.0)
}

/// The plain numbers of a colour, in single precision.
pub fn color(c: Color) -> [f32; 3] {
    c.map(|c| c.0 as f32)
}
