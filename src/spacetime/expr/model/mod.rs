//! The functions a backend needs of a model, generated from its formulas.
//!
//! Whatever its class, each model gets the same functions in both dialects: `rate` (velocity and force along a ray), `launch` (momentum and
//! energy from a direction), `observe` (direction, frequency and constraint error as the local observer sees them), `frame` (his
//! orthonormal frame), `matter_frequency`, `far_frequency`, `index_gradient`, `coordinate_radius`, `capture_distance` and `safe_step`.
//! Models with many sources get a loop over them. `text` writes them out.

mod text;

use super::{Expr, gradient};
use crate::spacetime::{Dyadic, Flow, Medium, Metric, Parameters, Scalar, Vec3};

/// A function of the generated interface. Several results are `out` parameters in GLSL and a tuple in Rust.
struct Function {
    name: &'static str,
    arguments: &'static [Argument],
    results: Vec<(&'static str, Vec<Expr>)>,
}

/// A vector with the names of its components in the formulas, or a number.
enum Argument {
    Vector(&'static str, [&'static str; 3]),
    Number(&'static str),
}

const POSITION: Argument = Argument::Vector("position", ["x", "y", "z"]);
const MOMENTUM: Argument = Argument::Vector("momentum", ["px", "py", "pz"]);
const DIRECTION: Argument = Argument::Vector("direction", ["dx", "dy", "dz"]);
const RATE: &[Argument] = &[POSITION, MOMENTUM, Argument::Number("energy"), Argument::Number("sense"), Argument::Number("parameter")];
const LAUNCH: &[Argument] = &[POSITION, DIRECTION, Argument::Number("speed"), Argument::Number("sense")];
const FRAME: &[Argument] = &[POSITION];
const STEP: &[Argument] = &[POSITION, DIRECTION];
const GRADIENT: &[Argument] = &[POSITION, Argument::Number("energy")];
const FAR: &[Argument] = &[MOMENTUM, Argument::Number("energy")];
const MATTER: &[Argument] =
    &[POSITION, MOMENTUM, Argument::Number("energy"), Argument::Number("sense"), Argument::Vector("velocity", ["wx", "wy", "wz"])];
const CAPTURE: &[Argument] = &[POSITION, MOMENTUM, Argument::Number("frequency"), Argument::Number("sense")];

/// Entries of the table of a model, and their derivatives by its two coordinates.
const TABLE_ENTRIES: [&str; 3] = ["table_0", "table_1", "table_2"];
const TABLE_BY_U: [&str; 3] = ["table_0_u", "table_1_u", "table_2_u"];
const TABLE_BY_V: [&str; 3] = ["table_0_v", "table_1_v", "table_2_v"];

/// The smallest of the steps that sources allow along the direction, and along any.
const SOURCE_STEPS: [&str; 2] = ["source_step", "source_detail"];

/// The formulas of one model, ready to be written out.
pub struct ModelFormulas {
    global_names: &'static [&'static str],
    source_names: &'static [&'static str],
    source_potential: Expr,
    /// The longest step that a source allows along the direction, and along any.
    source_steps: [Expr; 2],
    /// Where the table is read, of a model that has one.
    table_point: Option<[Expr; 2]>,
    functions: Vec<Function>,
}

fn inputs(prefix: &str, names: &[&str]) -> Vec<Expr> {
    names.iter().map(|n| Expr::input(Box::leak(format!("{prefix}{n}").into_boxed_str()))).collect()
}

fn vector(names: [&'static str; 3]) -> Vec3<Expr> {
    let [x, y, z] = names.map(Expr::input);
    Vec3(x, y, z)
}

fn components(v: Vec3<Expr>) -> Vec<Expr> {
    vec![v.0, v.1, v.2]
}

fn unit(v: Vec3<Expr>) -> Vec3<Expr> {
    v * (Expr::constant(1.0) / v.length())
}

impl ModelFormulas {
    /// The functions of a medium.
    pub fn of_medium<M: Medium>() -> Self {
        let global_names = <M::Global<Expr> as Parameters<Expr>>::NAMES;
        let source_names = <M::Source<Expr> as Parameters<Expr>>::NAMES;
        let global = M::Global::<Expr>::read(&inputs("g_", global_names));
        let source = M::Source::<Expr>::read(&inputs("s_", source_names));
        let (x, p, d) = (vector(["x", "y", "z"]), vector(["px", "py", "pz"]), vector(["dx", "dy", "dz"]));
        let [potential, energy, speed] = ["potential", "energy", "speed"].map(Expr::input);
        let one = Expr::constant(1.0);
        let w = vector(["wx", "wy", "wz"]);
        let lapse = M::lapse(&global, x, potential);

        let index = M::index(&global, x, potential, energy);
        let [ix, iy, iz, by_potential] = gradient(index, [x.0, x.1, x.2, potential]);
        let chain = |direct: Expr, name| direct + by_potential * Expr::input(name);
        let slope = Vec3(chain(ix, "potential_x"), chain(iy, "potential_y"), chain(iz, "potential_z"));
        let launched = M::energy(&global, x, potential, speed);
        let bounded = |d, by_sources| {
            let step = M::safe_step(&global, x, d);
            if source_names.is_empty() { step } else { Scalar::min(step, Expr::input(by_sources)) }
        };
        let functions = vec![
            Function { name: "rate", arguments: RATE, results: vec![("velocity", components(p)), ("force", components(slope * index))] },
            Function { name: "index_gradient", arguments: GRADIENT, results: vec![("gradient", components(slope))] },
            radius_function(x.length_or_zero()),
            Function {
                name: "launch",
                arguments: LAUNCH,
                results: vec![
                    ("momentum", components(d * M::index(&global, x, potential, launched))),
                    ("energy", vec![launched]),
                    ("frequency", vec![one / lapse]),
                ],
            },
            Function {
                name: "observe",
                arguments: RATE,
                results: vec![
                    ("direction", components(unit(p))),
                    ("frequency", vec![one / lapse]),
                    ("constraint_error", vec![p.length() / index - one]),
                ],
            },
            frame_function(Dyadic::identity().entries()),
            matter_function(one / (lapse * (one - index.square() * w.dot(w)).sqrt()), w),
            Function { name: "far_frequency", arguments: FAR, results: vec![("frequency", vec![one])] },
            Function {
                name: "capture_distance",
                arguments: CAPTURE,
                results: vec![("distance", vec![M::capture_distance(&global, x, potential)])],
            },
            safe_step_function(bounded(d, SOURCE_STEPS[0]), bounded(Vec3::zero(), SOURCE_STEPS[1])),
        ];
        ModelFormulas {
            global_names,
            source_names,
            source_potential: M::source_potential(&source, x),
            source_steps: [d, Vec3::zero()].map(|d| M::source_safe_step(&source, x, d)),
            table_point: None,
            functions,
        }
    }

    /// The functions of a metric.
    pub fn of_metric<M: Metric>() -> Self {
        let global_names = <M::Global<Expr> as Parameters<Expr>>::NAMES;
        let global = M::Global::<Expr>::read(&inputs("g_", global_names));
        let (x, q, d) = (vector(["x", "y", "z"]), vector(["px", "py", "pz"]), vector(["dx", "dy", "dz"]));
        let [energy, sense, frequency] = ["energy", "sense", "frequency"].map(Expr::input);
        let table = TABLE_ENTRIES.map(Expr::input);
        let (shift, inverse) = (M::shift(&global, x, table), M::inverse_metric(&global, x, table));
        let lapse_squared = M::lapse_squared(&global, x, table);
        let lapse = lapse_squared.sqrt();
        let table_point = M::HAS_TABLE.then(|| M::table_point(&global, x));

        let squared = inverse.squared(q);
        let measured = squared.sqrt();
        let hamiltonian = (lapse_squared * squared).sqrt() - sense * shift.dot(q);
        let [hx, hy, hz, vx, vy, vz] = gradient(hamiltonian, [x.0, x.1, x.2, q.0, q.1, q.2]);
        let [hx, hy, hz] = through_table(hamiltonian, table, table_point, x, [hx, hy, hz]);
        // L q in the local frame, L the symmetric root of gamma^ij; its inverse turns a unit direction into a momentum of frequency 1.
        let root = inverse.root();
        let local = root.times(q);
        let launched = root.inverse().times(d);
        // Velocity of matter against the Eulerian observer, L^-1 (w + shift), in units of the lapse.
        let w = vector(["wx", "wy", "wz"]);
        let moved = w + shift.vector();
        let against = root.inverse().times(moved);
        let functions = vec![
            no_index_gradient(),
            radius_function(M::coordinate_radius(&global, x)),
            Function { name: "rate", arguments: RATE, results: vec![("velocity", vec![vx, vy, vz]), ("force", vec![-hx, -hy, -hz])] },
            Function {
                name: "launch",
                arguments: LAUNCH,
                results: vec![
                    ("momentum", components(launched)),
                    ("energy", vec![lapse - sense * shift.dot(launched)]),
                    ("frequency", vec![Expr::constant(1.0)]),
                ],
            },
            Function {
                name: "observe",
                arguments: RATE,
                results: vec![
                    ("direction", components(local * (Expr::constant(1.0) / measured))),
                    ("frequency", vec![measured]),
                    ("constraint_error", vec![(hamiltonian - energy) / measured]),
                ],
            },
            frame_function(root.entries()),
            matter_function(Expr::constant(1.0) / (lapse_squared - against.dot(against)).sqrt(), w),
            Function { name: "far_frequency", arguments: FAR, results: vec![("frequency", vec![M::far_frequency(q, energy)])] },
            Function {
                name: "capture_distance",
                arguments: CAPTURE,
                results: vec![("distance", vec![M::capture_distance(&global, x, measured / frequency, sense)])],
            },
            safe_step_function(M::safe_step(&global, x, d), M::detail(&global, x)),
        ];
        ModelFormulas { table_point, ..Self::without_sources(global_names, functions) }
    }

    /// The functions of a flow.
    pub fn of_flow<M: Flow>() -> Self {
        let global_names = <M::Global<Expr> as Parameters<Expr>>::NAMES;
        let global = M::Global::<Expr>::read(&inputs("g_", global_names));
        let (x, p, d) = (vector(["x", "y", "z"]), vector(["px", "py", "pz"]), vector(["dx", "dy", "dz"]));
        let (zero, one) = (Expr::constant(0.0), Expr::constant(1.0));
        let velocity = M::velocity(&global, x, p, Expr::input("parameter"));
        let functions = vec![
            no_index_gradient(),
            radius_function(x.length_or_zero()),
            Function { name: "rate", arguments: RATE, results: vec![("velocity", components(velocity)), ("force", vec![zero; 3])] },
            Function {
                name: "launch",
                arguments: LAUNCH,
                results: vec![("momentum", components(d)), ("energy", vec![one]), ("frequency", vec![one])],
            },
            Function {
                name: "observe",
                arguments: RATE,
                results: vec![("direction", components(unit(velocity))), ("frequency", vec![one]), ("constraint_error", vec![zero])],
            },
            frame_function(Dyadic::identity().entries()),
            Function { name: "matter_frequency", arguments: MATTER, results: vec![("frequency", vec![one])] },
            Function { name: "far_frequency", arguments: FAR, results: vec![("frequency", vec![one])] },
            Function { name: "capture_distance", arguments: CAPTURE, results: vec![("distance", vec![one])] },
            safe_step_function(M::safe_step(&global, x), M::safe_step(&global, x)),
        ];
        Self::without_sources(global_names, functions)
    }

    fn without_sources(global_names: &'static [&'static str], functions: Vec<Function>) -> Self {
        let zero = Expr::constant(0.0);
        ModelFormulas { global_names, source_names: &[], source_potential: zero, source_steps: [zero; 2], table_point: None, functions }
    }
}

/// Adds to the derivatives of `output` by position what comes through the table's entries.
fn through_table(output: Expr, table: [Expr; 3], point: Option<[Expr; 2]>, x: Vec3<Expr>, direct: [Expr; 3]) -> [Expr; 3] {
    let Some(point) = point else { return direct };
    let by_entry = gradient(output, table);
    let mut sum = direct;
    for (along, names) in point.into_iter().zip([TABLE_BY_U, TABLE_BY_V]) {
        let slope = by_entry.into_iter().zip(names).fold(Expr::constant(0.0), |s, (by, name)| s + by * Expr::input(name));
        let by_position = gradient(along, [x.0, x.1, x.2]);
        for (total, by) in sum.iter_mut().zip(by_position) {
            *total = *total + slope * by;
        }
    }
    sum
}

/// The model's own radial coordinate.
fn radius_function(radius: Expr) -> Function {
    Function { name: "coordinate_radius", arguments: FRAME, results: vec![("radius", vec![radius])] }
}

/// The longest step, and the length by which its error is measured.
fn safe_step_function(length: Expr, detail: Expr) -> Function {
    Function { name: "safe_step", arguments: STEP, results: vec![("length", vec![length]), ("detail", vec![detail])] }
}

/// u^t (E - sense p . w) of matter with coordinate velocity `w` and `rate` u^t of its coordinate time by its own.
fn matter_function(rate: Expr, w: Vec3<Expr>) -> Function {
    let q = vector(["px", "py", "pz"]);
    let seen = rate * (Expr::input("energy") - Expr::input("sense") * q.dot(w));
    Function { name: "matter_frequency", arguments: MATTER, results: vec![("frequency", vec![seen])] }
}

/// Models without an index have no gradient of it.
fn no_index_gradient() -> Function {
    Function { name: "index_gradient", arguments: GRADIENT, results: vec![("gradient", vec![Expr::constant(0.0); 3])] }
}

/// The symmetric root of gamma^ij: xx, yy, zz, and xy, xz, yz.
fn frame_function((diagonal, mixed): (Vec3<Expr>, Vec3<Expr>)) -> Function {
    Function { name: "frame", arguments: FRAME, results: vec![("diagonal", components(diagonal)), ("mixed", components(mixed))] }
}
