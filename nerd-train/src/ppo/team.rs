//! Several ranks of one run: each steps its share of the environments and computes its part of every minibatch. Moments and gradients are
//! added up over all of them, so every rank makes the same step and weights are never sent.
//!
//! An episode draws from a stream of its environment's number among all, so what is seen and done is what one rank sees and does. A sum
//! over ranks has another order than that of one, so weights agree to rounding.

use std::ops::Range;

use super::*;

/// This rank among those of a run; alone by default.
#[derive(Clone, Debug, Default)]
pub(super) struct Team {
    pub ranks: Arc<Ranks>,
    /// Environments of all ranks.
    pub all: usize,
    /// Those of this one.
    pub part: Range<usize>,
}

impl Team {
    /// With its share of so many environments.
    pub fn new(ranks: &Arc<Ranks>, environments: usize) -> Self {
        Self { ranks: ranks.clone(), all: environments, part: ranks.part(environments) }
    }

    pub fn alone(&self) -> bool {
        self.ranks.world() == 1
    }

    /// This rank's steps of a minibatch of all, by their numbers here.
    pub fn own(&self, batch: &[u32]) -> impl Iterator<Item = u32> {
        let (all, part) = (self.all, &self.part);
        let place = batch.iter().map(move |i| (*i as usize / all, *i as usize % all));
        place.filter(|(_, env)| part.contains(env)).map(|(t, env)| (t * part.len() + env - part.start) as u32)
    }

    /// Moments of the rows of all ranks.
    pub fn pool(&self, own: RunningMoments) -> Result<RunningMoments, RankError> {
        if self.alone() {
            return Ok(own);
        }
        let columns = own.mean.len();
        let words = own.mean.iter().chain(&own.variance).chain([&own.count]).map(|x| x.to_bits()).collect();
        let mut all = RunningMoments { count: 0.0, ..RunningMoments::new(columns) };
        for words in self.exchange(words)? {
            let numbers: Vec<f64> = words.into_iter().map(f64::from_bits).collect();
            let (mean, variance) = (numbers[..columns].into(), numbers[columns..2 * columns].into());
            all.absorb(&RunningMoments { mean, variance, count: numbers[2 * columns] });
        }
        Ok(all)
    }

    /// Adds up a gradient and the terms of its loss.
    pub fn sum(&self, gradient: &mut Vec<f32>, terms: &mut Terms) -> Result<(), RankError> {
        if self.alone() {
            return Ok(());
        }
        let parameters = gradient.len();
        gradient.extend(terms.list().map(|x| x as f32));
        self.ranks.sum(gradient)?;
        *terms = Terms::of(std::array::from_fn(|k| f64::from(gradient[parameters + k])));
        gradient.truncate(parameters);
        Ok(())
    }

    /// What was taken on all ranks, episodes in the order of one.
    pub fn together(&self, taken: Taken) -> Result<Taken, RankError> {
        if self.alone() {
            return Ok(taken);
        }
        let line = |e: &Ended| [e.step as u64, (self.part.start + e.env) as u64, e.total.to_bits(), e.length.to_bits()];
        let all = self.exchange(taken.ended.iter().flat_map(line).chain([taken.failed as u64]).collect())?;
        let mut lines: Vec<[u64; 4]> = all.iter().flat_map(|words| words.as_chunks::<4>().0.iter().copied()).collect();
        lines.sort_unstable();
        let episode = |[step, env, total, length]: [u64; 4]| Ended {
            step: step as usize,
            env: env as usize,
            total: f64::from_bits(total),
            length: f64::from_bits(length),
        };
        let failed = all.iter().filter_map(|words| words.last()).sum::<u64>() as usize;
        Ok(Taken { ended: lines.into_iter().map(episode).collect(), failed })
    }

    /// What all ranks have, in their order, on every rank.
    pub fn exchange(&self, mine: Vec<u64>) -> Result<Vec<Vec<u64>>, RankError> {
        let words = |bytes: Vec<u8>| bytes.as_chunks().0.iter().map(|x| u64::from_le_bytes(*x)).collect();
        let bytes = || mine.iter().flat_map(|x| x.to_le_bytes()).collect();
        (0..self.ranks.world()).map(|from| self.ranks.share(from, bytes).map(words)).collect()
    }
}
