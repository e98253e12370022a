//! Circles in a graph of names.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Edges from a name to names, each with how many uses it has.
pub type Graph = BTreeMap<String, BTreeMap<String, usize>>;

/// The shortest circle through each name, once; its last step, back to its first name, is the one of fewest uses.
pub fn circles(graph: &Graph) -> BTreeSet<Vec<String>> {
    let mut all = BTreeSet::new();
    for mut circle in graph.keys().filter_map(|name| shortest(graph, name)) {
        let n = circle.len();
        let uses = |k: usize| (graph[&circle[k]][&circle[(k + 1) % n]], &circle[k]);
        let fewest = (0..n).min_by_key(|k| uses(*k)).unwrap_or(0);
        circle.rotate_left((fewest + 1) % n);
        all.insert(circle);
    }
    all
}

/// The shortest way from a name back to it.
fn shortest(graph: &Graph, start: &String) -> Option<Vec<String>> {
    let (mut before, mut open) = (BTreeMap::<&String, &String>::new(), VecDeque::from([start]));
    while let Some(name) = open.pop_front() {
        for next in graph.get(name).into_iter().flat_map(BTreeMap::keys) {
            if next == start {
                let mut way = vec![name.clone()];
                while let Some(last) = before.get(way.last()?) {
                    way.push(last.to_string());
                }
                way.reverse();
                return Some(way);
            }
            if !before.contains_key(next) {
                before.insert(next, name);
                open.push_back(next);
            }
        }
    }
    None
}
