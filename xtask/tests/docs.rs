//! What docs/ says of robots: the seven grounds are drawn where they lie, and every key of a robot's TOML is explained.

use std::path::Path;

use nalgebra::Vector3;
use nerd_sim::prelude::*;

/// As the picture projects: world x to the right, y up, z towards the viewer and to the lower left; 32 units a metre.
fn place(p: Vector3<f64>) -> [f64; 2] {
    let z = p.z - 1.0;
    [118.0 + 32.0 * (p.x - 0.42 * z), 124.0 - 32.0 * (p.y - 2.0 - 0.38 * z)]
}

/// Numbers of a line with this class in a panel.
fn drawn(panel: &str, class: &str) -> Vec<f64> {
    let line = panel.lines().find(|line| line.contains(class)).unwrap_or_default();
    let numbers = ["x1", "y1", "x2", "y2"].map(|key| line.split(&format!("{key}=\"")).nth(1)?.split('"').next()?.parse().ok());
    numbers.into_iter().flatten().collect()
}

#[test]
fn grounds_lie_as_the_scenes_say() {
    let picture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/pictures/grounds.svg");
    let text = std::fs::read_to_string(picture).expect("the picture");
    let system = System::named("pendulum").expect("built in");
    for name in ["ground1", "ground2", "ground3", "ground4", "ground5", "ground6"] {
        let panel = text.split(&format!(">{name}</text>")).nth(1).and_then(|rest| rest.split("</g>").next()).expect("a panel");
        let scene = system.scene(name).expect("its scene");
        // The place of the plane above or below (x, 0, 1), and its normal.
        let ground = |x: f64| {
            let event = scene.contact(&Vector3::new(x, 0.0, 1.0));
            (Vector3::new(x, -event.distance / event.normal.y, 1.0), event.normal)
        };
        let (foot, normal) = ground(-1.5);
        for (class, ends) in [("cut", [ground(-2.4).0, ground(2.4).0]), ("normal", [foot, foot + 0.8 * normal])] {
            let (shown, wanted) = (drawn(panel, class), ends.map(place).concat());
            let apart = shown.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(shown.len() == 4 && apart < 0.06, "{name}: `{class}` is drawn at {shown:?}, {apart} from {wanted:?}");
        }
    }
}

#[test]
fn every_key_of_a_robots_file_is_explained() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| std::fs::read_to_string(root.join(path)).expect(path);
    let (spec, page) = (read("nerd-sim/src/spec.rs") + &read("nerd-sim/src/material.rs"), read("docs/your-robot.md"));
    let keys = spec.lines().filter_map(|line| line.strip_prefix("    pub ")?.split_once(": ")).map(|(key, _)| key);
    let keys: Vec<&str> = keys.filter(|key| key.chars().all(|c| c.is_ascii_lowercase() || c == '_')).collect();
    assert!(keys.len() > 40, "only {} keys found: has the file's form changed?", keys.len());
    for key in keys {
        // Lists of tables are named by one of them.
        let key = match key {
            "joints" | "contacts" | "scenes" | "pegs" => key.trim_end_matches('s'),
            "boxes" => "box",
            _ => key,
        };
        let named = [format!("`{key}`"), format!("`{key}."), format!("[{key}]"), format!(".{key}`")].iter().any(|form| page.contains(form));
        assert!(named, "docs/your-robot.md does not explain `{key}`");
    }
}

/// Rust and Python of the workspace, below a folder.
fn sources(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path());
    let named = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let folders = folders.into_iter().filter(|path| !named(path).starts_with('.') && !named(path).starts_with("target"));
    let files = files.into_iter().filter(|path| path.extension().is_some_and(|ending| ending == "rs" || ending == "py"));
    files.chain(folders.flat_map(|path| sources(&path))).collect()
}

#[test]
fn no_file_of_code_is_longer_than_400_lines() {
    let all = sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    assert!(all.len() > 200, "only {} files found", all.len());
    for path in all {
        let lines = std::fs::read_to_string(&path).expect("text").lines().count();
        assert!(lines <= 400, "{} has {lines} lines", path.display());
    }
}
