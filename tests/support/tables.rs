//! The tables of tests/reference that state where rays go, each as one comparison that serves every backend in both precisions.
//!
//! Errors are relative to the size of the number compared where that is above 1, and divided by the row's condition number where that
//! is: near a photon sphere rounding of the initial data alone moves a ray's end by 1e8 times as much.

use super::{Row, distance, table, world};
use nullray::backend::{Backend, Launch, Precision, Stop, TraceOptions, TraceRay, TraceResult};
use nullray::kernels::constants::{STATUS_CAPTURED, STATUS_ESCAPED, STATUS_STOPPED};
use nullray::kernels::integrator::{ModelBlock, PointFunctions, along};
use nullray::kernels::triangle::{cross, dot};
use nullray::spacetime::{ModelKind, thermal};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A reference table and the largest errors allowed in it.
pub struct Table {
    pub name: &'static str,
    /// In single and in double precision.
    bounds: [f64; 2],
    compare: fn(&mut Tracer) -> Errors,
}

/// Every table that is compared here.
pub const TABLES: &[Table] = &[
    Table { name: "schw_rays", bounds: [2e-3, 1e-7], compare: schwarzschild_rays },
    Table { name: "schw_deflection", bounds: [2e-3, 1e-7], compare: schwarzschild_deflection },
    Table { name: "redshift_pairs", bounds: [2e-3, 1e-7], compare: redshift_pairs },
    Table { name: "luminet_disc", bounds: [2e-3, 1e-7], compare: luminet_disc },
    Table { name: "kerr_rays", bounds: [2e-3, 1e-7], compare: kerr_rays },
    Table { name: "kerr_shadow", bounds: [2e-3, 1e-5], compare: kerr_shadow },
    Table { name: "kerr_photon_orbits", bounds: [2e-3, 1e-5], compare: kerr_photon_orbits },
    Table { name: "alcubierre_rays", bounds: [2e-3, 1e-7], compare: alcubierre_rays },
    Table { name: "ellis_rays", bounds: [2e-3, 1e-7], compare: ellis_rays },
    Table { name: "grin_fisheye", bounds: [2e-3, 1e-7], compare: fisheye },
    Table { name: "grin_luneburg", bounds: [2e-3, 1e-7], compare: luneburg },
    Table { name: "flow_lorenz_roessler", bounds: [2e-3, 1e-7], compare: flows },
];

impl Table {
    /// The table of that name.
    pub fn named(name: &str) -> &'static Table {
        TABLES.iter().find(|t| t.name == name).unwrap_or_else(|| panic!("no table {name}"))
    }

    /// Fails if a ray of the table ends otherwise, or elsewhere, than it should.
    pub fn check(&self, backend: &mut dyn Backend, precision: Precision) {
        let errors = (self.compare)(&mut Tracer { backend, precision });
        let bound = self.bounds[usize::from(precision == Precision::F64)];
        println!("{} {precision:?}: {} values, largest error {:.2e} ({})", self.name, errors.compared, errors.largest, errors.row);
        assert!(errors.compared > 0, "{}: nothing compared", self.name);
        assert!(errors.largest < bound, "{} {precision:?}: {:e} is not below {bound:e} ({})", self.name, errors.largest, errors.row);
    }
}

/// The largest error of a table's rows over max(1, condition number).
#[derive(Default)]
struct Errors {
    largest: f64,
    /// Which row has it, and what of it.
    row: String,
    /// Numbers compared.
    compared: usize,
}

impl Errors {
    fn add(&mut self, case: &Case, what: &str, error: f64) {
        self.compared += 1;
        let error = if error.is_nan() { f64::INFINITY } else { error / case.cond.max(1.0) };
        if error > self.largest || self.row.is_empty() {
            self.largest = error;
            self.row = format!("{what} of {}", case.name);
        }
    }

    /// Compares points relative to the larger of 1 and their distance from the origin.
    fn add_point(&mut self, case: &Case, what: &str, found: [f64; 3], expected: [f64; 3]) {
        self.add(case, what, distance(found, expected) / size(expected).max(1.0));
    }
}

/// A row with its name and condition number.
struct Case {
    row: Row,
    name: String,
    cond: f64,
}

impl Case {
    /// Whether a cell is not empty.
    fn has(&self, column: &str) -> bool {
        !self.row.text(column).is_empty()
    }

    fn expect(&self, result: &TraceResult, status: u32) {
        assert_eq!(result.status, status, "{}", self.name);
    }
}

/// A backend at work in one precision.
struct Tracer<'a> {
    backend: &'a mut dyn Backend,
    precision: Precision,
}

impl Tracer<'_> {
    /// The better of two values in f64, the worse in f32.
    fn by_precision(&self, single: f64, double: f64) -> f64 {
        if self.precision == Precision::F64 { double } else { single }
    }

    /// Rows of a table, named by some columns, without those that are beyond the precision.
    fn cases(&self, name: &str, named_by: &[&str], cond: impl Fn(&Row) -> f64) -> Vec<Case> {
        let limit = self.by_precision(1e3, f64::INFINITY);
        let describe = |row: &Row| named_by.iter().map(|c| format!("{c} {}", row.text(c))).collect::<Vec<_>>().join(", ");
        let cases = table(name).into_iter().map(|row| Case { name: describe(&row), cond: cond(&row), row });
        cases.filter(|c| c.cond <= limit).collect()
    }

    /// Makes a `[spacetime]` the one that rays are traced through.
    fn enter(&mut self, spacetime: &str) {
        let world = world(&format!("[spacetime]\n{spacetime}\n[integrator]\nmax_steps = 1000000\n"));
        self.backend.upload(Arc::new(world), self.precision, 0).unwrap();
    }

    fn trace(&mut self, rays: &[TraceRay], stop: Stop) -> Vec<TraceResult> {
        let options = TraceOptions { tolerance: self.by_precision(1e-5, 1e-12), stop, max_steps: None };
        let results = self.backend.trace(rays, options).unwrap();
        assert_eq!(results.len(), rays.len());
        results
    }

    /// Traces rays that have to come to the stop.
    fn stopped(&mut self, cases: &[&Case], rays: &[TraceRay], stop: Stop) -> Vec<TraceResult> {
        let results = self.trace(rays, stop);
        cases.iter().zip(&results).for_each(|(case, result)| case.expect(result, STATUS_STOPPED));
        results
    }

    /// For each bracket the value that parts captured rays (its low end) from escaping ones, by bisection.
    fn thresholds(&mut self, cases: &[Case], ends: [f64; 2], bisections: u32, ray: impl Fn(usize, f64) -> TraceRay) -> Vec<f64> {
        let mut captured = |values: &[f64]| -> Vec<bool> {
            let rays: Vec<TraceRay> = values.iter().enumerate().map(|(i, v)| ray(i, *v)).collect();
            let results = self.trace(&rays, Stop::Never);
            results
                .iter()
                .zip(cases)
                .map(|(result, case)| match result.status {
                    STATUS_CAPTURED => true,
                    STATUS_ESCAPED => false,
                    status => panic!("{}: status {status}", case.name),
                })
                .collect()
        };
        let [mut low, mut high] = ends.map(|end| vec![end; cases.len()]);
        for (i, (inside, outside)) in captured(&low).into_iter().zip(captured(&high)).enumerate() {
            assert!(inside && !outside, "{}: captured {inside} inside the threshold, {outside} outside", cases[i].name);
        }
        for _ in 0..bisections {
            let middle: Vec<f64> = low.iter().zip(&high).map(|(a, b)| 0.5 * (a + b)).collect();
            for (i, inside) in captured(&middle).into_iter().enumerate() {
                let end = if inside { &mut low[i] } else { &mut high[i] };
                *end = middle[i];
            }
        }
        low.iter().zip(&high).map(|(a, b)| 0.5 * (a + b)).collect()
    }
}

/// The condition number in a column: 1 where the table has none, which is for captured rays and radial ones.
fn cond_in(column: &'static str) -> impl Fn(&Row) -> f64 {
    move |row| row.text(column).parse().unwrap_or(1.0f64).abs()
}

/// Of a table of rays none of which is near-critical.
fn well_conditioned(_: &Row) -> f64 {
    1.0
}

/// Cases with the same text in some columns.
fn grouped(cases: Vec<Case>, columns: &[&str]) -> Vec<Vec<Case>> {
    let mut groups: BTreeMap<Vec<String>, Vec<Case>> = BTreeMap::new();
    for case in cases {
        groups.entry(columns.iter().map(|c| case.row.text(c).to_owned()).collect()).or_default().push(case);
    }
    groups.into_values().collect()
}

fn size(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    v.map(|c| c / size(v))
}

/// a x + b y.
fn combine(a: f64, x: [f64; 3], b: f64, y: [f64; 3]) -> [f64; 3] {
    along(x.map(|c| a * c), y, b)
}

/// Schwarzschild's isotropic radius of an areal one.
fn isotropic(r: f64) -> f64 {
    if r.is_infinite() { r } else { 0.5 * (r - 1.0 + (r * (r - 2.0)).sqrt()) }
}

/// Parameters of a Schwarzschild hole of mass 1.
fn unit_hole() -> ModelBlock<f64> {
    ModelBlock { global: vec![1.0], ..ModelBlock::default() }
}

fn schwarzschild_rays(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let cases = tracer.cases("schw_rays", &["r_obs", "alpha_in"], cond_in("dsweep_dalpha"));
    tracer.enter("kind = \"schwarzschild\"");
    let ray = |case: &Case| TraceRay::looking(case.row.vector(["x0", "y0", "z0"]), case.row.vector(["dx", "dy", "dz"]));
    let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
    for (case, result) in cases.iter().zip(tracer.trace(&rays, Stop::Never)) {
        if case.row.text("outcome") == "captured" {
            case.expect(&result, STATUS_CAPTURED);
        } else {
            case.expect(&result, STATUS_ESCAPED);
            errors.add_point(case, "direction", result.direction, case.row.vector(["fx", "fy", "fz"]));
        }
    }
    for (case, result) in cases.iter().zip(tracer.trace(&rays, Stop::Sphere(100.0))) {
        if case.has("hout_x") {
            case.expect(&result, STATUS_STOPPED);
            errors.add_point(case, "crossing of rho = 100", result.position, case.row.vector(["hout_x", "hout_y", "hout_z"]));
        } else {
            // Captured, or never that near.
            assert_ne!(result.status, STATUS_STOPPED, "{}", case.name);
        }
    }
    errors
}

/// From the periapsis outward: half of what a ray from infinity to infinity is turned by.
fn schwarzschild_deflection(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let cond = |row: &Row| row.number("r_min") / (row.number("r_min") - 3.0);
    let cases = tracer.cases("schw_deflection", &["b"], cond);
    tracer.enter("kind = \"schwarzschild\"");
    let ray = |case: &Case| TraceRay::looking([isotropic(case.row.number("r_min")), 0.0, 0.0], [0.0, 1.0, 0.0]);
    let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
    for (case, result) in cases.iter().zip(tracer.trace(&rays, Stop::Never)) {
        case.expect(&result, STATUS_ESCAPED);
        let (sin, cos) = (0.5 * case.row.number("deflection")).sin_cos();
        errors.add(case, "deflection", 2.0 * distance(result.direction, [-sin, cos, 0.0]));
    }
    errors
}

/// Frequency that matter on the circular orbit of areal radius `r` about +z sees of a photon that was traced backward from where it
/// arrives; 1 is its frequency at infinity.
fn frequency_in_orbit(result: &TraceResult, r: f64) -> f64 {
    let functions = PointFunctions::<f64>::of(ModelKind::Schwarzschild);
    let [x, y, _] = result.position;
    let turn = r.powf(-1.5);
    (functions.matter_frequency)((), &unit_hole(), result.position, result.momentum, 1.0, -1.0, [-turn * y, turn * x, 0.0])
}

/// Compares where a ray came through the plane z = 0 with a point of the disc there, and its frequency ratio with `g`.
fn add_disc_point(errors: &mut Errors, case: &Case, result: &TraceResult, [r, phi]: [f64; 2], observed: f64) {
    let rho = isotropic(r);
    // A ray along the plane has no definite crossing.
    let grazing = result.direction[2].abs();
    errors.add(case, "point of the disc", grazing * distance(result.position, [rho * phi.cos(), rho * phi.sin(), 0.0]) / rho);
    errors.add(case, "g", grazing * (observed / frequency_in_orbit(result, r) / case.row.number("g") - 1.0).abs());
}

/// The plane of the discs.
const EQUATOR: Stop = Stop::Plane([0.0, 0.0, 1.0], 0.0);

fn redshift_pairs(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let functions = PointFunctions::<f64>::of(ModelKind::Schwarzschild);
    let hole = unit_hole();
    tracer.enter("kind = \"schwarzschild\"");
    for case in tracer.cases("redshift_pairs", &["kind", "r_em", "r_obs"], well_conditioned) {
        let [emitter, observer] = ["rho_em", "rho_obs"].map(|c| case.row.number(c));
        if case.row.text("kind") == "circular" {
            // Look from the observer at the emitter, in the plane of both and the hole.
            let ([inclination, phi], alpha) = (["inc_deg", "phi_em"].map(|c| case.row.number(c)), case.row.number("alpha_obs_in"));
            let (sin, cos) = inclination.to_radians().sin_cos();
            let up = [sin, 0.0, cos];
            let source = [phi.cos(), phi.sin(), 0.0];
            let aside = unit(combine(1.0, source, -dot(source, up), up));
            let ray = TraceRay::looking(up.map(|c| observer * c), combine(-alpha.cos(), up, alpha.sin(), aside));
            let result = tracer.stopped(&[&case], &[ray], EQUATOR)[0];
            let (_, _, here) = (functions.launch)((), &hole, ray.origin, [1.0, 0.0, 0.0], 1.0, -1.0);
            add_disc_point(&mut errors, &case, &result, [case.row.number("r_em"), phi], here);
            continue;
        }
        // Radially from the emitter to the observer.
        let outward = if observer > emitter { 1.0 } else { -1.0 };
        let start = [emitter, 0.0, 0.0];
        let direction = [outward, 0.0, 0.0];
        let ray = TraceRay { past: false, ..TraceRay::looking(start, direction) };
        let mut g = if observer.is_finite() {
            tracer.stopped(&[&case], &[ray], Stop::Plane([1.0, 0.0, 0.0], observer))[0].frequency_ratio
        } else {
            let result = tracer.trace(&[ray], Stop::Never)[0];
            case.expect(&result, STATUS_ESCAPED);
            result.frequency_ratio
        };
        if case.row.text("kind") == "infall_radial" {
            // dr/dt of a fall from rest at infinity, in the isotropic radius.
            let r = case.row.number("r_em");
            let fall = -(1.0 - 2.0 / r) * (2.0 / r).sqrt() / (1.0 - 0.25 / (emitter * emitter));
            let (momentum, energy, at_rest) = (functions.launch)((), &hole, start, direction, 1.0, 1.0);
            g *= at_rest / (functions.matter_frequency)((), &hole, start, momentum, energy, 1.0, [fall, 0.0, 0.0]);
        }
        errors.add(&case, "g", (g / case.row.number("g") - 1.0).abs());
    }
    errors
}

/// Seen from infinity: a ray of impact parameter b leaves the isotropic radius R at the angle asin(b / n R) and is turned by
/// (2 / b) (1 - cos) from there on, up to (1 / R)^2.
fn luminet_disc(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let start = tracer.by_precision(1e3, 1e5);
    let cases = tracer.cases("luminet_disc", &["r", "phi_deg", "order"], well_conditioned);
    tracer.enter("kind = \"schwarzschild\"");
    let (sin, cos) = 80.0f64.to_radians().sin_cos();
    let (sight, right, up) = ([sin, 0.0, cos], [0.0, 1.0, 0.0], [-cos, 0.0, sin]);
    let ray = |case: &Case| {
        let [x, y] = ["X", "Y"].map(|c| case.row.number(c));
        let b = x.hypot(y);
        let offset = combine(x / b, right, y / b, up);
        let u = 0.5 / start;
        let alpha = (b * (1.0 - u) / ((1.0 + u).powi(3) * start)).asin();
        let away = alpha + 2.0 / b * (1.0 - alpha.cos());
        let outward = combine(away.cos(), sight, away.sin(), offset);
        let aside = combine(-away.sin(), sight, away.cos(), offset);
        TraceRay::looking(outward.map(|c| start * c), combine(-alpha.cos(), outward, alpha.sin(), aside))
    };
    let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
    let all: Vec<&Case> = cases.iter().collect();
    let first = tracer.stopped(&all, &rays, EQUATOR);
    let onward: Vec<TraceRay> = first.iter().map(|r| TraceRay::looking(r.position, r.direction)).collect();
    let is_second = |case: &Case| case.row.text("order") == "2";
    let later: Vec<usize> = (0..cases.len()).filter(|i| is_second(&cases[*i])).collect();
    let later_cases: Vec<&Case> = later.iter().map(|i| all[*i]).collect();
    let later_rays: Vec<TraceRay> = later.iter().map(|i| onward[*i]).collect();
    let second = tracer.stopped(&later_cases, &later_rays, EQUATOR);
    let hits = all.iter().zip(&first).filter(|(case, _)| !is_second(case)).chain(later_cases.iter().zip(&second));
    for (case, result) in hits {
        add_disc_point(&mut errors, case, result, ["r", "phi"].map(|c| case.row.number(c)), 1.0);
    }
    errors
}

/// Boyer-Lindquist radius of a point in Kerr-Schild coordinates, the spin along +z.
fn kerr_radius(x: [f64; 3], spin: f64) -> f64 {
    let w = dot(x, x) - spin * spin;
    (0.5 * (w + w.hypot(2.0 * spin * x[2]))).sqrt()
}

/// Point and covariant momentum, in ingoing Kerr-Schild coordinates, of a photon of energy 1, angular momentum `xi` and momentum `beta`
/// along theta at Boyer-Lindquist radius `r` and polar angle `theta`. The hole has mass 1, `spin` along +z, and `charge`.
///
/// The radial momentum follows from Carter's constant; t_ks = t + int (2 r - Q^2) / Delta dr and phi_ks = phi + int a / Delta dr.
pub fn kerr_photon([spin, charge]: [f64; 2], [r, theta]: [f64; 2], xi: f64, beta: f64, outward: bool) -> ([f64; 3], [f64; 3]) {
    let (sin, cos) = theta.sin_cos();
    let delta = r * r - 2.0 * r + spin * spin + charge * charge;
    let carter = beta * beta + (xi * cos / sin).powi(2) - (spin * cos).powi(2) + (xi - spin).powi(2);
    let root = ((r * r + spin * spin - spin * xi).powi(2) - delta * carter).sqrt();
    let radial = (if outward { root } else { -root } + 2.0 * r - charge * charge - spin * xi) / delta;
    // x + i y = (r + i a) e^(i phi) sin(theta) at phi = 0, and its derivatives by r, theta and phi.
    let x = [r * sin, spin * sin, r * cos];
    let (by_r, by_theta, by_phi) = ([sin, 0.0, cos], [r * cos, spin * cos, -r * sin], [-x[1], x[0], 0.0]);
    let volume = dot(by_r, cross(by_theta, by_phi));
    let p = combine(radial, cross(by_theta, by_phi), beta, cross(by_phi, by_r));
    (x, along(p, cross(by_r, by_theta), xi).map(|c| c / volume))
}

fn enter_kerr(tracer: &mut Tracer, case: &Case) -> f64 {
    let spin = case.row.text("a");
    tracer.enter(&format!("kind = \"kerr\"\nspin = {spin}\naxis = [0, 0, 1]"));
    case.row.number("a")
}

fn kerr_rays(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let mut cases = tracer.cases("kerr_rays", &["a", "id"], cond_in("cond"));
    if tracer.precision == Precision::F32 {
        // Captured rays have no condition number, and those that circle the hole first would need one.
        cases.retain(|case| case.row.text("outcome") == "escaped" || case.row.number("n_eq") < 2.0);
    }
    for cases in grouped(cases, &["a"]) {
        let spin = enter_kerr(tracer, &cases[0]);
        let all: Vec<usize> = (0..cases.len()).collect();
        let ray = |case: &Case| TraceRay {
            origin: case.row.vector(["x", "y", "z"]),
            launch: Launch::Momentum(case.row.vector(["p_x", "p_y", "p_z"])),
            past: case.row.text("trace") == "past",
            side: 1,
        };
        let mut rays: Vec<TraceRay> = cases.iter().map(ray).collect();
        let chosen = |indices: &[usize], rays: &[TraceRay]| -> (Vec<&Case>, Vec<TraceRay>) {
            (indices.iter().map(|i| &cases[*i]).collect(), indices.iter().map(|i| rays[*i]).collect())
        };

        let ends = tracer.trace(&rays, Stop::Never);
        for (case, end) in cases.iter().zip(&ends) {
            if case.row.text("outcome") == "captured" {
                case.expect(end, STATUS_CAPTURED);
            } else {
                case.expect(end, STATUS_ESCAPED);
                errors.add_point(case, "direction", end.direction, case.row.vector(["nx", "ny", "nz"]));
            }
        }

        let escaping: Vec<usize> = all.iter().copied().filter(|i| cases[*i].has("x200")).collect();
        let (some, from) = chosen(&escaping, &rays);
        for (case, result) in some.iter().zip(tracer.stopped(&some, &from, Stop::Sphere(200.0))) {
            errors.add_point(case, "crossing of r = 200", result.position, case.row.vector(["x200", "y200", "z200"]));
        }

        for i in all.iter().copied().filter(|i| cases[*i].has("hor_x")) {
            let found = horizon_crossing(tracer, rays[i], spin, &ends[i]);
            errors.add_point(&cases[i], "crossing of the horizon", found, cases[i].row.vector(["hor_x", "hor_y", "hor_z"]));
        }

        let mut crossing = all;
        for column in ["eq1_r", "eq2_r", "eq3_r"] {
            crossing.retain(|i| cases[*i].has(column));
            let (some, from) = chosen(&crossing, &rays);
            for (i, result) in crossing.iter().zip(tracer.stopped(&some, &from, EQUATOR)) {
                let (case, expected) = (&cases[*i], cases[*i].row.number(column));
                let error = (kerr_radius(result.position, spin) / expected - 1.0).abs();
                errors.add(case, column, error);
                if column == "eq1_r" {
                    let place = [case.row.number("eq1_x"), case.row.number("eq1_y"), 0.0];
                    // Into the past the azimuth of this chart winds by 2 a / Delta dr towards the horizon.
                    let winding = 2.0 * spin / (expected * (expected - 2.0) + spin * spin);
                    errors.add(case, "first crossing", distance(result.position, place) / size(place) / (1.0 + winding));
                }
                rays[*i] = TraceRay { origin: result.position, launch: Launch::Momentum(result.momentum), ..rays[*i] };
            }
        }
    }
    errors
}

/// Where a ray of the future comes through the horizon, in which its chart is regular: secant steps in coordinate time from where it
/// was captured, somewhat below.
fn horizon_crossing(tracer: &mut Tracer, ray: TraceRay, spin: f64, captured: &TraceResult) -> [f64; 3] {
    let horizon = 1.0 + (1.0 - spin * spin).sqrt();
    let close_enough = tracer.by_precision(3e-4, 1e-10);
    let above = |result: &TraceResult| kerr_radius(result.position, spin) - horizon;
    let mut before = *captured;
    let mut time = captured.parameter - 0.05;
    for _ in 0..10 {
        let now = tracer.trace(&[ray], Stop::Parameter(time))[0];
        if above(&now).abs() < close_enough {
            return now.position;
        }
        time = now.parameter - above(&now) * (now.parameter - before.parameter) / (above(&now) - above(&before));
        before = now;
    }
    panic!("no crossing of the horizon found from {:?}", ray.origin);
}

/// Whether a ray is captured depends on its constants of motion alone, which are exact here: its starting point may be anywhere
/// outside.
fn kerr_shadow(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let bisections = tracer.by_precision(10.0, 18.0) as u32;
    let every_third = tracer.cases("kerr_shadow", &["a", "inc_deg", "k"], well_conditioned).into_iter().step_by(3).collect();
    for cases in grouped(every_third, &["a"]) {
        let spin = enter_kerr(tracer, &cases[0]);
        let ray = |i: usize, scale: f64| {
            let case = |c: &str| cases[i].row.number(c);
            let theta = case("inc_deg").to_radians();
            let (sin, cos) = case("psi").sin_cos();
            let (alpha, beta) = (case("alpha_center") + scale * case("radius") * cos, scale * case("radius") * sin);
            let (origin, p) = kerr_photon([spin, 0.0], [30.0, theta], -alpha * theta.sin(), -beta, true);
            TraceRay { origin, launch: Launch::Momentum(p), past: true, side: 1 }
        };
        for (case, scale) in cases.iter().zip(tracer.thresholds(&cases, [0.95, 1.05], bisections, ray)) {
            errors.add(case, "radius", (scale - 1.0).abs() * case.row.number("radius"));
        }
    }
    errors
}

fn kerr_photon_orbits(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let bisections = tracer.by_precision(10.0, 18.0) as u32;
    for cases in grouped(tracer.cases("kerr_photon_orbits", &["a"], well_conditioned), &["a"]) {
        let spin = enter_kerr(tracer, &cases[0]);
        let case = &cases[0];
        for (sign, orbit) in [(1.0, "prograde"), (-1.0, "retrograde")] {
            // Around an extremal hole the orbit along its spin is at the horizon.
            if spin == 1.0 && sign == 1.0 {
                continue;
            }
            let isco = thermal::isco(1.0, sign * spin) / case.row.number(&format!("r_isco_{orbit}")) - 1.0;
            errors.add(case, "innermost stable orbit", isco.abs());
            let b = case.row.number(&format!("b_photon_{orbit}"));
            let ray = |_: usize, scale: f64| {
                let (origin, p) = kerr_photon([spin, 0.0], [30.0, std::f64::consts::FRAC_PI_2], scale * b, 0.0, false);
                TraceRay { origin, launch: Launch::Momentum(p), past: false, side: 1 }
            };
            let scale = tracer.thresholds(&cases[..1], [0.95, 1.05], bisections, ray)[0];
            errors.add(case, orbit, (scale - 1.0).abs());
        }
    }
    errors
}

/// The model's chart moves with the bubble: x = X + v t.
fn alcubierre_rays(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let cases = tracer.cases("alcubierre_rays", &["id", "kind", "trace"], cond_in("cond"));
    for cases in grouped(cases, &["v", "R", "sigma", "t0", "t_end"]) {
        let value = |column: &str| cases[0].row.text(column);
        tracer.enter(&format!(
            "kind = \"alcubierre\"\nspeed = {}\nradius = {}\nsigma = {}\naxis = [1, 0, 0]",
            value("v"),
            value("R"),
            value("sigma")
        ));
        let [speed, begin, end] = ["v", "t0", "t_end"].map(|c| cases[0].row.number(c));
        let ray = |case: &Case| TraceRay {
            origin: along(case.row.vector(["x0", "y0", "z0"]), [1.0, 0.0, 0.0], -speed * begin),
            launch: Launch::Momentum(case.row.vector(["p_x", "p_y", "p_z"])),
            past: case.row.text("trace") == "past",
            side: 1,
        };
        let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
        let all: Vec<&Case> = cases.iter().collect();
        for (case, result) in cases.iter().zip(tracer.stopped(&all, &rays, Stop::Parameter((end - begin).abs()))) {
            let found = along(result.position, [1.0, 0.0, 0.0], speed * end);
            errors.add_point(case, "position", found, case.row.vector(["x_end", "y_end", "z_end"]));
            errors.add_point(case, "direction", unit(result.momentum), case.row.vector(["dir_x", "dir_y", "dir_z"]));
            errors.add_point(case, "momentum", result.momentum, case.row.vector(["p_x_end", "p_y_end", "p_z_end"]));
            errors.add(case, "frequency", (result.frequency_ratio / case.row.number("omega_end") - 1.0).abs());
        }
    }
    errors
}

fn ellis_rays(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    let cases = tracer.cases("ellis_rays", &["id"], cond_in("cond"));
    tracer.enter("kind = \"ellis\"\nthroat = 1");
    let ray = |case: &Case| TraceRay::looking(case.row.vector(["x0", "y0", "z0"]), case.row.vector(["dx", "dy", "dz"]));
    let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
    for (case, result) in cases.iter().zip(tracer.trace(&rays, Stop::Never)) {
        case.expect(&result, STATUS_ESCAPED);
        let side = if case.row.text("side_end") == "+" { 1 } else { -1 };
        assert_eq!(result.side, side, "{}", case.name);
        errors.add_point(case, "direction", result.direction, case.row.vector(["nx", "ny", "nz"]));
    }
    errors
}

fn fisheye(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    // Rays are great circles in stereographic projection, which magnifies by 1 + (r / R)^2.
    let stretch = |row: &Row| {
        let points = ["q1", "q2", "q3", "img"].map(|point| size(["x", "y", "z"].map(|axis| row.number(&format!("{point}_{axis}")))));
        1.0 + (points.into_iter().fold(0.0, f64::max) / row.number("R")).powi(2)
    };
    for case in tracer.cases("grin_fisheye", &["id"], stretch) {
        tracer.enter(&format!("kind = \"grin\"\nprofile = \"fisheye\"\nn0 = {}\nradius = {}", case.row.text("n0"), case.row.text("R")));
        let ray = TraceRay::looking(case.row.vector(["p0_x", "p0_y", "p0_z"]), case.row.vector(["dx", "dy", "dz"]));
        for (share, point) in [(0.25, "q1"), (0.5, "q2"), (0.75, "q3"), (1.0, "img")] {
            let result = tracer.stopped(&[&case], &[ray], Stop::Length(share * case.row.number("path_length")))[0];
            let [x, y, z] = ["x", "y", "z"].map(|axis| case.row.number(&format!("{point}_{axis}")));
            errors.add_point(&case, point, result.position, [x, y, z]);
            if point == "img" {
                errors.add_point(&case, "tangent", result.direction, case.row.vector(["t_x", "t_y", "t_z"]));
            }
        }
    }
    errors
}

fn luneburg(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    for case in tracer.cases("grin_luneburg", &["id"], well_conditioned) {
        tracer.enter(&format!("kind = \"grin\"\nprofile = \"luneburg\"\nradius = {}", case.row.text("R")));
        let radius = case.row.number("R");
        let (start, direction) = (case.row.vector(["start_x", "start_y", "start_z"]), case.row.vector(["dx", "dy", "dz"]));
        let [enter, middle, focus] = [
            case.row.vector(["enter_x", "enter_y", "enter_z"]),
            case.row.vector(["mid_x", "mid_y", "mid_z"]),
            case.row.vector(["focus_x", "focus_y", "focus_z"]),
        ];
        let exit = case.row.vector(["exit_dx", "exit_dy", "exit_dz"]);
        let ray = [TraceRay::looking(start, direction)];
        let at_rim = tracer.stopped(&[&case], &ray, Stop::Length(distance(start, enter)))[0];
        errors.add_point(&case, "entry", at_rim.position, enter);
        errors.add_point(&case, "direction of entry", at_rim.direction, direction);
        // Half-way the ray crosses the plane through the center on which the way from entry to focus stands.
        let along_chord = unit(combine(1.0, focus, -1.0, enter));
        let half_way = tracer.stopped(&[&case], &ray, Stop::Plane(along_chord, 0.0))[0];
        errors.add_point(&case, "middle", half_way.position, middle);
        errors.add_point(&case, "direction in the middle", half_way.direction, along_chord);
        let at_focus = tracer.stopped(&[&case], &ray, Stop::Sphere(radius))[0];
        errors.add_point(&case, "focus", at_focus.position, focus);
        let beyond = tracer.trace(&ray, Stop::Never)[0];
        case.expect(&beyond, STATUS_ESCAPED);
        errors.add_point(&case, "direction of exit", beyond.direction, exit);
    }
    errors
}

fn flows(tracer: &mut Tracer) -> Errors {
    let mut errors = Errors::default();
    for cases in grouped(tracer.cases("flow_lorenz_roessler", &["system", "id"], cond_in("sens10")), &["system", "p1", "p2", "p3"]) {
        let lorenz = cases[0].row.text("system") == "lorenz";
        let (kind, names) = if lorenz { ("lorenz", ["sigma", "r", "b"]) } else { ("rossler", ["a", "b", "c"]) };
        let values = ["p1", "p2", "p3"].map(|c| cases[0].row.text(c));
        let keys: Vec<String> = names.iter().zip(values).map(|(name, value)| format!("{name} = {value}")).collect();
        tracer.enter(&format!("kind = \"{kind}\"\n{}", keys.join("\n")));
        let ray =
            |case: &Case| TraceRay::looking(case.row.vector(["x0_x", "x0_y", "x0_z"]), case.row.vector(["dir0_x", "dir0_y", "dir0_z"]));
        let rays: Vec<TraceRay> = cases.iter().map(ray).collect();
        let all: Vec<&Case> = cases.iter().collect();
        for (length, point) in [(1.0, "s1"), (5.0, "s5"), (10.0, "s10")] {
            for (case, result) in cases.iter().zip(tracer.stopped(&all, &rays, Stop::Length(length))) {
                let [x, y, z] = ["x", "y", "z"].map(|axis| case.row.number(&format!("{point}_{axis}")));
                errors.add_point(case, point, result.position, [x, y, z]);
            }
        }
    }
    errors
}
