//! What no single file can promise: twins have the same functions, structures the same layout, modules their place.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::vulkan::pipeline::kernel_spirv;
use nullray::kernels::layout::*;
use std::collections::{BTreeMap, BTreeSet};
use std::mem::offset_of;
use support::root;

/// Names of the functions a file defines at its top level.
fn functions(text: &str, glsl: bool) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for line in text.lines() {
        let line = if glsl { line } else { line.trim_start_matches("pub ").trim_start_matches("pub(super) ") };
        let name = if glsl {
            let Some((head, _)) = line.split_once('(') else { continue };
            if line.starts_with([' ', '#', '/', '}']) || !line.ends_with('{') {
                continue;
            }
            head.split_whitespace().last()
        } else {
            line.strip_prefix("fn ").and_then(|l| l.split(['(', '<']).next())
        };
        names.extend(name.map(str::to_owned));
    }
    names
}

#[test]
fn twins_have_the_same_functions() {
    // (stem, functions that one language alone needs)
    let twins: [(&str, &[&str]); 16] = [
        // A pair per lane.
        ("rng", &["random_pairs"]),
        ("sampling", &[]),
        ("camera", &[]),
        ("texture", &[]),
        // Built into GLSL, but not for four vectors at once.
        ("triangle", &["dot", "cross", "lanes", "lanes_dot", "lanes_cross"]),
        ("primitive", &[]),
        ("curve", &[]),
        // Lanes ask the root first; what is under way at once on the CPU is in traverser.rs, GLSL follows one segment.
        ("bvh", &["enter_root", "nearest", "closest_hit", "stack_entry", "entry_start", "entry_end", "order_entries", "sort_entries"]),
        // Built into GLSL as `length`.
        ("clearance", &["grid_length"]),
        // The first two are constructors in GLSL. The others keep stages out of memory there.
        ("integrator", &["to_vec3", "from_vec3", "tableau", "take_stage"]),
        // Lanes choose different lights.
        ("light", &["sample_lights"]),
        // The table is computed by the host.
        ("material", &["integrate_ggx_albedo"]),
        ("surface", &[]),
        ("table", &[]),
        // AOVs are stored by state.glsl.
        ("path", &["hit_aov", "miss_aov"]),
        // Shaders get exposure and tone curve as numbers, and pack bytes by a function of their own.
        ("develop", &["gain", "tone_number", "byte"]),
    ];
    for (stem, own) in twins {
        let read = |path: String| std::fs::read_to_string(root().join(&path)).unwrap_or_else(|e| panic!("{path}: {e}"));
        // Films are also developed without a backend.
        let folder = if stem == "develop" { "film" } else { "kernels" };
        let rust = functions(&read(format!("src/{folder}/{stem}.rs")), false);
        let glsl = functions(&read(format!("shaders/{stem}.glsl")), true);
        assert!(!glsl.is_empty(), "{stem}: no functions found");
        let own: BTreeSet<String> = own.iter().map(|s| s.to_string()).collect();
        let different: Vec<_> = rust.symmetric_difference(&glsl).filter(|f| !own.contains(*f)).collect();
        assert!(different.is_empty(), "{stem}: only one of the twins has {different:?}");
    }
}

#[test]
fn modules_keep_their_place() {
    // (folder, words its files must not contain)
    let rules: [(&str, &[&str]); 8] = [
        ("src/kernels", &["ash::", "std::fs", "std::thread", "rayon"]),
        ("src/spacetime", &["crate::backend", "crate::world", "crate::scene", "ash::"]),
        ("src/scene", &["ash::", "crate::backend", "crate::world"]),
        ("src/world", &["ash::", "crate::backend"]),
        ("src/backend/cpu", &["ash::"]),
        ("src/film", &["crate::backend", "crate::world", "ash::"]),
        ("src/scheduler.rs", &["ash::", "backend::cpu", "backend::vulkan"]),
        ("src/viewer", &["ash::", "crate::cli"]),
    ];
    for (folder, words) in rules {
        let mut todo = vec![root().join(folder)];
        while let Some(path) = todo.pop() {
            if path.is_dir() {
                todo.extend(std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for word in words {
                assert!(!text.contains(word), "{} contains {word}", path.display());
            }
        }
    }
}

/// Structures of a SPIR-V module: name to (member name, byte offset) in order, and strides of arrays of them.
struct Reflection {
    members: BTreeMap<String, Vec<(String, u32)>>,
    strides: BTreeMap<String, u32>,
}

fn reflect(kernel: &str) -> Reflection {
    let bytes = kernel_spirv(kernel).unwrap_or_else(|| panic!("no kernel {kernel}"));
    let words: Vec<u32> = bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    let text = |words: &[u32]| {
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).take_while(|&b| b != 0).collect();
        String::from_utf8(bytes).unwrap()
    };
    let mut names = BTreeMap::new();
    let mut member_names = BTreeMap::new();
    let mut offsets = BTreeMap::new();
    let mut array_strides = BTreeMap::new();
    let mut elements = BTreeMap::new();
    let mut at = 5;
    while at < words.len() {
        let (length, opcode) = ((words[at] >> 16) as usize, words[at] & 0xffff);
        let w = &words[at + 1..at + length];
        match opcode {
            5 => drop(names.insert(w[0], text(&w[1..]))),
            6 => drop(member_names.insert((w[0], w[1]), text(&w[2..]))),
            // OpDecorate ArrayStride, OpMemberDecorate Offset
            71 if w[1] == 6 => drop(array_strides.insert(w[0], w[2])),
            72 if w[2] == 35 => drop(offsets.insert((w[0], w[1]), w[3])),
            // OpTypeArray, OpTypeRuntimeArray
            28 | 29 => drop(elements.insert(w[0], w[1])),
            _ => {}
        }
        at += length;
    }
    let mut reflection = Reflection { members: BTreeMap::new(), strides: BTreeMap::new() };
    for ((id, member), offset) in &offsets {
        let list = reflection.members.entry(names[id].clone()).or_default();
        list.push((member_names[&(*id, *member)].clone(), *offset));
    }
    for (array, element) in &elements {
        if let (Some(name), Some(stride)) = (names.get(element), array_strides.get(array)) {
            reflection.strides.insert(name.clone(), *stride);
        }
    }
    reflection
}

macro_rules! check_layout {
    ($kernel:literal, $name:literal, $type:ident { $($field:ident),+ }) => {
        let reflection = reflect($kernel);
        let expected: Vec<(String, u32)> = vec![$((stringify!($field).to_string(), offset_of!($type, $field) as u32)),+];
        assert_eq!(reflection.members.get($name), Some(&expected), "{}", $name);
        if let Some(stride) = reflection.strides.get($name) {
            assert_eq!(*stride as usize, size_of::<$type>(), "stride of {}", $name);
        }
    };
}

/// Members of a structure of `layout.glsl` with the offsets they have without padding.
fn members_in_words(name: &str) -> Vec<(String, u32)> {
    let text = std::fs::read_to_string(root().join("shaders/layout.glsl")).unwrap();
    let body = text.split(&format!("struct {name} {{\n")).nth(1).unwrap().split('}').next().unwrap();
    let mut at = 0;
    let member = |line: &str| {
        let (kind, member) = line.trim().trim_end_matches(';').split_once(' ').unwrap();
        let (member, count) = member.trim_end_matches(']').split_once('[').unwrap_or((member, "1"));
        let each = match kind {
            "float" | "uint" => 1,
            "vec3" => 3,
            other => panic!("{name}: a member of type {other}"),
        };
        let numbers = each * count.parse::<u32>().unwrap();
        at += 4 * numbers;
        (member.to_owned(), at - 4 * numbers)
    };
    body.lines().map(member).collect()
}

macro_rules! check_words {
    ($name:literal, $type:ident { $($field:ident),+ }) => {
        let expected: Vec<(String, u32)> = vec![$((stringify!($field).to_string(), offset_of!($type, $field) as u32)),+];
        assert_eq!(members_in_words($name), expected, "{}", $name);
    };
}

#[test]
fn structures_have_the_layout_of_the_shaders() {
    check_words!("Triangle", Triangle { vertices, object });
    check_words!("Vertex", Vertex { normal, uv });
    check_words!("Primitive", Primitive { data, kind, object });
    check_words!(
        "Material",
        Material {
            base_color,
            kind,
            emission,
            roughness,
            absorption,
            ior,
            base_texture,
            roughness_texture,
            emission_texture,
            flags,
            temperature,
            profile,
            inner_radius,
            outer_radius
        }
    );
    check_words!("Light", Light { position, kind, edge_u, size, edge_v, cumulative });
    check_layout!("shade", "Texture", Texture { first_index, width, height });
    check_layout!("shade", "Aov", Aov { albedo, redshift, normal, distance, position, constraint_error, object, status, steps, chords });
    check_layout!(
        "shade",
        "EnvironmentParameters",
        EnvironmentParameters { color, kind, horizon, scale, nadir, angle, texture_index, columns, rows, temperature }
    );
    check_layout!(
        "shade",
        "SceneParameters",
        SceneParameters {
            camera_position,
            tan_half_fov,
            camera_right,
            aspect,
            camera_up,
            aperture_radius,
            camera_forward,
            focus_distance,
            camera_velocity,
            far_root,
            environment,
            region_center,
            region_radius,
            grid_focus,
            grid_inverse_cell,
            grid_size,
            region_strength,
            bounds_low,
            camera_kind,
            bounds_high,
            filter_kind,
            grid_focus_cell,
            film_width,
            grid_reach_low,
            film_height,
            grid_reach_high,
            pixel_spread,
            aim_focus,
            aim_scale,
            cone_width,
            origin_offset,
            tolerance,
            chord_tolerance,
            max_steps,
            method,
            literal_kick,
            max_depth,
            light_count,
            region_sharp,
            local_frames,
            light_share
        }
    );
}
