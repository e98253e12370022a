//! A run on several ranks: what all of them have in common before it begins, and what those do that do not lead.

use std::path::PathBuf;
use std::time::Instant;

use nerd_model::transformer::Weights;
use serde_json::json;

use super::Run;
use super::card::Identity;
use super::data::Data;
use crate::difference::between;
use crate::error::Result;
use crate::learner::LearnerState;
use crate::ranks::{RankError, bytes, floats};

impl Run {
    /// Trains as another rank than 0, and waits for the model that rank 0 makes.
    pub(super) fn follow(&self) -> Result<Option<PathBuf>> {
        let started = Instant::now();
        self.agreed(&self.identity())?;
        let Data { judge, matter, sha256, .. } = self.data()?;
        self.same_data(&sha256)?;
        let state = self.given(None)?;
        if !self.config.finish {
            let fresh = self.supply(&judge.normalizer, state.step)?;
            let mut engine = self.engine(state, matter, &judge)?;
            self.trainer("", started).run(&mut *engine, fresh, &mut |_, _| Ok(None))?;
        }
        Ok(self.ranks.decide(false)?.then(|| self.config.out.join("model")))
    }

    /// Refuses to begin where ranks were given other settings: they would wait for each other in vain.
    pub(super) fn agreed(&self, identity: &Identity) -> Result<()> {
        let mine = json!({ "run": identity, "minutes": self.config.minutes, "finish": self.config.finish, "data": self.config.data });
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let how = |theirs: &[u8], ours: &[u8]| between(&text(theirs), &text(ours)) + "; give all ranks the same command";
        Ok(self.ranks.agree("settings", mine.to_string().as_bytes(), how)?)
    }

    /// Refuses to begin where a folder of data, or what a rank has recorded of a chain, is something else than that of rank 0; tokens that ranks
    /// record they have from each other.
    pub(super) fn same_data(&self, sha256: &str) -> Result<()> {
        if self.config.data.is_none() && self.config.unrolled().is_none() {
            return Ok(());
        }
        let how = |_: &[u8], _: &[u8]| "it has other data; give all ranks the same".to_string();
        Ok(self.ranks.agree("data", sha256.as_bytes(), how)?)
    }

    /// The state to go on from, as rank 0 has it.
    pub(super) fn given(&self, mine: Option<LearnerState>) -> Result<LearnerState> {
        if let Some(mine) = mine {
            if self.ranks.world() > 1 {
                self.ranks.share(0, || packed(&mine))?;
            }
            return Ok(mine);
        }
        let sent = self.ranks.share(0, Vec::new)?;
        let (step, vectors) = sent.split_first_chunk().unwrap_or((&[0; 8], &[]));
        let n = self.network.parameters();
        let mut vectors = floats(vectors).chunks(n).map(<[f32]>::to_vec).collect::<Vec<_>>().into_iter();
        let mut next = || {
            let whole = vectors.next().filter(|vector| vector.len() == n);
            whole.ok_or_else(|| RankError::Meet(format!("rank 0 sent no state of {n} parameters: give all ranks the same program")))
        };
        let weights = Weights { config: self.network, flat: next()? };
        Ok(LearnerState { step: u64::from_le_bytes(*step), weights, average: next()?, m: next()?, v: next()? })
    }
}

/// A state as it is sent: updates done (8 bytes, little endian), weights, average, both moments.
fn packed(state: &LearnerState) -> Vec<u8> {
    let LearnerState { step, weights, average, m, v } = state;
    [step.to_le_bytes().to_vec(), bytes(&weights.flat), bytes(average), bytes(m), bytes(v)].concat()
}
