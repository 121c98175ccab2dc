//! Choice of a physical device, the logical device and its queue and allocator.

use super::instance::{Instance, vulkan};
use super::pipeline::PipelineCache;
use super::swapchain::Surface;
use crate::error::{Error, Result};
use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::ffi::CString;
use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a physical device is and what it lacks.
#[derive(Clone, Debug)]
pub struct DeviceReport {
    /// Number for `--device`.
    pub index: usize,
    /// Name the driver gives.
    pub name: String,
    /// discrete, integrated, virtual, cpu or other.
    pub kind: &'static str,
    /// Vulkan version.
    pub api_version: (u32, u32, u32),
    /// Required features it lacks; empty if nullray runs on it.
    pub missing: Vec<&'static str>,
    /// Whether double-precision kernels run.
    pub float64: bool,
    /// Whether synchronization2 is there.
    pub synchronization2: bool,
    /// Whether dispatches can be timed.
    pub timestamps: bool,
    /// Largest storage buffer range in bytes.
    pub max_storage_buffer_range: u32,
    /// Most texels of a texel buffer.
    pub max_texel_buffer_elements: u32,
    /// Memory of the device's own heaps in bytes.
    pub memory: u64,
    pub(super) handle: vk::PhysicalDevice,
    queue_family: u32,
    timestamp_period: f32,
}

impl DeviceReport {
    /// Whether it is an implementation on the processor.
    pub fn is_software(&self) -> bool {
        self.kind == "cpu"
    }

    /// What it lacks, in words.
    fn lacks(&self) -> String {
        format!("{} lacks {}", self.name, self.missing.join(", "))
    }

    fn rank(&self) -> usize {
        ["discrete", "integrated", "virtual", "cpu"].iter().position(|k| *k == self.kind).unwrap_or(4)
    }
}

/// Describes every physical device.
pub fn enumerate(instance: &Instance) -> Result<Vec<DeviceReport>> {
    describe_all(instance, None)
}

/// Describes every physical device; drawing to a `surface` is one more thing to ask of it.
fn describe_all(instance: &Instance, surface: Option<&Surface>) -> Result<Vec<DeviceReport>> {
    // SAFETY: the instance is alive.
    let handles = unsafe { instance.raw.enumerate_physical_devices() }.map_err(vulkan("vkEnumeratePhysicalDevices"))?;
    Ok(handles.into_iter().enumerate().map(|(i, h)| describe(instance, i, h, surface)).collect())
}

fn describe(instance: &Instance, index: usize, handle: vk::PhysicalDevice, surface: Option<&Surface>) -> DeviceReport {
    // SAFETY: `handle` comes from this instance; the feature structures live through the calls.
    let (properties, families, memory, v12, (synchronization2, dynamic_rendering), core) = unsafe {
        let properties = instance.raw.get_physical_device_properties(handle);
        let families = instance.raw.get_physical_device_queue_family_properties(handle);
        let memory = instance.raw.get_physical_device_memory_properties(handle);
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default();
        if properties.api_version >= vk::API_VERSION_1_2 {
            features = features.push_next(&mut v12);
        }
        if properties.api_version >= vk::API_VERSION_1_3 {
            features = features.push_next(&mut v13);
        }
        instance.raw.get_physical_device_features2(handle, &mut features);
        let core = features.features;
        let of_1_3 = (v13.synchronization2 == vk::TRUE, v13.dynamic_rendering == vk::TRUE);
        (properties, families, memory, [v12.buffer_device_address, v12.uniform_buffer_standard_layout], of_1_3, core)
    };
    let serves = |family: usize, flags: vk::QueueFlags| match surface {
        None => flags.contains(vk::QueueFlags::COMPUTE),
        Some(surface) => flags.contains(vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS) && surface.is_served_by(handle, family as u32),
    };
    let family = families.iter().enumerate().position(|(i, f)| serves(i, f.queue_flags));
    let mut missing = vec![];
    if properties.api_version < vk::API_VERSION_1_2 {
        missing.push("Vulkan 1.2");
    }
    for (supported, feature) in v12.into_iter().zip(["bufferDeviceAddress", "uniformBufferStandardLayout"]) {
        if supported == vk::FALSE {
            missing.push(feature);
        }
    }
    if surface.is_some() && !(synchronization2 && dynamic_rendering) {
        missing.push("dynamic rendering of Vulkan 1.3");
    }
    if surface.is_some() && !has_swapchains(instance, handle) {
        missing.push("VK_KHR_swapchain");
    }
    if family.is_none() {
        missing.push(if surface.is_some() { "a queue that draws to the window" } else { "a compute queue" });
    }
    let version = properties.api_version;
    DeviceReport {
        index,
        name: properties.device_name_as_c_str().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        kind: match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
            vk::PhysicalDeviceType::CPU => "cpu",
            _ => "other",
        },
        api_version: (vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version)),
        missing,
        float64: core.shader_float64 == vk::TRUE,
        synchronization2,
        timestamps: family.is_some_and(|f| families[f].timestamp_valid_bits > 0) && properties.limits.timestamp_period > 0.0,
        max_storage_buffer_range: properties.limits.max_storage_buffer_range,
        max_texel_buffer_elements: properties.limits.max_texel_buffer_elements,
        memory: memory.memory_heaps_as_slice().iter().filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL)).map(|h| h.size).sum(),
        handle,
        queue_family: family.unwrap_or(0) as u32,
        timestamp_period: properties.limits.timestamp_period,
    }
}

fn has_swapchains(instance: &Instance, handle: vk::PhysicalDevice) -> bool {
    // SAFETY: `handle` comes from this instance.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(handle) }.unwrap_or_default();
    extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(khr::swapchain::NAME))
}

/// The device `wanted` names by number or part of its name, or the best one.
fn choose(mut devices: Vec<DeviceReport>, wanted: Option<&str>) -> Result<DeviceReport> {
    if let Some(wanted) = wanted {
        let known: Vec<String> = devices.iter().map(|d| format!("{} ({})", d.index, d.name)).collect();
        let lower = wanted.to_lowercase();
        let found = devices.into_iter().find(|d| match wanted.parse::<usize>() {
            Ok(index) => d.index == index,
            Err(_) => d.name.to_lowercase().contains(&lower),
        });
        let found = found.ok_or_else(|| Error::Usage {
            argument: format!("--device {wanted}"),
            reason: format!("no such Vulkan device, expected one of: {}", known.join(", ")),
        })?;
        return if found.missing.is_empty() { Ok(found) } else { Err(Error::NoDevice { missing: found.lacks() }) };
    }
    let lacking: Vec<String> = devices.iter().map(DeviceReport::lacks).collect();
    devices.retain(|d| d.missing.is_empty());
    devices
        .into_iter()
        .min_by_key(DeviceReport::rank)
        .ok_or_else(|| Error::NoDevice { missing: if lacking.is_empty() { "no driver is installed".into() } else { lacking.join("; ") } })
}

/// A logical device with one queue, which several threads may use.
pub struct Device {
    /// Device functions.
    pub raw: ash::Device,
    /// What it is.
    pub report: DeviceReport,
    queue: Mutex<vk::Queue>,
    /// Family of the queue.
    pub queue_family: u32,
    /// Nanoseconds per timestamp tick.
    pub timestamp_period: f32,
    names: Option<ext::debug_utils::Device>,
    pub(super) pipeline_cache: PipelineCache,
    allocator: ManuallyDrop<Mutex<Allocator>>,
    pub(super) instance: Arc<Instance>,
}

impl Device {
    /// Opens a device, chosen as `--device` says.
    pub fn new(instance: Arc<Instance>, wanted: Option<&str>) -> Result<Arc<Device>> {
        let report = choose(enumerate(&instance)?, wanted)?;
        Device::open(instance, report, false)
    }

    /// Opens a device that draws to a surface of the same instance.
    pub fn for_surface(instance: Arc<Instance>, surface: &Surface, wanted: Option<&str>) -> Result<Arc<Device>> {
        let report = choose(describe_all(&instance, Some(surface))?, wanted)?;
        Device::open(instance, report, true)
    }

    fn open(instance: Arc<Instance>, report: DeviceReport, draws: bool) -> Result<Arc<Device>> {
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(report.queue_family).queue_priorities(&priorities)];
        let core = vk::PhysicalDeviceFeatures::default().shader_float64(report.float64);
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default().buffer_device_address(true).uniform_buffer_standard_layout(true);
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).dynamic_rendering(draws);
        let extensions = [khr::swapchain::NAME.as_ptr()];
        let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&core).push_next(&mut v12);
        if draws {
            info = info.enabled_extension_names(&extensions);
        }
        if report.synchronization2 {
            info = info.push_next(&mut v13);
        }
        // SAFETY: the physical device belongs to the instance and has every feature asked for.
        let raw = unsafe { instance.raw.create_device(report.handle, &info, None) }.map_err(vulkan("vkCreateDevice"))?;
        let names = instance.names(&raw);
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: report.handle,
            debug_settings: Default::default(),
            buffer_device_address: true,
            allocation_sizes: Default::default(),
        })
        .map_err(|e| Error::Vulkan { call: "gpu-allocator", result: e.to_string() })?;
        let pipeline_cache = PipelineCache::open(&raw, &report.name)?;
        // SAFETY: the device was created with one queue of this family.
        let queue = unsafe { raw.get_device_queue(report.queue_family, 0) };
        let device = Device {
            queue: Mutex::new(queue),
            queue_family: report.queue_family,
            timestamp_period: report.timestamp_period,
            raw,
            report,
            names,
            pipeline_cache,
            allocator: ManuallyDrop::new(Mutex::new(allocator)),
            instance,
        };
        device.set_name(queue, "compute queue");
        device.set_name(device.pipeline_cache.raw, "pipeline cache");
        Ok(Arc::new(device))
    }

    /// The queue, for one call: threads take turns, and wait for the fences of their submissions without it. Only waiting for it to
    /// be idle keeps it all the while: uploads of panel textures do that, and what has been submitted to it when it is dropped.
    pub fn queue(&self) -> MutexGuard<'_, vk::Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The memory allocator.
    pub fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Names an object for validation messages and captures.
    pub fn set_name<H: vk::Handle>(&self, object: H, name: &str) {
        if let (Some(names), Ok(name)) = (&self.names, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
            // SAFETY: the object belongs to this device; a name that cannot be set changes nothing.
            let _ = unsafe { names.set_debug_utils_object_name(&info) };
        }
    }

    /// Opens a named group of commands for captures.
    pub fn begin_label(&self, commands: vk::CommandBuffer, name: &str) {
        if let (Some(names), Ok(name)) = (&self.names, CString::new(name)) {
            // SAFETY: the buffer belongs to this device and is being recorded.
            unsafe { names.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&name)) };
        }
    }

    /// Closes the group that was opened last.
    pub fn end_label(&self, commands: vk::CommandBuffer) {
        if let Some(names) = &self.names {
            // SAFETY: as above; whoever opened the group closes it in the same recording.
            unsafe { names.cmd_end_debug_utils_label(commands) };
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: every resource holds an `Arc` of the device, so none is left; the allocator goes before its device.
        unsafe {
            let _ = self.raw.device_wait_idle();
            self.pipeline_cache.close(&self.raw);
            ManuallyDrop::drop(&mut self.allocator);
            self.raw.destroy_device(None);
        }
    }
}
