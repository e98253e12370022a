//! Hostile input by the hundred thousand, in this process: files of every kind are changed at random and read, and robots moved a little. Each
//! must be refused in words or accepted, without a panic and within ten seconds. `xtask`'s tests try command lines, and runs that are killed.

mod case;
mod compiler;
mod found;
mod text;
mod tree;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};

use strum::VariantArray;

use crate::prelude::*;

pub use case::{Kind, Outcome};
pub use found::Found;
pub use text::{Dictionary, byte, repeated};

/// Longest that a case may take.
const LIMIT: Duration = Duration::from_secs(10);

settings! {
    /// What is tried.
    pub struct Campaign {
        /// Cases in all, as many of each kind
        cases: u64 = 10_000, Whole(1..=1_000_000_000);
        /// Seed of the changes
        seed: u64 = 0, Whole(SEEDS);
        /// Number of the first case of each kind, to try one again with --cases 1 and its --kinds
        first: u64 = 0, Whole(SEEDS);
        /// Kinds, comma-separated [default: all of mjcf, urdf, robot, task, settings, recipe, log, csv, npz, policy, model]
        kinds: Vec<String> = Vec::new(), Texts;
        /// Python with MuJoCo, whose compiler is asked about every changed MJCF that is accepted
        mujoco: Option<PathBuf> = None, Text;
        /// Folder to write the files of faults into [default: none is written]
        keep: Option<PathBuf> = None, Text;
    }
}

type Tried = (Kind, u64, Outcome);

/// By worker, its case and when it began.
type Busy = BTreeMap<usize, ((Kind, u64), Instant)>;

/// Cases that are given out, those under way by worker, and where outcomes go.
struct Desk {
    asked: Vec<(Kind, u64)>,
    seed: u64,
    next: AtomicU64,
    busy: Mutex<Busy>,
}

impl Campaign {
    pub fn run(&self) -> Result<Found> {
        let known = Kind::VARIANTS;
        let kind = |name: &String| {
            known.iter().find(|kind| kind.name() == *name).copied().with_context(|| {
                format!("--kinds {name}: choose from {}", known.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(", "))
            })
        };
        let kinds = if self.kinds.is_empty() { known.to_vec() } else { self.kinds.iter().map(kind).collect::<Result<_>>()? };
        let share = |k: u64| (kinds[(k % kinds.len() as u64) as usize], self.first + k / kinds.len() as u64);
        let desk = Arc::new(Desk {
            asked: (0..self.cases).map(share).collect(),
            seed: self.seed,
            next: AtomicU64::new(0),
            busy: Mutex::default(),
        });
        let (give, tried) = channel();
        let mut workers = 0;
        let mut start = || -> Result<()> {
            let (desk, give, own) = (desk.clone(), give.clone(), workers);
            workers += 1;
            std::thread::Builder::new().spawn(move || work(&desk, own, &give)).context("no thread for the campaign").map(drop)
        };
        // A panic is caught and counted; its story would be told on standard error each time.
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| ()));
        let begun = std::thread::available_parallelism().map_or(1, usize::from).min(self.cases as usize);
        let found = (0..begun).try_for_each(|_| start()).and_then(|()| self.gather(&desk, &tried, &mut start));
        std::panic::set_hook(hook);
        let (mut found, accepted) = found?;
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

    /// Outcomes of all cases, and the numbers of the MJCFs that were accepted. Who takes too long is left alone, and another
    /// one started.
    fn gather(
        &self,
        desk: &Desk,
        tried: &std::sync::mpsc::Receiver<Tried>,
        start: &mut dyn FnMut() -> Result<()>,
    ) -> Result<(Found, Vec<u64>)> {
        let (mut found, mut accepted, bar) = (Found::default(), Vec::new(), bar("cases", self.cases));
        let (mut done, mut late) = (0, std::collections::BTreeSet::new());
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
            let over: Vec<_> = busy.extract_if(.., |_, (_, since)| since.elapsed() > LIMIT).map(|(_, (case, _))| case).collect();
            drop(busy);
            for (kind, number) in over {
                late.insert((kind, number));
                done += 1;
                found.counts.entry(kind).or_default()[2] += 1;
                found.faults.push((kind, number, format!("over {} s", LIMIT.as_secs())));
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
        let tried = catch_unwind(AssertUnwindSafe(|| kind.make(desk.seed, number).map(|files| kind.judge(folder.path(), &files))));
        let outcome = match tried {
            Ok(Ok(outcome)) => outcome,
            Ok(Err(e)) => Outcome::Fault(format!("no case: {e:#}")),
            Err(panic) => {
                let said = panic.downcast_ref::<String>().cloned().or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string));
                Outcome::Fault(format!("a panic: {}", said.unwrap_or_default()))
            }
        };
        // Who was given up on ends.
        if busy().remove(&own).is_none() || give.send((kind, number, outcome)).is_err() {
            return;
        }
    }
}
