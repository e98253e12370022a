//! Formulas as a record: every operation is a node, from which values, gradients and text are made.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::number::{Function, Number};

/// An input of a formula.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Leaf {
    /// Number k of the state.
    State(usize),
    /// Number k of the goal.
    Goal(usize),
    /// Number k of the action.
    Action(usize),
    /// Number k of the torques of the last frame.
    Torque(usize),
    /// Number k of the upstream gradient of an adjoint.
    By(usize),
    /// A coordinate of a point of a link, given in the link's own axes.
    Place { link: usize, local: [f64; 3], axis: usize },
    /// Distance of a contact point from the scene.
    Distance(usize),
    /// Height of the ground at a distance ahead of a free root and to its left. It is held constant.
    Ground([f64; 2]),
    /// Torque i of a call of the controller.
    Controlled { call: usize, i: usize },
    /// Gradient with respect to number i of the action of a call, from the torques' gradient in list `by`.
    Pushed { call: usize, by: usize, i: usize },
}

/// A known number, or a node's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Given {
    Known(f64),
    Node(usize),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Node {
    Leaf(Leaf),
    Made(Function, [Given; 2]),
}

/// The nodes so far, each with its value if the values of its leaves are known.
#[derive(Debug, Default)]
pub struct Tape {
    pub(crate) nodes: RefCell<Vec<(Node, f64)>>,
    /// Actions of calls of the controller, and gradients with respect to their torques.
    pub(crate) lists: RefCell<Vec<Vec<Given>>>,
    /// The first index out of range, if any.
    pub(crate) wrong: RefCell<Option<String>>,
}

impl Tape {
    fn push(&self, node: Node, value: f64) -> Traced<'_> {
        let mut nodes = self.nodes.borrow_mut();
        nodes.push((node, value));
        Traced::Node(self, nodes.len() - 1)
    }

    pub(crate) fn leaf(&self, leaf: Leaf, value: f64) -> Traced<'_> {
        self.push(Node::Leaf(leaf), value)
    }

    pub(crate) fn list(&self, numbers: &[Traced]) -> usize {
        let mut lists = self.lists.borrow_mut();
        lists.push(numbers.iter().map(|x| x.given()).collect());
        lists.len() - 1
    }

    /// Records an error unless index k is below `count`.
    pub(crate) fn among(&self, what: &str, k: usize, count: usize) {
        if k >= count {
            self.wrong.borrow_mut().get_or_insert_with(|| format!("number {k} of {count} {what} is asked for"));
        }
    }
}

/// A number of a formula that is recorded.
#[derive(Clone, Copy, Debug)]
pub enum Traced<'a> {
    /// Known when recorded.
    Number(f64),
    /// Of this node.
    Node(&'a Tape, usize),
}

impl From<f64> for Traced<'_> {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl<'a> Traced<'a> {
    pub(crate) fn given(self) -> Given {
        match self {
            Self::Number(x) => Given::Known(x),
            Self::Node(_, k) => Given::Node(k),
        }
    }

    pub(crate) fn value(self) -> f64 {
        match self {
            Self::Number(x) => x,
            Self::Node(tape, k) => tape.nodes.borrow()[k].1,
        }
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident),+) => { $(
        impl $operator for Traced<'_> {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                self.made(Function::$operator, other)
            }
        }
    )+ };
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Traced<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self.made(Function::Neg, Self::Number(0.0))
    }
}

impl Number for Traced<'_> {
    fn made(self, f: Function, other: Self) -> Self {
        let value = self.value().made(f, other.value());
        match (f, self, other) {
            (_, Self::Number(_), Self::Number(_)) => Self::Number(value),
            (Function::Mul, Self::Number(1.0), x) | (Function::Mul, x, Self::Number(1.0)) => x,
            (_, Self::Node(tape, _), _) | (_, _, Self::Node(tape, _)) => tape.push(Node::Made(f, [self.given(), other.given()]), value),
        }
    }
}
