//! The Vulkan backend: every kernel function against its Rust twin, whole films against the CPU, physics, and clean validation.
//!
//! Runs under `NULLRAY_VALIDATION=1` by itself. Without a Vulkan device the tests show as ignored, unless
//! `NULLRAY_REQUIRE_VULKAN=1` says that there must be one.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use glam::{Vec3, vec3};
use nullray::backend::cpu::CpuBackend;
use nullray::backend::vulkan::VulkanBackend;
use nullray::backend::vulkan::buffer::Buffer;
use nullray::backend::vulkan::command::Commands;
use nullray::backend::vulkan::pipeline::{Layout, Pipeline};
use nullray::backend::{Backend, Canvas, Channel, Development, Precision};
use nullray::film::compare::{Thresholds, compare};
use nullray::film::fixed_from_float;
use nullray::kernels::constants::*;
use nullray::kernels::material::*;
use nullray::kernels::primitive::*;
use nullray::kernels::rng::*;
use nullray::kernels::sampling::*;
use nullray::kernels::triangle::intersect_triangle;
use nullray::kernels::view::SceneView;
use nullray::scene::ToneMap;
use nullray::simd::Vector;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::sync::Arc;
use support::tables::TABLES;
use support::*;

fn main() {
    let tests: [DeviceTest; 12] = [
        ("kernel_functions_equal_their_twins", true, kernel_functions_equal_their_twins),
        ("reference_tables_f32", true, reference_tables_f32),
        ("reference_tables_f64", true, reference_tables_f64),
        ("thesis_rays", true, thesis_rays),
        ("films_agree_on_every_scene", true, films_agree_on_every_scene),
        ("films_agree_in_f64", true, films_agree_in_f64),
        ("methods_agree", true, methods_agree),
        ("parts_merge_to_the_bit", true, parts_merge_to_the_bit),
        ("power_law_and_lines_agree", true, power_law_and_lines_agree),
        ("light_kinds_and_textures_agree", true, light_kinds_and_textures_agree),
        ("films_develop_as_on_the_host", true, films_develop_as_on_the_host),
        ("a_moved_camera_needs_no_new_world", true, a_moved_camera_needs_no_new_world),
    ];
    run_device_tests(&tests);
}

fn vulkan() -> VulkanBackend {
    VulkanBackend::new(None).unwrap()
}

struct Includes;

impl glslang::include::IncludeHandler for Includes {
    fn include(&mut self, _: glslang::include::IncludeType, name: &str, _: &str, _: usize) -> Option<glslang::include::IncludeResult> {
        let data = if name == "constants.glsl" {
            let mut text = String::new();
            UINTS.iter().for_each(|(n, v)| writeln!(text, "const uint {n} = {v}u;").unwrap());
            FLOATS.iter().for_each(|(n, v)| writeln!(text, "const float {n} = {v:?};").unwrap());
            text
        } else {
            std::fs::read_to_string(root().join("shaders").join(name)).ok()?
        };
        Some(glslang::include::IncludeResult { name: name.to_owned(), data })
    }
}

/// SPIR-V of the probe for one function.
fn probe(function: usize) -> Vec<u8> {
    use glslang::*;
    let text = std::fs::read_to_string(root().join("tests/probes/kernels.comp")).unwrap();
    let source = ShaderSource::from(text);
    let options = CompilerOptions {
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_2, spirv_version: SpirvVersion::SPIRV1_5 },
        messages: ShaderMessage::VULKAN_RULES | ShaderMessage::SPV_RULES,
        ..CompilerOptions::default()
    };
    let value = function.to_string();
    let defines = [("FUNCTION", Some(value.as_str()))];
    let mut includes = Includes;
    let input = ShaderInput::new(&source, ShaderStage::Compute, &options, Some(&defines[..]), Some(&mut includes)).unwrap();
    let shader = Compiler::acquire().unwrap().create_shader(input).unwrap_or_else(|e| panic!("probe {function}: {e}"));
    shader.compile().unwrap().iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// Runs a probe over rows of sixteen inputs.
fn run_probe(backend: &VulkanBackend, function: usize, inputs: &[[f32; 16]]) -> Vec<[f32; 8]> {
    let device = backend.device();
    let layout = Layout::new(device, 2, 4).unwrap();
    let pipeline = Pipeline::new(device, &layout, "probe", &probe(function)).unwrap();
    let mut from = Buffer::new(device, "inputs", size_of_val(inputs) as u64, gpu_allocator::MemoryLocation::CpuToGpu).unwrap();
    let mut to = Buffer::new(device, "outputs", inputs.len() as u64 * 32, gpu_allocator::MemoryLocation::GpuToCpu).unwrap();
    let bytes: &[u8] = bytemuck::cast_slice(inputs);
    from.mapped().unwrap()[..bytes.len()].copy_from_slice(bytes);
    layout.bind(&[&from, &to]);
    let mut commands = Commands::new(device).unwrap();
    commands.begin().unwrap();
    let count = inputs.len() as u32;
    commands.dispatch(&layout, &pipeline, &count.to_le_bytes(), count.div_ceil(64));
    commands.barrier();
    commands.submit().unwrap();
    bytemuck::pod_collect_to_vec(&to.mapped().unwrap()[..inputs.len() * 32])
}

/// What the Rust twin of a probed function gives for a row of inputs.
fn twin(function: usize, i: &[f32; 16]) -> Vec<f32> {
    let v2 = |a: usize| [i[a], i[a + 1]];
    let v3 = |a: usize| vec3(i[a], i[a + 1], i[a + 2]);
    let flat = |parts: &[&[f32]]| parts.concat();
    let array = |v: Vector<f32>| Vec3::from(v).to_array();
    let wo: Vector<f32> = vec3(i[0] - 0.5, i[1] - 0.5, i[2] + 0.05).normalize().into();
    let eta = if i[10] < 0.5 { 1.5 } else { 1.0 / 1.5 };
    let bsdf = Bsdf { color: v3(6).into(), kind: (i[9] * 3.0) as u32, alpha: i[3] + 0.05, eta, albedo: 0.9 };
    match function {
        0 => {
            let [x, y] = [i[0], i[1]].map(|v| (v * 16_777_216.0) as u32);
            let seed = pixel_seed(x, y);
            flat(&[&random_pair(seed, x & 63, y).to_array(), &[(hash(seed) >> 8) as f32, (pascal(seed) >> 8) as f32]])
        }
        1 => flat(&[&sin_cos_turns((), i[0]), &array(spherical_direction((), 2.0 * i[1] - 1.0, i[2])), &array(sample_cosine((), v2(3)))]),
        2 => {
            let n = (v3(0) - Vec3::splat(0.5)).normalize().into();
            flat(&[&array(world_from_frame((), n, v3(3).into())), &array(frame_from_world((), n, v3(3).into()))])
        }
        3 => {
            let shift = |a: usize| (v3(a) - Vec3::splat(0.5)).to_array();
            let hit = intersect_triangle::<f32>((), v3(0).to_array(), shift(3), v3(6).to_array(), shift(9), shift(12), 10.0);
            if hit.mask { vec![1.0, hit.t, hit.u, hit.v] } else { vec![0.0; 4] }
        }
        4 => {
            let origin = v3(0) * 4.0 - Vec3::splat(2.0);
            let direction = v3(3) - Vec3::splat(0.5);
            let edges = [v3(9) - Vec3::splat(0.3), v3(12) - Vec3::splat(0.7)].map(Vector::from);
            let quad = intersect_quad((), origin.into(), direction.into(), v3(6).into(), edges[0], edges[1], 100.0);
            flat(&[&[intersect_sphere(origin, direction, v3(6), i[9] + 0.1, 100.0)], &array(quad)])
        }
        5 => {
            let world = world("");
            let table: Vec<f32> = (0..ALBEDO_SIZE * ALBEDO_SIZE).map(|i| i as f32 / (ALBEDO_SIZE * ALBEDO_SIZE) as f32).collect();
            let view = SceneView { albedo: &table, ..world.view() };
            let m = v3(5) + Vec3::splat(0.01);
            let lambda = ggx_lambda((), m.into(), i[8] + 0.001);
            let distribution = ggx_distribution((), m.normalize().into(), i[8] + 0.01);
            flat(&[
                &[fresnel_dielectric((), i[0], 0.4 + 2.0 * i[1])],
                &array(fresnel_schlick((), v3(2).into(), i[0])),
                &[lambda, distribution, ggx_albedo((), &view, i[9], i[10])],
            ])
        }
        6 => array(sample_visible_normal((), wo, i[3] + 0.01, v2(4))).to_vec(),
        7 => {
            let drawn = sample_bsdf((), &bsdf, wo, v2(4), i[11]);
            flat(&[&array(drawn.wi), &array(drawn.weight)])
        }
        8 => {
            let (value, pdf) = evaluate_bsdf((), &bsdf, wo, (v3(12) - Vec3::splat(0.5)).normalize().into());
            flat(&[&array(value), &[pdf]])
        }
        _ => {
            let v = fixed_from_float(i[0] * 2f32.powi((i[1] * 44.0) as i32 - 22));
            vec![((v as u32) >> 16) as f32, (v & 0xffff) as f32, (v >> 32) as f32]
        }
    }
}

fn kernel_functions_equal_their_twins() {
    let backend = vulkan();
    // Edge cases first, then pairs of the renderer's own sequence.
    let mut inputs = vec![[0.0f32; 16], [1.0 - f32::EPSILON; 16], [0.5; 16], [0.25; 16]];
    inputs.extend((0..4096u32).map(|n| {
        let mut row = [0.0; 16];
        for (k, pair) in row.chunks_exact_mut(2).enumerate() {
            pair.copy_from_slice(&random_pair(99, k as u32, n).to_array());
        }
        row
    }));
    // (function, largest difference relative to 1 + |value|, share of rows that may flip a branch)
    let tolerances = [
        (0, 0.0, 0.0),   // integers: to the bit
        (1, 5e-4, 0.0),  // sqrt(1 - cos^2) near the pole, where a fused product differs
        (2, 2e-6, 0.0),  // division by 1 + |n.z|
        (3, 2e-3, 2e-3), // division by a determinant that may be small; hits on an edge may flip
        (4, 2e-3, 2e-3), // as above
        (5, 2e-5, 0.0),  // quotients of near numbers in the Fresnel terms
        (6, 2e-5, 0.0),  // normalised sums
        (7, 2e-4, 2e-3), // total reflection may flip
        (8, 2e-3, 2e-3), // densities of narrow lobes
        (9, 0.0, 0.0),   // integers from exact powers of two
    ];
    for (function, tolerance, flips) in tolerances {
        let outputs = run_probe(&backend, function, &inputs);
        let mut wrong = 0;
        let mut worst: f32 = 0.0;
        for (input, output) in inputs.iter().zip(&outputs) {
            let expected = twin(function, input);
            let error = expected
                .iter()
                .zip(output)
                .map(|(e, o)| if e.is_nan() && o.is_nan() || e == o { 0.0 } else { (e - o).abs() / (1.0 + e.abs()) })
                .fold(0.0f32, |a, b| if b.is_nan() { f32::INFINITY } else { a.max(b) });
            if error > tolerance {
                wrong += 1;
            } else {
                worst = worst.max(error);
            }
        }
        println!("function {function}: largest difference {worst:.2e}, {wrong} of {} rows beyond {tolerance:e}", inputs.len());
        assert!(f64::from(wrong) <= flips * inputs.len() as f64, "function {function}: {wrong} rows differ");
    }
    // The comparison itself must be able to fail.
    let outputs = run_probe(&backend, 0, &inputs);
    assert!(outputs[7][..2] != twin(0, &inputs[8])[..2]);
}

fn reference_tables_f32() {
    let mut backend = vulkan();
    TABLES.iter().for_each(|t| t.check(&mut backend, Precision::F32));
}

fn reference_tables_f64() {
    let mut backend = vulkan();
    if backend.supports_f64() {
        TABLES.iter().for_each(|t| t.check(&mut backend, Precision::F64));
    }
}

fn thesis_rays() {
    let mut backend = vulkan();
    let literal = groeller_literal_error(&mut backend, Precision::F32);
    let limit = groeller_limit_error(&mut backend, Precision::F32, 1e-5);
    println!("f32: literal {literal:.2e}, limit {limit:.2e}");
    assert!(literal < 1e-3 && limit < 1e-3, "{literal:e} {limit:e}");
}

/// Both films of a world at `spp`, compared.
fn agree(backend: &mut VulkanBackend, name: &str, world: nullray::world::World, precision: Precision, spp: u32, thresholds: Thresholds) {
    let mut cpu = CpuBackend::new(None).unwrap();
    let gpu_film = film(backend, world.clone(), precision, spp);
    let cpu_film = film(&mut cpu, world, precision, spp);
    let difference = compare(&gpu_film, &cpu_film);
    println!("{name}: {difference:?}");
    assert!(thresholds.hold(&difference), "{name}: {difference:?}");
    assert_eq!(gpu_film.statistics.invalid, 0);
}

fn films_agree_on_every_scene() {
    let mut backend = vulkan();
    let mut names: Vec<_> =
        std::fs::read_dir(root().join("assets/scenes")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert!(names.len() >= 9);
    for name in names.iter().filter(|n| n.ends_with(".toml")) {
        let shallow = asset_world(name, &["film.width=96", "film.height=54", "film.max_depth=2"]);
        agree(&mut backend, name, shallow, Precision::F32, 1, Thresholds::SHALLOW);
        let deep = asset_world(name, &["film.width=64", "film.height=36"]);
        agree(&mut backend, name, deep, Precision::F32, 4, Thresholds::DEEP);
    }
}

fn films_agree_in_f64() {
    let mut backend = vulkan();
    if !backend.supports_f64() {
        return;
    }
    for name in ["singularity.toml", "dim-curved.toml"] {
        let world = asset_world(name, &["film.width=64", "film.height=36", "film.max_depth=2"]);
        agree(&mut backend, name, world, Precision::F64, 1, Thresholds::SHALLOW);
    }
}

/// Every method that runs from a tableau, and the symplectic one, with steps so coarse that each has errors of its own.
fn methods_agree() {
    let mut backend = vulkan();
    let mut cpu = CpuBackend::new(None).unwrap();
    let mut films = Vec::new();
    for method in ["euler", "rk4", "bogacki-shampine", "dormand-prince", "symplectic"] {
        let method_set = format!("integrator.method={method}");
        let coarse = ["integrator.step=3", "integrator.tolerance=1000"];
        let set = [&[method_set.as_str()], &coarse[..], &["film.width=64", "film.height=36", "film.max_depth=2"]].concat();
        agree(&mut backend, method, asset_world("kerr.toml", &set), Precision::F32, 1, Thresholds::SHALLOW);
        let own = film(&mut cpu, asset_world("kerr.toml", &set), Precision::F32, 1);
        for (other, film) in &films {
            let difference = compare(film, &own);
            assert!(!Thresholds::SHALLOW.hold(&difference), "{method} is not told from {other}: {difference:?}");
        }
        films.push((method, own));
    }
}

fn parts_merge_to_the_bit() {
    let world = || asset_world("singularity.toml", &["film.width=48", "film.height=27"]);
    let mut backend = vulkan();
    let whole = film(&mut backend, world(), Precision::F32, 6);
    let first = film(&mut backend, world(), Precision::F32, 2);
    backend.upload(Arc::new(world()), Precision::F32, 2).unwrap();
    backend.accumulate(0..27, 2..6).unwrap();
    let mut merged = backend.film().unwrap();
    merged.merge(&first).unwrap();
    assert!(merged == whole, "merged parts differ from one run");
}

fn power_law_and_lines_agree() {
    let base = "[camera]\nposition = [0, 1.5, -7]\n[film]\nwidth = 64\nheight = 36\nmax_depth = 2\n[environment]\nkind = \"grid\"\n\
                [[quad]]\ncorner = [-9, 0, -9]\nu = [0, 0, 18]\nv = [18, 0, 0]\n[spacetime]\nkind = \"gravity\"\n";
    let sources = "[[spacetime.center]]\nposition = [1, 1.5, 0]\nstrength = 0.2\nradius = 6\n\
                   [[spacetime.line]]\npoint = [-1, 0, 0]\ndirection = [0, 1, 0.2]\nstrength = -0.1\nradius = 5\nlength = 3\n";
    let mut backend = vulkan();
    for law in ["law = \"thesis\"\n", "law = \"power\"\nexponent = 2\n", "law = \"power\"\nexponent = 1.5\n", "form = \"literal\"\n"] {
        let mut text = format!("{base}{law}{sources}");
        if law.starts_with("form") {
            text = text.replace("strength = 0.2", "strength = 0.02").replace("strength = -0.1", "strength = -0.01");
        }
        for precision in [Precision::F32, Precision::F64] {
            if precision == Precision::F32 || backend.supports_f64() {
                agree(&mut backend, law.trim(), world(&text), precision, 1, Thresholds::SHALLOW);
            }
        }
    }
}

fn light_kinds_and_textures_agree() {
    let folder = std::env::temp_dir().join(format!("nullray-textures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let sky = image::Rgb32FImage::from_fn(64, 32, |x, y| {
        image::Rgb([0.2 + (x / 8 % 2) as f32, 0.3 + y as f32 / 40.0, if x == 20 && y == 8 { 80.0 } else { 0.4 }])
    });
    sky.save(folder.join("sky.exr")).unwrap();
    let colors = image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([(x * 16) as u8, (y * 16) as u8, 128]));
    colors.save(folder.join("colors.png")).unwrap();
    let text = "[camera]\nposition = [0, 1.5, -7]\naperture_radius = 0.05\n[film]\nwidth = 64\nheight = 36\n[environment]\nkind = \"image\"\nfile = \"sky.exr\"\nrotation_degrees = 30\n\
        [[material]]\nname = \"painted\"\nbase_color_texture = \"colors.png\"\n\
        [[material]]\nname = \"brushed\"\nkind = \"metallic\"\nbase_color = [0.9, 0.8, 0.7]\nroughness_texture = \"colors.png\"\n\
        [[material]]\nname = \"frosted\"\nkind = \"dielectric\"\nroughness = 0.4\nabsorption = [0.5, 0.1, 0.1]\n\
        [[material]]\nname = \"screen\"\nkind = \"emissive\"\nemission = [3, 3, 3]\nemission_texture = \"colors.png\"\ntwo_sided = false\n\
        [[quad]]\ncorner = [-9, 0, -9]\nu = [0, 0, 18]\nv = [18, 0, 0]\nmaterial = \"painted\"\n\
        [[quad]]\ncorner = [-1, 3, 1]\nu = [2, 0, 0]\nv = [0, 0, 1]\nmaterial = \"screen\"\n\
        [[sphere]]\ncenter = [-1.5, 1, 0]\nradius = 1\nmaterial = \"brushed\"\n[[sphere]]\ncenter = [1.5, 1, 0]\nradius = 1\nmaterial = \"frosted\"\n\
        [[box]]\nmin = [-0.3, 0, -2]\nmax = [0.3, 0.6, -1.4]\ntransform = { rotate_degrees = [0, 20, 0] }\nmaterial = \"painted\"\n";
    let scene = nullray::scene::parse_scene(&folder.join("test.toml"), text, &[]).unwrap();
    let world = nullray::world::World::compile(&scene).unwrap();
    assert_eq!(world.lights.len(), 2);
    agree(&mut vulkan(), "textures", world, Precision::F32, 4, Thresholds::DEEP);
    std::fs::remove_dir_all(&folder).unwrap();
}

fn films_develop_as_on_the_host() {
    const UNTOUCHED: [u8; 4] = [1, 2, 3, 4];
    let (mut gpu, mut cpu) = (vulkan(), CpuBackend::new(None).unwrap());
    let device = gpu.device().clone();
    let world = Arc::new(asset_world("singularity.toml", &["film.width=50", "film.height=30"]));
    let mut canvas = Canvas::new(&device, 50, 30, true).unwrap();
    let mut other_size = Canvas::new(&device, 30, 50, true).unwrap();
    // Largest difference of bytes: the device's functions are not the host's to the last digit.
    let backends: [(&mut dyn Backend, u8); 2] = [(&mut gpu, 1), (&mut cpu, 0)];
    for (backend, tolerance) in backends {
        backend.upload(world.clone(), Precision::F32, 0).unwrap();
        // Rows of two samples, of one, and of none.
        backend.accumulate(0..20, 0..1).unwrap();
        backend.accumulate(0..10, 1..2).unwrap();
        let film = backend.film().unwrap();
        assert_eq!([9, 10, 19, 20].map(|row| film.counts[row * 50]), [2, 1, 1, 0]);
        for channel in Channel::ALL {
            for tone_map in [ToneMap::None, ToneMap::Reinhard, ToneMap::Aces] {
                for columns in [0..u32::MAX, 13..37] {
                    let what = format!("{}, {channel:?}, {tone_map:?}, columns {columns:?}", backend.name());
                    let whole = columns.start == 0;
                    let development = Development { channel, exposure: 0.7, tone_map, columns };
                    let mut expected = vec![UNTOUCHED; film.sums.len()];
                    film.develop(&development, &mut expected);
                    canvas.pixels_mut().unwrap().fill(UNTOUCHED);
                    backend.develop(&development, &mut canvas).unwrap();
                    let pixels = canvas.pixels_mut().unwrap();
                    let differences = pixels.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| a.abs_diff(*b));
                    let worst = differences.max().unwrap();
                    assert!(worst <= tolerance, "{what}: {worst}/255");
                    // Untouched outside the columns; inside black without samples and of several colours with them.
                    assert!((0..50).all(|x| (pixels[x] == UNTOUCHED) != (whole || (13..37).contains(&x))), "{what}: other columns");
                    assert_eq!(pixels[25 * 50 + 20], [0, 0, 0, 255], "{what}");
                    let colors: BTreeSet<[u8; 4]> = pixels[..20 * 50].iter().copied().collect();
                    assert!(colors.len() > 2, "{what}: {} colours", colors.len());
                    assert!(backend.develop(&development, &mut other_size).is_err(), "{what}: another size");
                }
            }
        }
    }
}

fn a_moved_camera_needs_no_new_world() {
    new_parameters_are_as_good_as_a_new_world(&mut vulkan());
}
