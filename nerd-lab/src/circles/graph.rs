//! Circles in a graph of names, and the cheapest edges to cut.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Edges from a name to names, each with how many uses stand behind it.
pub type Graph = BTreeMap<String, BTreeMap<String, usize>>;

/// Sets of names that all reach each other, the largest first.
pub fn components(graph: &Graph) -> Vec<BTreeSet<String>> {
    let reach: BTreeMap<&String, BTreeSet<&String>> = graph.keys().map(|from| (from, reached(graph, from))).collect();
    let mut sets = BTreeSet::new();
    for (from, to) in &reach {
        let both: BTreeSet<String> =
            to.iter().filter(|other| reach.get(*other).is_some_and(|r| r.contains(from))).map(|s| s.to_string()).collect();
        if !both.is_empty() {
            sets.insert(both);
        }
    }
    let mut sets: Vec<_> = sets.into_iter().collect();
    sets.sort_by_key(|set| std::cmp::Reverse(set.len()));
    sets
}

fn reached<'a>(graph: &'a Graph, from: &'a String) -> BTreeSet<&'a String> {
    let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(name) = open.pop() {
        for next in graph.get(name).into_iter().flat_map(BTreeMap::keys) {
            if seen.insert(next) {
                open.push(next);
            }
        }
    }
    seen
}

/// Circles, the shortest first, until cutting the edge of fewest uses in each leaves none. That edge is a circle's last step.
pub fn circles(graph: &Graph, within: &BTreeSet<String>) -> Vec<Vec<String>> {
    let inside =
        |edges: &BTreeMap<String, usize>| edges.iter().filter(|(to, _)| within.contains(*to)).map(|(to, n)| (to.clone(), *n)).collect();
    let mut graph: Graph =
        graph.iter().filter(|(from, _)| within.contains(*from)).map(|(from, edges)| (from.clone(), inside(edges))).collect();
    let mut all = Vec::new();
    while let Some(mut circle) = graph.keys().filter_map(|name| shortest(&graph, name)).min_by_key(Vec::len) {
        let n = circle.len();
        let cost = |k: usize| graph[&circle[k]][&circle[(k + 1) % n]];
        let cheapest = (0..n).min_by_key(|k| cost(*k)).unwrap_or(0);
        circle.rotate_left((cheapest + 1) % n);
        if let Some(edges) = graph.get_mut(&circle[n - 1]) {
            edges.remove(&circle[0]);
        }
        all.push(circle);
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
