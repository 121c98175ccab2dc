//! The disc of dust against its explicit solution, closed forms, and the field equations.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use nullray::spacetime::dust_disc::solve::{GAUSS, tabulate, tabulate_sized};
use nullray::spacetime::dust_disc::table::DustDisc;
use std::f64::consts::PI;
use std::sync::{Mutex, PoisonError};

static SOLVED: Mutex<Vec<DustDisc>> = Mutex::new(Vec::new());

/// The disc of one mu, solved once for all tests.
fn disc_of(mu: f64) -> DustDisc {
    let mut solved = SOLVED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = solved.iter().find(|disc| disc.mu == mu) {
        return known.clone();
    }
    let disc = tabulate(mu).unwrap();
    solved.push(disc.clone());
    disc
}

/// (mu, rho, zeta, Re f, Im f) of the Ernst potential from the hyperelliptic solution (Neugebauer & Meinel 1995).
const ORACLE: [(f64, f64, f64, f64, f64); 12] = [
    (0.1, 0.5, 0.5, 0.94958380, -0.00469526),
    (0.1, 1.3, 0.9, 0.97311003, -0.00097977),
    (0.1, 2.0, 0.5, 0.97878628, -0.00025812),
    (0.5, 0.5, 0.5, 0.75831393, -0.05205945),
    (0.5, 1.3, 0.9, 0.86204447, -0.01203564),
    (0.5, 2.0, 0.5, 0.88944090, -0.00325222),
    (1.0, 0.5, 0.5, 0.54434432, -0.14446681),
    (1.0, 1.3, 0.9, 0.71520897, -0.03836031),
    (1.0, 2.0, 0.5, 0.76634805, -0.01075798),
    (2.0, 0.5, 0.5, 0.20549127, -0.38271156),
    (2.0, 1.3, 0.9, 0.39584344, -0.13833390),
    (2.0, 2.0, 0.5, 0.47151286, -0.04281533),
];

/// e^{2U}, G = e^{2U} A = rho^2 e^{-2 nu} omega, and the gradients of both: regular in the ergoregion too.
fn killing_norms(disc: &DustDisc, rho: f64, zeta: f64) -> ([f64; 2], [[f64; 2]; 2]) {
    let ([nu, omega, _], gradient) = disc.evaluate_with_gradient(rho, zeta);
    let inertia = rho * rho * (-2.0 * nu).exp();
    let (mut by_f, mut by_g) = ([0.0; 2], [0.0; 2]);
    for axis in 0..2 {
        let inertia_d = inertia * (if axis == 0 { 2.0 / rho } else { 0.0 } - 2.0 * gradient[0][axis]);
        by_g[axis] = inertia_d * omega + inertia * gradient[1][axis];
        by_f[axis] = 2.0 * gradient[0][axis] * (2.0 * nu).exp() - by_g[axis] * omega - inertia * omega * gradient[1][axis];
    }
    ([(2.0 * nu).exp() - inertia * omega * omega, inertia * omega], [by_f, by_g])
}

/// grad b = e^{4U} / rho (-A_zeta, A_rho), with e^{4U} grad A = f grad G - G grad f.
fn twist_gradient(disc: &DustDisc, rho: f64, zeta: f64) -> [f64; 2] {
    let ([f, g], [f_d, g_d]) = killing_norms(disc, rho, zeta);
    [-(f * g_d[1] - g * f_d[1]) / rho, (f * g_d[0] - g * f_d[0]) / rho]
}

/// b by integration from infinity at constant zeta.
fn twist(disc: &DustDisc, rho: f64, zeta: f64) -> f64 {
    let cells = 200;
    let mut sum = 0.0;
    for cell in 0..cells {
        for (x, weight) in GAUSS {
            let p = (cell as f64 + 0.5 * (1.0 + x)) / cells as f64;
            let jacobian = 1.0 / ((1.0 - p) * (1.0 - p));
            sum -= 0.5 * weight / cells as f64 * jacobian * twist_gradient(disc, rho + p / (1.0 - p), zeta)[0];
        }
    }
    sum
}

fn largest_oracle_error(disc: &DustDisc) -> f64 {
    ORACLE.iter().filter(|row| row.0 == disc.mu).fold(0.0, |largest: f64, &(_, rho, zeta, real, imaginary)| {
        let e2u = killing_norms(disc, rho, zeta).0[0];
        largest.max((e2u - real).abs()).max((twist(disc, rho, zeta) - imaginary).abs())
    })
}

/// Weierstrass p function for real invariants: Laurent series of z / 32, then five duplications.
fn weierstrass_p(z: f64, g2: f64, g3: f64) -> f64 {
    let small = z / 32.0;
    let mut c = [0.0; 12];
    (c[2], c[3]) = (g2 / 20.0, g3 / 28.0);
    for k in 4..12 {
        c[k] = 3.0 / ((2 * k + 1) as f64 * (k - 3) as f64) * (2..k - 1).map(|m| c[m] * c[k - m]).sum::<f64>();
    }
    let mut p = 1.0 / (small * small) + (2..12).map(|k| c[k] * small.powi(2 * k as i32 - 2)).sum::<f64>();
    for _ in 0..5 {
        let slope2 = 4.0 * p * p * p - g2 * p - g3;
        p = -2.0 * p + (6.0 * p * p - 0.5 * g2).powi(2) / (4.0 * slope2);
    }
    p
}

/// V0(mu) of Neugebauer & Meinel, Astrophys. J. 414 (1993) L97.
fn exact_surface_potential(mu: f64) -> f64 {
    // I = (1/pi) int_0^mu ln(x + sqrt(1 + x^2)) dx / sqrt((1 + x^2) (mu - x)), with x = mu - t^2.
    let (cells, top) = (40, mu.sqrt());
    let mut integral = 0.0;
    for cell in 0..cells {
        for (x, weight) in GAUSS {
            let t = (cell as f64 + 0.5 * (1.0 + x)) / cells as f64 * top;
            let x = mu - t * t;
            integral += weight * top / cells as f64 * x.asinh() / (1.0 + x * x).sqrt() / PI;
        }
    }
    let p = weierstrass_p(integral, 4.0 / 3.0 * mu * mu - 4.0, 8.0 / 3.0 * mu * (1.0 + mu * mu / 9.0));
    -0.5 * (mu + (1.0 + mu * mu) / (p - 2.0 / 3.0 * mu)).asinh()
}

#[test]
fn ernst_potential_is_that_of_the_explicit_solution() {
    for mu in [0.1, 0.5, 1.0, 2.0] {
        let error = largest_oracle_error(&disc_of(mu));
        println!("mu {mu}: oracle error {error:.1e}");
        assert!(error < 1e-6, "mu {mu}: {error:e}");
    }
}

#[test]
fn oracle_rejects_a_disc_that_drags_one_percent_more() {
    let mut disc = disc_of(1.0);
    disc.values.iter_mut().for_each(|value| value[1] *= 1.01);
    assert!(largest_oracle_error(&disc) > 1e-5);
}

#[test]
fn surface_potential_is_the_closed_form() {
    for mu in [0.01, 0.1, 0.5, 1.0, 1.7, 2.0, 3.0] {
        let disc = disc_of(mu);
        let error = (disc.v0 - exact_surface_potential(mu)).abs();
        println!("mu {mu}: V0 {:.9} error {error:.1e}", disc.v0);
        assert!(error < 1e-8, "mu {mu}: {error:e}");
        assert!((2.0 * disc.omega.powi(2) * (-2.0 * disc.v0).exp() - mu).abs() < 1e-12);
    }
}

#[test]
fn dust_has_one_redshift() {
    for mu in [0.1, 0.5, 1.0, 2.0, 3.0] {
        let disc = disc_of(mu);
        let surface = (2.0 * disc.v0).exp();
        let (mut worst, mut worst_literal) = (0.0_f64, 0.0_f64);
        for step in 0..=1000 {
            let rho = step as f64 / 1000.0;
            let [nu, omega, _] = disc.evaluate(rho, 0.0);
            let norm = (2.0 * nu).exp() - (rho * (disc.omega - omega)).powi(2) * (-2.0 * nu).exp();
            worst = worst.max((norm / surface - 1.0).abs());
            if let Some([u, a, _]) = disc.papapetrou(rho, 0.0) {
                let literal = (2.0 * u).exp() * (1.0 + disc.omega * a).powi(2) - (disc.omega * rho).powi(2) * (-2.0 * u).exp();
                worst_literal = worst_literal.max((literal / surface - 1.0).abs());
            }
        }
        println!("mu {mu}: relative error of e^(2 V0) on the disc {worst:.1e} (by U and A {worst_literal:.1e})");
        assert!(worst < 1e-5 && worst_literal < 1e-4, "mu {mu}: {worst:e} {worst_literal:e}");
    }
}

#[test]
fn small_mu_is_the_maclaurin_disc() {
    let disc = disc_of(0.01);
    let newtonian = 4.0 * disc.omega.powi(2) / (3.0 * PI);
    assert!((disc.mass / newtonian - 1.0).abs() < 0.015);
    // J = (2/5) M Omega rho0^2 for a surface density ~ sqrt(1 - rho^2).
    assert!((disc.angular_momentum / (0.4 * disc.mass * disc.omega) - 1.0).abs() < 0.015);
}

#[test]
fn first_law_holds_between_neighbouring_discs() {
    // M = 2 Omega J + e^{V0} M0 and dM = Omega dJ + e^{V0} dM0, M0 the rest mass.
    for mu in [1.0, 2.0] {
        let [below, above] = [mu - 0.02, mu + 0.02].map(disc_of);
        let middle = disc_of(mu);
        let rest = |disc: &DustDisc| (disc.mass - 2.0 * disc.omega * disc.angular_momentum) * (-disc.v0).exp();
        let change = above.mass - below.mass;
        let work = middle.omega * (above.angular_momentum - below.angular_momentum) + middle.v0.exp() * (rest(&above) - rest(&below));
        println!("mu {mu}: first law {:.1e}", work / change - 1.0);
        assert!((work / change - 1.0).abs() < 1e-3);
    }
}

#[test]
fn vacuum_holds_off_the_disc() {
    for mu in [0.1, 0.5, 1.0, 2.0, 3.0] {
        let disc = disc_of(mu);
        let h = 0.004;
        let mut worst = 0.0_f64;
        for (rho, zeta) in [(0.5, 0.5), (0.3, 0.1), (0.9, 0.2), (1.3, 0.9), (2.0, 0.5), (1.4, 0.1), (0.2, 3.0), (6.0, 5.0)] {
            // Real part of the Ernst equation: f laplacian f = |grad f|^2 - |grad b|^2.
            let f = |r: f64, z: f64| killing_norms(&disc, r, z).0[0];
            let centre = f(rho, zeta);
            let [east, west, north, south] = [f(rho + h, zeta), f(rho - h, zeta), f(rho, zeta + h), f(rho, zeta - h)];
            let laplacian = (east + west + north + south - 4.0 * centre) / (h * h) + (east - west) / (2.0 * h * rho);
            let (_, [f_d, _]) = killing_norms(&disc, rho, zeta);
            let b_d = twist_gradient(&disc, rho, zeta);
            let squares = f_d[0].powi(2) + f_d[1].powi(2) + b_d[0].powi(2) + b_d[1].powi(2);
            let right = f_d[0].powi(2) + f_d[1].powi(2) - b_d[0].powi(2) - b_d[1].powi(2);
            let curvature = centre.abs() * ((east + west - 2.0 * centre).abs() + (north + south - 2.0 * centre).abs()) / (h * h);
            worst = worst.max((centre * laplacian - right).abs() / (squares + curvature));
        }
        println!("mu {mu}: relative Ernst residual {worst:.1e}");
        assert!(worst < 1e-3, "mu {mu}: {worst:e}");
    }
}

#[test]
fn conformal_factor_has_the_gradient_of_the_ernst_potential() {
    for mu in [0.1, 1.0, 2.0, 3.0] {
        let disc = disc_of(mu);
        let mut worst = 0.0_f64;
        for (rho, zeta) in [(0.5, 0.5), (0.3, 0.02), (0.97, 0.02), (1.03, 0.02), (1.3, 0.9), (2.0, 0.5), (1.4, 0.0), (0.2, 3.0), (6.0, 5.0)]
        {
            let ([f, _], [f_d, _]) = killing_norms(&disc, rho, zeta);
            let b_d = twist_gradient(&disc, rho, zeta);
            let scale = rho / (4.0 * f * f);
            let k_rho = scale * (f_d[0].powi(2) - f_d[1].powi(2) + b_d[0].powi(2) - b_d[1].powi(2));
            let k_zeta = 2.0 * scale * (f_d[0] * f_d[1] + b_d[0] * b_d[1]);
            let gradient = disc.evaluate_with_gradient(rho, zeta).1;
            for (axis, k_d) in [k_rho, k_zeta].into_iter().enumerate() {
                let measured = gradient[2][axis] + 0.5 * f_d[axis] / f;
                worst = worst.max((measured - k_d).abs() / (1e-3 + k_rho.hypot(k_zeta)));
            }
        }
        println!("mu {mu}: gradient of k {worst:.1e}");
        assert!(worst < 2e-4, "mu {mu}: {worst:e}");
    }
}

#[test]
fn gradients_are_those_of_the_values() {
    let disc = disc_of(2.0);
    let h = 1e-5;
    for (rho, zeta) in [(0.5, 0.5), (0.3, -0.1), (0.999, 0.01), (1.3, 0.9), (2.0, -0.5), (1.4, 0.0), (0.001, 2.0), (40.0, 20.0), (0.4, 0.0)]
    {
        let gradient = disc.evaluate_with_gradient(rho, zeta).1;
        let side = if zeta == 0.0 && rho < 1.0 { 0.0 } else { 1.0 };
        let along_rho = [disc.evaluate(rho - h, zeta), disc.evaluate(rho + h, zeta)];
        let along_zeta = [disc.evaluate(rho, zeta - side * h), disc.evaluate(rho, zeta + h)];
        for k in 0..3 {
            let errors = [
                (along_rho[1][k] - along_rho[0][k]) / (2.0 * h) - gradient[k][0],
                (along_zeta[1][k] - along_zeta[0][k]) / ((1.0 + side) * h) - gradient[k][1],
            ];
            assert!(errors.iter().all(|error| error.abs() < 2e-5), "({rho}, {zeta}) function {k}: {errors:?}");
        }
    }
}

#[test]
fn far_field_and_axis_are_exact() {
    let disc = disc_of(1.0);
    let (rho, zeta) = (3e4, 4e4);
    let r = 5e4;
    let [nu, omega, alpha] = disc.evaluate(rho, zeta);
    assert!((nu * r / -disc.mass - 1.0).abs() < 1e-6);
    assert!((omega * r * r * r / (2.0 * disc.angular_momentum) - 1.0).abs() < 1e-3);
    assert!((alpha + nu).abs() < 1e-9);
    for zeta in [0.0, 0.3, 2.0, 100.0] {
        let [nu, _, alpha] = disc.evaluate(0.0, zeta);
        assert_eq!(alpha, -nu);
    }
    assert!(disc.evaluate(1.0, 0.0).iter().all(|value| value.is_finite()));
    assert!(disc.evaluate_with_gradient(1.0, 0.0).1.iter().flatten().all(|value| value.is_finite()));
}

#[test]
fn spline_is_as_good_as_a_larger_one() {
    for mu in [1.0, 3.0] {
        let disc = disc_of(mu);
        let larger = tabulate_sized(mu, [240, 120]).unwrap();
        let (mut worst, mut scale) = ([0.0_f64; 6], [0.0_f64; 3]);
        for p in 0..20_000 {
            let (s, eta) = (((p as f64) * 0.618_033_988_75).fract(), ((p as f64) * 0.754_877_666_2).fract());
            let (value, by_s, by_eta) = disc.spline(s, eta);
            let (exact, exact_by_s, exact_by_eta) = larger.spline(s, eta);
            for k in 0..3 {
                worst[k] = worst[k].max((value[k] - exact[k]).abs());
                worst[3 + k] = worst[3 + k].max((by_s[k] - exact_by_s[k]).abs()).max((by_eta[k] - exact_by_eta[k]).abs());
                scale[k] = scale[k].max(exact[k].abs());
            }
        }
        let relative: Vec<String> = (0..6).map(|k| format!("{:.1e}", worst[k] / scale[k % 3])).collect();
        println!("mu {mu}: spline error of n, w, q and of their slopes, relative to the largest value: {relative:?}");
        assert!((0..3).all(|k| worst[k] < 2e-6 * scale[k]), "mu {mu}: {relative:?}");
    }
}

#[test]
fn ergoregion_appears_at_mu_1_69() {
    let reaches_zero = |mu: f64| {
        let disc = disc_of(mu);
        (1..2000).any(|p| disc.papapetrou(p as f64 * 1e-3, 0.0).is_none())
    };
    assert!(!reaches_zero(1.68) && reaches_zero(1.70));
}

#[test]
fn what_is_out_of_range_is_an_error() {
    for mu in [0.0, -1.0, f64::NAN, 3.1, f64::INFINITY] {
        assert!(tabulate(mu).is_err());
    }
    for size in [[7, 48], [96, 7], [0, 0]] {
        assert!(tabulate_sized(1.0, size).is_err());
    }
    assert!(tabulate_sized(1.0, [8, 8]).is_ok());
}
