//! The program end to end: good runs write what they should, bad input gets one line and exit code 2.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::path::PathBuf;
use std::process::{Command, Output};
use support::root;

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("nullray-cli-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
    fn write(&self, name: &str, text: &str) -> String {
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    }
    fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn nullray(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nullray")).args(arguments).current_dir(root()).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs `check` on a scene text and expects exit 2 with one error line that holds every one of `words`.
fn refuses(folder: &Folder, text: &str, words: &[&str]) {
    let scene = folder.write("scene.toml", text);
    let output = nullray(&["check", &scene]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{text}\n{message}");
    assert!(!message.contains("panicked"), "{message}");
    assert_eq!(message.lines().filter(|l| l.contains("error:")).count(), 1, "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "{text}\n{message}\nlacks {word}");
    }
}

#[test]
fn renders_png_and_exr_with_metadata() {
    let folder = Folder::new("render");
    let (png, exr) = (folder.path("a.png"), folder.path("a.exr"));
    let output = nullray(&["render", "--backend", "cpu", "--size", "32x18", "--spp", "2", "-o", &png, "-o", &exr, "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["samples"], 2);
    assert_eq!(summary["invalid"], 0);
    let picture = image::open(&png).unwrap().to_rgb8();
    assert_eq!((picture.width(), picture.height()), (32, 18));
    assert!(picture.pixels().any(|p| p.0 != picture.get_pixel(0, 0).0), "the picture is one colour");
    let film = exr::prelude::read_all_flat_layers_from_file(&exr).unwrap();
    let layer = &film.layer_data[0];
    let names: Vec<String> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
    for name in [
        "R",
        "G",
        "B",
        "albedo.R",
        "normal.X",
        "position.Z",
        "redshift",
        "steps",
        "chords",
        "status",
        "object",
        "samples",
        "constraint_error",
    ] {
        assert!(names.iter().any(|n| n == name), "no channel {name} in {names:?}");
    }
    assert!(layer.attributes.other.keys().any(|k| k == "nullray.spacetime"));
    assert!(std::fs::read_dir(&folder.0).unwrap().count() == 2, "temporary files are left");
}

#[test]
fn stops_at_time_and_noise() {
    let folder = Folder::new("limits");
    let out = folder.path("a.png");
    let run = |extra: &[&str]| {
        let mut arguments = vec!["render", "--backend", "cpu", "--size", "64x36", "--linear", "-o", &out, "--json"];
        arguments.extend(extra);
        let output = nullray(&arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    assert!(run(&["--noise", "0.5"])["relative_error"].as_f64().unwrap() <= 0.5);
    let timed = run(&["--time", "0.5"]);
    assert!(timed["samples"].as_u64().unwrap() > 1 && timed["seconds"].as_f64().unwrap() < 30.0);
}

#[test]
fn refuses_bad_scenes() {
    let folder = Folder::new("scenes");
    let missing = nullray(&["check", &folder.path("nowhere.toml")]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(stderr(&missing).contains("nowhere.toml"));
    refuses(&folder, "", &["scene.toml:1:1", "empty"]);
    refuses(&folder, "[camera\nposition = 1", &["scene.toml:1:"]);
    refuses(&folder, "[camera]\npositon = [0, 0, 0]", &["scene.toml:2:1", "unknown field `positon`", "position"]);
    refuses(&folder, "[camera]\nposition = \"here\"", &["scene.toml:2:12"]);
    refuses(&folder, "[camera]\nposition = [0, nan, 0]", &["scene.toml:2:16", "NaN"]);
    refuses(&folder, "[camera]\nposition = [0, inf, 0]", &["scene.toml:2:16", "inf"]);
    refuses(&folder, "[[sphere]]\ncenter = [0, 0, 0]\nradius = -1", &["scene.toml:3:10", "-1", "above 0"]);
    refuses(&folder, "[film]\nwidth = 0", &["scene.toml:2:9", "1 to 32768"]);
    refuses(&folder, "[film]\nwidth = 32000\nheight = 32000", &["scene.toml:3:10", "pixels"]);
    refuses(&folder, "[film]\nwidth = 1000000000", &["scene.toml:2:9"]);
    refuses(&folder, "[spacetime]\nkind = \"flat\"\nmass = 1", &["scene.toml:3:8", "mass"]);
    refuses(&folder, "[spacetime]\nkind = \"wormhole\"", &["scene.toml:2:8", "schwarzschild"]);
    refuses(&folder, "[[sphere]]\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"gold\"", &["scene.toml:4:12", "gold"]);
    refuses(&folder, "[camera]\nlook_at = [0, 1.5, -10]", &["scene.toml:2:11"]);
    refuses(&folder, "[[mesh]]\nfile = \"nowhere.obj\"", &["scene.toml:2:8", "nowhere.obj"]);
    refuses(&folder, "[environment]\nkind = \"image\"\nfile = \"nowhere.exr\"", &["scene.toml:3:8", "nowhere.exr"]);
    refuses(&folder, "[camera]\nposition = [0, 0, 0.2]\n[spacetime]\nkind = \"schwarzschild\"\nmass = 1", &["horizon"]);
}

#[test]
fn refuses_bad_files() {
    let folder = Folder::new("files");
    let mesh = "[[mesh]]\nfile = \"bad.obj\"";
    for (text, word) in [
        ("v 0 0 0\nv 1 0 0\nf 1 2 9\n", "bad.obj"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "bad.obj"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "bad.obj"),
        ("\u{1}\u{2}\u{3}garbage", "bad.obj"),
    ] {
        folder.write("bad.obj", text);
        refuses(&folder, mesh, &["scene.toml:2:8", word]);
    }
    folder.write("bad.glb", "not a glb");
    refuses(&folder, "[[mesh]]\nfile = \"bad.glb\"", &["bad.glb"]);
    folder.write("bad.png", "not an image");
    refuses(&folder, "[[material]]\nname = \"m\"\nbase_color_texture = \"bad.png\"", &["scene.toml:3:22", "bad.png", "not an image"]);
}

#[test]
fn refuses_bad_arguments() {
    let folder = Folder::new("arguments");
    let out = folder.path("a.png");
    let cases: [&[&str]; 10] = [
        &["render", "--backend", "vulkan", "--device", "no such device", "-o", &out],
        &["render", "-o", "/proc/nowhere/a.png"],
        &["render", "-o", "a.jpg"],
        &["render", "--size", "0x10", "-o", &out],
        &["render", "--size", "big", "-o", &out],
        &["render", "--time", "-1", "-o", &out],
        &["render", "--set", "film.width", "-o", &out],
        &["render", "--set", "film.width=-3", "-o", &out],
        &["render", "--set", "spacetime.kind=flat", "--set", "spacetime.mass=1", "-o", &out],
        &["render", "--spp", "0", "-o", &out],
    ];
    for arguments in cases {
        let output = nullray(arguments);
        let code = output.status.code();
        // Without a Vulkan loader the unknown device is a missing device.
        let no_vulkan = arguments.contains(&"vulkan") && code == Some(1);
        assert!(code == Some(2) || no_vulkan, "{arguments:?}: {code:?} {}", stderr(&output));
        assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
    }
    assert!(!folder.0.join("a.png").exists());
}

#[test]
fn warns_of_darkness() {
    let folder = Folder::new("dark");
    let scene = folder.write("dark.toml", "[[sphere]]\ncenter = [0, 0, 0]\nradius = 1\n");
    let output = nullray(&["check", &scene]);
    assert!(output.status.success());
    assert!(stderr(&output).contains("warning") && stderr(&output).contains("nothing emits light"), "{}", stderr(&output));
}

#[test]
fn checks_every_scene_of_the_repository() {
    let mut arguments = vec!["check".to_string()];
    let scenes = std::fs::read_dir(root().join("assets/scenes")).unwrap().map(|e| e.unwrap().path().display().to_string());
    arguments.extend(scenes.filter(|p| p.ends_with(".toml")));
    let output = nullray(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), arguments.len() - 1);
}

#[test]
fn interrupt_writes_what_is_there() {
    use std::time::{Duration, Instant};
    let folder = Folder::new("interrupt");
    let out = folder.path("a.png");
    let mut child = Command::new(env!("CARGO_BIN_EXE_nullray"))
        .args(["render", "--backend", "cpu", "--size", "320x180", "--spp", "100000", "-o", &out])
        .current_dir(root())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let start = Instant::now();
    let status = child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
    assert!(start.elapsed() < Duration::from_secs(20));
    assert!(image::open(&out).is_ok());
}
