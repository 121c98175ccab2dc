//! Bending models, each stated once.
//!
//! A model belongs to one of three classes, each a trait: a [`Medium`] is a refractive index n(x); a [`Metric`] is a spacetime in
//! 3+1 form; a [`Flow`] gives a ray's velocity outright. `build.rs` evaluates each model over [`expr::Expr`], differentiates it, and
//! emits the functions both backends call: a GLSL include per model and a Rust function over SIMD lanes. Parameters stay run-time
//! values.
//!
//! Positions are relative to the model's own origin. This folder depends on the standard library alone, because the build script
//! compiles it too.

mod alcubierre;
pub mod dust_disc;
pub mod expr;
mod flat;
mod flow;
pub mod gravity;
mod grin;
mod kerr;
mod masses;
mod scalar;
pub mod schwarzschild;
pub mod thermal;
mod wormhole;

pub use alcubierre::Alcubierre;
pub use dust_disc::DustDisc;
pub use flat::Flat;
pub use flow::{Lorenz, Parametric, Rossler};
pub use gravity::{PowerGravity, ThesisGravity};
pub use grin::{Fisheye, Layered, Luneburg, Radial, layer_values};
pub use kerr::KerrNewman;
pub use masses::{MajumdarPapapetrou, WeakLens};
pub use scalar::{Dyadic, Scalar, Scaled, Vec3};
pub use schwarzschild::{ReissnerNordstrom, Schwarzschild};
pub use wormhole::{Dneg, Ellis, LENSING_WIDTH};

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

/// A bending model as an optical medium of index n(x): rays obey x' = p, p' = n grad n with |p| = n.
///
/// Static spacetimes whose space is conformally flat are media too, of index 1 / lapse times the conformal factor. Models made of many
/// sources (gravity centers, point masses) state the potential of one source; the sum over all reaches the model as `potential`.
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
    fn lapse<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _potential: S) -> S {
        S::constant(1.0)
    }

    /// Positive where a ray lives, negative where it is captured.
    fn capture_distance<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _potential: S) -> S {
        S::constant(1.0)
    }

    /// Largest coordinate length of one integration step from `x` along the unit vector `d`; along zero, that of one in any direction.
    fn safe_step<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _d: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }

    /// Largest step that one source allows at `x` along `d`.
    fn source_safe_step<S: Scalar>(_source: &Self::Source<S>, _x: Vec3<S>, _d: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }
}

/// A stationary spacetime in 3+1 form, ds^2 = -lapse^2 dt^2 + gamma_ij (dx^i + shift^i dt)(dx^j + shift^j dt).
///
/// Rays obey Hamilton's equations of h(x, q) = lapse sqrt(gamma^ij q_i q_j) - sense shift^i q_i in coordinate time t: h is the
/// photon's conserved energy, so the null condition holds by construction. `sense` = +1 follows a photon of covariant
/// momentum q forward; -1 follows one of momentum -q backward in time, as a camera does.
pub trait Metric {
    /// Parameters of the model.
    type Global<S: Scalar>: Parameters<S>;

    /// Whether part of the metric comes from a table over two coordinates.
    const HAS_TABLE: bool = false;

    /// Where the table is read at `x`: two numbers in [0, 1]. Its three entries there reach the other functions as `table`.
    fn table_point<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>) -> [S; 2] {
        [S::constant(0.0); 2]
    }

    /// Square of the lapse, the proper time of the Eulerian observer per coordinate time.
    fn lapse_squared<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _table: [S; 3]) -> S {
        S::constant(1.0)
    }

    /// Shift vector. Where it is along the vector of [`Metric::inverse_metric`], rays cost less if it is stated by that vector.
    fn shift<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _table: [S; 3]) -> Scaled<S> {
        Scaled { factor: S::constant(0.0), v: Vec3::zero() }
    }

    /// Inverse spatial metric gamma^ij.
    fn inverse_metric<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _table: [S; 3]) -> Dyadic<S> {
        Dyadic::identity()
    }

    /// The model's own radial coordinate at `x`.
    fn coordinate_radius<S: Scalar>(_global: &Self::Global<S>, x: Vec3<S>) -> S {
        x.length_or_zero()
    }

    /// Frequency a distant static observer measures, of a ray of momentum `q` and conserved `energy` that has escaped.
    fn far_frequency<S: Scalar>(_q: Vec3<S>, energy: S) -> S {
        energy
    }

    /// Positive where a ray lives, negative where it is captured; `blueshift` is its frequency over that at its start.
    fn capture_distance<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _blueshift: S, _sense: S) -> S {
        S::constant(1.0)
    }

    /// Largest coordinate length of one integration step from `x` along the unit vector `d`; along zero, that of one in any direction.
    fn safe_step<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>, _d: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }

    /// Length over which the way of rays changes at `x`, of which the error of a step is but a small share. Steps themselves may be longer.
    fn detail<S: Scalar>(global: &Self::Global<S>, x: Vec3<S>) -> S {
        Self::safe_step(global, x, Vec3::zero())
    }
}

/// Rays whose velocity is given: by where they are, by the direction they set out in, by how far they have come.
pub trait Flow {
    /// Parameters of the model.
    type Global<S: Scalar>: Parameters<S>;

    /// Velocity dx/ds at `x` of the ray that set out along the unit vector `direction`, `s` after its start.
    fn velocity<S: Scalar>(global: &Self::Global<S>, x: Vec3<S>, direction: Vec3<S>, s: S) -> Vec3<S>;

    /// Largest coordinate length of one integration step from `x`.
    fn safe_step<S: Scalar>(_global: &Self::Global<S>, _x: Vec3<S>) -> S {
        S::constant(UNBOUNDED_STEP)
    }
}

/// How a model states its physics: which of the traits it implements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// [`Medium`].
    Medium,
    /// [`Metric`].
    Metric,
    /// [`Flow`].
    Flow,
}

/// Share of the distance by which steps that go straight away from a center are longer than those towards it.
const AWAY: f64 = 1.4;

/// Longest step along the unit vector `d` from `x`, `r` away from a center where light bends on the scale of that distance: a share
/// `towards` of it, and more for rays that go away. A pair of methods is blind to the errors of steps that end much nearer to the center.
pub(crate) fn step_past_center<S: Scalar>(x: Vec3<S>, r: S, d: Vec3<S>, towards: f64) -> S {
    r * S::constant(towards) + x.dot(d).max(S::constant(0.0)) * S::constant(AWAY)
}

/// A step length no scene reaches.
pub const UNBOUNDED_STEP: f64 = 1e12;

/// Calls `$macro!{ (Variant, stem, Class), ... }` with every model: the one list of them.
#[macro_export]
macro_rules! for_each_model {
    ($macro:ident) => {
        $macro! {
            (Flat, flat, Medium),
            (ThesisGravity, thesis_gravity, Medium),
            (PowerGravity, power_gravity, Medium),
            (Lorenz, lorenz, Flow),
            (Rossler, rossler, Flow),
            (Parametric, parametric, Flow),
            (Fisheye, fisheye, Medium),
            (Luneburg, luneburg, Medium),
            (Radial, radial, Medium),
            (Layered, layered, Medium),
            (Schwarzschild, schwarzschild, Medium),
            (ReissnerNordstrom, reissner_nordstrom, Medium),
            (KerrNewman, kerr_newman, Metric),
            (MajumdarPapapetrou, majumdar_papapetrou, Medium),
            (WeakLens, weak_lens, Medium),
            (Alcubierre, alcubierre, Metric),
            (Ellis, ellis, Medium),
            (Dneg, dneg, Metric),
            (DustDisc, dust_disc, Metric),
        }
    };
}

macro_rules! source_stride {
    (Medium, $name:ident) => {
        <<$name as Medium>::Source<f64> as Parameters<f64>>::NAMES.len()
    };
    ($class:ident, $name:ident) => {
        0
    };
}

macro_rules! model_kind {
    ($(($name:ident, $stem:ident, $class:ident)),+ $(,)?) => {
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

            /// How the model states its physics.
            pub fn class(self) -> Class {
                match self { $(ModelKind::$name => Class::$class),+ }
            }

            /// Whether the model has two sides, joined at a throat.
            pub fn has_throat(self) -> bool {
                matches!(self, ModelKind::Ellis | ModelKind::Dneg)
            }

            /// Whether the gradient of its index jumps at a rim.
            pub fn has_rim(self) -> bool {
                matches!(self, ModelKind::Luneburg | ModelKind::Radial)
            }

            /// Whether the model is a medium whose force has kinks that steps go across: no place for a method of high order.
            pub fn has_kinks(self) -> bool {
                matches!(self, ModelKind::ThesisGravity | ModelKind::PowerGravity | ModelKind::Layered)
            }

            /// Whether the chart moves against observers at rest at infinity, so that directions there are not those of coordinates.
            pub fn moves_at_infinity(self) -> bool {
                self == ModelKind::Alcubierre
            }

            /// Numbers per source in the model's parameter block.
            pub fn source_stride(self) -> usize {
                match self { $(ModelKind::$name => source_stride!($class, $name)),+ }
            }
        }
    };
}
for_each_model!(model_kind);
