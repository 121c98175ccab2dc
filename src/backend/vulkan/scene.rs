//! A world in device memory, reached from one block of addresses and parameters.

use super::buffer::Buffer;
use super::command::Commands;
use super::device::Device;
use crate::backend::Precision;
use crate::error::Result;
use crate::kernels::constants::{TABLE_COLUMNS, TABLE_ROWS};
use crate::kernels::layout::SceneParameters;
use crate::simd::Real;
use crate::world::World;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Bytes moved per transfer.
const STAGING: u64 = 32 << 20;

/// The arrays of a world and the block that `bindings.glsl` calls `Scene`.
pub struct DeviceScene {
    /// Keeps what the block points to alive.
    arrays: Vec<Buffer>,
    block: Buffer,
    staging: Buffer,
}

impl DeviceScene {
    /// Uploads a world.
    pub fn new(device: &Arc<Device>, commands: &mut Commands, world: &World, precision: Precision) -> Result<DeviceScene> {
        let _span = tracing::info_span!("upload", bytes = world.bytes()).entered();
        let mut staging = Buffer::new(device, "staging", STAGING, MemoryLocation::CpuToGpu)?;
        let model = match precision {
            Precision::F32 => model_bytes::<f32>(world),
            Precision::F64 => model_bytes::<f64>(world),
        };
        let clearance: Vec<u8> = world.clearance.iter().copied().chain([0; 3]).collect();
        let contents: [(&str, &[u8]); 16] = [
            ("nodes", bytemuck::cast_slice(&world.nodes)),
            ("triangle blocks", bytemuck::cast_slice(&world.blocks)),
            ("triangles", bytemuck::cast_slice(&world.triangles)),
            ("vertices", bytemuck::cast_slice(&world.vertices)),
            ("primitives", bytemuck::cast_slice(&world.primitives)),
            ("objects", bytemuck::cast_slice(&world.objects)),
            ("materials", bytemuck::cast_slice(&world.materials)),
            ("textures", bytemuck::cast_slice(&world.textures)),
            ("texels", bytemuck::cast_slice(&world.texels)),
            ("lights", bytemuck::cast_slice(&world.lights)),
            ("environment distribution", bytemuck::cast_slice(&world.environment_cdf)),
            ("clearance", &clearance[..clearance.len() & !3]),
            ("albedo", bytemuck::cast_slice(&world.albedo)),
            ("black bodies", bytemuck::cast_slice(&world.black_bodies)),
            ("disc profiles", bytemuck::cast_slice(&world.profiles)),
            ("model", &model),
        ];
        let mut arrays = Vec::new();
        for (name, bytes) in contents {
            let buffer = Buffer::new(device, name, bytes.len() as u64, MemoryLocation::GpuOnly)?;
            upload(commands, &mut staging, &buffer, bytes)?;
            arrays.push(buffer);
        }
        let size = 8 * arrays.len() + size_of::<SceneParameters>();
        let block = Buffer::new(device, "scene", size as u64, MemoryLocation::GpuOnly)?;
        let mut scene = DeviceScene { arrays, block, staging };
        scene.set_parameters(commands, &world.scene)?;
        Ok(scene)
    }

    /// Replaces everything that is not an array.
    pub fn set_parameters(&mut self, commands: &mut Commands, parameters: &SceneParameters) -> Result<()> {
        let mut bytes: Vec<u8> = self.arrays.iter().flat_map(|b| b.address().to_le_bytes()).collect();
        bytes.extend_from_slice(bytemuck::bytes_of(parameters));
        upload(commands, &mut self.staging, &self.block, &bytes)
    }

    /// Address of the block.
    pub fn address(&self) -> u64 {
        self.block.address()
    }
}

/// Where parts begin, then origin, step, throat, rim, tableau, parameters and sources in the precision of the integrator.
fn model_bytes<T: Real>(world: &World) -> Vec<u8> {
    let block = world.model_block::<T>();
    let stride = world.model.source_stride();
    let count = block.sources.len().checked_div(stride).unwrap_or(0);
    let mut values: Vec<T> = block.origin.iter().chain([&block.step, &block.throat, &block.rim]).chain(&block.tableau).copied().collect();
    let global_start = values.len();
    values.extend(&block.global);
    let source_start = values.len();
    values.extend(&block.sources);
    let table_start = values.len();
    values.extend(&block.table);
    let (rows, columns) = (TABLE_ROWS as usize, TABLE_COLUMNS as usize);
    let header = [count, stride, source_start, global_start, table_start, rows, columns, values.len()].map(|v| v as u32);
    let mut bytes = bytemuck::cast_slice(&header).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&values));
    bytes
}

/// Copies bytes to the start of a buffer, a piece at a time.
pub fn upload(commands: &mut Commands, staging: &mut Buffer, to: &Buffer, bytes: &[u8]) -> Result<()> {
    upload_at(commands, staging, to, 0, bytes)
}

/// Copies bytes to `offset` of a buffer, a piece at a time.
pub fn upload_at(commands: &mut Commands, staging: &mut Buffer, to: &Buffer, offset: u64, bytes: &[u8]) -> Result<()> {
    for (i, piece) in bytes.chunks(staging.size as usize).enumerate() {
        staging.mapped()?[..piece.len()].copy_from_slice(piece);
        commands.begin()?;
        commands.copy(staging, 0, to, offset + i as u64 * staging.size, piece.len() as u64);
        commands.barrier();
        commands.submit()?;
    }
    Ok(())
}

/// Reads `size` bytes from `offset` of a buffer, a piece at a time.
pub fn download(commands: &mut Commands, readback: &mut Buffer, from: &Buffer, offset: u64, size: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(size as usize);
    while (bytes.len() as u64) < size {
        let piece = (size - bytes.len() as u64).min(readback.size);
        commands.begin()?;
        commands.barrier();
        commands.copy(from, offset + bytes.len() as u64, readback, 0, piece);
        commands.submit()?;
        bytes.extend_from_slice(&readback.mapped()?[..piece as usize]);
    }
    Ok(bytes)
}
