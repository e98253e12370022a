//! The page of all results in a real browser: it opens without an error, loads nothing, and its replays move.

use std::process::Command;

use crate::{Folder, done, text};

const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

#[test]
fn the_page_opens_without_an_error_and_its_replays_move() {
    let folder = Folder::new();
    let page = folder.path("report.html");
    done("report --frames 30 --out", &[&page]);
    let html = text(&page);
    for loads in ["src=", "<link", "@import", "fetch(", "XMLHttpRequest"] {
        assert!(!html.contains(loads), "the page has `{loads}`: it would load something");
    }
    let replays = html.matches("class=motion").count();
    assert!(replays >= 14, "{replays} replays in the page");
    let there = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|run| run.status.success());
    let Some(browser) = BROWSERS.into_iter().find(there) else { return println!("skipped: no browser") };
    // The document after four seconds of the page's own time, in a window that shows all of it.
    let opened = || {
        let mut command = Command::new(browser);
        command.args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-sync",
        ]);
        command.args(["--disable-component-update", "--window-size=1400,30000", "--virtual-time-budget=4000", "--dump-dom"]);
        command.arg(format!("--user-data-dir={}", folder.0.path().display())).arg(format!("file://{}", page.display()));
        String::from_utf8_lossy(&command.output().expect("a browser that starts").stdout).into_owned()
    };
    let painted = |seen: &str| -> Vec<usize> {
        seen.split("data-painted=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect()
    };
    let mut seen = opened();
    // The browser's own clock may run out before a busy machine has drawn a second frame; what really does not move does so each time.
    for _ in 0..2 {
        if painted(&seen).iter().any(|n| *n <= 1) {
            seen = opened();
        }
    }
    let error = seen.split("data-error=").nth(1).map(|rest| rest.chars().take(200).collect::<String>());
    assert!(seen.contains("</html>") && error.is_none(), "a script failed: {error:?}");
    let painted = painted(&seen);
    assert!(painted.len() == replays && painted.iter().all(|n| *n > 1), "a replay does not move: painted {painted:?} times");
    let points = seen.matches("<circle").count();
    assert!(points > 50, "{points} points in all charts");
}
