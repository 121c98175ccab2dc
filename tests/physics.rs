//! Bending models and the integrator against exact values, on the CPU backend.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use nullray::backend::Precision;
use nullray::backend::cpu::CpuBackend;
use nullray::kernels::integrator::{Model, ModelBlock};
use nullray::spacetime::{PowerGravity, Schwarzschild, ThesisGravity, gravity::Source};
use support::*;

fn cpu() -> CpuBackend {
    CpuBackend::new(None).unwrap()
}

#[test]
fn thesis_recurrence_in_f64() {
    let error = groeller_literal_error(&mut cpu(), Precision::F64);
    println!("largest error: {error:.2e}");
    assert!(error < 1e-9, "{error:e}");
}

#[test]
fn thesis_equation_of_motion_in_f64() {
    let error = groeller_limit_error(&mut cpu(), Precision::F64, 1e-12);
    println!("largest error: {error:.2e}");
    assert!(error < 1e-9, "{error:e}");
}

#[test]
fn thesis_in_f32() {
    let literal = groeller_literal_error(&mut cpu(), Precision::F32);
    let limit = groeller_limit_error(&mut cpu(), Precision::F32, 1e-5);
    println!("literal {literal:.2e}, limit {limit:.2e}");
    assert!(literal < 1e-3 && limit < 1e-3, "{literal:e} {limit:e}");
}

/// Dual numbers: a value and its derivative, for derivatives without cancellation.
#[derive(Clone, Copy)]
struct Dual(f64, f64);

mod dual {
    use super::Dual;
    use nullray::spacetime::Scalar;
    use std::ops::*;
    impl Add for Dual {
        type Output = Dual;
        fn add(self, o: Dual) -> Dual {
            Dual(self.0 + o.0, self.1 + o.1)
        }
    }
    impl Sub for Dual {
        type Output = Dual;
        fn sub(self, o: Dual) -> Dual {
            Dual(self.0 - o.0, self.1 - o.1)
        }
    }
    impl Mul for Dual {
        type Output = Dual;
        fn mul(self, o: Dual) -> Dual {
            Dual(self.0 * o.0, self.0 * o.1 + self.1 * o.0)
        }
    }
    impl Div for Dual {
        type Output = Dual;
        fn div(self, o: Dual) -> Dual {
            Dual(self.0 / o.0, (self.1 * o.0 - self.0 * o.1) / (o.0 * o.0))
        }
    }
    impl Neg for Dual {
        type Output = Dual;
        fn neg(self) -> Dual {
            Dual(-self.0, -self.1)
        }
    }
    impl Scalar for Dual {
        fn constant(v: f64) -> Dual {
            Dual(v, 0.0)
        }
        fn sqrt(self) -> Dual {
            let root = self.0.sqrt();
            Dual(root, self.1 / (2.0 * root))
        }
        fn exp(self) -> Dual {
            let e = self.0.exp();
            Dual(e, self.1 * e)
        }
        fn ln(self) -> Dual {
            Dual(self.0.ln(), self.1 / self.0)
        }
        fn sin(self) -> Dual {
            Dual(self.0.sin(), self.1 * self.0.cos())
        }
        fn cos(self) -> Dual {
            Dual(self.0.cos(), -self.1 * self.0.sin())
        }
        fn atan(self) -> Dual {
            Dual(self.0.atan(), self.1 / (1.0 + self.0 * self.0))
        }
        fn min(self, o: Dual) -> Dual {
            if self.0 < o.0 { self } else { o }
        }
        fn max(self, o: Dual) -> Dual {
            if self.0 > o.0 { self } else { o }
        }
        fn select_less(a: Dual, b: Dual, t: Dual, f: Dual) -> Dual {
            if a.0 < b.0 { t } else { f }
        }
        fn held(self) -> Dual {
            Dual(self.0, 0.0)
        }
    }
}

/// Index and derivative along `axis` of a model's formula by dual numbers.
fn by_dual<M: nullray::spacetime::Medium>(block: &ModelBlock<f64>, stride: usize, x: [f64; 3], axis: usize, energy: f64) -> Dual {
    use nullray::spacetime::{Parameters, Vec3};
    let seed = |i: usize| Dual(x[i] - block.origin[i], f64::from(u8::from(i == axis)));
    let at = Vec3(seed(0), seed(1), seed(2));
    let lift = |v: &[f64]| v.iter().map(|&c| Dual(c, 0.0)).collect::<Vec<_>>();
    let global = M::Global::<Dual>::read(&lift(&block.global));
    let mut potential = Dual(0.0, 0.0);
    if stride > 0 {
        for source in block.sources.chunks_exact(stride) {
            potential = potential + M::source_potential(&M::Source::<Dual>::read(&lift(source)), at);
        }
    }
    M::index(&global, at, potential, Dual(energy, 0.0))
}

/// Energy of the rays whose medium is differentiated.
const ENERGY: f64 = 1.3;

/// Refractive index by the generated code: a momentum of length 1 has the constraint error 1/n - 1.
fn index<M: Model>(block: &ModelBlock<f64>, x: [f64; 3]) -> f64 {
    1.0 / (1.0 + M::observe::<f64>((), block, x, [1.0, 0.0, 0.0], ENERGY, 1.0, 0.0).2)
}

fn check_derivatives<M: nullray::spacetime::Medium + Model>(block: ModelBlock<f64>, points: &[[f64; 3]]) {
    let stride = M::KIND.source_stride();
    for &x in points {
        let n = index::<M>(&block, x);
        let gradient = M::index_gradient::<f64>((), &block, x, ENERGY);
        for axis in 0..3 {
            let exact = by_dual::<M>(&block, stride, x, axis, ENERGY);
            assert!((n - exact.0).abs() <= 1e-13 * exact.0.abs(), "{:?} {n} {}", M::KIND, exact.0);
            assert!(
                (gradient[axis] - exact.1).abs() <= 1e-12 * (1.0 + exact.1.abs()),
                "{:?} at {x:?}: {} {}",
                M::KIND,
                gradient[axis],
                exact.1
            );
            // And by central differences, which share nothing with either.
            let step = 1e-5;
            let shifted = |s: f64| {
                let mut y = x;
                y[axis] += s;
                index::<M>(&block, y)
            };
            let difference = (shifted(step) - shifted(-step)) / (2.0 * step);
            assert!((difference - exact.1).abs() < 1e-6 * (1.0 + exact.1.abs()), "{:?} at {x:?}: {difference} {}", M::KIND, exact.1);
        }
    }
}

#[test]
fn generated_gradients_equal_dual_numbers() {
    let points = [[2.0, 0.3, -1.0], [0.4, 0.9, 0.2], [-3.0, 1.0, 2.5], [0.7, -0.6, 4.0]];
    check_derivatives::<Schwarzschild>(ModelBlock { origin: [0.1, 0.2, 0.3], global: vec![0.4], ..ModelBlock::default() }, &points);
    let sources = [
        Source { position: [0.5, 0.0, 0.0], direction: [0.0, 1.0, 0.0], extent: (0.0, 0.0), strength: 0.3, radius: 5.0 },
        Source {
            position: [-1.0, 0.0, 1.0],
            direction: [0.6, 0.8, 0.0],
            extent: (f64::NEG_INFINITY, f64::INFINITY),
            strength: -0.2,
            radius: f64::INFINITY,
        },
        Source { position: [2.0, 2.0, 1.0], direction: [0.0, 0.0, 1.0], extent: (0.0, 2.0), strength: 0.5, radius: 8.0 },
    ];
    let thesis = sources.iter().flat_map(Source::thesis_parameters).collect();
    check_derivatives::<ThesisGravity>(ModelBlock { sources: thesis, ..ModelBlock::default() }, &points);
    for exponent in [1.0, 2.0, 2.5, 4.0] {
        let power = sources.iter().flat_map(|s| s.power_parameters(exponent)).collect();
        check_derivatives::<PowerGravity>(ModelBlock { sources: power, ..ModelBlock::default() }, &points);
    }
}

/// The thesis' law is the power law with exponent 0: two formulas, one force.
#[test]
fn thesis_law_is_power_zero() {
    let source = Source { position: [0.5, 0.0, 0.0], direction: [0.0, 1.0, 0.0], extent: (0.0, 0.0), strength: 0.3, radius: 5.0 };
    let thesis = ModelBlock { sources: source.thesis_parameters(), ..ModelBlock::default() };
    let power = ModelBlock { sources: source.power_parameters(0.0), ..ModelBlock::default() };
    for x in [[1.0, 2.0, 3.0], [-0.2, 0.1, 0.4], [4.0, 4.0, 4.0]] {
        let (a, ga) = (index::<ThesisGravity>(&thesis, x), ThesisGravity::index_gradient::<f64>((), &thesis, x, ENERGY));
        let (b, gb) = (index::<PowerGravity>(&power, x), PowerGravity::index_gradient::<f64>((), &power, x, ENERGY));
        assert!((a - b).abs() < 1e-13 && distance(ga, gb) < 1e-13, "{x:?}: {a} {b}");
    }
}

/// The index n = E + k / r of an inverse-square force deflects by an angle in closed form.
#[test]
fn inverse_square_deflection_is_exact() {
    // b = rho n sin(angle) is conserved: deflection = 2 int b dr / (r sqrt(n^2 r^2 - b^2)) - pi, here in u = 1/r:
    // n r = 1/u + k, so the integral is elementary: 2 b/sqrt(b^2-k^2) * (pi/2 + asin(k/b)) - pi.
    let (k, b) = (0.2f64, 1.5f64);
    let beta = (b * b - k * k).sqrt();
    let expected = 2.0 * b / beta * (std::f64::consts::FRAC_PI_2 + (k / b).asin()) - std::f64::consts::PI;
    let world = world(&format!(
        "[spacetime]\nkind = \"gravity\"\nlaw = \"power\"\nexponent = 2\n[[spacetime.center]]\nposition = [0, 0, 0]\nstrength = {k}\n[integrator]\nmax_steps = 1000000"
    ));
    let mut backend = cpu();
    nullray::backend::Backend::upload(&mut backend, std::sync::Arc::new(world), Precision::F64, 0).unwrap();
    // Launched from far away with |V| such that n at infinity is 1.
    let far = 1e6f64;
    let ray = nullray::backend::TraceRay::looking([-far, b, 0.0], [1.0 + k / far, 0.0, 0.0]);
    let options = nullray::backend::TraceOptions { tolerance: 1e-11, stop: nullray::backend::Stop::Never, max_steps: None };
    let result = nullray::backend::Backend::trace(&mut backend, &[ray], options).unwrap()[0];
    let angle = -result.direction[1].atan2(result.direction[0]);
    println!("deflection {angle}, expected {expected}");
    assert!((angle - expected).abs() < 2e-6, "{angle} {expected}");
}
