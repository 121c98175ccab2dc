//! PNG output.

use super::{Film, write_atomically};
use crate::error::{Error, Result};
use crate::scene::ToneMap;
use std::path::Path;

/// Writes the developed picture.
pub fn write_png(path: &Path, film: &Film, exposure: f64, curve: ToneMap) -> Result<()> {
    write_pixels(path, film.width, film.height, &film.developed(exposure, curve))
}

/// Writes a picture of 8-bit sRGB, rows from the top.
pub fn write_pixels(path: &Path, width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<()> {
    write_atomically(path, |temporary| {
        image::save_buffer_with_format(
            temporary,
            pixels.as_flattened(),
            width,
            height,
            image::ExtendedColorType::Rgb8,
            image::ImageFormat::Png,
        )
        .map_err(|e| match e {
            image::ImageError::IoError(source) => Error::Io { path: path.into(), source },
            e => Error::Asset { path: path.into(), reason: e.to_string() },
        })
    })
}
