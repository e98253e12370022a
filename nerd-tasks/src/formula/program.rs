//! A recorded formula.

use super::Number;
use super::tape::{Given, Leaf, Node, Tape, Traced};

/// Steps and results of a formula.
#[derive(Clone, Debug, Default)]
pub(crate) struct Program {
    pub nodes: Vec<Node>,
    /// Actions of each call of the controller.
    pub lists: Vec<Vec<Given>>,
    pub out: Vec<Given>,
}

impl Program {
    /// Takes all nodes from a tape, with `out` as results.
    pub fn of(tape: &Tape, out: &[Traced]) -> Self {
        Self { nodes: tape.nodes.take(), lists: tape.lists.take(), out: out.iter().map(|x| x.given()).collect() }
    }

    /// Records the formula anew on `tape`, with `action` and `torques` in place of its inputs.
    pub fn replay<'a>(&self, tape: &'a Tape, action: &[Traced<'a>], torques: &[Traced<'a>]) -> Vec<Traced<'a>> {
        let mut all: Vec<Traced> = Vec::with_capacity(self.nodes.len());
        let mut now = 0;
        let traced = |all: &[Traced<'a>], x: &Given| match *x {
            Given::Known(x) => Traced::Number(x),
            Given::Node(k) => all[k],
        };
        for node in &self.nodes {
            all.push(match *node {
                Node::Made(f, [a, b]) => traced(&all, &a).made(f, traced(&all, &b)),
                Node::Leaf(Leaf::Action(k)) => action[k],
                Node::Leaf(Leaf::Torque(k)) => torques[k],
                Node::Leaf(Leaf::Controlled { call, i }) => {
                    if i == 0 {
                        now = tape.list(&self.lists[call].iter().map(|x| traced(&all, x)).collect::<Vec<_>>());
                    }
                    tape.leaf(Leaf::Controlled { call: now, i })
                }
                Node::Leaf(leaf) => tape.leaf(leaf),
            });
        }
        self.out.iter().map(|x| traced(&all, x)).collect()
    }

    /// Whether the formula reads numbers that the task computes in plain code ([`crate::Plain`]).
    pub fn plain(&self) -> bool {
        self.nodes.iter().any(|node| matches!(node, Node::Leaf(Leaf::Plain(_))))
    }
}
