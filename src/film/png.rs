//! Development of radiance into an 8-bit sRGB picture.

use super::{Film, luminance, write_atomically};
use crate::error::{Error, Result};
use crate::scene::ToneMap;
use std::path::Path;

/// Tone curve on exposed linear radiance, to [0, 1].
fn tone_map(curve: ToneMap, c: [f32; 3]) -> [f32; 3] {
    match curve {
        ToneMap::None => c.map(|v| v.clamp(0.0, 1.0)),
        ToneMap::Reinhard => {
            let scale = 1.0 / (1.0 + luminance(c));
            c.map(|v| (v * scale).clamp(0.0, 1.0))
        }
        // Narkowicz 2016, at 0.6 of its input as he proposes for matching exposure.
        ToneMap::Aces => c.map(|v| {
            let x = 0.6 * v;
            ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
        }),
    }
}

/// sRGB encoding of a linear value in [0, 1] (IEC 61966-2-1).
fn srgb_from_linear(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

impl Film {
    /// The picture as 8-bit sRGB, rows from the top: exposure in stops, then the tone curve.
    pub fn developed(&self, exposure: f64, curve: ToneMap) -> Vec<[u8; 3]> {
        let gain = exposure.exp2() as f32;
        (0..self.sums.len())
            .map(|i| tone_map(curve, self.radiance(i).map(|v| v * gain)).map(|v| (srgb_from_linear(v) * 255.0 + 0.5) as u8))
            .collect()
    }
}

/// Writes the developed picture.
pub fn write_png(path: &Path, film: &Film, exposure: f64, curve: ToneMap) -> Result<()> {
    let pixels = film.developed(exposure, curve);
    write_atomically(path, |temporary| {
        image::save_buffer_with_format(
            temporary,
            pixels.as_flattened(),
            film.width,
            film.height,
            image::ExtendedColorType::Rgb8,
            image::ImageFormat::Png,
        )
        .map_err(|e| match e {
            image::ImageError::IoError(source) => Error::Io { path: path.into(), source },
            e => Error::Asset { path: path.into(), reason: e.to_string() },
        })
    })
}
