//! Records: what was measured once and cannot be measured again in a day is drawn anew from its data.
#![cfg(feature = "report")]

use nerd_train::experiments::ablations::Ablations;
use nerd_train::experiments::sweep::Sweep;
use nerd_train::experiments::{Experiment, redraw};
use nerd_train::report::artifact::Head;
use nerd_train::settings::Settings;
use serde_json::{Map, json};

/// Figures of which a JSON reader that is one rounding off makes other ones.
const FIGURES: [&str; 4] = ["0.00011479155122486666", "2.861036858525616e-05", "0.13780672414761091", "55.5375705078125"];

fn record() -> String {
    let row = |name: &str, left: bool| {
        let [a, b, c, time] = FIGURES;
        let at = if left { "null".into() } else { format!("[{a}, {b}, {c}]") };
        let error = if left { "null" } else { a };
        let error = if left { error.into() } else { format!("[{error}]") };
        format!(
            r#"{{"name": "{name}", "seed": 0, "parameters": 3, "minutes": "1.0", "at": {at}, "error": {error}, "diverged": 0, "microseconds": {time}}}"#
        )
    };
    format!(
        "{{\n  \"provenance\": {},\n  \"kept\": 1.50,\n  \"rows\": [{}, {}],\n  \"seed\": [0],\n  \"set\": \"sizes\",\n  \"tables\": []\n}}\n",
        json!({"commit": "abc", "command": "cargo xtask reproduce sweep", "seed": 0, "machine": "one", "date": "2026-01-01"}),
        row("base", false),
        row("gone", true),
    )
}

#[test]
fn a_record_drawn_anew_keeps_every_digit_and_the_second_time_every_byte() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sweep-sizes-pendulum.json");
    let before = record();
    std::fs::write(&path, &before).expect("written");
    let drawn = || {
        redraw(folder.path(), "sweep-sizes-pendulum").expect("drawn");
        std::fs::read_to_string(&path).expect("read")
    };
    let (first, second) = (drawn(), drawn());
    assert_eq!(first, second);
    let kept = before.split("\"tables\"").next().expect("text");
    assert!(first.starts_with(kept), "{first}");
    let tables = Head::read(folder.path(), "sweep-sizes-pendulum").expect("a result").tables;
    let cells: Vec<&str> = tables[0].rows.iter().flat_map(|row| [row[0].as_str(), row[2].as_str()]).collect();
    assert_eq!(cells, ["base", "0.000115 +- 0 (1.00)", "gone", "left"]);
    for file in ["md", "svg", "png"] {
        assert!(path.with_extension(file).exists(), "no {file}");
    }
}

#[test]
fn what_can_be_measured_again_is_not_drawn_from_its_data() {
    let said = redraw(std::path::Path::new("."), "passive").expect_err("refused").to_string();
    assert!(said.contains("measure it again") && !said.contains('\n'), "{said}");
}

#[test]
fn settings_that_name_nothing_are_refused_before_anything_is_trained() {
    let given = |text: serde_json::Value| match text {
        serde_json::Value::Object(all) => all,
        _ => Map::new(),
    };
    let sweep = |keys| Sweep::default().with(&given(keys)).expect("settings").measure().err().map(|e| e.to_string()).unwrap_or_default();
    let ablations =
        |keys| Ablations::default().with(&given(keys)).expect("settings").measure().err().map(|e| e.to_string()).unwrap_or_default();
    for (said, word) in [
        (sweep(json!({"set": "colours"})), "--set colours: known are switches, sizes, smallest, forms, sameness"),
        (sweep(json!({"only": ["e3"], "set": "sizes"})), "--only e3: known are e32-l2"),
        (ablations(json!({"robot": ["cube"]})), "--robot cube"),
        (ablations(json!({"seed": [1, 1]})), "each once"),
        (ablations(json!({"robot": ["pendulum"], "only": ["mpl"]})), "--only mpl: known are lstm, gru, mlp, e2e, abs-pred"),
    ] {
        assert!(said.starts_with(word) || said.contains(word), "`{said}` in place of `{word}`");
    }
    let said = Ablations::default().with(&given(json!({"updates": 79}))).expect_err("refused");
    assert!(said.contains("79") && said.contains("80"), "{said}");
}
