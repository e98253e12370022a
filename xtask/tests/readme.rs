//! Rust in the README and in docs/ is taken from examples, and those compile.

use std::path::{Path, PathBuf};

/// Files of these endings in a folder and below it, whose path holds `within`.
fn files(folder: &Path, ending: &str, within: &str) -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|file| file.path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if path.is_dir() && !name.starts_with('.') && !name.starts_with("target") && name != "results" && name != "models" {
                folders.push(path);
            } else if name.ends_with(ending) && path.to_string_lossy().contains(within) {
                found.push(path);
            }
        }
    }
    found
}

/// Lines with something on them, without their indentation, as one text; documents leave `fn main` out.
fn plain(code: &str) -> String {
    let lines = code.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("fn main"));
    lines.fold(String::from("\n"), |all, line| all + line + "\n")
}

#[test]
fn every_rust_block_of_readme_and_docs_stands_in_an_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    let read = |path: &PathBuf| std::fs::read_to_string(path).expect("a text");
    let examples: Vec<String> = files(root, ".rs", "examples").iter().map(|path| plain(&read(path))).collect();
    let mut documents = files(&root.join("docs"), ".md", "");
    documents.push(root.join("README.md"));
    let mut blocks = 0;
    for document in &documents {
        for block in read(document).split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next()) {
            blocks += 1;
            assert!(examples.iter().any(|e| e.contains(&plain(block))), "{}: stands in no example:\n{block}", document.display());
        }
    }
    assert!(blocks >= 4, "{blocks} blocks of Rust in {} documents: are they found at all?", documents.len());
}
