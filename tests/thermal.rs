//! Thin discs and black bodies against the literature, the integrals they are a closed form of, and brute force.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use nullray::spacetime::thermal::{black_body, black_body_xyz, disc_flux, disc_temperatures, isco, keplerian, max_flux_over_radius};

/// Largest |a / M| that the flux is evaluated for.
const MAX_FLUX_SPIN: f64 = 1.0 - 1e-9;

fn luminance(c: [f64; 3]) -> f64 {
    0.212_672_9 * c[0] + 0.715_152_2 * c[1] + 0.072_175_0 * c[2]
}

fn relative(value: f64, expected: f64) -> f64 {
    (value / expected - 1.0).abs()
}

/// Energy and angular momentum of a circular orbit, M = 1 (Bardeen, Press & Teukolsky 1972, eqs. 2.12 and 2.13).
fn orbit(r: f64, a: f64) -> (f64, f64) {
    let root = (r.powf(1.5) - 3.0 * r.sqrt() + 2.0 * a).sqrt() * r.powf(0.75);
    ((r.powf(1.5) - 2.0 * r.sqrt() + a) / root, (r * r - 2.0 * a * r.sqrt() + a * a) / root)
}

/// f as the integral that defines it, `-Omega' (E - Omega L)^-2 int (E - Omega L) dL`, by the midpoint rule.
fn flux_by_integration(r: f64, a: f64) -> f64 {
    let (start, steps) = (isco(1.0, a), 20_000);
    let radius = |i: usize| start + (r - start) * i as f64 / steps as f64;
    let gap = |r: f64| orbit(r, a).0 - keplerian(r, 1.0, a) * orbit(r, a).1;
    let slice = |i: usize| gap(0.5 * (radius(i) + radius(i + 1))) * (orbit(radius(i + 1), a).1 - orbit(radius(i), a).1);
    let integral: f64 = (0..steps).map(slice).sum();
    let slope = -1.5 * r.sqrt() * keplerian(r, 1.0, a).powi(2);
    -slope * integral / gap(r).powi(2)
}

fn uniform(inner: f64, outer: f64, n: usize) -> Vec<f64> {
    (0..n).map(|i| inner + (outer - inner) * i as f64 / (n.max(2) - 1) as f64).collect()
}

#[test]
fn innermost_orbits() {
    for (a, expected) in [(0.9, 2.320883), (0.5, 4.233_002_5), (0.0, 6.0), (-0.0, 6.0), (-1.0, 9.0), (1.0, 1.0)] {
        assert!((isco(1.0, a) - expected).abs() < 5e-7, "{a}: {}", isco(1.0, a));
        assert!((isco(3.0, 3.0 * a) - 3.0 * isco(1.0, a)).abs() < 1e-12);
    }
    assert_eq!(isco(0.0, 0.5), 0.0);
}

#[test]
fn orbital_frequency() {
    assert!(relative(keplerian(4.0, 1.0, 0.5), 1.0 / 8.5) < 1e-15);
    assert!(relative(keplerian(8.0, 2.0, 1.0), 1.0 / 17.0) < 1e-15);
}

#[test]
fn flux_of_the_literature() {
    assert!(relative(disc_flux(5.0, 1.0, 0.9), 0.014_032_606_26) < 1e-9);
    assert!(relative(disc_flux(12.0, 1.0, 0.5), 0.002_925_946_941) < 1e-9);
    assert!(relative(disc_flux(10.0, 2.0, 1.8), 0.5 * 0.014_032_606_26) < 1e-9);
}

#[test]
fn flux_against_its_integral() {
    for a in [-1.0, -0.5, -1e-9, 0.0, 1e-9, 0.3, 0.9, 0.998, 1.0] {
        for r in [isco(1.0, a) + 0.02, isco(1.0, a) + 1.0, 15.0, 60.0] {
            let error = relative(disc_flux(r, 1.0, a), flux_by_integration(r, a.min(MAX_FLUX_SPIN)));
            assert!(error < 3e-6, "a {a} r {r}: {error:e}");
        }
    }
}

#[test]
fn flux_is_zero_where_there_is_none() {
    for (r, m, a) in [(5.9, 1.0, 0.0), (2.3, 1.0, 0.9), (0.0, 1.0, 1.0), (8.9, 1.0, -1.0), (5.0, 0.0, 0.0), (f64::NAN, 1.0, 0.0)] {
        assert_eq!(disc_flux(r, m, a), 0.0);
    }
    assert!(disc_flux(f64::INFINITY, 1.0, 0.5) == 0.0 && disc_flux(1e9, 1.0, 0.5) > 0.0);
}

#[test]
fn hottest_ring() {
    // Without spin the flux has its top at 9.55 M (Page & Thorne 1974).
    let temperatures = disc_temperatures(1.0, 0.0, &uniform(5.0, 15.0, 10_001));
    let hottest = (0..temperatures.len()).max_by(|&i, &j| temperatures[i].total_cmp(&temperatures[j])).unwrap();
    assert!((5.0 + 0.001 * hottest as f64 - 9.55).abs() < 0.01, "{hottest}");
    assert!(temperatures[hottest] > 0.999_999 && temperatures[0] == 0.0 && temperatures[10_000] > 0.5);
    assert!(temperatures.iter().all(|t| (0.0..=1.0).contains(t)));
}

#[test]
fn ends_of_the_temperatures() {
    for (a, inner) in [(0.0, 20.0), (0.9, 6.0), (-1.0, 40.0)] {
        let t = disc_temperatures(1.0, a, &uniform(inner, 50.0, 400));
        assert!(t.windows(2).all(|pair| pair[0] > pair[1]), "a {a}");
        assert_eq!(t[0], 1.0);
    }
    // The highest flux anywhere is no higher than the one the search finds.
    for a in [-1.0, -0.3, 0.0, 0.6, 0.95, 0.998, 1.0] {
        let brute = (1..200_000).map(|i| f64::from(i) * 2e-4 + 1.0).map(|r| disc_flux(r, 1.0, a) / r).fold(0.0, f64::max);
        let found = max_flux_over_radius(1.0, a, 0.5);
        assert!(found >= brute * (1.0 - 1e-12) && relative(found, brute) < 1e-4, "a {a}: {found} {brute}");
    }
    assert!(disc_temperatures(1.0, 0.0, &uniform(6.0, 20.0, 0)).is_empty());
    assert_eq!(disc_temperatures(1.0, 0.0, &uniform(20.0, 30.0, 1)), [1.0]);
    assert_eq!(disc_temperatures(0.0, 0.0, &uniform(6.0, 20.0, 3)), [0.0; 3]);
}

#[test]
fn chromaticities() {
    for (kelvin, x, y) in [(6504.0, 0.3135, 0.3237), (2856.0, 0.4476, 0.4074), (1900.0, 0.5378, 0.4112), (1e9, 0.2399, 0.2340)] {
        let v = black_body_xyz(kelvin);
        let sum = v[0] + v[1] + v[2];
        assert!((v[0] / sum - x).abs() < 0.003 && (v[1] / sum - y).abs() < 0.003, "{} {}", v[0] / sum, v[1] / sum);
    }
}

#[test]
fn black_bodies_grow_and_stay_in_gamut() {
    assert!((luminance(black_body(6500.0)) - 1.0).abs() < 1e-6);
    let mut previous = 0.0;
    for i in 0..200 {
        let kelvin = 300.0 * (f64::from(i) * 0.03).exp();
        let (rgb, y) = (black_body(kelvin), black_body_xyz(kelvin)[1]);
        assert!(rgb.iter().all(|&c| c >= 0.0) && y > previous, "{kelvin} {rgb:?}");
        assert!(relative(luminance(rgb), y) < 1e-6);
        previous = y;
    }
    for kelvin in [0.0, -5.0, f64::NAN, f64::INFINITY] {
        assert_eq!((black_body(kelvin), black_body_xyz(kelvin)), ([0.0; 3], [0.0; 3]));
    }
    assert!(black_body(1.0).iter().all(|&c| c == 0.0));
    assert!((0.0095..0.0105).contains(&luminance(black_body(3000.0))));
}
