//! The event loop's handler: opens the stage, passes it what happens, and keeps how it ended.

use super::document::Document;
use super::stage::Stage;
use super::{Summary, ViewOptions};
use crate::error::Result;
use crate::scene::{Assets, Scene};
use crate::world::World;
use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::WindowId;

/// The render thread has something to collect.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wake;

/// The scene a window is opened with.
pub(super) struct Opening {
    pub document: Document,
    pub scene: Scene,
    pub world: World,
    /// Files the scene names.
    pub assets: Assets,
}

/// The program while a window is open.
pub(super) struct App {
    options: ViewOptions,
    opening: Option<Opening>,
    proxy: EventLoopProxy<Wake>,
    stage: Option<Stage>,
    outcome: Result<Summary>,
}

impl App {
    /// A program that has no window yet.
    pub fn new(options: ViewOptions, opening: Opening, proxy: EventLoopProxy<Wake>) -> App {
        App { options, opening: Some(opening), proxy, stage: None, outcome: Ok(Summary::default()) }
    }

    /// What came of it.
    pub fn finish(self) -> Result<Summary> {
        self.outcome
    }

    /// Does something with the stage; an error ends the program.
    fn with_stage(&mut self, event_loop: &ActiveEventLoop, act: impl FnOnce(&mut Stage) -> Result<()>) {
        if let Some(stage) = &mut self.stage
            && let Err(e) = act(stage)
        {
            self.outcome = Err(e);
            event_loop.exit();
        }
    }
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(opening) = self.opening.take() else { return };
        match Stage::open(event_loop, &self.options, opening, self.proxy.clone()) {
            Ok(stage) => self.stage = Some(stage),
            Err(e) => {
                self.outcome = Err(e);
                event_loop.exit();
            }
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, _: Wake) {
        self.with_stage(event_loop, Stage::collect);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.with_stage(event_loop, |stage| stage.window_event(&event));
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.with_stage(event_loop, |stage| stage.tick(event_loop));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The window goes before its display does.
        if let Some(stage) = self.stage.take()
            && self.outcome.is_ok()
        {
            self.outcome = Ok(stage.summary());
        }
    }
}
