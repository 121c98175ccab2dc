//! The program end to end: good runs write what they should, bad input gets one line and exit code 2.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::collections::HashMap;
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
fn refuses_bad_models() {
    let folder = Folder::new("models");
    let cases: [(&str, &str, &[&str]); 11] = [
        ("kerr", "spin = 1.1", &["scene.toml:3:8", "1.1", "spin^2 + charge^2 <= mass^2"]),
        ("kerr", "throat = 1", &["scene.toml:3:10", "`throat`", "`kerr`"]),
        ("kerr", "axis = [0, 0, 0]", &["scene.toml:3:8", "`axis` is zero"]),
        ("schwarzschild", "[[spacetime.mass]]\nposition = [0, 0, 0]\nmass = 1", &["scene.toml:3:1", "one number"]),
        ("weak-lens", "mass = 1", &["scene.toml:3:8", "[[spacetime.mass]]"]),
        ("weak-lens", "", &["scene.toml:2:8", "needs", "[[spacetime.mass]]"]),
        ("dust-disc", "mu = 4", &["scene.toml:3:6", "mu = 4", "mu <= 3"]),
        ("grin", "", &["scene.toml:2:8", "needs `profile`"]),
        ("grin", "profile = \"layered\"\nheights = [0, 1, 1]\nindices = [1, 2, 3]", &["scene.toml:4:11", "above the one before"]),
        ("grin", "profile = \"layered\"\nheights = [0, 1, 2]\nindices = [1, 2]", &["scene.toml:5:11", "2 indices for 3 heights"]),
        ("grin", "profile = \"radial\"\ncoefficients = [1, -2]", &["scene.toml:4:16", "index falls below"]),
    ];
    for (kind, keys, words) in cases {
        refuses(&folder, &format!("[spacetime]\nkind = \"{kind}\"\n{keys}"), words);
    }
    refuses(&folder, "[spacetime]\nkind = \"kerr\"\n[integrator]\nmethod = \"nystrom\"", &["scene.toml:4:10", "`nystrom` needs a medium"]);
    refuses(
        &folder,
        "[spacetime]\nkind = \"lorenz\"\n[integrator]\nmethod = \"symplectic\"",
        &["scene.toml:4:10", "`symplectic` needs a Hamiltonian"],
    );
    refuses(
        &folder,
        "[camera]\nposition = [0, 0, 0.4]\nlook_at = [0, 0, 1]\n[spacetime]\nkind = \"ellis\"",
        &["scene.toml", "`ellis`", "throat"],
    );
    refuses(&folder, "[camera]\nvelocity = [0.8, 0, 0.6]", &["scene.toml:2:12", "less than that of light"]);
    refuses(
        &folder,
        "[spacetime]\nkind = \"schwarzschild\"\n[[sphere]]\ncenter = [0, 0, 0]\nradius = 1\nside = -1",
        &["scene.toml:6:8", "wormholes only"],
    );
    refuses(
        &folder,
        "[spacetime]\nkind = \"ellis\"\n[[sphere]]\ncenter = [0, 0, 0]\nradius = 1\nside = 2",
        &["scene.toml:6:8", "`2`", "-1"],
    );
    refuses(&folder, "[spacetime]\nkind = \"kerr\"\n[environment.far]\ncolor = [1, 1, 1]", &["scene.toml:3:1", "wormholes only"]);
    refuses(&folder, "[[disc]]\ncenter = [0, 0, 0]\nnormal = [0, 0, 0]\nradius = 1", &["scene.toml:3:10", "`normal` is zero"]);
    refuses(
        &folder,
        "[[disc]]\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 1\ninner_radius = 2",
        &["scene.toml:4:10", "inner radius 2"],
    );
    refuses(&folder, "[[accretion_disc]]\nouter_radius = 20\npeak_temperature = 5000", &["scene.toml:2:16", "hole to orbit", "`flat`"]);
    refuses(
        &folder,
        "[spacetime]\nkind = \"schwarzschild\"\n[[accretion_disc]]\ninner_radius = 5\nouter_radius = 20\npeak_temperature = 5000",
        &["scene.toml:4:16", "at least 6"],
    );
    refuses(
        &folder,
        "[spacetime]\nkind = \"schwarzschild\"\n[[accretion_disc]]\nouter_radius = 6\npeak_temperature = 5000",
        &["scene.toml:4:16", "not above the inner radius"],
    );
    refuses(
        &folder,
        "[spacetime]\nkind = \"kerr\"\nspin = 0.5\n[[accretion_disc]]\nnormal = [0, 1, 1]\nouter_radius = 20\npeak_temperature = 5000",
        &["scene.toml:5:10", "equatorial plane"],
    );
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

const FLAT: &str = "[[material]]\nname = \"red, shiny\"\n[[sphere]]\ncenter = [0, 0, 5]\nradius = 1\nmaterial = \"red, shiny\"\n";
const HOLE: &str = "[spacetime]\nkind = \"schwarzschild\"\nmass = 1\n[integrator]\nmax_steps = 1000000\n";
const SPINNING: &str = "[spacetime]\nkind = \"kerr\"\nspin = 0.9\naxis = [0, 0, 1]\n[integrator]\nmax_steps = 1000000\n";

/// Runs `trace` on a scene and rays, with the output in out.csv.
fn trace(folder: &Folder, scene: &str, rays: &str, extra: &[&str]) -> Output {
    let (scene, rays, out) = (folder.write("scene.toml", scene), folder.write("rays.csv", rays), folder.path("out.csv"));
    let arguments: [&str; 8] = ["trace", &scene, "--rays", &rays, "-o", &out, "--backend", "cpu"];
    nullray(&[&arguments[..], extra].concat())
}

/// A row of a CSV file by column.
type Line = HashMap<String, String>;

/// Header and rows of a CSV file.
fn read_csv(path: &str) -> (Vec<String>, Vec<Line>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let mut rows = Vec::new();
    for record in reader.records() {
        rows.push(header.iter().cloned().zip(record.unwrap().iter().map(str::to_owned)).collect());
    }
    (header, rows)
}

/// The rows that a run of `trace` that goes well leaves.
fn traced(folder: &Folder, scene: &str, rays: &str, extra: &[&str]) -> Vec<Line> {
    let output = trace(folder, scene, rays, extra);
    assert!(output.status.success(), "{}", stderr(&output));
    read_csv(&folder.path("out.csv")).1
}

fn numbers<const N: usize>(row: &Line, columns: [&str; N]) -> [f64; N] {
    columns.map(|column| row[column].parse().unwrap())
}

#[test]
fn traces_rays_and_passes_columns_through() {
    let folder = Folder::new("trace");
    let rays = "name,x,y,z,dx,dy,dz,trace,status\n\"a, \"\"b\"\"\",0,0,0,0,0,1,past,first\nc,0,0,0,0,3,4,future,second\n";
    let output = trace(&folder, FLAT, rays, &["--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["rays"], 2);
    assert_eq!(summary["status"]["hit"], 1);
    assert_eq!(summary["status"]["escaped"], 1);
    let (header, rows) = read_csv(&folder.path("out.csv"));
    let expected =
        "name,in_status,status,x,y,z,dx,dy,dz,vx,vy,vz,length,side,steps,chords,constraint_error,frequency_ratio,object,material";
    assert_eq!(header.join(","), expected);
    assert_eq!(rows.len(), 2);
    let texts = |row: usize| ["name", "in_status", "status", "object", "material"].map(|column| rows[row][column].as_str());
    assert_eq!(texts(0), ["a, \"b\"", "first", "hit", "0", "red, shiny"]);
    assert_eq!(texts(1), ["c", "second", "escaped", "", ""]);
    assert_eq!(numbers(&rows[0], ["x", "y", "z", "dx", "dy", "dz", "length", "side"]), [0.0, 0.0, 4.0, 0.0, 0.0, 1.0, 4.0, 1.0]);
    assert_eq!(numbers(&rows[0], ["constraint_error", "frequency_ratio"]), [0.0, 1.0]);
    let direction = numbers(&rows[1], ["dx", "dy", "dz"]);
    assert!(direction.iter().zip([0.0, 0.6, 0.8]).all(|(found, given)| (found - given).abs() < 1e-12), "{direction:?}");
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 3, "temporary files are left");
}

#[test]
fn traces_the_past_and_the_future() {
    let folder = Folder::new("senses");
    let rows = traced(
        &folder,
        SPINNING,
        "x,y,z,dx,dy,dz,trace\n20,0,0,-1,0.5,0,past\n20,0,0,-1,0.5,0,future\n20,0,0,-1,0.5,0,past\n20,0,0,-1,0.05,0,past\n",
        &[],
    );
    let statuses: Vec<&str> = rows.iter().map(|row| row["status"].as_str()).collect();
    assert_eq!(statuses, ["escaped", "escaped", "escaped", "captured"]);
    let direction = |row: usize| numbers(&rows[row], ["dx", "dy", "dz"]);
    assert_eq!(direction(0), direction(2));
    // The hole drags both the same way, and they go opposite ways.
    assert!((direction(0)[1] - direction(1)[1]).abs() > 0.01, "{:?} {:?}", direction(0), direction(1));
    assert!(rows.iter().all(|row| numbers(row, ["constraint_error"])[0] < 1e-9), "{rows:?}");
}

#[test]
fn traces_to_spheres_lengths_and_planes() {
    let folder = Folder::new("stops");
    let rays = "x,y,z,dx,dy,dz\n20,0,0,-1,0.5,0\n20,0,0,-1,0,0\n";
    let rows = traced(&folder, HOLE, rays, &["--sphere", "30"]);
    let [x, y, z] = numbers(&rows[0], ["x", "y", "z"]);
    assert_eq!((rows[0]["status"].as_str(), rows[1]["status"].as_str()), ("stopped", "captured"));
    assert!((x.hypot(y).hypot(z) - 30.0).abs() < 1e-8 && x < 0.0, "{x} {y} {z}");

    let rows = traced(&folder, HOLE, rays, &["--length", "7"]);
    assert!(rows.iter().all(|row| row["status"] == "stopped"), "{rows:?}");
    assert!(rows.iter().all(|row| (numbers(row, ["length"])[0] - 7.0).abs() < 1e-9), "{rows:?}");
    assert!((numbers(&rows[1], ["x"])[0] - 13.0).abs() < 1e-9, "{rows:?}");

    let mut places = Vec::new();
    for plane in ["1,0,0,10", "-2,0,0,-20"] {
        let rows = traced(&folder, HOLE, rays, &["--plane", plane]);
        assert_eq!((rows[0]["status"].as_str(), rows[1]["status"].as_str()), ("escaped", "captured"));
        for row in &rows {
            assert_eq!((row["crossings"].as_str(), row["c2_x"].as_str(), row["c3_z"].as_str()), ("1", "", ""));
            assert!((numbers(row, ["c1_x"])[0] - 10.0).abs() < 1e-9, "{row:?}");
        }
        places.push(numbers(&rows[0], ["c1_y"])[0]);
    }
    assert!(places[0] > 4.0 && (places[0] - places[1]).abs() < 1e-8, "{places:?}");
}

#[test]
fn traces_paths() {
    let folder = Folder::new("paths");
    let rays = "x,y,z,dx,dy,dz\n20,0,0,-1,0.5,0\n0,20,1,0,-1,0.2\n20,0,0,-1,0.05,0\n";
    let (table, polylines) = (folder.path("paths.csv"), folder.path("paths.vtp"));
    let ends = traced(&folder, SPINNING, rays, &["--time", "12", "--paths", &table]);
    assert!(ends.iter().all(|row| row["status"] == "stopped"), "{ends:?}");
    let (header, vertices) = read_csv(&table);
    assert_eq!(header.join(","), "ray,vertex,x,y,z,length,side");
    for (ray, end) in ends.iter().enumerate() {
        let line: Vec<_> = vertices.iter().filter(|v| v["ray"] == ray.to_string()).collect();
        assert!(line.len() > 10, "ray {ray}: {} vertices", line.len());
        assert!(line.iter().enumerate().all(|(i, v)| v["vertex"] == i.to_string()), "ray {ray}");
        let lengths: Vec<f64> = line.iter().map(|v| numbers(v, ["length"])[0]).collect();
        assert!(lengths[0] == 0.0 && lengths.windows(2).all(|pair| pair[0] < pair[1]), "ray {ray}: {lengths:?}");
        let place = ["x", "y", "z", "length"];
        assert_eq!(numbers(line[line.len() - 1], place), numbers(end, place), "ray {ray}");
    }
    assert_eq!(numbers(&vertices[0], ["x", "y", "z"]), [20.0, 0.0, 0.0]);

    let again = traced(&folder, SPINNING, rays, &["--time", "12", "--paths", &polylines]);
    assert_eq!(again, ends);
    let text = std::fs::read_to_string(&polylines).unwrap();
    let points = vertices.len();
    assert!(text.contains(&format!("NumberOfPoints=\"{points}\" NumberOfLines=\"3\"")), "{points}");
    let values = |name: &str| -> Vec<f64> {
        let array = text.split(&format!("Name=\"{name}\"")).nth(1).unwrap();
        array.split(['>', '<']).nth(1).unwrap().split_whitespace().map(|v| v.parse().unwrap()).collect()
    };
    assert_eq!((values("Points").len(), values("length").len(), values("ray").len()), (3 * points, points, points));
    assert!(values("connectivity").iter().enumerate().all(|(i, v)| *v == i as f64));
    let offsets = values("offsets");
    assert!(offsets.len() == 3 && offsets.windows(2).all(|pair| pair[0] < pair[1]) && offsets[2] == points as f64, "{offsets:?}");
    // Every tag that is opened is closed, the innermost first.
    let mut open = Vec::new();
    for tag in text.split('<').skip(1).map(|rest| rest.split(['>', ' ']).next().unwrap()).filter(|tag| !tag.starts_with('?')) {
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop(), Some(name)),
            None => open.push(tag),
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

/// Exit 2, one line of an error that holds every one of `words`, and no file but the scene and the rays.
fn expect_refusal(folder: &Folder, output: &Output, words: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{words:?}\n{message}");
    assert!(!message.contains("panicked"), "{message}");
    let errors: Vec<&str> = message.lines().filter(|line| line.contains("error:")).collect();
    assert_eq!(errors.len(), 1, "{message}");
    for word in words {
        assert!(errors[0].contains(word), "{message}\nlacks {word}");
    }
    for entry in std::fs::read_dir(&folder.0).unwrap() {
        let name = entry.unwrap().file_name();
        assert!(name == "scene.toml" || name == "rays.csv", "{name:?} is left behind\n{message}");
    }
}

#[test]
fn refuses_bad_rays() {
    let folder = Folder::new("rays");
    let good = "x,y,z,dx,dy,dz\n0,0,0,0,0,1\n";
    let cases: [(&str, &str, &[&str], &[&str]); 13] = [
        (FLAT, "x,y,z,dx,dy\n0,0,0,0,1\n", &[], &["rays.csv:1:6", "`dz` is missing"]),
        (FLAT, "x,y,z,dx,dy,dz\n0,0,0,0,0,1\n0,0,zero,0,0,1\n", &[], &["rays.csv:3:3", "`z`", "zero"]),
        (FLAT, "x,y,z,dx,dy,dz\n0,0,0,0,0,1\n0,0,0,0,0\n", &[], &["rays.csv:3:", "5 fields", "expected 6"]),
        (FLAT, "x,y,z,dx,dy,dz\n0,0,0,0,0,0\n", &[], &["rays.csv:2:4", "`dx`", "zero vector"]),
        (FLAT, "x,y,z,dx,dy,dz,px\n0,0,0,0,0,1,1\n", &[], &["rays.csv:1:7", "`px` beside a direction"]),
        (FLAT, "x,y,z,dx,dy,dz,trace\n0,0,0,0,0,1,present\n", &[], &["rays.csv:2:7", "`trace`", "present"]),
        (FLAT, "", &[], &["rays.csv:1:1", "`x` is missing"]),
        (FLAT, good, &["--length", "1", "--sphere", "2"], &["--length", "--sphere"]),
        (FLAT, good, &["--time", "1"], &["--time 1", "`flat` has no coordinate time"]),
        (HOLE, good, &["--time", "1"], &["--time 1", "`schwarzschild` has no coordinate time"]),
        (FLAT, good, &["--plane", "0,0,0,1"], &["--plane 0,0,0,1", "four numbers"]),
        (FLAT, good, &["--paths", "paths.txt"], &["paths.txt", ".csv or .vtp"]),
        ("[spacetime]\nkind = \"loop\"", good, &[], &["scene.toml:2:8", "loop"]),
    ];
    for (scene, rays, extra, words) in cases {
        expect_refusal(&folder, &trace(&folder, scene, rays, extra), words);
    }
    let (scene, rays, out) = (folder.write("scene.toml", FLAT), folder.path("nowhere.csv"), folder.path("out.csv"));
    expect_refusal(&folder, &nullray(&["trace", &scene, "--rays", &rays, "-o", &out]), &["nowhere.csv"]);
}
