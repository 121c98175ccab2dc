//! What the viewer is made of, without a window: how the camera moves, how scenes are edited, how much is rendered at once.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use glam::DVec3;
use nullray::Error;
use nullray::backend::{
    Backend, Canvas, Development, Precision, Profiling, Timings, TraceOptions, TraceRay, TraceResult, cpu::CpuBackend, path::trace_path,
};
use nullray::error::Result;
use nullray::film::Film;
use nullray::kernels::constants::STATUS_ESCAPED;
use nullray::kernels::layout::SceneParameters;
use nullray::scene::{Assets, ToneMap};
use nullray::scheduler::{Interactive, Refinement, reduced};
use nullray::viewer::document::Document;
use nullray::viewer::input::{Drag, Flight, Latency};
use nullray::viewer::model::Action;
use nullray::viewer::navigation::Pose;
use nullray::viewer::subject::Subject;
use nullray::world::World;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use support::{distance, new_parameters_are_as_good_as_a_new_world, world};
use winit::keyboard::{KeyCode, PhysicalKey};

const POSE: Pose =
    Pose { position: DVec3::new(0.0, 2.0, -9.0), look_at: DVec3::new(0.0, 1.0, 0.0), up: DVec3::new(0.0, 3.0, 0.0), fov: 45.0 };

fn near(a: DVec3, b: DVec3) -> bool {
    a.distance(b) < 1e-9
}

#[test]
fn orbit_keeps_the_target_and_its_distance() {
    let turned = POSE.orbit(0.7, 0.4);
    assert_eq!(turned.look_at, POSE.look_at);
    assert!((turned.distance() - POSE.distance()).abs() < 1e-12);
    // To the camera's right and up: it looks along +z, so its right is -x.
    let small = POSE.orbit(0.01, 0.01).position - POSE.position;
    let [right, up] = POSE.right_and_up();
    assert!(small.dot(right) > 0.0 && small.dot(up) > 0.0 && right.x < -0.99, "{small} {right}");
    assert!(near(POSE.orbit(TAU, 0.0).position, POSE.position));
    assert!(near(POSE.orbit(0.3, 0.2).orbit(-0.3, -0.2).position, POSE.position));
    // Not over the pole, and back from it.
    let top = POSE.orbit(0.0, 10.0);
    assert!(top.forward().dot(DVec3::Y) > -1.0 + 1e-6 && top.position.y > POSE.position.y);
    assert!(top.right_and_up().iter().all(|v| v.is_finite()));
    assert!(near(top.orbit(0.0, 10.0).position, top.position));
}

#[test]
fn look_keeps_the_eye() {
    let turned = POSE.look(0.2, 0.1);
    assert_eq!(turned.position, POSE.position);
    assert!((turned.distance() - POSE.distance()).abs() < 1e-12);
    let [right, up] = POSE.right_and_up();
    assert!(turned.forward().dot(right) > 0.19 && turned.forward().dot(up) > 0.09);
    assert!(POSE.look(0.0, -9.0).forward().y > -1.0 + 1e-6);
}

#[test]
fn fly_takes_the_target_along_and_dolly_does_not() {
    let flown = POSE.fly([1.0, 2.0, 3.0]);
    let [right, _] = POSE.right_and_up();
    assert!(near(flown.position - POSE.position, right + DVec3::Y * 2.0 + POSE.forward() * 3.0));
    assert!(near(flown.position - POSE.position, flown.look_at - POSE.look_at));
    assert_eq!(POSE.fly([1e12, 0.0, 0.0]), POSE);
    let closer = POSE.dolly(1.0);
    assert_eq!(closer.look_at, POSE.look_at);
    assert!(closer.distance() < POSE.distance() && near(closer.dolly(-1.0).position, POSE.position));
    assert!(POSE.dolly(1e6).distance() > 0.0 && POSE.dolly(-1e6).position.is_finite());
    // A view along `up` still has a right.
    let steep = Pose { up: POSE.forward(), ..POSE };
    assert!(steep.right_and_up().iter().all(|v| (v.length() - 1.0).abs() < 1e-9));
}

#[test]
fn flight_goes_on_while_keys_are_down() {
    let (forward, left) = (PhysicalKey::Code(KeyCode::KeyW), PhysicalKey::Code(KeyCode::KeyA));
    let mut flight = Flight::default();
    assert!(!flight.is_on());
    flight.press(forward, [0, 0, 1]);
    let tap = flight.step(10.0, false);
    assert!(tap[2] > 0.0 && tap[0] == 0.0, "{tap:?}");
    flight.press(left, [-1, 0, 0]);
    std::thread::sleep(Duration::from_millis(20));
    let both = flight.step(10.0, true);
    assert!(both[0] < 0.0 && both[2] > 0.0);
    flight.release(forward);
    assert!(flight.is_on());
    flight.release(left);
    assert!(!flight.is_on());
}

#[test]
fn clicks_are_told_from_drags_and_answers_are_timed() {
    let from = glam::DVec2::new(10.0, 10.0);
    let mut drag = Drag::Orbit { from, moved: false };
    drag.follow(from + 2.0, 1.0);
    drag.follow(from + 4.0, 2.0);
    assert_eq!(drag, Drag::Orbit { from, moved: false });
    drag.follow(from + 20.0, 1.0);
    drag.follow(from, 1.0);
    assert_eq!(drag, Drag::Orbit { from, moved: true });
    let mut latency = Latency::default();
    assert_eq!((latency.median(), latency.max()), (None, None));
    let earlier = Instant::now().checked_sub(Duration::from_millis(50)).unwrap();
    latency.asked(3, earlier);
    latency.asked(4, Instant::now());
    latency.answered(2);
    assert_eq!(latency.count(), 0);
    latency.answered(4);
    assert_eq!(latency.count(), 2);
    assert!(latency.max().unwrap() >= 50.0);
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("nullray-viewing-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const SCENE: &str = "# A comment on top.
[camera]
position = [0, 1, -8] # where I stand
look_at = [0, 1, 0]

[spacetime]
kind = \"gravity\"

# The first.
[[spacetime.center]]
position = [0, 1, 0]
strength = 0.1

[[sphere]]
center = [0, 1, 3]
radius = 1
";

fn document(folder: &Folder, overrides: &[&str]) -> Document {
    let path = folder.0.join("scene.toml");
    std::fs::write(&path, SCENE).unwrap();
    let overrides: Vec<String> = overrides.iter().map(|o| o.to_string()).collect();
    Document::open(Some(&path), &overrides).unwrap()
}

#[test]
fn documents_are_edited_in_place() {
    let folder = Folder::new("edit");
    let mut document = document(&folder, &[]);
    assert_eq!(document.text(), SCENE);
    assert_eq!(document.number("spacetime.center.0.strength"), Some(0.1));
    assert_eq!(document.number("spacetime.center[0].strength"), Some(0.1));
    assert_eq!(document.vector("camera.position"), Some([0.0, 1.0, -8.0]));
    assert_eq!(document.word("spacetime.kind"), Some("gravity"));
    assert_eq!((document.count("spacetime.center"), document.count("spacetime.line")), (1, 0));
    assert_eq!(document.number("spacetime.center.1.strength"), None);

    document.set("spacetime.center.0.strength", 0.25f64.into()).unwrap();
    document.set("camera.position.2", (-9.5f64).into()).unwrap();
    document.set("film.samples", 4i64.into()).unwrap();
    document.set("spacetime.center.1", "{ position = [1, 1, 0], strength = -0.2 }".parse().unwrap()).unwrap();
    document.set("spacetime.line.0", "{ point = [0, 0, 0], direction = [0, 1, 0], strength = 0.01 }".parse().unwrap()).unwrap();
    let text = document.text();
    assert!(text.contains("# A comment on top.") && text.contains("# where I stand") && text.contains("# The first."), "{text}");
    let scene = document.to_scene(&mut Assets::default()).unwrap();
    assert_eq!(scene.film.samples, 4);
    assert_eq!(scene.camera.position, DVec3::new(0.0, 1.0, -9.5));
    assert_eq!((document.count("spacetime.center"), document.count("spacetime.line")), (2, 1));

    assert!(document.remove("spacetime.center.0") && document.remove("spacetime.line") && !document.remove("spacetime.exponent"));
    assert_eq!(document.number("spacetime.center.0.strength"), Some(-0.2));
    document.set("spacetime", "{ kind = 'kerr', mass = 0.5, spin = 0.4 }".parse().unwrap()).unwrap();
    let scene = document.to_scene(&mut Assets::default()).unwrap();
    assert_eq!(scene.spacetime.kind, "kerr");
    document.set("environment", "{ kind = 'constant', color = [1, 1, 1] }".parse().unwrap()).unwrap();
    assert!(document.text().contains("[environment]"), "{}", document.text());
    for (key, value) in [("sphere.0", "3"), ("sphere.7.radius", "1"), ("camera.position.x", "1"), ("", "1"), ("film.samples.0", "1")] {
        let refused = document.clone().set(key, value.parse().unwrap());
        assert!(refused.is_err(), "{key}: {refused:?}");
    }
}

#[test]
fn documents_are_saved_and_read_again() {
    let folder = Folder::new("save");
    let mut document = document(&folder, &["film.samples=3", "spacetime.kind=flat"]);
    assert_eq!((document.number("film.samples"), document.word("spacetime.kind")), (Some(3.0), Some("flat")));
    document.set("sphere.0.radius", 2i64.into()).unwrap();
    // The file has neither the edit nor the assignments; reading it again makes the assignments.
    let again = document.reread().unwrap();
    assert_eq!((again.number("film.samples"), again.number("sphere.0.radius")), (Some(3.0), Some(1.0)));
    let path = folder.0.join("saved.toml");
    document.save(&path).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), document.text());
    assert_eq!(document.path(), Some(path.as_path()));
    assert!(matches!(Document::open(None, &["film.samples".into()]), Err(Error::Override { .. })));
    assert!(matches!(Document::open(None, &["film.samples=(".into()]), Err(Error::Override { .. })));
    std::fs::write(&path, "[camera]\nposition = [0, 1\nlook_at = 3").unwrap();
    match document.reread() {
        Err(Error::Scene { line, .. }) => assert!((2..=3).contains(&line), "{line}"),
        other => panic!("{other:?}"),
    }
    assert!(document.save(&folder.0.join("no/such/folder.toml")).is_err());
}

#[test]
fn saving_keeps_what_others_wrote() {
    let folder = Folder::new("others");
    let mut document = document(&folder, &["film.samples=3"]);
    let path = document.path().unwrap().to_owned();
    std::fs::write(&path, "[camera\n").unwrap();
    assert!(matches!(document.save(&path), Err(Error::Io { .. })));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "[camera\n");
    std::fs::remove_file(&path).unwrap();
    document.save(&path).unwrap();
    // An assignment that the file holds is not made again.
    document.set("film.samples", 5i64.into()).unwrap();
    document.save(&path).unwrap();
    assert_eq!(document.reread().unwrap().number("film.samples"), Some(5.0));
    #[cfg(unix)]
    {
        let link = folder.0.join("link.toml");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let mut linked = Document::open(Some(&link), &[]).unwrap();
        linked.set("film.samples", 6i64.into()).unwrap();
        linked.save(&link).unwrap();
        assert!(link.is_symlink());
        assert_eq!(document.reread().unwrap().number("film.samples"), Some(6.0));
    }
}

#[test]
fn unchanged_assets_are_not_read_again() {
    let folder = Folder::new("assets");
    let mesh = folder.0.join("triangle.obj");
    std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let mut assets = Assets::default();
    let first = assets.mesh(&mesh).unwrap();
    assert!(Arc::ptr_eq(&first, &assets.mesh(&mesh).unwrap()));
    std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n").unwrap();
    let changed = assets.mesh(&mesh).unwrap();
    assert_eq!((first.parts[0].0.indices.len(), changed.parts[0].0.indices.len()), (1, 2));
    assets.forget_unused();
    assets.forget_unused();
    assert!(!Arc::ptr_eq(&changed, &assets.mesh(&mesh).unwrap()));
}

#[test]
fn the_subject_keeps_its_camera_and_saves_it() {
    let folder = Folder::new("subject");
    let document = document(&folder, &[]);
    let path = document.path().unwrap().to_owned();
    let scene = document.to_scene(&mut Assets::default()).unwrap();
    let mut subject = Subject::new(document, scene, true);
    let home = *subject.pose();
    subject.navigate(|pose| pose.orbit(0.5, 0.1));
    let away = *subject.pose();
    assert_eq!(subject.scene().camera.position, away.position);
    let others = subject.apply(vec![Action::Exposure(1.5), Action::ToneMap(ToneMap::None), Action::Velocity(0.5), Action::Screenshot]);
    assert!(matches!(others[..], [Action::Screenshot]));
    assert!((subject.scene().camera.velocity - away.forward() * 0.5).length() < 1e-12);

    // The file changes but not its camera: the view stays.
    assert!(!subject.reload_if_changed());
    std::fs::write(&path, SCENE.replace("radius = 1", "radius = 1.5")).unwrap();
    let before = subject.request(1, (4, 4)).source.number;
    assert!(subject.reload_if_changed() && subject.trouble().is_none());
    assert_eq!((*subject.pose(), subject.request(2, (4, 4)).source.number), (away, before + 1));
    // It breaks: the document stays.
    std::fs::write(&path, "[camera\n").unwrap();
    assert!(subject.reload_if_changed() && subject.trouble().is_some());
    assert_eq!(subject.document().number("sphere.0.radius"), Some(1.5));
    // Its camera moves: the view goes there.
    std::fs::write(&path, SCENE.replace("[0, 1, -8]", "[0, 1, -7]")).unwrap();
    assert!(subject.reload_if_changed() && subject.trouble().is_none());
    assert_eq!(subject.pose().position.z, -7.0);

    subject.navigate(|_| away);
    assert_eq!(subject.save(|| unreachable!("it has a file")).unwrap(), path);
    assert!(!subject.reload_if_changed());
    let saved = Document::open(Some(&path), &[]).unwrap();
    let scene = saved.to_scene(&mut Assets::default()).unwrap();
    assert!(scene.camera.position.distance(away.position) < 1e-5 && scene.camera.velocity.length() > 0.49);
    assert_eq!((scene.film.exposure, scene.film.tone_map), (1.5, ToneMap::None));
    assert!(saved.text().contains("# where I stand"), "{}", saved.text());
    let mut again = Subject::new(saved, scene, true);
    again.navigate(|_| home);
    again.apply(vec![Action::ResetCamera]);
    assert!(again.pose().position.distance(away.position) < 1e-5);
}

#[test]
fn every_save_holds_the_present_development() {
    let folder = Folder::new("development");
    let document = document(&folder, &[]);
    let path = document.path().unwrap().to_owned();
    let scene = document.to_scene(&mut Assets::default()).unwrap();
    let mut subject = Subject::new(document, scene, true);
    for stops in [2.0, 0.0, 2.0] {
        subject.apply(vec![Action::Exposure(stops)]);
        subject.save(|| unreachable!("it has a file")).unwrap();
        assert_eq!(Document::open(Some(&path), &[]).unwrap().number("film.exposure"), Some(stops));
    }
    // An edit of something else keeps what was not saved.
    subject.apply(vec![Action::Exposure(1.0), Action::Set { key: "sphere.0.radius".into(), value: 2i64.into() }]);
    let number = subject.request(1, (4, 4)).source.number;
    let mut scene = subject.document().to_scene(&mut Assets::default()).unwrap();
    assert!(!subject.loaded(number, scene.clone()));
    assert_eq!(subject.development().exposure, 1.0);
    // One of the exposure itself does not.
    scene.film.exposure = -1.0;
    assert!(subject.loaded(number, scene));
    assert_eq!(subject.development().exposure, -1.0);
}

#[test]
fn paths_lead_from_the_camera_to_the_end() {
    let mut backend = CpuBackend::new(Some(1)).unwrap();
    backend.upload(Arc::new(world("[spacetime]\nkind = \"schwarzschild\"\nmass = 0.5")), Precision::F64, 0).unwrap();
    let ray = TraceRay::looking([3.0, 0.0, -10.0], [0.0, 0.0, 1.0]);
    let options = TraceOptions { tolerance: 1e-6, stop: Default::default(), max_steps: Some(10_000) };
    let (end, path) = trace_path(&mut backend, &ray, options, 40, || true).unwrap().unwrap();
    assert_eq!(end.status, STATUS_ESCAPED);
    assert!((3..=43).contains(&path.len()), "{} points", path.len());
    assert_eq!((path[0], *path.last().unwrap()), (ray.origin, end.position));
    // It bends towards the hole, and no point is far from the way from one to the next.
    assert!(path.iter().any(|p| p[2] > 5.0 && p[0] < 2.9), "{path:?}");
    // It ends where it is told to.
    let mut left = 3;
    let go_on = || {
        left -= 1;
        left >= 0
    };
    let (_, part) = trace_path(&mut backend, &ray, options, 40, go_on).unwrap().unwrap();
    assert!((2..=4).contains(&part.len()) && path.starts_with(&part) && part.len() < path.len(), "{part:?}");
    let whole: f64 = path.windows(2).map(|w| distance(w[0], w[1])).sum();
    assert!(whole <= end.length * (1.0 + 1e-9) && whole > 0.9 * end.length, "{whole} of {}", end.length);
}

#[test]
fn a_moved_camera_needs_no_new_world() {
    new_parameters_are_as_good_as_a_new_world(&mut CpuBackend::new(None).unwrap());
}

/// A backend whose pixels cost what they are told to, and which counts what is asked of it.
struct Dummy {
    width: u32,
    per_pixel: Duration,
    per_call: Duration,
    samples: Vec<u32>,
    longest: Duration,
}

impl Dummy {
    fn new((width, height): (u32, u32), per_pixel: Duration) -> Dummy {
        Dummy { width, per_pixel, per_call: Duration::from_micros(20), samples: vec![0; height as usize], longest: Duration::ZERO }
    }
}

impl Backend for Dummy {
    fn name(&self) -> String {
        "dummy".into()
    }
    fn upload(&mut self, _: Arc<World>, _: Precision, _: u32) -> Result<()> {
        Ok(())
    }
    fn set_parameters(&mut self, _: &SceneParameters) -> Result<()> {
        Ok(())
    }
    fn accumulate(&mut self, rows: Range<u32>, samples: Range<u32>) -> Result<()> {
        let work = rows.len() as u32 * samples.len() as u32 * self.width;
        let time = self.per_call + self.per_pixel * work;
        self.longest = self.longest.max(time);
        let start = Instant::now();
        while start.elapsed() < time {
            std::hint::spin_loop();
        }
        for row in rows {
            // Every sample once, in order.
            assert_eq!(self.samples[row as usize], samples.start);
            self.samples[row as usize] = samples.end;
        }
        Ok(())
    }
    fn film(&mut self) -> Result<Film> {
        Ok(Film::new(self.width, self.samples.len() as u32, 0))
    }
    fn develop(&mut self, _: &Development, _: &mut Canvas) -> Result<()> {
        Ok(())
    }
    fn trace(&mut self, _: &[TraceRay], _: TraceOptions) -> Result<Vec<TraceResult>> {
        Ok(vec![])
    }
    fn set_profiling(&mut self, _: Profiling) {}
    fn timings(&mut self) -> Timings {
        Timings::default()
    }
}

/// Fills a film; returns the backend.
fn fill(pace: &mut Interactive, size: (u32, u32), reduction: u32, goal: u32, per_pixel: Duration, budget: Duration) -> Dummy {
    let mut film = Refinement::new(size.0, size.1, reduction, goal);
    let mut backend = Dummy::new(film.size(), per_pixel);
    let mut added = 0;
    while !film.is_complete() {
        added += film.advance(&mut backend, pace, budget).unwrap();
    }
    assert_eq!(film.advance(&mut backend, pace, budget).unwrap(), 0);
    assert_eq!((film.samples(), film.is_even()), (goal, true));
    assert_eq!(added, u64::from(film.size().0) * u64::from(film.size().1) * u64::from(goal));
    assert!(backend.samples.iter().all(|&s| s == goal));
    backend
}

#[test]
fn slices_fill_every_pixel_once_and_keep_the_budget() {
    let budget = Duration::from_millis(4);
    for (size, reduction, goal) in [((64, 50), 1, 3), ((1, 1), 16, 5), ((33, 7), 2, 130), ((5, 90), 4, 1)] {
        let mut pace = Interactive::default();
        // The costs of the first pass are known to the second.
        for _ in 0..2 {
            fill(&mut pace, size, reduction, goal, Duration::from_nanos(500), budget);
        }
    }
    let mut pace = Interactive::default();
    let backend = fill(&mut pace, (400, 200), 1, 2, Duration::from_nanos(500), budget);
    // A machine that is busy with other things makes slices shorter, never longer.
    assert!(backend.longest <= 2 * budget, "{:?}", backend.longest);
}

#[test]
fn coarseness_follows_the_cost() {
    let (size, budget) = ((320, 200), Duration::from_millis(16));
    let mut pace = Interactive::default();
    assert_eq!(pace.reduction(size.0, size.1, budget), 16, "nothing is known");
    // 64000 pixels of 1 microsecond: half the width and height fit.
    let dear = Duration::from_micros(1);
    let mut reduction = 16;
    for _ in 0..20 {
        fill(&mut pace, size, reduction, 1, dear, budget);
        reduction = pace.reduction(size.0, size.1, budget);
    }
    assert!((2..=8).contains(&reduction), "{reduction}");
    // They become ten times cheaper.
    for _ in 0..20 {
        fill(&mut pace, size, reduction, 1, dear / 10, budget);
        reduction = pace.reduction(size.0, size.1, budget);
    }
    assert!(reduction <= 2, "{reduction}");
    assert_eq!(reduced(1, 1, 16), (1, 1));
    assert_eq!(reduced(333, 211, 4), (84, 53));
}

#[test]
fn passes_that_are_given_up_tell_what_they_cost() {
    let (size, budget) = ((320, 200), Duration::from_millis(16));
    let mut pace = Interactive::default();
    fill(&mut pace, size, 1, 1, Duration::from_nanos(10), budget);
    let mut film = Refinement::new(size.0, size.1, 1, 1);
    let mut backend = Dummy::new(size, Duration::from_micros(20));
    film.give_up(&mut pace);
    assert_eq!(pace.reduction(size.0, size.1, budget), 1);
    // Everything has become 2000 times dearer; rows that are believed to be cheap are rendered a few at a time.
    for _ in 0..10 {
        film.advance(&mut backend, &mut pace, Duration::from_micros(20)).unwrap();
    }
    assert!(!film.is_even());
    film.give_up(&mut pace);
    assert!(pace.reduction(size.0, size.1, budget) > 1);
}

#[test]
fn a_quarter_turn_is_a_quarter_turn() {
    let level = Pose { position: DVec3::new(0.0, 0.0, -2.0), look_at: DVec3::ZERO, up: DVec3::Y, fov: 40.0 };
    assert!(near(level.orbit(FRAC_PI_2, 0.0).position, DVec3::new(-2.0, 0.0, 0.0)));
    assert!(near(level.look(FRAC_PI_2, 0.0).forward(), DVec3::new(-1.0, 0.0, 0.0)));
}
