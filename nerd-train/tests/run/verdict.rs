//! Verdicts: a model that learned nothing has its base's errors, and a linear motion is learned by the linear map.

use nerd_sim::instruments::{Glide, Hold};
use nerd_train::verdict::{Row, Verdict, verdict};

use crate::common::models::model;
use crate::*;

/// The verdict of a model with weights 0, for a robot without a free root.
fn judged(system: &Arc<System>, scene: &str, base: Base, action: Action) -> Verdict {
    let (protocol, mut nothing) = (PassiveConfig { starts: 4, steps: 30, seed: 5, action }, model(system, base));
    nothing.weights.flat.fill(0.0);
    let found = verdict(system, &system.scene(scene).expect("a scene"), &nothing, protocol);
    let found = found.expect("a truth that steps").expect("a verdict");
    println!("{found}\n");
    found
}

/// With weights 0 the model is its base: the error ratio is 1, the model fails, and the verdict advises the solver.
#[test]
fn a_model_that_adds_nothing_is_its_base_and_is_told_so() {
    let system = System::named("pendulum").expect("built in");
    for (base, still) in [(Base::State, &mut Hold as &mut dyn Solver), (Base::Trapezoid, &mut Glide)] {
        let found = judged(&system, "ground1", base, Action::Random(1.0));
        let (truth, scene) = (&mut *Truth::Articulated.solver(&system), system.scene("ground1").expect("a scene"));
        let report = passive(&system, &scene, truth, still, found.protocol, &mut |_| ()).expect("a report");
        let apart = found.base.errors.iter().zip(&report.error).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(
            apart < 1e-12 && (base != Base::State || report.error == report.hold),
            "{base:?}: {:?} {report:?}",
            found.base
        );
        for times in found.times(&found.base) {
            assert!((times - 1.0).abs() < 1e-4, "{base:?}: base alone errs {times} times as much");
        }
        assert!(found.shortfall().is_some_and(|why| why.contains("base alone")), "{base:?}: {:?}", found.shortfall());
        assert!(!found.line().starts_with("use the network"), "{}", found.line());
        assert!(found.equal().is_some(), "at the truth's own substeps the error is 0");
        assert!(
            found.articulated.iter().rev().skip(1).all(|row| row.mean() > found.model.mean()),
            "{:?}",
            found.articulated
        );
        // A solver with smaller errors is advised if it is known to take less time.
        for microseconds in [1e-3, 0.0] {
            let other = Row { of: "another".into(), errors: found.model.errors.clone(), microseconds, diverged: 0 };
            let line = Verdict { beside: vec![other], ..found.clone() }.line();
            assert_eq!(line.starts_with("use the solver: another errs no more"), microseconds > 0.0, "{line}");
        }
    }
}

/// A wheel on a vertical axle with damping: its next velocity is a linear function of velocity and torque.
#[test]
fn a_linear_motion_is_learned_by_the_linear_map() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("wheel.urdf");
    std::fs::write(&path, crate::recorded::WHEEL).expect("written");
    let system = System::named(&path.display().to_string()).expect("a robot");
    let found = judged(&system, "free", Base::State, Action::Random(1.0));
    let share = found.linear.errors[0] / found.base.errors[0];
    // Left are the rounding of tokens to f32, and the ridge.
    assert!(share < 1e-3, "the linear map errs {share:.1e} of hold last");
}
