//! The functions a backend needs of a model, generated from its formula.
//!
//! For each model both dialects get the same five functions: `medium` (index and its gradient), `launch_energy`, `lapse`,
//! `capture_distance` and `safe_step`. Models with many sources get a loop over them.

use super::emit::{Dialect, reads, statements};
use super::{Expr, gradient};
use crate::spacetime::{Medium, Parameters, Scalar, Vec3};
use std::fmt::Write;

/// A function of the generated interface: its outputs, and how the sources enter.
struct Function {
    name: &'static str,
    argument: Option<&'static str>,
    outputs: Vec<Expr>,
    reduction: Reduction,
}

/// What a loop over the sources accumulates.
enum Reduction {
    None,
    /// Sum of potentials, with their gradient when asked for.
    Potential {
        gradient: bool,
    },
    /// Smallest safe step.
    SafeStep,
}

/// The formulas of one model, ready to be written out.
pub struct ModelFormulas {
    global_names: &'static [&'static str],
    source_names: &'static [&'static str],
    source_potential: Expr,
    source_gradient: [Expr; 3],
    source_safe_step: Expr,
    functions: Vec<Function>,
}

fn inputs(prefix: &str, names: &[&str]) -> Vec<Expr> {
    names.iter().map(|n| Expr::input(Box::leak(format!("{prefix}{n}").into_boxed_str()))).collect()
}

impl ModelFormulas {
    /// Evaluates a model over [`Expr`] and differentiates it.
    pub fn of<M: Medium>() -> Self {
        let global_names = <M::Global<Expr> as Parameters<Expr>>::NAMES;
        let source_names = <M::Source<Expr> as Parameters<Expr>>::NAMES;
        let global = M::Global::<Expr>::read(&inputs("g_", global_names));
        let source = M::Source::<Expr>::read(&inputs("s_", source_names));
        let [x, y, z] = ["x", "y", "z"].map(Expr::input);
        let at = Vec3(x, y, z);
        let potential = Expr::input("potential");
        let energy = Expr::input("energy");
        let speed = Expr::input("speed");

        let index = M::index(&global, at, potential, energy);
        let [ix, iy, iz, by_potential] = gradient(index, [x, y, z, potential]);
        let chain = |direct: Expr, name| direct + by_potential * Expr::input(name);
        let medium = vec![index, chain(ix, "potential_x"), chain(iy, "potential_y"), chain(iz, "potential_z")];

        let source_potential = M::source_potential(&source, at);
        let has_sources = !source_names.is_empty();
        let potential_of = |outputs: &[Expr], gradient| {
            let used = ["potential", "potential_x"].iter().any(|n| reads(outputs, n));
            if used && has_sources { Reduction::Potential { gradient } } else { Reduction::None }
        };
        let energy_out = vec![M::energy(&global, at, potential, speed)];
        let capture_out = vec![M::capture_distance(&global, at, potential)];
        let step_out = vec![Scalar::min(M::safe_step(&global, at), Expr::input("source_step"))];
        let functions = vec![
            Function { name: "medium", argument: Some("energy"), reduction: potential_of(&medium, true), outputs: medium },
            Function { name: "launch_energy", argument: Some("speed"), reduction: potential_of(&energy_out, false), outputs: energy_out },
            Function { name: "lapse", argument: None, reduction: Reduction::None, outputs: vec![M::lapse(&global, at)] },
            Function { name: "capture_distance", argument: None, reduction: potential_of(&capture_out, false), outputs: capture_out },
            Function {
                name: "safe_step",
                argument: None,
                reduction: if has_sources { Reduction::SafeStep } else { Reduction::None },
                outputs: if has_sources { step_out } else { vec![M::safe_step(&global, at)] },
            },
        ];
        ModelFormulas {
            global_names,
            source_names,
            source_gradient: gradient(source_potential, [x, y, z]),
            source_potential,
            source_safe_step: M::source_safe_step(&source, at),
            functions,
        }
    }

    /// GLSL functions of the model; `real` and the accessors `model_*` must be in scope.
    pub fn glsl(&self, dialect: Dialect) -> String {
        let mut out = String::new();
        for f in &self.functions {
            let mut parameters = String::from("real3 position");
            if let Some(argument) = f.argument {
                let _ = write!(parameters, ", real {argument}");
            }
            if f.outputs.len() == 4 {
                parameters.push_str(", out real3 gradient");
            }
            let (body, results) = statements(dialect, "t", &f.outputs);
            let _ = writeln!(out, "real {}({parameters}) {{", f.name);
            out.push_str(
                "    real x = position.x - model_origin().x, y = position.y - model_origin().y, z = position.z - model_origin().z;\n",
            );
            self.load(&mut out, dialect, "g_", self.global_names, &f.outputs, |i| format!("model_global({i})"));
            self.reduce(&mut out, dialect, &f.reduction, "for (int source = 0; source < model_source_count(); ++source)", |i| {
                format!("model_source(source, {i})")
            });
            out.push_str(&body);
            if f.outputs.len() == 4 {
                let _ = writeln!(out, "    gradient = real3({}, {}, {});", results[1], results[2], results[3]);
            }
            let _ = writeln!(out, "    return {};\n}}\n", results[0]);
        }
        out
    }

    /// A Rust `impl Model for $name` over SIMD lanes.
    pub fn rust(&self, name: &str) -> String {
        let mut out = format!(
            "impl Model for crate::spacetime::{name} {{\n    const KIND: crate::spacetime::ModelKind = crate::spacetime::ModelKind::{name};\n"
        );
        for f in &self.functions {
            let argument = f.argument.map(|a| format!(", {a}: L")).unwrap_or_default();
            let result = if f.outputs.len() == 4 { "(L, [L; 3])" } else { "L" };
            let (body, results) = statements(Dialect::Rust, "t", &f.outputs);
            let _ = writeln!(
                out,
                "    #[inline(always)]\n    #[allow(unused_variables, reason = \"a model need not read everything\")]\n    fn {}<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>, position: [L; 3]{argument}) -> {result} {{",
                f.name
            );
            for (i, name) in ["x", "y", "z"].into_iter().enumerate() {
                let _ = writeln!(out, "    let {name} = position[{i}] - L::splat(token, model.origin[{i}]);");
            }
            self.load(&mut out, Dialect::Rust, "g_", self.global_names, &f.outputs, |i| format!("L::splat(token, model.global[{i}])"));
            let stride = self.source_names.len();
            self.reduce(&mut out, Dialect::Rust, &f.reduction, &format!("for source in model.sources.chunks_exact({stride})"), |i| {
                format!("L::splat(token, source[{i}])")
            });
            out.push_str(&body);
            let _ = match results.as_slice() {
                [index, gx, gy, gz] => writeln!(out, "    ({index}, [{gx}, {gy}, {gz}])\n    }}"),
                results => writeln!(out, "    {}\n    }}", results[0]),
            };
        }
        out.push_str("}\n");
        out
    }

    /// Declares every parameter of `names` that `outputs` read.
    fn load(&self, out: &mut String, dialect: Dialect, prefix: &str, names: &[&str], outputs: &[Expr], value: impl Fn(usize) -> String) {
        for (i, name) in names.iter().enumerate() {
            let name = format!("{prefix}{name}");
            if reads(outputs, &name) {
                let keyword = if dialect == Dialect::Rust { "let" } else { "real" };
                let _ = writeln!(out, "    {keyword} {name} = {};", value(i));
            }
        }
    }

    /// Writes the loop over the sources.
    fn reduce(&self, out: &mut String, dialect: Dialect, reduction: &Reduction, header: &str, value: impl Fn(usize) -> String) {
        let variable = if dialect == Dialect::Rust { "let mut" } else { "real" };
        let (terms, targets, combine): (Vec<Expr>, Vec<&str>, &str) = match reduction {
            Reduction::None => {
                return;
            }
            Reduction::Potential { gradient: false } => (vec![self.source_potential], vec!["potential"], "+"),
            Reduction::Potential { gradient: true } => {
                let [gx, gy, gz] = self.source_gradient;
                (vec![self.source_potential, gx, gy, gz], vec!["potential", "potential_x", "potential_y", "potential_z"], "+")
            }
            Reduction::SafeStep => (vec![self.source_safe_step], vec!["source_step"], "min"),
        };
        let start = if combine == "min" { crate::spacetime::UNBOUNDED_STEP } else { 0.0 };
        for target in &targets {
            let _ = writeln!(out, "    {variable} {target} = {};", dialect.constant(start));
        }
        let _ = writeln!(out, "    {header} {{");
        self.load(out, dialect, "s_", self.source_names, &terms, value);
        let (body, results) = statements(dialect, "s", &terms);
        out.push_str(&body);
        for (target, result) in targets.iter().zip(results) {
            let sum = match (combine, dialect) {
                ("+", _) => format!("{target} + {result}"),
                (_, Dialect::Rust) => format!("{target}.min({result})"),
                _ => format!("min({target}, {result})"),
            };
            let _ = writeln!(out, "    {target} = {sum};");
        }
        out.push_str("    }\n");
    }
}
