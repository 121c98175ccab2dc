//! What rendered pictures must show: energy, exact irradiance, the shadow and the ring at the right size, the same film however
//! it was made. On the CPU backend; `tests/vulkan.rs` holds the GPU against it.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::cpu::CpuBackend;
use nullray::backend::{Backend, Precision};
use nullray::film::compare::{Thresholds, compare};
use nullray::film::{Film, luminance};
use nullray::kernels::bvh::{EMPTY_STACK, Hit, closest_hit, straight};
use nullray::kernels::constants::NO_INDEX;
use nullray::kernels::material::{Bsdf, evaluate_bsdf, sample_bsdf};
use nullray::kernels::rng::random_pair;
use nullray::kernels::triangle::intersect_triangle;
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
        let wo = glam::vec3((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
        let bsdf = Bsdf { color: glam::Vec3::ONE, kind: 1, alpha, eta: 1.0, albedo: 1.0 };
        let s: f64 = (0..100000u32).map(|k| f64::from(sample_bsdf(&bsdf, wo, random_pair(1, 0, k), 0.0).weight.x)).sum::<f64>() / 1e5;
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
        let bsdf = Bsdf { color: glam::Vec3::ONE, kind: 2, alpha, eta, albedo: 1.0 };
        let wo = glam::vec3((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
        let n = 1200;
        let (mut value, mut density) = (0.0f64, 0.0f64);
        for i in 0..n {
            let z = -1.0 + (2.0 * i as f64 + 1.0) / n as f64;
            for j in 0..n {
                let phi = std::f64::consts::TAU * (j as f64 + 0.5) / n as f64;
                let s = (1.0 - z * z).sqrt();
                let wi = glam::vec3((s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32);
                let (v, pdf) = evaluate_bsdf(&bsdf, wo, wi);
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
                let drawn = sample_bsdf(&bsdf, wo, random_pair(1, 0, k), random_pair(1, 1, k).x);
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
        let bsdf = Bsdf { color: glam::Vec3::splat(0.7), kind, alpha, eta, albedo: 0.9 };
        let wo = glam::vec3(0.5, 0.2, 0.8).normalize();
        let mut counts = vec![0.0f64; rows * columns];
        let mut lost = 0.0;
        for k in 0..samples {
            let drawn = sample_bsdf(&bsdf, wo, random_pair(7, 0, k), random_pair(7, 1, k).x);
            if drawn.weight == glam::Vec3::ZERO {
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
                    expected += f64::from(evaluate_bsdf(&bsdf, wo, glam::vec3((s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32)).1);
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

    let heavier = [&set[..], &["spacetime.mass=0.2525"]].concat();
    let other = film(&mut cpu(), asset_world("singularity.toml", &heavier), Precision::F32, 1);
    let difference = compare(&right, &other);
    assert!(!Thresholds::SHALLOW.hold(&difference), "1% more mass: {difference:?}");
}

/// The tree finds what testing every triangle finds.
#[test]
fn bvh_equals_brute_force() {
    let world: World = asset_world("benchmark.toml", &["spacetime.kind=flat"]);
    let view = world.view();
    let level = fearless_simd::Level::new();
    let mut hits = 0;
    for k in 0..2000u32 {
        let (a, b, c) = (random_pair(3, 0, k), random_pair(3, 1, k), random_pair(3, 2, k));
        let origin = glam::vec3(6.0 * a.x - 3.0, 3.0 * a.y, 6.0 * b.x - 3.0);
        let target = glam::vec3(1.6 * b.y - 0.8, 0.4 + 1.4 * c.x, 1.6 * c.y - 0.8);
        let direction = (target - origin).normalize();
        let mut hit = Hit::none(1e30);
        let mut stack = EMPTY_STACK;
        nullray::dispatch!(level, simd => closest_hit(simd, &view, &straight(origin, direction), 0, &mut stack, &mut hit));
        let mut best = 1e30f32;
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
        hits += u32::from(best < 1e30);
        let same = (hit.t - best).abs() <= 1e-5 * best || (hit.primitive == NO_INDEX && best == 1e30);
        assert!(same, "ray {k}: {} against {best}", hit.t);
    }
    assert!(hits > 1500, "{hits}");
}
