//! Parameters of every kind of `[spacetime]`, and what has to change to get from one kind to another.

use super::{Control, Group, Parameter, array, remove, remove_others, set, size, tidy};
use crate::spacetime::dust_disc::solve::MU_MAX;
use crate::viewer::document::Document;
use crate::viewer::model::Action;
use std::ops::RangeInclusive;
use toml_edit::{InlineTable, Value};

const KINDS: &[(&str, &str)] = &[
    ("flat", "Flat: straight light"),
    ("gravity", "Gravity centers and lines"),
    ("lorenz", "Lorenz' flow"),
    ("rossler", "Rössler's flow"),
    ("parametric", "Parametric curves"),
    ("grin", "Graded index"),
    ("schwarzschild", "Schwarzschild hole"),
    ("reissner-nordstrom", "Reissner-Nordström hole"),
    ("kerr", "Kerr hole"),
    ("kerr-newman", "Kerr-Newman hole"),
    ("majumdar-papapetrou", "Extremal holes in balance"),
    ("weak-lens", "Weak masses"),
    ("alcubierre", "Alcubierre's warp bubble"),
    ("ellis", "Ellis' wormhole"),
    ("dneg", "DNEG's wormhole"),
    ("dust-disc", "Disc of dust"),
];

/// Keys that belong to some kinds only.
const KEYS: &[&str] = &[
    "law",
    "form",
    "exponent",
    "center",
    "line",
    "a",
    "b",
    "c",
    "r",
    "sigma",
    "scale",
    "offset",
    "weight",
    "curve",
    "amplitude",
    "frequency",
    "profile",
    "n0",
    "radius",
    "coefficients",
    "normal",
    "heights",
    "indices",
    "mass",
    "charge",
    "spin",
    "axis",
    "speed",
    "observer",
    "throat",
    "throat_radius",
    "throat_length",
    "lensing_width",
    "mu",
];

/// Keys of a graded index apart from its profile.
const PROFILE_KEYS: &[&str] = &["n0", "radius", "coefficients", "normal", "heights", "indices"];

const MASS: &str = "Mass M, a length: half of the Schwarzschild radius";
const STRENGTH: &str = "How hard it pulls; negative pushes";
const INFLUENCE: &str = "Radius beyond which it does nothing";
const PLACE: &str = "Where it is, from the model's position";

/// The model's own parameters, then a group for each of its sources.
pub fn spacetime(document: &Document) -> Vec<Group> {
    let model = Model { document, size: size(document) };
    let kind = document.word("spacetime.kind").unwrap_or("flat");
    let hint = "What bends the light";
    let mut parameters = vec![Parameter::choice("spacetime.kind", "Model", hint, "flat", KINDS).choosing(choose_kind)];
    parameters.extend(model.parameters(kind));
    if kind != "flat" {
        parameters.push(Parameter::point("spacetime.position", "Position", "Origin of the model in the scene", model.size));
    }
    let (buttons, sources) = match kind {
        "gravity" => model.gravity_sources(),
        "majumdar-papapetrou" | "weak-lens" => model.masses(),
        "grin" => (model.layer_buttons(), vec![]),
        _ => (vec![], vec![]),
    };
    let mut groups = vec![Group { parameters, buttons, ..Group::default() }];
    groups.extend(sources);
    groups
}

/// Labels of buttons with what they change.
type Buttons = Vec<(&'static str, Vec<Action>)>;

/// The document, and a length that says how large the scene is: ranges of lengths go with it.
struct Model<'a> {
    document: &'a Document,
    size: f64,
}

impl Model<'_> {
    fn number(&self, key: &str, fallback: f64) -> f64 {
        self.document.number(key).unwrap_or(fallback)
    }

    fn is(&self, key: &str, value: &str) -> bool {
        self.document.word(key).is_some_and(|word| word == value)
    }

    /// A length between two shares of the scene's size.
    fn length(&self, key: impl Into<String>, label: &'static str, hint: &'static str, fallback: f64, shares: [f64; 2]) -> Parameter {
        Parameter::number(key, label, hint, fallback, shares[0] * self.size..=shares[1] * self.size).logarithmic()
    }

    fn mass(&self) -> Parameter {
        self.length("spacetime.mass", "Mass", MASS, 1.0, [1e-3, 1.0])
    }

    fn charge(&self) -> Parameter {
        let mass = self.number("spacetime.mass", 1.0);
        Parameter::number("spacetime.charge", "Charge", "Charge Q; Q^2 + a^2 is at most M^2", 0.0, -mass..=mass)
    }

    fn spin(&self) -> Vec<Parameter> {
        let mass = self.number("spacetime.mass", 1.0);
        vec![
            Parameter::number("spacetime.spin", "Spin", "a = J / M; a^2 + Q^2 is at most M^2", 0.0, -mass..=mass),
            Parameter::direction("spacetime.axis", "Axis", "Axis of the spin", [0.0, 1.0, 0.0]),
        ]
    }

    fn parameters(&self, kind: &str) -> Vec<Parameter> {
        let axis = |hint, fallback| Parameter::direction("spacetime.axis", "Axis", hint, fallback);
        match kind {
            "gravity" => self.gravity(),
            "lorenz" => self.flow([("sigma", 10.0, 0.1..=40.0), ("r", 28.0, 0.0..=80.0), ("b", 8.0 / 3.0, 0.0..=10.0)]),
            "rossler" => self.flow([("a", 0.1, -0.5..=0.5), ("b", 0.1, 0.0..=2.0), ("c", 14.0, 0.0..=40.0)]),
            "parametric" => self.parametric(),
            "grin" => self.grin(),
            "schwarzschild" => vec![self.mass()],
            "reissner-nordstrom" => vec![self.mass(), self.charge()],
            "kerr" => [vec![self.mass()], self.spin()].concat(),
            "kerr-newman" => [vec![self.mass()], self.spin(), vec![self.charge()]].concat(),
            "alcubierre" => vec![
                Parameter::number("spacetime.speed", "Speed", "In units of light's; may be above it", 1.0, 0.0..=4.0),
                self.length("spacetime.radius", "Radius", "Radius of the bubble", 1.0, [1e-2, 2.0]),
                Parameter::number(
                    "spacetime.sigma",
                    "Steepness",
                    "The wall is about 1 / sigma thick",
                    8.0,
                    0.5 / self.size..=500.0 / self.size,
                )
                .logarithmic(),
                axis("Direction of travel", [1.0, 0.0, 0.0]),
            ],
            "ellis" => vec![self.length("spacetime.throat", "Throat", "Radius of the throat", 1.0, [1e-2, 1.5])],
            "dneg" => self.dneg(),
            "dust-disc" => vec![
                Parameter::number("spacetime.mu", "mu", "How relativistic it is; it takes a second to solve for", 1.0, 0.01..=MU_MAX)
                    .needed()
                    .slow(),
                self.length("spacetime.radius", "Radius", "Coordinate radius of the rim", 1.0, [1e-2, 1.0]),
                axis("Axis of the rotation", [0.0, 1.0, 0.0]),
            ],
            _ => vec![],
        }
    }

    fn gravity(&self) -> Vec<Parameter> {
        let laws = &[("thesis", "Constant"), ("power", "Power of the distance")];
        let forms = &[("ode", "Equation of motion"), ("literal", "As the thesis prints it")];
        let mut list = vec![
            Parameter::choice("spacetime.law", "Force", "How the force changes with the distance", "thesis", laws).choosing(choose_law),
            Parameter::choice("spacetime.form", "Form", "How the equation is read", "ode", forms).choosing(choose_form),
        ];
        if self.is("spacetime.law", "power") {
            let hint = "The force is the strength over the distance to this power";
            list.push(Parameter::number("spacetime.exponent", "Exponent", hint, 2.0, 0.0..=4.0));
        }
        list
    }

    fn flow(&self, own: [(&'static str, f64, RangeInclusive<f64>); 3]) -> Vec<Parameter> {
        let coefficient = |(name, fallback, range): (&'static str, f64, RangeInclusive<f64>)| {
            Parameter::number(format!("spacetime.{name}"), name, "Coefficient of the flow", fallback, range)
        };
        let mut list: Vec<Parameter> = own.into_iter().map(coefficient).collect();
        let scale = 0.5 / self.size..=500.0 / self.size;
        list.extend([
            Parameter::number("spacetime.scale", "Scale", "Units of the field per scene unit", 1.0, scale).logarithmic(),
            Parameter::point("spacetime.offset", "Offset", "Where the field's origin is", self.size),
            Parameter::number("spacetime.weight", "Weight", "0 is straight light, 1 is the flow", 1.0, 0.0..=1.0),
        ]);
        list
    }

    fn parametric(&self) -> Vec<Parameter> {
        let curves = &[("parabola", "Parabola"), ("sine", "Sine"), ("helix", "Corkscrew")];
        let parabola = self.is("spacetime.curve", "parabola");
        let most = if parabola { 1.0 / self.size } else { 0.2 * self.size };
        let hint = "How far the curve leaves the straight line";
        let mut list = vec![
            Parameter::choice("spacetime.curve", "Curve", "What every ray is", "parabola", curves).choosing(choose_curve).needed(),
            Parameter::number("spacetime.amplitude", "Amplitude", hint, 0.05, -most..=most),
        ];
        if !parabola {
            let range = 0.1 / self.size..=100.0 / self.size;
            list.push(Parameter::number("spacetime.frequency", "Frequency", "Radians per length", 1.0, range).logarithmic());
        }
        list
    }

    fn grin(&self) -> Vec<Parameter> {
        const PROFILES: &[(&str, &str)] = &[
            ("fisheye", "Maxwell's fish-eye"),
            ("luneburg", "Luneburg's lens"),
            ("radial", "Powers of the radius"),
            ("layered", "Layers"),
        ];
        let profile = self.document.word("spacetime.profile").unwrap_or_default();
        let choice = Parameter::choice("spacetime.profile", "Profile", "How the index changes", "luneburg", PROFILES);
        let mut list = vec![choice.choosing(choose_profile).needed()];
        let list_of = |key: &str, label, hint, range, count| {
            Parameter::new(format!("spacetime.{key}"), label, hint, Control::List { range, count }).needed()
        };
        match profile {
            "fisheye" => list.push(Parameter::number("spacetime.n0", "Index", "Index in the center", 2.0, 0.1..=4.0)),
            "radial" => {
                let hint = "Factors of 1, r^2, r^4, ...; the index stays positive";
                list.push(list_of("coefficients", "Coefficients", hint, -1e3..=1e3, 1..=5));
            }
            "layered" => {
                let reach = 10.0 * self.size;
                // A layer is a height and an index: buttons add and remove both together.
                let count = |key: &str| {
                    let now = self.document.count(&format!("spacetime.{key}"));
                    now..=now
                };
                list.push(Parameter::direction("spacetime.normal", "Normal", "Heights are counted along it", [0.0, 1.0, 0.0]));
                list.push(list_of("heights", "Heights", "Each above the one before", -reach..=reach, count("heights")));
                list.push(list_of("indices", "Indices", "The index at each height", 0.1..=10.0, count("indices")));
            }
            _ => {}
        }
        if profile != "layered" {
            list.push(self.length("spacetime.radius", "Radius", "Radius of the lens", 1.0, [1e-2, 10.0]));
        }
        list
    }

    fn dneg(&self) -> Vec<Parameter> {
        let radius = self.number("spacetime.throat_radius", 1.0);
        let (length, width) = ("Length 2a of the cylinder", "The smaller, the more abruptly space opens");
        vec![
            self.length("spacetime.throat_radius", "Throat", "Radius of the throat", 1.0, [1e-2, 1.5]),
            Parameter::number("spacetime.throat_length", "Length", length, 0.01 * radius, 0.0..=10.0 * radius).logarithmic(),
            Parameter::number("spacetime.lensing_width", "Lensing width", width, 0.05 * radius, 1e-3 * radius..=5.0 * radius).logarithmic(),
        ]
    }

    fn gravity_sources(&self) -> (Buttons, Vec<Group>) {
        let exponent = if self.is("spacetime.law", "power") { self.number("spacetime.exponent", 2.0) } else { 0.0 };
        // At a fifth of the scene's size, the strongest source turns a ray within a third of it.
        let most = 3.0 / self.size * (0.2 * self.size).powf(exponent);
        let common = |at: &str| {
            let radius = self.length(format!("{at}.radius"), "Influence", INFLUENCE, 0.5 * self.size, [1e-2, 10.0]).absent("everywhere");
            let strength = Parameter::number(format!("{at}.strength"), "Strength", STRENGTH, 0.4 * most, -most..=most).needed();
            [strength, radius]
        };
        let (centers, lines) = (self.document.count("spacetime.center"), self.document.count("spacetime.line"));
        let center = |i: usize| {
            let at = format!("spacetime.center.{i}");
            let mut parameters = vec![Parameter::point(format!("{at}.position"), "Position", PLACE, self.size).needed()];
            parameters.extend(common(&at));
            source(format!("Center {}", i + 1), at, parameters)
        };
        let line = |i: usize| {
            let at = format!("spacetime.line.{i}");
            let length = self.length(format!("{at}.length"), "Length", "How long it is from its start on", self.size, [1e-2, 10.0]);
            let mut parameters = vec![
                Parameter::point(format!("{at}.point"), "Start", PLACE, self.size).needed(),
                Parameter::direction(format!("{at}.direction"), "Direction", "Where it goes", [0.0, 1.0, 0.0]).needed(),
            ];
            parameters.extend(common(&at));
            parameters.push(length.absent("both ways"));
            source(format!("Line {}", i + 1), at, parameters)
        };
        let strength = Value::from(tidy(0.4 * most));
        let radius = Value::from(tidy(0.5 * self.size));
        let origin = array(&[0.0; 3]);
        let new_center = table([("position", origin.clone()), ("strength", strength.clone()), ("radius", radius.clone())]);
        let upward = array(&[0.0, 1.0, 0.0]);
        let new_line = table([("point", origin), ("direction", upward), ("strength", strength), ("radius", radius)]);
        let buttons = vec![
            ("Add a center", vec![set(format!("spacetime.center.{centers}"), new_center)]),
            ("Add a line", vec![set(format!("spacetime.line.{lines}"), new_line)]),
        ];
        (buttons, (0..centers).map(center).chain((0..lines).map(line)).collect())
    }

    fn masses(&self) -> (Buttons, Vec<Group>) {
        let count = self.document.count("spacetime.mass");
        let group = |i: usize| {
            let at = format!("spacetime.mass.{i}");
            let parameters = vec![
                Parameter::point(format!("{at}.position"), "Position", PLACE, self.size).needed(),
                self.length(format!("{at}.mass"), "Mass", MASS, 0.02 * self.size, [1e-4, 0.2]).needed(),
            ];
            let group = source(format!("Mass {}", i + 1), at, parameters);
            if count > 1 { group } else { Group { buttons: vec![], ..group } }
        };
        let place = array(&[0.1 * self.size * count as f64, 0.0, 0.0]);
        let new = table([("position", place), ("mass", Value::from(tidy(0.01 * self.size)))]);
        (vec![("Add a mass", vec![set(format!("spacetime.mass.{count}"), new)])], (0..count).map(group).collect())
    }

    /// Layers come and go at the top.
    fn layer_buttons(&self) -> Buttons {
        let values = |key| self.document.numbers(key).unwrap_or_default();
        let (heights, indices) = (values("spacetime.heights"), values("spacetime.indices"));
        let ([.., low, high], [.., index]) = (heights.as_slice(), indices.as_slice()) else { return vec![] };
        let both = |h: &[f64], n: &[f64]| vec![set("spacetime.heights", array(h)), set("spacetime.indices", array(n))];
        let added = both(&[heights.as_slice(), &[2.0 * high - low]].concat(), &[indices.as_slice(), &[*index]].concat());
        let mut buttons = vec![("Add a layer", added)];
        if heights.len() > 2 {
            buttons.push(("Remove a layer", both(&heights[..heights.len() - 1], &indices[..indices.len() - 1])));
        }
        buttons
    }
}

fn source(title: String, at: String, parameters: Vec<Parameter>) -> Group {
    Group { title, parameters, buttons: vec![("Remove", vec![remove(at)])], ..Group::default() }
}

fn table<const N: usize>(entries: [(&str, Value); N]) -> Value {
    Value::InlineTable(entries.into_iter().collect::<InlineTable>())
}

/// Keys of the kinds that are black holes.
fn hole_keys(kind: &str) -> &'static [&'static str] {
    match kind {
        "schwarzschild" => &["mass"],
        "reissner-nordstrom" => &["mass", "charge"],
        "kerr" => &["mass", "spin", "axis"],
        "kerr-newman" => &["mass", "spin", "axis", "charge"],
        _ => &[],
    }
}

/// Goes over to another kind: its keys with values that suit the scene's size. Holes keep what they have in common.
fn choose_kind(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let now = document.word(key).unwrap_or_default();
    let kept: &[&str] = if hole_keys(now).is_empty() { &[] } else { hole_keys(option) };
    let mut actions = remove_others(document, "spacetime", KEYS, kept);
    actions.extend(remove_others(document, "integrator", &["method"], &[]));
    actions.push(set(key, option));
    let size = size(document);
    let keeps = |name: &str| kept.contains(&name) && document.get(&format!("spacetime.{name}")).is_some();
    let start = |name: &str, value: f64| (name.to_owned(), Value::from(tidy(value)));
    let mass = if keeps("mass") { document.number("spacetime.mass").unwrap_or(1.0) } else { 0.025 * size };
    let values: Vec<(String, Value)> = match option {
        "schwarzschild" => vec![start("mass", mass)],
        "reissner-nordstrom" => vec![start("mass", mass), start("charge", 0.8 * mass)],
        "kerr" => vec![start("mass", mass), start("spin", 0.9 * mass)],
        "kerr-newman" => {
            let spin = if keeps("spin") { document.number("spacetime.spin").unwrap_or(0.0) } else { 0.6 * mass };
            let room = (mass * mass - spin * spin).max(0.0).sqrt();
            vec![start("mass", mass), start("charge", 0.5 * room), start("spin", spin)]
        }
        "gravity" => {
            let center = table([
                ("position", array(&[0.0; 3])),
                ("strength", Value::from(tidy(1.2 / size))),
                ("radius", Value::from(tidy(0.5 * size))),
            ]);
            vec![("center.0".to_owned(), center)]
        }
        "lorenz" | "rossler" => vec![start("scale", 60.0 / size), start("weight", 0.2)],
        "parametric" => {
            vec![("curve".to_owned(), Value::from("helix")), start("amplitude", 0.04 * size), start("frequency", 12.0 / size)]
        }
        "grin" => vec![("profile".to_owned(), Value::from("luneburg")), start("radius", 0.15 * size)],
        "majumdar-papapetrou" | "weak-lens" => [-0.1, 0.1]
            .into_iter()
            .enumerate()
            .map(|(i, x)| {
                let mass = Value::from(tidy(0.01 * size));
                (format!("mass.{i}"), table([("position", array(&[x * size, 0.0, 0.0])), ("mass", mass)]))
            })
            .collect(),
        "alcubierre" => vec![start("speed", 0.5), start("radius", 0.15 * size), start("sigma", 40.0 / size)],
        "ellis" => vec![start("throat", 0.1 * size)],
        "dneg" => vec![start("throat_radius", 0.1 * size), start("throat_length", 0.1 * size), start("lensing_width", 0.04 * size)],
        "dust-disc" => vec![start("mu", 1.0), start("radius", 0.1 * size)],
        _ => vec![],
    };
    actions.extend(values.into_iter().filter(|(name, _)| !keeps(name)).map(|(name, value)| set(format!("spacetime.{name}"), value)));
    actions
}

fn choose_law(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let mut actions = vec![set(key, option)];
    if option == "thesis" {
        actions.extend(remove_others(document, "spacetime", &["exponent"], &[]));
    }
    actions
}

/// The thesis' recurrence has an integrator of its own.
fn choose_form(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let mut actions = vec![set(key, option)];
    if option == "literal" {
        actions.extend(remove_others(document, "integrator", &["method"], &[]));
    }
    actions
}

fn choose_curve(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let now = document.word(key).unwrap_or_default();
    let mut actions = vec![set(key, option)];
    if option == "parabola" {
        actions.extend(remove_others(document, "spacetime", &["frequency"], &[]));
    }
    // The amplitude of a parabola is an inverse length.
    if (now == "parabola") != (option == "parabola") {
        let size = size(document);
        actions.push(set("spacetime.amplitude", tidy(if option == "parabola" { 0.15 / size } else { 0.04 * size })));
    }
    actions
}

fn choose_profile(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let mut actions = remove_others(document, "spacetime", PROFILE_KEYS, &[]);
    actions.push(set(key, option));
    let size = size(document);
    let radius = tidy(document.number("spacetime.radius").unwrap_or(0.15 * size));
    let reach = tidy(0.05 * size);
    actions.extend(match option {
        "radial" => vec![set("spacetime.coefficients", array(&[1.5, -0.5 / (radius * radius)])), set("spacetime.radius", radius)],
        "layered" => vec![set("spacetime.heights", array(&[0.0, reach])), set("spacetime.indices", array(&[1.0, 1.05]))],
        _ => vec![set("spacetime.radius", radius)],
    });
    actions
}
