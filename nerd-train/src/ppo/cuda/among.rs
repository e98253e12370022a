//! [`Among`]: a card among those of other ranks. Each steps its share of the environments. Minibatches are drawn from the steps of all of them;
//! a card computes those that are its own, gradients are added up, and every card makes the same step.

use std::ops::Range;
use std::sync::Arc;

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Device, DeviceError, Sums};

use super::super::config::PpoConfig;
use super::super::normalizer::RunningMoments;
use super::super::rollout::{Ended, Taken};
use super::CudaEngine;
use crate::ranks::Ranks;

/// No step: where a minibatch has fewer of this card than there is room for.
const NONE: u32 = u32::MAX;
/// Deviations by which a card's steps in a minibatch may be more than its share.
const FAR: f64 = 8.0;

/// See the module.
pub(super) struct Among {
    ranks: Arc<Ranks>,
    sums: Sums,
    /// This card's environments.
    pub(super) part: Range<usize>,
}

impl Among {
    /// Joins the cards of the other ranks.
    pub(super) fn join(device: &Device, config: &PpoConfig, ranks: &Arc<Ranks>) -> Result<Self, DeviceError> {
        let id = if ranks.leads() { Sums::id()? } else { Vec::new() };
        let id = ranks.share(0, || id).map_err(lost)?;
        let sums = Sums::join(device, &id, ranks.rank(), ranks.world())?;
        Ok(Self { ranks: ranks.clone(), sums, part: ranks.part(config.environments) })
    }

    /// Steps of a minibatch of all cards for which this one has room.
    pub(super) fn room(part: &Range<usize>, config: &PpoConfig) -> usize {
        let (all, share) = (config.minibatch.min(config.steps()) as f64, part.len() as f64 / config.environments as f64);
        ((all * share + FAR * (all * share * (1.0 - share)).sqrt()) as usize + 8).min(all as usize)
    }

    /// This card's steps in an order of all, minibatch by minibatch, each filled up to its room.
    pub(super) fn own(part: &Range<usize>, order: &[u32], config: &PpoConfig) -> Result<Vec<u32>, String> {
        let (room, all, own) = (Self::room(part, config), config.environments, part.len());
        let mut mine = Vec::with_capacity(order.len().div_ceil(config.minibatch) * room);
        for batch in order.chunks(config.minibatch) {
            let before = mine.len();
            let local = batch.iter().map(|i| (*i as usize / all, *i as usize % all)).filter(|(_, env)| part.contains(env));
            mine.extend(local.map(|(t, env)| (t * own + env - part.start) as u32));
            if mine.len() - before > room {
                return Err(format!(
                    "a minibatch has {} steps of this card, there is room for {room}: take larger ones",
                    mine.len() - before
                ));
            }
            mine.resize(before + room, NONE);
        }
        Ok(mine)
    }

    /// Moments of the rows of all cards.
    pub(super) fn moments(&self, [mean, variance]: [Vec<f64>; 2], rows: usize) -> Result<[Vec<f64>; 2], DeviceError> {
        let words = mean.iter().chain(&variance).chain([&(rows as f64)]).flat_map(|x| x.to_le_bytes()).collect();
        let told = self.ranks.gather(words).map_err(lost)?;
        let joined = || {
            // Begins with no rows at all.
            let mut all = RunningMoments { count: 0.0, ..RunningMoments::new(mean.len()) };
            for words in &told {
                let numbers: Vec<f64> = words.as_chunks().0.iter().map(|x| f64::from_le_bytes(*x)).collect();
                let (moments, rows) = numbers.split_at(2 * mean.len());
                all.absorb(&moments[..mean.len()], &moments[mean.len()..], rows[0]);
            }
            all.mean.iter().chain(&all.variance).flat_map(|x| x.to_le_bytes()).collect()
        };
        let all = self.ranks.share(0, joined).map_err(lost)?;
        let numbers: Vec<f64> = all.as_chunks().0.iter().map(|x| f64::from_le_bytes(*x)).collect();
        let (mean, variance) = numbers.split_at(mean.len());
        Ok([mean.to_vec(), variance.to_vec()])
    }

    /// Refuses to go on where some cards have the episodes and others do not: their messages would not fit.
    pub(super) fn alike(&self, on_device: bool) -> Result<(), DeviceError> {
        let told = self.ranks.gather(vec![u8::from(on_device)]).map_err(lost)?;
        let same = self.ranks.decide(told.iter().all(|other| *other == told[0])).map_err(lost)?;
        let wrong = "some ranks have their episodes on the card, others do not: give all of them cards with as much free memory";
        same.then_some(()).ok_or_else(|| DeviceError(wrong.into()))
    }

    /// What was taken on all cards, episodes in the order of one.
    pub(super) fn together(&self, taken: Taken) -> Result<Taken, DeviceError> {
        let line = |e: &Ended| [e.step as u64, (self.part.start + e.env) as u64, e.total.to_bits(), e.length.to_bits()];
        let words = taken.ended.iter().flat_map(line).chain([taken.failed as u64]).flat_map(u64::to_le_bytes).collect();
        let told = self.ranks.gather(words).map_err(lost)?;
        // Each rank's lines, behind how many numbers they are.
        let join =
            || told.iter().flat_map(|words| (words.len() as u64 / 8).to_le_bytes().into_iter().chain(words.iter().copied())).collect();
        let all = self.ranks.share(0, join).map_err(lost)?;
        let mut numbers = all.as_chunks().0.iter().map(|x| u64::from_le_bytes(*x));
        let (mut lines, mut failed) = (Vec::new(), 0);
        while let Some(len) = numbers.next() {
            let words: Vec<u64> = numbers.by_ref().take(len as usize).collect();
            lines.extend_from_slice(words.as_chunks::<4>().0);
            failed += words.last().map_or(0, |n| *n as usize);
        }
        lines.sort_unstable();
        let episode = |[step, env, total, length]: &[u64; 4]| Ended {
            step: *step as usize,
            env: *env as usize,
            total: f64::from_bits(*total),
            length: f64::from_bits(*length),
        };
        Ok(Taken { ended: lines.iter().map(episode).collect(), failed, ..taken })
    }
}

impl CudaEngine {
    /// Adds up gradients and loss terms of all cards; the number of blocks that terms are in then.
    pub(super) fn joined(&self, blocks: usize) -> Result<usize, DeviceError> {
        let Some(among) = &self.among else { return Ok(blocks) };
        let tail = Ptr(self.gradient.at(self.weights.len));
        self.net.device.launch("tell", (1, 1), (32, 1), 0, &[Ptr(self.terms.ptr), Int(blocks), tail])?;
        among.sums.sum(&self.net.device, &self.gradient)?;
        self.net.device.launch("hear", (1, 1), (32, 1), 0, &[tail, Ptr(self.terms.ptr)])?;
        Ok(1)
    }
}

fn lost(error: crate::ranks::RankError) -> DeviceError {
    DeviceError(error.to_string())
}
