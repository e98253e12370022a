//! Serves the live page and its requests to this machine alone.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, PoisonError, RwLock};

use nerd_train::replay::{SCRIPT, escape, fill, script};

use super::ask::Ask;
use super::http::{Reply, Request, Server, refused};
use super::world::World;
use crate::prelude::*;

/// Largest number of queued requests; further requests are refused.
const WAITING: usize = 64;

const PAGE: &str = include_str!("live.html");
const LIVE: &str = include_str!("live.js");

/// Serves a page until dropped; the world ends when the last connection closes.
pub struct Live(Server);

#[derive(Clone, Default)]
struct Face {
    page: Arc<[u8]>,
    state: Arc<[u8]>,
    crowd: Arc<[u8]>,
}

impl Face {
    fn new(world: &mut World) -> Self {
        let title = escape(&world.title);
        let data = script(&world.page());
        let page = fill(PAGE, &[("TITLE", &title), ("PAINTER", SCRIPT), ("LIVE", LIVE), ("DATA", &data)]);
        Self { page: page.into_bytes().into(), ..Self::default() }.now(world)
    }

    /// Keeps the page and updates the state to that of the world.
    fn now(self, world: &World) -> Self {
        let state = serde_json::to_vec(&world.shown()).unwrap_or_else(|e| format!("{{\"trouble\":\"{e}\"}}").into());
        Self { state: state.into(), crowd: world.crowd().into(), ..self }
    }
}

impl Live {
    /// Serves a world at a port of this machine (0: any free one), and steps it in real time.
    pub fn serve(mut world: World, port: u16) -> Result<Self> {
        let shown = Arc::new(RwLock::new(Face::new(&mut world)));
        let (asks, asked) = sync_channel(WAITING);
        let answer = {
            let shown = shown.clone();
            Arc::new(move |request: &Request| reply(request, &asks, &shown))
        };
        let server = Server::new(port, answer).map_err(|e| anyhow!("--port {port}: {e}; name another"))?;
        std::thread::Builder::new().spawn(move || run(world, &asked, &shown)).context("no thread for the world")?;
        Ok(Self(server))
    }

    pub fn address(&self) -> String {
        format!("http://{}", self.0.address)
    }
}

fn reply(request: &Request, asks: &SyncSender<Ask>, shown: &RwLock<Face>) -> Reply {
    const JSON: &str = "application/json";
    // A page from another site cannot read this one (its Host differs) or send requests (its content type differs).
    // Browsers omit port 80.
    let host = request.host.rsplit_once(':').map_or(request.host.as_str(), |(host, _)| host);
    if !["127.0.0.1", "localhost"].contains(&host) {
        return refused(403, "this is for the machine that it runs on: open http://127.0.0.1 and its port");
    }
    let face = || shown.read().unwrap_or_else(PoisonError::into_inner).clone();
    match (request.method.as_str(), request.path.as_str()) {
        ("GET" | "HEAD", "/") => (200, "text/html; charset=utf-8", face().page),
        ("GET", "/state") => (200, JSON, face().state),
        ("GET", "/crowd") => (200, "application/octet-stream", face().crowd),
        ("POST", "/ask") if request.kind == JSON => {
            let Ok(text) = std::str::from_utf8(&request.body) else { return refused(400, "an ask is UTF-8") };
            match Ask::read(text).map(|ask| asks.try_send(ask)) {
                Ok(Ok(())) => (200, JSON, b"{}"[..].into()),
                Ok(Err(TrySendError::Full(_))) => refused(503, "too many asks wait; ask again"),
                Ok(Err(TrySendError::Disconnected(_))) => refused(500, "the world has ended"),
                Err(why) => refused(400, &why),
            }
        }
        ("POST", "/ask") => refused(415, "an ask is application/json"),
        _ => refused(404, "there is /, /state and /crowd to get, and /ask to post to"),
    }
}

/// Steps a world in real time, or slower if frames take too long, until the server is gone.
fn run(mut world: World, asked: &Receiver<Ask>, shown: &RwLock<Face>) {
    let mut next = Instant::now();
    loop {
        let pace = Duration::from_secs_f64(world.pace());
        let number = world.number;
        let left = next.saturating_duration_since(Instant::now());
        if left.is_zero() {
            if !world.paused {
                world.step();
            }
            next = (next + pace).max(Instant::now());
        }
        // Handles at most `WAITING` further requests between frames: neither late frames nor endless requests block the
        // other.
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
