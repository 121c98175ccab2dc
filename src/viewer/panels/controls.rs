//! Widgets of the parameters: a row each, with the label on the left and the control on the right.

use crate::viewer::document::Document;
use crate::viewer::model::Action;
use crate::viewer::parameters::{Choose, Control, Group, Number, Parameter, admissible, array, remove, set, settle, tidy};
use egui::collapsing_header::{CollapsingState, paint_default_icon};
use egui::{Align2, Button, ComboBox, DragValue, Label, Sense, Slider, SliderClamping, TextStyle, Ui, vec2};
use glam::DVec3;
use std::ops::RangeInclusive;
use toml_edit::Value;

/// Width of the labels.
const LABEL: f32 = 104.0;

/// Room for a slider's number.
const NUMBER: f32 = 72.0;

/// Said of options that the scene does not allow.
const REFUSED: &str = "Not with this scene: something in it needs another model, or the camera would be where no light can be followed";

/// Draws parameters of a document and gathers what a person does to them.
pub struct Editor<'a> {
    /// The scene.
    pub document: &'a Document,
    /// Where the camera is: edits keep it where light can be followed.
    pub camera: DVec3,
    /// What is to be done.
    pub actions: Vec<Action>,
}

impl Editor<'_> {
    /// A group under its heading, if it has one.
    pub fn group(&mut self, ui: &mut Ui, group: &Group, open: bool) {
        if group.title.is_empty() {
            return self.contents(ui, group);
        }
        let id = ui.make_persistent_id(("group", &group.title));
        let mut state = CollapsingState::load_with_default_open(ui.ctx(), id, open);
        let header = ui.horizontal(|ui| {
            state.show_toggle_button(ui, paint_default_icon);
            if let Some(color) = group.swatch {
                let (rect, _) = ui.allocate_exact_size(vec2(14.0, 14.0), Sense::hover());
                let largest = color.iter().fold(1.0, |a: f64, c| a.max(*c));
                let [r, g, b] = color.map(|c| (c / largest) as f32);
                ui.painter().rect_filled(rect, 3.0, egui::Rgba::from_rgb(r, g, b));
            }
            if ui.add(Label::new(&group.title).selectable(false).sense(Sense::click())).clicked() {
                state.toggle(ui);
            }
        });
        state.show_body_indented(&header.response, ui, |ui| self.contents(ui, group));
    }

    fn contents(&mut self, ui: &mut Ui, group: &Group) {
        self.parameters(ui, &group.parameters);
        if group.buttons.is_empty() {
            return;
        }
        ui.horizontal(|ui| {
            for (label, actions) in &group.buttons {
                if ui.small_button(*label).clicked() && self.fits(actions) {
                    self.actions.extend(actions.iter().cloned());
                }
            }
        });
    }

    /// A row for each parameter.
    pub fn parameters(&mut self, ui: &mut Ui, parameters: &[Parameter]) {
        for parameter in parameters {
            ui.push_id(&parameter.key, |ui| ui.horizontal(|ui| self.row(ui, parameter)));
        }
    }

    fn row(&mut self, ui: &mut Ui, parameter: &Parameter) {
        let key = &parameter.key;
        let given = self.document.get(key).is_some();
        let hint = if parameter.needed || !given {
            parameter.hint.to_owned()
        } else {
            format!("{}. Double-click for the default.", parameter.hint)
        };
        if label(ui, parameter.label, given, &hint).double_clicked() && given && !parameter.needed {
            self.apply_if_it_fits(vec![remove(key)]);
        }
        match &parameter.control {
            Control::Number(number) => self.number(ui, key, number),
            Control::Whole { range, fallback } => self.whole(ui, key, range, *fallback),
            Control::Vector { fallback, speed, direction } => self.vector(ui, key, *fallback, *speed, *direction),
            Control::Color { fallback, bright } => self.color(ui, key, *fallback, *bright),
            Control::List { range, count } => self.list(ui, key, range, count),
            Control::Flag { fallback } => {
                let mut value = self.document.flag(key).unwrap_or(*fallback);
                if ui.checkbox(&mut value, "").changed() {
                    self.actions.push(set(key, value));
                }
            }
            Control::Choice { options, fallback, choose } => self.choice(ui, key, options, fallback, *choose),
        }
    }

    fn fits(&self, actions: &[Action]) -> bool {
        admissible(self.document, self.camera, actions) || !admissible(self.document, self.camera, &[])
    }

    fn apply_if_it_fits(&mut self, actions: Vec<Action>) {
        if self.fits(&actions) {
            self.actions.extend(actions);
        }
    }

    fn settle(&mut self, key: &str, from: &[f64], to: &[f64], value: fn(&[f64]) -> Value) {
        self.actions.extend(settle(self.document, self.camera, key, from, to, value));
    }

    fn number(&mut self, ui: &mut Ui, key: &str, number: &Number) {
        let given = self.document.number(key);
        if let Some(meaning) = number.absent {
            let mut on = given.is_some();
            let label = if on { "" } else { meaning };
            if ui.checkbox(&mut on, label).changed() {
                self.apply_if_it_fits(vec![if on { set(key, tidy(number.fallback)) } else { remove(key) }]);
            }
            if given.is_none() {
                return;
            }
        }
        let now = given.unwrap_or(number.fallback);
        // What a slow slider shows until it is let go.
        let id = ui.id().with("waiting");
        let waiting = ui.data(|data| data.get_temp::<f64>(id));
        let mut value = waiting.unwrap_or(now);
        let smallest = 1e-4 * number.range.start().abs().max(number.range.end().abs());
        let slider = Slider::new(&mut value, number.range.clone()).logarithmic(number.logarithmic).smallest_positive(smallest);
        let held = wide(ui, slider).dragged();
        if number.slow && held {
            ui.data_mut(|data| data.insert_temp(id, value));
            return;
        }
        if waiting.is_some() {
            ui.data_mut(|data| data.remove::<f64>(id));
        }
        // A slider that is held still says the same again, but for rounding.
        if tidy(value) != tidy(now) {
            self.settle(key, &[now], &[value], scalar);
        }
    }

    fn whole(&mut self, ui: &mut Ui, key: &str, range: &RangeInclusive<i64>, fallback: i64) {
        let now = self.document.number(key).map_or(fallback, |value| value as i64);
        let mut value = now;
        let slider = Slider::new(&mut value, range.clone()).logarithmic(*range.end() > 100);
        if wide(ui, slider).changed() && value != now {
            self.actions.push(set(key, value));
        }
    }

    fn vector(&mut self, ui: &mut Ui, key: &str, fallback: [f64; 3], speed: f64, direction: bool) {
        let now = self.document.vector(key).unwrap_or(fallback);
        let mut value = now;
        for component in &mut value {
            ui.add(drag(component, speed, -1e6..=1e6));
        }
        if value != now && !(direction && DVec3::from(value).length() < 1e-3) {
            self.settle(key, &now, &value, array);
        }
    }

    fn list(&mut self, ui: &mut Ui, key: &str, range: &RangeInclusive<f64>, count: &RangeInclusive<usize>) {
        let now = self.document.numbers(key).unwrap_or_default();
        let mut value = now.clone();
        ui.horizontal_wrapped(|ui| {
            for number in &mut value {
                ui.add(drag(number, 0.01, range.clone()));
            }
            if now.len() < *count.end() && ui.small_button("+").clicked() {
                self.apply_if_it_fits(vec![set(key, array(&[now.as_slice(), &[0.0]].concat()))]);
            }
            if now.len() > *count.start() && ui.small_button("-").clicked() {
                self.apply_if_it_fits(vec![set(key, array(&now[..now.len() - 1]))]);
            }
        });
        if value != now {
            self.settle(key, &now, &value, array);
        }
    }

    /// A colour; one that may be brighter than 1 is a colour times a brightness, which is remembered while the window is open.
    fn color(&mut self, ui: &mut Ui, key: &str, fallback: [f64; 3], bright: bool) {
        let now = self.document.vector(key).unwrap_or(fallback);
        let id = ui.id().with("brightness");
        let largest = now.iter().fold(0.0, |a: f64, c| a.max(*c));
        let remembered = ui.data(|data| data.get_temp::<f64>(id)).unwrap_or(1.0).max(1e-6);
        // Rounding must not make the remembered brightness grow.
        let mut brightness = if largest > remembered * (1.0 + 1e-4) { largest } else { remembered };
        let mut color = now.map(|c| (c / brightness) as f32);
        let mut changed = ui.color_edit_button_rgb(&mut color).changed();
        if bright {
            let speed = 0.01 * brightness;
            let factor = drag(&mut brightness, speed, 1e-3..=1e6).prefix("x ");
            changed |= ui.add(factor).on_hover_text("Brightness: factor on the colour").changed();
            ui.data_mut(|data| data.insert_temp(id, brightness));
        }
        let limit = if bright { 1e9 } else { 1.0 };
        let value = color.map(|c| (f64::from(c) * brightness).clamp(0.0, limit));
        // An open picker says the same again, but for rounding.
        let moved = value.iter().zip(&now).any(|(a, b)| (a - b).abs() > 1e-4 * brightness);
        if changed && moved {
            self.actions.push(set(key, array(&value)));
        }
    }

    fn choice(&mut self, ui: &mut Ui, key: &str, options: &[(&str, &str)], fallback: &str, choose: Choose) {
        let now = self.document.word(key).unwrap_or(fallback);
        let named = options.iter().find(|(word, _)| *word == now).map_or(now, |(_, name)| *name);
        ComboBox::from_id_salt("choice").selected_text(named).width(ui.available_width()).truncate().show_ui(ui, |ui| {
            for (word, name) in options {
                let actions = choose(self.document, key, word);
                let button = Button::selectable(*word == now, *name);
                let response = ui.add_enabled(*word == now || self.fits(&actions), button).on_disabled_hover_text(REFUSED);
                if response.clicked() && *word != now {
                    self.actions.extend(actions);
                }
            }
        });
    }
}

/// The label of a row: bright if the scene says something about it, dim where a default is shown.
pub fn label(ui: &mut Ui, text: &str, bright: bool, hint: &str) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(vec2(LABEL, ui.spacing().interact_size.y), Sense::click());
    let color = if bright { ui.visuals().text_color() } else { ui.visuals().weak_text_color() };
    let font = TextStyle::Body.resolve(ui.style());
    ui.painter_at(rect).text(rect.left_center(), Align2::LEFT_CENTER, text, font, color);
    response.on_hover_text(hint)
}

/// A slider over the rest of the row. A value outside its range stays until it is moved.
pub fn wide(ui: &mut Ui, slider: Slider<'_>) -> egui::Response {
    ui.spacing_mut().slider_width = (ui.available_width() - NUMBER).max(40.0);
    ui.add(slider.clamping(SliderClamping::Edits).update_while_editing(false).custom_formatter(shown))
}

fn drag(value: &mut f64, speed: f64, range: RangeInclusive<f64>) -> DragValue<'_> {
    DragValue::new(value).speed(speed).range(range).clamp_existing_to_range(false).update_while_editing(false).custom_formatter(shown)
}

fn scalar(values: &[f64]) -> Value {
    values.first().copied().unwrap_or_default().into()
}

/// A number with four digits.
pub fn shown(value: f64, _: RangeInclusive<usize>) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let decimals = if size == 0.0 { 0 } else { (3 - size.log10().floor() as i32).clamp(0, 6) as usize };
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
