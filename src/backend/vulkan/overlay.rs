//! The triangles and textures of the panels, drawn by `egui-ash-renderer`.

use super::device::Device;
use super::presenter::Panels;
use crate::error::{Error, Result};
use ash::vk;
use egui::epaint::{ImageDelta, Primitive};
use egui::{ColorImage, ImageData, TextureId, TexturesDelta};
use egui_ash_renderer::allocator::DefaultAllocator;
use egui_ash_renderer::{DynamicRendering, Options, RenderMode, Renderer, RendererError};
use std::collections::HashMap;
use std::sync::Arc;

/// Draws panels over a window.
pub(super) struct Overlay {
    renderer: Renderer<DefaultAllocator>,
    /// What the textures hold. A patch uploads all of its texture: the renderer's own patches let the rest of the image go.
    images: HashMap<TextureId, Arc<ColorImage>>,
    /// Textures that the last panels were the last to use.
    retired: Vec<TextureId>,
}

impl Overlay {
    /// A renderer for images of a format that are shown as they are.
    pub fn new(device: &Device, format: vk::Format) -> Result<Overlay> {
        let mode = RenderMode::DynamicRendering(DynamicRendering {
            color_attachment_format: format,
            depth_attachment_format: None,
            stencil_attachment_format: None,
        });
        let options = Options { in_flight_frames: 1, srgb_framebuffer: false, ..Options::default() };
        let renderer = Renderer::with_default_allocator(&device.instance.raw, device.report.handle, device.raw.clone(), mode, options)
            .map_err(failed)?;
        Ok(Overlay { renderer, images: HashMap::new(), retired: vec![] })
    }

    /// Frees textures that are no longer used; the last frame has been waited for.
    pub fn free_retired(&mut self) -> Result<()> {
        for id in self.retired.drain(..) {
            self.images.remove(&id);
            self.renderer.free_texture(id).map_err(failed)?;
        }
        Ok(())
    }

    /// Takes over what has changed in the textures; the last frame has been waited for.
    pub fn update(&mut self, device: &Device, pool: vk::CommandPool, textures: &TexturesDelta) -> Result<()> {
        for (&id, deltas) in &textures.set {
            for delta in deltas {
                self.apply(id, delta);
            }
            let (Some(image), Some(last)) = (self.images.get(&id), deltas.last()) else { continue };
            let whole = ImageDelta { image: ImageData::Color(image.clone()), options: last.options, pos: None };
            let queue = device.queue();
            self.renderer.set_texture(*queue, pool, id, &whole).map_err(failed)?;
        }
        self.retired.extend(textures.free.iter().copied());
        Ok(())
    }

    fn apply(&mut self, id: TextureId, delta: &ImageDelta) {
        let ImageData::Color(new) = &delta.image;
        if let (Some(at), Some(whole)) = (delta.pos, self.images.get_mut(&id)) {
            patch(Arc::make_mut(whole), new, at);
        } else {
            self.images.insert(id, new.clone());
        }
    }

    /// Records drawing the panels over a window of `extent`.
    pub fn draw(&mut self, commands: vk::CommandBuffer, extent: vk::Extent2D, panels: &Panels<'_>) -> Result<()> {
        // The renderer puts all meshes into one buffer, and Vulkan has no empty ones.
        let any = panels.primitives.iter().any(|p| matches!(&p.primitive, Primitive::Mesh(mesh) if !mesh.indices.is_empty()));
        if any {
            self.renderer.cmd_draw(commands, extent, panels.pixels_per_point, panels.primitives).map_err(failed)?;
        }
        Ok(())
    }
}

/// Puts an image into a larger one.
fn patch(whole: &mut ColorImage, part: &ColorImage, [x, y]: [usize; 2]) {
    for (row, pixels) in part.pixels.chunks_exact(part.width().max(1)).enumerate() {
        let start = (y + row) * whole.width() + x;
        if let Some(target) = whole.pixels.get_mut(start..start + pixels.len()) {
            target.copy_from_slice(pixels);
        }
    }
}

fn failed(error: RendererError) -> Error {
    match error {
        RendererError::Vulkan(vk::Result::ERROR_DEVICE_LOST) => Error::DeviceLost { kernel: "panels".into() },
        e => Error::Vulkan { call: "egui-ash-renderer", result: e.to_string() },
    }
}
