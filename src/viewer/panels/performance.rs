//! How fast the picture comes about, and where the time goes.

use super::controls::shown;
use crate::viewer::history::History;
use crate::viewer::model::{FrameInfo, View};
use egui::{Align2, Color32, FontId, Grid, ProgressBar, RichText, Sense, Stroke, Ui, pos2, vec2};

/// Colours of kernels, by their order.
const COLORS: [Color32; 8] = [
    Color32::from_rgb(104, 170, 255),
    Color32::from_rgb(255, 176, 82),
    Color32::from_rgb(118, 214, 140),
    Color32::from_rgb(240, 110, 120),
    Color32::from_rgb(190, 140, 255),
    Color32::from_rgb(90, 214, 214),
    Color32::from_rgb(240, 220, 110),
    Color32::from_rgb(230, 150, 200),
];

/// Frames over the whole width of the plot, at least.
const PLOTTED: usize = 60;

/// The section.
pub fn show(ui: &mut Ui, view: &View<'_>) {
    let Some(frame) = view.frame else {
        ui.weak("No picture yet.");
        return;
    };
    let done = frame.samples as f32 / frame.goal.max(1) as f32;
    ui.add(ProgressBar::new(done).desired_height(14.0).text(RichText::new(format!("{} of {}", frame.samples, frame.goal)).small()));
    show_numbers(ui, view, frame);
    show_kernels(ui, frame);
    show_history(ui, view.history, frame);
}

fn show_numbers(ui: &mut Ui, view: &View<'_>, frame: &FrameInfo) {
    let statistics = &frame.statistics;
    let lost = 100.0 * statistics.exhausted as f64 / statistics.rays.max(1) as f64;
    let mut numbers = vec![
        ("Rays", format!("{} per second", rate(frame.rays_per_second))),
        ("Steps", format!("{} per second", rate(frame.steps_per_second))),
        ("Out of steps", format!("{} % of all rays", shown(lost, 0..=0))),
        ("Renders on", frame.backend.clone()),
        ("Window on", view.device.to_owned()),
    ];
    if statistics.invalid > 0 {
        numbers.push(("Not a number", format!("{} samples", statistics.invalid)));
    }
    Grid::new("numbers").num_columns(2).spacing([12.0, 3.0]).show(ui, |ui| {
        for (name, value) in numbers {
            ui.weak(name);
            ui.add(egui::Label::new(&value).truncate()).on_hover_text(value);
            ui.end_row();
        }
    });
}

fn color(index: usize) -> Color32 {
    COLORS[index % COLORS.len()]
}

fn show_kernels(ui: &mut Ui, frame: &FrameInfo) {
    let total: f64 = frame.timings.iter().map(|t| t.time.as_secs_f64()).sum();
    if total <= 0.0 {
        return;
    }
    ui.add_space(4.0);
    Grid::new("kernels").num_columns(4).spacing([12.0, 2.0]).show(ui, |ui| {
        for heading in ["Kernel", "Runs", "Time", "Share"] {
            ui.label(RichText::new(heading).small().weak());
        }
        ui.end_row();
        for (i, timing) in frame.timings.iter().enumerate() {
            let seconds = timing.time.as_secs_f64();
            ui.label(RichText::new(&timing.kernel).color(color(i)));
            ui.label(timing.count.to_string());
            ui.label(format!("{} ms", shown(1e3 * seconds, 0..=0)));
            ui.label(format!("{:.0} %", 100.0 * seconds / total));
            ui.end_row();
        }
    });
}

/// Time of each kernel in the last frames, and in grey that of whole frames where it fits in.
fn show_history(ui: &mut Ui, history: &History, frame: &FrameInfo) {
    ui.add_space(4.0);
    let (response, painter) = ui.allocate_painter(vec2(ui.available_width(), 84.0), Sense::hover());
    let rect = response.rect;
    let weak = ui.visuals().weak_text_color();
    painter.rect_filled(rect, 4.0, ui.visuals().extreme_bg_color);
    let largest = history.frames.iter().flat_map(|f| &f.kernels).fold(0.0, |a: f32, (_, time)| a.max(*time));
    let top = if largest > 0.0 { 1.1 * largest } else { 50.0 };
    let step = rect.width() / history.frames.len().max(PLOTTED) as f32;
    let line = |time: &dyn Fn(usize) -> Option<f32>, color: Color32| {
        let newest = history.frames.len();
        let point =
            |i: usize| Some(pos2(rect.right() - step * (newest - i) as f32, rect.bottom() - rect.height() * time(i)?.min(top) / top));
        painter.line((0..newest).filter_map(point).collect(), Stroke::new(1.0, color));
    };
    line(&|i| Some(history.frames.get(i)?.interval), weak.gamma_multiply(0.5));
    for (k, timing) in frame.timings.iter().enumerate() {
        let time = |i: usize| history.frames.get(i)?.kernels.iter().find(|(name, _)| *name == timing.kernel).map(|(_, time)| *time);
        line(&time, color(k));
    }
    let text = format!("{} ms", shown(f64::from(top), 0..=0));
    painter.text(rect.left_top() + vec2(5.0, 3.0), Align2::LEFT_TOP, text, FontId::proportional(10.0), weak);
    response.on_hover_text("Time of each kernel in the last frames; grey: of whole frames");
}

/// A count per second in thousands, millions or billions.
pub fn rate(value: f64) -> String {
    let (factor, unit) = match value {
        v if v >= 1e9 => (1e9, " G"),
        v if v >= 1e6 => (1e6, " M"),
        v if v >= 1e3 => (1e3, " k"),
        _ => (1.0, ""),
    };
    let scaled = value / factor;
    let decimals = if scaled < 100.0 { 1 } else { 0 };
    format!("{scaled:.decimals$}{unit}")
}
