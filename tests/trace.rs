//! `nullray trace` from its file of rays to its files of results: what it reads, refuses, puts together and writes. What rows should
//! say comes from the library, which traces the rays that the file is meant to hold.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::cpu::CpuBackend;
use nullray::backend::{Backend, Launch, Precision, Stop, TraceOptions, TraceRay, TraceResult};
use nullray::kernels::constants::{STATUS_ESCAPED, STATUS_HIT, STATUS_STOPPED};
use nullray::spacetime::Class;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::Arc;
use support::{distance, root, world};

const FLAT: &str = "[[material]]\nname = \"red, shiny\"\n[[sphere]]\ncenter = [0, 0, 5]\nradius = 1\nmaterial = \"red, shiny\"\n";
const GRAVITY: &str =
    "[spacetime]\nkind = \"gravity\"\nform = \"ode\"\n[[spacetime.center]]\nposition = [0, -1, 0]\nstrength = 0.2\nradius = 5\n";
const HOLE: &str = "[spacetime]\nkind = \"schwarzschild\"\nmass = 1\n";
const SPINNING: &str = "[spacetime]\nkind = \"kerr\"\nspin = 0.9\naxis = [0, 0, 1]\n";
const WORMHOLE: &str = "[spacetime]\nkind = \"dneg\"\nthroat_radius = 1\nthroat_length = 2\nlensing_width = 0.4\n";
const LORENZ: &str = "[spacetime]\nkind = \"lorenz\"\n";

/// A folder of a test's own, which goes when the test ends.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("nullray-trace-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.join(name)).unwrap()
    }

    /// Runs the program on a scene and rays, with the results in out.csv.
    fn run(&self, scene: &str, rays: &str, extra: &[&str]) -> Output {
        std::fs::write(self.0.join("scene.toml"), scene).unwrap();
        std::fs::write(self.0.join("rays.csv"), rays).unwrap();
        let [scene, rays, out] = ["scene.toml", "rays.csv", "out.csv"].map(|name| self.path(name));
        let arguments: [&str; 8] = ["trace", &scene, "--rays", &rays, "-o", &out, "--backend", "cpu"];
        Command::new(env!("CARGO_BIN_EXE_nullray")).args(arguments).args(extra).current_dir(root()).output().unwrap()
    }

    /// What a run that goes well says on stdout.
    fn succeed(&self, scene: &str, rays: &str, extra: &[&str]) -> String {
        let output = self.run(scene, rays, extra);
        assert!(output.status.success(), "{extra:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Header and rows of the results of a run that goes well.
    fn rows(&self, scene: &str, rays: &str, extra: &[&str]) -> (Vec<String>, Vec<Vec<String>>) {
        self.succeed(scene, rays, extra);
        read_csv(&self.read("out.csv"))
    }

    /// The JSON that a run that goes well prints.
    fn summary(&self, scene: &str, rays: &str, extra: &[&str]) -> serde_json::Value {
        serde_json::from_str(&self.succeed(scene, rays, &[extra, &["--json"]].concat())).unwrap()
    }

    /// The error of a run that is refused.
    fn refusal(&self, scene: &str, rays: &str, extra: &[&str]) -> String {
        let output = self.run(scene, rays, extra);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{rays:?} {extra:?}: {message}");
        assert!(!self.0.join("out.csv").exists(), "{rays:?} {extra:?}: results are left");
        message.lines().find_map(|line| line.strip_prefix("nullray: error: ")).unwrap_or_else(|| panic!("{message}")).to_owned()
    }

    /// Line, column and reason of the error in a file of rays.
    fn complaint(&self, scene: &str, rays: &str) -> (usize, usize, String) {
        let error = self.refusal(scene, rays, &[]);
        let place = error.strip_prefix(&format!("{}:", self.path("rays.csv"))).unwrap_or_else(|| panic!("{error}"));
        let (line, rest) = place.split_once(':').unwrap();
        let (column, reason) = rest.split_once(": ").unwrap();
        (line.parse().unwrap(), column.parse().unwrap(), reason.to_owned())
    }
}

fn read_csv(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let fields = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<String>>();
    let header = fields(reader.headers().unwrap());
    let rows = reader.records().map(|record| fields(&record.unwrap())).collect();
    (header, rows)
}

/// What the library makes of rays, as the program has them traced.
fn expected(scene: &str, rays: &[TraceRay], stop: Stop) -> Vec<TraceResult> {
    let mut backend = CpuBackend::new(None).unwrap();
    backend.upload(Arc::new(world(scene)), Precision::F64, 0).unwrap();
    backend.trace(rays, TraceOptions { tolerance: 1e-12, stop, max_steps: Some(100_000) }).unwrap()
}

/// Numbers with the fewest digits that read back exactly.
fn texts(numbers: &[f64]) -> Vec<String> {
    numbers.iter().map(|v| format!("{v:?}")).collect()
}

/// The fields of a result in front of its object.
fn fields(result: &TraceResult) -> Vec<String> {
    let status = match result.status {
        STATUS_HIT => "hit",
        STATUS_ESCAPED => "escaped",
        STATUS_STOPPED => "stopped",
        other => panic!("status {other}"),
    };
    [
        vec![status.to_owned()],
        texts(&[result.position, result.direction, result.momentum].concat()),
        texts(&[result.length]),
        vec![result.side.to_string(), result.steps.to_string(), result.chords.to_string()],
        texts(&[result.constraint_error, result.frequency_ratio]),
    ]
    .concat()
}

#[test]
fn reads_directions_and_passes_other_columns_through() {
    let folder = Folder::new("directions");
    let text = "name,x, y ,z,dx,dy,dz,note\r\n\"a, \"\"b\"\"\",1,-2.5,3e0,0,0,-1,\"two\r\nlines\"\r\nc,0,0,0,1,2,3,\r\n";
    let (header, rows) = folder.rows(GRAVITY, text, &["--length", "2"]);
    assert_eq!(header[..3], ["name", "note", "status"]);
    let rays = [TraceRay::looking([1.0, -2.5, 3.0], [0.0, 0.0, -1.0]), TraceRay::looking([0.0; 3], [1.0, 2.0, 3.0])];
    let results = expected(GRAVITY, &rays, Stop::Length(2.0));
    assert_eq!(rows.len(), 2);
    assert_eq!((&rows[0][..2], &rows[0][2..18]), (&["a, \"b\"", "two\r\nlines"].map(String::from)[..], &fields(&results[0])[..]));
    assert_eq!((&rows[1][..2], &rows[1][2..18]), (&["c", ""].map(String::from)[..], &fields(&results[1])[..]));
    // The length of a direction is the speed in a gravity field, so it has to arrive too.
    let speeds = [0, 1].map(|ray| distance(results[ray].momentum, [0.0; 3]));
    assert!(speeds[0] < 2.0 && speeds[1] > 3.0, "{speeds:?}");
}

#[test]
fn reads_momenta_senses_and_sides() {
    let folder = Folder::new("momenta");
    let text = "trace,side,pz,py,px,z,y,x\nfuture,-1,3,2,1,6,5,4\npast,1.0,3,2,1,6,5,4\n";
    let (header, rows) = folder.rows(WORMHOLE, text, &["--length", "2"]);
    assert_eq!(header[0], "status");
    let launch = Launch::Momentum([1.0, 2.0, 3.0]);
    let ray = TraceRay { origin: [4.0, 5.0, 6.0], launch, past: false, side: -1 };
    let results = expected(WORMHOLE, &[ray, TraceRay { past: true, side: 1, ..ray }], Stop::Length(2.0));
    assert_eq!(rows.len(), 2);
    assert_eq!((&rows[0][..16], &rows[1][..16]), (&fields(&results[0])[..], &fields(&results[1])[..]));
    // Neither the sense nor the side could be mistaken without a trace.
    assert!(distance(results[0].position, results[1].position) > 2.0 && results[0].side != results[1].side, "{results:?}");
}

#[test]
fn refuses_headers() {
    let folder = Folder::new("headers");
    assert_eq!(
        folder.complaint(FLAT, "x,y,z,dx,dy\n"),
        (1, 6, "column `dz` is missing, expected x,y,z and either dx,dy,dz or px,py,pz".into())
    );
    assert_eq!(folder.complaint(FLAT, "").1, 1);
    assert_eq!(folder.complaint(WORMHOLE, "x,y,z,px,dx,dy,dz\n").1, 4);
    assert_eq!(folder.complaint(WORMHOLE, "x,y,z,dx,dy,dz,x\n"), (1, 7, "column `x` again, expected it once".into()));
    let (_, column, reason) = folder.complaint(LORENZ, "x,y,z,px,py,pz\n");
    assert_eq!((column, reason.contains("`lorenz` have no momentum")), (4, true), "{reason}");
}

#[test]
fn refuses_values_with_their_line_and_column() {
    let folder = Folder::new("values");
    let header = "x,y,z,dx,dy,dz";
    for (found, end) in [("abc", "\n"), ("", "\r\n"), ("nan", "\n\n"), ("inf", "\r\n\r\n"), ("1e10", "\r"), ("1,2", "\n")] {
        let text = format!("{end}{header}{end}1,2,3,0,0,1{end}1,2,3,0,\"{found}\",1{end}");
        let lines = 3 * end.matches('\n').count().max(1) + 1;
        let (line, column, reason) = folder.complaint(FLAT, &text);
        assert_eq!((line, column), (lines, 5), "{text:?}");
        assert!(reason.starts_with(&format!("column `dy`: found `{found}`, expected a number")), "{reason}");
    }
    assert!(folder.complaint(FLAT, &format!("{header}\n1,2,3,0,-0.0,0\n")).2.contains("zero vector"));
    assert_eq!(folder.complaint(FLAT, &format!("{header}\n1,2,3,0,0,1\n1,2,3\n")).0, 3);
    assert_eq!(folder.complaint(FLAT, &format!("{header},trace\n1,2,3,0,0,1,Past\n")).1, 7);
    assert_eq!(folder.complaint(WORMHOLE, &format!("{header},side\n1,2,3,0,0,1,2\n")).1, 7);
    assert_eq!(folder.complaint(FLAT, &format!("{header},side\n1,2,3,0,0,1,-1\n")).1, 7);
}

#[test]
fn reads_planes() {
    let folder = Folder::new("planes");
    let rays = "x,y,z,dx,dy,dz\n1,0,3,0,-1,0\n";
    for text in ["1,2,3", "1,2,3,4,5", "0,0,0,1", "1,0,0,x", "1,0,0,inf", "nan,0,0,1", ""] {
        let reason = "expected four numbers nx,ny,nz,d with a normal that is not zero";
        assert_eq!(folder.refusal(FLAT, rays, &["--plane", text]), format!("--plane {text}: {reason}"));
    }
    let (header, rows) = folder.rows(FLAT, rays, &["--plane", "0, -2,0,4"]);
    assert_eq!(header[18..22], ["crossings", "c1_x", "c1_y", "c1_z"]);
    let ray = TraceRay::looking([1.0, 0.0, 3.0], [0.0, -1.0, 0.0]);
    let crossing = expected(FLAT, &[ray], Stop::Plane([0.0, -1.0, 0.0], 2.0))[0].position;
    assert_eq!((rows[0][18].as_str(), &rows[0][19..22]), ("1", &texts(&crossing)[..]));
    assert!(distance(crossing, [1.0, -2.0, 3.0]) < 1e-9, "{crossing:?}");
}

/// A file of one ray.
fn file_of(ray: &TraceRay) -> String {
    let (names, [vx, vy, vz]) = match ray.launch {
        Launch::Direction(direction) => ("dx,dy,dz", direction),
        Launch::Momentum(momentum) => ("px,py,pz", momentum),
    };
    let ([x, y, z], sense) = (ray.origin, if ray.past { "past" } else { "future" });
    format!("x,y,z,{names},trace,side\n{x},{y},{z},{vx},{vy},{vz},{sense},{}\n", ray.side)
}

/// Where a ray crosses a plane, and its end: it is launched again on the plane as it came there, along its direction with its speed
/// in a medium, with the photon's momentum in a metric. What is then reported as its momentum has this `sign` over its own.
fn through(scene: &str, ray: &TraceRay, plane: Stop, sign: f64) -> ([f64; 3], TraceResult) {
    let first = expected(scene, &[*ray], plane)[0];
    assert_eq!(first.status, STATUS_STOPPED);
    let launch = if world(scene).model.class() == Class::Metric {
        Launch::Momentum(first.momentum.map(|c| sign * c))
    } else {
        let speed = distance(first.momentum, [0.0; 3]);
        Launch::Direction(first.direction.map(|c| speed * c))
    };
    let rest = expected(scene, &[TraceRay { origin: first.position, launch, past: ray.past, side: first.side }], plane)[0];
    let whole = TraceResult {
        momentum: rest.momentum.map(|c| sign * c),
        length: first.length + rest.length,
        steps: first.steps + rest.steps,
        chords: first.chords + rest.chords,
        constraint_error: first.constraint_error + rest.constraint_error,
        frequency_ratio: first.frequency_ratio * rest.frequency_ratio,
        ..rest
    };
    (first.position, whole)
}

#[test]
fn goes_on_from_a_plane_as_it_came() {
    let folder = Folder::new("legs");
    let (slow, fast) = ([-1.0, 0.5, 0.0], [-2.5, 0.0, 0.0]);
    let looking = TraceRay::looking;
    let carrying = |origin, photon| TraceRay { origin, launch: Launch::Momentum(photon), past: true, side: 1 };
    let cases = [
        (GRAVITY, looking([10.0, 1.0, 0.0], fast), 0.5, 1.0),
        (GRAVITY, carrying([10.0, 1.0, 0.0], [2.5, 0.0, 0.0]), 0.5, -1.0),
        (SPINNING, looking([20.0, 0.0, 0.0], slow), 10.0, -1.0),
        (SPINNING, TraceRay { past: false, ..looking([20.0, 0.0, 0.0], slow) }, 10.0, 1.0),
        (SPINNING, carrying([20.0, 0.0, 0.0], [1.0, -0.5, 0.0]), 10.0, 1.0),
        (WORMHOLE, TraceRay { side: -1, ..looking([8.0, 0.0, 0.0], slow) }, 3.0, -1.0),
    ];
    for (scene, ray, x, sign) in cases {
        let rows = folder.rows(scene, &file_of(&ray), &["--plane", &format!("1,0,0,{x}")]).1;
        let (crossing, whole) = through(scene, &ray, Stop::Plane([1.0, 0.0, 0.0], x), sign);
        assert_eq!(rows[0][..16], fields(&whole)[..], "{ray:?}");
        assert_eq!((rows[0][18].as_str(), &rows[0][19..22]), ("1", &texts(&crossing)[..]), "{ray:?}");
        // It ends as it does where no plane is.
        let plain = expected(scene, &[ray], Stop::Never)[0];
        assert_eq!((whole.status, whole.side), (STATUS_ESCAPED, ray.side), "{ray:?}");
        assert_eq!((plain.status, plain.side), (STATUS_ESCAPED, ray.side), "{ray:?}");
        assert!(distance(whole.direction, plain.direction) < 1e-7, "{ray:?}: {whole:?} {plain:?}");
        assert!((whole.frequency_ratio - plain.frequency_ratio).abs() < 1e-7, "{ray:?}: {whole:?} {plain:?}");
        let momentum = distance(plain.momentum, [0.0; 3]);
        assert!(distance(whole.momentum, plain.momentum) < 1e-4 * momentum, "{ray:?}: {whole:?} {plain:?}");
    }
}

#[test]
fn columns_that_are_passed_through_give_way() {
    let folder = Folder::new("names");
    let rays = "name,length,in_length,c1_x,vx,x,y,z,dx,dy,dz\na,1,2,3,4,0,0,0,0,0,1\n";
    let cases: [(&[&str], [&str; 6]); 2] = [
        (&[], ["name", "in_in_length", "in_length", "c1_x", "in_vx", "status"]),
        (&["--plane", "0,0,1,2"], ["name", "in_in_length", "in_length", "in_c1_x", "in_vx", "status"]),
    ];
    for (extra, names) in cases {
        let (header, rows) = folder.rows(FLAT, rays, extra);
        assert_eq!(header[..6], names);
        assert_eq!(rows[0][..6], ["a", "1", "2", "3", "4", "hit"]);
    }
}

#[test]
fn rows_read_back_exactly() {
    let folder = Folder::new("rows");
    let (header, rows) = folder.rows(FLAT, "name,x,y,z,dx,dy,dz\n\"a, \"\"b\"\"\",0.1,-2,1e-300,0,0,1\nc,0,0,0,1,2,30\n", &[]);
    let rays = [TraceRay::looking([0.1, -2.0, 1e-300], [0.0, 0.0, 1.0]), TraceRay::looking([0.0; 3], [1.0, 2.0, 30.0])];
    let results = expected(FLAT, &rays, Stop::Never);
    let [passing, hitting] = [0, 1].map(|ray| fields(&results[ray]).join(","));
    assert!(passing.starts_with("escaped,0.1,-2.0,1e-300,0.0,0.0,1.0,") && hitting.starts_with("hit,"), "{passing} {hitting}");
    let text = format!("{}\n\"a, \"\"b\"\"\",{passing},,\nc,{hitting},0,\"red, shiny\"\n", header.join(","));
    assert_eq!(folder.read("out.csv"), text);
    assert_eq!((header.len(), &rows[1][17..]), (19, &["0", "red, shiny"].map(String::from)[..]));

    let ray = TraceRay::looking([20.0, 0.0, 0.0], [-1.0, 0.5, 0.0]);
    let (header, rows) = folder.rows(SPINNING, &file_of(&ray), &["--plane", "1,0,0,10"]);
    let (crossing, whole) = through(SPINNING, &ray, Stop::Plane([1.0, 0.0, 0.0], 10.0), -1.0);
    let row = folder.read("out.csv").lines().nth(1).unwrap().to_owned();
    assert_eq!(row, format!("{},,,1,{},,,,,,", fields(&whole).join(","), texts(&crossing).join(",")));
    assert_eq!(header.len(), 28);
    let [drift, ratio] = [14, 15].map(|column| rows[0][column].parse::<f64>().unwrap());
    assert!(drift > 0.0 && drift < 1e-6 && rows[0][14].contains("e-"), "{}", rows[0][14]);
    assert_eq!((drift, ratio), (whole.constraint_error, whole.frequency_ratio));
}

#[test]
fn drift_is_counted_in_order() {
    let folder = Folder::new("drift");
    let header = "x,y,z,dx,dy,dz\n";
    let none = folder.summary(HOLE, header, &[]);
    assert_eq!(none["rays"], 0);
    assert_eq!(none["constraint_error_p99.9"], 0.0);

    // Away from the hole and past it, and two that come so near that they drift further than all others.
    let wide = (0..1998).map(|i| f64::from(i) * 1e-3).map(|angle| format!("20,0,0,{:?},{:?},0\n", angle.cos(), angle.sin()));
    let near = ["20,0,0,-1,0.3,0\n", "20,0,0,-1,-0.31,0\n"].map(String::from);
    let rays: String = std::iter::once(header.to_owned()).chain(near).chain(wide).collect();
    let options = ["--length", "30", "--tolerance", "1e-8"];
    let summary = folder.summary(HOLE, &rays, &options);
    let (names, rows) = read_csv(&folder.read("out.csv"));
    let column = names.iter().position(|name| name == "constraint_error").unwrap();
    let mut drifts: Vec<f64> = rows.iter().map(|row| row[column].parse().unwrap()).collect();
    drifts.sort_by(f64::total_cmp);
    let [max, quantile] = ["max_constraint_error", "constraint_error_p99.9"].map(|key| summary[key].as_f64().unwrap());
    println!("drift: largest {max:e}, 99.9 percent {quantile:e}");
    assert_eq!(summary["rays"], 2000);
    assert_eq!(summary["status"]["stopped"], 2000);
    assert_eq!(drifts.len(), 2000);
    assert!(drifts[1999] > 1.01 * drifts[1997], "{:?}", &drifts[1995..]);
    assert!((max / drifts[1999] - 1.0).abs() < 1e-14, "{max:e} {:e}", drifts[1999]);
    assert!((quantile / drifts[1997] - 1.0).abs() < 0.004, "{quantile:e} {:e}", drifts[1997]);

    // From the singularity no ray gets anywhere: its drift is not a number, and counts as infinite, which JSON has no number for.
    let lost = folder.summary(HOLE, &format!("{header}20,0,0,1,0,0\n0,0,0,0,0,1\n"), &options);
    let rows = read_csv(&folder.read("out.csv")).1;
    assert_eq!((rows[0][0].as_str(), rows[1][column].as_str()), ("stopped", "NaN"));
    assert!(lost["max_constraint_error"].is_null() && lost["constraint_error_p99.9"].is_null(), "{lost}");
}

#[test]
fn vtp_has_a_polyline_for_each_ray() {
    let folder = Folder::new("polylines");
    let rays = "x,y,z,dx,dy,dz,side\n8,0,0,-1,0.5,0,-1\n25,0,0,1,0,0,1\n";
    let run = |paths: &str| folder.succeed(WORMHOLE, rays, &["--sphere", "30", "--tolerance", "1e-8", "--paths", &folder.path(paths)]);
    run("paths.csv");
    run("paths.vtp");
    let (header, vertices) = read_csv(&folder.read("paths.csv"));
    assert_eq!(header.join(","), "ray,vertex,x,y,z,length,side");
    let first = vertices.iter().filter(|vertex| vertex[0] == "0").count();
    let points = vertices.len();
    assert!(points >= first + 2 && first > points - first, "{first} of {points}");

    let text = folder.read("paths.vtp");
    assert!(text.contains(&format!("NumberOfPoints=\"{points}\" NumberOfLines=\"2\"")), "{points}");
    let values = |name: &str| -> Vec<String> {
        let array = text.split(&format!("Name=\"{name}\"")).nth(1).unwrap();
        array.split(['>', '<']).nth(1).unwrap().split_whitespace().map(str::to_owned).collect()
    };
    let columns = |columns: &[usize]| -> Vec<String> { vertices.iter().flat_map(|v| columns.iter().map(move |c| v[*c].clone())).collect() };
    assert_eq!(values("offsets"), [first, points].map(|end| end.to_string()));
    assert_eq!(values("connectivity"), (0..points).map(|i| i.to_string()).collect::<Vec<_>>());
    assert_eq!(values("ray"), columns(&[0]));
    assert_eq!(values("Points"), columns(&[2, 3, 4]));
    assert_eq!((values("length"), values("side")), (columns(&[5]), columns(&[6])));
}
