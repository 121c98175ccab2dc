//! The list of lights directions are sampled towards, and the table the environment is sampled from.

use super::World;
use super::bvh::{box_corners, primitive_bounds};
use crate::kernels::constants::*;
use crate::kernels::layout::Light;
use crate::scene::{Environment, Geometry, Scene, Shape};
use crate::spacetime::thermal::black_body;
use glam::Vec3;

/// Most columns and rows of the environment's table.
const MAX_COLUMNS: u32 = 1024;
/// Faces of a box: origin corner and the corners at the ends of its two edges.
const BOX_FACES: [[usize; 3]; 6] = [[0, 2, 4], [1, 3, 5], [0, 1, 4], [2, 3, 6], [0, 1, 2], [4, 5, 6]];

fn luminance(c: [f32; 3]) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

fn flat_light(kind: u32, position: Vec3, edge_u: Vec3, edge_v: Vec3) -> Light {
    let parallelogram = edge_u.cross(edge_v).length();
    Light {
        position: position.into(),
        kind,
        edge_u: edge_u.into(),
        size: if kind == LIGHT_TRIANGLE { 0.5 * parallelogram } else { parallelogram },
        edge_v: edge_v.into(),
        cumulative: 0.0,
    }
}

/// Collects every emitting shape and the environment image; a light is chosen in proportion to its power.
pub(super) fn add(world: &mut World, scene: &Scene) {
    let mut lights: Vec<(Light, f32)> = Vec::new();
    for (object, shape) in scene.shapes.iter().enumerate() {
        let material = &scene.materials[shape.material];
        // Discs shine over a range of temperatures and of frequency: aiming at them would not pay.
        let thermal = if material.temperature > 0.0 { black_body(f64::from(material.temperature)).map(|c| c as f32) } else { [1.0; 3] };
        let brightness = luminance(material.emission) * luminance(thermal);
        if brightness <= 0.0 {
            continue;
        }
        let mut push = |light: Light, area: f32| {
            if area > 0.0 && area.is_finite() {
                lights.push((light, brightness * area));
            }
        };
        match &shape.geometry {
            Geometry::Sphere { center, radius } => {
                let r = *radius as f32;
                let zero = [0.0; 3];
                push(
                    Light { position: center.as_vec3().into(), kind: LIGHT_SPHERE, edge_u: zero, size: r, edge_v: zero, cumulative: 0.0 },
                    4.0 * PI * r * r,
                );
            }
            Geometry::Quad { corner, u, v } => {
                let light = flat_light(LIGHT_QUAD, corner.as_vec3(), u.as_vec3(), v.as_vec3());
                push(light, light.size);
            }
            Geometry::Box { .. } => {
                for primitive in world.primitives.iter().filter(|p| p.object == object as u32) {
                    let c = box_corners(primitive);
                    for [origin, u, v] in BOX_FACES {
                        let light = flat_light(LIGHT_QUAD, c[origin], c[u] - c[origin], c[v] - c[origin]);
                        push(light, light.size);
                    }
                }
            }
            // Directions towards a disc are left to the surface's own lobes.
            Geometry::Disc { .. } | Geometry::AccretionDisc(_) => {}
            Geometry::Mesh(mesh) => {
                for t in &mesh.indices {
                    let [a, b, c] = t.map(|i| Vec3::from(mesh.positions[i as usize]));
                    let light = flat_light(LIGHT_TRIANGLE, a, b - a, c - a);
                    push(light, light.size);
                }
            }
        }
    }
    if let Environment::Image { image, scale, .. } = &scene.environment[0].environment {
        let mean = environment_table(world, scene, *image);
        let extent =
            world.primitives.iter().map(primitive_bounds).fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let radius = if extent.0.x <= extent.1.x { 0.5 * (extent.1 - extent.0).length() } else { 1.0 };
        let power = mean * scale * 4.0 * PI * radius.min(100.0).powi(2);
        if power > 0.0 {
            // The environment surrounds everything: half of all choices when there are other lights.
            let others: f32 = lights.iter().map(|(_, p)| p).sum();
            let weight = if others > 0.0 { others.max(power.min(others)) } else { 1.0 };
            lights.push((Light { kind: LIGHT_ENVIRONMENT, ..bytemuck::Zeroable::zeroed() }, weight));
        } else {
            let sky = &mut world.scene.environment[0];
            (sky.columns, sky.rows) = (0, 0);
        }
    }
    let total: f64 = lights.iter().map(|(_, p)| f64::from(*p)).sum();
    let mut sum = 0.0;
    for (light, power) in &mut lights {
        sum += f64::from(*power);
        light.cumulative = (sum / total) as f32;
    }
    if let Some((last, _)) = lights.last_mut() {
        last.cumulative = 1.0;
    }
    world.lights = lights.into_iter().map(|(l, _)| l).collect();
    world.scene.light_count = world.lights.len() as u32;
    let sky_is_black = world
        .scene
        .environment
        .iter()
        .all(|sky| sky.kind != ENVIRONMENT_IMAGE && [sky.color, sky.horizon, sky.nadir].iter().all(|c| luminance(*c) == 0.0));
    let textured_emission = scene.materials.iter().any(|m| m.textures[2].is_some() && luminance(m.emission) > 0.0);
    let shines = |s: &Shape| luminance(scene.materials[s.material].emission) > 0.0;
    let discs = scene.shapes.iter().any(|s| matches!(s.geometry, Geometry::Disc { .. } | Geometry::AccretionDisc(_)) && shines(s));
    world.dark = world.lights.is_empty() && sky_is_black && !textured_emission && !discs;
}

/// Builds the cumulative table (rows, then the columns of each row) from brightness times solid angle; returns the mean radiance.
fn environment_table(world: &mut World, scene: &Scene, image: usize) -> f32 {
    let image = &scene.images[image];
    let columns = image.width.min(MAX_COLUMNS);
    let rows = image.height.min(MAX_COLUMNS / 2);
    let mut weights = vec![0.0f64; (columns * rows) as usize];
    let mut solid_angles = 0.0;
    for y in 0..image.height {
        let polar = (f64::from(y) + 0.5) / f64::from(image.height) * std::f64::consts::PI;
        let row = y * rows / image.height;
        for x in 0..image.width {
            let column = x * columns / image.width;
            weights[(row * columns + column) as usize] += f64::from(luminance(image.rgb(x, y)).max(0.0)) * polar.sin();
            solid_angles += polar.sin();
        }
    }
    let total: f64 = weights.iter().sum();
    world.scene.environment[0].columns = columns;
    world.scene.environment[0].rows = rows;
    world.environment_cdf = vec![0.0; (rows + rows * columns) as usize];
    if total <= 0.0 {
        return 0.0;
    }
    let mut sum = 0.0;
    for row in 0..rows as usize {
        let of_row = &weights[row * columns as usize..(row + 1) * columns as usize];
        let row_total: f64 = of_row.iter().sum();
        sum += row_total;
        world.environment_cdf[row] = (sum / total) as f32;
        let mut row_sum = 0.0;
        for (column, weight) in of_row.iter().enumerate() {
            row_sum += weight;
            let share = if row_total > 0.0 { row_sum / row_total } else { (column + 1) as f64 / f64::from(columns) };
            world.environment_cdf[rows as usize + row * columns as usize + column] = share as f32;
        }
        world.environment_cdf[rows as usize + (row + 1) * columns as usize - 1] = 1.0;
    }
    world.environment_cdf[rows as usize - 1] = 1.0;
    (total / solid_angles) as f32
}
