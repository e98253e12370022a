//! Passive evaluation: what is held against itself has no error at all, whatever drives it.

use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};

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
