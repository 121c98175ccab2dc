//! The panels over the picture: one at the right with a section for everything that can be changed, a status line, the picked ray,
//! the keys. They show a [`View`] and return [`Action`]s; nothing is changed in here.

mod controls;
mod performance;

use super::help;
use super::input::GRIP;
use super::map::Map;
use super::model::{Action, Pick, View};
use super::parameters::{self, Group};
use crate::backend::Channel;
use crate::kernels::constants::{STATUS_CAPTURED, STATUS_EXHAUSTED, STATUS_HIT};
use crate::scene::ToneMap;
use controls::{Editor, label, shown, wide};
use egui::{Align2, Color32, ComboBox, CursorIcon, FontId, Id, RichText, Slider, Stroke, Ui, pos2, vec2};

/// Name of a tone curve.
const TONE_MAPS: [(ToneMap, &str); 3] = [(ToneMap::Aces, "ACES"), (ToneMap::Reinhard, "Reinhard"), (ToneMap::None, "Clip at white")];

const ERROR: Color32 = Color32::from_rgb(122, 28, 30);
const ACCENT: Color32 = Color32::from_rgb(104, 170, 255);

/// What the panels remember from frame to frame, beside what egui does.
#[derive(Clone, Debug, Default)]
pub struct PanelState {
    map: Map,
    styled: bool,
}

/// Draws the panels over the whole window and returns what a person did.
pub fn show(ui: &mut Ui, state: &mut PanelState, view: &View<'_>) -> Vec<Action> {
    if !state.styled {
        set_style(ui.ctx());
        state.styled = true;
    }
    if let Some(error) = view.error {
        show_error(ui, error);
    }
    show_status(ui, view);
    let mut editor = Editor { document: view.document, camera: view.scene.camera.position, actions: vec![] };
    show_side(ui, view, &mut editor);
    let mut actions = editor.actions;
    if let Some(split) = view.split {
        show_border(ui, split);
    }
    if let Some(pick) = view.pick {
        actions.extend(show_pick(ui.ctx(), &mut state.map, view, pick));
    }
    if view.help && !help::show(ui.ctx()) {
        actions.push(Action::Help(false));
    }
    actions
}

/// Dark, a little translucent, with one accent colour.
fn set_style(ctx: &egui::Context) {
    ctx.set_theme(egui::Theme::Dark);
    ctx.all_styles_mut(|style| {
        style.spacing.item_spacing = vec2(8.0, 5.0);
        let visuals = &mut style.visuals;
        visuals.panel_fill = Color32::from_rgba_unmultiplied(20, 22, 28, 244);
        visuals.window_fill = Color32::from_rgba_unmultiplied(24, 26, 33, 248);
        visuals.extreme_bg_color = Color32::from_rgb(11, 12, 16);
        visuals.selection.bg_fill = Color32::from_rgb(38, 84, 150);
        visuals.slider_trailing_fill = true;
    });
    ctx.request_repaint();
}

fn show_error(ui: &mut Ui, error: &str) {
    let frame = egui::Frame::new().fill(ERROR).inner_margin(8);
    egui::Panel::top(Id::new("error")).frame(frame).show_separator_line(false).show(ui, |ui| {
        ui.add(egui::Label::new(RichText::new(error).color(Color32::WHITE)).wrap());
    });
}

fn show_status(ui: &mut Ui, view: &View<'_>) {
    let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(10, 4));
    egui::Panel::bottom(Id::new("status")).frame(frame).show(ui, |ui| {
        let right = |ui: &mut Ui| {
            let Some(frame) = view.frame else { return };
            ui.label(format!("{} of {} samples", frame.samples, frame.goal));
            ui.separator();
            ui.label(format!("{} rays/s", performance::rate(frame.rays_per_second)));
            ui.separator();
            let (width, height) = frame.size;
            ui.label(if frame.scale > 1 { format!("{width} x {height}, 1:{}", frame.scale) } else { format!("{width} x {height}") });
            if let Some(latency) = view.latency_ms {
                ui.separator();
                ui.label(format!("{latency:.0} ms")).on_hover_text("Median time from an input to the picture that answers it");
            }
        };
        let left = |ui: &mut Ui| match (view.message, view.frame) {
            (Some(message), _) => ui.colored_label(ACCENT, message),
            (None, Some(frame)) => ui.weak(&frame.backend),
            (None, None) => ui.weak(view.device),
        };
        egui::Sides::new().shrink_left().truncate().show(ui, left, right);
    });
}

fn show_side(ui: &mut Ui, view: &View<'_>, editor: &mut Editor<'_>) {
    let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(10);
    egui::Panel::right(Id::new("panels")).default_size(356.0).size_range(320.0..=600.0).frame(frame).show(ui, |ui| {
        show_head(ui, view, editor);
        ui.separator();
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            section(ui, "Picture", true, |ui| show_picture(ui, view, editor));
            section(ui, "Bending", true, |ui| show_bending(ui, view, editor));
            section(ui, "Camera", true, |ui| show_camera(ui, view, editor));
            section(ui, "Performance", true, |ui| performance::show(ui, view));
            section(ui, "Sampling", false, |ui| editor.parameters(ui, &parameters::film()));
            section(ui, "Integrator", false, |ui| editor.parameters(ui, &parameters::integrator(view.document)));
            section(ui, "Materials", false, |ui| {
                let groups = [parameters::materials(view.document), parameters::discs(view.document)].concat();
                show_groups(ui, editor, &groups, false);
            });
            section(ui, "Sky", false, |ui| show_groups(ui, editor, &parameters::environment(view.document), true));
        });
    });
}

fn show_head(ui: &mut Ui, view: &View<'_>, editor: &mut Editor<'_>) {
    let name = view.document.name();
    let title = name.file_stem().unwrap_or(name.as_os_str()).to_string_lossy().into_owned();
    let left = |ui: &mut Ui| ui.heading(title).on_hover_text(name.display().to_string());
    let right = |ui: &mut Ui| {
        if ui.small_button("Hide").on_hover_text("Hide the panels (Tab)").clicked() {
            editor.actions.push(Action::HidePanels);
        }
        if ui.small_button("Keys").on_hover_text("Show the keys (F1)").clicked() {
            editor.actions.push(Action::Help(!view.help));
        }
    };
    egui::Sides::new().shrink_left().truncate().show(ui, left, right);
}

fn section(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(open).show_background(true).show_unindented(ui, |ui| {
        contents(ui);
        ui.add_space(4.0);
    });
}

fn show_groups(ui: &mut Ui, editor: &mut Editor<'_>, groups: &[Group], open: bool) {
    if groups.is_empty() {
        ui.weak("The scene has none.");
    }
    for group in groups {
        editor.group(ui, group, open);
    }
}

/// A row with a label, of something that is not a parameter of the scene.
fn row(ui: &mut Ui, text: &str, hint: &str, contents: impl FnOnce(&mut Ui)) {
    ui.horizontal(|ui| {
        label(ui, text, true, hint);
        contents(ui);
    });
}

fn show_picture(ui: &mut Ui, view: &View<'_>, editor: &mut Editor<'_>) {
    let actions = &mut editor.actions;
    let development = view.development;
    row(ui, "Channel", "Which value of the film is shown (1 to 9 and 0)", |ui| {
        ComboBox::from_id_salt("channel").selected_text(development.channel.label()).width(ui.available_width()).show_ui(ui, |ui| {
            for channel in Channel::ALL {
                if ui.selectable_label(channel == development.channel, channel.label()).clicked() {
                    actions.push(Action::Channel(channel));
                }
            }
        });
    });
    row(ui, "Exposure", "In stops (+ and -)", |ui| {
        let mut exposure = development.exposure;
        if wide(ui, Slider::new(&mut exposure, -10.0..=10.0).step_by(0.05)).changed() {
            actions.push(Action::Exposure(exposure));
        }
    });
    row(ui, "Tone curve", "How bright light is fitted into a picture", |ui| {
        let name = TONE_MAPS.iter().find(|(curve, _)| *curve == development.tone_map).map_or("", |(_, name)| *name);
        ComboBox::from_id_salt("tone curve").selected_text(name).width(ui.available_width()).show_ui(ui, |ui| {
            for (curve, name) in TONE_MAPS {
                if ui.selectable_label(curve == development.tone_map, name).clicked() {
                    actions.push(Action::ToneMap(curve));
                }
            }
        });
    });
    row(ui, "Save", "Files are named after the scene", |ui| {
        for (text, hint, action) in [
            ("Picture", "PNG, as shown (P)", Action::Screenshot),
            ("Film", "EXR, all channels (F)", Action::SaveFilm),
            ("Scene", "TOML, as it is now (Ctrl+S)", Action::SaveScene),
        ] {
            if ui.button(text).on_hover_text(hint).clicked() {
                actions.push(action);
            }
        }
    });
}

fn show_bending(ui: &mut Ui, view: &View<'_>, editor: &mut Editor<'_>) {
    ui.horizontal(|ui| {
        let mut bending = view.bending;
        if ui.checkbox(&mut bending, "Bend light").on_hover_text("Straight light for comparison (B)").changed() {
            editor.actions.push(Action::Bending(bending));
        }
        let mut split = view.split.is_some();
        if ui.checkbox(&mut split, "Split view").on_hover_text("Straight on the left, bent on the right (V)").changed() {
            editor.actions.push(Action::Split(split.then_some(0.5)));
        }
    });
    if let Some(mut split) = view.split {
        row(ui, "Border", "It can be dragged in the picture too", |ui| {
            if wide(ui, Slider::new(&mut split, 0.0..=1.0)).changed() {
                editor.actions.push(Action::Split(Some(split)));
            }
        });
    }
    show_groups(ui, editor, &parameters::spacetime(view.document), true);
}

fn show_camera(ui: &mut Ui, view: &View<'_>, editor: &mut Editor<'_>) {
    editor.parameters(ui, &parameters::camera(view.document));
    row(ui, "Velocity", "Of the observer along the viewing direction, in units of light's", |ui| {
        let mut velocity = view.velocity;
        if wide(ui, Slider::new(&mut velocity, -0.99..=0.99)).changed() {
            editor.actions.push(Action::Velocity(velocity));
        }
    });
    let at = view.scene.camera.position.to_array().map(|c| shown(c, 0..=0)).join(", ");
    row(ui, "Position", "Left drag orbits, right drag looks around, W A S D fly", |ui| {
        ui.label(at);
        if ui.small_button("Reset").on_hover_text("Back to where the scene has it (R)").clicked() {
            editor.actions.push(Action::ResetCamera);
        }
    });
}

/// The line between straight and bent light. The window drags it, with or without panels.
fn show_border(ui: &Ui, split: f64) {
    let window = ui.ctx().viewport_rect();
    let free = ui.available_rect_before_wrap();
    let x = window.left() + split as f32 * window.width();
    if !free.x_range().contains(x) {
        return;
    }
    let pointer = ui.input(|i| i.pointer.hover_pos()).filter(|p| free.contains(*p) && !ui.ctx().is_pointer_over_egui());
    let color = if pointer.is_some_and(|p| f64::from((p.x - x).abs()) < GRIP) {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
        ACCENT
    } else {
        Color32::WHITE
    };
    let painter = ui.painter();
    painter.vline(x, free.y_range(), Stroke::new(1.0, color));
    painter.circle(pos2(x, free.center().y), 5.0, color, Stroke::new(1.0, Color32::BLACK));
    let tag = |at: egui::Pos2, anchor: Align2, text: &str| {
        let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::WHITE);
        let rect = anchor.anchor_size(at, galley.size());
        painter.rect_filled(rect.expand2(vec2(6.0, 3.0)), 4.0, Color32::from_black_alpha(150));
        painter.galley(rect.min, galley, Color32::WHITE);
    };
    tag(pos2(x - 14.0, free.top() + 12.0), Align2::RIGHT_TOP, "straight");
    tag(pos2(x + 14.0, free.top() + 12.0), Align2::LEFT_TOP, "bent");
}

/// What is known about the picked ray, and the map.
fn show_pick(ctx: &egui::Context, map: &mut Map, view: &View<'_>, pick: &Pick) -> Option<Action> {
    let mut open = true;
    let place = ctx.content_rect().left_top() + vec2(16.0, 16.0);
    egui::Window::new("Picked ray").open(&mut open).default_pos(place).default_size([400.0, 560.0]).collapsible(false).show(ctx, |ui| {
        egui::Grid::new("pick").num_columns(2).spacing([16.0, 4.0]).show(ui, |ui| {
            for (name, value) in facts(pick) {
                ui.weak(name);
                ui.label(value);
                ui.end_row();
            }
        });
        ui.add_space(4.0);
        map.show(ui, view.scene, pick);
    });
    (!open).then_some(Action::ClearPick)
}

fn facts(pick: &Pick) -> [(&'static str, String); 6] {
    let number = |value: f64| shown(value, 0..=0);
    let seen = match pick.status {
        STATUS_HIT if !pick.material.is_empty() => format!("{} of {}", pick.object_name, pick.material),
        STATUS_CAPTURED => "nothing: the ray was captured".into(),
        STATUS_EXHAUSTED => "nothing: the ray ran out of steps".into(),
        _ => pick.object_name.clone(),
    };
    let shift = if pick.redshift > 0.0 {
        format!("g = {}, z = {}", number(pick.redshift), number(1.0 / pick.redshift - 1.0))
    } else {
        "none".into()
    };
    [
        ("Pixel", format!("{}, {}", pick.pixel.0, pick.pixel.1)),
        ("Seen there", seen),
        ("End of the ray", pick.position.map(number).join(", ")),
        ("Redshift", shift),
        ("Length", number(pick.length)),
        ("Work", format!("{} steps, {} chords", pick.steps, pick.chords)),
    ]
}
