//! HTTP server for one small page. Silent or unfinished connections are closed. At most [`SEATS`] connections are open.
//! Each further one closes the connection that has been silent for longest.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::prelude::*;

/// Largest number of open connections.
const SEATS: usize = 200;
/// Longest silence between the requests of a connection.
const SILENT: Duration = Duration::from_secs(20);
/// Longest time to receive a request, or to send an answer.
const SLOW: Duration = Duration::from_secs(5);
/// Largest head of a request (bytes).
const HEAD: usize = 8192;
/// Largest body of a request (bytes).
pub const BODY: usize = 1024;

/// A parsed HTTP request.
#[derive(Default)]
pub struct Request {
    pub method: String,
    pub path: String,
    pub host: String,
    pub kind: String,
    pub body: Vec<u8>,
    /// Whether the connection closes after this request.
    last: bool,
}

/// An answer: HTTP status, content type and body.
pub type Reply = (u16, &'static str, Arc<[u8]>);
type Answer = dyn Fn(&Request) -> Reply + Send + Sync;

/// Open connections by number, each with the time since which it is silent.
type Seats = Mutex<BTreeMap<u64, (Arc<TcpStream>, Instant)>>;

pub struct Server {
    pub address: std::net::SocketAddr,
    over: Arc<AtomicBool>,
}

impl Server {
    /// Serves a port of this machine until dropped; port 0 takes any free one.
    pub fn new(port: u16, answer: Arc<Answer>) -> std::io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", port))?;
        let address = listener.local_addr()?;
        let over = Arc::new(AtomicBool::new(false));
        let ended = over.clone();
        std::thread::Builder::new().spawn(move || {
            let seats = Arc::new(Seats::default());
            for number in 0.. {
                let stream = listener.accept();
                if ended.load(Ordering::SeqCst) {
                    return;
                }
                match stream {
                    Ok((stream, _)) => seat(number, stream, &seats, &answer),
                    // Frees a file descriptor, for lack of which `accept` may fail.
                    Err(_) => {
                        hang_up(&seats);
                        std::thread::sleep(Duration::from_millis(20));
                    }
                }
            }
        })?;
        Ok(Self { address, over })
    }
}

/// Ends the accept loop: connects once, so that the loop wakes and sees `over`.
impl Drop for Server {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        let _ = TcpStream::connect_timeout(&self.address, SLOW);
    }
}

fn seat(number: u64, stream: TcpStream, seats: &Arc<Seats>, answer: &Arc<Answer>) {
    let stream = Arc::new(stream);
    let own = seats.clone();
    let answer = answer.clone();
    if locked(seats).len() >= SEATS {
        hang_up(seats);
    }
    locked(seats).insert(number, (stream.clone(), Instant::now()));
    // Closes the connection if no thread can be started.
    let served = std::thread::Builder::new().spawn(move || {
        while let Ok(last) = serve(&stream, &*answer) {
            if last {
                break;
            }
            locked(&own).entry(number).and_modify(|seat| seat.1 = Instant::now());
        }
        locked(&own).remove(&number);
    });
    if served.is_err() {
        locked(seats).remove(&number);
    }
}

/// Closes the connection that has been silent for longest.
fn hang_up(seats: &Seats) {
    let mut seats = locked(seats);
    let oldest = seats.iter().min_by_key(|(_, seat)| seat.1).map(|(number, _)| *number);
    if let Some((stream, _)) = oldest.and_then(|number| seats.remove(&number)) {
        let _ = stream.shutdown(Shutdown::Both);
    }
}

fn locked(seats: &Seats) -> std::sync::MutexGuard<'_, BTreeMap<u64, (Arc<TcpStream>, Instant)>> {
    seats.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes an answer that refuses a request with a status and a reason.
pub fn refused(code: u16, why: &str) -> Reply {
    (code, "text/plain; charset=utf-8", why.as_bytes().into())
}

/// Answers one request; returns whether it was the connection's last. An error ends the connection.
fn serve(mut stream: &TcpStream, answer: &Answer) -> std::io::Result<bool> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(SLOW))?;
    let mut asked = Request { last: true, ..Request::default() };
    let (code, kind, text) = match read(stream)? {
        Ok(request) => {
            asked = request;
            answer(&asked)
        }
        Err((code, why)) => refused(code, why),
    };
    let length = text.len();
    let close = if asked.last { "Connection: close\r\n" } else { "" };
    let head = format!(
        "HTTP/1.1 {code} \r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\n{close}\r\n"
    );
    let text = if asked.method == "HEAD" { b"" } else { &text[..] };
    stream.write_all(&[head.as_bytes(), text].concat())?;
    if asked.last {
        // Reads what the client still sends: closing earlier would reset the connection and cut the answer.
        stream.shutdown(Shutdown::Write)?;
        stream.set_read_timeout(Some(Duration::from_millis(500)))?;
        let _ = std::io::copy(&mut stream.take(1 << 20), &mut std::io::sink());
    }
    Ok(asked.last)
}

/// Reads a request, or returns the status and reason of a refusal.
fn read(mut stream: &TcpStream) -> std::io::Result<Result<Request, (u16, &'static str)>> {
    let mut bytes = Vec::new();
    let mut began = None;
    loop {
        let left = began.map_or(SILENT, |began: Instant| SLOW.saturating_sub(began.elapsed()));
        if left.is_zero() {
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        let mut some = [0; 4096];
        let n = stream.read(&mut some)?;
        if n == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        began.get_or_insert_with(Instant::now);
        bytes.extend_from_slice(&some[..n]);
        match parsed(&bytes).transpose() {
            Some(done) => return Ok(done),
            None if bytes.len() < HEAD + BODY => {}
            None => return Ok(Err((431, "an ask has a shorter head"))),
        }
    }
}

/// Parses a request; `None` while it is not complete. Pipelined requests are not supported.
fn parsed(bytes: &[u8]) -> Result<Option<Request>, (u16, &'static str)> {
    const LONG: (u16, &str) = (413, "an ask is at most 1024 bytes, and says how many");
    let mut headers = [httparse::EMPTY_HEADER; 64];
    let mut head = httparse::Request::new(&mut headers);
    let httparse::Status::Complete(begin) = head.parse(bytes).map_err(|_| (400, "this is no HTTP"))? else {
        return Ok(None);
    };
    let header = |name: &str| {
        let found = head.headers.iter().find(|h| h.name.eq_ignore_ascii_case(name));
        found.map(|h| String::from_utf8_lossy(h.value).into_owned())
    };
    let connection = header("Connection").unwrap_or_default().to_ascii_lowercase();
    if ["Transfer-Encoding", "Expect"].into_iter().any(|name| header(name).is_some()) || connection.contains("upgrade")
    {
        return Err(LONG);
    }
    let length =
        header("Content-Length").map_or(Ok(0), |n| n.trim().parse::<usize>()).map_err(|_| (400, "no length"))?;
    if length > BODY {
        return Err(LONG);
    }
    let Some(body) = bytes.get(begin..begin + length) else { return Ok(None) };
    let word = |word: Option<&str>| word.unwrap_or_default().to_string();
    Ok(Some(Request {
        method: word(head.method),
        path: word(head.path),
        host: header("Host").unwrap_or_default(),
        kind: header("Content-Type").unwrap_or_default(),
        body: body.into(),
        last: connection.contains("close") || head.version == Some(0),
    }))
}
