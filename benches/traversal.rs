//! Closest hits of straight rays per second on one thread: the eight-wide BVH against Embree 3, on the same triangles and rays.
//!
//! The scene, 524,288 triangles, and the rays are those of `support/displaced.rs`. Embree is opened at run time if it is installed.
//! Contestants take turns within every repeat; what Embree is given is packed outside its time.
#![allow(clippy::expect_used, reason = "a benchmark stops where it cannot go on")]

#[path = "support/displaced.rs"]
mod displaced;

use displaced::{FULL, Ray, closest_hits, diffuse_rays, displaced_mesh, displaced_scene, primary_rays};
use fearless_simd::{Level, dispatch};
use libloading::Library;
use nullray::kernels::bvh::Hit;
use nullray::kernels::constants::{FAR, NO_INDEX};
use nullray::kernels::view::SceneView;
use nullray::scene::mesh::Mesh;
use nullray::world::World;
use std::ffi::{c_char, c_void};
use std::fmt;
use std::mem::ManuallyDrop;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

/// Repeats that count; one more warms up and is checked.
const REPEATS: usize = 21;
/// Share of the rays that may hit in one library only, and relative difference of the sums of distances.
const TOLERANCE: f64 = 1e-4;
/// Those who take turns, in the order of the table.
const CONTESTANTS: [&str; 4] = ["nullray", "Embree single", "Embree packet8", "packet8 coherent"];

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("traversal: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// Measures both kinds of rays and prints the table; fails if the libraries do not see the same surfaces.
fn run() -> Result<(), String> {
    let mesh = Arc::new(displaced_mesh(FULL));
    let world = World::compile(&displaced_scene(&mesh, "")).expect("half a million triangles fit");
    let view = world.view();
    let level = Level::new();
    let embree = Embree::build(&mesh);

    let name = dispatch!(level, simd => std::any::type_name_of_val(&simd)).rsplit("::").next().unwrap_or("scalar");
    let peer = embree.as_ref().map_or("no Embree".to_owned(), |e| format!("Embree {}", e.version()));
    println!("{} triangles, one thread, SIMD level {name}, {peer}", mesh.indices.len());
    println!("Mrays/s: median (min..max) of {REPEATS} repeats");

    let primary = primary_rays();
    let (_, hits) = trace(level, &view, &primary);
    let diffuse = diffuse_rays(&mesh, &view, &primary, &hits);
    let rows = [
        ("primary", measure(level, &view, embree.as_ref(), &primary).map_err(|e| format!("primary rays: {e}"))?),
        ("diffuse", measure(level, &view, embree.as_ref(), &diffuse).map_err(|e| format!("diffuse rays: {e}"))?),
    ];
    print_table(&rows);
    if embree.is_none() {
        println!("install libembree-dev to compare");
    }
    Ok(())
}

// The measurement.

/// One pass of a contestant over all rays.
struct Pass {
    seconds: f64,
    /// Distance of the hit of each ray, `FAR` without one.
    distances: Vec<f32>,
}

/// What the table says about one kind of rays.
struct Measured {
    rays: usize,
    hits: usize,
    /// One entry per contestant present.
    rates: Vec<Rate>,
}

/// Millions of rays per second.
struct Rate {
    median: f64,
    min: f64,
    max: f64,
}

impl Rate {
    fn new(rays: usize, seconds: &[f64]) -> Rate {
        let mut rates: Vec<f64> = seconds.iter().map(|s| 1e-6 * rays as f64 / s).collect();
        rates.sort_by(f64::total_cmp);
        Rate { median: rates[rates.len() / 2], min: rates[0], max: rates[rates.len() - 1] }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(&format!("{:.2} ({:.2}..{:.2})", self.median, self.min, self.max))
    }
}

/// Seconds our traversal takes for the rays, and what they hit.
fn trace(level: Level, view: &SceneView, rays: &[Ray]) -> (f64, Vec<Hit>) {
    let mut hits = vec![Hit::none(FAR); rays.len()];
    let start = Instant::now();
    closest_hits(level, view, rays, &mut hits);
    (start.elapsed().as_secs_f64(), hits)
}

/// Lets the contestants take turns; the first turn is checked instead of timed.
fn measure(level: Level, view: &SceneView, embree: Option<&Embree>, rays: &[Ray]) -> Result<Measured, String> {
    let mut seconds = vec![Vec::new(); CONTESTANTS.len()];
    let mut hit_count = 0;
    for repeat in 0..=REPEATS {
        let (own_seconds, hits) = trace(level, view, rays);
        let mut passes = vec![Pass { seconds: own_seconds, distances: hits.iter().map(|h| h.t).collect() }];
        if let Some(embree) = embree {
            passes.push(embree.trace_single(rays));
            passes.push(embree.trace_packets(rays, CONTEXT_INCOHERENT));
            passes.push(embree.trace_packets(rays, CONTEXT_COHERENT));
        }
        if repeat == 0 {
            hit_count = hits.iter().filter(|h| h.primitive != NO_INDEX).count();
            for (pass, name) in passes.iter().zip(CONTESTANTS).skip(1) {
                compare(&passes[0].distances, &pass.distances).map_err(|e| format!("nullray and {name} differ: {e}"))?;
            }
            continue;
        }
        for (list, pass) in seconds.iter_mut().zip(&passes) {
            list.push(pass.seconds);
        }
    }
    let rates = seconds.iter().filter(|s| !s.is_empty()).map(|s| Rate::new(rays.len(), s)).collect();
    Ok(Measured { rays: rays.len(), hits: hit_count, rates })
}

/// Says how two lists of distances differ, if they do: in what is hit at all, or in the sum over what both hit.
fn compare(ours: &[f32], theirs: &[f32]) -> Result<(), String> {
    let (mut one_sided, mut our_sum, mut their_sum) = (0usize, 0.0, 0.0);
    for (&a, &b) in ours.iter().zip(theirs) {
        match (a < FAR, b < FAR) {
            (true, true) => {
                our_sum += f64::from(a);
                their_sum += f64::from(b);
            }
            (false, false) => {}
            _ => one_sided += 1,
        }
    }
    if one_sided as f64 > TOLERANCE * ours.len() as f64 {
        return Err(format!("{one_sided} of {} rays hit in one of them only", ours.len()));
    }
    if (our_sum - their_sum).abs() > TOLERANCE * our_sum {
        return Err(format!("the distances sum to {our_sum} and {their_sum}"));
    }
    Ok(())
}

fn print_table(rows: &[(&str, Measured)]) {
    let compared = rows.iter().all(|(_, m)| m.rates.len() > 1);
    let present = if compared { CONTESTANTS.len() } else { 1 };
    print!("{:<8} {:>7} {:>6}", "rays", "count", "hit");
    CONTESTANTS[..present].iter().for_each(|name| print!(" {name:>21}"));
    println!("{}", if compared { " ours/single  ours/best" } else { "" });
    for (name, measured) in rows {
        let share = 100.0 * measured.hits as f64 / measured.rays as f64;
        print!("{name:<8} {:>7} {share:>5.1}%", measured.rays);
        measured.rates.iter().for_each(|rate| print!(" {rate:>21}"));
        if let [ours, single, ..] = &measured.rates[..] {
            let best = measured.rates[1..].iter().map(|r| r.median).fold(0.0, f64::max);
            print!(" {:>11.2} {:>10.2}", ours.median / single.median, ours.median / best);
        }
        println!();
    }
}

// Embree 3, as far as it is used. Names, values and layouts are those of embree3/rtcore_*.h, version 3.13.

const LIBRARY: &str = "libembree3.so.3";
const BUILD_QUALITY_HIGH: u32 = 2;
const GEOMETRY_TYPE_TRIANGLE: u32 = 0;
const BUFFER_TYPE_INDEX: u32 = 0;
const BUFFER_TYPE_VERTEX: u32 = 1;
const FORMAT_UINT3: u32 = 0x5003;
const FORMAT_FLOAT3: u32 = 0x9003;
const CONTEXT_INCOHERENT: u32 = 0;
const CONTEXT_COHERENT: u32 = 1;
const DEVICE_PROPERTY_VERSION: u32 = 0;
const ERROR_NONE: u32 = 0;
const INVALID_ID: u32 = u32::MAX;

/// RTCDevice, RTCScene or RTCGeometry.
type Handle = *mut c_void;

/// RTCIntersectContext.
#[repr(C)]
#[allow(dead_code, reason = "read by Embree")]
struct Context {
    flags: u32,
    filter: *const c_void,
    instance: u32,
}

/// RTCRayHit8 for N = 8; for N = 1 RTCRayHit, with a larger alignment than it asks for.
#[repr(C, align(32))]
#[allow(dead_code, reason = "read and written by Embree")]
struct RayHit<const N: usize> {
    origin: [[f32; N]; 3],
    t_near: [f32; N],
    direction: [[f32; N]; 3],
    time: [f32; N],
    t_far: [f32; N],
    mask: [u32; N],
    id: [u32; N],
    flags: [u32; N],
    normal: [[f32; N]; 3],
    u: [f32; N],
    v: [f32; N],
    primitive: [u32; N],
    geometry: [u32; N],
    instance: [u32; N],
}

impl<const N: usize> RayHit<N> {
    /// N rays that have hit nothing yet.
    fn pack(rays: &[Ray]) -> Self {
        let lanes = |component: fn(&Ray) -> f32| -> [f32; N] { std::array::from_fn(|lane| component(&rays[lane])) };
        RayHit {
            origin: [lanes(|r| r.origin.x), lanes(|r| r.origin.y), lanes(|r| r.origin.z)],
            t_near: [0.0; N],
            direction: [lanes(|r| r.direction.x), lanes(|r| r.direction.y), lanes(|r| r.direction.z)],
            time: [0.0; N],
            t_far: [FAR; N],
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
            normal: [[0.0; N]; 3],
            u: [0.0; N],
            v: [0.0; N],
            primitive: [INVALID_ID; N],
            geometry: [INVALID_ID; N],
            instance: [INVALID_ID; N],
        }
    }
}

/// Which rays of a packet are traced: -1 is yes.
#[repr(C, align(32))]
struct PacketMask([i32; 8]);

macro_rules! embree_functions {
    ($($field:ident = $symbol:literal ($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// Functions of the library.
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            /// Never unloaded: its worker threads may still be running its code when the last scene is gone.
            _library: ManuallyDrop<Library>,
        }

        impl Functions {
            /// Opens the library if it is installed.
            fn open() -> Option<Functions> {
                // SAFETY: Embree needs nothing of us to be loaded; the types are those its headers give the functions; and the
                // library stays open as long as the pointers to them.
                unsafe {
                    let library = Library::new(LIBRARY).ok()?;
                    $(let $field = *library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($symbol).ok()?;)*
                    Some(Functions { $($field,)* _library: ManuallyDrop::new(library) })
                }
            }
        }
    };
}

embree_functions! {
    new_device = b"rtcNewDevice\0" (*const c_char) -> Handle;
    release_device = b"rtcReleaseDevice\0" (Handle);
    device_property = b"rtcGetDeviceProperty\0" (Handle, u32) -> isize;
    device_error = b"rtcGetDeviceError\0" (Handle) -> u32;
    new_scene = b"rtcNewScene\0" (Handle) -> Handle;
    release_scene = b"rtcReleaseScene\0" (Handle);
    set_scene_build_quality = b"rtcSetSceneBuildQuality\0" (Handle, u32);
    commit_scene = b"rtcCommitScene\0" (Handle);
    new_geometry = b"rtcNewGeometry\0" (Handle, u32) -> Handle;
    release_geometry = b"rtcReleaseGeometry\0" (Handle);
    set_new_geometry_buffer = b"rtcSetNewGeometryBuffer\0" (Handle, u32, u32, u32, usize, usize) -> *mut c_void;
    commit_geometry = b"rtcCommitGeometry\0" (Handle);
    attach_geometry = b"rtcAttachGeometry\0" (Handle, Handle) -> u32;
    intersect1 = b"rtcIntersect1\0" (Handle, *mut Context, *mut RayHit<1>);
    intersect8 = b"rtcIntersect8\0" (*const i32, Handle, *mut Context, *mut RayHit<8>);
}

/// The mesh in Embree's best BVH.
struct Embree {
    functions: Functions,
    device: Handle,
    scene: Handle,
}

impl Embree {
    /// Builds the BVH on one thread; `None` without the library.
    fn build(mesh: &Mesh) -> Option<Embree> {
        let f = Functions::open()?;
        // SAFETY: handles are used as the kind of object they were made as, and only while it lives; each buffer has room for the
        // items it was made for, and nothing else writes to it.
        unsafe {
            let device = (f.new_device)(c"threads=1".as_ptr());
            assert!(!device.is_null(), "Embree makes no device");
            let scene = (f.new_scene)(device);
            (f.set_scene_build_quality)(scene, BUILD_QUALITY_HIGH);
            let geometry = (f.new_geometry)(device, GEOMETRY_TYPE_TRIANGLE);
            let fill = |kind, format, item_size, count| {
                let buffer = (f.set_new_geometry_buffer)(geometry, kind, 0, format, item_size, count);
                assert!(!buffer.is_null(), "Embree makes no buffer");
                buffer
            };
            let (positions, indices) = (&mesh.positions, &mesh.indices);
            let vertex_buffer = fill(BUFFER_TYPE_VERTEX, FORMAT_FLOAT3, size_of::<[f32; 3]>(), positions.len());
            vertex_buffer.cast::<[f32; 3]>().copy_from_nonoverlapping(positions.as_ptr(), positions.len());
            let index_buffer = fill(BUFFER_TYPE_INDEX, FORMAT_UINT3, size_of::<[u32; 3]>(), indices.len());
            index_buffer.cast::<[u32; 3]>().copy_from_nonoverlapping(indices.as_ptr(), indices.len());
            (f.commit_geometry)(geometry);
            (f.attach_geometry)(scene, geometry);
            (f.release_geometry)(geometry);
            (f.commit_scene)(scene);
            assert_eq!((f.device_error)(device), ERROR_NONE, "Embree fails to build the scene");
            Some(Embree { functions: f, device, scene })
        }
    }

    /// Version of the library.
    fn version(&self) -> String {
        // SAFETY: the device lives as long as `self`.
        let version = unsafe { (self.functions.device_property)(self.device, DEVICE_PROPERTY_VERSION) };
        format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
    }

    /// Traces ray by ray.
    fn trace_single(&self, rays: &[Ray]) -> Pass {
        time_packed::<1>(rays, CONTEXT_INCOHERENT, |context, ray| {
            // SAFETY: the scene is committed; the references are valid for the call, and a ray has the layout of RTCRayHit and more
            // than its alignment.
            unsafe { (self.functions.intersect1)(self.scene, context, ray) }
        })
    }

    /// Traces eight rays at a time, a multiple of eight in all.
    fn trace_packets(&self, rays: &[Ray], flags: u32) -> Pass {
        let all = PacketMask([-1; 8]);
        time_packed::<8>(rays, flags, |context, packet| {
            // SAFETY: the scene is committed; the references are valid for the call, the packet has the layout and alignment of
            // RTCRayHit8, and the mask those of its eight integers.
            unsafe { (self.functions.intersect8)(all.0.as_ptr(), self.scene, context, packet) }
        })
    }
}

/// Packs the rays by N, and times `intersect` on all of them.
fn time_packed<const N: usize>(rays: &[Ray], flags: u32, intersect: impl Fn(&mut Context, &mut RayHit<N>)) -> Pass {
    let mut packets: Vec<RayHit<N>> = rays.chunks_exact(N).map(RayHit::pack).collect();
    let mut context = Context { flags, filter: std::ptr::null(), instance: INVALID_ID };
    let start = Instant::now();
    for packet in &mut packets {
        intersect(&mut context, packet);
    }
    let seconds = start.elapsed().as_secs_f64();
    Pass { seconds, distances: packets.iter().flat_map(|p| p.t_far).collect() }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both handles are ours, and nothing uses them afterwards.
        unsafe {
            (self.functions.release_scene)(self.scene);
            (self.functions.release_device)(self.device);
        }
    }
}
