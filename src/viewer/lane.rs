//! A backend with the scene that it renders: one for bent light, one for straight.

use super::navigation::Eye;
use crate::backend::{Backend, Canvas, Development, Precision};
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::scheduler::{Interactive, Refinement};
use crate::world::World;
use std::sync::Arc;
use std::time::Duration;

/// Renders one kind of light.
pub struct Lane {
    backend: Box<dyn Backend>,
    precision: Precision,
    pace: Interactive,
    /// What the backend holds; the camera and the film of the scene are those that are rendered.
    held: Option<(Scene, Arc<World>)>,
    film: Refinement,
}

impl Lane {
    /// A lane without a scene.
    pub fn new(backend: Box<dyn Backend>, precision: Precision) -> Lane {
        Lane { backend, precision, pace: Interactive::default(), held: None, film: Refinement::new(1, 1, 1, 0) }
    }

    /// Gives the backend a world, unless it has it. If that fails it gets back the one it had, as far as it can take that.
    pub fn load(&mut self, scene: &Scene, world: &Arc<World>) -> Result<()> {
        if self.held.as_ref().is_some_and(|(_, held)| Arc::ptr_eq(held, world)) {
            return Ok(());
        }
        if let Err(e) = self.backend.upload(world.clone(), self.precision, 0) {
            // Whatever failed, the backend may be empty now.
            if let Some((_, held)) = &self.held
                && self.backend.upload(held.clone(), self.precision, 0).is_err()
            {
                self.held = None;
            }
            return Err(e);
        }
        // What an edit costs is close to what was measured before, but models have little in common.
        if self.held.as_ref().is_some_and(|(_, held)| held.model != world.model) {
            self.pace = Interactive::default();
        }
        self.held = Some((scene.clone(), world.clone()));
        Ok(())
    }

    /// How much coarser than a window of this size a picture has to be that takes no longer than `budget`.
    pub fn reduction(&self, (width, height): (u32, u32), budget: Duration) -> u32 {
        self.pace.reduction(width, height, budget)
    }

    /// Starts a film of what the eye sees.
    pub fn start(&mut self, eye: &Eye, (width, height): (u32, u32), reduction: u32) -> Result<()> {
        let Some((scene, world)) = &mut self.held else { return Err(Error::World("no scene was uploaded".into())) };
        let film = Refinement::new(width, height, reduction, scene.film.samples);
        eye.apply(&mut scene.camera);
        (scene.film.width, scene.film.height) = film.size();
        self.backend.set_parameters(&world.parameters_for(scene)?)?;
        self.film.give_up(&mut self.pace);
        self.film = film;
        Ok(())
    }

    /// Renders for about as long as `budget`; returns the samples of pixels that were added.
    pub fn advance(&mut self, budget: Duration) -> Result<u64> {
        self.film.advance(self.backend.as_mut(), &mut self.pace, budget)
    }

    /// How far the film is.
    pub fn film(&self) -> &Refinement {
        &self.film
    }

    /// Develops the film into columns of a canvas.
    pub fn develop(&mut self, development: &Development, canvas: &mut Canvas) -> Result<()> {
        self.backend.develop(development, canvas)
    }

    /// The backend.
    pub fn backend(&mut self) -> &mut dyn Backend {
        self.backend.as_mut()
    }

    /// The backend with the scene and the world it holds.
    pub fn parts(&mut self) -> Option<(&mut dyn Backend, &Scene, &World)> {
        let (scene, world) = self.held.as_ref()?;
        let backend: &mut dyn Backend = self.backend.as_mut();
        Some((backend, scene, world.as_ref()))
    }
}
