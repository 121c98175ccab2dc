//! Light sampling where space is bent: directions drawn towards a light lead there, and however good the table of apparent lights is, the
//! light that arrives is the same.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use fearless_simd::Level;
use glam::{Vec3, vec3};
use nullray::backend::cpu::CpuBackend;
use nullray::backend::cpu::advance::{Launch, advance_curved};
use nullray::backend::cpu::step::Course;
use nullray::backend::{Precision, Stop};
use nullray::film::luminance;
use nullray::kernels::constants::*;
use nullray::kernels::integrator::from_vec3;
use nullray::kernels::light::{Vantage, sample_lights};
use nullray::kernels::rng::random_pair;
use nullray::kernels::traverser::Traverser;
use nullray::world::World;
use std::sync::atomic::{AtomicU32, Ordering};
use support::*;

/// What bends the light of a lamp.
const SPACETIMES: [(&str, &str); 4] = [
    ("gravity", "kind = \"gravity\"\ncenter = [{ position = [0, 2, 0], strength = 0.3, radius = 5 }]"),
    ("schwarzschild", "kind = \"schwarzschild\"\nmass = 0.2\nposition = [0, 2, 0]"),
    ("kerr", "kind = \"kerr\"\nmass = 0.2\nspin = 0.18\nposition = [0, 2, 0]"),
    ("ellis", "kind = \"ellis\"\nthroat = 0.3\nposition = [0, 2, 0]"),
];
/// A lamp of each shape, of about the same size.
const LAMPS: [(&str, &str); 3] = [
    ("sphere", "[[sphere]]\ncenter = [2.5, 3, 0.5]\nradius = 0.3\nmaterial = \"lamp\""),
    ("quad", "[[quad]]\ncorner = [2.2, 3, 0.2]\nu = [0.6, 0, 0]\nv = [0, 0.1, 0.6]\nmaterial = \"lamp\""),
    ("triangle", "[[mesh]]\nfile = \"FILE\"\nmaterial = \"lamp\""),
];

/// A lamp over a floor.
fn lit_world(spacetime: &str, lamp: &str) -> World {
    static FOLDERS: AtomicU32 = AtomicU32::new(0);
    let number = FOLDERS.fetch_add(1, Ordering::Relaxed);
    let folder = std::env::temp_dir().join(format!("nullray-aim-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mesh = folder.join("lamp.obj");
    std::fs::write(&mesh, "v 2.1 3 0.1\nv 3 3 0.3\nv 2.4 3.2 1\nf 1 2 3\n").unwrap();
    let compiled = world(&format!(
        "[camera]\nposition = [0, 3, 7]\nlook_at = [0, 1, 0]\n[film]\nwidth = 64\nheight = 36\nmax_depth = 1\n[spacetime]\n{spacetime}\n\
         [[material]]\nname = \"floor\"\nbase_color = [0.6, 0.5, 0.4]\n\
         [[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [9, 8, 6]\ntwo_sided = true\n\
         {}\n[[quad]]\ncorner = [-6, 0, 6]\nu = [12, 0, 0]\nv = [0, 0, -12]\nmaterial = \"floor\"\n",
        lamp.replace("FILE", &mesh.display().to_string())
    ));
    std::fs::remove_dir_all(&folder).unwrap();
    compiled
}

/// The same, aimed at straight.
fn aimed_straight(mut world: World) -> World {
    world.scene.aim_scale = 0.0;
    world
}

/// Share of the directions drawn towards the lamp from points on the floor, away from the shadow of the center, that lead there.
fn share_that_arrives(world: &World) -> f64 {
    let view = world.view();
    let model = world.model_block::<f32>();
    let course = Course { view, scene: view.scene, model: &model, kind: world.model, stop: Stop::Never, drift: false };
    let count = 4000;
    let ray = |i: usize| {
        let (place, u) = (random_pair(1, 0, i as u32), random_pair(1, 1, i as u32));
        let origin = vec3(place.x * 7.0 - 2.0, 1e-3, place.y * 6.0 - 3.0);
        let from = Vantage::new(&view, origin.into());
        (origin, Vec3::from(sample_lights((), &view, true, 0.0, &from, [u.x, u.y])))
    };
    let launch = |i: usize| {
        let (origin, direction) = ray(i);
        Launch { origin: from_vec3(origin), direction: from_vec3(direction), speed: 1.0, sense: -1.0, side: 0, width: 1e-3, spread: 1e-3 }
    };
    let (mut arrived, mut traverser) = (0, Traverser::new());
    nullray::dispatch!(Level::new(), simd => advance_curved(simd, &course, &mut traverser, count, launch, |_, landing| {
        let arrival = landing.arrival;
        arrived += u32::from(arrival.status == STATUS_HIT && arrival.position.y > 1.0);
    }));
    f64::from(arrived) / count as f64
}

#[test]
fn directions_lead_to_the_lights() {
    for (spacetime, text) in SPACETIMES {
        for (lamp, shape) in LAMPS {
            let world = lit_world(text, shape);
            let (aimed, straight) = (share_that_arrives(&world), share_that_arrives(&aimed_straight(world.clone())));
            println!("{spacetime}, {lamp}: {aimed:.3} of the directions arrive, {straight:.3} if aimed straight");
            if world.parameters.throat > 0.0 {
                assert_eq!(aimed, straight, "there is no table for two sides");
                continue;
            }
            // The table makes lights larger where they appear distorted, so that not all can.
            assert!(aimed > 0.5 && aimed > straight + 0.05, "{spacetime}, {lamp}: {aimed} against {straight}");
        }
    }
}

/// Mean luminance of a film, and its relative error.
fn mean_luminance(world: World) -> (f64, f64) {
    let film = film(&mut CpuBackend::new(None).unwrap(), world, Precision::F32, 1024);
    let sum: f64 = (0..film.sums.len()).map(|i| f64::from(luminance(film.radiance(i)))).sum();
    (sum / film.sums.len() as f64, film.relative_error())
}

#[test]
fn what_is_aimed_at_does_not_matter_in_the_mean() {
    let all = LAMPS.map(|(_, shape)| shape).join("\n");
    for (spacetime, text) in &SPACETIMES[..3] {
        let mut wrong = lit_world(text, &all);
        assert_eq!(wrong.scene.light_count, 3);
        for entry in &mut wrong.aims {
            *entry = [entry[0] + 0.4, entry[1], entry[2] - 0.2, 0.5 * entry[3] + 0.3];
        }
        let films = [lit_world(text, &all), aimed_straight(lit_world(text, &all)), wrong].map(mean_luminance);
        let [(aimed, _), (straight, _), (wrong, _)] = films;
        println!("{spacetime}: {films:?}");
        assert!((aimed / straight - 1.0).abs() < 0.01 && (wrong / straight - 1.0).abs() < 0.01, "{spacetime}: {films:?}");
        assert!(films[0].1 < films[1].1, "{spacetime}: aiming gains nothing: {films:?}");
    }
}
