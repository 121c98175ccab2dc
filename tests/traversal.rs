//! Closest hits by the BVH: on every instruction set, one at a time and many at once, from the root and from below it.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

#[path = "../benches/support/displaced.rs"]
#[allow(dead_code, reason = "benches use the rest")]
mod displaced;

use displaced::{Detail, displaced_mesh, displaced_scene, primary_rays};
use fearless_simd::{Level, Simd};
use glam::{Vec3, vec3};
use nullray::kernels::bvh::{Hit, RootSpans, enter_root, slabs};
use nullray::kernels::constants::{CHORD_SLACK, FAR, NO_INDEX};
use nullray::kernels::curve::{Curve, curve_point, cut_span, hermite, whole_chord};
use nullray::kernels::primitive::intersect_primitive;
use nullray::kernels::rng::random_pair;
use nullray::kernels::traverser::{Query, Traverser};
use nullray::kernels::triangle::intersect_triangle;
use nullray::kernels::view::SceneView;
use nullray::scene::parse_scene;
use nullray::world::World;
use std::path::Path;
use std::sync::{Arc, LazyLock};

/// A hundred thousand triangles: more nodes than are small enough not to be asked for ahead.
static WORLD: LazyLock<World> = LazyLock::new(|| {
    let mesh = Arc::new(displaced_mesh(Detail { subdivisions: 5, ground_cells: 64 }));
    World::compile(&displaced_scene(&mesh, "")).unwrap()
});

/// Random numbers from -1 to 1.
fn random(kind: u32, k: u32) -> Vec3 {
    let (a, b) = (random_pair(11, 2 * kind, k), random_pair(11, 2 * kind + 1, k));
    2.0 * vec3(a.x, a.y, b.x) - 1.0
}

/// Straight rays: those of a camera, and as many from all over the scene.
fn straight_queries(view: &SceneView) -> Vec<Query> {
    let root = view.scene_root(0);
    let camera = primary_rays().into_iter().step_by(10).map(|ray| Query::straight(ray.origin, ray.direction, root));
    let others = (0..12_000).map(|k| Query::straight(random(0, k) * vec3(10.0, 3.0, 10.0), random(1, k).normalize(), root));
    camera.chain(others).collect()
}

/// Curved steps all over the scene, of up to a fifth of its extent, in few pieces and in many.
fn curved_queries(view: &SceneView) -> Vec<Query> {
    let step = |k: u32| {
        let (start, chord) = (random(2, k) * vec3(10.0, 3.0, 10.0), random(3, k) * 4.0);
        let tolerance: f32 = [1e-3, 1e-2, 1e-1, 1.0][k as usize % 4];
        let bend = random(4, k).cross(chord) * 0.5;
        let whole = hermite((), start.into(), (start + chord).into(), (chord + bend).into(), (chord - bend).into());
        let curve = cut_span((), &whole, 0.0, 1.0, tolerance);
        Query { curve, slabs: slabs((), &curve), child: view.scene_root(0), span: (0.0, 1.0), t_max: 1.0 }
    };
    (0..12_000).map(step).collect()
}

/// Closest hits, `at_once` of the queries by one call.
fn closest_hits<S: Simd>(simd: S, queries: &[Query], at_once: usize) -> Vec<Hit> {
    let view = WORLD.view();
    let mut hits = vec![Hit::none(0.0); queries.len()];
    let mut traverser = Traverser::new();
    for (some, hits) in queries.chunks(at_once).zip(hits.chunks_mut(at_once)) {
        simd.vectorize(|| traverser.closest_hits(simd, &view, some.iter().copied().enumerate(), |i, _, hit| hits[i] = hit));
    }
    hits
}

/// The hits as bits.
fn bits(hits: &[Hit]) -> Vec<[u32; 4]> {
    hits.iter().map(|h| [h.t.to_bits(), h.primitive, h.u.to_bits(), h.v.to_bits()]).collect()
}

/// Share of the queries that hit in one list only, or further along than 1e-4 of the way.
fn difference(a: &[Hit], b: &[Hit]) -> f64 {
    let apart = |(a, b): &(&Hit, &Hit)| {
        let both = a.primitive != NO_INDEX && b.primitive != NO_INDEX;
        (a.primitive == NO_INDEX) != (b.primitive == NO_INDEX) || both && (a.t - b.t).abs() > 1e-4 * a.t.max(b.t)
    };
    a.iter().zip(b).filter(apart).count() as f64 / a.len() as f64
}

/// What is found for a segment does not depend on those that are under way beside it, and hardly on the instruction set.
fn check<S: Simd>(simd: S) {
    let view = WORLD.view();
    for queries in [straight_queries(&view), curved_queries(&view)] {
        let alone = closest_hits(simd, &queries, 1);
        for at_once in [5, 33, queries.len()] {
            assert!(bits(&alone) == bits(&closest_hits(simd, &queries, at_once)), "{at_once} at once");
        }
        let widest = nullray::dispatch!(Level::new(), simd => closest_hits(simd, &queries, queries.len()));
        let (apart, hits) = (difference(&alone, &widest), alone.iter().filter(|h| h.primitive != NO_INDEX).count());
        println!("{}: {hits} of {} hit, {apart:.5} elsewhere", std::any::type_name::<S>(), queries.len());
        assert!(apart < 5e-4, "{apart} of the queries hit elsewhere");
        assert!(hits > queries.len() / 10, "{hits} of {}", queries.len());
    }
}

#[test]
#[cfg(target_arch = "x86_64")]
fn segments_do_not_see_one_another() {
    let level = Level::new();
    check(level.as_sse2().unwrap());
    if let Some(simd) = level.as_avx2() {
        check(simd);
    }
    if let Some(simd) = level.as_avx512() {
        check(simd);
    }
}

/// Steps that meet a single child of the root hit below it what they hit from the root; those that meet none hit nothing.
#[test]
fn the_root_is_left_out() {
    let view = WORLD.view();
    let queries = curved_queries(&view);
    let search = |queries: &[Query]| nullray::dispatch!(Level::new(), simd => closest_hits(simd, queries, queries.len()));
    let from_root = search(&queries);
    let mut spans: Box<RootSpans<f32>> = bytemuck::zeroed_box();
    let (mut below, mut expected, mut none) = (vec![], vec![], 0);
    for (query, &hit) in queries.iter().zip(&from_root) {
        if enter_root::<f32>((), &view, &query.slabs, &mut spans) & 1 == 0 {
            assert_eq!(hit.primitive, NO_INDEX, "a hit outside of all children");
            none += 1;
        } else if let Some((child, span)) = spans.single_child(&view, 0) {
            below.push(Query { child, span, ..*query });
            expected.push(hit);
        }
    }
    let apart = difference(&search(&below), &expected);
    println!("{none} of {} meet no child, {} one, of which {apart:.5} hit elsewhere", queries.len(), below.len());
    assert!(none > 500 && below.len() > 500, "{none} {}", below.len());
    assert!(apart < 5e-4, "{apart}");
}

/// Where the chords of a curve hit first if everything is tested; `FAR` for nowhere.
fn first_of_all(view: &SceneView, curve: &Curve<f32>) -> f32 {
    let count = curve.chords;
    let mut first = FAR;
    for j in 0..count as u32 {
        let at = |j: u32| Vec3::from(curve_point(curve, j as f32 / count));
        // Pieces reach a little into one another.
        let (from, chord, end) =
            if count == 1.0 { (at(j), whole_chord(curve).into(), 1.0) } else { (at(j), at(j + 1) - at(j), 1.0 + CHORD_SLACK) };
        let mut meet = |t: f32| first = first.min((j as f32 + t) / count);
        for block in view.blocks {
            for lane in 0..8 {
                let row = |v: &[[f32; 8]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let (vertex, edge1, edge2) = (row(&block.vertex), row(&block.edge1), row(&block.edge2));
                let met = intersect_triangle::<f32>((), from.into(), chord.into(), vertex, edge1, edge2, end);
                if met.mask {
                    meet(met.t);
                }
            }
        }
        for primitive in view.primitives {
            let met = intersect_primitive(primitive, from, chord, end);
            if met.x > 0.0 {
                meet(met.x);
            }
        }
    }
    first
}

/// Fails if a curve is not found to hit where its chords do; returns how many hit.
fn check_curves(view: &SceneView, queries: &[Query]) -> usize {
    let (mut hits, mut traverser) = (vec![Hit::none(0.0); queries.len()], Traverser::new());
    let numbered = queries.iter().copied().enumerate();
    nullray::dispatch!(Level::new(), simd => traverser.closest_hits(simd, view, numbered, |i, _, hit| hits[i] = hit));
    for (k, (query, hit)) in queries.iter().zip(&hits).enumerate() {
        let first = first_of_all(view, &query.curve);
        // What is at the very end is the next step's.
        let same = if hit.primitive == NO_INDEX { first > 1.0 - CHORD_SLACK } else { (hit.t - first).abs() < 1e-3 };
        assert!(same, "curve {k} of {} chords: {} against {first}", query.curve.chords, hit.t);
    }
    hits.iter().filter(|hit| hit.primitive != NO_INDEX).count()
}

/// Curved steps hit what their chords hit if every triangle is tested.
#[test]
fn curves_hit_what_their_chords_hit() {
    let view = WORLD.view();
    let found = check_curves(&view, &curved_queries(&view)[..400]);
    assert!(found > 30, "{found}");
}

/// Curved steps hit squares in the planes of the axes, whose boxes have no thickness.
#[test]
fn flat_boxes_are_met() {
    let mut text = String::from("[[material]]\nname = \"m\"\n");
    for k in 0..300 {
        let (corner, axis) = ((random(9, k) * vec3(10.0, 3.0, 10.0)).round(), k as usize % 3);
        let (u, v) = (Vec3::AXES[axis], Vec3::AXES[(axis + 1) % 3]);
        text += &format!("[[quad]]\nmaterial = \"m\"\ncorner = {:?}\nu = {:?}\nv = {:?}\n", corner.to_array(), u.to_array(), v.to_array());
    }
    let world = World::compile(&parse_scene(Path::new("squares"), &text, &[]).unwrap()).unwrap();
    let view = world.view();
    let found = check_curves(&view, &curved_queries(&view));
    assert!(found > 300, "{found}");
    // Arcs from corner to corner of a lattice, whose pieces end in these planes.
    let arc = |k: u32| {
        let (start, chord) = ((random(10, k) * vec3(10.0, 3.0, 10.0)).round(), (random(11, k) * 2.0).round() * 2.0);
        let bend = Vec3::AXES[k as usize % 3] * [0.02, 0.1, 0.5][(k / 3) as usize % 3];
        let whole = hermite((), start.into(), (start + chord).into(), (chord + bend).into(), (chord - bend).into());
        let curve = cut_span((), &whole, 0.0, 1.0, [1e-3, 1e-2, 1e-1f32][(k / 9) as usize % 3]);
        Query { curve, slabs: slabs((), &curve), child: view.scene_root(0), span: (0.0, 1.0), t_max: 1.0 }
    };
    let found = check_curves(&view, &(0..12_000).map(arc).collect::<Vec<_>>());
    assert!(found > 300, "{found}");
}

/// More than four children of a node are met where all overlap.
#[test]
fn many_children_are_met_at_once() {
    let mut text = String::from("[[material]]\nname = \"m\"\n");
    for k in 0..200 {
        let (center, radius) = (random(5, k).to_array(), 0.5 + 0.4 * random(6, k).x);
        text += &format!("[[sphere]]\nmaterial = \"m\"\ncenter = {center:?}\nradius = {radius}\n");
    }
    let world = World::compile(&parse_scene(Path::new("spheres"), &text, &[]).unwrap()).unwrap();
    let view = world.view();
    let rays: Vec<(Vec3, Vec3)> = (0..3000).map(|k| (random(7, k) * 2.0, random(8, k).normalize())).collect();
    let queries = rays.iter().map(|&(origin, direction)| Query::straight(origin, direction, view.scene_root(0))).enumerate();
    let (mut hits, mut traverser) = (vec![Hit::none(0.0); rays.len()], Traverser::new());
    nullray::dispatch!(Level::new(), simd => traverser.closest_hits(simd, &view, queries, |i, _, hit| hits[i] = hit));
    for (k, (&(origin, direction), hit)) in rays.iter().zip(&hits).enumerate() {
        let nearest = |best: f32, primitive| match intersect_primitive(primitive, origin, direction, best).x {
            t if t > 0.0 => t,
            _ => best,
        };
        let best = world.primitives.iter().fold(FAR, nearest);
        assert!(hit.t == best, "ray {k}: {} against {best}", hit.t);
    }
    let nodes = traverser.work.nodes as f64 / rays.len() as f64;
    assert!(nodes > 5.0, "only {nodes} nodes per ray");
}
