//! Recording and submission of commands, with a timestamp round every dispatch.

use super::buffer::Buffer;
use super::device::Device;
use super::instance::vulkan;
use super::pipeline::{Layout, Pipeline};
use crate::backend::timing::{Dispatch, Profiling, Recorder, RoundCounts, Submission, Timings, now};
use crate::error::{Error, Result};
use ash::vk;
use std::sync::Arc;

/// Timestamps of one submission.
const MAX_QUERIES: u32 = 1024;
/// All ways in which commands write.
const WRITES: vk::AccessFlags =
    vk::AccessFlags::from_raw(vk::AccessFlags::SHADER_WRITE.as_raw() | vk::AccessFlags::TRANSFER_WRITE.as_raw());

/// One command buffer that is recorded, submitted and waited for, again and again.
pub struct Commands {
    device: Arc<Device>,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    fence: vk::Fence,
    queries: vk::QueryPool,
    /// Kernel and round of each pair of timestamps in the recording.
    timed: Vec<(Arc<str>, Option<u32>)>,
    /// Round that dispatches are recorded in.
    round: Option<u32>,
    /// When the recording began.
    begun: u64,
    recorder: Recorder,
    in_flight: String,
}

impl Commands {
    /// An empty recorder.
    pub fn new(device: &Arc<Device>) -> Result<Commands> {
        let d = &device.raw;
        // SAFETY: every handle is created on this device from complete structures.
        unsafe {
            let flags = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
            let pool = d
                .create_command_pool(&vk::CommandPoolCreateInfo::default().queue_family_index(device.queue_family).flags(flags), None)
                .map_err(vulkan("vkCreateCommandPool"))?;
            let info =
                vk::CommandBufferAllocateInfo::default().command_pool(pool).level(vk::CommandBufferLevel::PRIMARY).command_buffer_count(1);
            let buffer = d.allocate_command_buffers(&info).map_err(vulkan("vkAllocateCommandBuffers"))?[0];
            let fence = d.create_fence(&vk::FenceCreateInfo::default(), None).map_err(vulkan("vkCreateFence"))?;
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(MAX_QUERIES);
            let queries = d.create_query_pool(&info, None).map_err(vulkan("vkCreateQueryPool"))?;
            device.set_name(pool, "command pool");
            device.set_name(buffer, "commands");
            device.set_name(fence, "submission");
            device.set_name(queries, "timestamps");
            Ok(Commands {
                device: device.clone(),
                pool,
                buffer,
                fence,
                queries,
                timed: vec![],
                round: None,
                begun: 0,
                recorder: Recorder::new("queue", 1),
                in_flight: String::new(),
            })
        }
    }

    /// Starts a recording.
    pub fn begin(&mut self) -> Result<()> {
        self.begun = now();
        self.round = None;
        self.timed.clear();
        self.in_flight.clear();
        let d = &self.device.raw;
        // SAFETY: the last submission was waited for, so the buffer is free to be recorded anew.
        unsafe {
            let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            d.begin_command_buffer(self.buffer, &info).map_err(vulkan("vkBeginCommandBuffer"))?;
            if self.device.report.timestamps {
                d.cmd_reset_query_pool(self.buffer, self.queries, 0, MAX_QUERIES);
            }
        }
        Ok(())
    }

    /// Starts a round: what is dispatched until its end is recorded under its number.
    pub fn begin_round(&mut self, round: u32) {
        self.round = Some(round);
        self.device.begin_label(self.buffer, &format!("round {round}"));
    }

    /// Ends a round.
    pub fn end_round(&mut self) {
        self.round = None;
        self.device.end_label(self.buffer);
    }

    /// Makes all that was written visible to all that follows.
    pub fn barrier(&self) {
        let stages = vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER | vk::PipelineStageFlags::DRAW_INDIRECT;
        let reads = vk::AccessFlags::SHADER_READ
            | vk::AccessFlags::UNIFORM_READ
            | vk::AccessFlags::TRANSFER_READ
            | vk::AccessFlags::INDIRECT_COMMAND_READ;
        self.barrier_before(stages, reads | WRITES);
    }

    /// Makes all that was written visible to `accesses` of later `stages`.
    fn barrier_before(&self, stages: vk::PipelineStageFlags, accesses: vk::AccessFlags) {
        let d = &self.device.raw;
        let writers = vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER;
        // SAFETY: a global memory barrier names no resource.
        unsafe {
            if self.device.report.synchronization2 {
                // The flags that there were before mean the same.
                let stage = |flags: vk::PipelineStageFlags| vk::PipelineStageFlags2::from_raw(flags.as_raw().into());
                let access = |flags: vk::AccessFlags| vk::AccessFlags2::from_raw(flags.as_raw().into());
                let barrier = [vk::MemoryBarrier2::default()
                    .src_stage_mask(stage(writers))
                    .src_access_mask(access(WRITES))
                    .dst_stage_mask(stage(stages))
                    .dst_access_mask(access(accesses))];
                d.cmd_pipeline_barrier2(self.buffer, &vk::DependencyInfo::default().memory_barriers(&barrier));
            } else {
                let barrier = [vk::MemoryBarrier::default().src_access_mask(WRITES).dst_access_mask(accesses)];
                d.cmd_pipeline_barrier(self.buffer, writers, stages, Default::default(), &barrier, &[], &[]);
            }
        }
    }

    /// Records a dispatch of `groups` workgroups, timed under the kernel's name.
    pub fn dispatch(&mut self, layout: &Layout, pipeline: &Pipeline, push: &[u8], groups: u32) {
        self.timed_dispatch(layout, pipeline, push, |d, buffer| {
            // SAFETY: pipeline, set and push constants are bound by `timed_dispatch`.
            unsafe { d.cmd_dispatch(buffer, groups, 1, 1) }
        });
    }

    /// Records a dispatch whose workgroups are read from `arguments` at byte `offset`.
    pub fn dispatch_indirect(&mut self, layout: &Layout, pipeline: &Pipeline, push: &[u8], arguments: &Buffer, offset: u64) {
        let arguments = arguments.raw;
        self.timed_dispatch(layout, pipeline, push, |d, buffer| {
            // SAFETY: as above; the arguments were written before the last barrier.
            unsafe { d.cmd_dispatch_indirect(buffer, arguments, offset) }
        });
    }

    fn timed_dispatch(&mut self, layout: &Layout, pipeline: &Pipeline, push: &[u8], run: impl Fn(&ash::Device, vk::CommandBuffer)) {
        let d = &self.device.raw;
        let query = 2 * self.timed.len() as u32;
        let timed = self.device.report.timestamps && query + 2 <= MAX_QUERIES;
        self.device.begin_label(self.buffer, &pipeline.name);
        // SAFETY: all handles belong to this device and live until the submission has been waited for.
        unsafe {
            d.cmd_bind_pipeline(self.buffer, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
            d.cmd_bind_descriptor_sets(self.buffer, vk::PipelineBindPoint::COMPUTE, layout.raw, 0, &[layout.set], &[]);
            d.cmd_push_constants(self.buffer, layout.raw, vk::ShaderStageFlags::COMPUTE, 0, push);
            if timed {
                d.cmd_write_timestamp(self.buffer, vk::PipelineStageFlags::COMPUTE_SHADER, self.queries, query);
            }
            run(d, self.buffer);
            if timed {
                d.cmd_write_timestamp(self.buffer, vk::PipelineStageFlags::COMPUTE_SHADER, self.queries, query + 1);
            }
        }
        self.device.end_label(self.buffer);
        if timed {
            self.timed.push((pipeline.name.clone(), self.round));
        } else {
            self.recorder.lose(&pipeline.name);
        }
        if !self.in_flight.contains(&*pipeline.name) {
            self.in_flight += if self.in_flight.is_empty() { "" } else { ", " };
            self.in_flight += &pipeline.name;
        }
    }

    /// Records a copy between buffers.
    pub fn copy(&self, from: &Buffer, from_offset: u64, to: &Buffer, to_offset: u64, size: u64) {
        let region = [vk::BufferCopy { src_offset: from_offset, dst_offset: to_offset, size }];
        // SAFETY: callers keep the ranges inside the buffers, which live until the submission has been waited for.
        unsafe { self.device.raw.cmd_copy_buffer(self.buffer, from.raw, to.raw, &region) };
    }

    /// Records zeroing a whole buffer.
    pub fn clear(&self, buffer: &Buffer) {
        self.clear_range(buffer, 0, buffer.size & !3);
    }

    /// Records zeroing `size` bytes of a buffer from byte `offset`, both multiples of 4.
    pub fn clear_range(&self, buffer: &Buffer, offset: u64, size: u64) {
        // SAFETY: callers keep the range inside the buffer, which lives until the submission has been waited for.
        unsafe { self.device.raw.cmd_fill_buffer(self.buffer, buffer.raw, offset, size, 0) };
    }

    /// Submits the recording, waits for it, and takes its times.
    pub fn submit(&mut self) -> Result<()> {
        let lost = |call: &'static str, kernel: &str| {
            let kernel = kernel.to_owned();
            move |e: vk::Result| if e == vk::Result::ERROR_DEVICE_LOST { Error::DeviceLost { kernel } } else { vulkan(call)(e) }
        };
        let _span = tracing::trace_span!("submission", kernels = %self.in_flight).entered();
        // The host reads once the fence has signalled, which alone does not make writes visible to it.
        self.barrier_before(vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ);
        let d = &self.device.raw;
        let buffers = [self.buffer];
        let info = [vk::SubmitInfo::default().command_buffers(&buffers)];
        let fences = [self.fence];
        // SAFETY: the recording is complete; nothing it uses is freed before the fence has signalled.
        let (submitted, done) = unsafe {
            d.end_command_buffer(self.buffer).map_err(vulkan("vkEndCommandBuffer"))?;
            d.queue_submit(*self.device.queue(), &info, self.fence).map_err(lost("vkQueueSubmit", &self.in_flight))?;
            let submitted = now();
            d.wait_for_fences(&fences, true, u64::MAX).map_err(lost("vkWaitForFences", &self.in_flight))?;
            let done = now();
            d.reset_fences(&fences).map_err(vulkan("vkResetFences"))?;
            (submitted, done)
        };
        let span = self.collect_times(done)?;
        self.recorder.submission(Submission { start: self.begun, submit: submitted - self.begun, wait: done - submitted, span });
        Ok(())
    }

    /// Records the dispatches of a submission that was seen to end at `done`; returns how long it took the device.
    fn collect_times(&mut self, done: u64) -> Result<u64> {
        if self.timed.is_empty() {
            return Ok(0);
        }
        let mut ticks = vec![0u64; 2 * self.timed.len()];
        // SAFETY: these queries were written by the submission that has just been waited for.
        unsafe {
            self.device.raw.get_query_pool_results(self.queries, 0, &mut ticks, vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT)
        }
        .map_err(vulkan("vkGetQueryPoolResults"))?;
        let period = f64::from(self.device.timestamp_period);
        let nanos = |from: u64, to: u64| (to.saturating_sub(from) as f64 * period) as u64;
        let first = ticks[0];
        let span = nanos(first, ticks[ticks.len() - 1]);
        let start = done.saturating_sub(span);
        for ((kernel, round), pair) in self.timed.drain(..).zip(ticks.chunks_exact(2)) {
            let (start, duration) = (start + nanos(first, pair[0]), nanos(pair[0], pair[1]));
            self.recorder.dispatch(Dispatch { kernel, round, worker: 0, start, duration });
        }
        Ok(span)
    }

    /// How much is measured.
    pub fn profiling(&self) -> Profiling {
        self.recorder.profiling()
    }

    /// Sets how much is measured from now on.
    pub fn set_profiling(&mut self, profiling: Profiling) {
        self.recorder.set_profiling(profiling);
    }

    /// Adds what the kernels did in a round.
    pub fn count(&mut self, round: u32, counts: &RoundCounts) {
        self.recorder.count(round, counts);
    }

    /// What was measured since the last call.
    pub fn take_timings(&mut self) -> Timings {
        self.recorder.take()
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        // SAFETY: every submission is waited for in `submit`; after a failed wait the queue is drained here.
        unsafe {
            let d = &self.device.raw;
            let _ = d.queue_wait_idle(*self.device.queue());
            d.destroy_query_pool(self.queries, None);
            d.destroy_fence(self.fence, None);
            d.destroy_command_pool(self.pool, None);
        }
    }
}
