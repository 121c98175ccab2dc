//! What the parts of the CPU backend cost, each on its own: loading scenes, building worlds, traversal by straight and by bent rays,
//! integration where there is nothing to meet.
//!
//! Rates are items per second: triangles of `build` and of a mesh that is loaded, rays of `traversal`, steps of `integration`, rejected
//! ones included. A run without a filter, or with the filter `peak`, ends in a table: what share of a core's multiply-adds integration
//! keeps busy. That peak is measured, on the registers that hold rays; the operations of a step are counted by taking one with numbers
//! that count. Of the two rates there, one is that of the integration kernel alone, the other that of rays from launch to landing, with
//! judging of steps, clearance grid and refilled lanes, whose operations are not counted.
#![allow(clippy::expect_used, reason = "a benchmark stops where it cannot go on")]

#[path = "support/displaced.rs"]
mod displaced;

use bytemuck::{Pod, Zeroable};
use displaced::{Detail, FULL, Ray, closest_hits, diffuse_rays, displaced_mesh, displaced_scene, primary_rays};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box, black_box_drop};
use fearless_simd::{Level, Simd};
use glam::{Vec3, vec2};
use nullray::backend::Stop;
use nullray::backend::cpu::advance::{Launch, advance_curved};
use nullray::backend::cpu::lanes::Lanes;
use nullray::backend::cpu::step::{Course, ModelKernels, Scalar};
use nullray::dispatch;
use nullray::kernels::bvh::Hit;
use nullray::kernels::camera::film_direction;
use nullray::kernels::constants::{DIFFUSE_SPREAD, FAR, METHOD_NYSTROM};
use nullray::kernels::integrator::{Charge, Model, ModelBlock, nystrom_step, rate_at, runge_kutta_step};
use nullray::kernels::layout::SceneParameters;
use nullray::kernels::surface::Arrival;
use nullray::kernels::traverser::Traverser;
use nullray::kernels::work::Work;
use nullray::scene::mesh::Mesh;
use nullray::scene::{load_scene, parse_scene};
use nullray::simd::{Lane, MAX_LANES, Real};
use nullray::spacetime::{KerrNewman, Schwarzschild, ThesisGravity};
use nullray::world::World;
use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use std::time::Instant;

/// Most seconds for one benchmark.
const SECONDS: f64 = 5.0;
/// The filter that asks for the table alone.
const PEAK: &str = "peak";

fn main() {
    divan::main();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let measuring = arguments.iter().any(|a| a == "--bench");
    if measuring && arguments.iter().all(|a| a == "--bench" || a == PEAK) {
        print_shares();
    }
}

// Scenes.

/// About 100,000 triangles.
const MEDIUM: Detail = Detail { subdivisions: 4, ground_cells: 186 };
/// About 1,000 to 524,288 triangles.
const DETAILS: [Detail; 4] = [Detail { subdivisions: 1, ground_cells: 16 }, Detail { subdivisions: 3, ground_cells: 34 }, MEDIUM, FULL];

/// The world of a mesh: its BVH, and what is copied.
#[divan::bench(args = DETAILS, max_time = SECONDS)]
fn build(bencher: Bencher, detail: Detail) {
    let mesh = Arc::new(displaced_mesh(detail));
    let scene = displaced_scene(&mesh, "");
    let compile = || World::compile(&scene).expect("the mesh fits");
    // The first world computes tables that all share.
    black_box_drop(compile());
    bencher.counter(ItemsCount::new(mesh.indices.len())).bench_local(compile);
}

mod load {
    use super::*;

    #[divan::bench(max_time = SECONDS)]
    fn built_in(bencher: Bencher) {
        bencher.bench_local(|| load_scene(None, &[]).expect("the built-in scene is valid"));
    }

    #[divan::bench(max_time = SECONDS)]
    fn benchmark(bencher: Bencher) {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/scenes/benchmark.toml"));
        bencher.bench_local(|| load_scene(Some(path), &[]).expect("the benchmark scene is valid"));
    }

    #[divan::bench(max_time = SECONDS)]
    fn mesh(bencher: Bencher) {
        let mesh = displaced_mesh(MEDIUM);
        let folder = MeshFolder::holding(&mesh);
        let path = folder.0.join("scene.toml");
        bencher.counter(ItemsCount::new(mesh.indices.len())).bench_local(|| load_scene(Some(&path), &[]).expect("the mesh is valid"));
    }
}

/// A temporary folder with an OBJ file and a scene of it.
struct MeshFolder(PathBuf);

impl MeshFolder {
    fn holding(mesh: &Mesh) -> MeshFolder {
        let folder = MeshFolder(std::env::temp_dir().join(format!("nullray-parts-{}", std::process::id())));
        let vertices = mesh.positions.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
        let faces = mesh.indices.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        let mesh_text: String = vertices.chain(faces).collect();
        std::fs::create_dir_all(&folder.0).expect("a temporary folder can be made");
        for (name, text) in [("mesh.obj", mesh_text.as_str()), ("scene.toml", "[[mesh]]\nfile = \"mesh.obj\"\n")] {
            std::fs::write(folder.0.join(name), text).expect("a temporary file can be written");
        }
        folder
    }
}

impl Drop for MeshFolder {
    fn drop(&mut self) {
        // What is left behind does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

// Rays.

/// What bends the light.
#[derive(Clone, Copy, Debug)]
enum Bend {
    Straight,
    Gravity,
    Schwarzschild,
    Kerr,
}

const BENT: [Bend; 3] = [Bend::Gravity, Bend::Schwarzschild, Bend::Kerr];
const ALL: [Bend; 4] = [Bend::Straight, Bend::Gravity, Bend::Schwarzschild, Bend::Kerr];

impl Bend {
    /// Keys of `[spacetime]`: a hole of mass `size` at `position`, or a gravity center that reaches 40 times as far, and whose middle
    /// has an index of 1.75 for rays from outside, as in form A of `nullray bench`.
    fn keys(self, position: [f64; 3], size: f64) -> String {
        let place = format!("position = {position:?}");
        match self {
            Bend::Straight => String::new(),
            Bend::Gravity => {
                let (strength, radius) = (0.0375 / size, 40.0 * size);
                let center = format!("[[spacetime.center]]\nposition = [0, 0, 0]\nstrength = {strength}\nradius = {radius}");
                format!("kind = \"gravity\"\nlaw = \"thesis\"\n{place}\n{center}")
            }
            Bend::Schwarzschild => format!("kind = \"schwarzschild\"\n{place}\nmass = {size}"),
            Bend::Kerr => format!("kind = \"kerr\"\n{place}\nmass = {size}\nspin = {}", 0.9 * size),
        }
    }
}

/// A ray of light that is followed back from a camera, with the width its cone has there.
fn launch<T: Scalar>(scene: &SceneParameters, origin: Vec3, direction: Vec3, spread: f32) -> Launch<T> {
    let convert = |v: Vec3| v.to_array().map(|c| T::from_f64(f64::from(c)));
    Launch {
        origin: convert(origin),
        direction: convert(direction),
        speed: T::from_f64(1.0),
        sense: T::from_f64(-1.0),
        side: 0,
        width: scene.cone_width + scene.pixel_spread * origin.distance(Vec3::from(scene.camera_position)),
        spread,
    }
}

/// What all rays through a world share.
fn course_through<'a, T>(world: &'a World, model: &'a ModelBlock<T>) -> Course<'a, T> {
    Course { view: world.view(), scene: &world.scene, model, kind: world.model, stop: Stop::Never, drift: false }
}

/// Follows every ray to its end as the backend does, on one thread; returns what that took.
fn follow<T: Scalar>(course: &Course<T>, launches: &[Launch<T>], arrivals: &mut [Option<Arrival>]) -> Work {
    let (level, count) = (Level::new(), launches.len());
    let mut traverser = Traverser::new();
    dispatch!(level, simd => {
        advance_curved(simd, course, &mut traverser, count, |i| launches[i], |i, landing| arrivals[i] = Some(landing.arrival))
    });
    traverser.work
}

// Traversal.

/// Mass of the hole in the middle of the displaced scene.
const MASS: f64 = 0.25;

/// The displaced scene in full, and rays through it when light is straight.
struct Displaced {
    mesh: Arc<Mesh>,
    camera: Vec<Ray>,
    diffuse: Vec<Ray>,
}

static DISPLACED: LazyLock<Displaced> = LazyLock::new(|| {
    let mesh = Arc::new(displaced_mesh(FULL));
    let world = World::compile(&displaced_scene(&mesh, "")).expect("half a million triangles fit");
    let (camera, view) = (primary_rays(), world.view());
    let mut hits = vec![Hit::none(FAR); camera.len()];
    closest_hits(Level::new(), &view, &camera, &mut hits);
    let diffuse = diffuse_rays(&mesh, &view, &camera, &hits);
    Displaced { mesh, camera, diffuse }
});

mod traversal {
    use super::*;

    /// Coherent rays.
    #[divan::bench(args = ALL, max_time = SECONDS)]
    fn camera(bencher: Bencher, bend: Bend) {
        through_displaced(bencher, bend, &DISPLACED.camera, 0.0);
    }

    /// Incoherent rays.
    #[divan::bench(args = ALL, max_time = SECONDS)]
    fn diffuse(bencher: Bencher, bend: Bend) {
        through_displaced(bencher, bend, &DISPLACED.diffuse, DIFFUSE_SPREAD);
    }
}

/// Times `rays` through the displaced scene; their cones grow at least as `least_spread`. Straight ones are only looked up in the BVH.
fn through_displaced(bencher: Bencher, bend: Bend, rays: &[Ray], least_spread: f32) {
    let scene = displaced_scene(&DISPLACED.mesh, &bend.keys([0.0; 3], MASS));
    let world = World::compile(&scene).expect("half a million triangles fit");
    let bencher = bencher.counter(ItemsCount::new(rays.len()));
    if let Bend::Straight = bend {
        let (level, view) = (Level::new(), world.view());
        bencher.with_inputs(|| vec![Hit::none(FAR); rays.len()]).bench_local_refs(|hits| closest_hits(level, &view, rays, hits));
        return;
    }
    let model = world.model_block::<f32>();
    let course = course_through(&world, &model);
    let spread = world.scene.pixel_spread.max(least_spread);
    let launches: Vec<Launch<f32>> = rays.iter().map(|ray| launch(&world.scene, ray.origin, ray.direction, spread)).collect();
    bencher.with_inputs(|| vec![None::<Arrival>; rays.len()]).bench_local_refs(|arrivals| follow(&course, &launches, arrivals));
}

// Integration.

/// Where the model is in the empty scene, and the camera that looks at it. The bounds of nothing are the origin: far enough from it, the
/// clearance grid sends hardly a step to the BVH.
const PLACE: [f64; 3] = [100.0, 0.0, 0.0];
const EYE: [f64; 3] = [100.0, 0.0, 20.0];
/// The film, which sets the tolerance, and the distance of the pixels that are traced.
const FILM: [u32; 2] = [1920, 1080];
const STRIDE: u32 = 20;

/// Rays through an empty scene.
#[divan::bench(types = [f32, f64], args = BENT, max_time = SECONDS)]
fn integration<T: Scalar>(bencher: Bencher, bend: Bend) {
    let world = empty_world(bend);
    let model = world.model_block::<T>();
    let course = course_through(&world, &model);
    let launches = film_launches::<T>(&world.scene);
    let mut arrivals = vec![None::<Arrival>; launches.len()];
    let steps = follow(&course, &launches, &mut arrivals).steps;
    bencher.counter(ItemsCount::new(steps)).bench_local(|| follow(&course, &launches, &mut arrivals));
}

/// A hole of mass 1, or a gravity center, and nothing else.
fn empty_world(bend: Bend) -> World {
    let [width, height] = FILM;
    let text = format!(
        "[camera]\nposition = {EYE:?}\nlook_at = {PLACE:?}\nfov_degrees = 60\n\
         [film]\nwidth = {width}\nheight = {height}\n[spacetime]\n{}\n",
        bend.keys(PLACE, 1.0)
    );
    let scene = parse_scene(Path::new("empty"), &text, &[]).expect("the text is a scene");
    World::compile(&scene).expect("there is nothing in it")
}

/// Rays through every so many pixels of the film.
fn film_launches<T: Scalar>(scene: &SceneParameters) -> Vec<Launch<T>> {
    let [columns, rows] = FILM.map(|pixels| pixels / STRIDE);
    let origin = Vec3::from(scene.camera_position);
    (0..columns * rows)
        .map(|i| {
            let film = (vec2((i % columns) as f32, (i / columns) as f32) + 0.5) * STRIDE as f32;
            launch(scene, origin, film_direction((), scene, film.to_array()).into(), scene.pixel_spread)
        })
        .collect()
}

// The share of the peak.

/// Passes of a measurement, of which the fastest counts.
const PASSES: usize = 15;
/// Multiply-adds of each chain in a pass.
const CHAIN_LENGTH: usize = 1_000_000;
/// Calls of the integration kernel in a pass.
const CALLS: usize = 20_000;

/// Prints the table.
fn print_shares() {
    let level = Level::new();
    let name = dispatch!(level, simd => std::any::type_name_of_val(&simd)).rsplit("::").next().unwrap_or("scalar");
    let (single, double) = (peak::<f32>(), peak::<f64>());
    println!("\nSIMD level {name}; peak of a core: {:.1} Gflop/s in f32, {:.1} in f64", 1e-9 * single, 1e-9 * double);
    println!("                                            kernel alone      launch to landing");
    println!("model          real     flop/step      Msteps/s  of peak      Msteps/s  of peak");
    print_model::<ThesisGravity>(Bend::Gravity, single, double);
    print_model::<Schwarzschild>(Bend::Schwarzschild, single, double);
    print_model::<KerrNewman>(Bend::Kerr, single, double);
}

/// Prints the rows of the model `M`, which is that of `bend`.
fn print_model<M: Model>(bend: Bend, single: f64, double: f64) {
    let world = empty_world(bend);
    assert_eq!(world.model, M::KIND, "the model of {bend:?}");
    let operations = operations_per_step::<M>(&world);
    print_row::<f32>(bend, &world, operations, single);
    print_row::<f64>(bend, &world, operations, double);
}

/// Measures steps of `operations` each against a peak of operations per second, and prints the row.
fn print_row<T: Scalar>(bend: Bend, world: &World, operations: u64, peak: f64) {
    let level = Level::new();
    let model = world.model_block::<T>();
    let course = course_through(world, &model);
    let launches = film_launches::<T>(&world.scene);
    let kernel_seconds = fastest(|| dispatch!(level, simd => step_again(simd, &course, &launches)));
    let mut arrivals = vec![None::<Arrival>; launches.len()];
    let mut steps = 0;
    let seconds = fastest(|| steps = follow(&course, &launches, &mut arrivals).steps);
    let (kernel, whole) = ((CALLS * T::WIDTH) as f64 / kernel_seconds, steps as f64 / seconds);
    let percent = |rate: f64| 100.0 * operations as f64 * rate / peak;
    let name = format!("{bend:?}");
    println!(
        "{name:<14} {:<8} {operations:>9} {:>13.1} {:>7.1}% {:>13.1} {:>7.1}%",
        std::any::type_name::<T>(),
        1e-6 * kernel,
        percent(kernel),
        1e-6 * whole,
        percent(whole)
    );
}

/// Seconds of the fastest of some passes.
fn fastest(mut pass: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        pass();
        start.elapsed().as_secs_f64()
    };
    (0..PASSES).map(time).fold(f64::INFINITY, f64::min)
}

/// Takes the first step of a register full of rays again and again; no step waits for the one before.
#[inline(always)]
fn step_again<S: Simd, T: Scalar>(simd: S, course: &Course<T>, launches: &[Launch<T>]) {
    let kernels = ModelKernels::<S, T>::of(course.kind);
    let mut lanes = Lanes::<T>::idle();
    let spaced = launches.iter().step_by(launches.len() / T::WIDTH);
    for (i, ray) in spaced.take(T::WIDTH).enumerate() {
        for axis in 0..3 {
            lanes.x[axis][i] = ray.origin[axis];
            lanes.p[axis][i] = ray.direction[axis];
        }
        lanes.energy[i] = ray.speed;
        lanes.sense[i] = ray.sense;
    }
    (kernels.launch)(simd, course, &mut lanes);
    for _ in 0..CALLS {
        black_box_drop((kernels.integrate)(simd, course, &mut lanes));
    }
}

/// Most floating-point operations per second of one core in multiply-adds: the number of chains that hides their latency and stays in
/// registers depends on the machine.
fn peak<T: Scalar>() -> f64 {
    [chains_rate::<T, 3>(), chains_rate::<T, 5>(), chains_rate::<T, 8>(), chains_rate::<T, 10>()].into_iter().fold(0.0, f64::max)
}

/// Operations per second of independent chains of multiply-adds.
fn chains_rate<T: Scalar, const CHAINS: usize>() -> f64 {
    let level = Level::new();
    let seconds = fastest(|| dispatch!(level, simd => run_chains::<_, T, CHAINS>(simd)));
    (2 * CHAINS * T::WIDTH * CHAIN_LENGTH) as f64 / seconds
}

/// Multiplies and adds in every chain.
#[inline(always)]
fn run_chains<S: Simd, T: Scalar, const CHAINS: usize>(simd: S) {
    let factor = <T::Register<S>>::constant(simd, black_box(0.999));
    let addend = <T::Register<S>>::constant(simd, black_box(0.001));
    let mut chains = [addend; CHAINS];
    // No two chains are the same, or they might be computed once.
    for (i, chain) in chains.iter_mut().enumerate() {
        *chain = <T::Register<S>>::constant(simd, black_box(i as f64));
    }
    for _ in 0..CHAIN_LENGTH {
        for chain in &mut chains {
            *chain = chain.mul_add(factor, addend);
        }
    }
    let mut sum = addend;
    for chain in &chains {
        sum = sum + *chain;
    }
    let mut lanes = [T::default(); MAX_LANES];
    sum.store(&mut lanes);
    black_box_drop(lanes);
}

// Operations of a step.

thread_local! {
    /// Operations so far.
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// A number that counts what is done with it: additions, subtractions, multiplications, divisions, roots and transcendental functions as
/// one operation, a multiply-add as two, all else as none.
#[derive(Clone, Copy, Default, PartialEq, PartialOrd, Pod, Zeroable)]
#[repr(transparent)]
struct Counted(f32);

/// The result of some operations.
fn counted(operations: u64, value: f32) -> Counted {
    OPERATIONS.set(OPERATIONS.get() + operations);
    Counted(value)
}

/// Operations of one step through the model `M` by the world's method, of one ray.
fn operations_per_step<M: Model>(world: &World) -> u64 {
    let model = world.model_block::<Counted>();
    let scene = &world.scene;
    let [x, direction] = [scene.camera_position, scene.camera_forward].map(|v| v.map(Counted));
    let sense = Counted(-1.0);
    let (p, energy, _) = M::launch::<Counted>((), &model, x, direction, Counted(1.0), sense);
    let charge = Charge { energy, sense };
    let flight = rate_at::<M, Counted>((), &model, &charge, x, p, Counted(0.0));
    let h = Counted(0.1);
    OPERATIONS.set(0);
    let error = if scene.method == METHOD_NYSTROM {
        nystrom_step::<M, Counted>((), &model, &charge, &flight, h).1
    } else {
        runge_kutta_step::<M, Counted>((), &model, &charge, &flight, Counted(0.0), h).1
    };
    let operations = OPERATIONS.get();
    assert!(error.0.is_finite(), "the step leads nowhere");
    operations
}

macro_rules! count_operator {
    ($operator:ident, $function:ident) => {
        impl $operator for Counted {
            type Output = Counted;
            fn $function(self, other: Counted) -> Counted {
                counted(1, $operator::$function(self.0, other.0))
            }
        }
    };
}
count_operator!(Add, add);
count_operator!(Sub, sub);
count_operator!(Mul, mul);
count_operator!(Div, div);

impl Neg for Counted {
    type Output = Counted;
    fn neg(self) -> Counted {
        Counted(-self.0)
    }
}

impl Real for Counted {
    fn from_f64(value: f64) -> Counted {
        Counted(value as f32)
    }
    fn to_f64(self) -> f64 {
        self.0.into()
    }
    fn to_f32(self) -> f32 {
        self.0
    }
}

impl Lane for Counted {
    type Real = Counted;
    type Mask = bool;
    type Token = ();
    const LANES: usize = 1;

    fn splat(_: (), value: Counted) -> Counted {
        value
    }
    fn load(_: (), values: &[Counted]) -> Counted {
        values[0]
    }
    fn store(self, values: &mut [Counted]) {
        values[0] = self;
    }
    fn mul_add(self, factor: Counted, addend: Counted) -> Counted {
        counted(2, self.0 * factor.0 + addend.0)
    }
    fn sqrt(self) -> Counted {
        counted(1, self.0.sqrt())
    }
    fn exp(self) -> Counted {
        counted(1, self.0.exp())
    }
    fn ln(self) -> Counted {
        counted(1, self.0.ln())
    }
    fn sin(self) -> Counted {
        counted(1, self.0.sin())
    }
    fn cos(self) -> Counted {
        counted(1, self.0.cos())
    }
    fn atan(self) -> Counted {
        counted(1, self.0.atan())
    }
    fn floor(self) -> Counted {
        Counted(self.0.floor())
    }
    fn gather(self, table: &[u8]) -> Counted {
        Counted(f32::from(table[self.0 as usize]))
    }
    fn min(self, other: Counted) -> Counted {
        Counted(self.0.min(other.0))
    }
    fn max(self, other: Counted) -> Counted {
        Counted(self.0.max(other.0))
    }
    fn lt(self, other: Counted) -> bool {
        self.0 < other.0
    }
    fn mask(_: (), bits: u32) -> bool {
        bits & 1 == 1
    }
    fn select(mask: bool, then: Counted, otherwise: Counted) -> Counted {
        if mask { then } else { otherwise }
    }
    fn both(a: bool, b: bool) -> bool {
        a & b
    }
    fn bits(mask: bool) -> u32 {
        mask.into()
    }
}
