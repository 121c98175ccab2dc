//! The `[spacetime]` table compiled to a model and its parameters.

use super::file::*;
use super::values::numbers;
use crate::spacetime::ModelKind;
use crate::spacetime::dust_disc::solve::tabulate;
use crate::spacetime::gravity::Source;
use crate::spacetime::thermal::isco;
use glam::DVec3;
use std::ops::Range;

/// The bending model and its parameters.
#[derive(Clone, Debug)]
pub struct Spacetime {
    /// Name of the kind, as scene files have it.
    pub kind: &'static str,
    /// The model.
    pub model: ModelKind,
    /// Its origin in the world.
    pub position: DVec3,
    /// Values of its parameters, in the model's order.
    pub global: Vec<f64>,
    /// Values of its sources, one after another, in coordinates relative to `position`.
    pub sources: Vec<f64>,
    /// Its table, of three numbers per control point; empty without one.
    pub table: Vec<f64>,
    /// Radius of a wormhole's throat in its chart; 0 without one.
    pub throat: f64,
    /// Radius at which the gradient of the index jumps; 0 without one.
    pub rim: f64,
    /// How far it reaches.
    pub extent: Extent,
    /// Whether the thesis' recurrence is taken literally, its kick without a step length.
    pub literal: bool,
    /// The hole that matter can orbit, if there is one.
    pub hole: Option<Hole>,
}

/// Where light bends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// Nowhere.
    Nowhere,
    /// Inside a ball (center in the world).
    Ball(DVec3, f64),
    /// Everywhere, with far field n = 1 + strength / r around a center (in the world). `curved` is the length that sets how far out
    /// that form holds; charts in which asymptotes are straight have strength 0.
    Field {
        /// Center in the world.
        center: DVec3,
        /// Coefficient of 1/r.
        strength: f64,
        /// Length scale of the field.
        scale: f64,
    },
    /// Everywhere: rays are followed to this many times the size of the scene.
    Scenes(f64),
}

/// A black hole as far as its orbits are concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hole {
    /// Mass, a length.
    pub mass: f64,
    /// Spin a = J / M, a length.
    pub spin: f64,
    /// Unit axis of the spin.
    pub axis: DVec3,
    /// Whether the chart's radius is isotropic rather than areal.
    pub isotropic: bool,
}

impl Hole {
    /// Spin as matter that turns about `normal` has it: negative if it turns against the hole.
    pub fn spin_about(&self, normal: DVec3) -> f64 {
        if normal.dot(self.axis) < 0.0 { -self.spin } else { self.spin }
    }

    /// Circumferential (Boyer-Lindquist) radius of the innermost stable orbit.
    pub fn innermost_orbit(&self, normal: DVec3) -> f64 {
        isco(self.mass, self.spin_about(normal))
    }

    /// Distance from the axis in the chart, in the equatorial plane, of the circumferential radius `r`.
    pub fn chart_radius(&self, r: f64) -> f64 {
        if self.isotropic { 0.5 * (r - self.mass + (r * (r - 2.0 * self.mass)).sqrt()) } else { r.hypot(self.spin) }
    }

    /// Inverse of [`Self::chart_radius`].
    pub fn circumferential_radius(&self, chart: f64) -> f64 {
        if self.isotropic {
            chart * (1.0 + 0.5 * self.mass / chart).powi(2)
        } else {
            (chart * chart - self.spin * self.spin).max(0.0).sqrt()
        }
    }
}

/// A complaint about a place in the file.
type Complaint = (Range<usize>, String);

impl Spacetime {
    /// Straight light.
    pub fn flat() -> Self {
        Spacetime {
            kind: "flat",
            model: ModelKind::Flat,
            position: DVec3::ZERO,
            global: vec![],
            sources: vec![],
            table: vec![],
            throat: 0.0,
            rim: 0.0,
            extent: Extent::Nowhere,
            literal: false,
            hole: None,
        }
    }

    /// Compiles the table.
    pub fn new(table: &SpacetimeTable) -> Result<Spacetime, Complaint> {
        let kind = table.kind.as_ref().map_or(SpacetimeKind::Flat, |k| *k.get_ref());
        let reader = Reader { table, kind, origin: DVec3::from(table.position.map_or([0.0; 3], numbers)) };
        let base = Spacetime { kind: kind.name(), position: reader.origin, ..Spacetime::flat() };
        match kind {
            SpacetimeKind::Flat => reader.allow(&[]).map(|()| base),
            SpacetimeKind::Gravity => reader.gravity(base),
            SpacetimeKind::Lorenz | SpacetimeKind::Rossler => reader.flow(base),
            SpacetimeKind::Parametric => reader.parametric(base),
            SpacetimeKind::Grin => reader.grin(base),
            SpacetimeKind::Schwarzschild | SpacetimeKind::ReissnerNordstrom => reader.hole_at_rest(base),
            SpacetimeKind::Kerr | SpacetimeKind::KerrNewman => reader.spinning_hole(base),
            SpacetimeKind::MajumdarPapapetrou | SpacetimeKind::WeakLens => reader.masses(base),
            SpacetimeKind::Alcubierre => reader.bubble(base),
            SpacetimeKind::Ellis | SpacetimeKind::Dneg => reader.wormhole(base),
            SpacetimeKind::DustDisc => reader.dust_disc(base),
        }
    }
}

struct Reader<'a> {
    table: &'a SpacetimeTable,
    kind: SpacetimeKind,
    origin: DVec3,
}

/// The number behind an optional key, or a default.
macro_rules! number {
    ($self:ident, $key:ident, $default:expr) => {
        $self.table.$key.as_ref().map_or($default, |v| v.get_ref().0)
    };
}

impl Reader<'_> {
    /// Refuses keys that the kind does not have.
    fn allow(&self, keys: &[&str]) -> Result<(), Complaint> {
        match self.table.other_key(keys) {
            Some((key, span)) => Err((span, format!("`{key}` does not belong to kind `{}`", self.kind.name()))),
            None => Ok(()),
        }
    }

    fn missing(&self, key: &str) -> Complaint {
        (self.table.kind.as_ref().map(|k| k.span()).unwrap_or_default(), format!("kind `{}` needs `{key}`", self.kind.name()))
    }

    fn unit(&self, value: &Option<toml::Spanned<super::values::Vector>>, key: &str, default: DVec3) -> Result<DVec3, Complaint> {
        match value {
            None => Ok(default),
            Some(v) => DVec3::from(numbers(*v.get_ref())).try_normalize().ok_or((v.span(), format!("`{key}` is zero, expected a vector"))),
        }
    }

    fn mass(&self) -> Result<f64, Complaint> {
        match &self.table.mass {
            None => Ok(1.0),
            Some(m) => match m.get_ref() {
                MassValue::One(mass) => Ok(*mass),
                MassValue::Many(_) => {
                    Err((m.span(), format!("found tables, expected one number as `mass` of kind `{}`", self.kind.name())))
                }
            },
        }
    }

    fn gravity(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["law", "form", "exponent", "center", "line"])?;
        let power = self.table.law.as_ref().is_some_and(|l| *l.get_ref() == Law::Power);
        if let (false, Some(exponent)) = (power, &self.table.exponent) {
            return Err((exponent.span(), "`exponent` does not belong to law `thesis`".into()));
        }
        let exponent = power.then(|| number!(self, exponent, 2.0));
        let literal = self.table.form.as_ref().is_some_and(|f| *f.get_ref() == Form::Literal);
        let mut sources = Vec::new();
        for center in self.table.center.iter().flat_map(|c| c.get_ref()) {
            sources.push(Source {
                position: numbers(center.position),
                direction: [0.0, 1.0, 0.0],
                extent: (0.0, 0.0),
                strength: center.strength.0,
                radius: center.radius.map_or(f64::INFINITY, |r| r.0),
            });
        }
        for line in self.table.line.iter().flat_map(|l| l.get_ref()) {
            let direction = DVec3::from(numbers(*line.direction.get_ref()));
            let direction =
                direction.try_normalize().ok_or((line.direction.span(), "`direction` is zero, expected a vector".to_owned()))?;
            sources.push(Source {
                position: numbers(line.point),
                direction: direction.into(),
                extent: line.length.map_or((f64::NEG_INFINITY, f64::INFINITY), |l| (0.0, l.0)),
                strength: line.strength.0,
                radius: line.radius.map_or(f64::INFINITY, |r| r.0),
            });
        }
        if sources.is_empty() {
            return Ok(Spacetime { kind: "gravity", ..Spacetime::flat() });
        }
        let parameters = |s: &Source| exponent.map_or_else(|| s.thesis_parameters(), |e| s.power_parameters(e));
        Ok(Spacetime {
            model: if power { ModelKind::PowerGravity } else { ModelKind::ThesisGravity },
            sources: sources.iter().flat_map(parameters).collect(),
            extent: self.gravity_extent(exponent, &sources),
            literal,
            ..base
        })
    }

    fn gravity_extent(&self, exponent: Option<f64>, sources: &[Source]) -> Extent {
        if sources.iter().all(|s| s.radius.is_finite() && s.extent.1.is_finite()) {
            let balls: Vec<(DVec3, f64)> = sources
                .iter()
                .flat_map(|s| [s.extent.0, s.extent.1].map(|t| (DVec3::from(s.position) + DVec3::from(s.direction) * t, s.radius)))
                .collect();
            let low = balls.iter().fold(DVec3::INFINITY, |a, (c, r)| a.min(*c - DVec3::splat(*r)));
            let high = balls.iter().fold(DVec3::NEG_INFINITY, |a, (c, r)| a.max(*c + DVec3::splat(*r)));
            let center = (low + high) / 2.0;
            let radius = balls.iter().map(|(c, r)| c.distance(center) + r).fold(0.0, f64::max);
            return Extent::Ball(center + self.origin, radius);
        }
        // Only the potential of an inverse-square force has an asymptote in closed form.
        if exponent == Some(2.0) && sources.iter().all(|s| s.radius.is_infinite() && s.extent.1 == 0.0) {
            let center = sources.iter().map(|s| DVec3::from(s.position)).sum::<DVec3>() / sources.len() as f64;
            let strength: f64 = sources.iter().map(|s| s.strength).sum();
            return Extent::Field { center: center + self.origin, strength, scale: strength.abs() };
        }
        Extent::Scenes(10.0)
    }

    fn flow(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        let lorenz = self.kind == SpacetimeKind::Lorenz;
        let own: &[&str] = if lorenz { &["sigma", "r", "b"] } else { &["a", "b", "c"] };
        self.allow(&[own, &["scale", "offset", "weight"]].concat())?;
        let offset = self.table.offset.as_ref().map_or([0.0; 3], |v| numbers(*v.get_ref()));
        let mut global = if lorenz {
            vec![number!(self, sigma, 10.0), number!(self, r, 28.0), number!(self, b, 8.0 / 3.0)]
        } else {
            vec![number!(self, a, 0.1), number!(self, b, 0.1), number!(self, c, 14.0)]
        };
        global.push(number!(self, scale, 1.0));
        global.extend(offset);
        global.push(number!(self, weight, 1.0));
        let model = if lorenz { ModelKind::Lorenz } else { ModelKind::Rossler };
        Ok(Spacetime { model, global, extent: Extent::Scenes(2.0), ..base })
    }

    fn parametric(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["curve", "amplitude", "frequency"])?;
        let curve = self.table.curve.as_ref().ok_or_else(|| self.missing("curve"))?;
        if let (CurveKind::Parabola, Some(frequency)) = (curve.get_ref(), &self.table.frequency) {
            return Err((frequency.span(), "`frequency` does not belong to curve `parabola`".into()));
        }
        let (k, w) = (number!(self, amplitude, 0.05), number!(self, frequency, 1.0));
        let coefficients = match curve.get_ref() {
            CurveKind::Parabola => [2.0 * k, 0.0, 0.0, 0.0],
            CurveKind::Sine => [0.0, k * w, 0.0, 0.0],
            CurveKind::Helix => [0.0, 0.0, -k * w, k * w],
        };
        let global = coefficients.into_iter().chain([w]).collect();
        // A parabola turns back on itself far away: the world ends where its rays have gone twice through the scene.
        Ok(Spacetime { model: ModelKind::Parametric, global, extent: Extent::Scenes(2.0), ..base })
    }

    fn grin(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        let profile = self.table.profile.as_ref().ok_or_else(|| self.missing("profile"))?;
        let radius = number!(self, radius, 1.0);
        match profile.get_ref() {
            Profile::Fisheye => {
                self.allow(&["profile", "n0", "radius"])?;
                let global = vec![number!(self, n0, 2.0), radius];
                // Rays of a fish-eye are circles: they come back, unless they meet something.
                Ok(Spacetime { model: ModelKind::Fisheye, global, extent: Extent::Scenes(3.0), ..base })
            }
            Profile::Luneburg => {
                self.allow(&["profile", "radius"])?;
                let extent = Extent::Ball(self.origin, radius);
                Ok(Spacetime { model: ModelKind::Luneburg, global: vec![radius], rim: radius, extent, ..base })
            }
            Profile::Radial => {
                self.allow(&["profile", "coefficients", "radius"])?;
                let given = self.table.coefficients.as_ref().ok_or_else(|| self.missing("coefficients"))?;
                let values: Vec<f64> = given.get_ref().iter().map(|c| c.0).collect();
                if values.is_empty() || values.len() > 5 {
                    return Err((given.span(), format!("{} coefficients, expected 1 to 5", values.len())));
                }
                let index = |t: f64| values.iter().rev().fold(0.0, |sum, c| sum * t + c);
                if (0..=100).any(|i| index((f64::from(i) / 100.0 * radius).powi(2)) < 0.01) {
                    return Err((given.span(), "the index falls below 0.01 inside `radius`, expected a positive one".into()));
                }
                let mut global = values;
                global.resize(5, 0.0);
                global.push(radius);
                Ok(Spacetime { model: ModelKind::Radial, global, rim: radius, extent: Extent::Ball(self.origin, radius), ..base })
            }
            Profile::Layered => self.layers(base),
        }
    }

    fn layers(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["profile", "normal", "heights", "indices"])?;
        let normal = self.unit(&self.table.normal, "normal", DVec3::Y)?.to_array();
        let heights = self.table.heights.as_ref().ok_or_else(|| self.missing("heights"))?;
        let indices = self.table.indices.as_ref().ok_or_else(|| self.missing("indices"))?;
        let h: Vec<f64> = heights.get_ref().iter().map(|v| v.0).collect();
        let n: Vec<f64> = indices.get_ref().iter().map(|v| v.0).collect();
        if h.len() < 2 || h.windows(2).any(|w| w[1] <= w[0]) {
            return Err((heights.span(), "expected two heights or more, each above the one before".into()));
        }
        if n.len() != h.len() {
            return Err((indices.span(), format!("{} indices for {} heights, expected as many", n.len(), h.len())));
        }
        let sources = (1..h.len()).flat_map(|i| crate::spacetime::layer_values(normal, [h[i - 1], h[i]], n[i] - n[i - 1])).collect();
        let global = normal.into_iter().chain([n[0]]).collect();
        Ok(Spacetime { model: ModelKind::Layered, global, sources, extent: Extent::Scenes(3.0), ..base })
    }

    fn hole_at_rest(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        let charged = self.kind == SpacetimeKind::ReissnerNordstrom;
        self.allow(if charged { &["mass", "charge"] } else { &["mass"] })?;
        let mass = self.mass()?;
        let extent = Extent::Field { center: self.origin, strength: 2.0 * mass, scale: 2.0 * mass };
        if !charged {
            let hole = Hole { mass, spin: 0.0, axis: DVec3::Y, isotropic: true };
            return Ok(Spacetime { model: ModelKind::Schwarzschild, global: vec![mass], extent, hole: Some(hole), ..base });
        }
        let charge = number!(self, charge, 0.0);
        self.check_rotation(mass, 0.0, charge)?;
        Ok(Spacetime { model: ModelKind::ReissnerNordstrom, global: vec![mass, charge], extent, ..base })
    }

    fn check_rotation(&self, mass: f64, spin: f64, charge: f64) -> Result<(), Complaint> {
        if spin * spin + charge * charge <= mass * mass {
            return Ok(());
        }
        let span = self.table.spin.as_ref().map(|s| s.span()).or_else(|| self.table.charge.as_ref().map(|c| c.span())).unwrap_or_default();
        Err((
            span,
            format!("spin {spin} and charge {charge} of mass {mass} leave the singularity naked, expected spin^2 + charge^2 <= mass^2"),
        ))
    }

    fn spinning_hole(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        let charged = self.kind == SpacetimeKind::KerrNewman;
        self.allow(if charged { &["mass", "spin", "axis", "charge"] } else { &["mass", "spin", "axis"] })?;
        let mass = self.mass()?;
        let (spin, charge) = (number!(self, spin, 0.0), number!(self, charge, 0.0));
        self.check_rotation(mass, spin, charge)?;
        let axis = self.unit(&self.table.axis, "axis", DVec3::Y)?;
        let hole = (charge == 0.0).then_some(Hole { mass, spin, axis, isotropic: false });
        // Asymptotes are straight in this chart up to (M / r)^2.
        let extent = Extent::Field { center: self.origin, strength: 0.0, scale: 2.0 * mass };
        let horizon = mass + (mass * mass - spin * spin - charge * charge).max(0.0).sqrt();
        let global = [mass, spin, charge, horizon].into_iter().chain((axis * spin).to_array()).collect();
        Ok(Spacetime { model: ModelKind::KerrNewman, global, extent, hole, ..base })
    }

    fn masses(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["mass"])?;
        let masses = self.table.mass.as_ref().ok_or_else(|| self.missing("[[spacetime.mass]]"))?;
        let MassValue::Many(list) = masses.get_ref() else {
            return Err((masses.span(), format!("found a number, expected `[[spacetime.mass]]` tables of kind `{}`", self.kind.name())));
        };
        if list.is_empty() {
            return Err((masses.span(), "expected at least one mass".into()));
        }
        let total: f64 = list.iter().map(|m| m.mass.0).sum();
        let center = list.iter().map(|m| DVec3::from(numbers(m.position)) * m.mass.0).sum::<DVec3>() / total;
        let spread = list.iter().map(|m| DVec3::from(numbers(m.position)).distance(center)).fold(0.0, f64::max);
        let sources = list.iter().flat_map(|m| numbers(m.position).into_iter().chain([m.mass.0])).collect();
        let model = if self.kind == SpacetimeKind::WeakLens { ModelKind::WeakLens } else { ModelKind::MajumdarPapapetrou };
        let extent = Extent::Field { center: center + self.origin, strength: 2.0 * total, scale: (2.0 * total).max(spread) };
        Ok(Spacetime { model, sources, extent, ..base })
    }

    fn bubble(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["speed", "radius", "sigma", "axis", "observer"])?;
        let axis = self.unit(&self.table.axis, "axis", DVec3::X)?;
        let (radius, sigma) = (number!(self, radius, 1.0), number!(self, sigma, 8.0));
        let global = [number!(self, speed, 1.0), radius, sigma].into_iter().chain(axis.to_array()).collect();
        // Beyond ten widths of the wall the field is below 1e-8 of its strength.
        let scale = radius + 10.0 / sigma;
        Ok(Spacetime {
            model: ModelKind::Alcubierre,
            global,
            extent: Extent::Field { center: self.origin, strength: 0.0, scale: scale / 100.0 },
            ..base
        })
    }

    fn dust_disc(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        self.allow(&["mu", "radius", "axis"])?;
        let mu = self.table.mu.as_ref().ok_or_else(|| self.missing("mu"))?;
        let disc = tabulate(mu.get_ref().0).map_err(|reason| (mu.span(), reason))?;
        let radius = number!(self, radius, 1.0);
        let axis = self.unit(&self.table.axis, "axis", DVec3::Y)?;
        let strength = 2.0 * disc.mass * radius;
        Ok(Spacetime {
            model: ModelKind::DustDisc,
            global: [radius].into_iter().chain(axis.to_array()).collect(),
            table: disc.values.concat(),
            extent: Extent::Field { center: self.origin, strength, scale: strength.max(radius) },
            ..base
        })
    }

    fn wormhole(&self, base: Spacetime) -> Result<Spacetime, Complaint> {
        if self.kind == SpacetimeKind::Ellis {
            self.allow(&["throat"])?;
            let radius = number!(self, throat, 1.0);
            let extent = Extent::Field { center: self.origin, strength: 0.0, scale: radius };
            return Ok(Spacetime { model: ModelKind::Ellis, global: vec![radius], throat: 0.5 * radius, extent, ..base });
        }
        self.allow(&["throat_radius", "throat_length", "lensing_width"])?;
        let radius = number!(self, throat_radius, 1.0);
        let mass = number!(self, lensing_width, 0.05 * radius) / crate::spacetime::LENSING_WIDTH;
        let global = vec![radius, 0.5 * number!(self, throat_length, 0.01 * radius), mass];
        let extent = Extent::Field { center: self.origin, strength: 0.0, scale: radius };
        Ok(Spacetime { model: ModelKind::Dneg, global, throat: 0.5 * radius, extent, ..base })
    }
}
