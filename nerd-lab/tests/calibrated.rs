//! A calibration of the sample of tosses, from its log to its tables.

use std::path::Path;

use nerd_lab::experiments::Experiment;
use nerd_lab::experiments::calibrated::{CalibratedAll, Calibration};

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
fn fits_are_taken_from_a_result_of_the_same_splits_alone() {
    let settings = settings(|c| c.parameters = vec!["com.z".into()]);
    let found = settings.measure().expect("a calibration");
    let folder = std::env::temp_dir().join(format!("nerd-fits-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("fits.json");
    std::fs::write(&path, serde_json::to_vec(&found).expect("JSON")).expect("a file");
    let mut again = settings.clone();
    (again.fits, again.splits) = (Some(path.clone()), 2);
    let taken = again.measure().expect("taken fits").fitted;
    assert_eq!(taken[0].splits.len(), 2);
    for (a, b) in taken[0].splits.iter().zip(&found.fitted[0].splits) {
        // A file may round the last digit.
        let off = (a.fit.values[0] - b.fit.values[0]).abs();
        assert!(a.judged == b.judged && off < 1e-12, "{off:e} m beside the fit that was made");
    }
    // From there a search goes on, and comes no farther away.
    let mut further = settings.clone();
    (further.begin, further.splits, further.substeps, further.evaluations) = (Some(path.clone()), 1, 6, 40);
    let refined = &further.measure().expect("a search").fitted[0];
    let (now, then) = (refined.splits[0].fit.values[0], found.fitted[0].splits[0].fit.values[0]);
    assert!(refined.solver == "articulated implicit x6" && (now - then).abs() < 0.004, "{now} m, from {then} m");
    further.fits = Some(path.clone());
    assert!(further.measure().is_err_and(|e| e.to_string().contains("name one")));
    let mut other = settings;
    (other.fits, other.seed) = (Some(path), 9);
    let said = other.measure().err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("other splits"), "{said}");
    std::fs::remove_dir_all(folder).expect("removed");
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
