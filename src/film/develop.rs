//! Development of a film into an 8-bit sRGB picture: which of its values is shown, and in what colours.
//!
//! The functions on colours are the twins of `shaders/develop.glsl`. Exposure and tone curve act on radiance alone; every other
//! value has a fixed scale, so that its colours mean the same in every picture.

use super::{Film, luminance};
use crate::kernels::constants::*;
use crate::kernels::layout::Aov;
use crate::scene::ToneMap;
use rayon::prelude::*;
use std::ops::Range;

/// Largest exposure either way, in stops: beyond it the tone curves leave the range of single precision.
const MAX_STOPS: f64 = 40.0;

/// Which value of a film a picture shows.
#[repr(u32)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Channel {
    /// The light that arrived.
    #[default]
    Radiance = CHANNEL_RADIANCE,
    /// Base colour of the first surface.
    Albedo = CHANNEL_ALBEDO,
    /// Its shading normal, from -1..1 to 0..1.
    Normal = CHANNEL_NORMAL,
    /// Coordinate length of the camera ray, bright where it is short.
    Distance = CHANNEL_DISTANCE,
    /// Frequency at the film over frequency at the source: red below 1, blue above.
    Redshift = CHANNEL_REDSHIFT,
    /// Integration steps of the camera ray.
    Steps = CHANNEL_STEPS,
    /// Chords of the camera ray that met the BVH.
    Chords = CHANNEL_CHORDS,
    /// How the camera ray ended.
    Status = CHANNEL_STATUS,
    /// Relative drift of the Hamiltonian constraint.
    ConstraintError = CHANNEL_CONSTRAINT_ERROR,
    /// Steps and chords together.
    Cost = CHANNEL_COST,
}

impl Channel {
    /// Every channel, in the order of their keys.
    pub const ALL: [Channel; 10] = [
        Channel::Radiance,
        Channel::Albedo,
        Channel::Normal,
        Channel::Distance,
        Channel::Redshift,
        Channel::Steps,
        Channel::Chords,
        Channel::Status,
        Channel::ConstraintError,
        Channel::Cost,
    ];

    /// Its name, for people.
    pub fn label(self) -> &'static str {
        match self {
            Channel::Radiance => "radiance",
            Channel::Albedo => "albedo",
            Channel::Normal => "normal",
            Channel::Distance => "distance",
            Channel::Redshift => "redshift",
            Channel::Steps => "steps",
            Channel::Chords => "chords",
            Channel::Status => "status",
            Channel::ConstraintError => "constraint error",
            Channel::Cost => "cost",
        }
    }
}

/// How a film becomes a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Development {
    /// What is shown.
    pub channel: Channel,
    /// Exposure in stops.
    pub exposure: f64,
    /// Tone curve.
    pub tone_map: ToneMap,
    /// Which columns of the canvas are written; the others keep what they hold.
    pub columns: Range<u32>,
}

impl Development {
    /// Factor on radiance.
    pub fn gain(&self) -> f32 {
        gain(self.exposure)
    }

    /// The columns to be written of a canvas that has `width`.
    pub fn columns_within(&self, width: u32) -> Range<u32> {
        let end = self.columns.end.min(width);
        self.columns.start.min(end)..end
    }
}

/// Factor on radiance of an exposure in stops.
fn gain(exposure: f64) -> f32 {
    exposure.clamp(-MAX_STOPS, MAX_STOPS).exp2() as f32
}

/// Number of a tone curve in the kernels.
pub fn tone_number(curve: ToneMap) -> u32 {
    match curve {
        ToneMap::None => TONE_NONE,
        ToneMap::Reinhard => TONE_REINHARD,
        ToneMap::Aces => TONE_ACES,
    }
}

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

/// Colours from black over violet and orange to yellow, for a share of a range (gnuplot's formulae 7, 5, 15).
fn heat(share: f32) -> [f32; 3] {
    let t = share.clamp(0.0, 1.0);
    [t.sqrt(), t * t * t, (TAU * t.min(0.5)).sin().max(0.0)]
}

/// White for a ratio of frequencies of 1, to red below and to blue above; black for none.
fn shift_color(ratio: f32) -> [f32; 3] {
    if ratio <= 0.0 {
        return [0.0; 3];
    }
    let s = (ratio.log2() / SHIFT_OCTAVES).clamp(-1.0, 1.0);
    [1.0 - s.max(0.0), 1.0 - 0.7 * s.abs(), 1.0 + s.min(0.0)]
}

/// A colour for each way a ray ends.
fn status_color(status: u32) -> [f32; 3] {
    match status {
        STATUS_HIT => [0.75, 0.75, 0.75],
        STATUS_ESCAPED => [0.2, 0.4, 0.8],
        STATUS_CAPTURED => [0.45, 0.1, 0.55],
        STATUS_EXHAUSTED => [0.95, 0.25, 0.1],
        _ => [0.0; 3],
    }
}

/// Heat of a count, by its logarithm.
fn count_color(count: u32) -> [f32; 3] {
    heat((1.0 + count as f32).log2() / HEAT_OCTAVES)
}

/// Encoded colour of a channel other than radiance.
fn aov_color(channel: Channel, aov: &Aov) -> [f32; 3] {
    match channel {
        Channel::Albedo => aov.albedo.map(|v| srgb_from_linear(v.clamp(0.0, 1.0))),
        Channel::Normal if aov.object != 0 => aov.normal.map(|v| 0.5 + 0.5 * v),
        Channel::Distance => [1.0 / (1.0 + aov.distance / HALF_DISTANCE); 3],
        Channel::Redshift => shift_color(aov.redshift),
        Channel::Steps => count_color(aov.steps),
        Channel::Chords => count_color(aov.chords),
        Channel::Status => status_color(aov.status),
        Channel::ConstraintError => heat(1.0 + aov.constraint_error.max((-ERROR_OCTAVES).exp2()).log2() / ERROR_OCTAVES),
        Channel::Cost => count_color(aov.steps + aov.chords),
        Channel::Normal | Channel::Radiance => [0.0; 3],
    }
}

/// Encoded colour of exposed radiance.
fn radiance_color(curve: ToneMap, exposed: [f32; 3]) -> [f32; 3] {
    tone_map(curve, exposed).map(srgb_from_linear)
}

/// A value in [0, 1] as a byte.
fn byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

impl Film {
    /// The picture as 8-bit sRGB, rows from the top: exposure in stops, then the tone curve.
    pub fn developed(&self, exposure: f64, curve: ToneMap) -> Vec<[u8; 3]> {
        let gain = gain(exposure);
        (0..self.sums.len()).map(|i| radiance_color(curve, self.radiance(i).map(|v| v * gain)).map(byte)).collect()
    }

    /// Writes columns of a picture of the film's size, RGBA, rows from the top. Pixels without samples are black.
    pub fn develop(&self, development: &Development, picture: &mut [[u8; 4]]) {
        let width = self.width as usize;
        let columns = development.columns_within(self.width);
        let (first, end) = (columns.start as usize, columns.end as usize);
        let gain = development.gain();
        picture.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row[first..end].iter_mut().enumerate() {
                let i = y * width + first + x;
                let color = match development.channel {
                    _ if self.counts[i] == 0 => [0.0; 3],
                    Channel::Radiance => radiance_color(development.tone_map, self.radiance(i).map(|v| v * gain)),
                    channel => aov_color(channel, &self.aovs[i]),
                };
                let [r, g, b] = color.map(byte);
                *pixel = [r, g, b, 255];
            }
        });
    }
}
