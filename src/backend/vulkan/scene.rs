//! A world in device memory: arrays that are fetched by texels, arrays that are reached by address, and a block of those addresses and the
//! parameters.

use super::buffer::{Buffer, TexelView};
use super::command::Commands;
use super::device::Device;
use super::pipeline::{Layout, TEXEL_VIEWS};
use crate::backend::Precision;
use crate::error::Result;
use crate::kernels::constants::MAX_GLOBALS;
use crate::kernels::layout::SceneParameters;
use crate::simd::Real;
use crate::world::World;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Bytes moved per transfer.
const STAGING: u64 = 32 << 20;

/// Bytes of a word of a texel buffer.
const WORD: usize = 16;

/// The arrays of a world and the block that `bindings.glsl` calls `SceneBlock`.
pub struct DeviceScene {
    /// What is fetched by texels, and what keeps that alive.
    fetched: Vec<(TexelView, Buffer)>,
    /// What the block points to.
    arrays: Vec<Buffer>,
    /// The end of the block: what is the same for all rays of a model.
    model: Vec<u8>,
    block: Buffer,
    staging: Buffer,
}

impl DeviceScene {
    /// Uploads a world.
    pub fn new(device: &Arc<Device>, commands: &mut Commands, world: &World, precision: Precision) -> Result<DeviceScene> {
        let _span = tracing::info_span!("upload", bytes = world.bytes()).entered();
        let mut staging = Buffer::new(device, "staging", STAGING, MemoryLocation::CpuToGpu)?;
        let (model, sources) = match precision {
            Precision::F32 => model_bytes::<f32>(world),
            Precision::F64 => model_bytes::<f64>(world),
        };
        let words = (vk::Format::R32G32B32A32_UINT, WORD as u64);
        let numbers = (vk::Format::R32_UINT, 4);
        let by_texel: [(&str, &[u8], (vk::Format, u64)); TEXEL_VIEWS as usize] = [
            ("nodes", bytemuck::cast_slice(&world.nodes), words),
            ("triangle blocks", bytemuck::cast_slice(&world.blocks), words),
            ("primitives", bytemuck::cast_slice(&world.primitives), words),
            ("clearance", &world.clearance, (vk::Format::R8_UINT, 1)),
            ("model", &sources, words),
            ("triangles", bytemuck::cast_slice(&world.triangles), words),
            ("vertices", bytemuck::cast_slice(&world.vertices), words),
            ("objects", bytemuck::cast_slice(&world.objects), numbers),
            ("materials", bytemuck::cast_slice(&world.materials), words),
            ("lights", bytemuck::cast_slice(&world.lights), words),
            ("apparent lights", bytemuck::cast_slice(&world.aims), words),
            ("albedo", bytemuck::cast_slice(&world.albedo), numbers),
        ];
        let by_address: [(&str, &[u8]); 5] = [
            ("textures", bytemuck::cast_slice(&world.textures)),
            ("texels", bytemuck::cast_slice(&world.texels)),
            ("environment distribution", bytemuck::cast_slice(&world.environment_cdf)),
            ("black bodies", bytemuck::cast_slice(&world.black_bodies)),
            ("disc profiles", bytemuck::cast_slice(&world.profiles)),
        ];
        let mut array = |name: &str, bytes: &[u8]| {
            // Whole words: the last vertex may end in the middle of one.
            let size = bytes.len().next_multiple_of(WORD) as u64;
            let buffer = Buffer::new(device, name, size, MemoryLocation::GpuOnly)?;
            upload(commands, &mut staging, &buffer, bytes)?;
            Ok(buffer)
        };
        let arrays = by_address.iter().map(|(name, bytes)| array(name, bytes)).collect::<Result<Vec<_>>>()?;
        let mut fetched = Vec::new();
        for (name, bytes, (format, size)) in by_texel {
            let buffer = array(name, bytes)?;
            fetched.push((TexelView::new(device, &buffer, format, size)?, buffer));
        }
        let size = (8 * arrays.len()).next_multiple_of(16) + size_of::<SceneParameters>().next_multiple_of(16) + model.len();
        let block = Buffer::new(device, "scene", size as u64, MemoryLocation::GpuOnly)?;
        let mut scene = DeviceScene { fetched, arrays, model, block, staging };
        scene.set_parameters(commands, &world.scene)?;
        Ok(scene)
    }

    /// Replaces everything that is not an array.
    pub fn set_parameters(&mut self, commands: &mut Commands, parameters: &SceneParameters) -> Result<()> {
        let mut bytes: Vec<u8> = self.arrays.iter().flat_map(|b| b.address().to_le_bytes()).collect();
        // A structure begins and ends at a multiple of the alignment of its vectors.
        bytes.resize(bytes.len().next_multiple_of(16), 0);
        bytes.extend_from_slice(bytemuck::bytes_of(parameters));
        bytes.resize(bytes.len().next_multiple_of(16), 0);
        bytes.extend_from_slice(&self.model);
        upload(commands, &mut self.staging, &self.block, &bytes)
    }

    /// Lets kernels read it.
    pub fn bind(&self, layout: &Layout) {
        layout.bind_scene(&self.block, self.fetched.iter().map(|(view, _)| view));
    }
}

/// The model in the precision of the integrator. For the block: how many sources, of how many words each, and the word that the table begins
/// with; then origin, step, throat, rim, parameters. For an array of its own: the sources, then the entries of the table, each of whole words.
fn model_bytes<T: Real>(world: &World) -> (Vec<u8>, Vec<u8>) {
    let block = world.model_block::<T>();
    let mut words = Vec::new();
    let stride = world.model.source_stride();
    for entry in block.sources.chunks(stride.max(1)).chain(block.table.chunks(3)) {
        words.extend_from_slice(bytemuck::cast_slice(entry));
        words.resize(words.len().next_multiple_of(WORD), 0);
    }
    let count = block.sources.len().checked_div(stride).unwrap_or(0);
    let source_words = (stride * size_of::<T>()).div_ceil(WORD);
    let head = [count, source_words, count * source_words, 0].map(|v| v as u32);
    let mut values: Vec<T> = block.origin.iter().chain([&block.step, &block.throat, &block.rim]).copied().collect();
    assert!(block.global.len() <= MAX_GLOBALS as usize, "MAX_GLOBALS holds the parameters of every model");
    values.extend(&block.global);
    values.resize((6 + MAX_GLOBALS) as usize, T::default());
    ([bytemuck::cast_slice(&head), bytemuck::cast_slice(&values)].concat(), words)
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
