//! What keys and the mouse do.

use super::Stage;
use crate::viewer::help::{self, Command};
use crate::viewer::input::{Drag, GRIP};
use crate::viewer::model::Action;
use crate::viewer::navigation::Pose;
use crate::viewer::worker::Job;
use glam::DVec2;
use std::time::Instant;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};

/// Angle of an arrow key (radians).
const NUDGE: f64 = 0.035;
/// Pixels of a touchpad that count as a notch of the wheel.
const NOTCH: f64 = 40.0;

impl Stage {
    /// Takes a key that goes down; says whether it means something.
    pub(super) fn key(&mut self, key: &KeyEvent) -> bool {
        let Some(command) = help::command(key.physical_key, &key.logical_key, self.modifiers.control_key()) else { return false };
        if key.repeat && !matches!(command, Command::Nudge(_) | Command::Exposure(_)) {
            return true;
        }
        match command {
            Command::Panels => self.show_panels(!self.shows_panels),
            Command::Help => self.shows_help = !self.shows_help,
            Command::Bending => self.act(vec![Action::Bending(!self.subject.bending())]),
            Command::Split => self.act(vec![Action::Split(if self.subject.split().is_some() { None } else { Some(0.5) })]),
            Command::ResetCamera => self.act(vec![Action::ResetCamera]),
            Command::Channel(channel) => self.act(vec![Action::Channel(channel)]),
            Command::Exposure(stops) => self.act(vec![Action::Exposure(self.subject.development().exposure + stops)]),
            Command::Screenshot => self.act(vec![Action::Screenshot]),
            Command::SaveFilm => self.act(vec![Action::SaveFilm]),
            Command::SaveScene => self.act(vec![Action::SaveScene]),
            Command::Fly(direction) => {
                self.flight.press(key.physical_key, direction);
                self.fly();
            }
            Command::Nudge([right, up]) => self.navigate(|pose| pose.orbit(NUDGE * f64::from(right), NUDGE * f64::from(up))),
            Command::Quit if self.shows_help => self.shows_help = false,
            Command::Quit => self.is_done = true,
        }
        self.window.request_redraw();
        true
    }

    /// Takes what the mouse does; what egui has `consumed` begins nothing.
    pub(super) fn mouse(&mut self, event: &WindowEvent, consumed: bool) {
        match event {
            WindowEvent::CursorMoved { position, .. } => self.drag_to(DVec2::new(position.x, position.y)),
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } if !consumed => {
                let grip = GRIP * self.window.scale_factor();
                let border = self.subject.split().map(|split| split * f64::from(self.size.0));
                self.drag = match button {
                    MouseButton::Left if border.is_some_and(|x| (x - self.cursor.x).abs() < grip) => Some(Drag::Border),
                    MouseButton::Left => Some(Drag::Orbit { from: self.cursor, moved: false }),
                    MouseButton::Right => Some(Drag::Look),
                    _ => self.drag,
                };
            }
            WindowEvent::MouseInput { state: ElementState::Released, .. } => {
                if let Some(Drag::Orbit { moved: false, from }) = self.drag.take() {
                    let pixel = |at: f64, size: u32| (at.max(0.0) as u32).min(size.saturating_sub(1));
                    self.worker.ask(Job::Pick(pixel(from.x, self.size.0), pixel(from.y, self.size.1)));
                }
            }
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / NOTCH,
                };
                if self.flight.is_on() {
                    self.flight.accelerate(notches);
                } else {
                    self.navigate(|pose| pose.dolly(notches));
                }
            }
            _ => {}
        }
    }

    /// The mouse is there now.
    fn drag_to(&mut self, at: DVec2) {
        let (by, height) = (at - self.cursor, f64::from(self.size.1.max(1)));
        self.cursor = at;
        let Some(drag) = &mut self.drag else { return };
        drag.follow(at, self.window.scale_factor());
        let drag = *drag;
        match drag {
            Drag::Orbit { moved: false, .. } => {}
            // The picture goes with the mouse.
            Drag::Orbit { .. } => {
                let turn = by * (std::f64::consts::PI / height);
                self.navigate(|pose| pose.orbit(-turn.x, turn.y));
            }
            Drag::Look => {
                let turn = by * (self.subject.pose().fov.to_radians() / height);
                self.navigate(|pose| pose.look(turn.x, -turn.y));
            }
            Drag::Border => self.act(vec![Action::Split(Some(at.x / f64::from(self.size.0.max(1))))]),
        }
    }

    pub(super) fn fly(&mut self) {
        let way = self.flight.step(self.subject.pose().distance(), self.modifiers.shift_key());
        self.navigate(|pose| pose.fly(way));
    }

    fn navigate(&mut self, go: impl FnOnce(Pose) -> Pose) {
        self.subject.navigate(go);
        self.input_at.get_or_insert_with(Instant::now);
        self.is_stale = true;
    }
}
