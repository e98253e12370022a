//! Formulas as a record: every operation is a node. Values, gradients, program text and contracts are made from the
//! nodes.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::number::{Function, Number};

/// Input of a formula.
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
    /// Entry k of the upstream gradient in an adjoint.
    By(usize),
    /// World coordinate (m) of a point given in a link's frame (m).
    Place { link: usize, local: [f64; 3], axis: usize },
    /// Distance (m) of a contact point from the scene, radius not subtracted.
    Distance(usize),
    /// Height (m) of the ground at distances (m) ahead of a free root and to its left. Held constant in gradients.
    Ground([f64; 2]),
    /// Number k that the task computes in plain code.
    Plain(usize),
    /// Torque i that controller call `call` gives.
    Controlled { call: usize, i: usize },
    /// Gradient with respect to entry i of the action of a controller call. List `by` holds the gradient with respect
    /// to the call's torques.
    Pushed { call: usize, by: usize, i: usize },
}

/// A constant, or the value of a node.
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

/// The recorded nodes of a formula.
#[derive(Debug, Default)]
pub struct Tape {
    pub(crate) nodes: RefCell<Vec<Node>>,
    /// Lists of numbers: the actions of a controller call, or the gradient with respect to its torques.
    pub(crate) lists: RefCell<Vec<Vec<Given>>>,
    /// Error text for the first index out of range, if any.
    pub(crate) wrong: RefCell<Option<String>>,
}

impl Tape {
    fn push(&self, node: Node) -> Traced<'_> {
        let mut nodes = self.nodes.borrow_mut();
        nodes.push(node);
        Traced::Node(self, nodes.len() - 1)
    }

    pub(crate) fn leaf(&self, leaf: Leaf) -> Traced<'_> {
        self.push(Node::Leaf(leaf))
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

/// A recorded number of a formula.
#[derive(Clone, Copy, Debug)]
pub enum Traced<'a> {
    /// A constant.
    Number(f64),
    /// The value of the node with this index on the tape.
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
}

macro_rules! operators {
    ($($operator:ident $method:ident),+) => { $(
        impl $operator for Traced<'_> {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                self.made(Function::$operator, other)
            }
        }

        impl $operator<f64> for Traced<'_> {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                self.made(Function::$operator, other.into())
            }
        }

        impl<'a> $operator<Traced<'a>> for f64 {
            type Output = Traced<'a>;
            fn $method(self, other: Traced<'a>) -> Traced<'a> {
                Traced::from(self).made(Function::$operator, other)
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
        match (f, self, other) {
            (_, Self::Number(a), Self::Number(b)) => Self::Number(a.made(f, b)),
            (Function::Mul, Self::Number(1.0), x) | (Function::Mul, x, Self::Number(1.0)) => x,
            (_, Self::Node(tape, _), _) | (_, _, Self::Node(tape, _)) => {
                tape.push(Node::Made(f, [self.given(), other.given()]))
            }
        }
    }
}
