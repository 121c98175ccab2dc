//! Buffers and the memory they live in.

use super::device::Device;
use super::instance::vulkan;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// A buffer with its own memory.
pub struct Buffer {
    device: Arc<Device>,
    /// Handle.
    pub raw: vk::Buffer,
    /// Size in bytes.
    pub size: u64,
    allocation: Option<Allocation>,
}

impl Buffer {
    /// A buffer of at least 16 bytes for storage, uniform blocks, texel views, transfers, indirect arguments and access by address.
    pub fn new(device: &Arc<Device>, name: &str, size: u64, location: MemoryLocation) -> Result<Buffer> {
        let size = size.max(16);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: the device is alive and `info` is complete.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.map_err(vulkan("vkCreateBuffer"))?;
        let mut buffer = Buffer { device: device.clone(), raw, size, allocation: None };
        // SAFETY: `raw` was just created on this device.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let allocation = device
            .allocator()
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location,
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|_| Error::OutOfMemory { what: name.into(), bytes: size })?;
        // SAFETY: the memory fits the requirements and is bound once.
        let bound = unsafe { device.raw.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) };
        buffer.allocation = Some(allocation);
        bound.map_err(vulkan("vkBindBufferMemory"))?;
        device.set_name(raw, name);
        Ok(buffer)
    }

    /// Address for shaders.
    pub fn address(&self) -> u64 {
        // SAFETY: the buffer was created with SHADER_DEVICE_ADDRESS and is bound.
        unsafe { self.device.raw.get_buffer_device_address(&vk::BufferDeviceAddressInfo::default().buffer(self.raw)) }
    }

    /// The bytes of a buffer the host can see.
    pub fn mapped(&mut self) -> Result<&mut [u8]> {
        self.allocation
            .as_mut()
            .and_then(Allocation::mapped_slice_mut)
            .ok_or(Error::Vulkan { call: "vkMapMemory", result: "the memory is not visible to the host".into() })
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if let Some(allocation) = self.allocation.take() {
            // Freeing can only fail for an allocation of another allocator.
            let _ = self.device.allocator().free(allocation);
        }
        // SAFETY: whoever owns the buffer has waited for the submissions that use it.
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
    }
}

/// A buffer as an array of texels.
pub struct TexelView {
    device: Arc<Device>,
    /// Handle.
    pub raw: vk::BufferView,
}

impl TexelView {
    /// All of `buffer` as texels of `format`, which take `size` bytes each.
    pub fn new(device: &Arc<Device>, buffer: &Buffer, format: vk::Format, size: u64) -> Result<TexelView> {
        let (texels, most) = (buffer.size / size, u64::from(device.report.max_texel_buffer_elements));
        if texels > most {
            return Err(Error::World(format!(
                "the scene needs an array of {texels} texels, expected at most the {most} of {}",
                device.report.name
            )));
        }
        let info = vk::BufferViewCreateInfo::default().buffer(buffer.raw).format(format).range(vk::WHOLE_SIZE);
        // SAFETY: the buffer was created on this device for texel views, and is bound.
        let raw = unsafe { device.raw.create_buffer_view(&info, None) }.map_err(vulkan("vkCreateBufferView"))?;
        Ok(TexelView { device: device.clone(), raw })
    }
}

impl Drop for TexelView {
    fn drop(&mut self) {
        // SAFETY: whoever owns the view has waited for the submissions that use it.
        unsafe { self.device.raw.destroy_buffer_view(self.raw, None) };
    }
}
