//! Every row of the stability suite can go red, and what the presets are for.

use nerd_lab::experiments::stability::{Fault, accurate, converged, paper};
use nerd_sim::suite::{Row, Suite, Verdict};
use rayon::prelude::*;

/// At a runner's speed the reference's preset gives energy for nothing and does not keep momentum. What models are learned from
/// gives no energy and keeps momentum.
#[test]
fn only_the_reference_preset_pays_a_runner() {
    let suite = Suite::new().only(&["runner's"]).expect("rows");
    let lines = suite.run(&[paper(), accurate(), converged()], |_| ());
    assert_eq!(lines.len(), 2, "{lines:?}");
    for line in &lines {
        let verdicts: Vec<_> = line.cells.iter().map(|c| c.verdict).collect();
        assert_eq!(verdicts, [Verdict::Fail, Verdict::Pass, Verdict::Pass], "{}: {:?}, limit {}", line.row, line.cells, line.limit);
    }
}

/// A fault turns the rows red that name it, and leaves the others green.
#[test]
fn every_row_can_go_red() {
    let (method, asked) = (converged(), Suite::new().rows().iter().copied().filter(|r| r.must_pass()).collect::<Vec<_>>());
    let pairs: Vec<(&Row, Fault)> = asked.iter().flat_map(|r| Fault::ALL.iter().map(move |f| (*r, *f))).collect();
    let wrong: Vec<String> = pairs
        .par_iter()
        .filter_map(|(row, fault)| {
            let cell = row.cell(&fault.of(method.clone()));
            let red = cell.verdict != Verdict::Pass;
            (red != fault.reddened().contains(&row.name))
                .then(|| format!("{} under {}: {:?}", row.name, fault.name(), (cell.figure, cell.lost)))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
