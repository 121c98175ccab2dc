//! Functions of registers against those of single numbers.

use fearless_simd::{Level, Simd, f32x8, f32x16, f64x8};
use nullray::simd::{Lane, MAX_LANES, Real};

/// A function, and the arguments at which registers do not ask the library for it.
struct Case {
    name: &'static str,
    exact: fn(f64) -> f64,
    /// Least and largest argument in single and in double precision, or their powers of ten.
    range: [[f64; 2]; 2],
    powers_of_ten: bool,
    /// Errors are relative to the value, but to no less than this.
    least: f64,
}

const CASES: [Case; 5] = [
    Case { name: "exp", exact: f64::exp, range: [[-86.9, 87.9], [-707.9, 708.9]], powers_of_ten: false, least: 0.0 },
    Case { name: "ln", exact: f64::ln, range: [[-37.0, 38.0], [-307.0, 308.0]], powers_of_ten: true, least: 0.0 },
    Case { name: "sin", exact: f64::sin, range: [[-7.9e3, 7.9e3], [-9.9e5, 9.9e5]], powers_of_ten: false, least: 1e-3 },
    Case { name: "cos", exact: f64::cos, range: [[-7.9e3, 7.9e3], [-9.9e5, 9.9e5]], powers_of_ten: false, least: 1e-3 },
    Case { name: "atan", exact: f64::atan, range: [[-30.0, 30.0], [-200.0, 200.0]], powers_of_ten: true, least: 0.0 },
];

/// Largest relative error, in units of epsilon.
const LIMIT: f64 = 1.5;

fn single<L: Lane>() -> bool {
    size_of::<L::Real>() == 4
}

fn epsilon<L: Lane>() -> f64 {
    if single::<L>() { f64::from(f32::EPSILON) } else { f64::EPSILON }
}

/// The function of a row of arguments.
fn apply<L: Lane>(token: L::Token, name: &str, row: &[L::Real; MAX_LANES]) -> [L::Real; MAX_LANES] {
    let x = L::load(token, row);
    let y = match name {
        "exp" => x.exp(),
        "ln" => x.ln(),
        "sin" => x.sin(),
        "cos" => x.cos(),
        _ => x.atan(),
    };
    let mut found = [L::Real::default(); MAX_LANES];
    y.store(&mut found);
    found
}

/// The error of `found` in units of epsilon.
fn error<L: Lane>(case: &Case, found: f64, exact: f64) -> f64 {
    if found == exact { 0.0 } else { (found - exact).abs() / (exact.abs().max(case.least) * epsilon::<L>()) }
}

/// The largest error among arguments all over the range and among those from -4 to 4, and where it is.
fn largest_error<L: Lane>(token: L::Token, case: &Case) -> (f64, f64) {
    const COUNT: usize = 200_000;
    let even = |low: f64, high: f64| (0..COUNT).map(move |i| low + (high - low) * (i as f64 + 0.5) / COUNT as f64);
    let [low, high] = case.range[usize::from(!single::<L>())];
    let all = even(low, high).map(|v| if case.powers_of_ten { 10f64.powf(v) } else { v });
    let arguments: Vec<f64> = all.chain(even(if case.name == "ln" { 0.0 } else { -4.0 }, 4.0)).collect();
    let mut worst = (0.0, 0.0);
    for chunk in arguments.chunks_exact(L::LANES) {
        let mut row = [L::Real::default(); MAX_LANES];
        row.iter_mut().zip(chunk).for_each(|(lane, &v)| *lane = L::Real::from_f64(v));
        for (x, y) in row.iter().zip(apply::<L>(token, case.name, &row)).take(L::LANES) {
            let error = error::<L>(case, y.to_f64(), (case.exact)(x.to_f64()));
            assert!(!error.is_nan(), "{} of {:e} is {}", case.name, x.to_f64(), y.to_f64());
            if error > worst.0 {
                worst = (error, x.to_f64());
            }
        }
    }
    worst
}

fn check<L: Lane>(token: L::Token, label: &str) {
    for case in &CASES {
        let (error, at) = largest_error::<L>(token, case);
        println!("{label} {}: {error:.2} epsilon at {at:e}", case.name);
        assert!(error <= LIMIT, "{label} {}: {error} epsilon at {at:e}", case.name);
    }
    let exact: fn(f64) -> f64 =
        if single::<L>() { |x| x.exp() * (1.0 + 4.0 * f64::from(f32::EPSILON)) } else { |x| x.exp() * (1.0 + 4.0 * f64::EPSILON) };
    let wrong = Case { exact, ..CASES[0] };
    assert!(largest_error::<L>(token, &wrong).0 > LIMIT, "{label}: an error of 4 epsilon is not noticed");
}

/// A lane that is out of range has the library's value, and changes nothing in the others.
fn check_special<L: Lane>(token: L::Token, label: &str) {
    let usual = [L::Real::from_f64(0.7); MAX_LANES];
    for case in &CASES {
        let alone = apply::<L>(token, case.name, &usual)[0].to_f64();
        for special in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e30, -1e30, 1e-45, 100.0, -100.0, 1e4, 1e7] {
            for lane in 0..L::LANES {
                let mut row = usual;
                row[lane] = L::Real::from_f64(special);
                let exact = L::Real::from_f64((case.exact)(row[lane].to_f64())).to_f64();
                for (i, value) in apply::<L>(token, case.name, &row).iter().take(L::LANES).map(|v| v.to_f64()).enumerate() {
                    let as_library = (value.is_nan() && exact.is_nan()) || error::<L>(case, value, exact) <= LIMIT;
                    let right = if i == lane { as_library } else { value == alone };
                    assert!(right, "{label} {} of {special} in lane {lane}: {value} in lane {i}, expected {exact} or {alone}", case.name);
                }
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
            check_special::<f32x8<S>>(simd, label);
            check_special::<f32x16<S>>(simd, label);
            check_special::<f64x8<S>>(simd, label);
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
