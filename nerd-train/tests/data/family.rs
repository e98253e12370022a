//! Robots of a family beside solvers that know them more or less.

use nerd_sim::rig::Rig;
use nerd_train::evaluate::Pieces;

use crate::*;

#[test]
fn who_knows_more_errs_less_and_the_truth_errs_nothing() {
    let system = System::named("pendulum-family").expect("built in");
    let config = GenerateConfig { transitions: 24 * 30, frames: 30, resets: 1.0, hold: 8, seed: 5, ..Default::default() };
    let pieces = Pieces::drawn(&system, Truth::Articulated, &config, 10).expect("recorded");
    assert_eq!((pieces.count(), pieces.frames(), pieces.systems.len()), (24, 20, 24));
    let solver = || Articulated::new(ArticulatedConfig::accurate(&system));
    let error = |pieces: &Pieces, solver: &mut dyn Solver| mean(&pieces.compare(solver).expect("compared").error);
    // Torques that act late by two frames at most: three seen are enough.
    for seen in [10, 3, 2] {
        let exact = error(&pieces.seen(seen), &mut Rig::new(solver()));
        assert!(exact < 1e-9, "seen {seen}: {exact}");
    }
    let ignorant = error(&pieces.seen(0), &mut Rig::new(solver()));
    let told = error(&pieces.told(), &mut Rig::new(solver()));
    let described = error(&pieces.described(), &mut solver());
    assert!(ignorant > 1e-6, "late torques are known without having been seen: {ignorant}");
    assert!(told > 1e-6 && told < 0.7 * described, "told {told}, as described {described}");
    // The last frames are the same whatever is shown before them.
    let [long, short] = [pieces.seen(99), pieces.seen(4)];
    assert_eq!(long.states[long.before..], short.states[short.before..]);
    let refused = Pieces::drawn(&system, Truth::Articulated, &config, 30).map(|_| ());
    assert!(refused.expect_err("too few frames").to_string().contains("30 frames"));
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}
