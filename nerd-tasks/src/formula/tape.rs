//! Formulas as a record: every operation is a node, of which values, slopes and text are made.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::number::{Function, Number};

/// A number that a formula is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Leaf {
    /// Number k of the state.
    State(usize),
    /// Of the goal.
    Goal(usize),
    /// Of the action.
    Action(usize),
    /// Of the torques of the last frame.
    Torque(usize),
    /// Of the gradient that a way back begins with.
    By(usize),
    /// A coordinate of a point of a link, given in its own axes.
    Place { link: usize, local: [f64; 3], axis: usize },
    /// How far a contact point is from the scene.
    Distance(usize),
    /// Height of the ground so far ahead of a free root and to its left. It counts as constant.
    Ground([f64; 2]),
    /// Torque i of a call of the controller, one after the other.
    Controlled { call: usize, i: usize },
    /// Gradient by number i of the action of a call, `by` its torques.
    Pushed { call: usize, by: usize, i: usize },
}

/// A number that is known, or one of a node.
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

/// The nodes so far, each with its value where those of leaves are known.
#[derive(Debug, Default)]
pub struct Tape {
    pub(crate) nodes: RefCell<Vec<(Node, f64)>>,
    /// Actions of calls of the controller, and gradients by their torques.
    pub(crate) lists: RefCell<Vec<Vec<Given>>>,
    /// What reaches too far.
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

    /// Whether number k of so many is one of them.
    pub(crate) fn among(&self, what: &str, k: usize, count: usize) {
        if k >= count {
            self.wrong.borrow_mut().get_or_insert_with(|| format!("number {k} of {count} {what} is asked for"));
        }
    }
}

/// A number of a formula that is recorded.
#[derive(Clone, Copy, Debug)]
pub enum Traced<'a> {
    /// Known beforehand.
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
