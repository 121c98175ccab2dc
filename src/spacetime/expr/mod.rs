//! Formulas as a graph: build, differentiate, emit.
//!
//! [`Expr`] is a number in a per-thread arena of hash-consed nodes, so equal subexpressions are one node. Constants are folded
//! and identities removed as the graph is built. [`gradient`] is reverse-mode differentiation; [`emit`] writes straight-line code.

mod derive;
pub mod emit;
pub mod model;

use super::scalar::Scalar;
use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::{Add, Div, Mul, Neg, Sub};

pub use derive::gradient;

/// One operation of the graph. Operands come before their users in the arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Node {
    Constant(u64),
    Input(&'static str),
    Add(Expr, Expr),
    Sub(Expr, Expr),
    Mul(Expr, Expr),
    Div(Expr, Expr),
    Neg(Expr),
    /// The same value, a constant to [`gradient`].
    Held(Expr),
    Sqrt(Expr),
    Exp(Expr),
    Ln(Expr),
    Sin(Expr),
    Cos(Expr),
    Atan(Expr),
    Min(Expr, Expr),
    Max(Expr, Expr),
    /// (a, b, then, otherwise): `then` where a < b.
    SelectLess(Expr, Expr, Expr, Expr),
}

/// A formula: the index of its root node in this thread's arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Expr(pub(crate) u32);

#[derive(Default)]
struct Arena {
    nodes: Vec<Node>,
    index: HashMap<Node, Expr>,
}

thread_local! {
    static ARENA: RefCell<Arena> = RefCell::default();
}

impl Expr {
    /// A run-time value, named as the emitted code will name it.
    pub fn input(name: &'static str) -> Expr {
        Expr::intern(Node::Input(name))
    }

    fn intern(node: Node) -> Expr {
        ARENA.with_borrow_mut(|arena| {
            let next = Expr(arena.nodes.len() as u32);
            let found = *arena.index.entry(node).or_insert(next);
            if found == next {
                arena.nodes.push(node);
            }
            found
        })
    }

    pub(crate) fn node(self) -> Node {
        ARENA.with_borrow(|arena| arena.nodes[self.0 as usize])
    }

    /// A constant times a formula that is none; two constant factors become one.
    fn scaled(self, factor: f64) -> Expr {
        match (factor, self.node()) {
            (0.0, _) => Expr::constant(0.0),
            (1.0, _) => self,
            (-1.0, _) => -self,
            (_, Node::Neg(a)) => -a.scaled(factor),
            (_, Node::Mul(a, b)) => match (a.value(), b.value()) {
                (Some(c), _) => b.scaled(c * factor),
                (_, Some(c)) => a.scaled(c * factor),
                _ => self.product(Expr::constant(factor)),
            },
            _ => self.product(Expr::constant(factor)),
        }
    }

    fn product(self, other: Expr) -> Expr {
        let (a, b) = ordered(self, other);
        Expr::intern(Node::Mul(a, b))
    }

    fn value(self) -> Option<f64> {
        match self.node() {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }
}

/// Puts the operands of a commutative operation in one order, so that a + b and b + a are one node.
fn ordered(a: Expr, b: Expr) -> (Expr, Expr) {
    if a <= b { (a, b) } else { (b, a) }
}

impl Add for Expr {
    type Output = Expr;
    fn add(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a + b),
            (Some(0.0), _) => other,
            (_, Some(0.0)) => self,
            _ => match (self.node(), other.node()) {
                (_, Node::Neg(b)) => self - b,
                (Node::Neg(a), _) => other - a,
                _ => {
                    let (a, b) = ordered(self, other);
                    Expr::intern(Node::Add(a, b))
                }
            },
        }
    }
}

impl Sub for Expr {
    type Output = Expr;
    fn sub(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a - b),
            (Some(0.0), _) => -other,
            (_, Some(0.0)) => self,
            _ if self == other => Expr::constant(0.0),
            _ => match other.node() {
                Node::Neg(b) => self + b,
                _ => Expr::intern(Node::Sub(self, other)),
            },
        }
    }
}

impl Mul for Expr {
    type Output = Expr;
    fn mul(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a * b),
            (Some(factor), _) => other.scaled(factor),
            (_, Some(factor)) => self.scaled(factor),
            _ => match (self.node(), other.node()) {
                (Node::Neg(a), _) => -(a * other),
                (_, Node::Neg(b)) => -(self * b),
                _ => self.product(other),
            },
        }
    }
}

impl Div for Expr {
    type Output = Expr;
    fn div(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a / b),
            (Some(0.0), _) => Expr::constant(0.0),
            (_, Some(b)) => self * Expr::constant(1.0 / b),
            _ => match self.node() {
                Node::Neg(a) => -(a / other),
                _ => Expr::intern(Node::Div(self, other)),
            },
        }
    }
}

impl Neg for Expr {
    type Output = Expr;
    fn neg(self) -> Expr {
        match self.node() {
            Node::Constant(bits) => Expr::constant(-f64::from_bits(bits)),
            Node::Neg(a) => a,
            Node::Sub(a, b) => b - a,
            _ => Expr::intern(Node::Neg(self)),
        }
    }
}

impl Scalar for Expr {
    fn constant(value: f64) -> Expr {
        // -0.0 and 0.0 are one node.
        Expr::intern(Node::Constant((value + 0.0).to_bits()))
    }
    fn sqrt(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.sqrt()),
            None => Expr::intern(Node::Sqrt(self)),
        }
    }
    fn exp(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.exp()),
            None => Expr::intern(Node::Exp(self)),
        }
    }
    fn ln(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.ln()),
            None => Expr::intern(Node::Ln(self)),
        }
    }
    fn sin(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.sin()),
            None => Expr::intern(Node::Sin(self)),
        }
    }
    fn cos(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.cos()),
            None => Expr::intern(Node::Cos(self)),
        }
    }
    fn atan(self) -> Expr {
        match self.value() {
            Some(v) => Expr::constant(v.atan()),
            None => Expr::intern(Node::Atan(self)),
        }
    }
    fn min(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a.min(b)),
            _ => Expr::intern(Node::Min(self, other)),
        }
    }
    fn max(self, other: Expr) -> Expr {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Expr::constant(a.max(b)),
            _ => Expr::intern(Node::Max(self, other)),
        }
    }
    fn select_less(a: Expr, b: Expr, then: Expr, otherwise: Expr) -> Expr {
        match (a.value(), b.value()) {
            _ if then == otherwise => then,
            (Some(x), Some(y)) => {
                if x < y {
                    then
                } else {
                    otherwise
                }
            }
            _ => Expr::intern(Node::SelectLess(a, b, then, otherwise)),
        }
    }
    fn held(self) -> Expr {
        Expr::intern(Node::Held(self))
    }
}
