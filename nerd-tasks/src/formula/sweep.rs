//! The adjoint sweep over recorded formulas, for any number type. Plain numbers give gradients; recorded numbers give a
//! program that computes gradients.

use super::Number;
use super::tape::{Given, Leaf, Node};

/// Values and gradient accumulators of an adjoint sweep.
pub(crate) trait Ends<N> {
    /// Value of a node.
    fn value(&self, node: usize) -> N;
    /// Receives the gradient with respect to a leaf.
    fn leaf(&mut self, leaf: Leaf, by: N);
    /// Gradient with respect to the action of a controller call, from the gradient with respect to its torques.
    fn controlled(&mut self, call: usize, by: &[N]) -> Vec<N>;
}

/// Propagates gradients `seeds` with respect to results back to the leaves of `nodes`. `lists` are the actions of
/// controller calls.
pub(crate) fn sweep<N: Number>(nodes: &[Node], lists: &[Vec<Given>], seeds: &[(Given, N)], ends: &mut impl Ends<N>) {
    let mut by: Vec<Option<N>> = vec![None; nodes.len()];
    let add = |by: &mut Vec<Option<N>>, at: Given, g: N| {
        if let Given::Node(k) = at {
            by[k] = Some(by[k].map_or(g, |sum| sum + g));
        }
    };
    seeds.iter().for_each(|(at, g)| add(&mut by, *at, *g));
    for k in (0..nodes.len()).rev() {
        match (nodes[k], by[k]) {
            // The torques of one controller call are consecutive nodes; the sweep reaches the first one (i = 0) last.
            (Node::Leaf(Leaf::Controlled { call, i: 0 }), _) => {
                let of = &by[k..k + lists[call].len()];
                if of.iter().any(Option::is_some) {
                    let of: Vec<N> = of.iter().map(|g| g.unwrap_or(N::from(0.0))).collect();
                    let by_action = ends.controlled(call, &of);
                    lists[call].iter().zip(by_action).for_each(|(at, g)| add(&mut by, *at, g));
                }
            }
            (Node::Leaf(leaf), Some(g)) => ends.leaf(leaf, g),
            (Node::Made(f, both), Some(g)) => {
                let [a, b] = both.map(|of| match of {
                    Given::Known(x) => N::from(x),
                    Given::Node(k) => ends.value(k),
                });
                for (at, gradient) in both.into_iter().zip(f.gradients(a, b, ends.value(k))) {
                    if let (Some(gradient), Given::Node(_)) = (gradient, at) {
                        add(&mut by, at, g * gradient);
                    }
                }
            }
            _ => (),
        }
    }
}
