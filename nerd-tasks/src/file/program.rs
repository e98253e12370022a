//! A formula after reading: recorded steps, without unused and duplicate ones, to be evaluated for any kind of number.

use std::collections::HashMap;

use crate::formula::{Given, Leaf, Node, Number, Sight, Tape, Traced};

/// The steps, and the results they compute.
#[derive(Clone, Debug, Default)]
pub(super) struct Program {
    nodes: Vec<Node>,
    /// Actions of calls of the controller.
    lists: Vec<Vec<Given>>,
    out: Vec<Given>,
}

impl Program {
    /// The part of a tape that `out` depends on.
    pub fn of(tape: &Tape, out: &[Traced]) -> Self {
        let (nodes, lists) = (tape.nodes.borrow(), tape.lists.borrow());
        let out: Vec<Given> = out.iter().map(|x| x.given()).collect();
        let mut used = vec![false; nodes.len()];
        let ask = |used: &mut Vec<bool>, of: &[Given]| {
            of.iter().for_each(|x| {
                if let Given::Node(k) = x {
                    used[*k] = true
                }
            });
        };
        ask(&mut used, &out);
        for k in (0..nodes.len()).rev() {
            match nodes[k].0 {
                // The torques of a call are consecutive; all of them are kept or none.
                Node::Leaf(Leaf::Controlled { call, i: 0 }) if used[k..k + lists[call].len()].contains(&true) => {
                    used[k..k + lists[call].len()].fill(true);
                    ask(&mut used, &lists[call]);
                }
                Node::Made(_, both) if used[k] => ask(&mut used, &both),
                _ => (),
            }
        }
        let (mut kept, mut known, mut places) = (Vec::new(), HashMap::<String, usize>::new(), vec![0; nodes.len()]);
        let moved = |places: &[usize], x: Given| match x {
            Given::Node(k) => Given::Node(places[k]),
            known => known,
        };
        for k in (0..nodes.len()).filter(|k| used[*k]) {
            let node = match nodes[k].0 {
                Node::Made(f, both) => Node::Made(f, both.map(|x| moved(&places, x))),
                leaf => leaf,
            };
            places[k] = *known.entry(format!("{node:?}")).or_insert_with(|| {
                kept.push(node);
                kept.len() - 1
            });
        }
        let all = |list: &[Given]| list.iter().map(|x| moved(&places, *x)).collect::<Vec<_>>();
        Self { nodes: kept, lists: lists.iter().map(|list| all(list)).collect(), out: all(&out) }
    }

    /// Whether its result is the torques of one call of the controller and nothing else.
    pub fn controlled(&self) -> bool {
        let own = |(i, x): (usize, &Given)| matches!(x, Given::Node(k) if self.nodes[*k] == Node::Leaf(Leaf::Controlled { call: 0, i }));
        !self.out.is_empty() && self.out.iter().enumerate().all(own)
    }

    /// Evaluates it; `action` and `torques` are given to formulas that use them.
    pub fn run<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &[N]) -> Vec<N> {
        let mut values: Vec<N> = Vec::with_capacity(self.nodes.len());
        let mut place: Option<(usize, [f64; 3], [N; 3])> = None;
        let (mut called, coordinates) = (Vec::new(), sight.system().robot.nq());
        let value = |values: &[N], x: Given| match x {
            Given::Known(x) => N::from(x),
            Given::Node(k) => values[k],
        };
        for node in &self.nodes {
            let next = match *node {
                Node::Made(f, [a, b]) => value(&values, a).made(f, value(&values, b)),
                Node::Leaf(leaf) => match leaf {
                    Leaf::State(k) if k < coordinates => sight.q(k),
                    Leaf::State(k) => sight.qd(k - coordinates),
                    Leaf::Goal(k) => sight.goal(k),
                    Leaf::Action(k) => action[k],
                    Leaf::Torque(k) => torques[k],
                    Leaf::Place { link, local, axis } => {
                        let at = match place {
                            Some((l, p, at)) if (l, p) == (link, local) => at,
                            _ => sight.place(link, local),
                        };
                        place = Some((link, local, at));
                        at[axis]
                    }
                    Leaf::Distance(point) => sight.distance(point),
                    Leaf::Ground(at) => sight.ground(at),
                    Leaf::Controlled { call, i } => {
                        if i == 0 {
                            let action: Vec<N> = self.lists[call].iter().map(|x| value(&values, *x)).collect();
                            called = vec![N::from(0.0); action.len()];
                            sight.controlled(&action, &mut called);
                        }
                        called[i]
                    }
                    // Leaves of adjoints alone.
                    Leaf::By(_) | Leaf::Pushed { .. } => N::from(f64::NAN),
                },
            };
            values.push(next);
        }
        self.out.iter().map(|x| value(&values, *x)).collect()
    }

    /// One more than the largest goal index that it reads.
    pub fn goals(&self) -> usize {
        let read = |node: &Node| if let Node::Leaf(Leaf::Goal(k)) = node { k + 1 } else { 0 };
        self.nodes.iter().map(read).max().unwrap_or(0)
    }

    /// Number of results.
    pub fn len(&self) -> usize {
        self.out.len()
    }
}
