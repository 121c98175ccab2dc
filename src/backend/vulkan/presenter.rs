//! Shows canvases and panels in a window.
//!
//! One frame is in flight: it is waited for before the next, and its canvas and textures are kept until then. Another thread
//! may render on the same device; it takes turns at the queue. A swapchain that no longer fits the window is made anew.

use super::canvas::{Canvas, CanvasPipeline};
use super::device::Device;
use super::instance::{Instance, vulkan};
use super::overlay::Overlay;
use super::swapchain::{Surface, Swapchain, Target, whole_image};
use crate::error::{Error, Result};
use ash::vk;
use std::sync::Arc;
use winit::raw_window_handle::{HandleError, HasDisplayHandle};
use winit::window::Window;

/// How often a frame is tried while the window keeps changing.
const ATTEMPTS: usize = 3;

/// What egui wants drawn.
pub struct Panels<'a> {
    /// Changes of textures since the last panels. They count even if no frame can be shown.
    pub textures: &'a egui::TexturesDelta,
    /// Triangles.
    pub primitives: &'a [egui::ClippedPrimitive],
    /// Pixels per unit of length.
    pub pixels_per_point: f32,
}

/// Draws to one window.
pub struct Presenter {
    overlay: Overlay,
    picture: CanvasPipeline,
    swapchain: Option<Swapchain>,
    /// Whether the swapchain does not fit the window.
    stale: bool,
    surface: Arc<Surface>,
    format: vk::Format,
    size: vk::Extent2D,
    /// Whether the last frame has not been waited for.
    in_flight: bool,
    /// Its canvas.
    shown: Option<Arc<Canvas>>,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    finished: vk::Fence,
    acquired: vk::Semaphore,
    window: Arc<Window>,
    instance: Arc<Instance>,
    device: Arc<Device>,
}

impl Presenter {
    /// Opens the best device that can draw to the window, or the one `wanted` names by number or part of its name.
    pub fn new(window: Arc<Window>, wanted: Option<&str>) -> Result<Presenter> {
        let no_display = |e: HandleError| Error::NoDevice { missing: format!("the window has no display: {e}") };
        let instance = Arc::new(Instance::for_display(window.display_handle().map_err(no_display)?.as_raw())?);
        let surface = Arc::new(Surface::new(&instance, &window)?);
        let device = Device::for_surface(instance.clone(), &surface, wanted)?;
        let format = surface.format(&device)?;
        let overlay = Overlay::new(&device, format)?;
        let picture = CanvasPipeline::new(&device, format)?;
        let d = &device.raw;
        let flags = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
        let pool_info = vk::CommandPoolCreateInfo::default().queue_family_index(device.queue_family).flags(flags);
        // SAFETY: every handle is created on this device from complete structures.
        let (pool, commands, finished, acquired) = unsafe {
            let pool = d.create_command_pool(&pool_info, None).map_err(vulkan("vkCreateCommandPool"))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = d.allocate_command_buffers(&info).map_err(vulkan("vkAllocateCommandBuffers"))?[0];
            let finished = d.create_fence(&vk::FenceCreateInfo::default(), None).map_err(vulkan("vkCreateFence"))?;
            let acquired = d.create_semaphore(&vk::SemaphoreCreateInfo::default(), None).map_err(vulkan("vkCreateSemaphore"))?;
            (pool, commands, finished, acquired)
        };
        device.set_name(pool, "present");
        device.set_name(commands, "present");
        device.set_name(finished, "frame finished");
        device.set_name(acquired, "image acquired");
        let size = window.inner_size();
        Ok(Presenter {
            overlay,
            picture,
            swapchain: None,
            stale: true,
            surface,
            format,
            size: vk::Extent2D { width: size.width, height: size.height },
            in_flight: false,
            shown: None,
            pool,
            commands,
            finished,
            acquired,
            window,
            instance,
            device,
        })
    }

    /// The device, for backends and canvases.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Takes the window's new size in pixels; without a size it is not drawn to.
    pub fn resize(&mut self, width: u32, height: u32) {
        self.size = vk::Extent2D { width, height };
        self.stale = true;
    }

    /// Shows a canvas stretched over the window, and panels on top; says whether they are shown.
    ///
    /// A window that cannot be seen or changes too fast goes without this frame.
    pub fn present(&mut self, canvas: Option<&Arc<Canvas>>, panels: Option<Panels<'_>>) -> Result<bool> {
        self.finish_frame()?;
        self.overlay.free_retired()?;
        if let Some(panels) = &panels {
            self.overlay.update(&self.device, self.pool, panels.textures)?;
        }
        let Some(index) = self.acquire()? else { return Ok(false) };
        let Some(swapchain) = &self.swapchain else { return Ok(false) };
        let (target, extent) = (swapchain.targets[index as usize], swapchain.extent);
        self.record(target, extent, canvas, panels.as_ref())?;
        self.submit(target)?;
        self.shown = canvas.cloned();
        self.show(index)
    }

    /// Waits for the last frame and lets go of what it used.
    fn finish_frame(&mut self) -> Result<()> {
        if !self.in_flight {
            return Ok(());
        }
        let fences = [self.finished];
        // SAFETY: the fence was handed to the last submission.
        unsafe {
            self.device.raw.wait_for_fences(&fences, true, u64::MAX).map_err(failed("vkWaitForFences"))?;
            self.device.raw.reset_fences(&fences).map_err(failed("vkResetFences"))?;
        }
        self.in_flight = false;
        self.shown = None;
        Ok(())
    }

    /// The number of the next image to draw to, if there is one.
    fn acquire(&mut self) -> Result<Option<u32>> {
        if self.size.width == 0 || self.size.height == 0 {
            return Ok(None);
        }
        for _ in 0..ATTEMPTS {
            if self.stale {
                self.renew_swapchain()?;
            }
            let Some(swapchain) = &self.swapchain else { return Ok(None) };
            match swapchain.acquire(self.acquired) {
                Ok((index, changed)) => {
                    self.stale = changed && !swapchain.fits();
                    return Ok(Some(index));
                }
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => self.stale = true,
                Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(None),
                Err(e) => return Err(failed("vkAcquireNextImageKHR")(e)),
            }
        }
        Ok(None)
    }

    /// Makes the swapchain anew, on a new surface if the old one is lost.
    fn renew_swapchain(&mut self) -> Result<()> {
        let old = self.swapchain.take();
        let mut made = Swapchain::new(&self.device, &self.surface, self.format, self.size, old);
        if matches!(made, Err(vk::Result::ERROR_SURFACE_LOST_KHR)) {
            self.surface = Arc::new(Surface::new(&self.instance, &self.window)?);
            made = Swapchain::new(&self.device, &self.surface, self.format, self.size, None);
        }
        self.swapchain = made.map_err(failed("vkCreateSwapchainKHR"))?;
        self.stale = self.swapchain.is_none();
        Ok(())
    }

    /// Records drawing a frame.
    fn record(&mut self, target: Target, extent: vk::Extent2D, canvas: Option<&Arc<Canvas>>, panels: Option<&Panels<'_>>) -> Result<()> {
        let d = &self.device.raw;
        // The canvas was written by another submission; the image is free once it has been acquired.
        let written = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
            .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::FRAGMENT_SHADER)
            .dst_access_mask(vk::AccessFlags2::SHADER_STORAGE_READ)];
        let drawing = vk::AccessFlags2::COLOR_ATTACHMENT_READ | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE;
        let at = vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(target.image)
            .subresource_range(whole_image());
        let before = [at
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .dst_stage_mask(vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT)
            .dst_access_mask(drawing)];
        let after = [at
            .old_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .new_layout(vk::ImageLayout::PRESENT_SRC_KHR)
            .src_access_mask(vk::AccessFlags2::COLOR_ATTACHMENT_WRITE)];
        let attachments = [vk::RenderingAttachmentInfo::default()
            .image_view(target.view)
            .image_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue { color: vk::ClearColorValue { float32: [0.0, 0.0, 0.0, 1.0] } })];
        let area = vk::Rect2D { offset: Default::default(), extent };
        let rendering = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&attachments);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the last frame was waited for, so the buffer is free to be recorded anew; the image has been acquired.
        unsafe {
            d.begin_command_buffer(self.commands, &begin).map_err(failed("vkBeginCommandBuffer"))?;
            d.cmd_pipeline_barrier2(self.commands, &vk::DependencyInfo::default().memory_barriers(&written).image_memory_barriers(&before));
            d.cmd_begin_rendering(self.commands, &rendering);
        }
        if let Some(canvas) = canvas {
            self.picture.draw(self.commands, canvas, extent);
        }
        if let Some(panels) = panels {
            self.overlay.draw(self.commands, extent, panels)?;
        }
        // SAFETY: as above.
        unsafe {
            d.cmd_end_rendering(self.commands);
            d.cmd_pipeline_barrier2(self.commands, &vk::DependencyInfo::default().image_memory_barriers(&after));
            d.end_command_buffer(self.commands).map_err(failed("vkEndCommandBuffer"))
        }
    }

    /// Submits the recorded frame.
    fn submit(&mut self, target: Target) -> Result<()> {
        let (waits, signals, buffers) = ([self.acquired], [target.drawn], [self.commands]);
        let stages = [vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT];
        let info = [vk::SubmitInfo::default()
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&buffers)
            .signal_semaphores(&signals)];
        // SAFETY: the recording is complete; nothing it uses is freed before the fence has signalled.
        unsafe { self.device.raw.queue_submit(*self.device.queue(), &info, self.finished) }.map_err(failed("vkQueueSubmit"))?;
        self.in_flight = true;
        Ok(())
    }

    /// Shows the submitted frame, unless the window has changed too much for it.
    fn show(&mut self, index: u32) -> Result<bool> {
        let Some(swapchain) = &self.swapchain else { return Ok(false) };
        self.window.pre_present_notify();
        let outcome = swapchain.present(*self.device.queue(), index);
        match outcome {
            Ok(changed) => {
                self.stale |= changed && !swapchain.fits();
                Ok(true)
            }
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.stale = true;
                Ok(false)
            }
            Err(e) => Err(failed("vkQueuePresentKHR")(e)),
        }
    }
}

/// The error of a call that shows frames.
fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    move |e| if e == vk::Result::ERROR_DEVICE_LOST { Error::DeviceLost { kernel: "present".into() } } else { vulkan(call)(e) }
}

impl Drop for Presenter {
    fn drop(&mut self) {
        // SAFETY: once the queue is idle the last frame is over.
        unsafe {
            let d = &self.device.raw;
            let _ = d.queue_wait_idle(*self.device.queue());
            d.destroy_semaphore(self.acquired, None);
            d.destroy_fence(self.finished, None);
            d.destroy_command_pool(self.pool, None);
        }
    }
}
