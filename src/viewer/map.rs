//! A picked ray seen from above: x to the right, z up, the things of the scene in outline.

use super::model::Pick;
use crate::kernels::constants::STATUS_HIT;
use crate::scene::mesh::Mesh;
use crate::scene::{AccretionDisc, Camera, Geometry, Scene, Shape, Spacetime};
use crate::spacetime::ModelKind;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Sense, Stroke, StrokeKind, vec2};
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::{Arc, Weak};

/// Shapes beyond this many are left out.
const MAX_SHAPES: usize = 4000;

/// Corners of a circle's outline.
const CORNERS: u32 = 64;

const RAY: Color32 = Color32::from_rgb(255, 196, 72);
const STRAIGHT: Color32 = Color32::from_rgb(120, 130, 150);
const EYE: Color32 = Color32::from_rgb(120, 200, 255);
const FIELD: Color32 = Color32::from_rgb(190, 130, 255);

/// Where a map looks: kept from frame to frame, fitted anew to every picked ray.
#[derive(Clone, Debug, Default)]
pub struct Map {
    /// Middle of the map in the world's x and z.
    center: DVec2,
    /// Scene units from the middle to the nearest border.
    reach: f64,
    /// The pick it was fitted to: its pixel and its end.
    fitted: Option<((u32, u32), [f64; 3])>,
    /// Borders of meshes, which take long to find, by addresses that nothing else gets as long as they are watched.
    meshes: HashMap<usize, (Weak<Mesh>, [DVec2; 2])>,
}

/// From the world to the window.
#[derive(Clone, Copy)]
struct Projection {
    rect: Rect,
    center: DVec2,
    points_per_unit: f64,
}

impl Projection {
    fn pos(&self, at: DVec2) -> Pos2 {
        let offset = (at - self.center) * self.points_per_unit;
        self.rect.center() + vec2(offset.x as f32, -offset.y as f32)
    }

    fn length(&self, length: f64) -> f32 {
        (length * self.points_per_unit) as f32
    }
}

fn above(point: DVec3) -> DVec2 {
    DVec2::new(point.x, point.z)
}

impl Map {
    /// Draws the map into the rest of the ui. The wheel zooms, a drag moves it, a double click fits it to the ray again.
    pub fn show(&mut self, ui: &mut egui::Ui, scene: &Scene, pick: &Pick) {
        let size = ui.available_size().max(vec2(120.0, 120.0));
        let (response, painter) = ui.allocate_painter(size, Sense::click_and_drag());
        let now = Some((pick.pixel, pick.position));
        if self.fitted != now || response.double_clicked() {
            self.meshes.clear();
            self.fit(scene, pick);
            self.fitted = now;
        }
        let rect = response.rect;
        let half = f64::from(0.5 * rect.width().min(rect.height()));
        let world = |points: egui::Vec2, reach: f64| DVec2::new(f64::from(points.x), -f64::from(points.y)) * reach / half;
        self.center -= world(response.drag_delta(), self.reach);
        if let Some(pointer) = response.hover_pos() {
            // What is under the pointer stays there.
            let zoomed = (self.reach / f64::from(ui.input(|i| i.smooth_scroll_delta().y) / 240.0).exp()).clamp(1e-6, 1e9);
            let offset = pointer - rect.center();
            self.center += world(offset, self.reach) - world(offset, zoomed);
            self.reach = zoomed;
        }
        let projection = Projection { rect, center: self.center, points_per_unit: half / self.reach };
        self.draw(ui, &painter, &projection, scene, pick);
    }

    /// Shows the camera, the model's center, and where the ray ends if it ends on something.
    fn fit(&mut self, scene: &Scene, pick: &Pick) {
        let camera = above(scene.camera.position);
        let mut points = vec![camera, above(scene.spacetime.position)];
        if pick.status == STATUS_HIT {
            points.push(above(pick.position.into()));
        }
        let low = points.iter().fold(camera, |a, p| a.min(*p));
        let high = points.iter().fold(camera, |a, p| a.max(*p));
        self.center = (low + high) / 2.0;
        self.reach = (0.65 * (high - low).max_element()).max(0.05 * scene.camera.focus_distance).max(1e-6);
    }

    fn draw(&mut self, ui: &egui::Ui, painter: &Painter, projection: &Projection, scene: &Scene, pick: &Pick) {
        let visuals = ui.visuals();
        painter.rect_filled(projection.rect, 4.0, visuals.extreme_bg_color);
        draw_grid(painter, projection, visuals.weak_text_color());
        for shape in scene.shapes.iter().take(MAX_SHAPES) {
            self.draw_shape(painter, projection, scene, shape);
        }
        draw_field(painter, projection, &scene.spacetime);
        draw_path(painter, projection, &scene.camera, pick);
        draw_camera(painter, projection, &scene.camera);
        painter.rect_stroke(projection.rect, 4.0, visuals.window_stroke, StrokeKind::Inside);
    }

    fn draw_shape(&mut self, painter: &Painter, projection: &Projection, scene: &Scene, shape: &Shape) {
        let color = shape_color(scene, shape);
        let stroke = Stroke::new(1.0, color);
        let outline = match &shape.geometry {
            Geometry::Sphere { center, radius } => {
                let (center, radius) = (projection.pos(above(*center)), projection.length(*radius));
                painter.circle(center, radius, color.gamma_multiply(0.15), stroke);
                return;
            }
            Geometry::Box { world_from_unit } => {
                let corner = |i: u32| {
                    let unit = DVec3::new(f64::from(i & 1), f64::from((i >> 1) & 1), f64::from((i >> 2) & 1));
                    projection.pos(above(world_from_unit.transform_point3(unit)))
                };
                for (from, axis) in (0..8).flat_map(|i| [1, 2, 4].map(|axis| (i, axis))) {
                    if from & axis == 0 {
                        painter.line_segment([corner(from), corner(from | axis)], stroke);
                    }
                }
                return;
            }
            Geometry::Quad { corner, u, v } => [*corner, corner + u, corner + u + v, corner + v].map(above).to_vec(),
            Geometry::Disc { center, normal, outer_radius, .. } => circle(*center, *normal, *outer_radius),
            Geometry::AccretionDisc(disc) => circle(disc.center, disc.normal, outer_radius(disc, scene)),
            Geometry::Mesh(mesh) => {
                let entry = self.meshes.entry(Arc::as_ptr(mesh).addr());
                let (_, [low, high]) = entry.or_insert_with(|| (Arc::downgrade(mesh), borders(mesh)));
                vec![*low, DVec2::new(high.x, low.y), *high, DVec2::new(low.x, high.y)]
            }
        };
        painter.add(egui::Shape::closed_line(outline.iter().map(|p| projection.pos(*p)).collect(), stroke));
    }
}

/// The colour of a shape's material, bright enough to be seen on the map.
fn shape_color(scene: &Scene, shape: &Shape) -> Color32 {
    let material = scene.materials.get(shape.material);
    let color = material.map_or([0.5; 3], |m| if m.emission == [0.0; 3] { m.base_color } else { m.emission });
    let largest = color.iter().fold(1e-3, |a: f32, c| a.max(*c));
    let [r, g, b] = color.map(|c| 0.15 + 0.6 * c / largest);
    egui::Rgba::from_rgb(r, g, b).into()
}

fn circle(center: DVec3, normal: DVec3, radius: f64) -> Vec<DVec2> {
    let (u, v) = normal.any_orthonormal_pair();
    let corner = |i: u32| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(CORNERS)).sin_cos();
        above(center + radius * (cos * u + sin * v))
    };
    (0..CORNERS).map(corner).collect()
}

/// Radius of an accretion disc in the chart.
fn outer_radius(disc: &AccretionDisc, scene: &Scene) -> f64 {
    scene.spacetime.hole.map_or(disc.outer_radius, |hole| hole.chart_radius(disc.outer_radius))
}

fn borders(mesh: &Mesh) -> [DVec2; 2] {
    let points = mesh.positions.iter().map(|p| DVec2::new(f64::from(p[0]), f64::from(p[2])));
    points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

/// Lines at 1, 2 or 5 times a power of ten, with the distance between them written in a corner.
fn draw_grid(painter: &Painter, projection: &Projection, color: Color32) {
    let rect = projection.rect;
    let wanted = 60.0 / projection.points_per_unit;
    let decade = 10f64.powf(wanted.log10().floor());
    let spacing = [1.0, 2.0, 5.0, 10.0].map(|f| f * decade).into_iter().find(|s| *s >= wanted).unwrap_or(wanted);
    let stroke = Stroke::new(1.0, color.gamma_multiply(0.2));
    let half = DVec2::new(f64::from(rect.width()), f64::from(rect.height())) / (2.0 * projection.points_per_unit);
    let lines = |middle: f64, half: f64| ((middle - half) / spacing).ceil() as i64..=((middle + half) / spacing).floor() as i64;
    for i in lines(projection.center.x, half.x) {
        painter.vline(projection.pos(DVec2::new(i as f64 * spacing, 0.0)).x, rect.y_range(), stroke);
    }
    for i in lines(projection.center.y, half.y) {
        painter.hline(rect.x_range(), projection.pos(DVec2::new(0.0, i as f64 * spacing)).y, stroke);
    }
    let font = FontId::proportional(11.0);
    painter.text(rect.left_bottom() + vec2(6.0, -4.0), Align2::LEFT_BOTTOM, format!("grid {spacing}"), font.clone(), color);
    painter.text(rect.right_bottom() + vec2(-6.0, -4.0), Align2::RIGHT_BOTTOM, "from above: x right, z up", font, color);
}

/// Radius of what the model has around its center, and whether it swallows light.
fn field_radius(spacetime: &Spacetime) -> (f64, bool) {
    let value = |i: usize| spacetime.global.get(i).copied().unwrap_or(0.0);
    let root = |a: f64| a.max(0.0).sqrt();
    match spacetime.model {
        ModelKind::Schwarzschild => (0.5 * value(0), true),
        ModelKind::ReissnerNordstrom => (0.5 * root(value(0).powi(2) - value(1).powi(2)), true),
        ModelKind::KerrNewman => (value(3).hypot(value(1)), true),
        ModelKind::Ellis | ModelKind::Dneg => (spacetime.throat, false),
        ModelKind::Alcubierre | ModelKind::Fisheye => (value(1), false),
        ModelKind::Luneburg | ModelKind::DustDisc => (value(0), false),
        ModelKind::Radial => (value(5), false),
        _ => (0.0, false),
    }
}

/// Marks the model's center, its horizon, throat or border, and its sources.
fn draw_field(painter: &Painter, projection: &Projection, spacetime: &Spacetime) {
    if spacetime.model == ModelKind::Flat {
        return;
    }
    let stroke = Stroke::new(1.5, FIELD);
    let (radius, swallows) = field_radius(spacetime);
    let center = projection.pos(above(spacetime.position));
    let fill = if swallows { Color32::BLACK } else { FIELD.gamma_multiply(0.08) };
    painter.circle(center, projection.length(radius), fill, stroke);
    for arm in [vec2(4.0, 0.0), vec2(0.0, 4.0)] {
        painter.line_segment([center - arm, center + arm], stroke);
    }
    let placed =
        matches!(spacetime.model, ModelKind::ThesisGravity | ModelKind::PowerGravity | ModelKind::MajumdarPapapetrou | ModelKind::WeakLens);
    if placed {
        for source in spacetime.sources.chunks_exact(spacetime.model.source_stride()) {
            let position = spacetime.position + DVec3::from_slice(source);
            painter.circle_filled(projection.pos(above(position)), 4.0, FIELD);
        }
    }
}

/// Draws the ray, and where straight light would have gone.
fn draw_path(painter: &Painter, projection: &Projection, camera: &Camera, pick: &Pick) {
    let points: Vec<Pos2> = pick.path.iter().map(|p| projection.pos(above(DVec3::from(*p)))).collect();
    if let [first, second, ..] = points[..] {
        let direction = (second - first).normalized();
        let far = first + direction * (2.0 * projection.rect.size().length() + first.distance(projection.rect.center()));
        painter.line_segment([first, far], Stroke::new(1.0, STRAIGHT));
    }
    if points.len() > 1 {
        painter.line(points, Stroke::new(2.0, RAY));
    }
    let end = projection.pos(above(DVec3::from(pick.position)));
    if pick.status == STATUS_HIT && end != projection.pos(above(camera.position)) {
        painter.circle(end, 4.0, RAY, Stroke::new(1.0, Color32::BLACK));
    }
}

/// A small triangle that points where the camera looks.
fn draw_camera(painter: &Painter, projection: &Projection, camera: &Camera) {
    let at = projection.pos(above(camera.position));
    let forward = above(camera.forward).normalize_or(DVec2::Y);
    let forward = vec2(forward.x as f32, -forward.y as f32);
    let side = forward.rot90();
    let corners = vec![at + forward * 9.0, at - forward * 5.0 + side * 5.0, at - forward * 5.0 - side * 5.0];
    painter.add(egui::Shape::convex_polygon(corners, EYE, Stroke::new(1.0, Color32::BLACK)));
}
