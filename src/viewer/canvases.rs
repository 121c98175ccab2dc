//! Canvases that go round between the render thread and the window.

use crate::backend::Canvas;
use crate::backend::vulkan::device::Device;
use crate::error::Result;
use std::sync::Arc;

/// Canvases that are kept: in the window, on the way there, and next, in two sizes.
const MOST: usize = 6;

/// Makes canvases on the window's device, and takes those that nobody looks at any more.
pub struct Canvases {
    device: Arc<Device>,
    /// Whether the host develops into them.
    by_host: bool,
    kept: Vec<Arc<Canvas>>,
}

impl Canvases {
    /// No canvases yet.
    pub fn new(device: Arc<Device>, by_host: bool) -> Canvases {
        Canvases { device, by_host, kept: vec![] }
    }

    /// A canvas of this size, painted.
    pub fn painted(&mut self, (width, height): (u32, u32), paint: impl FnOnce(&mut Canvas) -> Result<()>) -> Result<Arc<Canvas>> {
        let is_free = |c: &mut Arc<Canvas>| (c.width(), c.height()) == (width, height) && Arc::get_mut(c).is_some();
        let index = match self.kept.iter_mut().position(is_free) {
            Some(index) => index,
            None => {
                if self.kept.len() >= MOST {
                    self.kept.retain_mut(|c| Arc::get_mut(c).is_none());
                }
                self.kept.push(Arc::new(Canvas::new(&self.device, width, height, self.by_host)?));
                self.kept.len() - 1
            }
        };
        let shared = &mut self.kept[index];
        if let Some(canvas) = Arc::get_mut(shared) {
            paint(canvas)?;
        }
        Ok(shared.clone())
    }

    /// The pixels of a picture of this size.
    pub fn pixels(&self, (width, height): (u32, u32), paint: impl FnOnce(&mut Canvas) -> Result<()>) -> Result<Vec<[u8; 3]>> {
        let mut canvas = Canvas::new(&self.device, width, height, true)?;
        paint(&mut canvas)?;
        Ok(canvas.pixels_mut()?.iter().map(|&[r, g, b, _]| [r, g, b]).collect())
    }
}
