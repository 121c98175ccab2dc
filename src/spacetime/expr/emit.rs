//! Straight-line code from formulas, in GLSL or in Rust over SIMD lanes.

use super::{Expr, Node};
use crate::spacetime::scalar::Scalar;
use std::collections::HashMap;
use std::fmt::Write;

/// The language code is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// GLSL with `real` = float.
    Glsl32,
    /// GLSL with `real` = double.
    Glsl64,
    /// Rust, generic over `L: Lane`, with a `token` in scope.
    Rust,
}

impl Dialect {
    /// A literal of the dialect's number type.
    pub fn constant(self, value: f64) -> String {
        match self {
            Dialect::Glsl32 => format!("{:?}", value as f32),
            Dialect::Glsl64 => format!("{value:?}lf"),
            Dialect::Rust => format!("L::constant(token, {value:?})"),
        }
    }

    fn declaration(self, name: &str, value: &str) -> String {
        match self {
            Dialect::Rust => format!("let {name} = {value};"),
            _ => format!("real {name} = {value};"),
        }
    }

    fn unary(self, function: &str, a: &str) -> String {
        match self {
            Dialect::Rust => format!("{a}.{function}()"),
            _ => match function {
                "sqrt" => format!("sqrt({a})"),
                // GLSL has these for single precision only: math.glsl has them for either.
                _ => format!("real_{function}({a})"),
            },
        }
    }

    fn binary(self, function: &str, a: &str, b: &str) -> String {
        match self {
            Dialect::Rust => format!("{a}.{function}({b})"),
            _ => format!("{function}({a}, {b})"),
        }
    }

    fn multiply_add(self, a: &str, b: &str, c: &str) -> String {
        match self {
            Dialect::Rust => format!("{a}.mul_add({b}, {c})"),
            _ => format!("fma({a}, {b}, {c})"),
        }
    }

    fn select_less(self, a: &str, b: &str, then: &str, otherwise: &str) -> String {
        match self {
            Dialect::Rust => format!("L::select({a}.lt({b}), {then}, {otherwise})"),
            _ => format!("({a} < {b} ? {then} : {otherwise})"),
        }
    }
}

/// Declarations that compute every one of `outputs`, indented by four spaces, and the names that hold them.
///
/// A product used once inside a sum becomes one fused multiply-add, and what is divided by more than once is inverted once. Local names
/// start with `prefix`.
pub fn statements(dialect: Dialect, prefix: &str, outputs: &[Expr]) -> (String, Vec<String>) {
    let outputs = &share_reciprocals(&release(outputs));
    let order = reachable(outputs);
    let uses = count_uses(&order, outputs);
    let fused = |e: Expr| matches!(e.node(), Node::Mul(..)) && uses[&e] == 1;

    // A product is left out where its one user is a sum that fuses it.
    let mut absorbed: HashMap<Expr, bool> = HashMap::new();
    for &expr in &order {
        match expr.node() {
            Node::Add(a, b) | Node::Sub(a, b) => {
                let product = if fused(a) {
                    Some(a)
                } else if fused(b) {
                    Some(b)
                } else {
                    None
                };
                if let Some(product) = product {
                    absorbed.insert(product, true);
                }
            }
            _ => {}
        }
    }

    let mut names: HashMap<Expr, String> = HashMap::new();
    let mut code = String::new();
    for &expr in &order {
        let name = |e: Expr| names[&e].clone();
        let value = match expr.node() {
            Node::Constant(bits) => {
                names.insert(expr, dialect.constant(f64::from_bits(bits)));
                continue;
            }
            Node::Input(input) => {
                names.insert(expr, input.to_owned());
                continue;
            }
            Node::Mul(..) if absorbed.contains_key(&expr) => continue,
            Node::Add(a, b) => match (absorbed.contains_key(&a), absorbed.contains_key(&b)) {
                (true, _) => fuse(dialect, &names, a, &name(b)),
                (_, true) => fuse(dialect, &names, b, &name(a)),
                _ => format!("{} + {}", name(a), name(b)),
            },
            Node::Sub(a, b) => match (absorbed.contains_key(&a), absorbed.contains_key(&b)) {
                (true, _) => fuse(dialect, &names, a, &format!("-{}", name(b))),
                (_, true) => {
                    let Node::Mul(x, y) = b.node() else { continue };
                    dialect.multiply_add(&format!("(-{})", name(x)), &name(y), &name(a))
                }
                _ => format!("{} - {}", name(a), name(b)),
            },
            Node::Mul(a, b) => format!("{} * {}", name(a), name(b)),
            Node::Div(a, b) => format!("{} / {}", name(a), name(b)),
            // `release` has left none.
            Node::Held(a) => name(a),
            Node::Neg(a) => format!("-{}", name(a)),
            Node::Sqrt(a) => dialect.unary("sqrt", &name(a)),
            Node::Exp(a) => dialect.unary("exp", &name(a)),
            Node::Ln(a) => dialect.unary("ln", &name(a)),
            Node::Sin(a) => dialect.unary("sin", &name(a)),
            Node::Cos(a) => dialect.unary("cos", &name(a)),
            Node::Atan(a) => dialect.unary("atan", &name(a)),
            Node::Min(a, b) => dialect.binary("min", &name(a), &name(b)),
            Node::Max(a, b) => dialect.binary("max", &name(a), &name(b)),
            Node::SelectLess(a, b, t, f) => dialect.select_less(&name(a), &name(b), &name(t), &name(f)),
        };
        let local = format!("{prefix}{}", names.len());
        // Writing to a String cannot fail.
        let _ = writeln!(code, "    {}", dialect.declaration(&local, &value));
        names.insert(expr, local);
    }
    let results = outputs.iter().map(|e| names[e].clone()).collect();
    (code, results)
}

/// The same formulas without what only differentiation reads.
fn release(outputs: &[Expr]) -> Vec<Expr> {
    rebuild(outputs, |node, at| if let Node::Held(a) = node { Some(at(a)) } else { None })
}

/// The same formulas with one reciprocal in place of all divisions by a number that more than one of them divide by: registers are
/// divided ten times as slowly as they are multiplied.
fn share_reciprocals(outputs: &[Expr]) -> Vec<Expr> {
    let mut divisions: HashMap<Expr, u32> = HashMap::new();
    for expr in reachable(outputs) {
        if let Node::Div(_, b) = expr.node() {
            *divisions.entry(b).or_default() += 1;
        }
    }
    rebuild(outputs, |node, at| match node {
        Node::Div(a, b) if divisions[&b] > 1 => Some(at(a) * (Expr::constant(1.0) / at(b))),
        _ => None,
    })
}

/// The same formulas, with what `change` puts in place of their nodes; it finds what has become of their operands by the function it is
/// handed.
fn rebuild(outputs: &[Expr], change: impl Fn(Node, &dyn Fn(Expr) -> Expr) -> Option<Expr>) -> Vec<Expr> {
    let mut rebuilt: HashMap<Expr, Expr> = HashMap::new();
    for expr in reachable(outputs) {
        let at = |e: Expr| rebuilt[&e];
        let value = change(expr.node(), &at).unwrap_or_else(|| match expr.node() {
            Node::Constant(_) | Node::Input(_) => expr,
            Node::Add(a, b) => at(a) + at(b),
            Node::Sub(a, b) => at(a) - at(b),
            Node::Mul(a, b) => at(a) * at(b),
            Node::Div(a, b) => at(a) / at(b),
            Node::Neg(a) => -at(a),
            Node::Held(a) => at(a).held(),
            Node::Sqrt(a) => at(a).sqrt(),
            Node::Exp(a) => at(a).exp(),
            Node::Ln(a) => at(a).ln(),
            Node::Sin(a) => at(a).sin(),
            Node::Cos(a) => at(a).cos(),
            Node::Atan(a) => at(a).atan(),
            Node::Min(a, b) => Scalar::min(at(a), at(b)),
            Node::Max(a, b) => Scalar::max(at(a), at(b)),
            Node::SelectLess(a, b, t, f) => Expr::select_less(at(a), at(b), at(t), at(f)),
        });
        rebuilt.insert(expr, value);
    }
    outputs.iter().map(|e| rebuilt[e]).collect()
}

/// Whether any of `outputs` reads the input `name`.
pub fn reads(outputs: &[Expr], name: &str) -> bool {
    reachable(outputs).iter().any(|e| matches!(e.node(), Node::Input(n) if n == name))
}

fn fuse(dialect: Dialect, names: &HashMap<Expr, String>, product: Expr, addend: &str) -> String {
    let Node::Mul(x, y) = product.node() else { return addend.to_owned() };
    dialect.multiply_add(&names[&x], &names[&y], addend)
}

fn operands(expr: Expr) -> Vec<Expr> {
    match expr.node() {
        Node::Constant(_) | Node::Input(_) => vec![],
        Node::Held(a) | Node::Neg(a) | Node::Sqrt(a) | Node::Exp(a) | Node::Ln(a) | Node::Sin(a) | Node::Cos(a) | Node::Atan(a) => vec![a],
        Node::Add(a, b) | Node::Sub(a, b) | Node::Mul(a, b) | Node::Div(a, b) | Node::Min(a, b) | Node::Max(a, b) => {
            vec![a, b]
        }
        Node::SelectLess(a, b, t, f) => vec![a, b, t, f],
    }
}

/// Every node `outputs` depend on, operands first.
fn reachable(outputs: &[Expr]) -> Vec<Expr> {
    let mut seen: std::collections::BTreeSet<Expr> = outputs.iter().copied().collect();
    let mut todo: Vec<Expr> = outputs.to_vec();
    while let Some(expr) = todo.pop() {
        todo.extend(operands(expr).into_iter().filter(|&e| seen.insert(e)));
    }
    seen.into_iter().collect()
}

fn count_uses(order: &[Expr], outputs: &[Expr]) -> HashMap<Expr, u32> {
    let mut uses: HashMap<Expr, u32> = order.iter().map(|&e| (e, 0)).collect();
    for used in order.iter().flat_map(|&e| operands(e)).chain(outputs.iter().copied()) {
        *uses.entry(used).or_default() += 1;
    }
    uses
}
