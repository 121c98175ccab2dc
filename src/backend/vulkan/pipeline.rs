//! Compute pipelines, the layout they share, and the cache of a device's pipelines on disk.

use super::buffer::{Buffer, TexelView};
use super::device::Device;
use super::instance::vulkan;
use crate::error::{Error, Result};
use ash::vk;
use std::path::PathBuf;
use std::sync::Arc;

mod spirv {
    include!(concat!(env!("OUT_DIR"), "/spirv.rs"));
}

/// SPIR-V of a kernel by name, as `build.rs` compiled it.
pub fn kernel_spirv(name: &str) -> Option<&'static [u8]> {
    spirv::SPIRV.iter().find(|(n, _)| *n == name).map(|(_, bytes)| *bytes)
}

/// Texel buffers of a scene.
pub const TEXEL_VIEWS: u32 = 12;

/// One descriptor set of storage buffers, the scene and the paths, and one block of push constants, for all kernels.
pub struct Layout {
    device: Arc<Device>,
    /// Pipeline layout.
    pub raw: vk::PipelineLayout,
    set_layout: vk::DescriptorSetLayout,
    pool: vk::DescriptorPool,
    /// The one descriptor set.
    pub set: vk::DescriptorSet,
    storage: u32,
}

impl Layout {
    /// A layout of `storage` storage buffers, after them the scene's uniform block and texel buffers and the paths as texels, and
    /// `push_bytes` of push constants.
    pub fn new(device: &Arc<Device>, storage: u32, push_bytes: u32) -> Result<Layout> {
        let binding = |(binding, ty)| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(ty)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        };
        let counts = [
            (vk::DescriptorType::STORAGE_BUFFER, storage),
            (vk::DescriptorType::UNIFORM_BUFFER, 1),
            (vk::DescriptorType::UNIFORM_TEXEL_BUFFER, TEXEL_VIEWS + 1),
        ];
        let types = counts.iter().flat_map(|&(ty, count)| std::iter::repeat_n(ty, count as usize));
        let bindings: Vec<_> = (0..).zip(types).map(binding).collect();
        let sizes = counts.map(|(ty, descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count });
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(push_bytes)];
        // SAFETY: every handle is created on this device, from structures that live through the calls.
        unsafe {
            let d = &device.raw;
            let set_layout = d
                .create_descriptor_set_layout(&vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings), None)
                .map_err(vulkan("vkCreateDescriptorSetLayout"))?;
            let pool = d
                .create_descriptor_pool(&vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes), None)
                .map_err(vulkan("vkCreateDescriptorPool"))?;
            let layouts = [set_layout];
            let set = d
                .allocate_descriptor_sets(&vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts))
                .map_err(vulkan("vkAllocateDescriptorSets"))?[0];
            let raw = d
                .create_pipeline_layout(&vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts).push_constant_ranges(&push), None)
                .map_err(vulkan("vkCreatePipelineLayout"))?;
            device.set_name(set_layout, "buffers");
            device.set_name(pool, "descriptor pool");
            device.set_name(set, "buffers");
            device.set_name(raw, "pipeline layout");
            Ok(Layout { device: device.clone(), raw, set_layout, pool, set, storage })
        }
    }

    /// Puts storage buffers into the descriptor set, in the order of the bindings.
    pub fn bind(&self, buffers: &[&Buffer]) {
        (0..).zip(buffers).for_each(|(binding, buffer)| self.write(binding, vk::DescriptorType::STORAGE_BUFFER, buffer));
    }

    /// Puts the scene's uniform block and texel buffers into the descriptor set.
    pub fn bind_scene<'a>(&self, block: &Buffer, views: impl Iterator<Item = &'a TexelView>) {
        self.write(self.storage, vk::DescriptorType::UNIFORM_BUFFER, block);
        (self.storage + 1..).zip(views).for_each(|(binding, view)| self.write_texels(binding, view));
    }

    /// Puts the paths as texels into the descriptor set.
    pub fn bind_paths(&self, view: &TexelView) {
        self.write_texels(self.storage + 1 + TEXEL_VIEWS, view);
    }

    fn write_texels(&self, binding: u32, view: &TexelView) {
        let views = [view.raw];
        self.update(self.entry(binding, vk::DescriptorType::UNIFORM_TEXEL_BUFFER).texel_buffer_view(&views));
    }

    fn write(&self, binding: u32, ty: vk::DescriptorType, buffer: &Buffer) {
        let info = [vk::DescriptorBufferInfo { buffer: buffer.raw, offset: 0, range: buffer.size }];
        self.update(self.entry(binding, ty).buffer_info(&info));
    }

    fn entry(&self, binding: u32, ty: vk::DescriptorType) -> vk::WriteDescriptorSet<'_> {
        vk::WriteDescriptorSet::default().dst_set(self.set).dst_binding(binding).descriptor_type(ty).descriptor_count(1)
    }

    fn update(&self, write: vk::WriteDescriptorSet) {
        // SAFETY: the set is not in use: submissions are waited for before what it names changes.
        unsafe { self.device.raw.update_descriptor_sets(&[write], &[]) };
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        // SAFETY: pipelines of this layout are dropped by their owner before it, with the queue idle.
        unsafe {
            self.device.raw.destroy_pipeline_layout(self.raw, None);
            self.device.raw.destroy_descriptor_pool(self.pool, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// What a driver keeps of the pipelines that it has built, for all backends on a device.
pub(super) struct PipelineCache {
    pub raw: vk::PipelineCache,
    file: Option<PathBuf>,
}

impl PipelineCache {
    /// The cache of a device of this name, with what was saved last time. Whoever opens it closes it.
    pub fn open(d: &ash::Device, name: &str) -> Result<PipelineCache> {
        let file = cache_path(name);
        let saved = file.as_ref().and_then(|p| std::fs::read(p).ok()).unwrap_or_default();
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&saved);
        // SAFETY: `info` is complete. The driver checks the header of saved data and ignores what is not its own.
        let raw = unsafe { d.create_pipeline_cache(&info, None) }.map_err(vulkan("vkCreatePipelineCache"))?;
        Ok(PipelineCache { raw, file })
    }

    /// Saves and destroys it. A cache that cannot be saved costs time at the next start, nothing else.
    pub fn close(&self, d: &ash::Device) {
        // SAFETY: the cache belongs to this device.
        if let (Some(path), Ok(data)) = (&self.file, unsafe { d.get_pipeline_cache_data(self.raw) }) {
            let temporary = path.with_extension(std::process::id().to_string());
            let folder = path.parent().map(std::fs::create_dir_all);
            if folder.is_some_and(|f| f.is_ok()) && std::fs::write(&temporary, data).is_ok() {
                let _ = std::fs::rename(&temporary, path);
            }
        }
        // SAFETY: no pipeline is being built any more.
        unsafe { d.destroy_pipeline_cache(self.raw, None) };
    }
}

/// File of the pipeline cache, by driver.
fn cache_path(name: &str) -> Option<PathBuf> {
    let home = || std::env::var_os("HOME").map(|h| PathBuf::from(h).join(".cache"));
    let folder = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(home)?;
    let name: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    Some(folder.join("nullray").join(format!("pipelines-{name}.bin")))
}

/// A kernel ready to run.
pub struct Pipeline {
    device: Arc<Device>,
    /// Handle.
    pub raw: vk::Pipeline,
    /// Name of the kernel, for timings and errors.
    pub name: Arc<str>,
}

impl Pipeline {
    /// Builds the pipeline of a kernel from SPIR-V.
    pub fn new(device: &Arc<Device>, layout: &Layout, name: &str, code: &[u8]) -> Result<Pipeline> {
        Pipeline::specialized(device, layout, name, code, &[])
    }

    /// Builds the pipeline of a kernel with values for its specialisation constants 0, 1 and so on; a true one is 1.
    pub fn specialized(device: &Arc<Device>, layout: &Layout, name: &str, code: &[u8], constants: &[u32]) -> Result<Pipeline> {
        let words =
            ash::util::read_spv(&mut std::io::Cursor::new(code)).map_err(|e| Error::Vulkan { call: "read_spv", result: e.to_string() })?;
        let entries: Vec<_> = (0..constants.len() as u32)
            .map(|i| vk::SpecializationMapEntry::default().constant_id(i).offset(4 * i).size(size_of::<u32>()))
            .collect();
        let specialization = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(constants));
        // SAFETY: the words are SPIR-V from glslang; the module is destroyed once the pipeline exists.
        unsafe {
            let module = device
                .raw
                .create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&words), None)
                .map_err(vulkan("vkCreateShaderModule"))?;
            device.set_name(module, name);
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(c"main")
                .specialization_info(&specialization);
            let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout.raw)];
            let created = device.raw.create_compute_pipelines(device.pipeline_cache.raw, &info, None);
            device.raw.destroy_shader_module(module, None);
            let raw = created.map_err(|(_, e)| vulkan("vkCreateComputePipelines")(e))?[0];
            device.set_name(raw, name);
            Ok(Pipeline { device: device.clone(), raw, name: name.into() })
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: submissions that use the pipeline have been waited for.
        unsafe { self.device.raw.destroy_pipeline(self.raw, None) };
    }
}
