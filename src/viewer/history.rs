//! Times of the last frames, for plots.

use crate::backend::KernelTiming;
use std::collections::VecDeque;
use std::time::Duration;

/// Frames that are remembered.
const LENGTH: usize = 240;

/// The time of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTime {
    /// Since the frame before (ms).
    pub interval: f32,
    /// What each kernel took of it (ms).
    pub kernels: Vec<(String, f32)>,
}

/// Times of the last frames, the oldest first.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// The frames.
    pub frames: VecDeque<FrameTime>,
}

impl History {
    /// Adds a frame; the oldest one goes.
    pub fn push(&mut self, interval: Duration, timings: &[KernelTiming]) {
        if self.frames.len() == LENGTH {
            self.frames.pop_front();
        }
        let milliseconds = |time: Duration| time.as_secs_f32() * 1e3;
        let kernels = timings.iter().map(|t| (t.kernel.clone(), milliseconds(t.time))).collect();
        self.frames.push_back(FrameTime { interval: milliseconds(interval), kernels });
    }
}
