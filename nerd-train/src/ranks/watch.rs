//! The ties of a rank, and the watch over them.
//!
//! A frame is a byte that says what it is, the length of what follows (8 bytes, little endian), and that. Every tie has a thread that
//! reads, whatever else the rank does, and one thread of the rank sends beats. So a rank that died is noticed when its connection
//! closes, one that hangs with its machine when it is silent; rank 0 tells all others.

use std::io::{ErrorKind, Read, Result, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Place, RankError};

/// Between two beats.
const BEAT: Duration = Duration::from_secs(5);
/// A tie on which nothing came for so long is lost.
const SILENCE: Duration = Duration::from_secs(30);
/// And one that takes nothing for so long: less, so that this rank is not silent to the others meanwhile.
const STUCK: Duration = Duration::from_secs(20);
/// Time for a busy rank to notice by itself that another one is lost, and time for one that has noticed to end.
const GRACE: Duration = Duration::from_secs(10);
const ENDING: Duration = Duration::from_secs(25);
/// Time to part: what was sent last has to arrive before a connection closes.
const PARTING: Duration = Duration::from_secs(5);
/// How often a rank that waits looks whether one is lost.
const LOOK: Duration = Duration::from_millis(100);

const DATA: u8 = 0;
const BEATS: u8 = 1;
/// Followed by the number of the rank (8 bytes) and its reason.
const LOST: u8 = 2;
const BYE: u8 = 3;

/// A tie to another rank.
#[derive(Debug)]
struct Tie {
    rank: usize,
    out: Mutex<TcpStream>,
    inbox: Mutex<Receiver<Vec<u8>>>,
}

/// All ties of a rank.
#[derive(Debug)]
pub(super) struct Watch {
    place: Place,
    ties: Vec<Tie>,
    /// The first rank that was lost.
    lost: Mutex<Option<RankError>>,
    /// Whether this rank knows it.
    known: AtomicBool,
    parted: AtomicBool,
    /// Threads that read.
    readers: AtomicUsize,
}

fn open<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Watches over ties to these ranks.
    pub fn over(place: &Place, streams: Vec<(usize, TcpStream)>, end: fn(&RankError)) -> Result<Arc<Self>> {
        let (mut ties, mut readers) = (Vec::new(), Vec::new());
        for (rank, stream) in streams {
            let (sender, inbox) = channel();
            stream.set_read_timeout(Some(SILENCE))?;
            stream.set_write_timeout(Some(STUCK))?;
            readers.push((rank, stream.try_clone()?, sender));
            ties.push(Tie { rank, out: Mutex::new(stream), inbox: Mutex::new(inbox) });
        }
        let (place, count) = (place.clone(), AtomicUsize::new(ties.len()));
        let (lost, known, parted) = Default::default();
        let watch = Arc::new(Self { place, ties, lost, known, parted, readers: count });
        for (rank, stream, sender) in readers {
            let watch = watch.clone();
            std::thread::spawn(move || {
                watch.read(rank, stream, &sender, end);
                watch.readers.fetch_sub(1, SeqCst);
            });
        }
        let weak = Arc::downgrade(&watch);
        std::thread::spawn(move || {
            while let Some(watch) = weak.upgrade().filter(|watch| !watch.parted.load(SeqCst)) {
                // A tie that cannot be written to is its reader's to report.
                watch.ties.iter().for_each(|tie| drop(write(&open(&tie.out), BEATS, &[])));
                drop(watch);
                std::thread::sleep(BEAT);
            }
        });
        Ok(watch)
    }

    /// Sends to a rank.
    pub fn send(&self, rank: usize, bytes: &[u8]) -> std::result::Result<(), RankError> {
        let tie = self.tie(rank)?;
        write(&open(&tie.out), DATA, bytes).map_err(|e| {
            // That it cannot be written to may follow from another's end, which is on its way.
            std::thread::sleep(LOOK);
            self.lose(rank, &said(&e))
        })
    }

    /// What a rank sent next; waits for it as long as that is alive.
    pub fn receive(&self, rank: usize) -> std::result::Result<Vec<u8>, RankError> {
        let inbox = open(&self.tie(rank)?.inbox);
        loop {
            match inbox.recv_timeout(LOOK) {
                Ok(bytes) => return Ok(bytes),
                Err(RecvTimeoutError::Timeout) => {
                    if open(&self.lost).is_some() {
                        return Err(self.lose(rank, ""));
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return Err(self.lose(rank, "it is done, and others are not")),
            }
        }
    }

    /// Parts from all, and waits a little for them to part, too.
    pub fn leave(&self, reason: Option<&str>) {
        let known = self.known.load(SeqCst);
        if self.parted.swap(true, SeqCst) {
            return;
        }
        for tie in &self.ties {
            let out = open(&tie.out);
            let _ = match reason {
                // Who ends because another did need not say it again.
                Some(_) if known => Ok(()),
                Some(reason) => write(&out, LOST, &farewell(self.place.rank, reason)),
                None => write(&out, BYE, &[]),
            };
            let _ = out.shutdown(std::net::Shutdown::Write);
        }
        let since = Instant::now();
        while self.readers.load(SeqCst) > 0 && since.elapsed() < PARTING {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn tie(&self, rank: usize) -> std::result::Result<&Tie, RankError> {
        let none = || RankError::Meet(format!("rank {} has no tie to rank {rank}", self.place.rank));
        self.ties.iter().find(|tie| tie.rank == rank).ok_or_else(none)
    }

    /// Notes that a rank is lost, unless one was before, and that this rank knows it.
    fn lose(&self, rank: usize, reason: &str) -> RankError {
        let error = self.note(rank, reason).0;
        self.known.store(true, SeqCst);
        error
    }

    /// The first rank that was lost, and whether that is this one.
    fn note(&self, rank: usize, reason: &str) -> (RankError, bool) {
        let mut lost = open(&self.lost);
        let first = lost.is_none();
        (lost.get_or_insert_with(|| RankError::Lost { rank, world: self.place.world, reason: reason.into() }).clone(), first)
    }

    /// Reads what a rank says, until it parts or is lost.
    fn read(&self, rank: usize, stream: TcpStream, sender: &Sender<Vec<u8>>, end: fn(&RankError)) {
        let (rank, reason) = loop {
            match read(&stream) {
                Ok((BYE, _)) => return,
                Ok((LOST, text)) => {
                    let (number, reason) = text.split_first_chunk().unwrap_or((&[0; 8], &[]));
                    break (u64::from_le_bytes(*number) as usize, String::from_utf8_lossy(reason).into_owned());
                }
                Ok((DATA, bytes)) => drop(sender.send(bytes)),
                Ok(_) => {}
                Err(e) => break (rank, said(&e)),
            }
        };
        let (error, first) = self.note(rank, &reason);
        if self.place.rank == 0 && first {
            let others = self.ties.iter().filter(|tie| tie.rank != rank);
            others.for_each(|tie| drop(write(&open(&tie.out), LOST, &farewell(rank, &reason))));
        }
        let since = Instant::now();
        while !self.parted.load(SeqCst) {
            if since.elapsed() > if self.known.load(SeqCst) { ENDING } else { GRACE } {
                return end(&error);
            }
            std::thread::sleep(LOOK);
        }
    }
}

fn farewell(rank: usize, reason: &str) -> Vec<u8> {
    [&(rank as u64).to_le_bytes(), reason.as_bytes()].concat()
}

/// How a rank was missed.
fn said(error: &std::io::Error) -> String {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted => {
            "its connection closed without a word; its own output, or its machine's, says why".into()
        }
        ErrorKind::WouldBlock | ErrorKind::TimedOut => format!("nothing was heard of it for {} s", SILENCE.as_secs()),
        _ => error.to_string(),
    }
}

/// Writes a frame.
fn write(mut to: &TcpStream, what: u8, bytes: &[u8]) -> Result<()> {
    let mut head = [what; 9];
    head[1..].copy_from_slice(&(bytes.len() as u64).to_le_bytes());
    to.write_all(&head)?;
    to.write_all(bytes)
}

/// Reads a frame.
fn read(mut from: &TcpStream) -> Result<(u8, Vec<u8>)> {
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
