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
        let is_free = |c: &Arc<Canvas>| (c.width(), c.height()) == (width, height) && Arc::strong_count(c) == 1;
        let free = self.kept.iter().position(is_free).and_then(|index| Arc::into_inner(self.kept.swap_remove(index)));
        let mut canvas = match free {
            Some(canvas) => canvas,
            None => {
                if self.kept.len() >= MOST {
                    self.kept.retain(|c| Arc::strong_count(c) > 1);
                }
                Canvas::new(&self.device, width, height, self.by_host)?
            }
        };
        paint(&mut canvas)?;
        let canvas = Arc::new(canvas);
        self.kept.push(canvas.clone());
        Ok(canvas)
    }

    /// The pixels of a picture of this size.
    pub fn pixels(&self, (width, height): (u32, u32), paint: impl FnOnce(&mut Canvas) -> Result<()>) -> Result<Vec<[u8; 3]>> {
        let mut canvas = Canvas::for_reading(&self.device, width, height)?;
        paint(&mut canvas)?;
        Ok(canvas.pixels_mut()?.iter().map(|&[r, g, b, _]| [r, g, b]).collect())
    }
}
