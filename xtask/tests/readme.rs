//! The README shows the examples of the crates, and those compile.

use std::path::Path;

#[test]
fn every_rust_block_of_the_readme_is_an_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    let readme = std::fs::read_to_string(root.join("README.md")).expect("README.md");
    let mut blocks: Vec<&str> = readme.split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    for (krate, example) in [("core", "dynamics"), ("sim", "swap"), ("model", "learned"), ("train", "drift"), ("tasks", "episode")] {
        let path = format!("nerd-{krate}/examples/{example}.rs");
        let text = std::fs::read_to_string(root.join(&path)).expect("an example for every crate");
        let shown: String = text
            .lines()
            .filter(|l| !l.is_empty() && !l.starts_with("//!") && !l.starts_with("fn main") && l.trim() != "Ok(())" && *l != "}")
            .map(|l| l.strip_prefix("    ").unwrap_or(l).to_owned() + "\n")
            .collect();
        assert!(blocks.contains(&shown.as_str()), "README.md does not show {path} as it is:\n{shown}");
        blocks.retain(|b| *b != shown);
    }
    assert!(blocks.is_empty(), "in README.md, but no example:\n{}", blocks.concat());
}
