//! Whether edits leave the scene valid, where that depends on several values at once: what the loader and the world's compiler ask of
//! the model, its sources and its discs, without reading meshes and images again.

use super::{Action, Document, set, tidy};
use crate::scene::file::{AccretionDiscTable, Method, SceneFile, SpacetimeKind};
use crate::scene::values::numbers;
use crate::scene::{Hole, Spacetime};
use crate::spacetime::{Class, ModelKind};
use crate::world::sees;
use glam::DVec3;
use toml_edit::Value;

/// Halvings of an edit that goes too far.
const HALVINGS: u32 = 16;

/// Sets `key` to `to`, or as far on the way there from its present value `from` as the scene stays valid; `None` if it cannot change
/// at all. `value` makes the document's value of the numbers.
pub fn settle(document: &Document, camera: DVec3, key: &str, from: &[f64], to: &[f64], value: fn(&[f64]) -> Value) -> Option<Action> {
    let numbers = |share: f64| -> Vec<f64> { from.iter().zip(to).map(|(a, b)| tidy(a + (b - a) * share)).collect() };
    let edit = |share: f64| set(key, value(&numbers(share)));
    let limited = key.starts_with("spacetime.") || key.starts_with("accretion_disc.");
    let fits = |share: f64| admissible(document, camera, &[edit(share)]);
    // A scene that is not valid as it is must not keep a person from mending it.
    if !limited || fits(1.0) || !admissible(document, camera, &[]) {
        return Some(edit(1.0));
    }
    let (mut good, mut bad) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (good + bad);
        if fits(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    (numbers(good) != numbers(0.0)).then(|| edit(good))
}

/// Whether the scene is valid after these edits, seen from `camera`.
pub fn admissible(document: &Document, camera: DVec3, actions: &[Action]) -> bool {
    let mut edited = document.clone();
    let done = actions.iter().all(|action| match action {
        Action::Set { key, value } => edited.set(key, value.clone()).is_ok(),
        Action::Remove { key } => edited.remove(key),
        _ => true,
    });
    done && toml::from_str(&edited.text()).is_ok_and(|file: SceneFile| holds_together(&file, camera))
}

fn holds_together(file: &SceneFile, camera: DVec3) -> bool {
    let Some(spacetime) = model(file) else { return false };
    let sided = has_sides(file) || file.environment.far.is_some();
    let method = *file.integrator.method.get_ref();
    // Of a disc of dust there is no table to look into.
    (spacetime.model == ModelKind::DustDisc || sees(&spacetime, camera))
        && can_integrate(method, &spacetime)
        && (spacetime.throat > 0.0 || !sided)
        && file.accretion_disc.iter().all(|disc| orbits(disc, spacetime.hole))
}

/// The model. A disc of dust stays without its table: solving for it takes a second, and its keys have no limits but their own.
fn model(file: &SceneFile) -> Option<Spacetime> {
    let kind = file.spacetime.kind.as_ref().map(|kind| *kind.get_ref());
    if kind == Some(SpacetimeKind::DustDisc) {
        return Some(Spacetime { model: ModelKind::DustDisc, ..Spacetime::flat() });
    }
    Spacetime::new(&file.spacetime).ok()
}

fn can_integrate(method: Method, spacetime: &Spacetime) -> bool {
    let class = spacetime.model.class();
    match method {
        Method::Auto | Method::Euler => true,
        _ if spacetime.literal => false,
        Method::Nystrom | Method::Leapfrog => class == Class::Medium,
        Method::Symplectic => class != Class::Flow,
        Method::Rk4 | Method::BogackiShampine | Method::DormandPrince => true,
    }
}

/// Whether some shape names its side of a wormhole.
fn has_sides(file: &SceneFile) -> bool {
    file.sphere.iter().any(|s| s.side.is_some())
        || file.r#box.iter().any(|b| b.side.is_some())
        || file.quad.iter().any(|q| q.side.is_some())
        || file.mesh.iter().any(|m| m.side.is_some())
        || file.disc.iter().any(|d| d.side.is_some())
}

/// Whether matter can orbit where the disc is.
fn orbits(disc: &AccretionDiscTable, hole: Option<Hole>) -> bool {
    let Some(hole) = hole else { return false };
    let normal = disc.normal.as_ref().map_or(hole.axis, |n| DVec3::from(numbers(*n.get_ref())).normalize_or_zero());
    let level = hole.spin == 0.0 || normal.dot(hole.axis).abs() >= 1.0 - 1e-9;
    let innermost = hole.innermost_orbit(normal);
    let inner = disc.inner_radius.as_ref().map_or(innermost, |r| r.get_ref().0);
    level && normal != DVec3::ZERO && inner >= innermost && disc.outer_radius.get_ref().0 > inner
}
