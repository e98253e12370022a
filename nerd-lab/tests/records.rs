//! Settings that name nothing are refused before anything is trained.

use nerd_lab::experiments::Experiment;
use nerd_lab::experiments::ablations::Ablations;
use nerd_train::settings::Settings;
use serde_json::{Map, json};

#[test]
fn settings_that_name_nothing_are_refused_before_anything_is_trained() {
    let given = |text: serde_json::Value| match text {
        serde_json::Value::Object(all) => all,
        _ => Map::new(),
    };
    let ablations =
        |keys| Ablations::default().with(&given(keys)).expect("settings").measure().err().map(|e| e.to_string()).unwrap_or_default();
    for (said, word) in [
        (ablations(json!({"robot": ["cube"]})), "--robot cube"),
        (ablations(json!({"seed": [1, 1]})), "each once"),
        (ablations(json!({"robot": ["pendulum"], "only": ["mpl"]})), "--only mpl: known are lstm, gru, mlp, e2e, abs-pred"),
    ] {
        assert!(said.starts_with(word) || said.contains(word), "`{said}` in place of `{word}`");
    }
    let said = Ablations::default().with(&given(json!({"updates": 79}))).expect_err("refused");
    assert!(said.contains("79") && said.contains("80"), "{said}");
}
