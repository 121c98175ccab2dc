//! What the panels let a person change: the keys of the scene that have a live control, with their ranges.
//!
//! Nothing in here draws. Lists are made from the document as it is, so that a control shows what the scene file says, and ranges lie
//! inside what the loader accepts. Where values depend on each other, [`settle`] keeps an edit from making the scene invalid.
//! docs/scene-files.md says what the keys mean.

mod limits;
mod spacetime;
mod surfaces;

pub use limits::{admissible, settle};
pub use spacetime::spacetime;
pub use surfaces::{discs, environment, materials};

use super::document::Document;
use super::model::Action;
use glam::DVec3;
use std::ops::RangeInclusive;
use toml_edit::Value;

/// What has to change in the document when an option is chosen for a key.
pub type Choose = fn(document: &Document, key: &str, option: &str) -> Vec<Action>;

/// A key of the scene with its control.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Where it is, as in `--set`.
    pub key: String,
    /// Its name for people.
    pub label: &'static str,
    /// One sentence about it.
    pub hint: &'static str,
    /// How it is changed.
    pub control: Control,
    /// Whether the scene needs the key, so that there is no default to go back to.
    pub needed: bool,
}

/// How a parameter is changed. Every `fallback` is the value where the key is absent.
#[derive(Clone, Debug)]
pub enum Control {
    /// A number on a slider.
    Number(Number),
    /// A whole number.
    Whole {
        /// Smallest and largest.
        range: RangeInclusive<i64>,
        /// The default.
        fallback: i64,
    },
    /// A point or vector.
    Vector {
        /// The default.
        fallback: [f64; 3],
        /// Change per point of a drag.
        speed: f64,
        /// Whether it must not be zero.
        direction: bool,
    },
    /// A colour in linear sRGB.
    Color {
        /// The default.
        fallback: [f64; 3],
        /// Whether its components may exceed 1.
        bright: bool,
    },
    /// Several numbers.
    List {
        /// Smallest and largest of each.
        range: RangeInclusive<f64>,
        /// How many there may be.
        count: RangeInclusive<usize>,
    },
    /// Yes or no.
    Flag {
        /// The default.
        fallback: bool,
    },
    /// One of several words.
    Choice {
        /// The words, and what they are called for people.
        options: &'static [(&'static str, &'static str)],
        /// The default.
        fallback: &'static str,
        /// What choosing one changes.
        choose: Choose,
    },
}

/// A number on a slider.
#[derive(Clone, Debug)]
pub struct Number {
    /// Ends of the slider.
    pub range: RangeInclusive<f64>,
    /// Whether equal distances on the slider are equal factors.
    pub logarithmic: bool,
    /// The default, or what an absent number starts with.
    pub fallback: f64,
    /// What it means that the key is absent, where that is no number.
    pub absent: Option<&'static str>,
    /// Whether a change takes long, so that it waits until the slider is let go.
    pub slow: bool,
}

/// Parameters that belong together.
#[derive(Clone, Debug, Default)]
pub struct Group {
    /// Heading; empty at the top.
    pub title: String,
    /// Colour of a swatch beside the heading.
    pub swatch: Option<[f64; 3]>,
    /// The parameters.
    pub parameters: Vec<Parameter>,
    /// What else can be done: a label, and the changes.
    pub buttons: Vec<(&'static str, Vec<Action>)>,
}

impl Parameter {
    fn new(key: impl Into<String>, label: &'static str, hint: &'static str, control: Control) -> Self {
        Parameter { key: key.into(), label, hint, control, needed: false }
    }

    fn number(key: impl Into<String>, label: &'static str, hint: &'static str, fallback: f64, range: RangeInclusive<f64>) -> Self {
        let number = Number { range, logarithmic: false, fallback, absent: None, slow: false };
        Parameter::new(key, label, hint, Control::Number(number))
    }

    fn whole(key: &str, label: &'static str, hint: &'static str, fallback: i64, range: RangeInclusive<i64>) -> Self {
        Parameter::new(key, label, hint, Control::Whole { range, fallback })
    }

    fn point(key: impl Into<String>, label: &'static str, hint: &'static str, size: f64) -> Self {
        Parameter::new(key, label, hint, Control::Vector { fallback: [0.0; 3], speed: 0.002 * size, direction: false })
    }

    fn direction(key: impl Into<String>, label: &'static str, hint: &'static str, fallback: [f64; 3]) -> Self {
        Parameter::new(key, label, hint, Control::Vector { fallback, speed: 0.01, direction: true })
    }

    fn color(key: String, label: &'static str, hint: &'static str, fallback: [f64; 3]) -> Self {
        Parameter::new(key, label, hint, Control::Color { fallback, bright: false })
    }

    fn flag(key: String, label: &'static str, hint: &'static str, fallback: bool) -> Self {
        Parameter::new(key, label, hint, Control::Flag { fallback })
    }

    fn choice(
        key: impl Into<String>,
        label: &'static str,
        hint: &'static str,
        fallback: &'static str,
        options: &'static [(&'static str, &'static str)],
    ) -> Self {
        Parameter::new(key, label, hint, Control::Choice { options, fallback, choose: |_, key, option| vec![set(key, option)] })
    }

    fn needed(mut self) -> Self {
        self.needed = true;
        self
    }

    fn logarithmic(self) -> Self {
        self.with_number(|n| n.logarithmic = true)
    }

    fn absent(self, meaning: &'static str) -> Self {
        self.with_number(|n| n.absent = Some(meaning))
    }

    fn slow(self) -> Self {
        self.with_number(|n| n.slow = true)
    }

    fn with_number(mut self, change: impl FnOnce(&mut Number)) -> Self {
        if let Control::Number(number) = &mut self.control {
            change(number);
        }
        self
    }

    fn bright(mut self) -> Self {
        if let Control::Color { bright, .. } = &mut self.control {
            *bright = true;
        }
        self
    }

    fn choosing(mut self, with: Choose) -> Self {
        if let Control::Choice { choose, .. } = &mut self.control {
            *choose = with;
        }
        self
    }
}

/// The camera's settings that are part of the scene.
pub fn camera(document: &Document) -> Vec<Parameter> {
    let size = size(document);
    let panorama = document.word("camera.kind").is_some_and(|kind| kind == "panorama");
    let kinds = &[("perspective", "Perspective"), ("panorama", "Panorama of the whole sky")];
    let mut list = vec![Parameter::choice("camera.kind", "Kind", "How directions become pixels", "perspective", kinds)];
    if !panorama {
        list.extend([
            Parameter::number("camera.fov_degrees", "Field of view", "Vertical, in degrees", 40.0, 2.0..=150.0),
            Parameter::number("camera.aperture_radius", "Aperture", "Radius of the lens; 0 is a pinhole", 0.0, 0.0..=0.1 * size)
                .logarithmic(),
            Parameter::number("camera.focus_distance", "Focus", "Distance of the plane in focus", size, 0.01 * size..=100.0 * size)
                .logarithmic()
                .absent("on the target"),
        ]);
    }
    list
}

/// How many samples are taken, and of what.
pub fn film() -> Vec<Parameter> {
    let filters = &[("gaussian", "Gaussian"), ("box", "Box")];
    vec![
        Parameter::whole("film.samples", "Samples", "Samples per pixel after which the picture rests", 256, 1..=65536),
        Parameter::whole("film.max_depth", "Bounces", "Most scattering events of a path", 8, 0..=64),
        Parameter::choice("film.filter", "Filter", "Pixel filter", "gaussian", filters),
    ]
}

/// How rays are integrated.
pub fn integrator(document: &Document) -> Vec<Parameter> {
    const METHODS: &[(&str, &str)] = &[
        ("auto", "Automatic"),
        ("nystrom", "Nyström 4(3)"),
        ("dormand-prince", "Dormand-Prince 5(4)"),
        ("bogacki-shampine", "Bogacki-Shampine 3(2)"),
        ("rk4", "Runge-Kutta 4"),
        ("euler", "Euler"),
        ("symplectic", "Symplectic Euler"),
        ("leapfrog", "Leapfrog"),
    ];
    let size = size(document);
    let method = document.word("integrator.method").unwrap_or("auto");
    let literal = document.word("spacetime.form").is_some_and(|form| form == "literal");
    let fixed = literal || ["rk4", "euler", "symplectic", "leapfrog"].contains(&method);
    let mut list = vec![Parameter::choice("integrator.method", "Method", "How the ray's equation is solved", "auto", METHODS)];
    if fixed {
        let hint = "Step of the methods that do not choose their own";
        list.push(Parameter::number("integrator.step", "Step", hint, 0.1, 1e-4 * size..=0.2 * size).logarithmic());
    } else {
        let hint = "Error allowed per step, in pixels";
        list.push(Parameter::number("integrator.tolerance", "Tolerance", hint, 0.5, 1e-3..=30.0).logarithmic());
    }
    let hint = "Distance allowed between the curve and the chords that meet the scene, in pixels";
    list.push(Parameter::number("integrator.chord_tolerance", "Chord tolerance", hint, 0.1, 1e-3..=30.0).logarithmic());
    let hint = "Steps after which a ray is given up";
    list.push(Parameter::whole("integrator.max_steps", "Most steps", hint, 2000, 10..=100_000));
    list
}

/// Sets a value of the scene.
pub fn set(key: impl Into<String>, value: impl Into<Value>) -> Action {
    Action::Set { key: key.into(), value: value.into() }
}

/// Takes a value out of the scene.
pub fn remove(key: impl Into<String>) -> Action {
    Action::Remove { key: key.into() }
}

/// An array of the numbers.
pub fn array(values: &[f64]) -> Value {
    values.iter().map(|v| tidy(*v)).collect()
}

/// A number with six digits, so that the scene file stays readable.
pub fn tidy(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// Removes the keys of `table` that are there and not in `kept`.
fn remove_others(document: &Document, table: &str, keys: &[&str], kept: &[&str]) -> Vec<Action> {
    let others = keys.iter().filter(|key| !kept.contains(*key)).map(|key| format!("{table}.{key}"));
    others.filter(|key| document.get(key).is_some()).map(remove).collect()
}

/// A length that says how large the scene is: how far the camera, as the scene has it, is from the model or from its target.
fn size(document: &Document) -> f64 {
    let point = |key: &str, default: [f64; 3]| DVec3::from(document.vector(key).unwrap_or(default));
    let camera = point("camera.position", [0.0, 1.5, -10.0]);
    let target = point("camera.look_at", [0.0, 1.0, 0.0]);
    let model = point("spacetime.position", [0.0; 3]);
    camera.distance(target).max(camera.distance(model)).clamp(1e-3, 1e6)
}
