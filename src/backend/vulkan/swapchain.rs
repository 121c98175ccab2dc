//! The surface of a window and the chain of images shown on it.

use super::device::Device;
use super::instance::{Instance, vulkan};
use crate::error::{Error, Result};
use ash::prelude::VkResult;
use ash::{khr, vk};
use std::sync::Arc;
use winit::raw_window_handle::{HandleError, HasDisplayHandle, HasWindowHandle};
use winit::window::Window;

/// How long to wait for an image (nanoseconds): a picture of a slow screen. A compositor gives none for a window that cannot be seen.
const IMAGE_WAIT: u64 = 40_000_000;

/// Formats of images whose bytes are shown as they are.
const FORMATS: [vk::Format; 3] = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM, vk::Format::A8B8G8R8_UNORM_PACK32];

/// What Vulkan draws to in a window.
pub struct Surface {
    functions: khr::surface::Instance,
    raw: vk::SurfaceKHR,
    // Both must outlive the surface.
    _window: Arc<Window>,
    _instance: Arc<Instance>,
}

impl Surface {
    /// The surface of a window.
    pub fn new(instance: &Arc<Instance>, window: &Arc<Window>) -> Result<Surface> {
        let no_handle = |e: HandleError| Error::NoDevice { missing: format!("the window has nothing to draw to: {e}") };
        let display = window.display_handle().map_err(no_handle)?.as_raw();
        let handle = window.window_handle().map_err(no_handle)?.as_raw();
        // SAFETY: the window and its display live as long as the surface, which keeps the window.
        let raw = unsafe { ash_window::create_surface(&instance.entry, &instance.raw, display, handle, None) }
            .map_err(vulkan("vkCreateSurfaceKHR"))?;
        let functions = khr::surface::Instance::new(&instance.entry, &instance.raw);
        Ok(Surface { functions, raw, _window: window.clone(), _instance: instance.clone() })
    }

    /// Whether a queue family of a device presents here.
    pub(super) fn is_served_by(&self, device: vk::PhysicalDevice, family: u32) -> bool {
        // SAFETY: device and surface belong to one instance, and the device has this family.
        unsafe { self.functions.get_physical_device_surface_support(device, family, self.raw) }.unwrap_or(false)
    }

    /// Format of the images that are to be shown here.
    pub(super) fn format(&self, device: &Device) -> Result<vk::Format> {
        // SAFETY: device and surface belong to one instance.
        let offered = unsafe { self.functions.get_physical_device_surface_formats(device.report.handle, self.raw) }
            .map_err(vulkan("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        let is_offered =
            |wanted: &vk::Format| offered.iter().any(|o| o.format == *wanted && o.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR);
        let missing = || Error::NoDevice { missing: format!("{} offers the window no 8-bit UNORM colours", device.report.name) };
        FORMATS.into_iter().find(is_offered).ok_or_else(missing)
    }

    /// What images for the window must be like at the moment.
    fn limits(&self, device: &Device) -> VkResult<vk::SurfaceCapabilitiesKHR> {
        // SAFETY: device and surface belong to one instance.
        unsafe { self.functions.get_physical_device_surface_capabilities(device.report.handle, self.raw) }
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: swapchains hold an `Arc` of their surface, so none is left.
        unsafe { self.functions.destroy_surface(self.raw, None) };
    }
}

/// An image to be shown, and what is signalled when it has been drawn.
#[derive(Clone, Copy)]
pub(super) struct Target {
    pub image: vk::Image,
    pub view: vk::ImageView,
    pub drawn: vk::Semaphore,
}

/// The images of a surface in one size.
pub(super) struct Swapchain {
    functions: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    pub extent: vk::Extent2D,
    pub targets: Vec<Target>,
    device: Arc<Device>,
    surface: Arc<Surface>,
}

impl Swapchain {
    /// Images as large as the window, or as `wanted` where the window leaves that open, in place of the `old` ones of the same
    /// surface; none while the window has no size.
    pub fn new(
        device: &Arc<Device>,
        surface: &Arc<Surface>,
        format: vk::Format,
        wanted: vk::Extent2D,
        old: Option<Swapchain>,
    ) -> VkResult<Option<Swapchain>> {
        let limits = surface.limits(device)?;
        // SAFETY: device and surface belong to one instance.
        let modes = unsafe { surface.functions.get_physical_device_surface_present_modes(device.report.handle, surface.raw)? };
        let (least, most) = (limits.min_image_extent, limits.max_image_extent);
        let extent = match limits.current_extent {
            vk::Extent2D { width: u32::MAX, .. } => vk::Extent2D {
                width: wanted.width.max(least.width).min(most.width),
                height: wanted.height.max(least.height).min(most.height),
            },
            own => own,
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        // The newest picture replaces one that still waits, where that is offered; else pictures wait their turn.
        let newest = modes.contains(&vk::PresentModeKHR::MAILBOX);
        let blending =
            [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT, vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED];
        let blending = blending.into_iter().find(|&b| limits.supported_composite_alpha.contains(b));
        let most_images = if limits.max_image_count == 0 { u32::MAX } else { limits.max_image_count };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.raw)
            .min_image_count((limits.min_image_count + 1).min(most_images))
            .image_format(format)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(limits.current_transform)
            .composite_alpha(blending.unwrap_or(vk::CompositeAlphaFlagsKHR::OPAQUE))
            .present_mode(if newest { vk::PresentModeKHR::MAILBOX } else { vk::PresentModeKHR::FIFO })
            .clipped(true)
            .old_swapchain(old.as_ref().map_or(vk::SwapchainKHR::null(), |o| o.raw));
        let functions = khr::swapchain::Device::new(&device.instance.raw, &device.raw);
        // SAFETY: the surface has no other swapchain than the old one; `info` is complete.
        let raw = unsafe { functions.create_swapchain(&info, None)? };
        let mut swapchain = Swapchain { functions, raw, extent, targets: vec![], device: device.clone(), surface: surface.clone() };
        drop(old);
        device.set_name(raw, "window");
        swapchain.add_targets(format)?;
        Ok(Some(swapchain))
    }

    fn add_targets(&mut self, format: vk::Format) -> VkResult<()> {
        // SAFETY: the swapchain is alive; every handle is created on its device from complete structures.
        let images = unsafe { self.functions.get_swapchain_images(self.raw)? };
        for (i, image) in images.into_iter().enumerate() {
            let mut target = Target { image, view: vk::ImageView::null(), drawn: vk::Semaphore::null() };
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(whole_image());
            // SAFETY: as above.
            target.view = unsafe { self.device.raw.create_image_view(&info, None)? };
            self.targets.push(target);
            // SAFETY: as above.
            target.drawn = unsafe { self.device.raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None)? };
            self.targets[i] = target;
            self.device.set_name(image, &format!("window {i}"));
            self.device.set_name(target.view, &format!("window {i}"));
            self.device.set_name(target.drawn, &format!("window {i} drawn"));
        }
        Ok(())
    }

    /// The number of the next image to draw to, and whether the window has changed; `ready` is signalled when it is free.
    pub fn acquire(&self, ready: vk::Semaphore) -> VkResult<(u32, bool)> {
        // SAFETY: the last wait for `ready` is over, because the frame that waited for it is.
        unsafe { self.functions.acquire_next_image(self.raw, IMAGE_WAIT, ready, vk::Fence::null()) }
    }

    /// Whether its images are as large as the window, or the window leaves that open. Others that the window would like better
    /// are not worth a new swapchain in every frame.
    pub fn fits(&self) -> bool {
        let size = self.surface.limits(&self.device).map(|l| l.current_extent);
        size.is_ok_and(|size| size == self.extent || size.width == u32::MAX)
    }

    /// Shows an image once it is drawn; says whether the window has changed.
    pub fn present(&self, queue: vk::Queue, index: u32) -> VkResult<bool> {
        let (waits, swapchains, indices) = ([self.targets[index as usize].drawn], [self.raw], [index]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&swapchains).image_indices(&indices);
        // SAFETY: the caller holds the queue; the image was acquired and its drawing submitted.
        unsafe { self.functions.queue_present(queue, &info) }
    }
}

/// All of an image that is shown.
pub(super) fn whole_image() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange { aspect_mask: vk::ImageAspectFlags::COLOR, level_count: 1, layer_count: 1, ..Default::default() }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // SAFETY: once the queue is idle no image is drawn to and no semaphore waited for.
        unsafe {
            let d = &self.device.raw;
            let _ = d.queue_wait_idle(*self.device.queue());
            for target in &self.targets {
                d.destroy_semaphore(target.drawn, None);
                d.destroy_image_view(target.view, None);
            }
            self.functions.destroy_swapchain(self.raw, None);
        }
    }
}
