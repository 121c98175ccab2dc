//! The scene that is rendered, as it is with straight light and with bent.

use crate::error::Result;
use crate::scene::{Scene, Spacetime};
use crate::world::World;
use std::sync::Arc;

/// Kinds of light, in the order in which the split view shows them from left to right.
pub(super) const STRAIGHT: usize = 0;
pub(super) const BENT: usize = 1;

/// A scene that could be compiled.
pub(super) struct Loaded {
    /// The scene by its light.
    pub scenes: [Scene; 2],
    /// Their worlds, compiled when they are first asked for.
    worlds: [Option<Arc<World>>; 2],
}

impl Loaded {
    /// A scene with bent light, and its world.
    pub fn new(scene: Scene, world: World) -> Loaded {
        let straight = Scene { spacetime: Spacetime::flat(), ..scene.clone() };
        Loaded { scenes: [straight, scene], worlds: [None, Some(Arc::new(world))] }
    }

    /// The world of a kind of light.
    pub fn world(&mut self, light: usize) -> Result<Arc<World>> {
        if let Some(world) = &self.worlds[light] {
            return Ok(world.clone());
        }
        let world = Arc::new(compile(&self.scenes[light])?);
        self.worlds[light] = Some(world.clone());
        Ok(world)
    }
}

/// A scene compiled for backends that start with a film of a single pixel: the window's comes later.
pub(super) fn compile(scene: &Scene) -> Result<World> {
    let mut world = World::compile(scene)?;
    (world.scene.film_width, world.scene.film_height) = (1, 1);
    Ok(world)
}
