//! Environments on several ranks: each steps its share, rank 0 sees all of them and learns (on cards every rank has one of its own part).
//!
//! An episode draws from a stream of its environment's number among all, and noise is drawn on rank 0 for all, so what happens is what
//! happens on one rank. Those that do not lead do what they are told: step, say where they stand, go on elsewhere, end.

use std::ops::Range;
use std::sync::Arc;

#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::Resident;
use nerd_sim::solver::StepError;
#[cfg(feature = "cuda")]
use nerd_sim::{batch::Batch, solver::Solver};
use nerd_tasks::{Episodes, Snapshot, StepResult};

#[cfg(feature = "cuda")]
use super::World;
use super::environments::Environments;
use super::rollout::Running;
use super::trainer::PpoError;
#[cfg(feature = "cuda")]
use crate::progress::tell;
use crate::ranks::{RankError, Ranks};

const STEP: u64 = 1;
const SAY: u64 = 2;
const GO_ON: u64 = 3;
const END: u64 = 0;

/// Episodes of all ranks, or this rank's share of them.
pub struct Shared {
    own: Episodes,
    ranks: Arc<Ranks>,
    count: usize,
    /// Of all, where there are several ranks.
    observations: Vec<f64>,
    /// Where they are on a device; none of those that cannot be.
    #[cfg(feature = "cuda")]
    world: Option<Option<World>>,
}

impl Shared {
    /// This rank's share of `count` environments, [`Ranks::part`].
    ///
    /// # Errors
    /// If a rank is lost.
    pub fn new(own: Episodes, count: usize, ranks: &Arc<Ranks>) -> Result<Self, RankError> {
        let mut shared = Self {
            own,
            ranks: ranks.clone(),
            count,
            observations: Vec::new(),
            #[cfg(feature = "cuda")]
            world: None,
        };
        if ranks.world() > 1 {
            let all = shared.answers(vec![bits(shared.own.observations())])?;
            shared.observations = all.iter().flat_map(|parts| reals(part(parts, 0))).collect();
        }
        Ok(shared)
    }

    /// Does what rank 0 says, until that says the end.
    ///
    /// # Errors
    /// If the solver cannot step, or a rank is lost.
    pub fn serve(&mut self) -> Result<(), PpoError> {
        let range = self.ranks.part(self.count);
        loop {
            let told = unpacked(&self.ranks.share(0, Vec::new)?);
            let answer = match part(&told, 0) {
                [STEP] => {
                    let actions = reals(part(&told, 1));
                    let result = self.own.step(&rows(&actions, 1, self.count, &range))?;
                    let flags = |all: &[bool]| all.iter().map(|yes| u64::from(*yes)).collect();
                    let (terminated, truncated) = (flags(&result.terminated), flags(&result.truncated));
                    let failed = vec![result.failed as u64];
                    vec![bits(&result.rewards), terminated, truncated, bits(&result.reached), failed, bits(self.own.observations())]
                }
                [SAY] => said(self.own.snapshot()),
                [GO_ON] => {
                    self.own.restore(&cut(&heard(&told[1..]), self.count, &range))?;
                    vec![bits(self.own.observations())]
                }
                _ => return Ok(()),
            };
            self.answers(answer)?;
        }
    }

    /// Ends the others' service.
    ///
    /// # Errors
    /// If a rank is lost.
    pub fn end(&self) -> Result<(), RankError> {
        self.tell(&[vec![END]])
    }

    /// The episodes as a world on the device of their solver; none where they cannot be, with a line that says why.
    #[cfg(feature = "cuda")]
    fn moved(&mut self) -> Result<Option<World>, StepError> {
        // Taken out, since a world is made of episodes and of their solver.
        let mut solver = std::mem::replace(&mut self.own.simulation.solver, Box::new(Nobody));
        let made = solver.resident().map(|resident| World::new(&self.own, resident)).transpose();
        self.own.simulation.solver = solver;
        match made {
            Err(StepError::Refused(why)) => {
                tell(format_args!("{why}; what is seen goes to the card once a step, and actions come back"));
                Ok(None)
            }
            // The solver's own kernels: it says more when it steps.
            Err(StepError::Solver(_)) => Ok(None),
            other => other,
        }
    }

    fn tell(&self, words: &[Vec<u64>]) -> Result<(), RankError> {
        if self.ranks.world() > 1 {
            self.ranks.share(0, || packed(words))?;
        }
        Ok(())
    }

    /// What all ranks answer, on rank 0.
    fn answers(&self, mine: Vec<Vec<u64>>) -> Result<Vec<Vec<Vec<u64>>>, RankError> {
        Ok(self.ranks.gather(packed(&mine))?.iter().map(|bytes| unpacked(bytes)).collect())
    }
}

impl Environments for Shared {
    fn count(&self) -> usize {
        self.count
    }

    fn observation_dim(&self) -> usize {
        self.own.task.observation_dim()
    }

    fn action_dim(&self) -> usize {
        self.own.task.action_dim()
    }

    fn observations(&self) -> &[f64] {
        if self.ranks.world() == 1 { self.own.observations() } else { &self.observations }
    }

    fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError> {
        if self.ranks.world() == 1 {
            return self.own.step(actions);
        }
        self.tell(&[vec![STEP], bits(actions)]).map_err(lost)?;
        let mut all = self.own.step(&rows(actions, 1, self.count, &self.ranks.part(self.count)))?;
        let answers = self.answers(Vec::new()).map_err(lost)?;
        self.observations.clear();
        self.observations.extend_from_slice(self.own.observations());
        for answer in &answers[1..] {
            let flags = |k: usize| part(answer, k).iter().map(|flag| *flag == 1);
            all.rewards.extend(reals(part(answer, 0)));
            all.terminated.extend(flags(1));
            all.truncated.extend(flags(2));
            all.reached.extend(reals(part(answer, 3)));
            all.failed += part(answer, 4).iter().sum::<u64>() as usize;
            self.observations.extend(reals(part(answer, 5)));
        }
        // Success is asked for in games alone.
        all.misses = vec![None; self.count];
        Ok(all)
    }

    #[cfg(feature = "cuda")]
    fn on_device(&mut self) -> Result<Option<(&mut World, &mut dyn Resident)>, StepError> {
        if self.ranks.world() > 1 {
            return Ok(None);
        }
        if self.world.is_none() {
            self.world = Some(self.moved()?);
        }
        let Some(resident) = self.own.simulation.solver.resident() else { return Ok(None) };
        Ok(self.world.as_mut().and_then(Option::as_mut).map(|world| (world, resident)))
    }

    fn snapshot(&self) -> Result<Snapshot, StepError> {
        #[cfg(feature = "cuda")]
        if let Some(Some(world)) = &self.world {
            return world.snapshot();
        }
        let own = self.own.snapshot();
        if self.ranks.world() == 1 {
            return Ok(own);
        }
        // If a rank is lost here nothing is saved, and what was saved last stays whole.
        let told = self.tell(&[vec![SAY]]).and_then(|()| self.answers(said(own))).map_err(lost)?;
        Ok(joined(&told.iter().map(|parts| heard(parts)).collect::<Vec<_>>()))
    }

    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StepError> {
        #[cfg(feature = "cuda")]
        {
            self.world = None;
        }
        if self.ranks.world() == 1 {
            return self.own.restore(snapshot);
        }
        let words = [vec![vec![GO_ON]], said(snapshot.clone())].concat();
        self.tell(&words).map_err(lost)?;
        self.own.restore(&cut(snapshot, self.count, &self.ranks.part(self.count)))?;
        let all = self.answers(vec![bits(self.own.observations())]).map_err(lost)?;
        self.observations = all.iter().flat_map(|parts| reals(part(parts, 0))).collect();
        Ok(())
    }
}

fn lost(error: RankError) -> StepError {
    StepError::Solver(error.to_string())
}

/// A snapshot as numbers.
fn said(snapshot: Snapshot) -> Vec<Vec<u64>> {
    let Snapshot { states, frames, goals, begun, past_states, past_torques } = snapshot;
    vec![bits(&states), frames, bits(&goals), begun, bits(&past_states), bits(&past_torques)]
}

fn heard(parts: &[Vec<u64>]) -> Snapshot {
    let real = |k| reals(part(parts, k));
    let (frames, begun) = (part(parts, 1).to_vec(), part(parts, 3).to_vec());
    Snapshot { states: real(0), frames, goals: real(2), begun, past_states: real(4), past_torques: real(5) }
}

/// Where all ranks stand, on rank 0; none on the others.
pub(super) fn gathered(ranks: &Ranks, (own, running): (Snapshot, Running)) -> Result<Option<(Snapshot, Running)>, RankError> {
    if ranks.world() == 1 {
        return Ok(Some((own, running)));
    }
    let mut words = said(own);
    words.extend([&running.stack.rows, &running.rewards, &running.lengths].map(|x| bits(x)));
    let told: Vec<Vec<Vec<u64>>> = ranks.gather(packed(&words))?.iter().map(|bytes| unpacked(bytes)).collect();
    if !ranks.leads() {
        return Ok(None);
    }
    let whole = joined(&told.iter().map(|parts| heard(parts)).collect::<Vec<_>>());
    let mut all = running;
    for (k, numbers) in [&mut all.stack.rows, &mut all.rewards, &mut all.lengths].into_iter().enumerate() {
        *numbers = told.iter().flat_map(|parts| reals(part(parts, 6 + k))).collect();
    }
    Ok(Some((whole, all)))
}

/// Some of n environments.
pub(super) fn cut(all: &Snapshot, n: usize, range: &Range<usize>) -> Snapshot {
    let past = all.past_states.len().checked_div(all.states.len()).unwrap_or(0);
    Snapshot {
        states: rows(&all.states, 1, n, range),
        frames: rows(&all.frames, 1, n, range),
        goals: rows(&all.goals, 1, n, range),
        begun: rows(&all.begun, 1, n, range),
        past_states: rows(&all.past_states, past, n, range),
        past_torques: rows(&all.past_torques, past, n, range),
    }
}

/// The environments of all these, one behind the other.
fn joined(parts: &[Snapshot]) -> Snapshot {
    let past = parts.first().map_or(0, |s| s.past_states.len().checked_div(s.states.len()).unwrap_or(0));
    let real = |of: fn(&Snapshot) -> &[f64], blocks: usize| -> Vec<f64> {
        let block = |part: &[f64], k: usize| part[k * (part.len() / blocks)..(k + 1) * (part.len() / blocks)].to_vec();
        (0..blocks).flat_map(|k| parts.iter().flat_map(move |s| block(of(s), k))).collect()
    };
    Snapshot {
        states: real(|s| &s.states, 1),
        frames: parts.iter().flat_map(|s| s.frames.clone()).collect(),
        goals: real(|s| &s.goals, 1),
        begun: parts.iter().flat_map(|s| s.begun.clone()).collect(),
        past_states: real(|s| &s.past_states, past),
        past_torques: real(|s| &s.past_torques, past),
    }
}

/// Some of the n rows of each of so many blocks.
fn rows<T: Copy>(all: &[T], blocks: usize, n: usize, range: &Range<usize>) -> Vec<T> {
    let width = all.len().checked_div(blocks * n).unwrap_or(0);
    (0..blocks).flat_map(|block| &all[(block * n + range.start) * width..(block * n + range.end) * width]).copied().collect()
}

fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

fn reals(bits: &[u64]) -> Vec<f64> {
    bits.iter().map(|x| f64::from_bits(*x)).collect()
}

/// One of some vectors; nothing where there is none.
fn part(parts: &[Vec<u64>], k: usize) -> &[u64] {
    parts.get(k).map_or(&[], Vec::as_slice)
}

/// Vectors as they are sent: each behind its length, 8 bytes a number, little endian.
fn packed(parts: &[Vec<u64>]) -> Vec<u8> {
    parts.iter().flat_map(|part| std::iter::once(part.len() as u64).chain(part.iter().copied())).flat_map(u64::to_le_bytes).collect()
}

fn unpacked(bytes: &[u8]) -> Vec<Vec<u64>> {
    let mut numbers = bytes.as_chunks().0.iter().map(|x| u64::from_le_bytes(*x));
    let mut parts = Vec::new();
    while let Some(len) = numbers.next() {
        parts.push(numbers.by_ref().take(len as usize).collect());
    }
    parts
}

/// Stands for a solver that is elsewhere for a moment.
#[cfg(feature = "cuda")]
struct Nobody;

#[cfg(feature = "cuda")]
impl Solver for Nobody {
    fn step(&mut self, _: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        Err(StepError::Solver("the solver is elsewhere".into()))
    }
}
