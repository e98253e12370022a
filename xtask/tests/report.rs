//! The page of all results in a real browser: it opens without an error, loads nothing, and its replays move.

mod common;

use std::path::Path;
use std::process::Command;

use common::{refused, replays, shows_a_cable, xtask};

const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// Robots and tasks, a replay each.
const REPLAYS: usize = 6 + 8;

fn browser() -> Option<&'static str> {
    BROWSERS.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success()))
}

/// The document as it stands after four seconds of the page's own time, in a window that shows all of it.
fn opened(browser: &str, page: &Path, profile: &Path) -> String {
    let run = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync"])
        .args(["--disable-component-update", "--window-size=1400,30000", "--virtual-time-budget=4000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("a browser that starts");
    String::from_utf8_lossy(&run.stdout).into_owned()
}

#[test]
fn the_page_opens_without_an_error_and_its_replays_move() {
    refused(&["report", "--frames", "0"], "--frames");
    let folder = tempfile::tempdir().expect("temporary folder");
    let page = folder.path().join("report.html");
    let run = xtask(&["report", "--frames", "30", "--out", page.to_str().expect("utf-8")]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = std::fs::read_to_string(&page).expect("the page");
    for loads in ["src=", "<link", "@import", "fetch(", "XMLHttpRequest"] {
        assert!(!text.contains(loads), "the page has `{loads}`: it would load something");
    }
    assert_eq!(text.matches("class=motion").count(), REPLAYS, "replays in the page");
    let lead = replays(&text).find(|replay| replay["title"] == "lead-pegs, moved at random").expect("a replay of the learned cable");
    shows_a_cable(&lead, 40, 4, 30);
    let Some(browser) = browser() else { return println!("skipped: no browser") };
    let painted = |seen: &str| -> Vec<usize> {
        seen.split("data-painted=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect()
    };
    let mut seen = opened(browser, &page, folder.path());
    // The browser's own clock may run out before a busy machine has drawn a second frame; what really stands still does so each time.
    for _ in 0..2 {
        if painted(&seen).iter().any(|n| *n <= 1) {
            seen = opened(browser, &page, folder.path());
        }
    }
    assert!(seen.contains("</html>"), "{browser} shows no page");
    assert!(
        !seen.contains("data-error"),
        "a script failed: {}",
        seen.split("data-error=").nth(1).unwrap_or_default().chars().take(200).collect::<String>()
    );
    let painted = painted(&seen);
    assert_eq!(painted.len(), REPLAYS, "replays on the screen");
    assert!(painted.iter().all(|n| *n > 1), "a replay stands still: painted {painted:?} times");
    let points = seen.matches("<circle").count();
    assert!(points > 50, "{points} points in all charts");
}
