//! Every committed result holds, and every figure in README and docs is the one that its result has.

mod common;

use std::path::Path;

use common::{refused, xtask};

#[test]
fn every_result_holds_and_every_document_says_what_it_says() {
    let run = xtask(&["results", "check"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    refused(&["results", "make", "unicorn"], "unicorn");
}

/// A workspace of its own, with this one's results and one document.
fn copy(to: &Path, document: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("workspace");
    std::fs::create_dir_all(to.join("results/passive")).expect("a folder");
    for file in ["manifest.toml", "passive/result.json"] {
        std::fs::copy(root.join("results").join(file), to.join("results").join(file)).expect("a result");
    }
    std::fs::write(to.join("Cargo.toml"), "[workspace]\n").expect("written");
    std::fs::write(to.join("README.md"), document).expect("written");
}

#[test]
fn a_changed_digit_is_found_and_mended() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let value = "<!--= passive /rows/0/report/error/0 -->";
    copy(folder.path(), &format!("It errs by {value}9.99<!--/--> m.\n"));
    let run = |args: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_xtask"));
        let output = command.args(args).current_dir(folder.path()).output().expect("xtask starts");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let said = run(&["results", "check"]).1;
    assert!(said.contains("README.md: figures that its results do not have"), "{said}");
    assert!(run(&["results", "write"]).0, "the document was not written");
    let text = std::fs::read_to_string(folder.path().join("README.md")).expect("the document");
    assert!(!text.contains("9.99") && text.contains(value), "{text}");
    let said = run(&["results", "check"]).1;
    assert!(!said.contains("README.md"), "a mended document is found wanting: {said}");
    std::fs::write(folder.path().join("README.md"), "It errs by 0.123 m.\n").expect("written");
    let said = run(&["results", "check"]).1;
    assert!(said.contains("README.md:1: 0.123 comes from no result"), "{said}");
}
