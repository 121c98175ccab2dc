//! Bending models, each stated once.
//!
//! A model is a [`Medium`]: an optical medium of index n(x) whose light rays are the solutions of x' = p, p' = n grad n
//! with |p| = n. `build.rs` evaluates each model over [`expr::Expr`], differentiates it, and emits the functions both backends
//! call: a GLSL include per model and a Rust function over SIMD lanes. Parameters stay run-time values.
//!
//! This folder depends on the standard library alone, because the build script compiles it too.

pub mod expr;
mod flat;
pub mod gravity;
mod scalar;
pub mod schwarzschild;

pub use flat::Flat;
pub use gravity::{PowerGravity, ThesisGravity};
pub use scalar::{Scalar, Vec3};
pub use schwarzschild::Schwarzschild;

/// A named block of numbers a model reads at run time.
pub trait Parameters<S: Scalar> {
    /// Names, in the order of the block.
    const NAMES: &'static [&'static str];
    /// The block from its values in order; `values` has `NAMES.len()` entries.
    fn read(values: &[S]) -> Self;
}

/// A block without entries.
pub struct NoParameters;

impl<S: Scalar> Parameters<S> for NoParameters {
    const NAMES: &'static [&'static str] = &[];
    fn read(_: &[S]) -> Self {
        NoParameters
    }
}

/// Declares a parameter block: a struct over [`Scalar`] with its names and reader.
macro_rules! parameters {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident),+ $(,)? }) => {
        $(#[$meta])*
        #[allow(missing_docs, reason = "one comment may stand for several fields of a block")]
        pub struct $name<S> { $($(#[$field_meta])* pub $field: S),+ }

        impl<S: $crate::spacetime::Scalar> $crate::spacetime::Parameters<S> for $name<S> {
            const NAMES: &'static [&'static str] = &[$(stringify!($field)),+];
            fn read(values: &[S]) -> Self {
                let mut next = values.iter().copied();
                let mut take = || next.next().unwrap_or(S::constant(f64::NAN));
                Self { $($field: take()),+ }
            }
        }
    };
}
pub(crate) use parameters;

/// A bending model as an optical medium of refractive index n(x).
///
/// Positions are relative to the model's own origin. Models made of many sources (gravity centers, point masses) state the
/// potential of one source; the sum over all reaches [`Medium::index`] as `potential`.
pub trait Medium {
    /// Parameters of the whole model.
    type Global<S: Scalar>: Parameters<S>;
    /// Parameters of one source.
    type Source<S: Scalar>: Parameters<S>;

    /// Refractive index at `x` for a ray of conserved `energy`.
    fn index<S: Scalar>(global: &Self::Global<S>, x: Vec3<S>, potential: S, energy: S) -> S;

    /// Contribution of one source to `potential`.
    fn source_potential<S: Scalar>(_source: &Self::Source<S>, _x: Vec3<S>) -> S {
        S::constant(0.0)
    }

    /// Conserved energy of a ray launched at `x` with velocity of length `speed` (1 unless the caller says otherwise).
    fn energy<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _potential: S, _speed: S) -> S {
        S::constant(1.0)
    }

    /// Lapse of the static observer at `x`: proper time per coordinate time, so frequencies go as 1 / lapse.
    fn lapse<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>) -> S {
        S::constant(1.0)
    }

    /// Positive where a ray lives, negative where it is captured.
    fn capture_distance<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _potential: S) -> S {
        S::constant(1.0)
    }

    /// Largest coordinate length of one integration step from `x`.
    fn safe_step<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }

    /// Largest step that one source allows at `x`.
    fn source_safe_step<S: Scalar>(_source: &Self::Source<S>, _x: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }
}

/// A step length no scene reaches.
pub const UNBOUNDED_STEP: f64 = 1e12;

/// Calls `$macro!{ (Variant, stem), ... }` with every model: the one list of them.
#[macro_export]
macro_rules! for_each_model {
    ($macro:ident) => {
        $macro! {
            (Flat, flat),
            (ThesisGravity, thesis_gravity),
            (PowerGravity, power_gravity),
            (Schwarzschild, schwarzschild),
        }
    };
}

macro_rules! model_kind {
    ($(($name:ident, $stem:ident)),+ $(,)?) => {
        /// Which model a world is bent by.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum ModelKind {
            $(#[allow(missing_docs, reason = "each variant is documented at the model of its name")] $name),+
        }

        impl ModelKind {
            /// Every model.
            pub const ALL: &'static [ModelKind] = &[$(ModelKind::$name),+];

            /// Stem of the generated files and functions.
            pub fn stem(self) -> &'static str {
                match self { $(ModelKind::$name => stringify!($stem)),+ }
            }

            /// Numbers per source in the model's parameter block.
            pub fn source_stride(self) -> usize {
                match self { $(ModelKind::$name => <<$name as Medium>::Source<f64> as Parameters<f64>>::NAMES.len()),+ }
            }
        }
    };
}
for_each_model!(model_kind);
