//! Pictures: what the render thread is asked for, and what of its answers and the panels is shown.

use super::Stage;
use crate::backend::vulkan::presenter::Panels;
use crate::error::Result;
use crate::viewer::help;
use crate::viewer::model::{Action, View};
use crate::viewer::panels;
use crate::viewer::worker::Job;
use egui::ViewportId;
use std::time::{Duration, Instant};
use tracing::debug;

/// When a frame that could not be shown is tried again.
const RETRY: Duration = Duration::from_millis(100);

impl Stage {
    /// Tells the render thread what has changed.
    pub(super) fn send_request(&mut self) {
        if !self.is_stale || self.size.0 == 0 || self.size.1 == 0 {
            return;
        }
        self.is_stale = false;
        self.revision += 1;
        let request = self.subject.request(self.revision, self.size);
        self.worker.send(request.clone());
        if let Some(time) = self.input_at.take() {
            self.latency.asked(self.revision, time);
        }
        let (pose, number) = (request.eye.pose, request.source.number);
        if self.sent.as_ref().is_some_and(|last| last.eye.pose != pose) {
            debug!(position = ?pose.position.to_array(), look_at = ?pose.look_at.to_array(), "camera moved");
        }
        if self.sent.as_ref().is_none_or(|last| last.source.number != number || !last.same_view(&request)) {
            self.pick = None;
            self.viewed_since = self.revision;
        }
        self.sent = Some(request);
    }

    /// Shows the newest picture, and the panels if there are any.
    pub(super) fn redraw(&mut self) -> Result<()> {
        // First: what was asked for can be rendered while the last picture is shown.
        self.send_request();
        if self.size.0 == 0 || self.size.1 == 0 {
            return Ok(());
        }
        let input = self.egui.take_egui_input(&self.window);
        let canvas = self.frame.as_ref().map(|f| &f.canvas);
        if !self.shows_overlay() {
            let is_shown = self.presenter.present(canvas, None)?;
            self.note_presented(is_shown);
            return Ok(());
        }
        let context = self.egui.egui_ctx().clone();
        let mut state = std::mem::take(&mut self.panels);
        let view = View {
            document: self.subject.document(),
            scene: self.subject.scene(),
            development: self.subject.development(),
            bending: self.subject.bending(),
            split: self.subject.split(),
            velocity: self.subject.velocity(),
            frame: self.frame.as_ref().map(|f| &f.info),
            history: &self.history,
            pick: self.pick.as_deref(),
            error: self.error(),
            message: self.message.as_ref().map(|(text, _)| text.as_str()),
            help: self.shows_help,
            device: &self.device,
            latency_ms: self.latency.median(),
        };
        let mut actions = vec![];
        let mut output = context.run_ui(input, |ui| {
            actions.extend(if self.shows_panels { panels::show(ui, &mut state, &view) } else { show_notices(ui, &view) });
        });
        self.panels = state;
        self.egui.handle_platform_output(&self.window, output.platform_output);
        let primitives = context.tessellate(output.shapes, output.pixels_per_point);
        let drawn = Panels { textures: &output.textures_delta, primitives: &primitives, pixels_per_point: output.pixels_per_point };
        let outcome = self.presenter.present(canvas, Some(drawn));
        output.textures_delta.clear();
        let is_shown = outcome?;
        if let Some(viewport) = output.viewport_output.get(&ViewportId::ROOT) {
            self.next_redraw = Instant::now().checked_add(viewport.repaint_delay);
        }
        self.note_presented(is_shown);
        self.act(actions);
        Ok(())
    }

    /// Takes note that the newest picture has been shown, or has to be tried again.
    fn note_presented(&mut self, is_shown: bool) {
        if !is_shown {
            self.next_redraw = Some(Instant::now() + RETRY);
            return;
        }
        let Some(frame) = &self.frame else { return };
        let info = &frame.info;
        let is_complete = info.scale == 1 && info.samples >= info.goal;
        if self.is_new {
            debug!(revision = info.revision, samples = info.samples, scale = info.scale, "frame presented");
            self.latency.answered(info.revision);
        }
        self.presented += u64::from(self.is_new || is_complete);
        self.is_new = false;
        let Some(wanted) = self.frames.filter(|_| !self.is_leaving) else { return };
        if self.presented < wanted {
            if is_complete {
                self.window.request_redraw();
            }
            return;
        }
        self.is_leaving = true;
        match self.screenshot.take() {
            Some(path) => self.worker.ask(Job::Screenshot(path)),
            None => self.is_done = true,
        }
    }
}

/// What is to be known while the panels are hidden.
fn show_notices(ui: &mut egui::Ui, view: &View<'_>) -> Vec<Action> {
    if let Some(text) = view.error.or(view.message) {
        let area = egui::Area::new(egui::Id::new("notice")).anchor(egui::Align2::CENTER_TOP, egui::vec2(0.0, 8.0));
        area.show(ui.ctx(), |ui| egui::Frame::popup(ui.style()).show(ui, |ui| ui.label(text)));
    }
    if view.help && !help::show(ui.ctx()) { vec![Action::Help(false)] } else { vec![] }
}
