//! The page and its two questions, on this machine alone.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, PoisonError, RwLock};

use nerd_train::replay::{SCRIPT, escape, fill, script};
use tiny_http::{Header, Method, Request, Response, Server};

use super::{Ask, World};
use crate::prelude::*;

/// Threads that answer.
const THREADS: usize = 4;
/// Asks that wait at most; more are turned away.
const WAITING: usize = 64;
/// Longest ask (bytes): what the server has read before it hands a request over.
const LONGEST: usize = 1024;

const PAGE: &str = include_str!("live.html");
const LIVE: &str = include_str!("live.js");

/// A world that is served.
pub struct Live {
    server: Arc<Server>,
    page: Arc<str>,
    asks: SyncSender<Ask>,
    shown: Arc<RwLock<Arc<str>>>,
}

impl Live {
    /// Serves a world at a port of this machine (0: any that is free), and steps it in real time.
    ///
    /// # Errors
    /// If the port is taken.
    pub fn serve(mut world: World, title: &str, port: u16) -> Result<Self> {
        let server = Server::http(("127.0.0.1", port)).map_err(|e| anyhow::anyhow!("--port {port}: {e}; name another"))?;
        let data = script(&world.page(title));
        let page = fill(PAGE, &[("TITLE", &escape(title)), ("PAINTER", SCRIPT), ("LIVE", LIVE), ("DATA", &data)]);
        let shown = Arc::new(RwLock::new(text(&mut world)));
        let (asks, asked) = sync_channel(WAITING);
        std::thread::spawn({
            let shown = shown.clone();
            move || run(world, &asked, &shown)
        });
        let live = Self { server: server.into(), page: page.into(), asks, shown };
        (0..THREADS).for_each(|_| live.answer());
        Ok(live)
    }

    /// Where it is.
    pub fn address(&self) -> String {
        format!("http://{}", self.server.server_addr())
    }

    fn answer(&self) {
        let Self { server, page, asks, shown } = self;
        let (server, page, asks, shown) = (server.clone(), page.clone(), asks.clone(), shown.clone());
        std::thread::spawn(move || {
            while let Ok(mut request) = server.recv() {
                // The rest of a long body is waited for when its request is dropped: not here.
                if lazy(&request) {
                    std::thread::spawn(move || request.respond(Response::from_string(LONG).with_status_code(413)));
                    continue;
                }
                let (code, kind, text) = reply(&mut request, &page, &asks, &shown);
                let header = Header::from_bytes("Content-Type", kind).into_iter();
                let fresh = Header::from_bytes("Cache-Control", "no-store").into_iter();
                let mut response = Response::from_string(&*text).with_status_code(code);
                header.chain(fresh).for_each(|header| response.add_header(header));
                // A visitor who is gone does not want the answer.
                let _ = request.respond(response);
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

type Reply = (u16, &'static str, Arc<str>);

fn reply(request: &mut Request, page: &Arc<str>, asks: &SyncSender<Ask>, shown: &RwLock<Arc<str>>) -> Reply {
    const JSON: &str = "application/json";
    let refused = |code: u16, why: &str| (code, "text/plain; charset=utf-8", why.into());
    // Another site's page that a browser here has open can neither read this one (its host is another) nor ask (its kind of text is another).
    let host = header(request, "Host").unwrap_or("").rsplit_once(':').map_or("", |(host, _)| host);
    if !["127.0.0.1", "localhost"].contains(&host) {
        return refused(403, "this is for the machine that it runs on: open http://127.0.0.1 and its port");
    }
    match (request.method(), request.url()) {
        (Method::Get, "/") => (200, "text/html; charset=utf-8", page.clone()),
        (Method::Get, "/state") => (200, JSON, shown.read().unwrap_or_else(PoisonError::into_inner).clone()),
        (Method::Post, "/ask") if header(request, "Content-Type") == Some(JSON) => {
            let mut text = String::new();
            if request.as_reader().read_to_string(&mut text).is_err() {
                return refused(400, "an ask is UTF-8");
            }
            match Ask::read(&text).map(|ask| asks.try_send(ask)) {
                Ok(Ok(())) => (200, JSON, "{}".into()),
                Ok(Err(TrySendError::Full(_))) => refused(503, "too many asks wait; ask again"),
                Ok(Err(TrySendError::Disconnected(_))) => refused(500, "the world has ended"),
                Err(why) => refused(400, &why),
            }
        }
        (Method::Post, "/ask") => refused(415, "an ask is application/json"),
        _ => refused(404, "there is / and /state to get, and /ask to post to"),
    }
}

/// Steps a world in real time until nobody can ask it any more. Where it cannot keep up, it is slow.
fn run(mut world: World, asked: &Receiver<Ask>, shown: &RwLock<Arc<str>>) {
    let pace = Duration::from_secs_f64(world.pace());
    let mut next = Instant::now() + pace;
    loop {
        let left = next.saturating_duration_since(Instant::now());
        // Asks wait while a frame is due, however many they are.
        if left.is_zero() {
            if !world.paused() {
                world.step();
            }
            next = (next + pace).max(Instant::now());
        } else {
            match asked.recv_timeout(left) {
                Ok(ask) => world.answer(ask),
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => continue,
            }
        }
        *shown.write().unwrap_or_else(PoisonError::into_inner) = text(&mut world);
    }
}

fn text(world: &mut World) -> Arc<str> {
    serde_json::to_string(&world.shown()).unwrap_or_else(|e| format!("{{\"trouble\":\"{e}\"}}")).into()
}
