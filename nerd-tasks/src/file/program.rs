//! Reduces a formula after reading: drops recorded steps that are unused or duplicates.

use std::collections::HashMap;

use crate::formula::{Given, Leaf, Node, Program, Tape, Traced};

impl Program {
    /// The steps of `tape` on which `out` depends, each once.
    pub fn reduced(tape: &Tape, out: &[Traced]) -> Self {
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
            match nodes[k] {
                // The torques of one controller call are consecutive nodes; keep all of them or none.
                Node::Leaf(Leaf::Controlled { call, i: 0 }) if used[k..k + lists[call].len()].contains(&true) => {
                    used[k..k + lists[call].len()].fill(true);
                    ask(&mut used, &lists[call]);
                }
                Node::Made(_, both) if used[k] => ask(&mut used, &both),
                _ => (),
            }
        }
        let mut kept = Vec::new();
        let mut known = HashMap::<String, usize>::new();
        let mut places = vec![0; nodes.len()];
        let moved = |places: &[usize], x: Given| match x {
            Given::Node(k) => Given::Node(places[k]),
            known => known,
        };
        for k in (0..nodes.len()).filter(|k| used[*k]) {
            let node = match nodes[k] {
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

    /// Whether the result is exactly the torques of one call of the controller.
    pub fn controlled(&self) -> bool {
        let own = |(i, x): (usize, &Given)| matches!(x, Given::Node(k) if self.nodes[*k] == Node::Leaf(Leaf::Controlled { call: 0, i }));
        !self.out.is_empty() && self.out.iter().enumerate().all(own)
    }

    /// The largest goal index that the formula reads, plus one; 0 if it reads none.
    pub fn goals(&self) -> usize {
        let read = |node: &Node| if let Node::Leaf(Leaf::Goal(k)) = node { k + 1 } else { 0 };
        self.nodes.iter().map(read).max().unwrap_or(0)
    }
}
