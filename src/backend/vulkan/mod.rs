//! The Vulkan backend: wavefront kernels over a pool of path slots.
//!
//! A batch fills the slots with camera paths and runs rounds of `advance -> prepare -> shade, escape -> prepare` with
//! indirect dispatches until no path is left; the host only looks once per submission. `resolve` then adds the batch to
//! the film.

mod batch;
pub mod buffer;
pub mod canvas;
pub mod command;
pub mod device;
mod film;
pub mod instance;
mod overlay;
pub mod pipeline;
pub mod presenter;
mod scene;
pub mod swapchain;
mod trace;

use super::{Backend, Canvas, Development, Precision, Profiling, Timings, TraceOptions, TraceRay, TraceResult};
use crate::error::{Error, Result};
use crate::film::Film;
use crate::kernels::constants::*;
use crate::kernels::layout::SceneParameters;
use crate::spacetime::ModelKind;
use crate::world::World;
use ash::vk;
use batch::Push;
use buffer::{Buffer, TexelView};
use command::Commands;
use device::Device;
use film::DeviceFilm;
use gpu_allocator::MemoryLocation;
use instance::Instance;
use pipeline::{Layout, Pipeline, kernel_spirv};
use scene::DeviceScene;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Words of 16 bytes that a path takes in memory (`bindings.glsl`).
const PATH_WORDS: u64 = 17;
/// Most path slots.
const MAX_SLOTS: u64 = 1 << 21;
/// Slots of the first batch, before anything was measured.
const FIRST_SLOTS: u32 = 8192;
/// Words of the counter buffer (`bindings.glsl`).
const COUNTERS: u64 = 32;

/// What a pipeline that advances rays is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Purpose {
    Rendering,
    /// Rendering, and counting what that takes.
    Counting,
    /// Rays on their own, whose ends are wanted in full.
    Tracing,
}

/// Pipelines of one model, method and precision.
struct Kernels {
    generate: Pipeline,
    prepare: Pipeline,
    advance: Pipeline,
    shade: Pipeline,
    escape: Pipeline,
    resolve: Pipeline,
    develop: Pipeline,
    /// `advance` that counts what it does, once that was asked for.
    counting: Option<Pipeline>,
    /// `advance` for the rays that were traced last: through which model, by which method.
    tracing: Option<(ModelKind, u32, Pipeline)>,
}

impl Kernels {
    /// The pipeline that advances rays; those that are not always needed must have been built before.
    fn advance_for(&self, purpose: Purpose) -> Result<&Pipeline> {
        let pipeline = match purpose {
            Purpose::Rendering => Some(&self.advance),
            Purpose::Counting => self.counting.as_ref(),
            Purpose::Tracing => self.tracing.as_ref().map(|(.., pipeline)| pipeline),
        };
        pipeline.ok_or(Error::Vulkan { call: "advance_for", result: "the kernel was not built".into() })
    }
}

/// A world on the device and its film.
struct Loaded {
    world: Arc<World>,
    /// In place of those of the world.
    parameters: SceneParameters,
    precision: Precision,
    kernels: Kernels,
    scene: DeviceScene,
    film: DeviceFilm,
    snapshot: Option<Film>,
    snapshot_at: Instant,
}

/// Renders on a Vulkan device.
pub struct VulkanBackend {
    loaded: Option<Loaded>,
    /// Whether the film survives the device. In a window the copies would be felt.
    takes_snapshots: bool,
    slots: u32,
    capacity: u32,
    /// Of `paths`, before which it is dropped.
    _path_view: TexelView,
    paths: Buffer,
    counters: Buffer,
    queues: Buffer,
    readback: Buffer,
    commands: Commands,
    layout: Layout,
    device: Arc<Device>,
}

impl VulkanBackend {
    /// Opens the best device, or the one `wanted` names by number or part of its name.
    pub fn new(wanted: Option<&str>) -> Result<VulkanBackend> {
        let backend = VulkanBackend::on_device(Device::new(Arc::new(Instance::new()?), wanted)?)?;
        Ok(VulkanBackend { takes_snapshots: true, ..backend })
    }

    /// Renders on a device that others use too; if it is lost, so is the film.
    pub fn on_device(device: Arc<Device>) -> Result<VulkanBackend> {
        let layout = Layout::new(&device, 3, size_of::<Push>() as u32)?;
        let by_range = u64::from(device.report.max_storage_buffer_range) / (PATH_WORDS * 16);
        let by_memory = device.report.memory / 4 / (PATH_WORDS * 16);
        let by_texels = u64::from(device.report.max_texel_buffer_elements) / PATH_WORDS;
        // Dispatches are one-dimensional: at most 65535 workgroups everywhere.
        let by_groups = 65535 * u64::from(WORKGROUP_SIZE);
        let capacity = by_range.min(by_memory).min(by_texels).min(by_groups).min(MAX_SLOTS) as u32;
        let paths = Buffer::new(&device, "paths", u64::from(capacity) * PATH_WORDS * 16, MemoryLocation::GpuOnly)?;
        let counters = Buffer::new(&device, "counters", COUNTERS * 4, MemoryLocation::GpuOnly)?;
        let queues = Buffer::new(&device, "queues", u64::from(capacity) * 16, MemoryLocation::GpuOnly)?;
        let readback = Buffer::new(&device, "readback", 32 << 20, MemoryLocation::GpuToCpu)?;
        layout.bind(&[&paths, &counters, &queues]);
        let path_view = TexelView::new(&device, &paths, vk::Format::R32G32B32A32_UINT, 16)?;
        layout.bind_paths(&path_view);
        let commands = Commands::new(&device)?;
        Ok(VulkanBackend {
            loaded: None,
            takes_snapshots: false,
            slots: FIRST_SLOTS.min(capacity),
            capacity,
            _path_view: path_view,
            paths,
            counters,
            queues,
            readback,
            commands,
            layout,
            device,
        })
    }

    /// Whether the device is an implementation on the processor.
    pub fn is_software(&self) -> bool {
        self.device.report.is_software()
    }

    /// Whether double-precision kernels run on the device.
    pub fn supports_f64(&self) -> bool {
        self.device.report.float64
    }

    /// The device it runs on.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    fn kernel(&self, name: &str) -> Result<Pipeline> {
        self.specialized_kernel(name, &[])
    }

    fn specialized_kernel(&self, name: &str, constants: &[u32]) -> Result<Pipeline> {
        let code = kernel_spirv(name).ok_or_else(|| Error::Vulkan { call: "kernel_spirv", result: format!("no kernel `{name}`") })?;
        Pipeline::specialized(&self.device, &self.layout, name, code, constants)
    }

    /// The kernel that advances rays through a model by the method of `parameters`.
    fn advance(&self, model: ModelKind, precision: Precision, parameters: &SceneParameters, purpose: Purpose) -> Result<Pipeline> {
        let is = |p: Purpose| u32::from(purpose == p);
        self.specialized_kernel(&advance_name(model, precision), &[is(Purpose::Counting), parameters.method, is(Purpose::Tracing)])
    }

    fn kernels(&self, model: ModelKind, precision: Precision, parameters: &SceneParameters) -> Result<Kernels> {
        let _span = tracing::info_span!("pipelines", model = model.stem()).entered();
        Ok(Kernels {
            generate: self.kernel("generate")?,
            prepare: self.kernel("prepare")?,
            advance: self.advance(model, precision, parameters, Purpose::Rendering)?,
            // Which follows from the model, as the rest does.
            shade: self.specialized_kernel("shade", &[parameters.local_frames])?,
            escape: self.kernel("escape")?,
            resolve: self.kernel("resolve")?,
            develop: self.kernel("develop")?,
            counting: None,
            tracing: None,
        })
    }
}

/// Name of the kernel that advances rays through a model.
fn advance_name(model: ModelKind, precision: Precision) -> String {
    format!("advance_{}_{}", model.stem(), precision.suffix())
}

impl Backend for VulkanBackend {
    fn name(&self) -> String {
        let r = &self.device.report;
        format!("vulkan, {}", r.name)
    }

    fn upload(&mut self, world: Arc<World>, precision: Precision, first_sample: u32) -> Result<()> {
        if precision == Precision::F64 && !self.device.report.float64 {
            return Err(Error::NoDevice {
                missing: format!("{} has no shaderFloat64, which --precision f64 needs", self.device.report.name),
            });
        }
        self.expect_width(world.scene.film_width)?;
        let (mut kernels, mut film) = (None, None);
        if let Some(old) = self.loaded.take() {
            // What fits the new world as well is kept: a viewer uploads one world after another.
            if (old.world.model, old.world.scene.method, old.precision) == (world.model, world.scene.method, precision) {
                kernels = Some(old.kernels);
            }
            film = Some(old.film);
        }
        let kernels = match kernels {
            Some(kernels) => kernels,
            None => self.kernels(world.model, precision, &world.scene)?,
        };
        let scene = DeviceScene::new(&self.device, &mut self.commands, &world, precision)?;
        scene.bind(&self.layout);
        let mut film = match film {
            Some(film) => film,
            None => DeviceFilm::new(&self.device)?,
        };
        film.first_sample = first_sample;
        film.restart(&mut self.commands, world.scene.film_width, world.scene.film_height)?;
        self.loaded =
            Some(Loaded { parameters: world.scene, world, precision, kernels, scene, film, snapshot: None, snapshot_at: Instant::now() });
        Ok(())
    }

    fn set_parameters(&mut self, parameters: &SceneParameters) -> Result<()> {
        self.expect_width(parameters.film_width)?;
        let loaded = self.loaded.as_mut().ok_or_else(nothing_loaded)?;
        loaded.film.restart(&mut self.commands, parameters.film_width, parameters.film_height)?;
        loaded.scene.set_parameters(&mut self.commands, parameters)?;
        loaded.parameters = *parameters;
        (loaded.snapshot, loaded.snapshot_at) = (None, Instant::now());
        Ok(())
    }

    fn accumulate(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()> {
        let mut loaded = self.take_loaded()?;
        let outcome = self.accumulate_in(&mut loaded, rows, samples);
        self.loaded = Some(loaded);
        outcome
    }

    fn film(&mut self) -> Result<Film> {
        let loaded = self.loaded.as_ref().ok_or_else(nothing_loaded)?;
        match loaded.film.read(&mut self.commands, &mut self.readback) {
            Err(Error::DeviceLost { .. }) if self.takes_snapshots => Ok(loaded.snapshot.clone().unwrap_or_else(|| loaded.film.empty())),
            film => film,
        }
    }

    fn develop(&mut self, development: &Development, canvas: &mut Canvas) -> Result<()> {
        let loaded = self.loaded.as_mut().ok_or_else(nothing_loaded)?;
        loaded.film.develop(&mut self.commands, &self.layout, &loaded.kernels.develop, development, canvas)
    }

    fn trace(&mut self, rays: &[TraceRay], options: TraceOptions) -> Result<Vec<TraceResult>> {
        let mut loaded = self.take_loaded()?;
        let outcome = self.trace_in(&mut loaded, rays, options);
        self.loaded = Some(loaded);
        outcome
    }

    fn set_profiling(&mut self, profiling: Profiling) {
        self.commands.set_profiling(profiling);
    }

    fn timings(&mut self) -> Timings {
        self.commands.take_timings()
    }
}

impl VulkanBackend {
    /// Fails if a row of pixels is more than a batch can be.
    fn expect_width(&self, width: u32) -> Result<()> {
        if width <= self.capacity {
            return Ok(());
        }
        let (most, device) = (self.capacity, &self.device.report.name);
        Err(Error::World(format!("the film is {width} pixels wide, expected at most the {most} paths that {device} holds")))
    }

    fn take_loaded(&mut self) -> Result<Loaded> {
        self.loaded.take().ok_or_else(nothing_loaded)
    }
}

fn nothing_loaded() -> Error {
    Error::World("no scene was uploaded".into())
}
