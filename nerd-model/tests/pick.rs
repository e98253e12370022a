//! The cheapest solver of a chart that is accurate enough.

use nerd_model::pick::{Setting, pick};
use nerd_sim::prelude::*;

const CHART: &str = r#"{"robot": "pendulum", "points": [
    {"series": "a", "setting": {"euler": 1}, "microseconds": 0.2, "error": 0.004, "diverged": 3},
    {"series": "a", "setting": {"euler": 8}, "microseconds": 1.5, "error": 0.02, "diverged": 0},
    {"series": "b", "setting": {"implicit": 2}, "microseconds": 0.8, "error": 0.013, "diverged": 0},
    {"series": "b", "setting": {"implicit": 4}, "microseconds": 2.6, "error": 0.003, "diverged": 0},
    {"series": "another engine", "microseconds": 0.1, "error": 0.0001, "diverged": 0},
    {"series": "c", "setting": {"neural": "models/pendulum"}, "microseconds": 0.5, "error": 0.05, "diverged": 0}]}"#;

#[test]
fn the_cheapest_that_is_accurate_enough_is_taken() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let chart = folder.path().join("chart-pendulum-ground1");
    std::fs::create_dir(&chart).and_then(|()| std::fs::write(chart.join("result.json"), CHART)).expect("written");
    let of = |tolerance: f64| pick(folder.path(), "pendulum", "ground1", tolerance);
    let settings = [0.1, 0.03, 0.01].map(|tolerance| of(tolerance).expect("accurate enough").setting);
    // Neither what left nor what this program has no name for is ever taken, however cheap.
    assert_eq!(settings, [Setting::Neural("models/pendulum".into()), Setting::Implicit(2), Setting::Implicit(4)]);
    let too_fine = of(1e-3).unwrap_err().to_string();
    assert!(too_fine.contains("3.00e-3"), "{too_fine}");
    for tolerance in [f64::NAN, -1.0, 0.0] {
        let said = of(tolerance).unwrap_err().to_string();
        assert!(said.contains(&tolerance.to_string()), "{said}");
    }
    let absent = pick(folder.path(), "ant", "ground", 0.1).unwrap_err().to_string();
    assert!(absent.contains("chart-ant-ground/result.json") && absent.contains("cargo xtask chart"), "{absent}");
    let system = System::named("pendulum").expect("built in");
    assert!(Setting::Implicit(2).solver(&system).is_ok());
    let nowhere = Setting::Neural("nowhere".into()).solver(&system).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(nowhere.contains("nowhere"), "{nowhere}");
}
