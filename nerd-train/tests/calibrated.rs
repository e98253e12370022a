//! A calibration of the sample of tosses, from its log to its tables.

#![cfg(feature = "report")]

use std::path::Path;

use nerd_train::experiments::Experiment;
use nerd_train::experiments::calibrated::{CalibratedAll, Calibration};

fn settings(change: impl FnOnce(&mut Calibration)) -> Calibration {
    let mut all = Calibration::default();
    all.log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/cube.log.toml");
    (all.solvers, all.splits, all.frames, all.every) = (vec!["articulated".into()], 3, 40, 16);
    (all.evaluations, all.trials) = (60, 24);
    change(&mut all);
    all
}

#[test]
fn tosses_that_nothing_was_fitted_to_are_predicted_better() {
    let settings = settings(|c| c.parameters = vec!["com.z".into(), "damping".into(), "lag".into()]);
    let found = settings.measure().expect("a calibration");
    let splits = &found.fitted[0].splits;
    assert!(splits.len() == 3 && splits.iter().any(|s| s.judged != splits[0].judged), "three splits of one kind");
    for split in splits {
        assert_eq!(split.judged.len(), 2, "half of the three tosses that 68 % of ten leave");
        assert!(split.fit.objective < 1.0, "the objective is {} of that without a fit", split.fit.objective);
        let [low, mean, high] = [&split.after.low, &split.after.mean, &split.after.high].map(|g| g.position);
        assert!(low <= mean && mean <= high, "{mean} m is not between {low} and {high}");
    }
    let text = |found: &CalibratedAll| settings.tables(found).expect("tables").iter().map(|t| t.markdown()).collect::<String>();
    let words = ["no motion", "articulated implicit x4, calibrated", "com.z (m)"];
    assert!(words.iter().all(|word| text(&found).contains(word)), "{}", text(&found));
    // As a file has it, it reads the same again.
    let json = serde_json::to_string(&found).expect("JSON");
    assert_eq!(text(&serde_json::from_str(&json).expect("itself")), text(&found));
}

#[test]
fn what_cannot_be_calibrated_is_said() {
    let refused = |settings: Calibration, what: &str| {
        let said = settings.measure().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(said.contains(what) && !said.contains('\n'), "`{said}` does not say {what}");
    };
    refused(settings(|c| c.solvers = vec!["bullet".into()]), "--solvers bullet");
    refused(settings(|c| c.parameters = vec!["colour".into()]), "no parameter `colour`");
    refused(settings(|c| c.parameters = vec!["lag".into(), "lag".into()]), "named twice");
    refused(
        settings(|c| {
            c.solvers = vec!["rapier".into()];
            c.parameters = vec!["stiffness".into()];
        }),
        "means nothing to this solver",
    );
    refused(settings(|c| c.frames = 1000), "--frames");
    refused(settings(|c| c.log = "absent.log.toml".into()), "absent.log.toml");
}
