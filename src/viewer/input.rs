//! What hands are doing: keys that are held to fly, drags of the mouse, and how long pictures take to follow.

use glam::{DVec2, DVec3};
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use winit::keyboard::PhysicalKey;

/// Distances of the target that are flown per second.
const SPEED: f64 = 0.5;
/// Factor on the speed of one notch of the wheel.
const NOTCH: f64 = 1.25;
/// Factor on the speed with Shift.
const HURRY: f64 = 4.0;
/// Flight of a key that is only tapped, and longest step of one that is held.
const STEPS: (Duration, Duration) = (Duration::from_millis(30), Duration::from_millis(100));
/// Points that the mouse may move in a click.
const CLICK: f64 = 4.0;
/// Points beside the border of the split view where it is taken hold of.
pub const GRIP: f64 = 6.0;
/// Latencies that are remembered.
const REMEMBERED: usize = 1000;

/// Keys that fly while they are held.
#[derive(Debug)]
pub struct Flight {
    held: Vec<(PhysicalKey, [i8; 3])>,
    speed: f64,
    last: Instant,
}

impl Default for Flight {
    fn default() -> Flight {
        Flight { held: vec![], speed: SPEED, last: Instant::now() }
    }
}

impl Flight {
    /// A key goes down.
    pub fn press(&mut self, key: PhysicalKey, direction: [i8; 3]) {
        if self.held.is_empty() {
            self.last = Instant::now().checked_sub(STEPS.0).unwrap_or_else(Instant::now);
        }
        if self.held.iter().all(|(k, _)| *k != key) {
            self.held.push((key, direction));
        }
    }

    /// A key comes up.
    pub fn release(&mut self, key: PhysicalKey) {
        self.held.retain(|(k, _)| *k != key);
    }

    /// All keys come up.
    pub fn land(&mut self) {
        self.held.clear();
    }

    /// Whether a key is held.
    pub fn is_on(&self) -> bool {
        !self.held.is_empty()
    }

    /// Turns the wheel while flying.
    pub fn accelerate(&mut self, notches: f64) {
        self.speed = (self.speed * NOTCH.powf(notches)).clamp(1e-3, 1e3);
    }

    /// The way since the last step, to the right, up and forward, at this distance of the target.
    pub fn step(&mut self, distance: f64, hurry: bool) -> [f64; 3] {
        let now = Instant::now();
        let time = now.saturating_duration_since(self.last).min(STEPS.1).as_secs_f64();
        self.last = now;
        let direction: DVec3 = self.held.iter().map(|(_, d)| DVec3::from(d.map(f64::from))).sum();
        let speed = self.speed * if hurry { HURRY } else { 1.0 };
        (direction.normalize_or_zero() * distance * speed * time).to_array()
    }
}

/// What the mouse is dragging.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drag {
    /// The camera around the target; a click so far, if it has not moved.
    Orbit {
        /// Where it began.
        from: DVec2,
        /// Whether it is more than a click.
        moved: bool,
    },
    /// The view.
    Look,
    /// The border of the split view.
    Border,
}

impl Drag {
    /// Takes note of where the mouse is, with so many pixels to a point.
    pub fn follow(&mut self, at: DVec2, scale: f64) {
        if let Drag::Orbit { from, moved } = self {
            *moved |= from.distance(at) > CLICK * scale;
        }
    }
}

/// Times from inputs to the pictures that answer them.
#[derive(Debug, Default)]
pub struct Latency {
    /// Requests that were not answered, with the time of the input.
    asked: VecDeque<(u64, Instant)>,
    /// Milliseconds of the last ones.
    recent: VecDeque<f64>,
    count: u64,
    max: f64,
}

impl Latency {
    /// An input at `time` is in the request with this number.
    pub fn asked(&mut self, revision: u64, time: Instant) {
        self.asked.push_back((revision, time));
    }

    /// A picture that answers this request has been shown now.
    pub fn answered(&mut self, revision: u64) {
        while let Some((_, time)) = self.asked.front().copied().filter(|(asked, _)| *asked <= revision) {
            self.asked.pop_front();
            let milliseconds = time.elapsed().as_secs_f64() * 1e3;
            if self.recent.len() == REMEMBERED {
                self.recent.pop_front();
            }
            self.recent.push_back(milliseconds);
            self.count += 1;
            self.max = self.max.max(milliseconds);
        }
    }

    /// How many there were.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest (ms).
    pub fn max(&self) -> Option<f64> {
        (self.count > 0).then_some(self.max)
    }

    /// The median of the last ones (ms).
    pub fn median(&self) -> Option<f64> {
        let mut sorted: Vec<f64> = self.recent.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}
