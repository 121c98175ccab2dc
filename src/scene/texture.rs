//! Images read from PNG, JPEG, HDR and EXR files.

use crate::error::{Error, Result};
use half::f16;
use std::path::Path;

/// Largest image, in pixels.
const MAX_PIXELS: u64 = 1 << 28;

/// An image in linear RGBA half floats, rows from the top.
#[derive(Clone, Debug)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, bit patterns of half floats.
    pub texels: Vec<[u16; 4]>,
}

impl Image {
    /// Reads an image. 8- and 16-bit files are decoded from sRGB, unless they hold `data` (roughness); float files are linear.
    pub fn read(path: &Path, data: bool) -> Result<Image> {
        let asset = |reason: String| Error::Asset { path: path.into(), reason };
        let io = |source| Error::Io { path: path.into(), source };
        let mut reader = image::ImageReader::open(path).map_err(io)?.with_guessed_format().map_err(io)?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(MAX_PIXELS * 16);
        reader.limits(limits);
        let decoded = reader.decode().map_err(|e| asset(format!("not an image that can be read (PNG, JPEG, HDR, EXR): {e}")))?;
        Ok(Image::from_dynamic(&decoded, data))
    }

    /// Converts a decoded image.
    pub fn from_dynamic(decoded: &image::DynamicImage, data: bool) -> Image {
        use image::DynamicImage::{ImageRgb32F, ImageRgba32F};
        let linear = matches!(decoded, ImageRgb32F(_) | ImageRgba32F(_)) || data;
        let rgba = decoded.to_rgba32f();
        let decode = |v: f32| if linear { v } else { linear_from_srgb(v) };
        let half = |v: f32| f16::from_f32(if v.is_finite() { v.clamp(-65504.0, 65504.0) } else { 0.0 }).to_bits();
        let texels = rgba.pixels().map(|p| [half(decode(p[0])), half(decode(p[1])), half(decode(p[2])), half(p[3])]).collect();
        Image { width: rgba.width(), height: rgba.height(), texels }
    }

    /// A square of `count` x `count` checks in two linear colours, about 1024 pixels wide.
    pub fn checker(colors: [[f32; 3]; 2], count: u32) -> Image {
        let check = 1024 / count;
        let side = count * check;
        let half = |c: [f32; 3]| [c[0], c[1], c[2], 1.0].map(|v| f16::from_f32(v).to_bits());
        let colors = colors.map(half);
        let texels = (0..side * side).map(|i| colors[((i % side / check + i / side / check) % 2) as usize]).collect();
        Image { width: side, height: side, texels }
    }

    /// Linear RGB of a pixel.
    pub fn rgb(&self, x: u32, y: u32) -> [f32; 3] {
        let t = self.texels[(y * self.width + x) as usize];
        [t[0], t[1], t[2]].map(|h| f16::from_bits(h).to_f32())
    }
}

/// Linear value of an sRGB-encoded one (IEC 61966-2-1).
pub fn linear_from_srgb(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}
