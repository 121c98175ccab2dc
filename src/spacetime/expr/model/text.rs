//! The functions of a model, written out as source text: GLSL, or Rust over SIMD lanes.

use super::{Argument, Function, ModelFormulas, SOURCE_STEPS, TABLE_BY_U, TABLE_BY_V, TABLE_ENTRIES};
use crate::spacetime::expr::emit::{Dialect, reads, statements};
use crate::spacetime::expr::{Expr, gradient};
use std::fmt::Write;

/// What a loop over the sources accumulates.
enum Reduction {
    None,
    /// Sum of potentials, with their gradient when it is read.
    Potential {
        gradient: bool,
    },
    /// Smallest safe steps.
    SafeStep,
}

impl ModelFormulas {
    /// GLSL functions of the model; `real`, `table_lookup` and the accessors `model_*` must be in scope.
    pub fn glsl(&self, dialect: Dialect) -> String {
        let mut out = String::new();
        for f in &self.functions {
            let outputs = f.outputs();
            let mut parameters: Vec<String> = f.arguments.iter().map(|a| format!("{} {}", a.glsl_type(), a.name())).collect();
            let result_type = |r: &[Expr]| if r.len() == 3 { "real3" } else { "real" };
            let returned = match f.results.as_slice() {
                [(_, only)] => result_type(only),
                several => {
                    parameters.extend(several.iter().map(|(name, r)| format!("out {} out_{name}", result_type(r))));
                    "void"
                }
            };
            let _ = writeln!(out, "{returned} {}({}) {{", f.name, parameters.join(", "));
            for argument in f.arguments {
                if let Argument::Vector(name, parts) = argument {
                    for (part, component) in parts.iter().zip(["x", "y", "z"]) {
                        let origin = if *name == "position" { format!(" - model_origin().{component}") } else { String::new() };
                        if *name == "position" || reads(&outputs, part) || reads(&self.source_steps, part) {
                            let _ = writeln!(out, "    real {part} = {name}.{component}{origin};");
                        }
                    }
                }
            }
            self.load(&mut out, dialect, "g_", self.global_names, &outputs, |i| format!("model_global({i})"));
            self.reduce(&mut out, dialect, &outputs, "for (int source = 0; source < model_source_count(); ++source)", |i| {
                format!("model_source(source, {i})")
            });
            self.read_table(&mut out, dialect, &outputs);
            let (body, names) = statements(dialect, "t", &outputs);
            out.push_str(&body);
            let values = f.values(names, ("real3(", ")"));
            if returned == "void" {
                for ((name, _), value) in f.results.iter().zip(&values) {
                    let _ = writeln!(out, "    out_{name} = {value};");
                }
                out.push_str("}\n\n");
            } else {
                let _ = writeln!(out, "    return {};\n}}\n", values[0]);
            }
        }
        out
    }

    /// A Rust `impl Model` for the model `name` over SIMD lanes.
    pub fn rust(&self, name: &str) -> String {
        let mut out = format!(
            "impl Model for crate::spacetime::{name} {{\n    const KIND: crate::spacetime::ModelKind = crate::spacetime::ModelKind::{name};\n"
        );
        for f in &self.functions {
            let outputs = f.outputs();
            let arguments: String = f.arguments.iter().map(|a| format!(", {}: {}", a.name(), a.rust_type())).collect();
            let result_type = |r: &[Expr]| if r.len() == 3 { "[L; 3]" } else { "L" };
            let types: Vec<&str> = f.results.iter().map(|(_, r)| result_type(r)).collect();
            let returned = if let [only] = types.as_slice() { (*only).to_owned() } else { format!("({})", types.join(", ")) };
            let _ = writeln!(
                out,
                "    #[inline(always)]\n    #[allow(unused_variables, reason = \"a model need not read everything\")]\n    fn {}<L: Lane>(token: L::Token, model: &ModelBlock<L::Real>{arguments}) -> {returned} {{",
                f.name
            );
            for argument in f.arguments {
                if let Argument::Vector(name, parts) = argument {
                    for (i, part) in parts.iter().enumerate() {
                        let origin = if *name == "position" { format!(" - L::splat(token, model.origin[{i}])") } else { String::new() };
                        let _ = writeln!(out, "    let {part} = {name}[{i}]{origin};");
                    }
                }
            }
            self.load(&mut out, Dialect::Rust, "g_", self.global_names, &outputs, |i| format!("L::splat(token, model.global[{i}])"));
            let stride = self.source_names.len();
            self.reduce(&mut out, Dialect::Rust, &outputs, &format!("for source in model.sources.chunks_exact({stride})"), |i| {
                format!("L::splat(token, source[{i}])")
            });
            self.read_table(&mut out, Dialect::Rust, &outputs);
            let (body, names) = statements(Dialect::Rust, "t", &outputs);
            out.push_str(&body);
            let values = f.values(names, ("[", "]"));
            let _ = if let [only] = values.as_slice() {
                writeln!(out, "    {only}\n    }}")
            } else {
                writeln!(out, "    ({})\n    }}", values.join(", "))
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

    /// Reads the table where `outputs` use its entries.
    fn read_table(&self, out: &mut String, dialect: Dialect, outputs: &[Expr]) {
        let Some(point) = self.table_point.filter(|_| TABLE_ENTRIES.iter().any(|n| reads(outputs, n))) else { return };
        let (body, at) = statements(dialect, "u", &point);
        out.push_str(&body);
        let list = |names: [&str; 3]| names.join(", ");
        if dialect == Dialect::Rust {
            let _ = writeln!(
                out,
                "    let ([{}], [{}], [{}]) = crate::kernels::table::table_lookup(token, &model.table, {}, {});",
                list(TABLE_ENTRIES),
                list(TABLE_BY_U),
                list(TABLE_BY_V),
                at[0],
                at[1]
            );
            return;
        }
        let _ = writeln!(
            out,
            "    real3 table_value, table_u, table_v;\n    table_lookup({}, {}, table_value, table_u, table_v);",
            at[0], at[1]
        );
        for (names, vector) in [(TABLE_ENTRIES, "table_value"), (TABLE_BY_U, "table_u"), (TABLE_BY_V, "table_v")] {
            for (name, component) in names.iter().zip(["x", "y", "z"]) {
                let _ = writeln!(out, "    real {name} = {vector}.{component};");
            }
        }
    }

    /// Which loop over the sources `outputs` need.
    fn reduction(&self, outputs: &[Expr]) -> Reduction {
        if self.source_names.is_empty() {
            return Reduction::None;
        }
        if reads(outputs, SOURCE_STEPS[0]) {
            return Reduction::SafeStep;
        }
        let gradient = reads(outputs, "potential_x");
        if gradient || reads(outputs, "potential") { Reduction::Potential { gradient } } else { Reduction::None }
    }

    /// Writes the loop over the sources.
    fn reduce(&self, out: &mut String, dialect: Dialect, outputs: &[Expr], header: &str, value: impl Fn(usize) -> String) {
        let variable = if dialect == Dialect::Rust { "let mut" } else { "real" };
        let (terms, targets, combine): (Vec<Expr>, Vec<&str>, &str) = match self.reduction(outputs) {
            Reduction::None => {
                return;
            }
            Reduction::Potential { gradient: false } => (vec![self.source_potential], vec!["potential"], "+"),
            Reduction::Potential { gradient: true } => {
                let [gx, gy, gz] = gradient(self.source_potential, ["x", "y", "z"].map(Expr::input));
                (vec![self.source_potential, gx, gy, gz], vec!["potential", "potential_x", "potential_y", "potential_z"], "+")
            }
            Reduction::SafeStep => (self.source_steps.to_vec(), SOURCE_STEPS.to_vec(), "min"),
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

impl Function {
    fn outputs(&self) -> Vec<Expr> {
        self.results.iter().flat_map(|(_, r)| r.iter().copied()).collect()
    }

    /// The text of each result, given the names of all outputs and what a vector's components are put between.
    fn values(&self, names: Vec<String>, (open, close): (&str, &str)) -> Vec<String> {
        let mut names = names.into_iter();
        let value = |length: usize| {
            let parts: Vec<String> = names.by_ref().take(length).collect();
            if length == 3 { format!("{open}{}{close}", parts.join(", ")) } else { parts.concat() }
        };
        self.results.iter().map(|(_, r)| r.len()).map(value).collect()
    }
}

impl Argument {
    fn name(&self) -> &'static str {
        match self {
            Argument::Vector(name, _) | Argument::Number(name) => name,
        }
    }
    fn glsl_type(&self) -> &'static str {
        match self {
            Argument::Vector(..) => "real3",
            Argument::Number(_) => "real",
        }
    }
    fn rust_type(&self) -> &'static str {
        match self {
            Argument::Vector(..) => "[L; 3]",
            Argument::Number(_) => "L",
        }
    }
}
