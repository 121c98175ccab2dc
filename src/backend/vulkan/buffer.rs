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
    /// A buffer of at least 16 bytes for storage, transfers, indirect arguments and access by address.
    pub fn new(device: &Arc<Device>, name: &str, size: u64, location: MemoryLocation) -> Result<Buffer> {
        let size = size.max(16);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
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
