//! A run on disk: one safetensors file, replaced as a whole, from which it goes on to the bit, in a streaming network's
//! simulator to its rounding (see `nerd_tasks::Episodes::remember`).
//!
//! Noise, orders and resets are drawn by number (iteration, step, episode), so no generator's state is stored. What belongs to
//! environments is in their order among those of all ranks, so a run may go on with another number of ranks.

use std::ops::Range;

use super::folder::{get, put};
use super::*;

impl Trainer {
    /// Writes where the run is; `run` is whatever else the caller wants to find again. Of several ranks all call it, and the first writes.
    pub fn save(&mut self, path: &Path, run: &str) -> Result<()> {
        let (state, team) = (&self.state, Team::new(&self.ranks, self.config.environments));
        let Snapshot { states, frames, goals, begun, past_states, past_torques } = self.engine.snapshot(&self.episodes)?;
        let past = past_states.len().checked_div(states.len()).unwrap_or(0);
        let mut file = Tensors::default();
        put(&mut file, "policy.", &state.policy);
        if let Some((reward, policy)) = &state.best {
            put(&mut file, "best.", policy);
            file.put_f64("best.reward", [*reward]);
        }
        file.put_f32("adam.m", &[state.adam.m.len()], &state.adam.m);
        file.put_f32("adam.v", &[state.adam.v.len()], &state.adam.v);
        file.put_u64("counts", &[state.iteration, state.adam.step, self.seed]);
        file.put_f64("rate", [state.adam.rate]);
        file.put_f64("recent", state.recent.iter().flat_map(|e| [e.0, e.1]));
        let reals: [(&str, &[f64], usize); 7] = [
            ("running.stack", &state.running.stack.rows, 1),
            ("running.rewards", &state.running.rewards, 1),
            ("running.lengths", &state.running.lengths, 1),
            ("states", &states, 1),
            ("goals", &goals, 1),
            ("past.states", &past_states, past),
            ("past.torques", &past_torques, past),
        ];
        for (name, own, blocks) in reals {
            let all = whole(&team, own.iter().map(|x| x.to_bits()).collect(), blocks)?;
            file.put_f64(name, all.into_iter().map(f64::from_bits));
        }
        for (name, own) in [("frames", frames), ("begun", begun)] {
            file.put_u64(name, &whole(&team, own, 1)?);
        }
        self.engine.learned()?.into_iter().for_each(|(name, numbers)| file.put_f32(name, &[numbers.len()], numbers));
        if !self.ranks.leads() {
            return Ok(());
        }
        let config = serde_json::to_string(&self.config).unwrap_or_default();
        file.put_word("config", config);
        file.put_word("run", run);
        file.save(path)
    }

    /// Goes on where the file's run was. What `run` was at [`Self::save`] must be the same now.
    ///
    /// # Errors
    /// If the file is no checkpoint, or that of another run; then nothing has changed but, at worst, the episodes.
    pub fn resume(&mut self, path: &Path, run: &str) -> Result<()> {
        let file = Tensors::open(path)?;
        let counts = file.u64("counts", Some(3))?;
        let config: PpoConfig = serde_json::from_str(file.word("config")?).map_err(|e| file.wrong(e))?;
        let (begun, wanted) = (config.iterations, self.config.iterations);
        if self.config.algorithm == Algorithm::Shac && begun != wanted {
            return Err(file.wrong(format!("SHAC's rate falls over all {begun} iterations of this run: it cannot become one of {wanted}")));
        }
        // Any other may be made longer.
        let config = PpoConfig { iterations: self.config.iterations, ..config };
        let whole = |config, run: &str, seed| serde_json::json!({ "run": run, "seed": seed, "settings": config }).to_string();
        let (found, asked) = (whole(&config, file.word("run")?, counts[2]), whole(&self.config, run, self.seed));
        if found != asked {
            return Err(file.wrong(format!("it is that of another run: {}", between(&found, &asked))));
        }
        let mut state = self.state.clone();
        state.policy = get(&file, "policy.", state.policy.shape)?;
        state.best = match file.f64("best.reward", Some(1)) {
            Ok(reward) => Some((reward[0], get(&file, "best.", state.policy.shape.clone())?)),
            Err(_) => None,
        };
        let weights = Some(state.adam.m.len());
        (state.adam.m, state.adam.v) = (file.f32("adam.m", weights)?, file.f32("adam.v", weights)?);
        (state.iteration, state.adam.step) = (counts[0], counts[1]);
        state.adam.rate = file.f64("rate", Some(1))?[0];
        state.recent = file.f64("recent", None)?.as_chunks().0.iter().map(|[a, b]| (*a, *b)).collect();
        let (n, running) = (self.config.environments, &mut state.running);
        let part = self.ranks.part(n);
        let row = running.stack.rows.len() / part.len().max(1);
        let real = |name: &str, blocks: usize, width: Option<usize>| -> Result<Vec<f64>> {
            Ok(rows(&file.f64(name, width.map(|width| n * width))?, blocks, n, &part))
        };
        running.stack.rows = real("running.stack", 1, Some(row))?;
        running.rewards = real("running.rewards", 1, Some(1))?;
        running.lengths = real("running.lengths", 1, Some(1))?;
        let past = file.f64("past.states", None)?.len().checked_div(file.f64("states", None)?.len()).unwrap_or(0);
        let snapshot = Snapshot {
            states: real("states", 1, None)?,
            frames: rows(&file.u64("frames", Some(n))?, 1, n, &part),
            goals: real("goals", 1, None)?,
            begun: rows(&file.u64("begun", Some(n))?, 1, n, &part),
            past_states: real("past.states", past, None)?,
            past_torques: real("past.torques", past, None)?,
        };
        for (name, numbers) in self.engine.learned()? {
            *numbers = file.f32(name, Some(numbers.len()))?;
        }
        self.engine.restore(&mut self.episodes, &snapshot)?;
        self.state = state;
        Ok(())
    }
}

/// A vector `[blocks][environment][numbers]` of all ranks.
fn whole(team: &Team, own: Vec<u64>, blocks: usize) -> Result<Vec<u64>, RankError> {
    if team.alone() {
        return Ok(own);
    }
    let parts = team.exchange(own)?;
    let block = |part: &[u64], k: usize| part[k * (part.len() / blocks)..(k + 1) * (part.len() / blocks)].to_vec();
    Ok((0..blocks).flat_map(|k| parts.iter().flat_map(move |part| block(part, k))).collect())
}

/// Some of the n environments of such a vector.
fn rows<T: Copy>(all: &[T], blocks: usize, n: usize, range: &Range<usize>) -> Vec<T> {
    let width = all.len().checked_div(blocks * n).unwrap_or(0);
    (0..blocks).flat_map(|block| &all[(block * n + range.start) * width..(block * n + range.end) * width]).copied().collect()
}
