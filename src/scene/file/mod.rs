//! A scene file as written: one struct per table, unknown keys refused. The keys are documented in docs/scene-files.md.
#![allow(missing_docs, reason = "the fields are the keys of the scene file, documented in docs/scene-files.md")]

mod spacetime;

use super::values::*;
use serde::Deserialize;
use toml::Spanned;

pub use spacetime::*;

/// The whole file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneFile {
    pub camera: CameraTable,
    pub film: FilmTable,
    pub spacetime: SpacetimeTable,
    pub integrator: IntegratorTable,
    pub environment: EnvironmentTable,
    pub material: Vec<MaterialTable>,
    pub sphere: Vec<SphereTable>,
    pub r#box: Vec<BoxTable>,
    pub quad: Vec<QuadTable>,
    pub mesh: Vec<MeshTable>,
    pub disc: Vec<DiscTable>,
    pub accretion_disc: Vec<AccretionDiscTable>,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum CameraKind {
    #[default]
    Perspective,
    Panorama,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraTable {
    pub kind: CameraKind,
    pub position: Spanned<Vector>,
    pub look_at: Spanned<Vector>,
    pub up: Spanned<Vector>,
    pub fov_degrees: FieldOfView,
    pub aperture_radius: NonNegative,
    pub focus_distance: Option<Positive>,
    pub velocity: Option<Spanned<Vector>>,
}

fn unspanned<T>(value: T) -> Spanned<T> {
    Spanned::new(0..0, value)
}

fn vector(x: f64, y: f64, z: f64) -> Spanned<Vector> {
    unspanned([Finite(x), Finite(y), Finite(z)])
}

impl Default for CameraTable {
    fn default() -> Self {
        CameraTable {
            kind: CameraKind::Perspective,
            position: vector(0.0, 1.5, -10.0),
            look_at: vector(0.0, 1.0, 0.0),
            up: vector(0.0, 1.0, 0.0),
            fov_degrees: FieldOfView(40.0),
            aperture_radius: NonNegative(0.0),
            focus_distance: None,
            velocity: None,
        }
    }
}

/// How radiance becomes a picture.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum ToneMap {
    /// Clip at 1.
    None,
    /// Luminance L / (1 + L).
    Reinhard,
    /// Narkowicz' fit to the ACES filmic curve.
    #[default]
    Aces,
}

/// Pixel filter.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// One pixel wide.
    Box,
    /// Gaussian of 0.45 pixels, cut off at 1.5.
    #[default]
    Gaussian,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilmTable {
    pub width: Whole<1, 32768>,
    pub height: Spanned<Whole<1, 32768>>,
    pub samples: Whole<1, 1_000_000>,
    pub max_depth: Whole<0, 1000>,
    pub exposure: Finite,
    pub tone_map: ToneMap,
    pub filter: Filter,
}

impl Default for FilmTable {
    fn default() -> Self {
        FilmTable {
            width: Whole(1280),
            height: unspanned(Whole(720)),
            samples: Whole(256),
            max_depth: Whole(8),
            exposure: Finite(0.0),
            tone_map: ToneMap::default(),
            filter: Filter::default(),
        }
    }
}

/// Names of `[integrator] method`.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    #[default]
    Auto,
    Euler,
    Symplectic,
    Leapfrog,
    Rk4,
    BogackiShampine,
    DormandPrince,
    Nystrom,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IntegratorTable {
    pub method: Spanned<Method>,
    pub tolerance: Positive,
    pub chord_tolerance: Positive,
    pub step: Positive,
    pub max_steps: Whole<1, 1_000_000>,
}

impl Default for IntegratorTable {
    fn default() -> Self {
        IntegratorTable {
            method: unspanned(Method::Auto),
            tolerance: Positive(0.5),
            chord_tolerance: Positive(0.1),
            step: Positive(0.1),
            max_steps: Whole(2000),
        }
    }
}

/// Names of `[environment] kind`.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum EnvironmentKind {
    #[default]
    Constant,
    Gradient,
    Grid,
    Image,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EnvironmentTable {
    pub kind: EnvironmentKind,
    pub color: Option<Spanned<Color>>,
    pub zenith: Option<Spanned<Color>>,
    pub horizon: Option<Spanned<Color>>,
    pub nadir: Option<Spanned<Color>>,
    pub line_color: Option<Spanned<Color>>,
    pub north: Option<Spanned<Color>>,
    pub south: Option<Spanned<Color>>,
    pub spacing_degrees: Option<Spanned<Positive>>,
    pub line_degrees: Option<Spanned<Positive>>,
    pub file: Option<Spanned<String>>,
    pub scale: Option<Spanned<NonNegative>>,
    pub rotation_degrees: Option<Spanned<Finite>>,
    pub temperature: Option<Spanned<Positive>>,
    pub far: Option<Spanned<Box<EnvironmentTable>>>,
}

/// Names of `[[material]] kind`.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum MaterialKind {
    #[default]
    Diffuse,
    Metallic,
    Dielectric,
    Emissive,
    /// Of accretion discs; scene files cannot name it.
    #[serde(skip)]
    Accretion,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialTable {
    pub name: Spanned<String>,
    #[serde(default)]
    pub kind: MaterialKind,
    pub base_color: Option<[Unit; 3]>,
    pub roughness: Option<Spanned<Unit>>,
    pub ior: Option<Spanned<Index>>,
    pub absorption: Option<Spanned<Color>>,
    pub emission: Option<Spanned<Color>>,
    pub temperature: Option<Spanned<Positive>>,
    pub two_sided: Option<bool>,
    pub checker: Option<Spanned<CheckerTable>>,
    pub base_color_texture: Option<Spanned<String>>,
    pub roughness_texture: Option<Spanned<String>>,
    pub emission_texture: Option<Spanned<String>>,
}

/// A checkered base colour: `count` squares along each texture coordinate, every other one of `color`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckerTable {
    pub color: [Unit; 3],
    pub count: Whole<2, 256>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum Scale {
    Uniform(f64),
    PerAxis([f64; 3]),
}

/// Scale, then rotate about X, Y and Z in this order, then translate.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransformTable {
    pub translate: Option<Vector>,
    pub rotate_degrees: Option<Vector>,
    pub scale: Option<Spanned<Scale>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereTable {
    pub center: Vector,
    pub radius: Positive,
    pub material: Option<Spanned<String>>,
    pub side: Option<Spanned<Side>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxTable {
    pub min: Vector,
    pub max: Spanned<Vector>,
    #[serde(default)]
    pub transform: TransformTable,
    pub material: Option<Spanned<String>>,
    pub side: Option<Spanned<Side>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadTable {
    pub corner: Vector,
    pub u: Vector,
    pub v: Spanned<Vector>,
    pub material: Option<Spanned<String>>,
    pub side: Option<Spanned<Side>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    pub file: Spanned<String>,
    #[serde(default)]
    pub transform: TransformTable,
    pub material: Option<Spanned<String>>,
    pub side: Option<Spanned<Side>>,
}

/// Side of a wormhole: 0, in the file 1, is the camera's; 1, in the file -1, the far one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side(pub u32);

impl<'de> Deserialize<'de> for Side {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match i64::deserialize(deserializer)? {
            1 => Ok(Side(0)),
            -1 => Ok(Side(1)),
            v => Err(serde::de::Error::invalid_value(
                serde::de::Unexpected::Signed(v),
                &"1 (the camera's side of a wormhole) or -1 (the far side)",
            )),
        }
    }
}

/// A flat disc, or a ring if it has an inner radius.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscTable {
    pub center: Vector,
    pub normal: Spanned<Vector>,
    pub radius: Spanned<Positive>,
    pub inner_radius: Option<NonNegative>,
    pub material: Option<Spanned<String>>,
    pub side: Option<Spanned<Side>>,
}

/// A thin disc of matter on circular orbits around the model's hole.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccretionDiscTable {
    pub inner_radius: Option<Spanned<Positive>>,
    pub outer_radius: Spanned<Positive>,
    pub normal: Option<Spanned<Vector>>,
    pub peak_temperature: Positive,
    pub brightness: Option<NonNegative>,
    pub opaque: Option<bool>,
}
