//! Every bending model and every integrator on the CPU backend: the reference tables, orders of convergence, conserved energies,
//! generated derivatives, and pairs of charts that must agree.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::cpu::CpuBackend;
use nullray::backend::{Backend, Launch, Precision, Stop, TraceOptions, TraceRay, TraceResult};
use nullray::kernels::constants::{STATUS_CAPTURED, STATUS_ESCAPED, STATUS_STOPPED};
use nullray::kernels::integrator::PointFunctions;
use nullray::spacetime::{Class, ModelKind};
use std::sync::Arc;
use support::tables::{TABLES, Table, kerr_photon};
use support::{distance, world};

macro_rules! table_tests {
    ($($table:ident),+ $(,)?) => {
        $(mod $table {
            use super::*;

            #[test]
            fn in_f64() {
                Table::named(stringify!($table)).check(&mut CpuBackend::new(None).unwrap(), Precision::F64);
            }

            #[test]
            fn in_f32() {
                Table::named(stringify!($table)).check(&mut CpuBackend::new(None).unwrap(), Precision::F32);
            }
        })+

        #[test]
        fn every_table_is_tested() {
            let tested = [$(stringify!($table)),+];
            assert!(TABLES.iter().all(|t| tested.contains(&t.name)) && TABLES.len() == tested.len());
        }
    };
}

table_tests!(
    schw_rays,
    schw_deflection,
    redshift_pairs,
    luminet_disc,
    kerr_rays,
    kerr_shadow,
    kerr_photon_orbits,
    alcubierre_rays,
    ellis_rays,
    grin_fisheye,
    grin_luneburg,
    flow_lorenz_roessler,
);

/// Traces rays through a scene of `[spacetime]` and `[integrator]` keys.
fn trace(spacetime: &str, integrator: &str, precision: Precision, rays: &[TraceRay], tolerance: f64, stop: Stop) -> Vec<TraceResult> {
    let world = world(&format!("[spacetime]\n{spacetime}\n[integrator]\nmax_steps = 1000000\n{integrator}\n"));
    let mut backend = CpuBackend::new(None).unwrap();
    backend.upload(Arc::new(world), precision, 0).unwrap();
    backend.trace(rays, TraceOptions { tolerance, stop, max_steps: None }).unwrap()
}

/// Slope of the straight line through the logarithms of points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (mx, my) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let (xy, xx) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - mx) * (y - my), b + (x - mx).powi(2)));
    xy / xx
}

/// End of a ray along +x past a hole of mass 1, and the steps it took.
fn passing(start: [f64; 3], integrator: &str, tolerance: f64, stop: Stop) -> ([f64; 3], f64) {
    let ray = [TraceRay::looking(start, [1.0, 0.0, 0.0])];
    let result = trace("kind = \"schwarzschild\"", integrator, Precision::F64, &ray, tolerance, stop)[0];
    assert_eq!(result.status, STATUS_STOPPED, "{integrator}");
    (result.position, f64::from(result.steps))
}

#[test]
fn methods_of_fixed_steps_have_their_order() {
    let start = [-8.0, 6.5, 1.0];
    // The thesis' recurrence counts its steps by length, all others by the affine parameter.
    let stops = [Stop::Parameter(16.0), Stop::Length(16.0)];
    let exact = stops.map(|stop| passing(start, "method = \"nystrom\"", 1e-13, stop).0);
    for (method, order, by_length) in [("euler", 1.0, 1), ("symplectic", 1.0, 0), ("leapfrog", 2.0, 0), ("rk4", 4.0, 0)] {
        let steps = [0.5, 0.25, 0.125, 0.0625, 0.03125];
        let errors = steps.map(|step| {
            let end = passing(start, &format!("method = \"{method}\"\nstep = {step}"), 1.0, stops[by_length]).0;
            (step, distance(end, exact[by_length]))
        });
        let found = slope(&errors[1..]);
        println!("{method}: order {found:.3}, errors {errors:?}");
        assert!((found - order).abs() < 0.2, "{method}: order {found}, expected {order}; {errors:?}");
    }
}

#[test]
fn methods_of_chosen_steps_have_their_order() {
    // Near the photon sphere, so that there are enough steps for their number to follow the tolerance.
    let (start, stop) = ([-20.0, 5.8, 1.0], Stop::Parameter(40.0));
    let exact = passing(start, "method = \"dormand-prince\"", 1e-14, stop).0;
    for (method, order, tolerance) in [("bogacki-shampine", 3.0, 1e-6), ("nystrom", 4.0, 1e-7), ("dormand-prince", 5.0, 1e-9)] {
        let errors = [1.0, 0.1, 0.01, 0.001].map(|share| {
            let (end, steps) = passing(start, &format!("method = \"{method}\""), share * tolerance, stop);
            (1.0 / steps, distance(end, exact))
        });
        let found = slope(&errors);
        println!("{method}: order {found:.3}, errors {errors:?}");
        assert!((found - order).abs() < 0.25, "{method}: order {found}, expected {order}; {errors:?}");
    }
}

/// Euler's methods serve metrics too, whose force depends on the momentum.
#[test]
fn methods_of_fixed_steps_have_their_order_in_a_metric() {
    let (origin, p) = kerr_photon([0.7, 0.0], [12.0, 1.2], 3.0, 4.0, false);
    let ray = [TraceRay { origin, launch: Launch::Momentum(p), past: false, side: 1 }];
    let end = |integrator: &str, tolerance: f64| {
        let spacetime = "kind = \"kerr\"\nspin = 0.7\naxis = [0, 0, 1]";
        let result = trace(spacetime, integrator, Precision::F64, &ray, tolerance, Stop::Parameter(16.0))[0];
        assert_eq!(result.status, STATUS_STOPPED, "{integrator}");
        result.position
    };
    let exact = end("method = \"dormand-prince\"", 1e-13);
    for (method, order) in [("euler", 1.0), ("symplectic", 1.0), ("rk4", 4.0)] {
        let errors = [0.125, 0.0625, 0.03125, 0.015625]
            .map(|step| (step, distance(end(&format!("method = \"{method}\"\nstep = {step}"), 1.0), exact)));
        let found = slope(&errors);
        println!("{method}: order {found:.3}, errors {errors:?}");
        assert!((found - order).abs() < 0.2, "{method}: order {found}, expected {order}; {errors:?}");
    }
}

/// One scene of every kind, its model away from the origin.
const SCENES: &[(&str, ModelKind)] = &[
    ("kind = \"schwarzschild\"\nmass = 0.8", ModelKind::Schwarzschild),
    ("kind = \"reissner-nordstrom\"\nmass = 0.8\ncharge = 0.6", ModelKind::ReissnerNordstrom),
    ("kind = \"kerr\"\nmass = 0.9\nspin = 0.8\naxis = [1, 2, 3]", ModelKind::KerrNewman),
    ("kind = \"kerr-newman\"\nmass = 0.9\nspin = -0.5\ncharge = 0.6\naxis = [1, -2, 1]", ModelKind::KerrNewman),
    (
        "kind = \"majumdar-papapetrou\"\n[[spacetime.mass]]\nposition = [1, 0, 0]\nmass = 0.6\n[[spacetime.mass]]\nposition = [-1, 0.5, 0]\nmass = 0.4",
        ModelKind::MajumdarPapapetrou,
    ),
    (
        "kind = \"weak-lens\"\n[[spacetime.mass]]\nposition = [1, 0, 0]\nmass = 0.06\n[[spacetime.mass]]\nposition = [-1, 0.5, 0]\nmass = 0.04",
        ModelKind::WeakLens,
    ),
    ("kind = \"alcubierre\"\nspeed = 1.5\nradius = 2\nsigma = 1.5\naxis = [2, 1, 0]", ModelKind::Alcubierre),
    ("kind = \"dust-disc\"\nmu = 1.5\naxis = [0, 1, 0.5]", ModelKind::DustDisc),
    ("kind = \"ellis\"\nthroat = 1.5", ModelKind::Ellis),
    ("kind = \"dneg\"\nthroat_radius = 1\nthroat_length = 1\nlensing_width = 0.7", ModelKind::Dneg),
    ("kind = \"grin\"\nprofile = \"fisheye\"\nn0 = 1.8\nradius = 2", ModelKind::Fisheye),
    ("kind = \"grin\"\nprofile = \"luneburg\"\nradius = 4", ModelKind::Luneburg),
    ("kind = \"grin\"\nprofile = \"radial\"\nradius = 5\ncoefficients = [1.5, -0.02, 0.001, -0.00003, 0.000001]", ModelKind::Radial),
    ("kind = \"grin\"\nprofile = \"layered\"\nnormal = [0, 1, 1]\nheights = [-4, 0, 4]\nindices = [1.3, 1.1, 1.2]", ModelKind::Layered),
    ("kind = \"gravity\"\n[[spacetime.center]]\nposition = [0.5, 0, 0]\nstrength = 0.1\nradius = 7", ModelKind::ThesisGravity),
    (
        "kind = \"gravity\"\nlaw = \"power\"\nexponent = 1.5\n[[spacetime.center]]\nposition = [0.5, 0, 0]\nstrength = 0.1",
        ModelKind::PowerGravity,
    ),
];

/// Where the models of `SCENES` are.
const PLACE: [f64; 3] = [0.3, -0.2, 0.1];

/// Central difference along one axis of a function of a point.
fn slope_along(f: impl Fn([f64; 3]) -> f64, at: [f64; 3], axis: usize) -> f64 {
    let step = 1e-4;
    let value = |shift: f64| {
        let mut point = at;
        point[axis] += shift * step;
        f(point)
    };
    // Of fourth order: 8 (f(1) - f(-1)) - (f(2) - f(-2)) over 12 steps.
    (8.0 * (value(1.0) - value(-1.0)) - (value(2.0) - value(-2.0))) / (12.0 * step)
}

#[test]
fn generated_rates_are_derivatives_of_the_hamiltonian() {
    let points = [[3.0, 1.0, -1.5], [-1.2, 2.4, 0.9], [0.4, -1.9, 2.2]];
    let momenta = [[0.7, -0.4, 0.5], [-0.9, 0.2, 0.3]];
    let mut covered = vec![ModelKind::Flat, ModelKind::Lorenz, ModelKind::Rossler, ModelKind::Parametric];
    for (spacetime, kind) in SCENES {
        let keys = spacetime.replacen('\n', &format!("\nposition = {PLACE:?}\n"), 1);
        let world = world(&format!("[spacetime]\n{keys}\n[integrator]\nmax_steps = 1000000\n"));
        assert_eq!(world.model, *kind);
        covered.push(*kind);
        let block = world.model_block::<f64>();
        let functions = PointFunctions::<f64>::of(*kind);
        for (x, q, sense) in points.iter().flat_map(|x| momenta.iter().flat_map(move |q| [-1.0, 1.0].map(|s| (*x, *q, s)))) {
            // A medium's ray has the Hamiltonian (p^2 - n^2) / 2, at an energy that only gravity reads; |p| / n - 1 is what it observes.
            // A metric's has the energy of a photon, which is linear in the length of its momentum.
            let energy = 1.7;
            let hamiltonian = |x: [f64; 3], q: [f64; 3]| {
                let (direction, frequency, constraint) = (functions.observe)((), &block, x, q, energy, sense, 0.0);
                let squared: f64 = q.iter().map(|c| c * c).sum();
                match kind.class() {
                    Class::Medium => 0.5 * squared * (1.0 - (1.0 + constraint).powi(-2)),
                    _ => frequency * (functions.launch)((), &block, x, direction, 1.0, sense).1,
                }
            };
            let (velocity, force) = (functions.rate)((), &block, x, q, energy, sense, 0.0);
            for axis in 0..3 {
                let by_momentum = slope_along(|q| hamiltonian(x, q), q, axis);
                let by_position = slope_along(|x| hamiltonian(x, q), x, axis);
                for (what, found, expected) in [("velocity", velocity[axis], by_momentum), ("force", force[axis], -by_position)] {
                    let error = (found - expected).abs() / (1.0 + expected.abs());
                    assert!(error < 1e-8, "{kind:?} at {x:?}, {q:?}, sense {sense}: {what} {axis} is {found}, expected {expected}");
                }
            }
        }
    }
    assert!(ModelKind::ALL.iter().all(|k| covered.contains(k)), "{covered:?}");
}

/// A fan of rays from a place outside every model of `SCENES`.
fn fan() -> Vec<TraceRay> {
    let eye = [1.0, 2.0, -9.0];
    let across = (0..40).map(|i| -1.0 + f64::from(i) / 19.5);
    across.flat_map(|x| [-0.3, 0.07].map(|y| TraceRay::looking(eye, [x, y - 0.1, 1.0]))).collect()
}

#[test]
fn hamiltonian_is_conserved() {
    // (precision, tolerance, largest relative drift, the same for the dust disc, whose table has a bend)
    for (precision, tolerance, smooth, bent) in [(Precision::F64, 1e-12, 1e-9, 1e-4), (Precision::F32, 1e-5, 1e-3, 5e-2)] {
        for (spacetime, kind) in SCENES {
            let results = trace(spacetime, "", precision, &fan(), tolerance, Stop::Length(18.0));
            let drifts: Vec<f64> = results.iter().filter(|r| r.status == STATUS_STOPPED).map(|r| r.constraint_error).collect();
            let worst = drifts.iter().fold(0.0, |a: f64, b| if b.is_nan() { f64::INFINITY } else { a.max(*b) });
            let bound = if *kind == ModelKind::DustDisc { bent } else { smooth };
            println!("{kind:?} {precision:?}: drift {worst:.1e} of {} rays", drifts.len());
            assert!(drifts.len() >= 40, "{kind:?}: {} rays stopped", drifts.len());
            assert!(worst < bound, "{kind:?} {precision:?}: {worst:e}");
        }
    }
}

/// The drift is a measure of the error: coarse steps must show in it.
#[test]
fn coarse_steps_drift() {
    for (spacetime, integrator) in [(SCENES[0].0, "method = \"leapfrog\"\nstep = 2.0"), (SCENES[2].0, "method = \"euler\"\nstep = 1.0")] {
        let results = trace(spacetime, integrator, Precision::F64, &fan(), 1.0, Stop::Length(18.0));
        let drift = results.iter().map(|r| r.constraint_error).fold(0.0, f64::max);
        println!("{integrator}: drift {drift:.1e}");
        assert!(drift > 1e-4, "{integrator}: {drift:e}");
    }
}

/// A charged hole in its isotropic chart and in Kerr-Schild's: one orbit of given impact parameter, two systems of equations.
#[test]
fn charts_of_a_charged_hole_agree() {
    let (charge, r) = (0.8f64, 40.0f64);
    // rho with r = rho ((1 + 1 / 2 rho)^2 - (Q / 2 rho)^2).
    let rho = 0.5 * (r - 1.0 + ((r - 1.0).powi(2) - (1.0 - charge * charge)).sqrt());
    let lapse = (1.0 - 2.0 / r + (charge / r).powi(2)).sqrt();
    let mut outcomes = [0, 0];
    for b in [2.0, 4.0, 4.4, 4.7, 5.0, 6.0, 9.0, 20.0] {
        let sin: f64 = b * lapse / r;
        let isotropic = [TraceRay { past: false, ..TraceRay::looking([rho, 0.0, 0.0], [-(1.0 - sin * sin).sqrt(), sin, 0.0]) }];
        let (origin, p) = kerr_photon([0.0, charge], [r, std::f64::consts::FRAC_PI_2], b, 0.0, false);
        let kerr_schild = [TraceRay { origin, launch: Launch::Momentum(p), past: false, side: 1 }];
        let spacetimes = [
            format!("kind = \"reissner-nordstrom\"\ncharge = {charge}"),
            format!("kind = \"kerr-newman\"\ncharge = {charge}\naxis = [0, 0, 1]"),
        ];
        let [one, other] = [(&spacetimes[0], isotropic), (&spacetimes[1], kerr_schild)]
            .map(|(spacetime, ray)| trace(spacetime, "", Precision::F64, &ray, 1e-12, Stop::Never)[0]);
        assert_eq!(one.status, other.status, "b = {b}");
        outcomes[usize::from(one.status == STATUS_CAPTURED)] += 1;
        if one.status == STATUS_ESCAPED {
            let difference = distance(one.direction, other.direction);
            println!("b = {b}: directions differ by {difference:.1e}");
            assert!(difference < 1e-8, "b = {b}: {:?} {:?}", one.direction, other.direction);
        }
    }
    assert!(outcomes.iter().all(|n| *n > 1), "{outcomes:?}");
}

/// Parametric rays have their paths in closed form, in the frame of their own direction.
#[test]
fn parametric_rays_are_their_curves() {
    let (amplitude, frequency, s) = (0.3f64, 1.7f64, 4.0f64);
    let phase = frequency * s;
    // Offsets along the frame's two normals.
    let curves = [
        ("parabola", [amplitude * s * s, 0.0]),
        ("sine", [amplitude * phase.sin(), 0.0]),
        ("helix", [amplitude * (phase.cos() - 1.0), amplitude * phase.sin()]),
    ];
    let (origin, d) = ([1.0, -2.0, 0.5], [0.6, 0.0, 0.8]);
    let (n1, n2) = ([0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]);
    for (curve, [a, b]) in curves {
        let keys = if curve == "parabola" { String::new() } else { format!("\nfrequency = {frequency}") };
        let spacetime = format!("kind = \"parametric\"\ncurve = \"{curve}\"\namplitude = {amplitude}{keys}");
        for (precision, tolerance, bound) in [(Precision::F64, 1e-12, 1e-10), (Precision::F32, 1e-5, 1e-4)] {
            let ray = [TraceRay::looking(origin, d)];
            let result = trace(&spacetime, "", precision, &ray, tolerance, Stop::Parameter(s))[0];
            assert_eq!(result.status, STATUS_STOPPED, "{curve}");
            let expected = [0, 1, 2].map(|i| origin[i] + s * d[i] + a * n1[i] + b * n2[i]);
            let error = distance(result.position, expected);
            println!("{curve} {precision:?}: {error:.1e}");
            assert!(error < bound, "{curve} {precision:?}: {:?}, expected {expected:?}", result.position);
        }
    }
}
