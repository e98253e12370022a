//! All ranks tied to rank 0: it listens, the others come to it.

use std::io::{Read, Result as Io, Write};
use std::net::{Ipv4Addr, Ipv6Addr, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::watch::Watch;
use super::{Place, RankError, bytes, floats};

/// Time for all to come.
const LIMIT: Duration = Duration::from_secs(60);
/// Between two tries.
const AGAIN: Duration = Duration::from_millis(50);
/// Time for one that came to say who it is.
const HELLO: Duration = Duration::from_secs(5);
/// First words of a rank; then its number and how many it knows of, 8 bytes each, little endian.
const WORDS: &[u8; 16] = b"nerd rank, v1   ";

/// The ties of a rank: of rank 0 to all others, of any other to rank 0.
#[derive(Debug)]
pub(super) struct Star {
    place: Place,
    watch: Arc<Watch>,
}

impl Star {
    /// Meets the others.
    pub fn join(place: &Place, end: fn(&RankError)) -> Result<Self, RankError> {
        let streams = if place.rank == 0 { listen(place)? } else { vec![(0, call(place)?)] };
        let failed = |e: std::io::Error| RankError::Meet(format!("rank {}: its connections: {e}", place.rank));
        for (_, stream) in &streams {
            stream.set_nodelay(true).map_err(failed)?;
        }
        Ok(Self { place: place.clone(), watch: Watch::over(place, streams, end).map_err(failed)? })
    }

    pub fn sum(&self, values: &mut [f32]) -> Result<(), RankError> {
        if self.place.rank > 0 {
            self.watch.send(0, &bytes(values))?;
            values.copy_from_slice(&self.numbers(0, values.len())?);
            return Ok(());
        }
        for rank in 1..self.place.world {
            let theirs = self.numbers(rank, values.len())?;
            values.iter_mut().zip(theirs).for_each(|(sum, x)| *sum += x);
        }
        self.to_all(0, &bytes(values))
    }

    pub fn share(&self, from: usize, mine: Option<Vec<u8>>) -> Result<Vec<u8>, RankError> {
        let all = match mine {
            Some(mine) if self.place.rank > 0 => {
                self.watch.send(0, &mine)?;
                return Ok(mine);
            }
            Some(mine) => mine,
            None => self.watch.receive(if self.place.rank == 0 { from } else { 0 })?,
        };
        if self.place.rank == 0 {
            self.to_all(from, &all)?;
        }
        Ok(all)
    }

    pub fn gather(&self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, RankError> {
        if self.place.rank > 0 {
            self.watch.send(0, &mine)?;
            return Ok(Vec::new());
        }
        std::iter::once(Ok(mine)).chain((1..self.place.world).map(|rank| self.watch.receive(rank))).collect()
    }

    pub fn leave(&self, reason: Option<&str>) {
        self.watch.leave(reason);
    }

    /// From rank 0 to all others but the one that has it.
    fn to_all(&self, but: usize, bytes: &[u8]) -> Result<(), RankError> {
        (1..self.place.world).filter(|rank| *rank != but).try_for_each(|rank| self.watch.send(rank, bytes))
    }

    fn numbers(&self, rank: usize, len: usize) -> Result<Vec<f32>, RankError> {
        let theirs = floats(&self.watch.receive(rank)?);
        if theirs.len() == len {
            return Ok(theirs);
        }
        let how = format!("rank {rank} has {}, this one {len}: give all ranks the same command and the same program", theirs.len());
        Err(RankError::Apart { rank: self.place.rank, what: "vectors to add up".into(), how })
    }
}

/// Rank 0 waits for all others.
fn listen(place: &Place) -> Result<Vec<(usize, TcpStream)>, RankError> {
    let (port, since) = (place.port, Instant::now());
    let failed = |e: std::io::Error| RankError::Meet(format!("rank 0 cannot listen on port {port} (MASTER_PORT): {e}; name a free one"));
    let listener = bind(place).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let mut came: Vec<(usize, TcpStream)> = Vec::new();
    while came.len() + 1 < place.world {
        if since.elapsed() > LIMIT {
            let missing = (1..place.world).filter(|rank| came.iter().all(|(known, _)| known != rank)).map(|rank| rank.to_string());
            let (missing, world, seconds) = (missing.collect::<Vec<_>>().join(", "), place.world, LIMIT.as_secs());
            return Err(RankError::Meet(format!("of {world} ranks these did not come within {seconds} s: {missing}; are they started?")));
        }
        match listener.accept() {
            Ok((stream, _)) => {
                // Whoever says something else is none of ours.
                let Ok((rank, world, stream)) = greeted(stream) else { continue };
                if world != place.world {
                    return Err(RankError::Meet(format!("rank {rank} has WORLD_SIZE {world}, rank 0 has {}", place.world)));
                }
                if rank == 0 || rank >= world || came.iter().any(|(known, _)| *known == rank) {
                    return Err(RankError::Meet(format!("two processes are rank {rank}: give each its own RANK")));
                }
                came.push((rank, stream));
            }
            Err(_) => std::thread::sleep(AGAIN),
        }
    }
    for (rank, stream) in &mut came {
        stream.write_all(WORDS).map_err(|e| RankError::Meet(format!("rank {rank} came and went: {e}")))?;
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
    if said.starts_with(WORDS) { Ok((number(16), number(24), stream)) } else { Err(std::io::ErrorKind::InvalidData.into()) }
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
                return Err(RankError::Meet(text));
            }
            Err(_) => std::thread::sleep(AGAIN),
        }
    };
    let mut heard = [0; WORDS.len()];
    // Rank 0 gives up first, and its end is heard.
    let met =
        stream.set_read_timeout(Some(LIMIT + HELLO)).and_then(|()| stream.write_all(&hello)).and_then(|()| stream.read_exact(&mut heard));
    if met.is_err() || heard != *WORDS {
        return Err(RankError::Meet(format!("rank {rank}: rank 0 at {address}:{port} did not take it up; what it says tells why")));
    }
    Ok(stream)
}
