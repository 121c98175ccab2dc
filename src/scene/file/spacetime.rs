//! `[spacetime]` as written: the keys of all kinds in one table.

use crate::scene::values::*;
use serde::Deserialize;
use toml::Spanned;

/// Names of `[spacetime] kind`.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum SpacetimeKind {
    #[default]
    Flat,
    Gravity,
    Lorenz,
    Rossler,
    Parametric,
    Grin,
    Schwarzschild,
    ReissnerNordstrom,
    Kerr,
    KerrNewman,
    MajumdarPapapetrou,
    WeakLens,
    Alcubierre,
    Ellis,
    Dneg,
    DustDisc,
}

impl SpacetimeKind {
    /// The name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            SpacetimeKind::Flat => "flat",
            SpacetimeKind::Gravity => "gravity",
            SpacetimeKind::Lorenz => "lorenz",
            SpacetimeKind::Rossler => "rossler",
            SpacetimeKind::Parametric => "parametric",
            SpacetimeKind::Grin => "grin",
            SpacetimeKind::Schwarzschild => "schwarzschild",
            SpacetimeKind::ReissnerNordstrom => "reissner-nordstrom",
            SpacetimeKind::Kerr => "kerr",
            SpacetimeKind::KerrNewman => "kerr-newman",
            SpacetimeKind::MajumdarPapapetrou => "majumdar-papapetrou",
            SpacetimeKind::WeakLens => "weak-lens",
            SpacetimeKind::Alcubierre => "alcubierre",
            SpacetimeKind::Ellis => "ellis",
            SpacetimeKind::Dneg => "dneg",
            SpacetimeKind::DustDisc => "dust-disc",
        }
    }
}

/// `profile` of a gradient-index medium.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    Fisheye,
    Luneburg,
    Radial,
    Layered,
}

/// `curve` of parametric rays.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum CurveKind {
    Parabola,
    Sine,
    Helix,
}

/// `observer` of a warp bubble.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Observer {
    Eulerian,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    Thesis,
    Power,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    Literal,
    Ode,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SpacetimeTable {
    pub kind: Option<Spanned<SpacetimeKind>>,
    pub position: Option<Vector>,
    pub law: Option<Spanned<Law>>,
    pub form: Option<Spanned<Form>>,
    pub exponent: Option<Spanned<NonNegative>>,
    pub center: Option<Spanned<Vec<CenterTable>>>,
    pub line: Option<Spanned<Vec<LineTable>>>,
    pub a: Option<Spanned<Finite>>,
    pub b: Option<Spanned<Finite>>,
    pub c: Option<Spanned<Finite>>,
    pub r: Option<Spanned<Finite>>,
    pub sigma: Option<Spanned<Positive>>,
    pub scale: Option<Spanned<Positive>>,
    pub offset: Option<Spanned<Vector>>,
    pub weight: Option<Spanned<Unit>>,
    pub curve: Option<Spanned<CurveKind>>,
    pub amplitude: Option<Spanned<Finite>>,
    pub frequency: Option<Spanned<Positive>>,
    pub profile: Option<Spanned<Profile>>,
    pub n0: Option<Spanned<Positive>>,
    pub radius: Option<Spanned<Positive>>,
    pub coefficients: Option<Spanned<Vec<Finite>>>,
    pub normal: Option<Spanned<Vector>>,
    pub heights: Option<Spanned<Vec<Finite>>>,
    pub indices: Option<Spanned<Vec<Positive>>>,
    pub mass: Option<Spanned<MassValue>>,
    pub charge: Option<Spanned<Finite>>,
    pub spin: Option<Spanned<Finite>>,
    pub axis: Option<Spanned<Vector>>,
    pub speed: Option<Spanned<NonNegative>>,
    pub observer: Option<Spanned<Observer>>,
    pub throat: Option<Spanned<Positive>>,
    pub throat_radius: Option<Spanned<Positive>>,
    pub throat_length: Option<Spanned<NonNegative>>,
    pub lensing_width: Option<Spanned<Positive>>,
    pub mu: Option<Spanned<Positive>>,
}

impl SpacetimeTable {
    /// The first key given that is not in `allowed`.
    pub fn other_key(&self, allowed: &[&str]) -> Option<(&'static str, std::ops::Range<usize>)> {
        macro_rules! first {
            ($($key:ident),+) => {
                [$((stringify!($key), self.$key.as_ref().map(|v| v.span()))),+]
            };
        }
        let keys = first!(
            law,
            form,
            exponent,
            center,
            line,
            a,
            b,
            c,
            r,
            sigma,
            scale,
            offset,
            weight,
            curve,
            amplitude,
            frequency,
            profile,
            n0,
            radius,
            coefficients,
            normal,
            heights,
            indices,
            mass,
            charge,
            spin,
            axis,
            speed,
            observer,
            throat,
            throat_radius,
            throat_length,
            lensing_width,
            mu
        );
        keys.into_iter().filter(|(key, _)| !allowed.contains(key)).find_map(|(key, span)| Some((key, span?)))
    }
}

/// `mass`: one number, or an array of tables.
#[derive(Clone, Debug)]
pub enum MassValue {
    One(f64),
    Many(Vec<PointMassTable>),
}

impl<'de> Deserialize<'de> for MassValue {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> serde::de::Visitor<'de> for Either {
            type Value = MassValue;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number above 0 and at most 1e9, or `[[spacetime.mass]]` tables")
            }
            fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<MassValue, E> {
                if v > 0.0 && v <= 1e9 { Ok(MassValue::One(v)) } else { Err(E::invalid_value(serde::de::Unexpected::Float(v), &self)) }
            }
            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<MassValue, E> {
                self.visit_f64(v as f64)
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, seq: A) -> Result<MassValue, A::Error> {
                Vec::deserialize(serde::de::value::SeqAccessDeserializer::new(seq)).map(MassValue::Many)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointMassTable {
    pub position: Vector,
    pub mass: Positive,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CenterTable {
    pub position: Vector,
    pub strength: Finite,
    pub radius: Option<Positive>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineTable {
    pub point: Vector,
    pub direction: Spanned<Vector>,
    pub strength: Finite,
    pub radius: Option<Positive>,
    pub length: Option<Positive>,
}
