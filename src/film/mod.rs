//! Accumulated radiance and what is known about each pixel.
//!
//! Sums are 64-bit fixed-point numbers (unit 2^-24), so adding is associative: the same samples give the same film to the bit in
//! whatever order, on however many threads, in one run or merged from several.

pub mod compare;
pub mod develop;
mod exr;
mod png;

pub use develop::{Channel, Development};
pub use exr::write_exr;
pub use png::{write_pixels, write_png};

use crate::error::{Error, Result};
use crate::kernels::constants::{FILM_FRACTION_BITS, MAX_MOMENT_LUMINANCE, MAX_RADIANCE};
use crate::kernels::layout::Aov;

/// Fixed-point sums of a pixel: red, green, blue, squared luminance.
pub type PixelSum = [u64; 4];

/// A picture in the making.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Sums, rows from the top.
    pub sums: Vec<PixelSum>,
    /// Samples in each pixel.
    pub counts: Vec<u32>,
    /// Values of the lowest sample of each pixel.
    pub aovs: Vec<Aov>,
    /// The lowest sample in the film.
    pub first_sample: u32,
    /// What happened to rays and samples.
    pub statistics: Statistics,
}

/// Counts over all samples of a film.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Rays traced, camera and bounce.
    pub rays: u64,
    /// Rays that ran out of steps.
    pub exhausted: u64,
    /// Samples that were not a number and count as black.
    pub invalid: u64,
}

impl Statistics {
    /// Adds the counts of another part.
    pub fn add(&mut self, other: Statistics) {
        self.rays += other.rays;
        self.exhausted += other.exhausted;
        self.invalid += other.invalid;
    }
}

/// A non-negative number in units of 2^-24, truncated.
pub fn fixed_from_float(value: f32) -> u64 {
    (f64::from(value) * f64::from(1u32 << FILM_FRACTION_BITS)) as u64
}

/// The number a fixed-point sum stands for.
pub fn float_from_fixed(value: u64) -> f64 {
    value as f64 / f64::from(1u32 << FILM_FRACTION_BITS)
}

/// Rec. 709 luminance of linear sRGB.
pub fn luminance(c: [f32; 3]) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// Adds one sample to a pixel; returns whether it was a number.
pub fn add_sample(sum: &mut PixelSum, radiance: [f32; 3]) -> bool {
    if !radiance.iter().all(|v| v.is_finite()) {
        return false;
    }
    let clamped = radiance.map(|v| v.clamp(0.0, MAX_RADIANCE));
    for (s, v) in sum.iter_mut().zip(clamped) {
        *s = s.wrapping_add(fixed_from_float(v));
    }
    let l = luminance(clamped).min(MAX_MOMENT_LUMINANCE);
    sum[3] = sum[3].wrapping_add(fixed_from_float(l * l));
    true
}

impl Film {
    /// An empty film whose first sample will be `first_sample`.
    pub fn new(width: u32, height: u32, first_sample: u32) -> Film {
        let pixels = width as usize * height as usize;
        Film {
            width,
            height,
            sums: vec![[0; 4]; pixels],
            counts: vec![0; pixels],
            aovs: vec![Aov::default(); pixels],
            first_sample,
            statistics: Statistics::default(),
        }
    }

    /// Empties the film and gives it a size, in the memory it has if that is enough.
    pub fn restart(&mut self, width: u32, height: u32) {
        let pixels = width as usize * height as usize;
        (self.width, self.height) = (width, height);
        self.sums.clear();
        self.sums.resize(pixels, [0; 4]);
        self.counts.clear();
        self.counts.resize(pixels, 0);
        self.aovs.clear();
        self.aovs.resize(pixels, Aov::default());
        self.statistics = Statistics::default();
    }

    /// Mean radiance of pixel `i`; black without samples.
    pub fn radiance(&self, i: usize) -> [f32; 3] {
        let n = f64::from(self.counts[i].max(1));
        [0, 1, 2].map(|c| (float_from_fixed(self.sums[i][c]) / n) as f32)
    }

    /// Lowest sample count of any pixel.
    pub fn samples(&self) -> u32 {
        self.counts.iter().copied().min().unwrap_or(0)
    }

    /// Standard error of the mean luminance over all pixels, relative to the picture's mean luminance; infinite below two samples.
    pub fn relative_error(&self) -> f64 {
        let mut variance = 0.0;
        let mut total = 0.0;
        for (sum, &count) in self.sums.iter().zip(&self.counts) {
            if count < 2 {
                return f64::INFINITY;
            }
            let n = f64::from(count);
            let mean = (0.2126 * float_from_fixed(sum[0]) + 0.7152 * float_from_fixed(sum[1]) + 0.0722 * float_from_fixed(sum[2])) / n;
            variance += (float_from_fixed(sum[3]) / n - mean * mean).max(0.0) / (n - 1.0);
            total += mean;
        }
        let pixels = self.counts.len() as f64;
        if total == 0.0 { 0.0 } else { (variance / pixels).sqrt() / (total / pixels) }
    }

    /// Adds a film of other samples of the same picture.
    pub fn merge(&mut self, other: &Film) -> Result<()> {
        if (self.width, self.height) != (other.width, other.height) {
            return Err(Error::World(format!(
                "films of {}x{} and {}x{} pixels do not merge",
                self.width, self.height, other.width, other.height
            )));
        }
        for (a, b) in self.sums.iter_mut().zip(&other.sums) {
            for (x, y) in a.iter_mut().zip(b) {
                *x = x.wrapping_add(*y);
            }
        }
        for (a, b) in self.counts.iter_mut().zip(&other.counts) {
            *a += b;
        }
        if other.first_sample < self.first_sample {
            self.aovs.clone_from(&other.aovs);
            self.first_sample = other.first_sample;
        }
        self.statistics.add(other.statistics);
        Ok(())
    }
}

/// Writes through a temporary file beside `path` and renames it, so that a failed write leaves nothing behind.
pub(crate) fn write_atomically(path: &std::path::Path, write: impl FnOnce(&std::path::Path) -> Result<()>) -> Result<()> {
    let name =
        path.file_name().ok_or_else(|| Error::Usage { argument: path.display().to_string(), reason: "expected a file name".into() })?;
    let temporary = path.with_file_name(format!(".{}.{}.part", name.to_string_lossy(), std::process::id()));
    let outcome =
        write(&temporary).and_then(|()| std::fs::rename(&temporary, path).map_err(|source| Error::Io { path: path.into(), source }));
    if outcome.is_err() {
        let _ = std::fs::remove_file(&temporary);
    }
    outcome
}
