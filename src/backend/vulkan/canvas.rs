//! A developed picture in device memory, and the pipeline that draws it over a window.

use super::buffer::Buffer;
use super::device::Device;
use super::instance::vulkan;
use super::pipeline::kernel_spirv;
use crate::error::{Error, Result};
use ash::vk;
use bytemuck::{Pod, Zeroable};
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// A picture of 8-bit sRGB, RGBA, rows from the top, that shaders reach by its address.
pub struct Canvas {
    buffer: Buffer,
    width: u32,
    height: u32,
}

impl Canvas {
    /// A canvas of at least one pixel; a device develops into it, or the host if it is visible there.
    pub fn new(device: &Arc<Device>, width: u32, height: u32, host_visible: bool) -> Result<Canvas> {
        Canvas::at(device, width, height, if host_visible { MemoryLocation::CpuToGpu } else { MemoryLocation::GpuOnly })
    }

    /// A canvas whose pixels the host reads, whoever develops into it.
    pub fn for_reading(device: &Arc<Device>, width: u32, height: u32) -> Result<Canvas> {
        Canvas::at(device, width, height, MemoryLocation::GpuToCpu)
    }

    fn at(device: &Arc<Device>, width: u32, height: u32, location: MemoryLocation) -> Result<Canvas> {
        let (width, height) = (width.max(1), height.max(1));
        let buffer = Buffer::new(device, "canvas", u64::from(width) * u64::from(height) * 4, location)?;
        Ok(Canvas { buffer, width, height })
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Address for shaders.
    pub fn address(&self) -> u64 {
        self.buffer.address()
    }

    /// The pixels of a canvas the host can see.
    pub fn pixels_mut(&mut self) -> Result<&mut [[u8; 4]]> {
        let size = self.width as usize * self.height as usize * 4;
        Ok(bytemuck::cast_slice_mut(&mut self.buffer.mapped()?[..size]))
    }

    /// Refuses a film of another size.
    pub fn expect_size(&self, width: u32, height: u32) -> Result<()> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(Error::World(format!("a film of {width} x {height} pixels does not fit a canvas of {} x {}", self.width, self.height)))
    }
}

/// Push constants of `present.frag`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct DrawPush {
    canvas: u64,
    canvas_size: [u32; 2],
    window_size: [u32; 2],
}

/// Draws a canvas over all of a window.
pub(super) struct CanvasPipeline {
    device: Arc<Device>,
    layout: vk::PipelineLayout,
    raw: vk::Pipeline,
}

impl CanvasPipeline {
    /// A pipeline for images of a format.
    pub fn new(device: &Arc<Device>, format: vk::Format) -> Result<CanvasPipeline> {
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::FRAGMENT).size(size_of::<DrawPush>() as u32)];
        let info = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&push);
        // SAFETY: the device is alive and `info` is complete.
        let layout = unsafe { device.raw.create_pipeline_layout(&info, None) }.map_err(vulkan("vkCreatePipelineLayout"))?;
        let mut pipeline = CanvasPipeline { device: device.clone(), layout, raw: vk::Pipeline::null() };
        let vertex = Module::new(device, "present.vert")?;
        let fragment = Module::new(device, "present.frag")?;
        pipeline.raw = pipeline.build(&vertex, &fragment, format)?;
        device.set_name(pipeline.layout, "present");
        device.set_name(pipeline.raw, "present");
        Ok(pipeline)
    }

    fn build(&self, vertex: &Module, fragment: &Module, format: vk::Format) -> Result<vk::Pipeline> {
        let stage = |module: &Module, stage| vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module.raw).name(c"main");
        let stages = [stage(vertex, vk::ShaderStageFlags::VERTEX), stage(fragment, vk::ShaderStageFlags::FRAGMENT)];
        let vertex_input = vk::PipelineVertexInputStateCreateInfo::default();
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let multisample = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let targets = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&targets);
        let dynamic_states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic_states);
        let formats = [format];
        let mut rendering = vk::PipelineRenderingCreateInfo::default().color_attachment_formats(&formats);
        let info = [vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&vertex_input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&multisample)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(self.layout)
            .push_next(&mut rendering)];
        // SAFETY: everything `info` points to lives until the call returns.
        let created = unsafe { self.device.raw.create_graphics_pipelines(vk::PipelineCache::null(), &info, None) };
        Ok(created.map_err(|(_, e)| vulkan("vkCreateGraphicsPipelines")(e))?[0])
    }

    /// Records drawing a canvas over a window of `extent`.
    pub fn draw(&self, commands: vk::CommandBuffer, canvas: &Canvas, extent: vk::Extent2D) {
        let push =
            DrawPush { canvas: canvas.address(), canvas_size: [canvas.width, canvas.height], window_size: [extent.width, extent.height] };
        let viewport = [vk::Viewport { width: extent.width as f32, height: extent.height as f32, max_depth: 1.0, ..Default::default() }];
        let scissor = [vk::Rect2D { offset: Default::default(), extent }];
        let d = &self.device.raw;
        // SAFETY: the commands are being recorded inside a rendering; the caller keeps the canvas until they have run.
        unsafe {
            d.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, self.raw);
            d.cmd_set_viewport(commands, 0, &viewport);
            d.cmd_set_scissor(commands, 0, &scissor);
            d.cmd_push_constants(commands, self.layout, vk::ShaderStageFlags::FRAGMENT, 0, bytemuck::bytes_of(&push));
            d.cmd_draw(commands, 3, 1, 0, 0);
        }
    }
}

impl Drop for CanvasPipeline {
    fn drop(&mut self) {
        // SAFETY: the frames that use the pipeline have been waited for.
        unsafe {
            self.device.raw.destroy_pipeline(self.raw, None);
            self.device.raw.destroy_pipeline_layout(self.layout, None);
        }
    }
}

/// A shader while its pipeline is built.
struct Module<'a> {
    device: &'a Device,
    raw: vk::ShaderModule,
}

impl<'a> Module<'a> {
    fn new(device: &'a Device, name: &str) -> Result<Module<'a>> {
        let code = kernel_spirv(name).ok_or_else(|| Error::Vulkan { call: "kernel_spirv", result: format!("no shader `{name}`") })?;
        let words =
            ash::util::read_spv(&mut std::io::Cursor::new(code)).map_err(|e| Error::Vulkan { call: "read_spv", result: e.to_string() })?;
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are SPIR-V from glslang.
        let raw = unsafe { device.raw.create_shader_module(&info, None) }.map_err(vulkan("vkCreateShaderModule"))?;
        Ok(Module { device, raw })
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: a pipeline keeps what it needs of its modules.
        unsafe { self.device.raw.destroy_shader_module(self.raw, None) };
    }
}
