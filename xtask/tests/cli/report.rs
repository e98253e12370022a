//! The page of all results in a real browser: it opens without an error, loads nothing, and its replays move.

use std::time::{Duration, Instant};
use std::{fs::File, process::Command};

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
    assert_eq!(replays, 14, "a replay for each of six robots and eight tasks");
    let there = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|run| run.status.success());
    let Some(browser) = BROWSERS.into_iter().find(there) else { return println!("skipped: no browser") };
    // The document after a second of the page's own time, in a window that shows all of it. A browser on such a clock now and then goes
    // round for ever, so it has thirty seconds and some tries.
    let opened = |number: usize| {
        let mut command = Command::new(browser);
        command.args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-sync",
        ]);
        command.args(["--disable-component-update", "--window-size=1400,30000", "--virtual-time-budget=1000", "--dump-dom"]);
        command.arg(format!("--user-data-dir={}", folder.path(&format!("browser-{number}")).display()));
        let seen = folder.path(&format!("seen-{number}.html"));
        command.arg(format!("file://{}", page.display())).stdout(File::create(&seen).expect("a file"));
        let (mut browser, began) = (command.spawn().expect("a browser that starts"), Instant::now());
        while browser.try_wait().expect("a state").is_none() {
            if began.elapsed() > Duration::from_secs(30) {
                browser.kill().and_then(|()| browser.wait()).expect("killed");
                return String::new();
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        text(&seen)
    };
    let painted = |seen: &str| -> Vec<usize> {
        seen.split("data-painted=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect()
    };
    let moves = |seen: &str| seen.contains("</html>") && painted(seen).iter().all(|n| *n > 1);
    let mut seen = String::new();
    for number in 0..8 {
        seen = opened(number);
        if moves(&seen) {
            break;
        }
    }
    let error = seen.split("data-error=").nth(1).map(|rest| rest.chars().take(200).collect::<String>());
    assert!(seen.contains("</html>") && error.is_none(), "a script failed: {error:?}");
    let painted = painted(&seen);
    assert!(painted.len() == replays && painted.iter().all(|n| *n > 1), "a replay does not move: painted {painted:?} times");
    let points = seen.matches("<circle").count();
    assert!(points > 50, "{points} points in all charts");
}
