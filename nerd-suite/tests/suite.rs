//! The stability suite: known physics passes, known faults fail.

use nerd_sim::instruments::Hold;
use nerd_sim::prelude::*;
use nerd_suite::{Method, Row, Suite, Verdict};
use rayon::prelude::*;

fn implicit(substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb))
}

fn implicit_method(substeps: usize) -> Method {
    Method::new("implicit", move |_| Box::new(implicit(substeps)))
}

/// All rows that `asked` selects must pass.
fn passes(method: &Method, asked: impl Fn(&Row) -> bool + Sync) {
    let suite = Suite::new();
    let rows = suite.rows().par_iter().filter(|row| row.must_pass() && asked(row));
    let failed: Vec<String> = rows
        .map(|row| (row, row.cell(method)))
        .inspect(|(row, cell)| println!("{}: {:?}, limit {}", row.name, cell.figure, row.limit))
        .filter(|(_, cell)| cell.verdict != Verdict::Pass)
        .map(|(row, cell)| format!("{}: {:?}, limit {}", row.name, (cell.figure, cell.lost), row.limit))
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn the_converged_preset_passes_known_physics() {
    passes(&implicit_method(128).finer(|_| Box::new(implicit(512))), |_| true);
}

/// Four substeps of 1/240 s achieve what takes the explicit step 1024: the purpose of the implicit step.
#[test]
fn four_implicit_substeps_pass_known_physics() {
    // Self-convergence needs an accurate preset. At a runner's speed the momentum error of four substeps shows.
    passes(&implicit_method(4), |row| !row.name.contains("self-convergence") && row.name != "runner's momentum");
}

/// Round bodies roll, precess and tip alike at any number of substeps, far within the rows' limits.
#[test]
fn round_bodies_move_alike_at_any_number_of_substeps() {
    let rolling = [("level rolling", 1e-12), ("level rolling, energy", 1e-12), ("wheel", 1e-4)];
    let tipping = [("wobbling coin", 2e-3), ("leaning can", 1e-6)];
    for (substeps, few) in [(1, true), (2, true), (8, false), (64, false)] {
        for (name, most) in rolling.iter().chain(tipping.iter().filter(|_| !few)) {
            let row = *Suite::new().rows().iter().find(|row| row.name == *name).expect("a row");
            let figure = row.cell(&implicit_method(substeps)).figure.expect("measured");
            assert!(figure < *most, "{name}, {substeps} substeps: {figure:e}, at most {most:e}");
        }
    }
}

/// Rows that a rigid first-order engine passes at 4 outer steps of 4 iterations.
#[test]
fn rapier_passes_known_physics() {
    let known = "free fall, off-centre spin, precession, gyroscopic energy, pendulum period, drive inertia, joint limit, universal joint, \
                 rest, tip into ground, under terrain, Markov, no number";
    let known: Vec<&str> = known.split(", ").collect();
    assert!(known.iter().all(|name| Suite::new().rows().iter().any(|row| row.name == *name)), "a row of another name");
    passes(&Method::new("rapier", |_| Box::new(Rapier::new(RapierConfig::default()))), |row| known.contains(&row.name));
}

/// A method without finer substeps does not fail rows that need them. Words choose rows, and unknown words are refused.
#[test]
fn what_cannot_be_asked_is_not_failed() {
    let mine = Method::new("mine", |_| Box::new(Hold));
    let lines = Suite::new().only(&["self-convergence", "free fall"]).expect("rows").run(&[mine], |_| ());
    let verdicts: Vec<_> = lines.iter().map(|l| (l.row.as_str(), l.cells[0].verdict)).collect();
    let expected = [
        ("free fall", Verdict::Fail),
        ("pendulum self-convergence", Verdict::Unasked),
        ("Ant self-convergence", Verdict::Unasked),
    ];
    assert_eq!(verdicts, expected, "{lines:?}");
    let said = Suite::new().only(&["bowling"]).expect_err("no such row").to_string();
    assert!(!said.contains('\n') && said.contains("bowling") && said.contains("free fall"), "{said}");
}

/// Rows on energy and sticking detect faults: friction as a drag fails `creep`, a preset without the energy check fails
/// `long steps` and `fast spin`.
#[test]
fn faults_of_energy_and_friction_turn_rows_red() {
    let drag = Method::new("sticking as a drag", |_| {
        Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Huber)))
    });
    let unwatched = Method::new("no watch", |system: &Arc<System>| {
        Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb)))
    });
    for (method, rows) in [(drag, vec!["creep"]), (unwatched, vec!["long steps", "fast spin"])] {
        for name in rows {
            let row = *Suite::new().rows().iter().find(|row| row.name == name).expect("a row");
            let cell = row.cell(&method);
            println!("{}: {name}: {:?}", method.name, cell);
            assert!(cell.verdict != Verdict::Pass, "{}: {name}: {cell:?}", method.name);
        }
    }
}
