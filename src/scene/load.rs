//! From a scene file to a [`Scene`]: parse, apply overrides, resolve names and files, check what single values cannot tell.

use super::assets::Assets;
use super::edit::{self, one_line};
use super::file::*;
use super::texture::Image;
use super::values::{Vector, color, numbers};
use super::*;
use crate::error::{Error, Result};
use crate::spacetime::Class;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml_edit::{DocumentMut, TomlError};

/// The scene that is rendered when no file is named.
const BUILT_IN: &str = include_str!("../../assets/scenes/singularity.toml");

/// Largest film, in pixels.
const MAX_PIXELS: u64 = 1 << 28;

/// Reads and validates a scene.
///
/// `path` is the file, or `None` for the built-in scene; each of `overrides` is `key.path=value` in TOML syntax. Errors name
/// the file with line and column, or the override.
pub fn load_scene(path: Option<&Path>, overrides: &[String]) -> Result<Scene> {
    let (path, text) = read_scene(path)?;
    parse_scene(&path, &text, overrides)
}

/// The text of a scene file, or of the built-in scene, and what errors call it.
pub fn read_scene(path: Option<&Path>) -> Result<(PathBuf, String)> {
    let Some(path) = path else { return Ok((PathBuf::from("built-in"), BUILT_IN.to_owned())) };
    let text = std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.into(), source })?;
    if text.trim().is_empty() {
        return Err(Error::Scene { path: path.into(), line: 1, column: 1, reason: "the file is empty, expected a scene".into() });
    }
    Ok((path.to_owned(), text))
}

/// Validates the text of a scene; files it names are relative to the folder of `path`.
pub fn parse_scene(path: &Path, text: &str, overrides: &[String]) -> Result<Scene> {
    parse_scene_with(path, text, overrides, &mut Assets::default())
}

/// The same, for a text that is parsed again and again: files that did not change since are taken from `assets`.
pub fn parse_scene_with(path: &Path, text: &str, overrides: &[String], assets: &mut Assets) -> Result<Scene> {
    let _span = tracing::info_span!("load", scene = %path.display()).entered();
    let fail = |e: toml::de::Error| error_at(path, text, e.span().unwrap_or_default(), one_line(e.message()));
    let file: SceneFile = toml::from_str(text).map_err(fail)?;
    let (text, file) = if overrides.is_empty() { (text.to_owned(), file) } else { apply_overrides(text, overrides)? };
    let scene = Loader { path, text: &text, assets }.scene(&file)?;
    assets.forget_unused();
    Ok(scene)
}

/// Makes assignments and reads the file again, after each of them so that the message names the right one; returns the edited text
/// with what it says.
fn apply_overrides(text: &str, overrides: &[String]) -> Result<(String, SceneFile)> {
    let mut document: DocumentMut = text.parse().map_err(|e: TomlError| Error::World(one_line(e.message())))?;
    let mut read = (text.to_owned(), SceneFile::default());
    for assignment in overrides {
        edit::assign(&mut document, assignment)?;
        let edited = document.to_string();
        let fail = |e: toml::de::Error| Error::Override { assignment: assignment.clone(), reason: one_line(e.message()) };
        read = (edited.clone(), toml::from_str(&edited).map_err(fail)?);
    }
    Ok(read)
}

/// What is wrong with a place in a file.
fn error_at(path: &Path, text: &str, span: Range<usize>, reason: impl Into<String>) -> Error {
    let (line, column) = edit::line_and_column(text, span.start);
    Error::Scene { path: path.into(), line, column, reason: reason.into() }
}

struct Loader<'a> {
    path: &'a Path,
    text: &'a str,
    assets: &'a mut Assets,
}

impl Loader<'_> {
    fn error(&self, span: Range<usize>, reason: impl Into<String>) -> Error {
        error_at(self.path, self.text, span, reason)
    }

    fn relative(&self, file: &str) -> PathBuf {
        self.path.parent().map_or_else(|| PathBuf::from(file), |folder| folder.join(file))
    }

    fn scene(&mut self, file: &SceneFile) -> Result<Scene> {
        let spacetime = Spacetime::new(&file.spacetime).map_err(|(span, reason)| self.error(span, reason))?;
        let dark = Sky { environment: Environment::Constant([0.0; 3]), temperature: 0.0 };
        let mut scene = Scene {
            path: self.path.into(),
            camera: self.camera(&file.camera)?,
            film: self.film(&file.film)?,
            integrator: self.integrator(&file.integrator, &spacetime)?,
            spacetime,
            environment: [dark.clone(), dark],
            materials: vec![Material::default()],
            images: vec![],
            shapes: vec![],
        };
        scene.environment[0] = self.environment(&file.environment, &mut scene.images)?;
        if let Some(far) = &file.environment.far {
            if scene.spacetime.throat == 0.0 {
                return Err(self.error(far.span(), "`far` belongs to wormholes only"));
            }
            if far.get_ref().far.is_some() {
                return Err(self.error(far.span(), "`far` has no far side of its own"));
            }
            scene.environment[1] = self.environment(far.get_ref(), &mut scene.images)?;
        } else {
            scene.environment[1] = scene.environment[0].clone();
        }
        for table in &file.material {
            let material = self.material(table, &mut scene)?;
            scene.materials.push(material);
        }
        self.shapes(file, &mut scene)?;
        Ok(scene)
    }

    fn camera(&self, table: &CameraTable) -> Result<Camera> {
        let position = DVec3::from(numbers(*table.position.get_ref()));
        let target = DVec3::from(numbers(*table.look_at.get_ref())) - position;
        let forward = target
            .try_normalize()
            .ok_or_else(|| self.error(table.look_at.span(), "`look_at` is the camera's position, expected another point"))?;
        let up = DVec3::from(numbers(*table.up.get_ref()));
        let right = forward
            .cross(up)
            .try_normalize()
            .filter(|_| forward.cross(up).length() > 1e-9 * up.length())
            .ok_or_else(|| self.error(table.up.span(), "`up` is parallel to the viewing direction, expected another vector"))?;
        let velocity = table.velocity.as_ref().map_or(DVec3::ZERO, |v| DVec3::from(numbers(*v.get_ref())));
        if let (Some(v), true) = (&table.velocity, velocity.length() >= 0.999_999) {
            return Err(self.error(v.span(), format!("a speed of {}, expected less than that of light, 1", velocity.length())));
        }
        Ok(Camera {
            kind: table.kind,
            position,
            forward,
            right,
            up: right.cross(forward),
            fov_radians: table.fov_degrees.0.to_radians(),
            aperture_radius: table.aperture_radius.0,
            focus_distance: table.focus_distance.map_or(target.length(), |d| d.0),
            velocity,
        })
    }

    fn film(&self, table: &FilmTable) -> Result<FilmSettings> {
        let (width, height) = (table.width.0, table.height.get_ref().0);
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(
                self.error(table.height.span(), format!("a film of {width} x {height} pixels, expected at most {MAX_PIXELS} pixels"))
            );
        }
        Ok(FilmSettings {
            width,
            height,
            samples: table.samples.0,
            max_depth: table.max_depth.0,
            exposure: table.exposure.0,
            tone_map: table.tone_map,
            filter: table.filter,
        })
    }

    /// Refuses a key that the chosen kind does not have.
    fn refuse<T>(&self, value: &Option<Spanned<T>>, key: &str, kind: &str) -> Result<()> {
        match value {
            Some(v) => Err(self.error(v.span(), format!("`{key}` does not belong to {kind}"))),
            None => Ok(()),
        }
    }

    fn integrator(&self, table: &IntegratorTable, spacetime: &Spacetime) -> Result<Integrator> {
        let class = spacetime.model.class();
        let medium = class == Class::Medium;
        let refuse = |reason: &str| Err(self.error(table.method.span(), reason));
        let method = match table.method.get_ref() {
            Method::Auto if spacetime.literal => Method::Euler,
            Method::Auto if medium => Method::Nystrom,
            Method::Auto => Method::DormandPrince,
            method if spacetime.literal && *method != Method::Euler => {
                return refuse("form `literal` is a recurrence, expected method `euler`");
            }
            Method::Nystrom if !medium => return refuse("method `nystrom` needs a medium, whose force depends on the position only"),
            Method::Leapfrog if !medium => return refuse("method `leapfrog` needs a medium, whose force depends on the position only"),
            Method::Symplectic if class == Class::Flow => {
                return refuse("method `symplectic` needs a Hamiltonian, which a flow does not have");
            }
            method => *method,
        };
        Ok(Integrator {
            method,
            auto: *table.method.get_ref() == Method::Auto,
            tolerance: table.tolerance.0,
            chord_tolerance: table.chord_tolerance.0,
            step: table.step.0,
            max_steps: table.max_steps.0,
        })
    }

    fn environment(&mut self, table: &EnvironmentTable, images: &mut Vec<Arc<Image>>) -> Result<Sky> {
        let kind = match table.kind {
            EnvironmentKind::Constant => "a constant environment",
            EnvironmentKind::Gradient => "a gradient environment",
            EnvironmentKind::Grid => "a grid environment",
            EnvironmentKind::Image => "an image environment",
        };
        let is = |k: EnvironmentKind| table.kind == k;
        if !is(EnvironmentKind::Constant) {
            self.refuse(&table.color, "color", kind)?;
        }
        if !is(EnvironmentKind::Gradient) {
            self.refuse(&table.zenith, "zenith", kind)?;
            self.refuse(&table.horizon, "horizon", kind)?;
            self.refuse(&table.nadir, "nadir", kind)?;
        }
        if !is(EnvironmentKind::Grid) {
            self.refuse(&table.line_color, "line_color", kind)?;
            self.refuse(&table.north, "north", kind)?;
            self.refuse(&table.south, "south", kind)?;
            self.refuse(&table.spacing_degrees, "spacing_degrees", kind)?;
            self.refuse(&table.line_degrees, "line_degrees", kind)?;
        }
        if !is(EnvironmentKind::Image) {
            self.refuse(&table.file, "file", kind)?;
            self.refuse(&table.scale, "scale", kind)?;
            self.refuse(&table.rotation_degrees, "rotation_degrees", kind)?;
        }
        let pick = |value: &Option<Spanned<values::Color>>, default: [f32; 3]| value.as_ref().map_or(default, |c| color(*c.get_ref()));
        let temperature = table.temperature.as_ref().map_or(0.0, |t| t.get_ref().0 as f32);
        let dark = if temperature > 0.0 { [1.0; 3] } else { [0.0; 3] };
        let environment = match table.kind {
            EnvironmentKind::Constant => Environment::Constant(pick(&table.color, dark)),
            EnvironmentKind::Gradient => Environment::Gradient {
                zenith: pick(&table.zenith, [0.25, 0.45, 0.9]),
                horizon: pick(&table.horizon, [0.8, 0.85, 0.9]),
                nadir: pick(&table.nadir, [0.2, 0.2, 0.2]),
            },
            EnvironmentKind::Grid => Environment::Grid {
                line: pick(&table.line_color, [1.0; 3]),
                north: pick(&table.north, [0.05, 0.1, 0.25]),
                south: pick(&table.south, [0.2, 0.1, 0.05]),
                spacing: table.spacing_degrees.as_ref().map_or(15.0, |v| v.get_ref().0).to_radians(),
                width: table.line_degrees.as_ref().map_or(0.5, |v| v.get_ref().0).to_radians(),
            },
            EnvironmentKind::Image => {
                let file = table.file.as_ref().ok_or_else(|| self.error(0..0, "an image environment needs `file`"))?;
                Environment::Image {
                    image: self.image(file, false, images)?,
                    scale: table.scale.as_ref().map_or(1.0, |v| v.get_ref().0 as f32),
                    rotation: table.rotation_degrees.as_ref().map_or(0.0, |v| v.get_ref().0).to_radians(),
                }
            }
        };
        Ok(Sky { environment, temperature })
    }

    fn image(&mut self, file: &Spanned<String>, data: bool, images: &mut Vec<Arc<Image>>) -> Result<usize> {
        let path = self.relative(file.get_ref());
        let image = self.assets.image(&path, data).map_err(|e| self.error(file.span(), e.to_string()))?;
        images.push(image);
        Ok(images.len() - 1)
    }

    fn material(&mut self, table: &MaterialTable, scene: &mut Scene) -> Result<Material> {
        let name = table.name.get_ref();
        if scene.materials.iter().skip(1).any(|m| &m.name == name) {
            return Err(self.error(table.name.span(), format!("a second material named `{name}`")));
        }
        let defaults = Material::default();
        let kind = table.kind;
        if kind != MaterialKind::Dielectric {
            self.refuse(&table.ior, "ior", "this kind of material, only to `dielectric`")?;
            self.refuse(&table.absorption, "absorption", "this kind of material, only to `dielectric`")?;
        }
        if matches!(kind, MaterialKind::Diffuse | MaterialKind::Emissive) {
            self.refuse(&table.roughness, "roughness", "this kind of material, only to `metallic` and `dielectric`")?;
            self.refuse(&table.roughness_texture, "roughness_texture", "this kind of material, only to `metallic` and `dielectric`")?;
        }
        let mut texture = |file: &Option<Spanned<String>>, data: bool| match file {
            Some(file) => self.image(file, data, &mut scene.images).map(Some),
            None => Ok(None),
        };
        let mut textures = [
            texture(&table.base_color_texture, false)?,
            texture(&table.roughness_texture, true)?,
            texture(&table.emission_texture, false)?,
        ];
        if let Some(checker) = &table.checker {
            if table.base_color_texture.is_some() {
                return Err(self.error(checker.span(), "`checker` and `base_color_texture` exclude each other"));
            }
            let checker = checker.get_ref();
            let own = table.base_color.map_or(defaults.base_color, |c| c.map(|v| v.0 as f32));
            scene.images.push(Arc::new(Image::checker([own, checker.color.map(|v| v.0 as f32)], checker.count.0)));
            textures[0] = Some(scene.images.len() - 1);
        }
        let textured = |i: usize| textures[i].is_some();
        let glass = kind == MaterialKind::Dielectric;
        let default_color = if glass || textured(0) { [1.0; 3] } else { defaults.base_color };
        let temperature = table.temperature.as_ref().map_or(0.0, |t| t.get_ref().0 as f32);
        let default_emission = if kind == MaterialKind::Emissive || textured(2) || temperature > 0.0 { [1.0; 3] } else { [0.0; 3] };
        let default_roughness = if kind == MaterialKind::Metallic { 0.3 } else { 0.0 };
        Ok(Material {
            name: name.clone(),
            kind,
            base_color: match table.base_color {
                Some(c) if table.checker.is_none() => c.map(|v| v.0 as f32),
                _ => default_color,
            },
            roughness: table.roughness.as_ref().map_or(if textured(1) { 1.0 } else { default_roughness }, |r| r.get_ref().0 as f32),
            ior: table.ior.as_ref().map_or(defaults.ior, |i| i.get_ref().0 as f32),
            absorption: table.absorption.as_ref().map_or([0.0; 3], |c| color(*c.get_ref())),
            emission: table.emission.as_ref().map_or(default_emission, |c| color(*c.get_ref())),
            temperature,
            two_sided: table.two_sided.unwrap_or(true),
            textures,
        })
    }

    fn material_index(&self, name: &Option<Spanned<String>>, scene: &Scene) -> Result<usize> {
        let Some(name) = name else { return Ok(0) };
        scene.materials.iter().skip(1).position(|m| &m.name == name.get_ref()).map(|i| i + 1).ok_or_else(|| {
            let known: Vec<&str> = scene.materials.iter().skip(1).map(|m| m.name.as_str()).collect();
            self.error(name.span(), format!("unknown material `{}`, expected one of: {}", name.get_ref(), known.join(", ")))
        })
    }

    fn transform(&self, table: &TransformTable) -> Result<DMat4> {
        let scale = match table.scale.as_ref().map(|s| s.get_ref()) {
            None => [1.0; 3],
            Some(Scale::Uniform(s)) => [*s; 3],
            Some(Scale::PerAxis(s)) => *s,
        };
        if !scale.iter().all(|s| s.is_finite() && s.abs() > 1e-9 && s.abs() < 1e9) {
            let span = table.scale.as_ref().map_or(0..0, |s| s.span());
            return Err(self.error(span, format!("scale {scale:?}, expected numbers other than 0")));
        }
        let vector = |v: Option<Vector>| DVec3::from(v.map_or([0.0; 3], numbers));
        let [x, y, z] = vector(table.rotate_degrees).to_array().map(f64::to_radians);
        Ok(DMat4::from_translation(vector(table.translate))
            * DMat4::from_rotation_z(z)
            * DMat4::from_rotation_y(y)
            * DMat4::from_rotation_x(x)
            * DMat4::from_scale(scale.into()))
    }

    fn shapes(&mut self, file: &SceneFile, scene: &mut Scene) -> Result<()> {
        for s in &file.sphere {
            let geometry = Geometry::Sphere { center: numbers(s.center).into(), radius: s.radius.0 };
            let (material, side) = (self.material_index(&s.material, scene)?, self.side(&s.side, scene)?);
            scene.shapes.push(Shape { material, side, geometry });
        }
        for b in &file.r#box {
            let min = DVec3::from(numbers(b.min));
            let size = DVec3::from(numbers(*b.max.get_ref())) - min;
            if size.min_element() <= 0.0 {
                return Err(self.error(b.max.span(), "`max` is not above `min` on every axis"));
            }
            let world_from_unit = self.transform(&b.transform)? * DMat4::from_translation(min) * DMat4::from_scale(size);
            let (material, side) = (self.material_index(&b.material, scene)?, self.side(&b.side, scene)?);
            scene.shapes.push(Shape { material, side, geometry: Geometry::Box { world_from_unit } });
        }
        for q in &file.quad {
            let (u, v) = (DVec3::from(numbers(q.u)), DVec3::from(numbers(*q.v.get_ref())));
            if u.cross(v).length() <= 1e-9 * u.length() * v.length() {
                return Err(self.error(q.v.span(), "`u` and `v` are parallel or zero, expected a parallelogram"));
            }
            let (material, side) = (self.material_index(&q.material, scene)?, self.side(&q.side, scene)?);
            scene.shapes.push(Shape { material, side, geometry: Geometry::Quad { corner: numbers(q.corner).into(), u, v } });
        }
        for m in &file.mesh {
            let transform = self.transform(&m.transform)?;
            let override_material = match &m.material {
                Some(_) => Some(self.material_index(&m.material, scene)?),
                None => None,
            };
            let side = self.side(&m.side, scene)?;
            let path = self.relative(m.file.get_ref());
            let read = self.assets.mesh(&path).map_err(|e| self.error(m.file.span(), e.to_string()))?;
            for (mesh, own_material) in read.add_to(scene) {
                let geometry = Geometry::Mesh(Arc::new(mesh.clone().transformed(transform)));
                scene.shapes.push(Shape { material: override_material.unwrap_or(own_material), side, geometry });
            }
        }
        for d in &file.disc {
            let normal = DVec3::from(numbers(*d.normal.get_ref()))
                .try_normalize()
                .ok_or_else(|| self.error(d.normal.span(), "`normal` is zero, expected a vector"))?;
            let (inner_radius, outer_radius) = (d.inner_radius.map_or(0.0, |r| r.0), d.radius.get_ref().0);
            if inner_radius >= outer_radius {
                return Err(self.error(d.radius.span(), format!("{outer_radius} is not above the inner radius {inner_radius}")));
            }
            let (material, side) = (self.material_index(&d.material, scene)?, self.side(&d.side, scene)?);
            let center = numbers(d.center).into();
            scene.shapes.push(Shape { material, side, geometry: Geometry::Disc { center, normal, inner_radius, outer_radius } });
        }
        for disc in &file.accretion_disc {
            let shape = self.accretion_disc(disc, scene)?;
            scene.shapes.push(shape);
        }
        Ok(())
    }

    fn side(&self, side: &Option<Spanned<Side>>, scene: &Scene) -> Result<u32> {
        match side {
            Some(s) if scene.spacetime.throat == 0.0 => Err(self.error(s.span(), "`side` belongs to wormholes only")),
            side => Ok(side.as_ref().map_or(0, |s| s.get_ref().0)),
        }
    }

    fn accretion_disc(&self, table: &AccretionDiscTable, scene: &mut Scene) -> Result<Shape> {
        let hole = scene.spacetime.hole.ok_or_else(|| {
            self.error(
                table.outer_radius.span(),
                format!(
                    "an accretion disc needs a hole to orbit, expected kind `schwarzschild` or `kerr`, found `{}`",
                    scene.spacetime.kind
                ),
            )
        })?;
        let normal = match &table.normal {
            None => hole.axis,
            Some(n) => DVec3::from(numbers(*n.get_ref()))
                .try_normalize()
                .ok_or_else(|| self.error(n.span(), "`normal` is zero, expected a vector"))?,
        };
        if let (Some(n), true) = (&table.normal, hole.spin != 0.0 && normal.dot(hole.axis).abs() < 1.0 - 1e-9) {
            return Err(self.error(n.span(), "the disc is not in the hole's equatorial plane, expected `normal` along `spacetime.axis`"));
        }
        let innermost = hole.innermost_orbit(normal);
        let inner_radius = table.inner_radius.as_ref().map_or(innermost, |r| r.get_ref().0);
        if let (Some(r), true) = (&table.inner_radius, inner_radius < innermost * (1.0 - 1e-9)) {
            return Err(self.error(r.span(), format!("{inner_radius} is inside the innermost stable orbit, expected at least {innermost}")));
        }
        let outer_radius = table.outer_radius.get_ref().0;
        if outer_radius <= inner_radius {
            return Err(self.error(table.outer_radius.span(), format!("{outer_radius} is not above the inner radius {inner_radius}")));
        }
        scene.materials.push(Material {
            name: format!("accretion disc {}", scene.materials.len()),
            kind: MaterialKind::Accretion,
            temperature: table.peak_temperature.0 as f32,
            emission: [table.brightness.map_or(1.0, |b| b.0) as f32; 3],
            ..Material::default()
        });
        let disc =
            AccretionDisc { center: scene.spacetime.position, normal, inner_radius, outer_radius, opaque: table.opaque.unwrap_or(true) };
        Ok(Shape { material: scene.materials.len() - 1, side: 0, geometry: Geometry::AccretionDisc(disc) })
    }
}
