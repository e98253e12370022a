//! The page and its two questions, on this machine alone.

use std::io::Write;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, PoisonError, RwLock};

use nerd_train::replay::{SCRIPT, escape, fill, script};
use tiny_http::{Method, Request, Response, Server};

use super::ask::Ask;
use super::world::World;
use crate::prelude::*;

const THREADS: usize = 4;
/// Asks that wait at most; more are turned away.
const WAITING: usize = 64;
/// Longest ask (bytes): what the server has read before it hands a request over.
const LONGEST: usize = 1024;

const PAGE: &str = include_str!("live.html");
const LIVE: &str = include_str!("live.js");

pub struct Live {
    server: Arc<Server>,
    asks: SyncSender<Ask>,
    shown: Arc<RwLock<Face>>,
}

#[derive(Clone, Default)]
struct Face {
    page: Arc<[u8]>,
    state: Arc<[u8]>,
    crowd: Arc<[u8]>,
}

impl Face {
    fn new(world: &mut World) -> Self {
        let (title, data) = (escape(&world.title), script(&world.page()));
        let page = fill(PAGE, &[("TITLE", &title), ("PAINTER", SCRIPT), ("LIVE", LIVE), ("DATA", &data)]);
        Self { page: page.into_bytes().into(), ..Self::default() }.now(world)
    }

    /// The same page with the world as it is now.
    fn now(self, world: &World) -> Self {
        let state = serde_json::to_vec(&world.shown()).unwrap_or_else(|e| format!("{{\"trouble\":\"{e}\"}}").into());
        Self { state: state.into(), crowd: world.crowd().into(), ..self }
    }
}

impl Live {
    /// Serves a world at a port of this machine (0: any that is free), and steps it in real time.
    pub fn serve(mut world: World, port: u16) -> Result<Self> {
        let server = Server::http(("127.0.0.1", port)).map_err(|e| anyhow::anyhow!("--port {port}: {e}; name another"))?;
        let shown = Arc::new(RwLock::new(Face::new(&mut world)));
        let (asks, asked) = sync_channel(WAITING);
        std::thread::spawn({
            let shown = shown.clone();
            move || run(world, &asked, &shown)
        });
        let live = Self { server: server.into(), asks, shown };
        (0..THREADS).for_each(|_| live.answer());
        Ok(live)
    }

    pub fn address(&self) -> String {
        format!("http://{}", self.server.server_addr())
    }

    fn answer(&self) {
        let Self { server, asks, shown } = self;
        let (server, asks, shown) = (server.clone(), asks.clone(), shown.clone());
        std::thread::spawn(move || {
            while let Ok(mut request) = server.recv() {
                // The rest of a long body is waited for when its request is dropped: not here.
                if lazy(&request) {
                    std::thread::spawn(move || request.respond(Response::from_string(LONG).with_status_code(413)));
                    continue;
                }
                let (code, kind, text) = reply(&mut request, &asks, &shown);
                // A visitor who is gone does not want the answer.
                let _ = whole(request, code, kind, &text);
            }
        });
    }
}

/// Ends the answering; the world ends with the last of what asks it.
impl Drop for Live {
    fn drop(&mut self) {
        (0..THREADS).for_each(|_| self.server.unblock());
    }
}

/// Answers in one piece: of two, TCP keeps the second back until the first is acknowledged, which may take 40 ms.
fn whole(request: Request, code: u16, kind: &str, text: &[u8]) -> std::io::Result<()> {
    let length = text.len();
    let head =
        format!("HTTP/1.1 {code} \r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\n\r\n").into_bytes();
    let text = if *request.method() == Method::Head { b"" } else { text };
    let mut writer = request.into_writer();
    writer.write_all(&[&head, text].concat())?;
    writer.flush()
}

const LONG: &str = "an ask is at most 1024 bytes, and says how many";

/// Whether the server has not read a request's body yet.
fn lazy(request: &Request) -> bool {
    let waits = ["Transfer-Encoding", "Expect"].into_iter().any(|name| header(request, name).is_some());
    let upgrade = header(request, "Connection").is_some_and(|kind| kind.to_ascii_lowercase().contains("upgrade"));
    waits || upgrade || request.body_length().is_some_and(|length| length > LONGEST)
}

fn header<'a>(request: &'a Request, name: &'static str) -> Option<&'a str> {
    request.headers().iter().find(|h| h.field.equiv(name)).map(|h| h.value.as_str())
}

type Reply = (u16, &'static str, Arc<[u8]>);

fn reply(request: &mut Request, asks: &SyncSender<Ask>, shown: &RwLock<Face>) -> Reply {
    const JSON: &str = "application/json";
    let refused = |code: u16, why: &str| (code, "text/plain; charset=utf-8", why.as_bytes().into());
    // Another site's page that a browser here has open can neither read this one (its host is another) nor ask (its kind of text is another).
    let host = header(request, "Host").unwrap_or("").rsplit_once(':').map_or("", |(host, _)| host);
    if !["127.0.0.1", "localhost"].contains(&host) {
        return refused(403, "this is for the machine that it runs on: open http://127.0.0.1 and its port");
    }
    let face = || shown.read().unwrap_or_else(PoisonError::into_inner).clone();
    match (request.method(), request.url()) {
        (Method::Get, "/") => (200, "text/html; charset=utf-8", face().page),
        (Method::Get, "/state") => (200, JSON, face().state),
        (Method::Get, "/crowd") => (200, "application/octet-stream", face().crowd),
        (Method::Post, "/ask") if header(request, "Content-Type") == Some(JSON) => {
            let mut text = String::new();
            if request.as_reader().read_to_string(&mut text).is_err() {
                return refused(400, "an ask is UTF-8");
            }
            match Ask::read(&text).map(|ask| asks.try_send(ask)) {
                Ok(Ok(())) => (200, JSON, b"{}"[..].into()),
                Ok(Err(TrySendError::Full(_))) => refused(503, "too many asks wait; ask again"),
                Ok(Err(TrySendError::Disconnected(_))) => refused(500, "the world has ended"),
                Err(why) => refused(400, &why),
            }
        }
        (Method::Post, "/ask") => refused(415, "an ask is application/json"),
        _ => refused(404, "there is /, /state and /crowd to get, and /ask to post to"),
    }
}

/// Steps a world in real time until nobody can ask it any more. Where it cannot keep up, it is slow.
fn run(mut world: World, asked: &Receiver<Ask>, shown: &RwLock<Face>) {
    let mut next = Instant::now();
    loop {
        let (pace, number) = (Duration::from_secs_f64(world.pace()), world.number);
        let left = next.saturating_duration_since(Instant::now());
        if left.is_zero() {
            if !world.paused {
                world.step();
            }
            next = (next + pace).max(Instant::now());
        }
        // Some are heard where frames take longer than they last, and frames come where asks have no end.
        match asked.recv_timeout(left) {
            Ok(ask) => std::iter::once(ask).chain(asked.try_iter().take(WAITING)).for_each(|ask| world.answer(ask)),
            Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) if left.is_zero() => {}
            Err(RecvTimeoutError::Timeout) => continue,
        }
        let old = shown.read().unwrap_or_else(PoisonError::into_inner).clone();
        let new = if number == world.number { old.now(&world) } else { Face::new(&mut world) };
        *shown.write().unwrap_or_else(PoisonError::into_inner) = new;
    }
}
