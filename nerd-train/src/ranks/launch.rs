//! The ranks of one machine, started by the command itself: as many processes of the same program with the same arguments.

use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, TcpListener};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use super::RankError;

/// Says to a rank that it was started here; it ends when its standard input does, which is when its launcher does.
pub const LAUNCHED: &str = "NERD_LAUNCHED";
/// How many threads a rank has.
const THREADS: &str = "RAYON_NUM_THREADS";
/// Time for the others to end by themselves once one has failed.
const PATIENCE: Duration = Duration::from_secs(20);

/// How the ranks ended.
#[derive(Debug, PartialEq, Eq)]
pub enum End {
    /// All is done.
    Well,
    /// Rank 0 has said why not.
    Said,
    /// For a reason that nobody has said yet.
    Ill(String),
}

/// A rank.
struct Started {
    child: Child,
    /// The last line that it said, of all but rank 0: that speaks for itself.
    last: Option<Receiver<String>>,
    ended: Option<ExitStatus>,
}

/// Starts `world` ranks of this very command and waits for them. A rank that fails ends the others.
///
/// # Errors
/// [`RankError::Meet`] if there is no free port, or a process cannot be started.
pub fn launch(world: usize) -> Result<End, RankError> {
    let failed = |e: std::io::Error| RankError::Meet(format!("{world} ranks cannot be started: {e}"));
    let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr()).map_err(failed)?.port();
    let mut ranks: Vec<Started> = Vec::new();
    for rank in 0..world {
        match start(rank, world, port) {
            Ok(started) => ranks.push(started),
            Err(e) => {
                ranks.iter_mut().for_each(|rank| drop(rank.child.kill()));
                return Err(failed(e));
            }
        }
    }
    let mut first: Option<(usize, Instant)> = None;
    while ranks.iter().any(|rank| rank.ended.is_none()) {
        for (number, rank) in ranks.iter_mut().enumerate().filter(|(_, rank)| rank.ended.is_none()) {
            rank.ended = rank.child.try_wait().map_err(failed)?;
            if rank.ended.is_some_and(|status| !status.success()) {
                first.get_or_insert((number, Instant::now()));
            }
        }
        if first.is_some_and(|(_, since)| since.elapsed() > PATIENCE) {
            ranks.iter_mut().filter(|rank| rank.ended.is_none()).for_each(|rank| drop(rank.child.kill()));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let Some((number, _)) = first else { return Ok(End::Well) };
    let of = |rank: usize| ranks[rank].ended.map_or_else(String::new, |status| status.to_string());
    if ranks[0].ended.and_then(|status| status.code()) == Some(2) {
        return Ok(End::Said);
    }
    let last = ranks[number].last.as_ref().and_then(|last| last.iter().last()).unwrap_or_default();
    let last = last.trim_start_matches("error: ");
    Ok(End::Ill(format!("rank {number} of {world} ended first, with {}{}{last}", of(number), if last.is_empty() { "" } else { ": " })))
}

fn start(rank: usize, world: usize, port: u16) -> std::io::Result<Started> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(std::env::args_os().skip(1)).stdin(Stdio::piped()).env(LAUNCHED, "1");
    command.env("RANK", rank.to_string()).env("WORLD_SIZE", world.to_string()).env("LOCAL_RANK", rank.to_string());
    command.env("MASTER_ADDR", "127.0.0.1").env("MASTER_PORT", port.to_string()).env_remove("TORCHELASTIC_USE_AGENT_STORE");
    // The cores of the machine are shared out, too.
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    if std::env::var_os(THREADS).is_none() {
        command.env(THREADS, (cores / world).max(1).to_string());
    }
    if rank > 0 {
        command.stdout(Stdio::null()).stderr(Stdio::piped());
    }
    let mut child = command.spawn()?;
    let last = child.stderr.take().map(|stderr| {
        let (sender, last) = channel();
        std::thread::spawn(move || BufReader::new(stderr).lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        last
    });
    Ok(Started { child, last, ended: None })
}

/// Ends this process when its launcher ends, if it has one.
pub fn with_launcher() {
    if std::env::var_os(LAUNCHED).is_some() {
        std::thread::spawn(|| {
            // Nothing is ever written there.
            let _ = std::io::stdin().read(&mut [0]);
            std::process::exit(2);
        });
    }
}
