//! A real browser, driven over its debugging pipe.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::Folder;

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// Longest silence of a browser; a machine may be busy.
const PATIENCE: Duration = Duration::from_secs(60);

pub struct Browser {
    process: Child,
    to: File,
    from: Receiver<Value>,
    session: Value,
    asked: u64,
    _folder: Folder,
}

impl Browser {
    /// Opens a page in a window of `width` x `height` pixels; prints a note and returns `None` without a browser.
    pub fn open(url: &str, [width, height]: [usize; 2]) -> Option<Self> {
        let there = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|run| run.status.success());
        let Some(name) = NAMES.into_iter().find(there).filter(|_| cfg!(unix)) else {
            println!("skipped: no browser");
            return None;
        };
        let folder = Folder::new();
        let [asks, answers] = ["asks", "answers"].map(|pipe| folder.path(pipe));
        assert!(Command::new("mkfifo").args([&asks, &answers]).status().expect("mkfifo").success(), "two pipes");
        let mut command = Command::new("sh");
        command
            .args(["-c", "exec \"$@\" 3<\"$ASKS\" 4>\"$ANSWERS\"", "sh", name])
            .env("ASKS", &asks)
            .env("ANSWERS", &answers);
        command.args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-sync",
            "--remote-debugging-pipe",
        ]);
        command.args(["--disable-background-networking", "--disable-component-update"]).stderr(Stdio::null());
        command.args([
            format!("--window-size={width},{height}"),
            format!("--user-data-dir={}", folder.path("profile").display()),
        ]);
        let process = command.spawn().expect("a shell");
        let to = File::options().write(true).open(asks).expect("a pipe");
        let (heard, from) = channel();
        let answers = File::open(answers).expect("a pipe");
        std::thread::spawn(move || {
            let messages = BufReader::new(answers).split(0).map_while(Result::ok);
            messages.filter_map(|text| serde_json::from_slice(&text).ok()).try_for_each(|message| heard.send(message))
        });
        let mut browser = Self { process, to, from, session: Value::Null, asked: 0, _folder: folder };
        let page = browser.call("Target.createTarget", json!({ "url": url }))["targetId"].clone();
        browser.session =
            browser.call("Target.attachToTarget", json!({ "targetId": page, "flatten": true }))["sessionId"].clone();
        Some(browser)
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.asked += 1;
        let mut message = json!({ "id": self.asked, "method": method, "params": params });
        if !self.session.is_null() {
            message["sessionId"] = self.session.clone();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("a browser that listens");
        loop {
            let mut answer =
                self.from.recv_timeout(PATIENCE).unwrap_or_else(|e| panic!("{method}: the browser says nothing: {e}"));
            if answer["id"] == self.asked {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].take();
            }
        }
    }

    /// The value of a line of JavaScript in the page; promises are awaited.
    pub fn run(&mut self, line: &str) -> Value {
        let mut answer =
            self.call("Runtime.evaluate", json!({ "expression": line, "awaitPromise": true, "returnByValue": true }));
        assert!(answer["exceptionDetails"].is_null(), "{line}: {answer}");
        answer["result"]["value"].take()
    }

    pub fn until(&mut self, line: &str) {
        let began = Instant::now();
        while self.run(line) != true {
            assert!(
                began.elapsed() < PATIENCE,
                "never true: {line}; the page: {}",
                self.run("document.body.innerText")
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Moves the mouse to a place of the page, with its left button: `mousePressed`, `mouseMoved` or `mouseReleased`.
    pub fn mouse(&mut self, what: &str, [x, y]: [f64; 2]) {
        self.call(
            "Input.dispatchMouseEvent",
            json!({ "type": what, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 }),
        );
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill().and_then(|()| self.process.wait());
    }
}
