//! A run on disk: one safetensors file, replaced as a whole, from which it goes on to the bit, in a streaming network's
//! simulator to its rounding (see `nerd_tasks::Episodes::remember`).
//!
//! Noise, orders and resets are drawn by number (iteration, step, episode), so no generator's state is in it.

use std::path::Path;

use nerd_tasks::Snapshot;

use super::environments::Environments;
use super::normalizer::RunningMoments;
use super::policy::Policy;
use super::shared::{cut, gathered};
use super::trainer::{PpoError, Trainer};
use crate::difference::between;
use crate::error::Result as Read;
use crate::tensors::Tensors;

impl<E: Environments> Trainer<E> {
    /// Writes where the run stands; `run` is whatever else the caller wants to find again. Of several ranks all call it, and the first writes.
    ///
    /// # Errors
    /// If the file cannot be written, or a rank is lost.
    pub fn save(&self, path: &Path, run: &str) -> Result<(), PpoError> {
        let (state, own) = (&self.state, (self.environments.snapshot()?, self.state.running.clone()));
        let Some((snapshot, running)) = gathered(&self.ranks, own)? else { return Ok(()) };
        let mut file = Tensors::default();
        put(&mut file, "policy", &state.policy);
        if let Some((reward, policy)) = &state.best {
            put(&mut file, "best", policy);
            file.put_f64("best.reward", [*reward]);
        }
        file.put_f32("adam.m", &[state.adam.m.len()], &state.adam.m);
        file.put_f32("adam.v", &[state.adam.v.len()], &state.adam.v);
        file.put_u64("counts", &[state.iteration, state.adam.step, self.seed]);
        file.put_f64("rate", [state.adam.rate]);
        file.put_f64("running.stack", running.stack.rows.iter().copied());
        file.put_f64("running.rewards", running.rewards.iter().copied());
        file.put_f64("running.lengths", running.lengths.iter().copied());
        file.put_f64("recent", state.recent.iter().flat_map(|e| [e.0, e.1]));
        file.put_f64("states", snapshot.states);
        file.put_u64("frames", &snapshot.frames);
        file.put_f64("goals", snapshot.goals);
        file.put_u64("begun", &snapshot.begun);
        file.put_f64("past.states", snapshot.past_states);
        file.put_f64("past.torques", snapshot.past_torques);
        let config = serde_json::to_string(&self.config).unwrap_or_default();
        file.put_word("config", config);
        file.put_word("run", run);
        Ok(file.save(path)?)
    }

    /// Goes on where the file's run stood. What `run` was at [`Self::save`] must be the same now.
    ///
    /// # Errors
    /// If the file is no checkpoint, or that of another run; then nothing has changed but, at worst, the environments.
    pub fn resume(&mut self, path: &Path, run: &str) -> Result<(), PpoError> {
        let file = Tensors::open(path)?;
        let counts = file.u64("counts", Some(3))?;
        let config: super::config::PpoConfig = serde_json::from_str(file.word("config")?).map_err(|e| file.wrong(e))?;
        // A run may be made longer.
        let config = super::config::PpoConfig { iterations: self.config.iterations, ..config };
        let whole = |config, run: &str, seed| serde_json::json!({ "run": run, "seed": seed, "settings": config }).to_string();
        let (found, asked) = (whole(&config, file.word("run")?, counts[2]), whole(&self.config, run, self.seed));
        if found != asked {
            return Err(file.wrong(format!("it is that of another run: {}", between(&found, &asked))).into());
        }
        let mut state = self.state.clone();
        state.policy = get(&file, "policy", &state.policy)?;
        state.best = match file.f64("best.reward", Some(1)) {
            Ok(reward) => Some((reward[0], get(&file, "best", &state.policy)?)),
            Err(_) => None,
        };
        let weights = Some(state.adam.m.len());
        (state.adam.m, state.adam.v) = (file.f32("adam.m", weights)?, file.f32("adam.v", weights)?);
        (state.iteration, state.adam.step) = (counts[0], counts[1]);
        state.adam.rate = file.f64("rate", Some(1))?[0];
        let (running, n) = (&mut state.running, self.config.environments);
        let part = self.ranks.part(n);
        let row = running.stack.rows.len() / part.len().max(1);
        let own = |name: &str, width: usize| -> Read<Vec<f64>> {
            Ok(file.f64(name, Some(n * width))?[part.start * width..part.end * width].to_vec())
        };
        running.stack.rows = own("running.stack", row)?;
        running.rewards = own("running.rewards", 1)?;
        running.lengths = own("running.lengths", 1)?;
        state.recent = file.f64("recent", None)?.as_chunks().0.iter().map(|[a, b]| (*a, *b)).collect();
        let snapshot = Snapshot {
            states: file.f64("states", None)?,
            frames: file.u64("frames", None)?,
            goals: file.f64("goals", None)?,
            begun: file.u64("begun", None)?,
            past_states: file.f64("past.states", None)?,
            past_torques: file.f64("past.torques", None)?,
        };
        self.environments.restore(&cut(&snapshot, n, &part))?;
        self.state = state;
        Ok(())
    }
}

fn put(file: &mut Tensors, name: &str, policy: &Policy) {
    file.put_f32(format!("{name}.flat"), &[policy.flat.len()], &policy.flat);
    for (what, moments) in [("seen", &policy.seen), ("returns", &policy.returns)] {
        let all = moments.mean.iter().chain(&moments.variance).copied().chain([moments.count]);
        file.put_f64(format!("{name}.{what}"), all);
    }
}

/// A policy of the same shape as `like`.
fn get(file: &Tensors, name: &str, like: &Policy) -> Read<Policy> {
    let moments = |what: &str, columns: usize| -> Read<RunningMoments> {
        let all = file.f64(&format!("{name}.{what}"), Some(2 * columns + 1))?;
        Ok(RunningMoments { mean: all[..columns].into(), variance: all[columns..2 * columns].into(), count: all[2 * columns] })
    };
    Ok(Policy {
        shape: like.shape.clone(),
        flat: file.f32(&format!("{name}.flat"), Some(like.flat.len()))?,
        seen: moments("seen", like.seen.mean.len())?,
        returns: moments("returns", 1)?,
    })
}
