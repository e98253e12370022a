//! The stability suite: known physics passes.

use nerd_sim::prelude::*;
use nerd_sim::suite::{Method, Row, Suite, Verdict};
use rayon::prelude::*;

fn implicit(substeps: usize) -> Method {
    Method::new("implicit", move |_| Box::new(Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb))))
}

fn must_pass() -> Vec<&'static Row> {
    Suite::new().rows().iter().copied().filter(|r| r.must_pass()).collect()
}

#[test]
fn the_converged_preset_passes_known_physics() {
    let method = implicit(128).finer(|_| Box::new(Articulated::new(ArticulatedConfig::implicit(512, Friction::Coulomb))));
    let failed: Vec<String> = must_pass()
        .par_iter()
        .map(|row| (row, row.cell(&method)))
        .filter(|(_, cell)| cell.verdict != Verdict::Pass)
        .map(|(row, cell)| format!("{}: {:?}, limit {}", row.name, (cell.figure, cell.lost), row.limit))
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// Four substeps of 1/240 s do what takes the explicit step 1024: the point of the implicit one.
#[test]
fn four_implicit_substeps_pass_known_physics() {
    let method = implicit(4);
    // Convergence is asked of an accurate preset, and at a runner's speed it shows.
    let asked = must_pass().into_par_iter().filter(|r| !r.name.contains("self-convergence") && r.name != "runner's momentum");
    let cells: Vec<_> = asked.map(|row| (row.name, row.cell(&method))).collect();
    let failed: Vec<_> = cells.iter().filter(|(_, c)| c.verdict != Verdict::Pass).map(|(name, c)| (name, c.figure)).collect();
    assert!(failed.is_empty(), "{failed:?}");
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
}
