//! Passive evaluation: a solver compared with itself has no error, under any action.

use crate::*;

#[test]
fn a_solver_against_itself_has_no_error() {
    for robot in ["ant", "anymal", "cube"] {
        let system = System::named(robot).expect("built in");
        let scene = system.scene("ground").expect("scene");
        let solver = || Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
        for action in [Action::Zero, Action::Random(1.0)] {
            let config = PassiveConfig { starts: 6, steps: 40, seed: 3, action };
            let report = passive(&system, &scene, &mut solver(), &mut solver(), config, &mut |_| ()).expect("finite");
            assert!(report.error.iter().all(|e| *e == 0.0), "{robot}, {action:?}: {:?}", report.error);
            assert!(report.curve.iter().all(|e| *e == 0.0) && report.diverged == 0, "{robot}, {action:?}: {report:?}");
            assert!(report.hold.iter().all(|e| *e > 0.0), "{robot}, {action:?}: nothing moved, {:?}", report.hold);
        }
    }
}

/// Fails from the first frame on, in every second environment.
struct Fails(Articulated);

impl Solver for Fails {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let torques: Vec<f64> =
            torques.iter().enumerate().map(|(i, t)| if i / 2 % 2 == 1 { f64::NAN } else { *t }).collect();
        self.0.step(batch, &torques)
    }
}

/// A failed rollout stays at its last state, and its error there counts.
#[test]
fn what_fails_is_counted_and_errs_as_what_stands_still() {
    let system = System::named("pendulum").expect("built in");
    let truth = || Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    let config = PassiveConfig { starts: 6, steps: 30, seed: 4, action: Action::Zero };
    let scene = system.scene("ground1").expect("scene");
    let report =
        passive(&system, &scene, &mut truth(), &mut Fails(truth()), config, &mut |_| ()).expect("the others go on");
    assert_eq!((report.failed, report.diverged, report.first_divergence), (3, 3, Some(1)));
    let standing = |k: usize| report.error[k] / report.hold[k];
    println!("errors over those of standing still {:.2}, {:.2}", standing(0), standing(1));
    assert!(
        (0.2..0.8).contains(&standing(0)) && (0.2..0.8).contains(&standing(1)),
        "half of the rollouts stand: {:?}",
        report.error
    );
}

#[test]
fn targets_are_of_each_start_and_within_what_is_asked() {
    let system = System::named("anymal").expect("built in");
    let protocol = |action| PassiveConfig { starts: 3, steps: 7, seed: 5, action };
    assert!(protocol(Action::Limp).held(&system).is_none());
    let held = protocol(Action::Held(0.3)).held(&system).expect("held");
    let all: Vec<f64> = held.targets.iter().flatten().flatten().copied().collect();
    assert_eq!((held.every, all.len()), (1, 7 * 3 * 12), "a target a frame of 1/60 s");
    let most = all.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    assert!((0.25..=0.3).contains(&most), "{most} rad at most");
    let of = |target, env: usize| -> Vec<f64> {
        held.drives(target, 5)[12 * env..12 * env + 12].iter().map(|d| d.target).collect()
    };
    assert!(of(0, 0) != of(0, 1) && of(0, 0) != of(1, 0) && of(0, 0) == of(0, 3), "of each start and target; in turn");
    // The same solver twice has no error; held targets move the robot otherwise than limp joints.
    let scene = system.scene("ground").expect("scene");
    let solver = || Articulated::new(ArticulatedConfig::accurate(&system));
    let report =
        |action| passive(&system, &scene, &mut solver(), &mut solver(), protocol(action), &mut |_| ()).expect("finite");
    let [held, limp] = [Action::Held(0.3), Action::Limp].map(report);
    assert!(held.error.iter().all(|x| *x == 0.0) && held.hold != limp.hold, "{held:?}");
}
