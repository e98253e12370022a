//! Checkpoints of a run: one safetensors file, replaced atomically. A resumed run gives the same bits as an unbroken
//! one. With a streaming network as simulator, both are equal up to rounding (see `nerd_tasks::Episodes::remember`).
//!
//! Random streams of noise, permutations and resets are numbered by iteration, step or episode, so no generator state
//! is stored.

use super::folder::{get, put};
use super::*;
use nerd_sim::files::renamed::{self, Kind};

impl Trainer {
    /// Writes a checkpoint; `run` identifies the run and is compared on resuming.
    pub fn save(&mut self, path: &Path, run: &str) -> Result<()> {
        let state = &self.state;
        let Snapshot { states, frames, goals, begun, past_states, past_torques } =
            self.engine.snapshot(&self.episodes)?;
        let mut file = Tensors::default();
        put(&mut file, "policy.", &state.policy);
        if let Some((reward, policy)) = &state.best {
            put(&mut file, "best.", policy);
            file.put_f64("best.reward", [*reward]);
        }
        file.put_f32("adam.m", &[state.adam.m.len()], &state.adam.m);
        file.put_f32("adam.v", &[state.adam.v.len()], &state.adam.v);
        file.put_u64("counts", &[state.iteration, state.adam.step, self.seed]);
        file.put_f64("rate", [state.adam.learning_rate]);
        file.put_f64("recent", state.recent.iter().flat_map(|e| [e.0, e.1]));
        let reals: [(&str, &[f64]); 7] = [
            ("running.stack", &state.running.stack.rows),
            ("running.rewards", &state.running.rewards),
            ("running.lengths", &state.running.lengths),
            ("states", &states),
            ("goals", &goals),
            ("past.states", &past_states),
            ("past.torques", &past_torques),
        ];
        reals.into_iter().for_each(|(name, numbers)| file.put_f64(name, numbers.iter().copied()));
        file.put_u64("frames", &frames);
        file.put_u64("begun", &begun);
        self.engine.learned()?.into_iter().for_each(|(name, numbers)| file.put_f32(name, &[numbers.len()], numbers));
        let config = serde_json::to_string(&self.config).unwrap_or_default();
        file.put_word("config", config);
        file.put_word("run", run);
        file.save(path)
    }

    /// Identity of the run as JSON: settings, seed and `run`.
    pub(super) fn whole(&self, run: &str) -> String {
        whole(&self.config, run, self.seed)
    }

    /// Continues the run of a checkpoint; `run` must equal the one given to [`Self::save`].
    ///
    /// # Errors
    /// If the file is no checkpoint, or belongs to another run. After an error only the episodes and the engine may
    /// have changed.
    pub fn resume(&mut self, path: &Path, run: &str) -> Result<()> {
        let file = Tensors::open(path)?;
        let counts = file.u64("counts", Some(3))?;
        let mut config = serde_json::from_str(file.word("config")?).map_err(|e| file.wrong(e))?;
        let old = renamed::json(Kind::Ppo, &mut config).map_err(|e| file.wrong(e))?;
        renamed::note(&path.display().to_string(), old);
        let config: PpoConfig = serde_json::from_value(config).map_err(|e| file.wrong(e))?;
        let begun = config.iterations;
        let wanted = self.config.iterations;
        if self.config.algorithm == Algorithm::Shac && begun != wanted {
            return Err(file.wrong(format!(
                "SHAC's rate falls over all {begun} iterations of this run: it cannot become one of {wanted}"
            )));
        }
        // A PPO run may change its number of iterations on resuming.
        let config = PpoConfig { iterations: self.config.iterations, ..config };
        let found = whole(&config, file.word("run")?, counts[2]);
        let asked = self.whole(run);
        if found != asked {
            let what = changed(file.word("run")?, run).map_or_else(|| between(&found, &asked), Into::into);
            return Err(file.wrong(format!("it is that of another run: {what}")));
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
        state.adam.learning_rate = file.f64("rate", Some(1))?[0];
        state.recent = file.f64("recent", None)?.as_chunks().0.iter().map(|[a, b]| (*a, *b)).collect();
        let n = self.config.environments;
        let running = &mut state.running;
        running.stack.rows = file.f64("running.stack", Some(running.stack.rows.len()))?;
        running.rewards = file.f64("running.rewards", Some(n))?;
        running.lengths = file.f64("running.lengths", Some(n))?;
        let snapshot = Snapshot {
            states: file.f64("states", None)?,
            frames: file.u64("frames", Some(n))?,
            goals: file.f64("goals", None)?,
            begun: file.u64("begun", Some(n))?,
            past_states: file.f64("past.states", None)?,
            past_torques: file.f64("past.torques", None)?,
        };
        for (name, numbers) in self.engine.learned()? {
            *numbers = file.f32(name, Some(numbers.len()))?;
        }
        self.engine.restore(&mut self.episodes, &snapshot)?;
        self.state = state;
        Ok(())
    }
}

/// Everything that determines the result of a run, as JSON.
fn whole(config: &PpoConfig, run: &str, seed: u64) -> String {
    serde_json::json!({ "run": run, "seed": seed, "settings": config }).to_string()
}

/// The cause if two identities differ by one hash alone. It is the task's (`task HASH of ..`) or the robot's (last
/// word).
fn changed(was: &str, now: &str) -> Option<&'static str> {
    let (was, now) = (was.split(' ').collect_vec(), now.split(' ').collect_vec());
    let apart = (0..was.len().max(now.len())).filter(|k| was.get(*k) != now.get(*k)).collect_vec();
    match apart[..] {
        [1, ..] if was[0] == "task" && apart[1..].iter().all(|k| k + 1 == was.len()) => Some("the task's text changed"),
        [k] if k + 1 == was.len() && was.len() > 2 => Some("the robot's file changed"),
        _ => None,
    }
}
