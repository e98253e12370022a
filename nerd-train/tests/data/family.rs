//! Errors of solvers on robots of a family, by what each solver knows of the robots.

use nerd_sim::rig::Rig;
use nerd_train::evaluate::Pieces;
use nerd_train::stats::mean;

use crate::*;

#[test]
fn who_knows_more_errs_less_and_the_truth_errs_nothing() {
    let system = System::named("pendulum-family").expect("built in");
    let config =
        GenerateConfig { transitions: 24 * 30, frames: 30, resets: 1.0, hold: 8, seed: 5, ..Default::default() };
    let pieces = Pieces::drawn(&system, Truth::Articulated, &config, 10).expect("recorded");
    assert_eq!((pieces.count(), pieces.frames(), pieces.all.systems.len()), (24, 20, 24));
    let solver = || Articulated::new(ArticulatedConfig::accurate(&system));
    let error = |pieces: &Pieces, solver: &mut dyn Solver| mean(&pieces.compare(solver).expect("compared").error);
    // Torques act at most two frames late, so two frames before the start determine them.
    for seen in [10, 3, 2] {
        let exact = error(&pieces.seen(seen), &mut Rig::new(solver()));
        assert!(exact < 1e-9, "seen {seen}: {exact}");
    }
    let ignorant = error(&pieces.seen(0), &mut Rig::new(solver()));
    let told = error(&pieces.told(), &mut Rig::new(solver()));
    let described = error(&pieces.described(), &mut solver());
    assert!(ignorant > 1e-6, "late torques are known without having been seen: {ignorant}");
    assert!(told > 1e-6 && told < 0.7 * described, "told {told}, as described {described}");
    // The last frames are the same, however many frames are shown before them.
    let [long, short] = [pieces.seen(99), pieces.seen(4)];
    assert_eq!(long.all.after(long.before), short.all.after(short.before));
    let refused = Pieces::drawn(&system, Truth::Articulated, &config, 30).map(|_| ());
    assert!(refused.expect_err("too few frames").to_string().contains("30 frames"));
}

/// Sensor noise is on shown states and tokens; targets and compared states have none.
#[test]
fn sensors_with_noise_show_what_nobody_is_judged_by() {
    let mut system = (*System::named("pendulum-family").expect("built in")).clone();
    let vary = system.spec.vary.as_mut().expect("a family");
    (vary.noise, vary.zero) = (Some(Range { low: 0.004, high: 0.004 }), None);
    let system = Arc::new(system);
    let config = GenerateConfig { transitions: 24 * 30, frames: 30, hold: 8, seed: 5, ..Default::default() };
    let (pieces, recording) = (
        Pieces::drawn(&system, Truth::Articulated, &config, 10).expect("recorded"),
        nerd_sim::dataset::record(&system, &mut *Truth::Articulated.solver(&system), &config, 0, 24).expect("recorded"),
    );
    let (mut clean, d) = (recording.clone(), system.robot.state_dim());
    clean.shown.clear();
    let apart = |frame: usize| {
        let gap = |k: usize| {
            let [a, b] = [pieces.all.state(k, frame), recording.state(k, frame)];
            (0..2).map(|i| nerd_core::state::wrap(a[i] - b[i]).abs()).fold(0.0, f64::max)
        };
        (0..24).map(gap).fold(0.0, f64::max)
    };
    assert!((0..10).all(|frame| apart(frame) > 0.004) && (10..=30).all(|frame| apart(frame) == 0.0));
    let [seen, real] = [&recording, &clean].map(|r| tokens(&system, r, 1, Base::Trapezoid));
    assert!(
        seen.y == real.y && seen.x.chunks(seen.inputs).zip(real.x.chunks(seen.inputs)).all(|(a, b)| a[..d] != b[..d])
    );
    let exact =
        pieces.compare(&mut Rig::new(Articulated::new(ArticulatedConfig::accurate(&system)))).expect("compared");
    assert!(mean(&exact.error) < 1e-9, "{:?}", exact.error);
}
