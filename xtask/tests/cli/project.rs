//! Statements of the program and the repository about themselves: lists, JSON, results, documents.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{Folder, command, done, root, text};

#[test]
fn lists_have_what_can_be_named_and_json_the_same_rows() {
    for (list, names) in [
        ("robots", ["pendulum", "anymal-paper"]),
        ("scenes", ["ground6", "hills"]),
        ("tasks", ["ant-run", "franka-reach-torque"]),
        ("models", ["models/cartpole-paper", "models/pendulum-paper"]),
        ("rows", ["free fall", "ANYmal kp 2000"]),
    ] {
        let table = done(&format!("list {list}"), &[]).0;
        let json: Value =
            serde_json::from_str(&done(&format!("list {list} --json"), &[]).0).expect("JSON and nothing else");
        let rows = json[list].as_array().expect("rows");
        assert_eq!(rows.len() + 2, table.trim().lines().count(), "{table}");
        for name in names {
            let has = |row: &Value| row.as_object().is_some_and(|row| row.values().any(|cell| cell == name));
            assert!(table.contains(&format!("| {name} ")) && rows.iter().any(has), "no {name} in {table}");
        }
    }
    let outside = Folder::new();
    let run = command("list models --json", &[]).current_dir(&outside.0).output().expect("started");
    let json: Value = serde_json::from_slice(&run.stdout).expect("JSON");
    assert_eq!(json["models"].as_array().map(Vec::len), Some(0), "there are none outside of the workspace");
}

#[test]
fn every_result_holds_and_every_document_says_what_it_says() {
    done("results check", &[]);
}

/// A separate workspace with this one's results and one document.
#[test]
fn a_changed_digit_is_found_and_mended() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("results/passive")).expect("a folder");
    for file in ["manifest.toml", "passive/result.json"] {
        std::fs::copy(root().join("results").join(file), folder.path("results").join(file)).expect("a result");
    }
    folder.write("Cargo.toml", "[workspace]\n");
    let value = "<!--= passive /rows/0/report/error/0 -->";
    let readme = folder.write("README.md", format!("It errs by {value}9.99<!--/--> m.\n"));
    let run = |line: &str| {
        let run = command(line, &[]).current_dir(&folder.0).output().expect("started");
        String::from_utf8_lossy(&run.stderr).into_owned()
    };
    assert!(run("results check").contains("README.md: figures that its results do not have"));
    run("results write");
    assert!(!text(&readme).contains("9.99") && text(&readme).contains(value), "{}", text(&readme));
    assert!(!run("results check").contains("README.md"), "a mended document is found wanting");
    folder.write("README.md", "It errs by 0.123 m.\n");
    assert!(run("results check").contains("README.md:1: 0.123 comes from no result"));
}

#[test]
fn every_key_of_a_robots_file_is_explained() {
    let page = text(root().join("docs/your-robot.md"));
    let sources = files(&root().join("nerd-sim/src"), ".rs");
    let spec: String =
        sources.iter().filter(|p| p.ends_with("robots/spec.rs") || p.ends_with("scene/spec.rs")).map(text).collect();
    let keys = spec.lines().filter_map(|line| line.strip_prefix("    pub ")?.split_once(": ")).map(|(key, _)| key);
    let keys: Vec<&str> = keys.filter(|key| key.chars().all(|c| c.is_ascii_lowercase() || c == '_')).collect();
    assert!(keys.len() > 40, "only {} keys found: has the file's form changed?", keys.len());
    for key in keys {
        // A list of tables is documented under its singular.
        let key = match key {
            "joints" | "contacts" | "scenes" | "pegs" => key.trim_end_matches('s'),
            "boxes" => "box",
            _ => key,
        };
        let named = [format!("`{key}`"), format!("`{key}."), format!("[{key}]"), format!(".{key}`")]
            .iter()
            .any(|form| page.contains(form));
        assert!(named, "docs/your-robot.md does not explain `{key}`");
    }
}

/// Files with an ending in a folder and below, without build output.
fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') && !name.starts_with("target") {
            found.extend(files(&path, ending));
        } else if name.ends_with(ending) {
            found.push(path);
        }
    }
    found
}

#[test]
fn no_file_of_code_is_longer_than_400_lines() {
    let all = [files(root(), ".rs"), files(root(), ".py")].concat();
    assert!(all.len() > 200, "only {} files found", all.len());
    for path in all {
        let lines = text(&path).lines().count();
        assert!(lines <= 400, "{} has {lines} lines", path.display());
    }
}

/// Lines that are not blank, without indentation, as one text; `fn main` is left out, as in documents.
fn plain(code: &str) -> String {
    let lines = code.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("fn main"));
    lines.fold(String::from("\n"), |all, line| all + line + "\n")
}

#[test]
fn every_rust_block_of_readme_and_docs_is_in_an_example_that_compiles() {
    let examples: Vec<String> = files(root(), ".rs")
        .iter()
        .filter(|path| path.to_string_lossy().contains("examples"))
        .map(|path| plain(&text(path)))
        .collect();
    let documents = [files(&root().join("docs"), ".md"), vec![root().join("README.md")]].concat();
    let mut blocks = 0;
    for document in &documents {
        for block in text(document).split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next()) {
            blocks += 1;
            assert!(
                examples.iter().any(|e| e.contains(&plain(block))),
                "{}: in no example:\n{block}",
                document.display()
            );
        }
    }
    assert!(blocks >= 4, "{blocks} blocks of Rust in {} documents: are they found at all?", documents.len());
}
