//! A star of TCP connections: rank 0 listens, the others connect.
//!
//! A message is a byte for its kind, a length (8 bytes, little endian) and the payload. A rank that fails sends its reason, and rank 0
//! passes it on; a connection that closes without one is a lost rank. A rank that waits elsewhere, such as in a driver, is ended by its
//! launcher.

use std::io::{Error, ErrorKind, Read, Result as Io, Write};
use std::net::{Ipv4Addr, Ipv6Addr, TcpListener, TcpStream};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

use super::place::{Place, RankError, bytes, floats};
use crate::prelude::*;

/// Time for all to come.
const LIMIT: Duration = Duration::from_secs(60);
/// Between two tries.
const AGAIN: Duration = Duration::from_millis(50);
/// Time for a new connection to identify itself.
const HELLO: Duration = Duration::from_secs(5);
/// Time to part: what was sent last has to arrive before a connection closes.
const PARTING: Duration = Duration::from_secs(5);
/// First words of a rank; then its number and how many it knows of, 8 bytes each, little endian.
const WORDS: &[u8; 16] = b"nerd rank, v1   ";

const DATA: u8 = 0;
/// Followed by the number of the rank (8 bytes) and its reason.
const LOST: u8 = 1;
const BYE: u8 = 2;

impl Ranks {
    /// Meets the others; waits for them up to a minute.
    pub fn join(place: Place) -> Result<Self, RankError> {
        let ties = match (place.world, place.rank) {
            (1, _) => Vec::new(),
            (_, 0) => listen(&place)?,
            _ => vec![(0, call(&place)?)],
        };
        let failed = |e: Error| RankError(format!("rank {}: its connections: {e}", place.rank));
        for (_, stream) in &ties {
            stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(None)).map_err(failed)?;
        }
        Ok(Self { place, ties, lost: OnceLock::new(), parted: AtomicBool::new(false) })
    }

    /// Adds up the vectors of all ranks, in rank order, so that all have the same bits after it.
    pub fn sum(&self, values: &mut [f32]) -> Result<(), RankError> {
        if self.ties.is_empty() {
            return Ok(());
        }
        if !self.leads() {
            self.send(0, &bytes(values))?;
            values.copy_from_slice(&self.numbers(0, values.len())?);
            return Ok(());
        }
        for rank in 1..self.place.world {
            let theirs = self.numbers(rank, values.len())?;
            values.iter_mut().zip(theirs).for_each(|(sum, x)| *sum += x);
        }
        self.to_all(0, &bytes(values))
    }

    /// What rank `from` has, on all ranks; only there is `make` called.
    pub fn share(&self, from: usize, make: impl FnOnce() -> Vec<u8>) -> Result<Vec<u8>, RankError> {
        let all = match (from == self.place.rank).then(make) {
            Some(mine) if !self.leads() => {
                self.send(0, &mine)?;
                return Ok(mine);
            }
            Some(mine) => mine,
            None => self.receive(if self.leads() { from } else { 0 })?,
        };
        if self.leads() {
            self.to_all(from, &all)?;
        }
        Ok(all)
    }

    /// Parts from the others: done, or for a reason that they will tell; waits a little for them to part, too. Once is enough.
    pub fn leave(&self, reason: Option<&str>) {
        if self.parted.swap(true, SeqCst) {
            return;
        }
        for (_, stream) in &self.ties {
            let _ = match (reason, self.lost.get()) {
                (None, _) => write(stream, BYE, &[]),
                (Some(_), Some((rank, reason))) => write(stream, LOST, &farewell(*rank, reason)),
                (Some(reason), None) => write(stream, LOST, &farewell(self.place.rank, reason)),
            };
            let _ = stream.shutdown(std::net::Shutdown::Write);
        }
        let since = Instant::now();
        for (_, stream) in &self.ties {
            let left = PARTING.saturating_sub(since.elapsed()).max(Duration::from_millis(1));
            while stream.set_read_timeout(Some(left)).is_ok() && read(stream).is_ok() {}
        }
    }

    fn send(&self, rank: usize, bytes: &[u8]) -> Result<(), RankError> {
        let stream = self.tie(rank)?;
        // A lost rank may have sent its reason.
        write(stream, DATA, bytes).or_else(|_| {
            loop {
                self.receive(rank)?;
            }
        })
    }

    /// What a rank sent next.
    fn receive(&self, rank: usize) -> Result<Vec<u8>, RankError> {
        let (rank, reason) = match read(self.tie(rank)?) {
            Ok((DATA, bytes)) => return Ok(bytes),
            Ok((LOST, text)) => {
                let (number, reason) = text.split_first_chunk().unwrap_or((&[0; 8], &[]));
                (u64::from_le_bytes(*number) as usize, String::from_utf8_lossy(reason).into_owned())
            }
            Ok(_) => (rank, "it is done, and others are not".into()),
            Err(e) => (rank, missed(&e)),
        };
        let (rank, reason) = self.lost.get_or_init(|| (rank, reason)).clone();
        Err(RankError(format!("rank {rank} of {} ended: {reason}", self.place.world)))
    }

    fn tie(&self, rank: usize) -> Result<&TcpStream, RankError> {
        let none = || RankError(format!("rank {} has no tie to rank {rank}", self.place.rank));
        self.ties.iter().find(|(other, _)| *other == rank).map(|(_, stream)| stream).ok_or_else(none)
    }

    /// From rank 0 to all others but the one that has it.
    fn to_all(&self, but: usize, bytes: &[u8]) -> Result<(), RankError> {
        (1..self.place.world).filter(|rank| *rank != but).try_for_each(|rank| self.send(rank, bytes))
    }

    fn numbers(&self, rank: usize, len: usize) -> Result<Vec<f32>, RankError> {
        let theirs = floats(&self.receive(rank)?);
        if theirs.len() == len {
            return Ok(theirs);
        }
        let (own, found) = (self.place.rank, theirs.len());
        Err(RankError(format!(
            "rank {own}: of vectors to add up rank {rank} has {found}, this one {len}: give all ranks the same command and the same program"
        )))
    }
}

fn farewell(rank: usize, reason: &str) -> Vec<u8> {
    [&(rank as u64).to_le_bytes(), reason.as_bytes()].concat()
}

/// How a rank was missed.
fn missed(error: &Error) -> String {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted => {
            "its connection closed without a word; its own output, or its machine's, says why".into()
        }
        _ => error.to_string(),
    }
}

fn write(mut to: &TcpStream, what: u8, bytes: &[u8]) -> Io<()> {
    let mut head = [what; 9];
    head[1..].copy_from_slice(&(bytes.len() as u64).to_le_bytes());
    to.write_all(&head)?;
    to.write_all(bytes)
}

fn read(mut from: &TcpStream) -> Io<(u8, Vec<u8>)> {
    let mut head = [0; 9];
    from.read_exact(&mut head)?;
    let [what, length @ ..] = head;
    let length = u64::from_le_bytes(length);
    // Grows with what comes, so that a wrong length asks for no memory.
    let mut bytes = Vec::with_capacity(length.min(1 << 24) as usize);
    from.take(length).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < length {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    Ok((what, bytes))
}

/// Rank 0 waits for all others.
fn listen(place: &Place) -> Result<Vec<(usize, TcpStream)>, RankError> {
    let (port, since) = (place.port, Instant::now());
    let failed = |e: Error| RankError(format!("rank 0 cannot listen on port {port} (MASTER_PORT): {e}; name a free one"));
    let listener = bind(place).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let mut came: Vec<(usize, TcpStream)> = Vec::new();
    while came.len() + 1 < place.world {
        if since.elapsed() > LIMIT {
            let missing = (1..place.world).filter(|rank| came.iter().all(|(known, _)| known != rank)).map(|rank| rank.to_string());
            let (missing, world, seconds) = (missing.collect::<Vec<_>>().join(", "), place.world, LIMIT.as_secs());
            return Err(RankError(format!("of {world} ranks these did not come within {seconds} s: {missing}; are they started?")));
        }
        match listener.accept() {
            Ok((stream, _)) => {
                // Whoever says something else is none of ours.
                let Ok((rank, world, stream)) = greeted(stream) else { continue };
                if world != place.world {
                    return Err(RankError(format!("rank {rank} has WORLD_SIZE {world}, rank 0 has {}", place.world)));
                }
                if rank == 0 || rank >= world || came.iter().any(|(known, _)| *known == rank) {
                    return Err(RankError(format!("two processes are rank {rank}: give each its own RANK")));
                }
                came.push((rank, stream));
            }
            Err(_) => std::thread::sleep(AGAIN),
        }
    }
    for (rank, stream) in &mut came {
        stream.write_all(WORDS).map_err(|e| RankError(format!("rank {rank} came and went: {e}")))?;
    }
    came.sort_by_key(|(rank, _)| *rank);
    Ok(came)
}

/// Listens on this machine alone where all are on it.
fn bind(place: &Place) -> Io<TcpListener> {
    if ["127.0.0.1", "localhost"].contains(&place.address.as_str()) {
        return TcpListener::bind((Ipv4Addr::LOCALHOST, place.port));
    }
    TcpListener::bind((Ipv6Addr::UNSPECIFIED, place.port)).or_else(|_| TcpListener::bind((Ipv4Addr::UNSPECIFIED, place.port)))
}

/// Who came.
fn greeted(mut stream: TcpStream) -> Io<(usize, usize, TcpStream)> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(HELLO))?;
    let mut said = [0; 32];
    stream.read_exact(&mut said)?;
    let number = |at: usize| said[at..].first_chunk().map_or(0, |x| u64::from_le_bytes(*x) as usize);
    if said.starts_with(WORDS) { Ok((number(16), number(24), stream)) } else { Err(ErrorKind::InvalidData.into()) }
}

/// Another rank comes to rank 0, and waits until all have come.
fn call(place: &Place) -> Result<TcpStream, RankError> {
    let Place { rank, world, address, port, .. } = place;
    let since = Instant::now();
    let hello = [&WORDS[..], &(*rank as u64).to_le_bytes(), &(*world as u64).to_le_bytes()].concat();
    let mut stream = loop {
        match TcpStream::connect((address.as_str(), *port)) {
            // A port that is asked for again and again may at last be given to who asks, and answer itself.
            Ok(stream) if stream.local_addr().ok() != stream.peer_addr().ok() => break stream,
            Ok(_) => std::thread::sleep(AGAIN),
            Err(e) if since.elapsed() > LIMIT => {
                let seconds = LIMIT.as_secs();
                let text = format!("rank {rank} found no rank 0 at {address}:{port} (MASTER_ADDR, MASTER_PORT) within {seconds} s: {e}");
                return Err(RankError(text));
            }
            Err(_) => std::thread::sleep(AGAIN),
        }
    };
    let mut heard = [0; WORDS.len()];
    // Rank 0 gives up first, and its end is heard.
    let met =
        stream.set_read_timeout(Some(LIMIT + HELLO)).and_then(|()| stream.write_all(&hello)).and_then(|()| stream.read_exact(&mut heard));
    if met.is_err() || heard != *WORDS {
        return Err(RankError(format!("rank {rank}: rank 0 at {address}:{port} did not accept it; its output says why")));
    }
    Ok(stream)
}
