//! Bilinear lookups in the pool of texels. Both backends filter by this text, so no sampler hardware is involved.

use super::layout::Texture;
use super::view::SceneView;
use glam::{Vec2, Vec4};

/// Index of texel (x, y), repeating in both directions.
#[inline(always)]
pub fn texel_index(texture: &Texture, x: i32, y: i32) -> u32 {
    let column = x.rem_euclid(texture.width as i32) as u32;
    let row = y.rem_euclid(texture.height as i32) as u32;
    texture.first_index + row * texture.width + column
}

/// Linear RGBA at `uv`; (0, 0) is the lower left corner of the image.
#[inline(always)]
pub fn sample_texture(view: &SceneView, index: u32, uv: Vec2) -> Vec4 {
    let texture = view.texture_at(index);
    let x = (uv.x - uv.x.floor()) * texture.width as f32 - 0.5;
    let y = (1.0 - (uv.y - uv.y.floor())) * texture.height as f32 - 0.5;
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let (ix, iy) = (x0 as i32, y0 as i32);
    let lower = view.texel(texel_index(&texture, ix, iy)) * (1.0 - fx) + view.texel(texel_index(&texture, ix + 1, iy)) * fx;
    let upper = view.texel(texel_index(&texture, ix, iy + 1)) * (1.0 - fx) + view.texel(texel_index(&texture, ix + 1, iy + 1)) * fx;
    lower * (1.0 - fy) + upper * fy
}
