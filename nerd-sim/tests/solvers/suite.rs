//! The stability suite: known physics passes, and every row can go red.

use nerd_sim::suite::{Fault, Method, Row, Suite, Verdict};
use rayon::prelude::*;

fn must_pass() -> Vec<&'static Row> {
    Suite::new().rows().iter().copied().filter(|r| r.must_pass()).collect()
}

#[test]
fn the_converged_preset_passes_known_physics() {
    let method = Method::converged();
    let failed: Vec<String> = must_pass()
        .par_iter()
        .map(|row| (row, row.cell(&method, None)))
        .filter(|(_, cell)| cell.verdict != Verdict::Pass)
        .map(|(row, cell)| format!("{}: {:?}, limit {}", row.name, (cell.figure, cell.lost), row.limit))
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// Four substeps of 1/240 s do what takes the explicit step 1024: the point of the implicit one.
#[test]
fn four_implicit_substeps_pass_known_physics() {
    let method = Method::known().into_iter().find(|m| m.name() == "implicit x4").expect("a column");
    // Convergence is asked of an accurate preset, and at a runner's speed it shows.
    let asked = must_pass().into_par_iter().filter(|r| !r.name.contains("self-convergence") && r.name != "runner's momentum");
    let cells: Vec<_> = asked.map(|row| (row.name, row.cell(&method, None))).collect();
    let failed: Vec<_> = cells.iter().filter(|(_, c)| c.verdict != Verdict::Pass).map(|(name, c)| (name, c.figure)).collect();
    assert!(failed.is_empty(), "{failed:?}");
}

/// At a runner's speed the reference's preset gives energy for nothing and does not keep momentum. What models are learned from
/// gives no energy and keeps momentum.
#[test]
fn only_the_reference_preset_pays_a_runner() {
    let suite = Suite::new().only(&["runner's"]).expect("rows");
    let lines = suite.run(&[Method::paper(), Method::accurate(), Method::converged()], |_| ());
    assert_eq!(lines.len(), 2, "{lines:?}");
    for line in &lines {
        let verdicts: Vec<_> = line.cells.iter().map(|c| c.verdict).collect();
        assert_eq!(verdicts, [Verdict::Fail, Verdict::Pass, Verdict::Pass], "{}: {:?}, limit {}", line.row, line.cells, line.limit);
    }
}

/// A fault turns the rows red that name it, and leaves the others green.
#[test]
fn every_row_can_go_red() {
    let (method, asked) = (Method::converged(), must_pass());
    let pairs: Vec<(&Row, Fault)> = asked.iter().flat_map(|r| Fault::ALL.map(|f| (*r, f))).collect();
    let wrong: Vec<String> = pairs
        .par_iter()
        .filter_map(|(row, fault)| {
            let cell = row.cell(&method, Some(*fault));
            let red = cell.verdict != Verdict::Pass;
            (red != row.reddens.contains(fault)).then(|| format!("{} under {fault}: {:?}", row.name, (cell.figure, cell.lost)))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A method without finer substeps is not failed for what it cannot be asked; words choose rows, and unknown ones are refused.
#[test]
fn what_cannot_be_asked_is_not_failed() {
    let mine = Method::new("mine", |_| Box::new(nerd_sim::instruments::Hold));
    let lines = Suite::new().only(&["self-convergence", "free fall"]).expect("rows").run(&[mine], |_| ());
    let verdicts: Vec<_> = lines.iter().map(|l| (l.row.as_str(), l.cells[0].verdict)).collect();
    let expected =
        [("free fall", Verdict::Fail), ("pendulum self-convergence", Verdict::Unasked), ("Ant self-convergence", Verdict::Unasked)];
    assert_eq!(verdicts, expected, "{lines:?}");
    let refused = Suite::new().only(&["bowling"]).expect_err("no such row").to_string();
    assert!(refused.contains("bowling") && refused.contains("free fall"), "{refused}");
    for fault in Fault::ALL {
        assert_eq!(fault.name().parse::<Fault>().expect("its name"), fault);
    }
}
