//! The page of all results in a real browser: it opens without an error, loads nothing, and its replays move.

use crate::{Folder, browser::Browser, done, text};

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
    // A window that shows the whole page.
    let Some(mut browser) = Browser::open(&format!("file://{}", page.display()), [1400, 30_000]) else { return };
    browser.until("document.readyState === 'complete'");
    let error = browser.run("document.querySelector('[data-error]')?.dataset.error");
    assert!(error.is_null(), "a script failed: {error}");
    browser.until(&format!(
        "[...document.querySelectorAll('[data-painted]')].filter(e => e.dataset.painted > 1).length === {replays}"
    ));
    let points = browser.run("document.querySelectorAll('circle').length");
    assert!(points.as_u64() > Some(50), "{points} points in all charts");
}
