//! OpenEXR output: linear radiance, every AOV as a channel, every parameter of the run as metadata.

use super::{Film, write_atomically};
use crate::error::{Error, Result};
use ::exr::prelude::*;
use std::path::Path as FilePath;

/// Writes the film. `metadata` becomes string attributes named `nullray.<key>`.
pub fn write_exr(path: &FilePath, film: &Film, metadata: &[(String, String)]) -> Result<()> {
    let pixels = film.sums.len();
    let floats = |name: &str, value: &dyn Fn(usize) -> f32| AnyChannel::new(name, FlatSamples::F32((0..pixels).map(value).collect()));
    let uints = |name: &str, value: &dyn Fn(usize) -> u32| AnyChannel::new(name, FlatSamples::U32((0..pixels).map(value).collect()));
    let a = &film.aovs;
    let mut channels = smallvec::SmallVec::new();
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push(floats(name, &|i| film.radiance(i)[c]));
    }
    for (c, (color, axis)) in [("R", "X"), ("G", "Y"), ("B", "Z")].into_iter().enumerate() {
        channels.push(floats(&format!("albedo.{color}"), &|i| a[i].albedo[c]));
        channels.push(floats(&format!("normal.{axis}"), &|i| a[i].normal[c]));
        channels.push(floats(&format!("position.{axis}"), &|i| a[i].position[c]));
    }
    channels.push(floats("distance", &|i| a[i].distance));
    channels.push(floats("redshift", &|i| a[i].redshift));
    channels.push(floats("constraint_error", &|i| a[i].constraint_error));
    channels.push(uints("steps", &|i| a[i].steps));
    channels.push(uints("chords", &|i| a[i].chords));
    channels.push(uints("status", &|i| a[i].status));
    channels.push(uints("object", &|i| a[i].object));
    channels.push(uints("samples", &|i| film.counts[i]));

    let size = (film.width as usize, film.height as usize);
    let mut layer = Layer::new(size, LayerAttributes::named("nullray"), Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels));
    for (key, value) in metadata {
        let text = Text::new_or_none(value)
            .ok_or_else(|| Error::Asset { path: path.into(), reason: format!("metadata `{key}` is not Latin text") })?;
        layer.attributes.other.insert(Text::from(format!("nullray.{key}").as_str()), AttributeValue::Text(text));
    }
    let image = Image::from_layer(layer);
    write_atomically(path, |temporary| {
        image.write().to_file(temporary).map_err(|e| match e {
            ::exr::error::Error::Io(source) => Error::Io { path: path.into(), source },
            e => Error::Asset { path: path.into(), reason: e.to_string() },
        })
    })
}
