//! Reverse-mode differentiation of a formula (Griewank and Walther, "Evaluating Derivatives", chapter 3).

use super::{Expr, Node};
use crate::spacetime::Scalar;
use std::collections::HashMap;

/// Partial derivatives of `output` by each of `inputs`.
///
/// Nodes are visited from the output down: arena order is topological, so a node's adjoint is complete when it is reached.
/// At the kinks of min, max and select the derivative of the chosen branch is taken.
pub fn gradient<const N: usize>(output: Expr, inputs: [Expr; N]) -> [Expr; N] {
    let zero = Expr::constant(0.0);
    let one = Expr::constant(1.0);
    let mut adjoints: HashMap<Expr, Expr> = HashMap::from([(output, one)]);
    for id in (0..=output.0).rev() {
        let expr = Expr(id);
        let Some(&adjoint) = adjoints.get(&expr) else { continue };
        let mut give = |to: Expr, amount: Expr| {
            let sum = adjoints.get(&to).copied().unwrap_or(zero) + amount;
            adjoints.insert(to, sum);
        };
        match expr.node() {
            Node::Constant(_) | Node::Input(_) | Node::Held(_) => {}
            Node::Add(a, b) => {
                give(a, adjoint);
                give(b, adjoint);
            }
            Node::Sub(a, b) => {
                give(a, adjoint);
                give(b, -adjoint);
            }
            Node::Mul(a, b) if a == b => give(a, adjoint * Expr::constant(2.0) * a),
            Node::Mul(a, b) => {
                give(a, adjoint * b);
                give(b, adjoint * a);
            }
            Node::Div(a, b) => {
                let share = adjoint / b;
                give(a, share);
                give(b, -(share * expr));
            }
            Node::Neg(a) => give(a, -adjoint),
            Node::Sqrt(a) => give(a, adjoint * Expr::constant(0.5) / expr),
            Node::Exp(a) => give(a, adjoint * expr),
            Node::Ln(a) => give(a, adjoint / a),
            Node::Sin(a) => give(a, adjoint * a.cos()),
            Node::Cos(a) => give(a, -(adjoint * a.sin())),
            Node::Atan(a) => give(a, adjoint / (one + a * a)),
            Node::Min(a, b) => {
                give(a, Expr::select_less(a, b, adjoint, zero));
                give(b, Expr::select_less(a, b, zero, adjoint));
            }
            Node::Max(a, b) => {
                give(a, Expr::select_less(a, b, zero, adjoint));
                give(b, Expr::select_less(a, b, adjoint, zero));
            }
            Node::SelectLess(a, b, then, otherwise) => {
                give(then, Expr::select_less(a, b, adjoint, zero));
                give(otherwise, Expr::select_less(a, b, zero, adjoint));
            }
        }
    }
    inputs.map(|input| adjoints.get(&input).copied().unwrap_or(zero))
}
