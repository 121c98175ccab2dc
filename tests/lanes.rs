//! Functions of registers against those of single numbers.

use fearless_simd::{Level, Simd, f32x8, f32x16, f64x8};
use nullray::simd::{Lane, MAX_LANES, Real};

/// A function of lanes, the library's function in double precision, and arguments inside and outside of what is reduced.
struct Case {
    name: &'static str,
    exact: fn(f64) -> f64,
    /// Least and largest argument in single and in double precision, as the exponents of ten of an even spread, or as the limits of one.
    ranges: [[f64; 2]; 2],
    logarithmic: bool,
}

const CASES: [Case; 5] = [
    Case { name: "exp", exact: f64::exp, ranges: [[-86.9, 87.9], [-707.9, 708.9]], logarithmic: false },
    Case { name: "ln", exact: f64::ln, ranges: [[-37.0, 38.0], [-307.0, 308.0]], logarithmic: true },
    Case { name: "sin", exact: f64::sin, ranges: [[-7.9e3, 7.9e3], [-9.9e5, 9.9e5]], logarithmic: false },
    Case { name: "cos", exact: f64::cos, ranges: [[-7.9e3, 7.9e3], [-9.9e5, 9.9e5]], logarithmic: false },
    Case { name: "atan", exact: f64::atan, ranges: [[-10.0, 10.0], [-10.0, 10.0]], logarithmic: true },
];

fn apply<L: Lane>(name: &str, x: L) -> L {
    match name {
        "exp" => x.exp(),
        "ln" => x.ln(),
        "sin" => x.sin(),
        "cos" => x.cos(),
        _ => x.atan(),
    }
}

/// Largest error in units in the last place (of a number of at least 1e-3), and where.
fn largest_error<L: Lane>(token: L::Token, case: &Case) -> (f64, f64) {
    let single = size_of::<L::Real>() == 4;
    let unit = if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
    let [low, high] = case.ranges[usize::from(!single)];
    const COUNT: usize = 200_000;
    // An even spread, one around 0 or 1, and small arguments of both signs.
    let spread =
        (0..COUNT).map(|i| low + (high - low) * (i as f64 + 0.5) / COUNT as f64).map(|v| if case.logarithmic { 10f64.powf(v) } else { v });
    let near = (0..COUNT).map(|i| 4.0 * (i as f64 + 0.5) / COUNT as f64);
    let signed = case.name != "ln";
    let arguments: Vec<f64> = spread.chain(near).flat_map(|v| [v, if signed { -v } else { v }]).collect();
    let mut worst = (0.0, 0.0);
    for chunk in arguments.chunks_exact(L::LANES) {
        let mut row = [L::Real::default(); MAX_LANES];
        row.iter_mut().zip(chunk).for_each(|(lane, &v)| *lane = L::Real::from_f64(v));
        let mut found = [L::Real::default(); MAX_LANES];
        apply(case.name, L::load(token, &row)).store(&mut found);
        for (x, y) in row.iter().zip(&found).take(L::LANES) {
            let exact = (case.exact)(x.to_f64());
            let error = (y.to_f64() - exact).abs() / (exact.abs().max(1e-3) * unit);
            if !(error <= worst.0) {
                worst = (error, x.to_f64());
            }
        }
    }
    worst
}

fn check<L: Lane>(token: L::Token, label: &str) {
    for case in &CASES {
        let (error, at) = largest_error::<L>(token, case);
        println!("{label} {}: {error:.2} units in the last place at {at:e}", case.name);
        assert!(error <= 1.5, "{label} {}: {error} units in the last place at {at:e}", case.name);
    }
    // What is out of range, or no number, is as in the library, in whichever lane it is.
    for case in &CASES {
        for special in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, -1.0, 1e30, -1e30, 1e-30, 1e4, 1e7] {
            for lane in 0..L::LANES {
                let mut row = [L::Real::from_f64(0.5); MAX_LANES];
                row[lane] = L::Real::from_f64(special);
                let mut found = [L::Real::default(); MAX_LANES];
                apply(case.name, L::load(token, &row)).store(&mut found);
                let exact = L::Real::from_f64((case.exact)(row[lane].to_f64())).to_f64();
                let value = found[lane].to_f64();
                let close = (value - exact).abs() <= 1e-6 * exact.abs().max(1e-3) || value == exact || (value.is_nan() && exact.is_nan());
                assert!(close, "{label} {} of {special} in lane {lane}: {value}, expected {exact}", case.name);
            }
        }
    }
}

fn check_registers<S: Simd>(simd: S, label: &str) {
    simd.vectorize(
        #[inline(always)]
        || {
            check::<f32x8<S>>(simd, &format!("{label} f32x8"));
            check::<f32x16<S>>(simd, &format!("{label} f32x16"));
            check::<f64x8<S>>(simd, &format!("{label} f64x8"));
        },
    );
}

#[test]
fn functions_of_registers_are_those_of_the_library() {
    let level = Level::new();
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = level.as_avx512() {
            check_registers(simd, "AVX-512");
        }
        if let Some(simd) = level.as_avx2() {
            check_registers(simd, "AVX2");
        }
        check_registers(level.as_sse2().expect("x86-64 has SSE2"), "SSE2");
    }
    #[cfg(not(target_arch = "x86_64"))]
    fearless_simd::dispatch!(level, simd => check_registers(simd, "this machine"));
}
