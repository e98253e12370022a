//! Fuzzes the file readers in this process: mutates files of every kind, reads them, and steps their robots. Each case
//! must be accepted, or refused with a message, within ten seconds and without a panic. Robots on random grounds must
//! not gain energy. The tests of `xtask` fuzz command lines and killed runs.

mod case;
mod compiler;
mod energy;
mod found;
mod text;
mod tree;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};

use strum::VariantArray;

use crate::prelude::*;
use nerd_cli::panics::{caught, silent};

pub use case::{Kind, Outcome};
pub use found::Found;
pub use text::{Dictionary, byte, repeated};

/// Time limit of a case on the CPU.
const LIMIT: Duration = Duration::from_secs(10);
/// Time limit of a case on a GPU; it includes compiling the kernels.
const CARD_LIMIT: Duration = Duration::from_secs(120);

settings! {
    /// Settings of a campaign.
    pub struct Campaign {
        /// Number of cases, shared equally among the kinds
        cases: u64 = 10_000, Whole(1..=1_000_000_000);
        /// Seed of the changes
        seed: u64 = 0, Whole(SEEDS);
        /// Number of the first case of each kind. With --cases 1 and --kinds it repeats a single case
        first: u64 = 0, Whole(SEEDS);
        /// Kinds of input, comma-separated [default: all of mjcf, urdf, robot, task, settings, recipe, log, csv, npz,
        /// policy, model, energy]
        kinds: Vec<String> = Vec::new(), Texts;
        /// Python that has MuJoCo, whose compiler checks every changed MJCF that is accepted here [default: none]
        mujoco: Option<PathBuf> = None, Text;
        /// Folder to write the files of faults into [default: none is written]
        keep: Option<PathBuf> = None, Text;
        /// Device of the solver in the kind energy: cpu, or cuda in f32
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

type Tried = (Kind, u64, Outcome);

/// Running cases: worker index to the case (kind, number) and its start time.
type Busy = BTreeMap<usize, ((Kind, u64), Instant)>;

/// State shared by the worker threads: all cases, the index of the next case to run, and the running cases.
struct Desk {
    asked: Vec<(Kind, u64)>,
    seed: u64,
    card: bool,
    next: AtomicU64,
    busy: Mutex<Busy>,
}

impl Campaign {
    pub fn run(&self) -> Result<Found> {
        let known = Kind::VARIANTS;
        let kind = |name: &String| {
            known.iter().find(|kind| kind.name() == *name).copied().with_context(|| {
                format!("--kinds {name}: choose from {}", known.iter().map(|kind| kind.name()).join(", "))
            })
        };
        let kinds =
            if self.kinds.is_empty() { known.to_vec() } else { self.kinds.iter().map(kind).collect::<Result<_>>()? };
        let share = |k: u64| (kinds[(k % kinds.len() as u64) as usize], self.first + k / kinds.len() as u64);
        let desk = Arc::new(Desk {
            asked: (0..self.cases).map(share).collect(),
            seed: self.seed,
            card: self.device == Device::Cuda,
            next: AtomicU64::new(0),
            busy: Mutex::default(),
        });
        let (give, tried) = channel();
        let mut workers = 0;
        let mut start = || -> Result<()> {
            let desk = desk.clone();
            let give = give.clone();
            let own = workers;
            workers += 1;
            std::thread::Builder::new()
                .spawn(move || work(&desk, own, &give))
                .context("no thread for the campaign")
                .map(drop)
        };
        let begun = std::thread::available_parallelism().map_or(1, usize::from).min(self.cases as usize);
        let (mut found, accepted) = silent(|| {
            (0..begun).try_for_each(|_| start())?;
            self.gather(&desk, &tried, &mut start)
        })?;
        if let Some(python) = &self.mujoco {
            let refused = compiler::refused(python, self.seed, &accepted)?;
            let counts = found.counts.entry(Kind::Mjcf).or_default();
            (counts[1], counts[2]) = (counts[1] - refused.len() as u64, counts[2] + refused.len() as u64);
            found.faults.extend(refused.into_iter().map(|(number, why)| (Kind::Mjcf, number, why)));
        }
        for ((kind, number, _), folder) in found.faults.iter().flat_map(|fault| Some(fault).zip(self.keep.as_ref())) {
            for (name, bytes) in kind.make(self.seed, *number)? {
                write(&folder.join(format!("{}-{number}", kind.name())).join(name), &bytes)?;
            }
        }
        Ok(found)
    }

    /// Collects the outcomes of all cases, and the numbers of the accepted MJCFs. A worker thread over the time limit
    /// is abandoned and replaced.
    fn gather(
        &self,
        desk: &Desk,
        tried: &std::sync::mpsc::Receiver<Tried>,
        start: &mut dyn FnMut() -> Result<()>,
    ) -> Result<(Found, Vec<u64>)> {
        let mut found = Found::default();
        let mut accepted = Vec::new();
        let bar = bar("cases", self.cases);
        let mut done = 0;
        let mut late = std::collections::BTreeSet::new();
        while done < self.cases {
            match tried.recv_timeout(Duration::from_millis(100)) {
                Ok((kind, number, _)) if late.contains(&(kind, number)) => continue,
                Ok((kind, number, outcome)) => {
                    done += 1;
                    let column = match outcome {
                        Outcome::Refused => 0,
                        Outcome::Accepted => {
                            accepted.extend((kind == Kind::Mjcf).then_some(number));
                            1
                        }
                        Outcome::Fault(what) => {
                            found.faults.push((kind, number, what));
                            2
                        }
                    };
                    found.counts.entry(kind).or_default()[column] += 1;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => bail!("the campaign's threads have ended"),
            }
            let mut busy = desk.busy.lock().unwrap_or_else(PoisonError::into_inner);
            let limit = if desk.card { CARD_LIMIT } else { LIMIT };
            let over =
                busy.extract_if(.., |_, (_, since)| since.elapsed() > limit).map(|(_, (case, _))| case).collect_vec();
            drop(busy);
            for (kind, number) in over {
                late.insert((kind, number));
                done += 1;
                found.counts.entry(kind).or_default()[2] += 1;
                found.faults.push((kind, number, format!("over {} s", limit.as_secs())));
                start()?;
            }
            bar.set(done);
        }
        bar.finish();
        Ok((found, accepted))
    }
}

fn work(desk: &Desk, own: usize, give: &Sender<Tried>) {
    let Ok(folder) = tempfile::tempdir() else { return };
    loop {
        let k = desk.next.fetch_add(1, Ordering::Relaxed) as usize;
        let Some(&(kind, number)) = desk.asked.get(k) else { return };
        let busy = || desk.busy.lock().unwrap_or_else(PoisonError::into_inner);
        busy().insert(own, ((kind, number), Instant::now()));
        let outcome =
            match caught(|| kind.make(desk.seed, number).map(|files| kind.judge(folder.path(), &files, desk.card))) {
                Ok(Ok(outcome)) => outcome,
                Ok(Err(e)) => Outcome::Fault(format!("no case: {e:#}")),
                Err(said) => Outcome::Fault(format!("a panic: {said}")),
            };
        // Ends a worker thread that was abandoned for exceeding the time limit.
        if busy().remove(&own).is_none() || give.send((kind, number, outcome)).is_err() {
            return;
        }
    }
}
