//! The viewer in a real window, on an X server of its own: what outside tools see and do.
//!
//! Runs under `NULLRAY_VALIDATION=1` by itself. Without Xvfb, xdotool, ImageMagick's import or a Vulkan device the tests show as
//! ignored, unless `NULLRAY_REQUIRE_VULKAN=1` says that all of them must be there.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use image::RgbImage;
use libtest_mimic::{Arguments, Trial};
use nullray::backend::vulkan::VulkanBackend;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use support::root;

/// Time within which the program must have done what was asked of it.
const PATIENCE: Duration = Duration::from_secs(30);
/// Size of most windows.
const SIZE: (u32, u32) = (240, 160);
/// Share of pixels that must be equal to within 1/255.
const EQUAL: f64 = 0.999;

/// A hole among spheres, small enough to be quick.
const SCENE: &str = r#"
[camera]
position = [0, 1.5, -8]
look_at = [0, 1, 0]
[film]
samples = 4
max_depth = 3
[spacetime]
kind = "schwarzschild"
mass = 0.2
position = [0.5, 1, 0]
[environment]
kind = "gradient"
[[material]]
name = "red"
base_color = [0.8, 0.1, 0.1]
[[quad]]
corner = [-9, 0, -9]
u = [0, 0, 18]
v = [18, 0, 0]
[[sphere]]
center = [-1.6, 0.8, 1]
radius = 0.8
material = "red"
"#;

/// A test that has a display to itself.
type Check = fn(&Display);

fn main() {
    let mut arguments = Arguments::from_args();
    // One display, one keyboard: tests one after another.
    arguments.test_threads = Some(1);
    let outcome = Display::open().and_then(|d| VulkanBackend::new(None).map(|_| d).map_err(|e| e.to_string()));
    let required = std::env::var("NULLRAY_REQUIRE_VULKAN").is_ok_and(|v| v == "1");
    if let (Err(missing), true) = (&outcome, required) {
        eprintln!("a display with a Vulkan device is required: {missing}");
        std::process::exit(1);
    }
    let display = outcome.ok().map(Arc::new);
    let tests: [(&str, Check); 8] = [
        ("vulkan_film_is_what_the_window_shows", |d| shows_the_film(d, "vulkan")),
        ("cpu_film_is_what_the_window_shows", |d| shows_the_film(d, "cpu")),
        ("keys_change_the_picture", keys_change_the_picture),
        ("the_mouse_moves_the_camera", the_mouse_moves_the_camera),
        ("resizes_are_followed", resizes_are_followed),
        ("hidden_windows_come_back", hidden_windows_come_back),
        ("broken_scenes_keep_the_last_good_one", broken_scenes_keep_the_last_good_one),
        ("scripts_get_frames_and_a_screenshot", scripts_get_frames_and_a_screenshot),
    ];
    let mut trials = vec![
        Trial::test("no_display_is_one_line", || {
            no_display_is_one_line();
            Ok(())
        }),
        Trial::test("comparisons_fail_on_other_pictures", || {
            comparisons_fail_on_other_pictures();
            Ok(())
        }),
    ];
    trials.extend(tests.into_iter().map(|(name, test)| {
        let (display, is_missing) = (display.clone(), display.is_none());
        let run = move || {
            if let Some(display) = &display {
                test(display);
            }
            Ok(())
        };
        Trial::test(name, run).with_ignored_flag(is_missing)
    }));
    let conclusion = libtest_mimic::run(&arguments, trials);
    // The server goes before the program does.
    drop(display);
    conclusion.exit();
}

/// An X server without a screen.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    fn open() -> Result<Display, String> {
        for tool in ["xdotool", "import"] {
            Command::new(tool).arg("-version").output().map_err(|e| format!("{tool}: {e}"))?;
        }
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| format!("Xvfb: {e}"))?;
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let display = Display { server, name: format!(":{}", number.trim()) };
        if number.trim().is_empty() { Err("Xvfb did not start".into()) } else { Ok(display) }
    }

    /// Runs a tool that ends by itself.
    fn tool(&self, tool: &str, arguments: &[&str]) -> String {
        let output = Command::new(tool).args(arguments).env("DISPLAY", &self.name).output().unwrap();
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Waits until `get` has something.
fn wait_for<T>(what: &str, mut get: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = get() {
            return found;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("nullray-viewer-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        std::fs::write(path.join("scene.toml"), SCENE).unwrap();
        Folder(path)
    }

    fn scene(&self) -> PathBuf {
        self.0.join("scene.toml")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The viewer, with what it says and its window.
struct Viewer<'a> {
    display: &'a Display,
    program: Child,
    said: Arc<Mutex<Vec<String>>>,
    /// Lines that were looked at.
    heard: usize,
    window: String,
}

impl<'a> Viewer<'a> {
    /// Opens a window and waits for its full picture, then hides the panels.
    fn open(display: &'a Display, folder: &Folder, backend: &str, (width, height): (u32, u32)) -> Viewer<'a> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_nullray"));
        command.arg("view").arg(folder.scene()).args(["--backend", backend, "--size", &format!("{width}x{height}")]);
        command.current_dir(&folder.0).env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        command.env("NULLRAY_LOG", "nullray::viewer=debug").env("NULLRAY_VALIDATION", "1").env("XDG_RUNTIME_DIR", &folder.0);
        let mut program = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let said = Arc::new(Mutex::new(Vec::new()));
        let (lines, to) = (BufReader::new(program.stderr.take().unwrap()).lines(), said.clone());
        std::thread::spawn(move || lines.map_while(|line| line.ok()).for_each(|line| to.lock().unwrap().push(line)));
        let mut viewer = Viewer { display, program, said, heard: 0, window: String::new() };
        viewer.hear(&["frame presented", "samples=4", "scale=1"]);
        viewer.window = wait_for("the window", || {
            let found = display.tool("xdotool", &["search", "--onlyvisible", "--name", "^nullray: "]);
            found.lines().next().map(str::to_owned)
        });
        viewer.key("Tab", &["panels hidden"]);
        viewer
    }

    /// Waits for a line with all of these words that it had not said before.
    fn hear(&mut self, words: &[&str]) -> String {
        let (said, program, mut at) = (self.said.clone(), &mut self.program, self.heard);
        let line = wait_for(&format!("{words:?}"), || {
            let lines = said.lock().unwrap();
            while let Some(line) = lines.get(at) {
                at += 1;
                if words.iter().all(|word| says(line, word)) {
                    return Some(line.clone());
                }
            }
            let ended = program.try_wait().unwrap();
            assert!(ended.is_none(), "the viewer ended with {ended:?}: {lines:#?}");
            None
        });
        self.heard = at;
        line
    }

    /// Waits for the full picture after something has changed.
    fn hear_full(&mut self) {
        self.hear(&["frame presented", "samples=4", "scale=1"]);
    }

    fn do_tool(&self, arguments: &[&str]) {
        self.display.tool("xdotool", arguments);
    }

    /// Presses a key and waits for its effect.
    fn key(&mut self, key: &str, words: &[&str]) {
        self.do_tool(&["windowfocus", "--sync", &self.window, "key", key]);
        self.hear(words);
    }

    /// Drags the mouse inside the window.
    fn drag(&mut self, button: &str, from: (i32, i32), to: (i32, i32)) {
        let text = [from.0, from.1, (from.0 + to.0) / 2, (from.1 + to.1) / 2, to.0, to.1].map(|v| v.to_string());
        let go = |i: usize| ["mousemove", "--window", &self.window, &text[i], &text[i + 1]];
        self.do_tool(&go(0));
        self.do_tool(&["mousedown", button]);
        self.do_tool(&go(2));
        self.do_tool(&go(4));
        self.do_tool(&["mouseup", button]);
        self.hear(&["camera moved"]);
    }

    /// The window as an outside tool sees it.
    fn seen(&self, folder: &Folder) -> RgbImage {
        let path = folder.0.join("seen.png");
        self.display.tool("import", &["-window", &self.window, "-depth", "8", &path.display().to_string()]);
        image::open(&path).unwrap().to_rgb8()
    }

    /// Waits until the window shows a picture; the tool may look while the picture is on its way.
    fn must_show(&self, folder: &Folder, picture: &RgbImage) {
        let start = Instant::now();
        loop {
            let seen = self.seen(folder);
            let share = equal_share(&seen, picture);
            if share >= EQUAL {
                return;
            }
            if start.elapsed() > Duration::from_secs(5) {
                let kept = std::env::temp_dir();
                seen.save(kept.join("nullray-viewer-seen.png")).unwrap();
                picture.save(kept.join("nullray-viewer-wanted.png")).unwrap();
                panic!("{:.4} of the pixels are equal; both pictures are in {}", share, kept.display());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until the window shows anything but a picture.
    fn must_not_show(&self, folder: &Folder, picture: &RgbImage) {
        wait_for("another picture", || (equal_share(&self.seen(folder), picture) < 0.95).then_some(()));
    }
}

impl Drop for Viewer<'_> {
    /// Closes the window: it must end well, without a word from the validation layers.
    fn drop(&mut self) {
        if std::thread::panicking() {
            let _ = self.program.kill();
            let _ = self.program.wait();
            return;
        }
        self.do_tool(&["windowfocus", "--sync", &self.window, "key", "Escape"]);
        let status = wait_for("the end", || self.program.try_wait().unwrap());
        let said = self.said.lock().unwrap();
        assert!(status.success(), "{status}: {said:#?}");
        assert!(!said.iter().any(|line| line.contains("validation:") || line.contains("panicked")), "{said:#?}");
    }
}

/// Whether a line has a word; a field must have all of its value.
fn says(line: &str, word: &str) -> bool {
    if word.contains('=') { line.split_whitespace().any(|w| w == word) } else { line.contains(word) }
}

/// Share of pixels that differ by no more than 1/255 in every channel; 0 for pictures of different sizes.
fn equal_share(a: &RgbImage, b: &RgbImage) -> f64 {
    if a.dimensions() != b.dimensions() {
        return 0.0;
    }
    let equal = a.pixels().zip(b.pixels()).filter(|(p, q)| p.0.iter().zip(q.0).all(|(x, y)| x.abs_diff(y) <= 1)).count();
    equal as f64 / f64::from(a.width() * a.height())
}

/// The film of a scene file, rendered without a window.
fn rendered(folder: &Folder, backend: &str, (width, height): (u32, u32), arguments: &[&str]) -> RgbImage {
    let path = folder.0.join("rendered.png");
    let size = format!("{width}x{height}");
    let status = Command::new(env!("CARGO_BIN_EXE_nullray"))
        .arg("render")
        .arg(folder.scene())
        .args(["--backend", backend, "--size", &size, "-o"])
        .arg(&path)
        .args(arguments)
        .stderr(Stdio::null())
        .status()
        .unwrap();
    assert!(status.success());
    image::open(&path).unwrap().to_rgb8()
}

/// A part of a picture.
fn part(picture: &RgbImage, x: u32, y: u32, width: u32, height: u32) -> RgbImage {
    image::imageops::crop_imm(picture, x, y, width, height).to_image()
}

fn shows_the_film(display: &Display, backend: &str) {
    let folder = Folder::new(backend);
    let wanted = rendered(&folder, backend, SIZE, &[]);
    let viewer = Viewer::open(display, &folder, backend, SIZE);
    viewer.must_show(&folder, &wanted);
}

fn keys_change_the_picture(display: &Display) {
    let folder = Folder::new("keys");
    let (bent, straight) = (rendered(&folder, "vulkan", SIZE, &[]), rendered(&folder, "vulkan", SIZE, &["--linear"]));
    assert!(equal_share(&bent, &straight) < 0.9);
    let mut viewer = Viewer::open(display, &folder, "vulkan", SIZE);
    viewer.must_show(&folder, &bent);
    viewer.key("b", &["bending toggled", "bending=false"]);
    viewer.hear_full();
    viewer.must_show(&folder, &straight);
    viewer.key("b", &["bending toggled", "bending=true"]);
    viewer.hear_full();
    viewer.must_show(&folder, &bent);

    // Split: the halves of both.
    viewer.key("v", &["split toggled", "split=true"]);
    viewer.hear_full();
    let (middle, mut both) = (SIZE.0 / 2, bent.clone());
    image::imageops::replace(&mut both, &part(&straight, 0, 0, middle, SIZE.1), 0, 0);
    viewer.must_show(&folder, &both);
    viewer.key("v", &["split toggled", "split=false"]);
    viewer.hear_full();

    // Away and back.
    for key in ["w", "Left"] {
        viewer.key(key, &["camera moved"]);
        viewer.hear_full();
        viewer.must_not_show(&folder, &bent);
        viewer.key("r", &["camera moved"]);
        viewer.hear_full();
        viewer.must_show(&folder, &bent);
    }

    // The exposure needs no new samples, other channels neither.
    viewer.key("plus", &["frame presented", "samples=4"]);
    viewer.must_not_show(&folder, &bent);
    viewer.key("minus", &["frame presented", "samples=4"]);
    viewer.key("3", &["frame presented", "samples=4"]);
    viewer.must_not_show(&folder, &bent);
    viewer.key("1", &["frame presented", "samples=4"]);
    viewer.must_show(&folder, &bent);

    // Panels come and go.
    viewer.key("Tab", &["panels shown"]);
    viewer.must_not_show(&folder, &bent);
    viewer.key("Tab", &["panels hidden"]);
    viewer.must_show(&folder, &bent);

    // The window's own picture.
    viewer.key("p", &["file written", "scene-0001.png"]);
    let saved = image::open(folder.0.join("scene-0001.png")).unwrap().to_rgb8();
    assert!(equal_share(&saved, &bent) >= EQUAL);
}

fn the_mouse_moves_the_camera(display: &Display) {
    let folder = Folder::new("mouse");
    let mut viewer = Viewer::open(display, &folder, "cpu", SIZE);
    let home = viewer.seen(&folder);
    for (button, to) in [("1", (150, 90)), ("3", (100, 60))] {
        let before = viewer.seen(&folder);
        viewer.drag(button, (120, 80), to);
        viewer.hear_full();
        viewer.must_not_show(&folder, &before);
    }
    viewer.do_tool(&["click", "4"]);
    viewer.hear(&["camera moved"]);
    viewer.key("r", &["camera moved"]);
    viewer.hear_full();
    viewer.must_show(&folder, &home);
    // A click asks what is there: the camera looks along +z, so the red sphere is to the right.
    let window = viewer.window.clone();
    viewer.do_tool(&["mousemove", "--window", &window, "161", "83", "click", "1"]);
    let line = viewer.hear(&["pixel picked"]);
    assert!(line.contains("sphere") && line.contains("red"), "{line}");
    viewer.must_show(&folder, &home);
}

fn resizes_are_followed(display: &Display) {
    let folder = Folder::new("resize");
    let mut viewer = Viewer::open(display, &folder, "vulkan", SIZE);
    let window = viewer.window.clone();
    for (width, height) in [(333, 211), (1, 1), (97, 131), SIZE] {
        viewer.do_tool(&["windowsize", &window, &width.to_string(), &height.to_string()]);
        viewer.hear_full();
        if width > 1 {
            viewer.must_show(&folder, &rendered(&folder, "vulkan", (width, height), &[]));
        }
    }
}

fn hidden_windows_come_back(display: &Display) {
    let folder = Folder::new("hidden");
    let mut viewer = Viewer::open(display, &folder, "vulkan", SIZE);
    let (home, window) = (viewer.seen(&folder), viewer.window.clone());
    for (hide, show) in [("windowminimize", "windowmap"), ("windowunmap", "windowmap")] {
        viewer.do_tool(&[hide, &window]);
        std::thread::sleep(Duration::from_millis(300));
        viewer.do_tool(&[show, &window]);
        wait_for("the window", || {
            let found = viewer.display.tool("xdotool", &["search", "--onlyvisible", "--name", "^nullray: "]);
            found.lines().any(|line| line == window).then_some(())
        });
        viewer.key("b", &["bending toggled"]);
        viewer.hear_full();
        viewer.key("b", &["bending toggled"]);
        viewer.hear_full();
        viewer.must_show(&folder, &home);
    }
}

fn broken_scenes_keep_the_last_good_one(display: &Display) {
    let folder = Folder::new("reload");
    // Room enough for the words of an error.
    let size = (480, 320);
    let mut viewer = Viewer::open(display, &folder, "vulkan", size);
    let (home, below) = (viewer.seen(&folder), size.1 / 2);
    // Not TOML; TOML that is no scene; a scene that cannot be rendered.
    for broken in ["[camera\n".to_owned(), SCENE.replace("mass", "mess"), SCENE.replace("mass = 0.2", "mass = 40")] {
        std::fs::write(folder.scene(), broken).unwrap();
        viewer.hear(&["scene failed"]);
        // The upper half says why.
        let lower = part(&home, 0, below, size.0, below);
        wait_for("the last good scene", || {
            let seen = viewer.seen(&folder);
            (equal_share(&part(&seen, 0, below, size.0, below), &lower) >= EQUAL).then_some(())
        });
    }
    std::fs::write(folder.scene(), SCENE.replace("[0.8, 0.1, 0.1]", "[0.1, 0.1, 0.8]")).unwrap();
    viewer.hear(&["scene reloaded"]);
    viewer.hear_full();
    let blue = rendered(&folder, "vulkan", size, &[]);
    assert!(equal_share(&blue, &home) < EQUAL);
    viewer.must_show(&folder, &blue);
}

fn scripts_get_frames_and_a_screenshot(display: &Display) {
    let folder = Folder::new("script");
    let picture = folder.0.join("shot.png");
    let output = Command::new(env!("CARGO_BIN_EXE_nullray"))
        .arg("view")
        .arg(folder.scene())
        .args(["--backend", "cpu", "--size", "120x80", "--set", "film.samples=1", "--frames", "6", "--json", "--screenshot"])
        .arg(&picture)
        .env("DISPLAY", &display.name)
        .env_remove("WAYLAND_DISPLAY")
        .env("NULLRAY_VALIDATION", "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(said.is_empty(), "{said}");
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(summary["frames"].as_u64().unwrap() >= 6, "{summary}");
    for (key, value) in [("width", 120), ("height", 80), ("samples", 1)] {
        assert_eq!(summary[key], value, "{summary}");
    }
    assert!(summary["backend"].as_str().unwrap().starts_with("cpu"), "{summary}");
    let shot = image::open(&picture).unwrap().to_rgb8();
    assert!(equal_share(&shot, &rendered(&folder, "cpu", (120, 80), &["--spp", "1"])) >= EQUAL);
}

fn no_display_is_one_line() {
    for (display, exit) in [("", 1), (":987", 1)] {
        let output = Command::new(env!("CARGO_BIN_EXE_nullray"))
            .args(["view", "--size", "16x16"])
            .current_dir(root())
            .env("DISPLAY", display)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(exit), "{said}");
        assert!(said.trim_end().lines().count() == 1 && said.contains("no window: "), "{said}");
    }
    let missing = Command::new(env!("CARGO_BIN_EXE_nullray")).args(["view", "no-such-scene.toml"]).output().unwrap();
    assert_eq!(missing.status.code(), Some(2));
    let wrong = Command::new(env!("CARGO_BIN_EXE_nullray")).args(["view", "--screenshot", "picture.jpg"]).output().unwrap();
    assert_eq!(wrong.status.code(), Some(2));
}

fn comparisons_fail_on_other_pictures() {
    let gradient = RgbImage::from_fn(40, 50, |x, y| image::Rgb([x as u8, y as u8, 7]));
    assert_eq!(equal_share(&gradient, &gradient), 1.0);
    let mut near = gradient.clone();
    near.pixels_mut().for_each(|p| p.0[0] += 1);
    assert_eq!(equal_share(&gradient, &near), 1.0);
    for at in 0..4 {
        near.put_pixel(at, 0, image::Rgb([200, 0, 7]));
    }
    assert!(equal_share(&gradient, &near) < EQUAL);
    assert_eq!(equal_share(&gradient, &part(&gradient, 0, 0, 40, 49)), 0.0);
}
