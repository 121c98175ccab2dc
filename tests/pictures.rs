//! What rendered pictures must show: energy, exact irradiance, the shadow and the ring at the right size, the same film however
//! it was made. On the CPU backend; `tests/vulkan.rs` holds the GPU against it.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::cpu::CpuBackend;
use nullray::backend::{Backend, Precision};
use nullray::film::compare::{Thresholds, compare};
use nullray::film::{Film, luminance};
use nullray::kernels::bvh::Hit;
use nullray::kernels::camera::sample_filter;
use nullray::kernels::clearance::clearance_at;
use nullray::kernels::constants::*;
use nullray::kernels::curve::{curve_point, deviation, hermite, whole_chord};
use nullray::kernels::material::{Bsdf, evaluate_bsdf, sample_bsdf};
use nullray::kernels::path::{BouncePairs, Scattering, draw_direction};
use nullray::kernels::rng::{pixel_seed, random_pair};
use nullray::kernels::sampling::spherical_direction;
use nullray::kernels::surface::black_body;
use nullray::kernels::traverser::{Query, Traverser};
use nullray::kernels::triangle::intersect_triangle;
use nullray::kernels::view::SceneView;
use nullray::simd::{Vector, by_lane, vector};
use nullray::spacetime::thermal;
use nullray::world::World;
use std::sync::Arc;
use support::*;

fn cpu() -> CpuBackend {
    CpuBackend::new(None).unwrap()
}

/// Mean radiance of all pixels, and its standard error.
fn mean(film: &Film) -> (f64, f64) {
    let values: Vec<f64> = (0..film.sums.len()).map(|i| f64::from(luminance(film.radiance(i)))).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// A sphere of one material in a white furnace, filling the picture.
fn furnace(material: &str, spp: u32, set: &str) -> f64 {
    let world = world(&format!(
        "[camera]\nposition = [0, 0, -10]\nlook_at = [0, 0, 0]\nfov_degrees = 4\n[film]\nwidth = 32\nheight = 32\nmax_depth = 64\nfilter = \"box\"\n{set}\n\
         [environment]\ncolor = [1, 1, 1]\n[[material]]\nname = \"m\"\n{material}\n[[sphere]]\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"m\"\n"
    ));
    mean(&film(&mut cpu(), world, Precision::F32, spp)).0
}

#[test]
fn white_furnace_of_every_material() {
    for (alpha, cos_o) in [(0.09f32, 0.97f32), (0.36, 0.97), (0.36, 0.5)] {
        let wo = vector((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
        let bsdf = Bsdf { color: Vector::uniform(1.0), kind: 1, alpha, eta: 1.0, albedo: 1.0 };
        let s: f64 =
            (0..100000u32).map(|k| f64::from(sample_bsdf((), &bsdf, wo, random_pair(1, 0, k).into(), 0.0).weight.x)).sum::<f64>() / 1e5;
        println!("alpha {alpha} cos {cos_o}: sampled {s} table {}", nullray::kernels::material::integrate_ggx_albedo(cos_o, alpha));
    }
    for albedo in [0.1, 0.5, 0.8, 0.99] {
        let value = furnace(&format!("base_color = [{albedo}, {albedo}, {albedo}]"), 64, "");
        assert!((value / albedo - 1.0).abs() < 0.005, "diffuse {albedo}: {value}");
    }
    for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
        let value = furnace(&format!("kind = \"metallic\"\nbase_color = [1, 1, 1]\nroughness = {roughness}"), 256, "");
        println!("metal, roughness {roughness}: {value}");
        assert!((value - 1.0).abs() < 0.005, "metal {roughness}: {value}");
    }
    let glass = furnace("kind = \"dielectric\"\nior = 1.5", 256, "");
    println!("glass: {glass}");
    assert!((glass - 1.0).abs() < 0.005, "glass: {glass}");
    // A black hole bends the furnace and changes nothing.
    let bent = furnace("base_color = [0.5, 0.5, 0.5]", 64, "[spacetime]\nkind = \"schwarzschild\"\nmass = 0.05\nposition = [0, 0, -1.5]");
    assert!(bent < 0.5, "the hole must swallow something: {bent}");
    let lensed = furnace(
        "base_color = [0.5, 0.5, 0.5]",
        64,
        "[spacetime]\nkind = \"gravity\"\n[[spacetime.center]]\nposition = [0, 0, -2]\nstrength = 0.2\nradius = 3",
    );
    assert!((lensed / 0.5 - 1.0).abs() < 0.005, "lensed furnace: {lensed}");
}

/// Rough glass scatters once: reflected plus transmitted light is its albedo, by quadrature over directions and by sampling.
#[test]
fn rough_dielectric_sampling_matches_quadrature() {
    for (alpha, eta, cos_o) in [(0.16f32, 1.5f32, 0.9f32), (0.36, 1.5, 0.5), (0.25, 1.0 / 1.5, 0.8)] {
        let bsdf = Bsdf { color: Vector::uniform(1.0), kind: 2, alpha, eta, albedo: 1.0 };
        let wo = vector((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
        let n = 1200;
        let (mut value, mut density) = (0.0f64, 0.0f64);
        for i in 0..n {
            let z = -1.0 + (2.0 * i as f64 + 1.0) / n as f64;
            for j in 0..n {
                let phi = std::f64::consts::TAU * (j as f64 + 0.5) / n as f64;
                let s = (1.0 - z * z).sqrt();
                let wi = vector((s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32);
                let (v, pdf) = evaluate_bsdf((), &bsdf, wo, wi);
                // Undo the compression of radiance, so that energy is counted.
                value += f64::from(v.x) * if z < 0.0 { f64::from(eta * eta) } else { 1.0 };
                density += f64::from(pdf);
            }
        }
        let solid_angle = 4.0 * std::f64::consts::PI / (n * n) as f64;
        let (value, density) = (value * solid_angle, density * solid_angle);
        let samples = 200_000u32;
        let sampled = (0..samples)
            .map(|k| {
                let drawn = sample_bsdf((), &bsdf, wo, random_pair(1, 0, k).into(), random_pair(1, 1, k).x);
                f64::from(drawn.weight.x) * if drawn.wi.z < 0.0 { f64::from(eta * eta) } else { 1.0 }
            })
            .sum::<f64>()
            / f64::from(samples);
        println!("alpha {alpha} eta {eta}: quadrature {value:.4}, sampled {sampled:.4}, density {density:.4}");
        assert!((value - sampled).abs() < 0.005 * value, "{value} {sampled}");
        assert!(density < 1.003, "density {density}");
    }
}

/// Directions of every lobe are distributed as their density says: chi-squared over a grid of directions.
#[test]
fn samplers_follow_their_densities() {
    let cases = [(0, 0.5f32, 1.0f32), (1, 0.3, 1.0), (2, 0.3, 1.5)];
    let (rows, columns, samples) = (16usize, 32usize, 200_000u32);
    for (kind, alpha, eta) in cases {
        let bsdf = Bsdf { color: Vector::uniform(0.7), kind, alpha, eta, albedo: 0.9 };
        let wo = vector(0.5, 0.2, 0.8).normalize(());
        let mut counts = vec![0.0f64; rows * columns];
        let mut lost = 0.0;
        for k in 0..samples {
            let drawn = sample_bsdf((), &bsdf, wo, random_pair(7, 0, k).into(), random_pair(7, 1, k).x);
            if glam::Vec3::from(drawn.weight) == glam::Vec3::ZERO {
                lost += 1.0;
                continue;
            }
            let row = (((drawn.wi.z + 1.0) * 0.5 * rows as f32) as usize).min(rows - 1);
            let turns = drawn.wi.y.atan2(drawn.wi.x) / std::f32::consts::TAU + 0.5;
            counts[row * columns + ((turns * columns as f32) as usize).min(columns - 1)] += 1.0;
        }
        let (mut chi2, mut cells) = (0.0, 0);
        let fine = 24;
        for row in 0..rows {
            for column in 0..columns {
                let mut expected = 0.0;
                for i in 0..fine * fine {
                    let z = -1.0 + 2.0 * (row as f64 + ((i / fine) as f64 + 0.5) / fine as f64) / rows as f64;
                    let phi = std::f64::consts::TAU * ((column as f64 + ((i % fine) as f64 + 0.5) / fine as f64) / columns as f64 - 0.5);
                    let s = (1.0 - z * z).sqrt();
                    let wi = vector((s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32);
                    expected += f64::from(evaluate_bsdf((), &bsdf, wo, wi).1);
                }
                expected *= 4.0 * std::f64::consts::PI / (rows * columns * fine * fine) as f64 * f64::from(samples);
                if expected > 20.0 {
                    chi2 += (counts[row * columns + column] - expected).powi(2) / expected;
                    cells += 1;
                }
            }
        }
        println!("kind {kind}: chi2 {chi2:.1} over {cells} cells, {lost} lost");
        // Scrambled Sobol samples are more even than random ones; a wrong density shows as a chi2 of thousands.
        assert!(cells > 20 && chi2 < f64::from(cells) + 5.0 * (2.0 * f64::from(cells)).sqrt(), "kind {kind}: {chi2} over {cells}");
    }
}

#[test]
fn closed_furnace_counts_bounces() {
    for row in table("radiometry").iter().filter(|r| r.text("kind") == "furnace_closed_emitter_n" && r.number("albedo") < 0.98) {
        let albedo = row.number("albedo");
        let world = world(&format!(
            "[camera]\nposition = [0.2, 0, 0]\nlook_at = [0, 0, 1]\n[film]\nwidth = 32\nheight = 32\nmax_depth = {}\n[[material]]\nname = \"m\"\n\
             base_color = [{albedo}, {albedo}, {albedo}]\nemission = [1, 1, 1]\n[[sphere]]\ncenter = [0, 0, 0]\nradius = 2\nmaterial = \"m\"\n",
            row.text("n_bounces")
        ));
        let (value, error) = mean(&film(&mut cpu(), world, Precision::F32, 64));
        let expected = row.number("value");
        assert!((value - expected).abs() < (4.0 * error).max(0.003 * expected), "albedo {albedo}: {value} +- {error}, expected {expected}");
    }
}

/// Irradiance of a small receiver under every sphere and rectangle of the table, with light sampling and without.
#[test]
fn irradiance_is_exact() {
    let mut worst: f64 = 0.0;
    let mut rows = 0;
    for row in table("radiometry").iter().filter(|r| ["sphere_light", "rect_light"].contains(&r.text("kind"))) {
        let p = row.vector(["px", "py", "pz"]).map(|v| v);
        let n = row.vector(["nx", "ny", "nz"]);
        let [n, p] = [n, p].map(glam::DVec3::from);
        let t = n.any_orthonormal_vector();
        let b = n.cross(t);
        let l = row.number("L");
        let c = glam::DVec3::from(row.vector(["cx", "cy", "cz"]));
        let light = if row.text("kind") == "sphere_light" {
            format!("[[sphere]]\ncenter = {:?}\nradius = {:?}\nmaterial = \"lamp\"\n", c.to_array(), row.number("R"))
        } else {
            let u = glam::DVec3::from(row.vector(["ux", "uy", "uz"])) * row.number("half_u");
            let v = glam::DVec3::from(row.vector(["vx", "vy", "vz"])) * row.number("half_v");
            // The quad's normal is u x v; it must point the way the table's does.
            let flipped = u.cross(v).dot(glam::DVec3::from(row.vector(["lnx", "lny", "lnz"]))) < 0.0;
            let (u, v) = if flipped { (v, u) } else { (u, v) };
            format!(
                "[[quad]]\ncorner = {:?}\nu = {:?}\nv = {:?}\nmaterial = \"lamp\"\n",
                (c - u - v).to_array(),
                (u * 2.0).to_array(),
                (v * 2.0).to_array()
            )
        };
        // A receiver of 2e-5 seen from just above; it reflects albedo / pi of the irradiance.
        let size = 1e-5;
        let corner = p - t * size - b * size;
        let albedo = row.number("albedo");
        let eye = p + n * 1e-3;
        let text = format!(
            "[camera]\nposition = {:?}\nlook_at = {:?}\nup = {:?}\nfov_degrees = 0.5\n[film]\nwidth = 16\nheight = 16\nmax_depth = 1\nfilter = \"box\"\n\
             [[material]]\nname = \"receiver\"\nbase_color = [{albedo}, {albedo}, {albedo}]\n[[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [{l}, {l}, {l}]\ntwo_sided = false\n\
             [[quad]]\ncorner = {:?}\nu = {:?}\nv = {:?}\nmaterial = \"receiver\"\n{light}",
            eye.to_array(),
            p.to_array(),
            t.to_array(),
            corner.to_array(),
            (t * 2.0 * size).to_array(),
            (b * 2.0 * size).to_array()
        );
        for share in [0.5, 0.0] {
            let mut scene = world(&text);
            scene.scene.light_share = share;
            let (value, error) = mean(&film(&mut cpu(), scene, Precision::F32, 64));
            let expected = row.number("radiance_out");
            // Without light sampling a small light is met by a few samples or none: the error is that of counting them.
            let factor = row.number("view_factor");
            let counting = albedo * l * (factor / (16.0 * 16.0 * 64.0)).sqrt();
            let error = if share == 0.0 { error.max(counting) } else { error };
            let deviation = (value - expected).abs() / error.max(2e-4 * expected);
            worst = worst.max(deviation);
            assert!(deviation < 4.5, "row {} share {share}: {value} +- {error}, expected {expected}", row.text("id"));
            rows += 1;
        }
    }
    println!("{rows} renderings, largest deviation {worst:.2} standard errors");
    assert!(rows > 60, "{rows}");
}

/// A patch of ground under a small lamp, seen through `panes` of glass: its radiance and the standard error over pixels.
fn ground_behind_glass(panes: usize) -> (f64, f64) {
    let mut text = String::from(
        "[camera]\nposition = [0, 1, 6]\nlook_at = [0, 0, 0]\nfov_degrees = 0.5\n[film]\nwidth = 32\nheight = 32\nfilter = \"box\"\n\
         [[material]]\nname = \"ground\"\n[[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [100, 100, 100]\n\
         [[material]]\nname = \"glass\"\nkind = \"dielectric\"\nior = 1.5\n\
         [[quad]]\ncorner = [-2, 0, 2]\nu = [4, 0, 0]\nv = [0, 0, -4]\nmaterial = \"ground\"\n\
         [[sphere]]\ncenter = [0, 3, 0]\nradius = 0.1\nmaterial = \"lamp\"\n",
    );
    for i in 0..panes {
        let z = 5.0 - 0.2 * i as f64;
        text += &format!("[[box]]\nmin = [-1, 0.1, {z}]\nmax = [1, 2, {}]\nmaterial = \"glass\"\n", z + 0.1);
    }
    mean(&film(&mut cpu(), world(&text), Precision::F32, 64))
}

/// Roulette must not take a ray towards a small lamp for the little that it brings.
#[test]
fn roulette_spares_rays_towards_lamps() {
    let (open, open_error) = ground_behind_glass(0);
    for panes in [1, 2, 3] {
        let (value, error) = ground_behind_glass(panes);
        let noise = (error / value) / (open_error / open);
        println!("{panes} panes: radiance {value:.5} of {open:.5}, relative noise {noise:.2} times that without");
        // Each of two surfaces reflects 4% of the light, and some of it back.
        assert!((value / open - 0.92f64.powi(panes as i32)).abs() < 0.03, "{panes} panes: {value} of {open}");
        // Losing reflected light alone makes it some 7 times as large; roulette by the weight of the direction drawn, 176 times.
        assert!(noise < 12.0, "{panes} panes: {noise}");
    }
}

/// An encounter with a surface of this kind, from the renderer's own numbers.
fn encounter(kind: u32, smooth: bool, k: u32) -> Scattering<f32> {
    let random = |pair| random_pair(11 + kind, pair, k);
    let unit = |pair| spherical_direction((), 2.0 * random(pair).x - 1.0, random(pair).y);
    let (a, b, c) = (random(0), random(1), random(2));
    let outward = unit(3);
    let color = vector(a.x, a.y, b.x);
    let alpha = if smooth { 0.0 } else { 0.001 + b.y * b.y };
    let eta = if kind == MATERIAL_DIELECTRIC { if k.is_multiple_of(2) { 1.5 } else { 1.0 / 1.5 } } else { 1.0 };
    let bsdf = Bsdf { color, kind, alpha, eta, albedo: 1.0 };
    let shading = (outward + unit(4) * 0.3).normalize(());
    let position = vector(8.0 * c.x - 4.0, c.y * 2.0 - 1.0, 8.0 * random(5).x - 4.0);
    Scattering { position, outward, shading, wo: unit(6), bsdf }
}

/// Directions and weights of sixteen encounters from number `first` on, drawn in registers and one by one.
fn draw_both(view: &SceneView, kind: u32, smooth: bool, first: u32) -> Vec<[[glam::Vec3; 2]; 2]> {
    let rows: Vec<Scattering<f32>> = (0..16).map(|lane| encounter(kind, smooth, first + lane)).collect();
    let pair = |pair: u32, lane: usize| random_pair(77, pair, first + lane as u32);
    let (wi, weight) = nullray::dispatch!(fearless_simd::Level::new(), simd => {
        type Register<S> = fearless_simd::f32x16<S>;
        let scattering: Scattering<Register<_>> = Scattering::by_lane(simd, |lane| &rows[lane]);
        let lanes = |k: u32| [by_lane(simd, |lane| pair(k, lane).x), by_lane(simd, |lane| pair(k, lane).y)];
        let random = BouncePairs { direction: lanes(0), lobe: lanes(1), choice: lanes(2)[0] };
        let draw = draw_direction(simd, view, &scattering, &random);
        (draw.wi.rows(), draw.weight.rows())
    });
    let of_lane = |lane: usize| {
        let at = |rows: &[[f32; 16]; 3]| glam::vec3(rows[0][lane], rows[1][lane], rows[2][lane]);
        let random = BouncePairs { direction: pair(0, lane).into(), lobe: pair(1, lane).into(), choice: pair(2, lane).x };
        let single = draw_direction((), view, &rows[lane], &random);
        [[at(&wi), at(&weight)], [single.wi.into(), single.weight.into()]]
    };
    (0..16).map(of_lane).collect()
}

/// Directions drawn in registers are those drawn one by one, at surfaces of every kind and with lights of every kind, few or many.
#[test]
fn registers_draw_the_directions_of_single_lanes() {
    let folder = std::env::temp_dir().join(format!("nullray-lights-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (sky, mesh) = (folder.join("sky.exr"), folder.join("lamp.obj"));
    image::Rgb32FImage::from_fn(16, 8, |x, y| image::Rgb([0.2 + (x % 3) as f32, 0.3, if y == 2 { 8.0 } else { 0.4 }])).save(&sky).unwrap();
    std::fs::write(&mesh, "v 2 3 -1\nv 3 3 1\nv 2 4 1\nf 1 2 3\n").unwrap();
    let lamp = "[[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [5, 4, 3]\n";
    let few = format!(
        "[environment]\nkind = \"image\"\nfile = {sky:?}\n[[sphere]]\ncenter = [0, 3, 0]\nradius = 0.7\nmaterial = \"lamp\"\n\
         [[quad]]\ncorner = [-3, 4, 0]\nu = [1, 0, 0.3]\nv = [0, 0.4, 1]\nmaterial = \"lamp\"\n\
         [[mesh]]\nfile = {mesh:?}\nmaterial = \"lamp\"\n"
    );
    let many = (0..20).fold(String::new(), |s, i| {
        s + &format!("[[box]]\nmin = [{}, 3, -1]\nmax = [{}, 3.5, 1]\nmaterial = \"lamp\"\n", i - 10, f64::from(i) - 9.5)
    });
    let kinds = [(MATERIAL_DIFFUSE, false), (MATERIAL_METALLIC, false), (MATERIAL_DIELECTRIC, false), (MATERIAL_DIELECTRIC, true)];
    for (lights, text) in [(0, String::new()), (4, few), (120, many)] {
        let world = world(&format!("{lamp}{text}"));
        let view = world.view();
        assert_eq!(view.lights.len(), lights);
        for (kind, smooth) in kinds {
            let draws: Vec<_> = (0..16_000).step_by(16).flat_map(|first| draw_both(&view, kind, smooth, first)).collect();
            let close = |[[wi, weight], [single_wi, single_weight]]: &[[glam::Vec3; 2]; 2]| {
                (wi - single_wi).length() < 1e-3 && (weight - single_weight).length() <= 2e-3 * (1e-2 + single_weight.length())
            };
            let different = draws.iter().filter(|draw| !close(draw)).count();
            let lost = draws.iter().filter(|draw| draw[1][1] == glam::Vec3::ZERO).count();
            println!("{lights} lights, kind {kind}, smooth {smooth}: {different} of {} differ, {lost} lost", draws.len());
            // A light's edge, or the critical angle, within rounding.
            assert!(different * 2000 < draws.len(), "{lights} lights, kind {kind}, smooth {smooth}: {different} differ");
            assert!(lost * 2 < draws.len(), "{lost} lost");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The shadow's angular radius at three distances, from the share of captured pixels along the middle row.
#[test]
fn shadow_has_the_exact_size() {
    for r_obs in [5.0, 10.0, 30.0] {
        let rows = table("schw_shadow");
        let row = rows.iter().find(|r| r.number("r_obs") == r_obs).unwrap();
        let (rho, alpha) = (row.number("rho_obs"), row.number("alpha_shadow"));
        let width = 401;
        // The field of view holds the shadow with some room.
        let fov = 2.0 * (alpha * 1.5).min(1.2);
        let world = world(&format!(
            "[camera]\nposition = [0, 0, {}]\nlook_at = [0, 0, 0]\nfov_degrees = {}\n[film]\nwidth = {width}\nheight = {width}\nfilter = \"box\"\n\
             [spacetime]\nkind = \"schwarzschild\"\nmass = 1\n[environment]\ncolor = [1, 1, 1]\n",
            -rho,
            fov.to_degrees()
        ));
        let film = film(&mut cpu(), world, Precision::F32, 16);
        let middle = (width / 2) * width;
        let captured: f64 = (0..width).map(|x| 1.0 - f64::from(film.radiance(middle + x)[0])).sum();
        let half = (fov / 2.0).tan();
        let expected = alpha.tan() / half * width as f64;
        println!("r_obs {r_obs}: shadow {captured:.2} pixels wide, expected {expected:.2}");
        assert!((captured - expected).abs() < 1.0, "r_obs {r_obs}: {captured} {expected}");
    }
}

/// The Einstein ring of a small emissive sphere exactly behind the hole.
#[test]
fn einstein_ring_has_the_exact_radius() {
    let rows = table("schw_einstein_ring");
    let row = rows.iter().find(|r| r.text("ring") == "1" && r.number("r_obs") == 30.0 && r.number("r_src").is_finite()).unwrap();
    let alpha = row.number("alpha");
    let width = 301usize;
    let fov = 2.0 * 1.4 * alpha;
    let world = world(&format!(
        "[camera]\nposition = [0, 0, {}]\nlook_at = [0, 0, 0]\nfov_degrees = {}\n[film]\nwidth = {width}\nheight = {width}\nfilter = \"box\"\n\
         [spacetime]\nkind = \"schwarzschild\"\nmass = 1\n[[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [1, 1, 1]\n\
         [[sphere]]\ncenter = [0, 0, {}]\nradius = 0.05\nmaterial = \"lamp\"\n",
        -row.number("rho_obs"),
        fov.to_degrees(),
        row.number("rho_src")
    ));
    let film = film(&mut cpu(), world, Precision::F32, 64);
    // Brightness-weighted distance of the ring's pixels from the centre, along the middle row.
    let middle = width / 2;
    let (mut weight, mut radius) = (0.0, 0.0);
    for x in 0..width {
        let light = f64::from(film.radiance(middle * width + x)[0]);
        let offset = (x as f64 - middle as f64).abs();
        if offset > 0.5 * alpha.tan() / (fov / 2.0).tan() * width as f64 / 2.0 {
            weight += light;
            radius += light * offset;
        }
    }
    let expected = alpha.tan() / (fov / 2.0).tan() * width as f64 / 2.0;
    println!("ring of {:.2} pixels, expected {expected:.2}", radius / weight);
    assert!(weight > 0.0 && (radius / weight - expected).abs() < 1.0, "{} {expected}", radius / weight);
}

/// Where on the film, in pixels, the first sample of a pixel is with a box filter.
fn first_sample(x: usize, y: usize) -> glam::DVec2 {
    let [across, down] = sample_filter((), FILTER_BOX, random_pair(pixel_seed(x as u32, y as u32), 0, 0).into());
    glam::dvec2(x as f64 + 0.5 + f64::from(across), y as f64 + 0.5 + f64::from(down))
}

/// Vertical field of view, in degrees, of a film whose half width is this tangent.
fn fov_degrees(half_width: f64, width: usize, height: usize) -> f64 {
    (2.0 * (half_width * height as f64 / width as f64).atan()).to_degrees()
}

/// A rotating hole's shadow from afar. The picture is a line through the shadow's middle, rolled by the angle `psi` of a row of the
/// table: samples this side of the tabulated edge are captured and the others escape, but for those within a pixel of it.
///
/// At a spin of 0.998 the light that orbits along the spin is 0.01 M above the horizon, and the flat side of the shadow comes out up to
/// 8 pixels short at the default tolerance of 0.3 pixels, here 0.005 M: it takes a finer one.
#[test]
fn kerr_shadow_has_the_exact_shape() {
    let (r, width, height) = (1000.0f64, 1001usize, 3usize);
    let half_width = 9.0 / r;
    // A length at the hole as the tangent of an angle at a camera at rest, which its lapse narrows.
    let tangent = (1.0 - 1.0 / r) / r;
    let rows = table("kerr_shadow");
    let mut backend = cpu();
    let (mut edges, mut worst) = (0, 0.0f64);
    for (spin, inclination, tolerance) in [("0.9", "60", 0.3), ("0.9", "90", 0.3), ("0.998", "60", 0.3), ("0.998", "90", 0.3)] {
        let shadow: Vec<&Row> = rows.iter().filter(|row| row.text("a") == spin && row.text("inc_deg") == inclination).collect();
        let edge = |k: usize| -> Option<f64> {
            let row = shadow.iter().find(|row| row.number("k") == k as f64)?;
            Some(row.number("radius") * tangent / half_width * width as f64 / 2.0)
        };
        for row in shadow.iter().step_by(4) {
            let (a, psi) = (row.number("a"), row.number("psi"));
            let (sin, cos) = row.number("inc_deg").to_radians().sin_cos();
            let (right, up) = (glam::DVec3::Y, glam::dvec3(-cos, 0.0, sin));
            let position = glam::dvec3(r * sin, a * sin, r * cos);
            // The local observer of this chart falls inward with this velocity: the camera is to stay where it is.
            let fall = 2.0 * r.powi(3) / (r.powi(4) + (a * position.z).powi(2));
            let world = world(&format!(
                "[camera]\nposition = {:?}\nlook_at = {:?}\nup = {:?}\nvelocity = {:?}\nfov_degrees = {:?}\n\
                 [film]\nwidth = {width}\nheight = {height}\nmax_depth = 0\nfilter = \"box\"\n\
                 [spacetime]\nkind = \"kerr\"\nspin = {spin}\naxis = [0, 0, 1]\n[environment]\ncolor = [1, 1, 1]\n\
                 [integrator]\ntolerance = {tolerance}\n",
                position.to_array(),
                (right * row.number("alpha_center") * (1.0 - 1.0 / r)).to_array(),
                (up * psi.cos() - right * psi.sin()).to_array(),
                glam::dvec3(fall * sin, 0.0, fall * cos).to_array(),
                fov_degrees(half_width, width, height)
            ));
            let film = film(&mut backend, world, Precision::F32, 1);
            let k = row.number("k") as usize;
            let ends = [edge((k + 32) % 64), edge(k)];
            for (i, aov) in film.aovs.iter().enumerate() {
                let known = [STATUS_CAPTURED, STATUS_ESCAPED].contains(&aov.status);
                assert!(known, "spin {spin}, inclination {inclination}, row {k}, pixel {i}: status {}", aov.status);
                let place = first_sample(i % width, i / width) - glam::dvec2(width as f64, height as f64) / 2.0;
                let Some(radius) = ends[usize::from(place.x > 0.0)] else { continue };
                let beyond = place.length() - radius;
                if (beyond < 0.0) != (aov.status == STATUS_CAPTURED) {
                    assert!(beyond.abs() < 1.0, "spin {spin}, inclination {inclination}, row {k}: {beyond} pixels beyond the edge");
                    worst = worst.max(beyond.abs());
                }
            }
            edges += ends.iter().flatten().count();
        }
    }
    println!("{edges} edges, wrong at most {worst:.2} pixels from them");
    assert!(edges >= 30, "{edges}");
}

/// Luminet's disc in a picture: where a pixel sees the disc, and with which shift, in the direct and in the secondary image.
#[test]
fn luminet_disc_has_the_exact_redshift() {
    // So far away that all lines of sight are parallel to 5e-4.
    let (away, width, height) = (20_000.0f64, 720usize, 240usize);
    let (sin, cos) = 80.0f64.to_radians().sin_cos();
    let r = away * (1.0 + 0.5 / away).powi(2);
    let lapse = (1.0 - 2.0 / r).sqrt();
    let tangent = |impact: f64| (impact * lapse / r).asin().tan();
    let half_width = tangent(34.0);
    let world = world(&format!(
        "[camera]\nposition = {:?}\nlook_at = [0, 0, 0]\nup = {:?}\nfov_degrees = {:?}\n\
         [film]\nwidth = {width}\nheight = {height}\nmax_depth = 0\nfilter = \"box\"\n[spacetime]\nkind = \"schwarzschild\"\nmass = 1\n\
         [[accretion_disc]]\nnormal = [0, 0, 1]\ninner_radius = 6\nouter_radius = 40\npeak_temperature = 10000\nopaque = false\n",
        [away * sin, 0.0, away * cos],
        [-cos, 0.0, sin],
        fov_degrees(half_width, width, height)
    ));
    let film = film(&mut cpu(), world, Precision::F32, 1);
    let hit = |i: usize| film.aovs[i].status == STATUS_HIT;
    let g = |i: usize| f64::from(film.aovs[i].redshift);
    let place = |i: usize| glam::Vec3::from(film.aovs[i].position).as_dvec3();
    // A pixel and its eight neighbours.
    let around = |i: usize| [i - width, i, i + width].map(|i| [i - 1, i, i + 1]).concat();
    let mut compared = [0, 0];
    let mut worst: f64 = 0.0;
    for row in table("luminet_disc") {
        let screen = glam::dvec2(row.number("X"), row.number("Y"));
        // In pixels from the middle, then from the upper left corner.
        let offset = screen.normalize() * tangent(screen.length()) / half_width * width as f64 / 2.0;
        let at = glam::dvec2(width as f64 / 2.0 + offset.x, height as f64 / 2.0 - offset.y);
        let gap = |i: usize| first_sample(i % width, i / width).distance(at);
        let nearest = around(at.y as usize * width + at.x as usize).into_iter().min_by(|i, j| gap(*i).total_cmp(&gap(*j))).unwrap();
        let (radius, phi, secondary) = (row.number("r"), row.number("phi"), row.text("order") == "2");
        let name = format!("r {radius}, phi {}, order {}", row.text("phi_deg"), row.text("order"));
        if !hit(nearest) {
            // The rim may be just beside the sample, and the secondary image is thinner than a pixel in places.
            assert!(secondary || radius == 6.0, "{name}: the disc is not there");
            continue;
        }
        let rho = 0.5 * (radius - 1.0 + (radius * (radius - 2.0)).sqrt());
        let miss = place(nearest).distance(glam::dvec3(rho * phi.cos(), rho * phi.sin(), 0.0));
        // The direct image hides the secondary one from the first hit.
        if secondary && miss > 0.25 * rho {
            continue;
        }
        // How much changes from pixel to pixel.
        let neighbours: Vec<usize> = around(nearest).into_iter().filter(|i| hit(*i)).collect();
        let spread = neighbours.iter().map(|i| place(*i).distance(place(nearest))).fold(0.0, f64::max);
        let change = neighbours.iter().map(|i| (g(*i) - g(nearest)).abs()).fold(0.0, f64::max);
        // Far from linear in the secondary image.
        let share = if secondary { 1.0 } else { 0.5 };
        // The camera is at a finite distance, where light comes in bluer by its lapse.
        let expected = row.number("g") / lapse;
        let error = (g(nearest) - expected).abs() / expected;
        let allowed = 0.005 + share * change / expected;
        assert!(error < allowed, "{name}: g {} expected {expected}, allowed {allowed}", g(nearest));
        assert!(miss < spread, "{name}: {miss} from the point, {spread} from pixel to pixel");
        if !secondary {
            worst = worst.max(error);
        }
        compared[usize::from(secondary)] += 1;
    }
    println!("{compared:?} rows, largest error of g in the direct image {worst:.4}");
    assert!(compared[0] >= 58 && compared[1] >= 12, "{compared:?}");
}

/// Someone who moves sees what is at rest nearer to where he goes, and bluer.
#[test]
fn moving_observer_sees_aberration_and_doppler_shift() {
    let (speed, width, height, half_width) = (0.6f64, 1201usize, 15usize, 2.75f64);
    let gamma = 1.0 / (1.0 - speed * speed).sqrt();
    let angles = [30.0f64, 60.0, 100.0].map(f64::to_radians);
    let temperature = 5000.0;
    // To the right of someone who looks along +Z is -X.
    let spheres: String = angles
        .iter()
        .map(|t| format!("[[sphere]]\ncenter = {:?}\nradius = 1.5\nmaterial = \"lamp\"\n", [-100.0 * t.sin(), 0.0, 100.0 * t.cos()]))
        .collect();
    let world = world(&format!(
        "[camera]\nposition = [0, 0, 0]\nlook_at = [0, 0, 1]\nvelocity = [0, 0, {speed}]\nfov_degrees = {:?}\n\
         [film]\nwidth = {width}\nheight = {height}\nmax_depth = 0\nfilter = \"box\"\n\
         [[material]]\nname = \"lamp\"\nkind = \"emissive\"\ntemperature = {temperature}\n{spheres}",
        fov_degrees(half_width, width, height)
    ));
    let film = film(&mut cpu(), world, Precision::F32, 1);
    for (object, theta) in angles.iter().enumerate() {
        let pixels: Vec<usize> = (0..film.aovs.len()).filter(|i| film.aovs[*i].object as usize == object + 1).collect();
        assert!(pixels.len() >= 5, "sphere {object}: {} pixels", pixels.len());
        let column = pixels.iter().map(|i| (i % width) as f64 + 0.5).sum::<f64>() / pixels.len() as f64;
        let seen = 2.0 * (((1.0 - speed) / (1.0 + speed)).sqrt() * (theta / 2.0).tan()).atan();
        let expected = (1.0 + seen.tan() / half_width) / 2.0 * width as f64;
        assert!((column - expected).abs() < 1.0, "sphere {object}: column {column}, expected {expected}");
        // The channel leaves out the camera's own motion; the colour has it.
        assert!(pixels.iter().all(|i| film.aovs[*i].redshift == 1.0), "sphere {object}: shifted at rest");
        let doppler = gamma * (1.0 + speed * theta.cos());
        let hot = thermal::black_body(doppler * temperature);
        let color = [0, 1, 2].map(|c| pixels.iter().map(|i| f64::from(film.radiance(*i)[c])).sum::<f64>() / pixels.len() as f64);
        println!("sphere {object}: column {column:.2} expected {expected:.2}, colour {color:.3?} expected {hot:.3?}");
        assert!(color.iter().zip(hot).all(|(c, h)| (c / h - 1.0).abs() < 0.02), "sphere {object}: {color:?}, expected {hot:?}");
    }
}

/// The mouth of a wormhole has its size, another sky inside, and what stands on the far side is seen in it alone.
#[test]
fn wormhole_mouth_has_the_exact_size() {
    let (rho, width, height) = (3.0f64, 401usize, 11usize);
    let half_width = 40.0f64.to_radians().tan();
    let world = world(&format!(
        "[camera]\nposition = [0, 0, {:?}]\nlook_at = [0, 0, 0]\nfov_degrees = {:?}\n\
         [film]\nwidth = {width}\nheight = {height}\nmax_depth = 0\nfilter = \"box\"\n[spacetime]\nkind = \"ellis\"\nthroat = 1\n\
         [environment]\ncolor = [1, 0, 0]\n[environment.far]\ncolor = [0, 0, 1]\n\
         [[material]]\nname = \"lamp\"\nkind = \"emissive\"\nemission = [0, 1, 0]\n\
         [[sphere]]\ncenter = [0, 0, -5]\nradius = 0.5\nmaterial = \"lamp\"\nside = -1\n\
         [[sphere]]\ncenter = [-2, 0, 0]\nradius = 0.25\nmaterial = \"lamp\"\nside = -1\n\
         [[sphere]]\ncenter = [2, 0, 0]\nradius = 0.25\nmaterial = \"lamp\"\n",
        -rho,
        fov_degrees(half_width, width, height)
    ));
    let film = film(&mut cpu(), world, Precision::F32, 1);
    let l = rho - 0.25 / rho;
    let mouth = (1.0 / (l * l + 1.0).sqrt()).asin().tan() / half_width * width as f64 / 2.0;
    let mut seen = [0; 4];
    for (i, aov) in film.aovs.iter().enumerate() {
        let (place, object) = (first_sample(i % width, i / width), aov.object as usize);
        seen[object] += 1;
        let beyond = place.distance(glam::dvec2(width as f64, height as f64) / 2.0) - mouth;
        if beyond.abs() < 1.0 {
            continue;
        }
        // The two skies, the spheres of the far side, that of the near one.
        let color = if object > 0 {
            [0.0, 1.0, 0.0]
        } else if beyond < 0.0 {
            [0.0, 0.0, 1.0]
        } else {
            [1.0, 0.0, 0.0]
        };
        assert_eq!(film.radiance(i), color, "pixel {i}, {beyond} beyond the mouth, object {object}");
        assert!(object == 0 || (object == 3) == (beyond > 0.0), "pixel {i}, {beyond} beyond the mouth: object {object}");
    }
    // Straight through the hole is the sphere behind the camera.
    assert_eq!(film.aovs[height / 2 * width + width / 2].object, 1);
    println!("mouth of {mouth:.2} pixels, pixels of objects {seen:?}");
    assert!(seen.iter().all(|n| *n >= 10), "{seen:?}");
}

/// The table of black bodies against the integral over the spectrum.
#[test]
fn black_bodies_equal_their_spectra() {
    let world = world("");
    let view = world.view();
    let mut worst: f64 = 0.0;
    for i in 0..=500 {
        let temperature = (800.0 * (90_000.0f64 / 800.0).powf(f64::from(i) / 500.0)) as f32;
        let exact = thermal::black_body(f64::from(temperature));
        let largest = exact.into_iter().fold(0.0, f64::max);
        let found = black_body(&view, temperature).as_dvec3().to_array();
        let error = found.iter().zip(exact).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max) / largest;
        assert!(error < 0.005, "{temperature} K: {found:?}, expected {exact:?}");
        worst = worst.max(error);
    }
    println!("largest error {worst:.1e} of the largest component");
}

/// Hardly a ray of any scene of the repository runs out of steps, and none brings what is not a number.
#[test]
fn rays_of_every_scene_come_to_an_end() {
    let mut backend = cpu();
    let mut scenes = 0;
    for entry in std::fs::read_dir(root().join("assets/scenes")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if !name.ends_with(".toml") {
            continue;
        }
        let statistics = film(&mut backend, asset_world(&name, &["film.width=96", "film.height=54"]), Precision::F32, 4).statistics;
        println!("{name}: {statistics:?}");
        assert!((statistics.exhausted as f64) < 0.001 * statistics.rays as f64, "{name}: {statistics:?}");
        assert_eq!(statistics.invalid, 0, "{name}");
        scenes += 1;
    }
    assert!(scenes >= 30, "{scenes}");
}

#[test]
fn same_film_from_any_number_of_threads_and_parts() {
    let world = || asset_world("singularity.toml", &["film.width=96", "film.height=54"]);
    let one = film(&mut CpuBackend::new(Some(1)).unwrap(), world(), Precision::F32, 4);
    let two = film(&mut CpuBackend::new(Some(2)).unwrap(), world(), Precision::F32, 4);
    assert!(one == two, "1 and 2 threads differ");
    let mut backend = cpu();
    let first = film(&mut backend, world(), Precision::F32, 1);
    backend.upload(Arc::new(world()), Precision::F32, 1).unwrap();
    // Rows and samples in another order and another cut.
    backend.accumulate(20..54, 1..3).unwrap();
    backend.accumulate(0..20, 1..4).unwrap();
    backend.accumulate(20..54, 3..4).unwrap();
    let mut merged = backend.film().unwrap();
    merged.merge(&first).unwrap();
    assert!(merged == one, "merged parts differ from one run");
}

/// The comparison of films fails on what it must notice.
#[test]
fn comparison_notices_wrong_films() {
    let set = ["film.width=96", "film.height=54", "film.max_depth=2"];
    let right = film(&mut cpu(), asset_world("singularity.toml", &set), Precision::F32, 1);
    assert!(Thresholds::SHALLOW.hold(&compare(&right, &right)));

    let mut brighter = right.clone();
    brighter.sums.iter_mut().for_each(|s| s.iter_mut().for_each(|v| *v += *v / 20));
    assert!(!Thresholds::SHALLOW.hold(&compare(&right, &brighter)), "5% more exposure");

    let mut shifted = right.clone();
    let w = right.width as usize;
    let row = 30 * w..31 * w;
    shifted.sums[row.clone()].rotate_right(1);
    shifted.aovs[row].rotate_right(1);
    let difference = compare(&right, &shifted);
    assert!(!Thresholds::SHALLOW.hold(&difference), "one shifted row: {difference:?}");

    let mut farther = right.clone();
    farther.aovs.iter_mut().filter(|a| a.status == STATUS_HIT).for_each(|a| a.distance *= 1.002);
    let difference = compare(&right, &farther);
    assert!(difference.pixels == 0.0 && !Thresholds::SHALLOW.hold(&difference), "hits 0.2% farther: {difference:?}");

    let heavier = [&set[..], &["spacetime.mass=0.2525"]].concat();
    let other = film(&mut cpu(), asset_world("singularity.toml", &heavier), Precision::F32, 1);
    let difference = compare(&right, &other);
    assert!(!Thresholds::SHALLOW.hold(&difference), "1% more mass: {difference:?}");
}

/// Closest hits of straight rays by the tree, in the order of the rays.
fn closest_hits(view: &SceneView, rays: &[(glam::Vec3, glam::Vec3)]) -> Vec<Hit> {
    let mut hits = vec![Hit::none(0.0); rays.len()];
    let queries = rays.iter().map(|&(origin, direction)| Query::straight(origin, direction, view.scene_root(0))).enumerate();
    nullray::dispatch!(fearless_simd::Level::new(), simd => Traverser::new().closest_hits(simd, view, queries, |i, _, hit| hits[i] = hit));
    hits
}

/// The tree finds what testing every triangle finds.
#[test]
fn bvh_equals_brute_force() {
    let world: World = asset_world("benchmark.toml", &["spacetime.kind=flat"]);
    let view = world.view();
    let rays: Vec<(glam::Vec3, glam::Vec3)> = (0..2000u32)
        .map(|k| {
            let (a, b, c) = (random_pair(3, 0, k), random_pair(3, 1, k), random_pair(3, 2, k));
            let origin = glam::vec3(6.0 * a.x - 3.0, 3.0 * a.y, 6.0 * b.x - 3.0);
            let target = glam::vec3(1.6 * b.y - 0.8, 0.4 + 1.4 * c.x, 1.6 * c.y - 0.8);
            (origin, (target - origin).normalize())
        })
        .collect();
    let mut hits = 0;
    for (k, (&(origin, direction), hit)) in rays.iter().zip(closest_hits(&view, &rays)).enumerate() {
        let mut best = FAR;
        for block in &world.blocks {
            for lane in 0..8 {
                let at = |v: &[[f32; 8]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let found = intersect_triangle::<f32>(
                    (),
                    origin.to_array(),
                    direction.to_array(),
                    at(&block.vertex),
                    at(&block.edge1),
                    at(&block.edge2),
                    best,
                );
                if found.mask && block.triangle[lane] != NO_INDEX {
                    best = found.t;
                }
            }
        }
        for primitive in &world.primitives {
            let t = nullray::kernels::primitive::intersect_primitive(primitive, origin, direction, best).x;
            if t > 0.0 {
                best = t;
            }
        }
        hits += u32::from(best < FAR);
        let same = (hit.t - best).abs() <= 1e-5 * best || (hit.primitive == NO_INDEX && best == FAR);
        assert!(same, "ray {k}: {} against {best}", hit.t);
    }
    assert!(hits > 1500, "{hits}");
}

/// What curves stray from their whole chord, and so the ends of their pieces, is what the boxes are extended by, to each side of each axis,
/// and not much less; a curve of a single piece is its chord.
#[test]
fn curves_stay_near_their_chords() {
    let mut largest = 0.0f32;
    for k in 0..2000u32 {
        let vector = |i: u32| {
            let (a, b) = (random_pair(7, 2 * i, k), random_pair(7, 2 * i + 1, k));
            [a.x - 0.5, a.y - 0.5, b.x - 0.5]
        };
        let mut curve = hermite((), vector(0), vector(1), vector(2), vector(3));
        assert_eq!(deviation((), &curve), ([0.0; 3], [0.0; 3]));
        curve.chords = 2.0;
        let (down, up) = deviation((), &curve);
        let chord = whole_chord(&curve);
        let (mut least, mut most) = ([0.0f32; 3], [0.0f32; 3]);
        for i in 0..=256 {
            let s = i as f32 / 256.0;
            let point = curve_point(&curve, s);
            for axis in 0..3 {
                let apart = point[axis] - (curve.start[axis] + chord[axis] * s);
                least[axis] = least[axis].min(apart);
                most[axis] = most[axis].max(apart);
            }
        }
        for axis in 0..3 {
            for (reached, bound) in [(-least[axis], down[axis]), (most[axis], up[axis])] {
                assert!(reached <= bound + 1e-6, "curve {k}, axis {axis}: {reached} from the chord, at most {bound} was expected");
                largest = largest.max(reached / bound.max(1e-3));
            }
        }
    }
    assert!(largest > 0.95, "the bound is never nearly reached: {largest}");
}

/// A random point of a box that holds most of the benchmark scene, or of one five times as large, in turns.
fn scene_point(k: u32) -> glam::Vec3 {
    let (a, b) = (random_pair(5, 0, k), random_pair(5, 1, k));
    let scale = if k.is_multiple_of(2) { 1.0 } else { 5.0 };
    glam::vec3(14.0 * a.x - 7.0, 7.0 * a.y - 1.0, 14.0 * b.x - 7.0) * scale
}

/// No surface is nearer to a point than the clearance grid says, on any level and beyond the region.
#[test]
fn clearance_is_a_lower_bound() {
    let hole = ["spacetime.kind=schwarzschild", "spacetime.mass=0.1", "spacetime.position=[0.9, 2.0, 1.2]"];
    let center = ["spacetime.kind=gravity", "spacetime.center=[{ position = [0.9, 2.0, 1.2], strength = 0.3, radius = 2 }]"];
    for set in [&hole[..], &center] {
        let world: World = asset_world("benchmark.toml", set);
        let view = world.view();
        // Where random rays meet surfaces.
        let rays: Vec<(glam::Vec3, glam::Vec3)> = (0..4000)
            .map(|k| {
                let (origin, target) = (scene_point(k), scene_point(k + 1));
                (origin, (target - origin).normalize())
            })
            .collect();
        let hits = closest_hits(&view, &rays).into_iter().zip(&rays).filter(|(hit, _)| hit.primitive != NO_INDEX);
        let surfaces: Vec<glam::Vec3> = hits.map(|(hit, &(origin, direction))| origin + direction * hit.t).collect();
        assert!(surfaces.len() > 2000, "{}", surfaces.len());
        let (mut clear, mut free) = (0.0, 0.0);
        for point in (10_000..12_000).map(scene_point) {
            let nearest = surfaces.iter().map(|s| s.distance(point)).fold(f32::INFINITY, f32::min);
            let focus = glam::Vec3::from(world.scene.grid_focus);
            let position = ((point - focus) * world.scene.grid_inverse_cell).to_array();
            let clearance = clearance_at::<f32>((), &view, position) / world.scene.grid_inverse_cell;
            assert!(clearance <= nearest, "{point}: {clearance} is clear, something is {nearest} away");
            clear += clearance;
            free += nearest;
        }
        assert!(clear > 0.1 * free, "of {free} only {clear} is known to be clear");
    }
}
