//! The film in device memory: sums, values of the first sample, and how many samples each row has.

use super::buffer::Buffer;
use super::canvas::Canvas;
use super::command::Commands;
use super::device::Device;
use super::pipeline::{Layout, Pipeline};
use super::scene::download;
use crate::error::Result;
use crate::film::develop::tone_number;
use crate::film::{Development, Film, PixelSum, Statistics};
use crate::kernels::constants::WORKGROUP_SIZE;
use crate::kernels::layout::Aov;
use bytemuck::{Pod, Zeroable};
use gpu_allocator::MemoryLocation;
use std::ops::Range;
use std::sync::Arc;

/// Most workgroups of a dispatch everywhere.
const MAX_GROUPS: u32 = 65535;

/// Push constants of `develop.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct DevelopPush {
    sums: u64,
    aovs: u64,
    row_counts: u64,
    canvas: u64,
    width: u32,
    height: u32,
    first_column: u32,
    column_count: u32,
    channel: u32,
    curve: u32,
    gain: f32,
    stride: u32,
}

/// A picture in the making. Its memory grows with it and does not shrink.
pub struct DeviceFilm {
    /// Fixed-point sums of every pixel.
    pub sums: Buffer,
    /// Values of the first sample of every pixel.
    pub aovs: Buffer,
    /// Index of that sample.
    pub first_sample: u32,
    /// What happened to rays and samples.
    pub statistics: Statistics,
    width: u32,
    /// Samples in each row.
    counts: Vec<u32>,
    /// The same, for shaders.
    row_counts: Buffer,
    device: Arc<Device>,
}

impl DeviceFilm {
    /// A film without pixels; `restart` gives it a size.
    pub fn new(device: &Arc<Device>) -> Result<DeviceFilm> {
        Ok(DeviceFilm {
            sums: Buffer::new(device, "film sums", 0, MemoryLocation::GpuOnly)?,
            aovs: Buffer::new(device, "film aovs", 0, MemoryLocation::GpuOnly)?,
            first_sample: 0,
            statistics: Statistics::default(),
            width: 0,
            counts: vec![],
            row_counts: Buffer::new(device, "film rows", 0, MemoryLocation::CpuToGpu)?,
            device: device.clone(),
        })
    }

    /// Empties the film and gives it a size.
    pub fn restart(&mut self, commands: &mut Commands, width: u32, height: u32) -> Result<()> {
        let pixels = u64::from(width) * u64::from(height);
        let (sums, aovs) = (pixels * size_of::<PixelSum>() as u64, pixels * size_of::<Aov>() as u64);
        let parts = [
            (&mut self.sums, "film sums", sums, MemoryLocation::GpuOnly),
            (&mut self.aovs, "film aovs", aovs, MemoryLocation::GpuOnly),
            (&mut self.row_counts, "film rows", u64::from(height) * 4, MemoryLocation::CpuToGpu),
        ];
        let mut larger = Vec::new();
        for (buffer, name, size, location) in parts {
            if buffer.size < size {
                larger.push((buffer, Buffer::new(&self.device, name, size, location)?));
            }
        }
        // The film stays as it was unless there is memory for all of it.
        for (buffer, new) in larger {
            *buffer = new;
        }
        self.width = width;
        self.counts.clear();
        self.counts.resize(height as usize, 0);
        self.statistics = Statistics::default();
        commands.begin()?;
        commands.clear_range(&self.sums, 0, sums);
        commands.clear_range(&self.aovs, 0, aovs);
        commands.barrier();
        commands.submit()
    }

    /// Notes that all pixels of `rows` have so many samples more.
    pub fn count(&mut self, rows: Range<u32>, samples: u32) {
        self.counts[rows.start as usize..rows.end as usize].iter_mut().for_each(|c| *c += samples);
    }

    /// A film of this size on the host, without samples.
    pub fn empty(&self) -> Film {
        Film::new(self.width, self.counts.len() as u32, self.first_sample)
    }

    /// The film on the host.
    pub fn read(&self, commands: &mut Commands, readback: &mut Buffer) -> Result<Film> {
        let mut film = self.empty();
        let pixels = film.sums.len() as u64;
        let sums = download(commands, readback, &self.sums, 0, pixels * size_of::<PixelSum>() as u64)?;
        bytemuck::cast_slice_mut::<_, u8>(&mut film.sums).copy_from_slice(&sums);
        let aovs = download(commands, readback, &self.aovs, 0, pixels * size_of::<Aov>() as u64)?;
        bytemuck::cast_slice_mut::<_, u8>(&mut film.aovs).copy_from_slice(&aovs);
        for (row, &count) in film.counts.chunks_exact_mut(self.width.max(1) as usize).zip(&self.counts) {
            row.fill(count);
        }
        film.statistics = self.statistics;
        Ok(film)
    }

    /// Develops columns of the film into a canvas of its size.
    pub fn develop(
        &mut self,
        commands: &mut Commands,
        layout: &Layout,
        kernel: &Pipeline,
        development: &Development,
        canvas: &mut Canvas,
    ) -> Result<()> {
        let height = self.counts.len() as u32;
        canvas.expect_size(self.width, height)?;
        let columns = development.columns_within(self.width);
        let groups = ((columns.end - columns.start) * height).div_ceil(WORKGROUP_SIZE).min(MAX_GROUPS);
        if groups == 0 {
            return Ok(());
        }
        let counts: &[u8] = bytemuck::cast_slice(&self.counts);
        self.row_counts.mapped()?[..counts.len()].copy_from_slice(counts);
        let push = DevelopPush {
            sums: self.sums.address(),
            aovs: self.aovs.address(),
            row_counts: self.row_counts.address(),
            canvas: canvas.address(),
            width: self.width,
            height,
            first_column: columns.start,
            column_count: columns.end - columns.start,
            channel: development.channel as u32,
            curve: tone_number(development.tone_map),
            gain: development.gain(),
            stride: groups * WORKGROUP_SIZE,
        };
        commands.begin()?;
        commands.barrier();
        commands.dispatch(layout, kernel, bytemuck::bytes_of(&push), groups);
        commands.submit()
    }
}
