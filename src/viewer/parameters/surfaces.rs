//! Parameters of what is seen: materials, accretion discs, the sky.

use super::{Action, Document, Group, Parameter, array, remove, remove_others, set};

const WHITE: [f64; 3] = [1.0; 3];
const BLACK: [f64; 3] = [0.0; 3];
const GREY: [f64; 3] = [0.8; 3];

/// Keys of a sky that belong to one kind of it.
const SKY_KEYS: &[&str] = &[
    "color",
    "zenith",
    "horizon",
    "nadir",
    "line_color",
    "north",
    "south",
    "spacing_degrees",
    "line_degrees",
    "file",
    "scale",
    "rotation_degrees",
];

/// A group for each material of the scene file. Materials that mesh files bring along are not in the document.
pub fn materials(document: &Document) -> Vec<Group> {
    (0..).map_while(|i| material(document, &format!("material.{i}"))).collect()
}

fn material(document: &Document, at: &str) -> Option<Group> {
    const KINDS: &[(&str, &str)] =
        &[("diffuse", "Diffuse"), ("metallic", "Metallic"), ("dielectric", "Dielectric"), ("emissive", "Emissive")];
    let title = document.word(&format!("{at}.name"))?.to_owned();
    let key = |name: &str| format!("{at}.{name}");
    let has = |name: &str| document.get(&key(name)).is_some();
    let kind = document.word(&key("kind")).unwrap_or("diffuse");
    let glass = kind == "dielectric";
    let base = if glass || has("base_color_texture") { WHITE } else { GREY };
    let glows = kind == "emissive" || has("emission_texture") || has("temperature");
    let emission = if glows { WHITE } else { BLACK };
    let mut parameters = vec![Parameter::choice(key("kind"), "Kind", "How it scatters light", "diffuse", KINDS).choosing(choose_material)];
    if kind != "emissive" {
        let (label, hint) = if glass { ("Tint", "Of light that goes through") } else { ("Colour", "Reflectance, linear sRGB") };
        parameters.push(Parameter::color(key("base_color"), label, hint, base));
    }
    if has("checker") {
        parameters.push(Parameter::color(key("checker.color"), "Other squares", "Every other square has this colour", BLACK).needed());
        parameters.push(Parameter::whole(&key("checker.count"), "Squares", "Along each texture coordinate", 2, 2..=256).needed());
    }
    if glass || kind == "metallic" {
        let fallback = if has("roughness_texture") {
            1.0
        } else if glass {
            0.0
        } else {
            0.3
        };
        parameters.push(Parameter::number(key("roughness"), "Roughness", "0 is a mirror", fallback, 0.0..=1.0));
    }
    if glass {
        parameters.push(Parameter::number(key("ior"), "Index", "Refractive index", 1.5, 1.0..=3.0));
        parameters.push(Parameter::color(key("absorption"), "Absorption", "Per length inside", BLACK).bright());
    }
    parameters.push(Parameter::color(key("emission"), "Emission", "Radiance, or multiple of the black body's", emission).bright());
    parameters.push(temperature(key("temperature"), "Makes it shine as a black body (kelvin)"));
    let shown = document.vector(&key("emission")).unwrap_or(emission);
    if shown != BLACK {
        parameters.push(Parameter::flag(key("two_sided"), "Two-sided", "Whether it emits on both sides", true));
    }
    let swatch = if kind == "emissive" { shown } else { document.vector(&key("base_color")).unwrap_or(base) };
    Some(Group { title, swatch: Some(swatch), parameters, ..Group::default() })
}

fn temperature(key: String, hint: &'static str) -> Parameter {
    Parameter::number(key, "Temperature", hint, 6500.0, 500.0..=40_000.0).logarithmic().absent("plain colour")
}

/// Takes out what the new kind does not have.
fn choose_material(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let at = key.trim_end_matches(".kind");
    let kept: &[&str] = match option {
        "dielectric" => &["ior", "absorption", "roughness", "roughness_texture"],
        "metallic" => &["roughness", "roughness_texture"],
        _ => &[],
    };
    let mut actions = remove_others(document, at, &["ior", "absorption", "roughness", "roughness_texture"], kept);
    actions.push(set(key, option));
    actions
}

/// A group for each accretion disc.
pub fn discs(document: &Document) -> Vec<Group> {
    (0..).map_while(|i| disc(document, i)).collect()
}

fn disc(document: &Document, i: usize) -> Option<Group> {
    let key = |name: &str| format!("accretion_disc.{i}.{name}");
    document.get(&key("outer_radius"))?;
    let mass = document.number("spacetime.mass").unwrap_or(1.0);
    let length = |name: &str, label, hint, fallback: f64, [low, high]: [f64; 2]| {
        Parameter::number(key(name), label, hint, fallback * mass, low * mass..=high * mass).logarithmic()
    };
    let parameters = vec![
        length("outer_radius", "Outer radius", "Circumferential", 20.0, [2.0, 200.0]).needed(),
        length("inner_radius", "Inner radius", "Circumferential, from the innermost stable orbit on", 9.0, [1.0, 100.0])
            .absent("innermost orbit"),
        Parameter::number(key("peak_temperature"), "Temperature", "Of the hottest ring (kelvin)", 6500.0, 500.0..=40_000.0)
            .logarithmic()
            .needed(),
        Parameter::number(key("brightness"), "Brightness", "Factor on the black body's radiance", 1.0, 0.0..=100.0).logarithmic(),
        Parameter::flag(key("opaque"), "Opaque", "Whether it hides what is behind it", true),
    ];
    let title = format!("Accretion disc {}", i + 1);
    Some(Group { title, parameters, buttons: vec![("Remove", vec![remove(format!("accretion_disc.{i}"))])], ..Group::default() })
}

/// The sky, and that of the far side of a wormhole.
pub fn environment(document: &Document) -> Vec<Group> {
    let mut groups = vec![Group { parameters: sky(document, "environment"), ..Group::default() }];
    let wormhole = document.word("spacetime.kind").is_some_and(|kind| kind == "ellis" || kind == "dneg");
    let title = "Far side".to_owned();
    if document.get("environment.far").is_some() {
        let buttons = vec![("Same sky as here", vec![remove("environment.far")])];
        groups.push(Group { title, parameters: sky(document, "environment.far"), buttons, ..Group::default() });
    } else if wormhole {
        let buttons = vec![("Another sky there", vec![set("environment.far.kind", "grid")])];
        groups.push(Group { title, buttons, ..Group::default() });
    }
    groups
}

fn sky(document: &Document, at: &str) -> Vec<Parameter> {
    const KINDS: &[(&str, &str)] = &[("constant", "One colour"), ("gradient", "Gradient"), ("grid", "Grid of lines")];
    const WITH_IMAGE: &[(&str, &str)] =
        &[("image", "Image"), ("constant", "One colour"), ("gradient", "Gradient"), ("grid", "Grid of lines")];
    let key = |name: &str| format!("{at}.{name}");
    let color = |name: &str, label, fallback| Parameter::color(key(name), label, "Radiance, linear sRGB", fallback).bright();
    let kind = document.word(&key("kind")).unwrap_or("constant");
    let kinds = if kind == "image" { WITH_IMAGE } else { KINDS };
    let mut list =
        vec![Parameter::choice(key("kind"), "Sky", "What is seen where light comes from far away", "constant", kinds).choosing(choose_sky)];
    match kind {
        "gradient" => list.extend([
            color("zenith", "Zenith", [0.25, 0.45, 0.9]),
            color("horizon", "Horizon", [0.8, 0.85, 0.9]),
            color("nadir", "Nadir", [0.2; 3]),
        ]),
        "grid" => list.extend([
            color("line_color", "Lines", WHITE),
            color("north", "Upper half", [0.05, 0.1, 0.25]),
            color("south", "Lower half", [0.2, 0.1, 0.05]),
            Parameter::number(key("spacing_degrees"), "Spacing", "Between lines, in degrees", 15.0, 1.0..=90.0),
            Parameter::number(key("line_degrees"), "Width", "Of the lines, in degrees", 0.5, 0.05..=10.0).logarithmic(),
        ]),
        "image" => list.extend([
            Parameter::number(key("scale"), "Scale", "Factor on the image", 1.0, 0.0..=100.0).logarithmic(),
            Parameter::number(key("rotation_degrees"), "Rotation", "About the vertical, in degrees", 0.0, -180.0..=180.0),
        ]),
        _ => list.push(color("color", "Colour", if document.get(&key("temperature")).is_some() { WHITE } else { BLACK })),
    }
    list.push(temperature(key("temperature"), "Makes the sky a black body, of which its colours are multiples (kelvin)"));
    list
}

fn choose_sky(document: &Document, key: &str, option: &str) -> Vec<Action> {
    let at = key.trim_end_matches(".kind");
    let mut actions = remove_others(document, at, SKY_KEYS, &[]);
    actions.push(set(key, option));
    if option == "constant" {
        // Its default is black, which could leave a scene without light.
        actions.push(set(format!("{at}.color"), array(&[0.5; 3])));
    }
    actions
}
