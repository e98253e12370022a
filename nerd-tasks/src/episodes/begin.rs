//! Starts episodes: random draws by seed, environment and episode, and the terrain of the episode's level.

use nerd_sim::files::renamed::{self, Kind};
use nerd_sim::{prelude::*, range::within};

use super::Episodes;
use crate::step::{CHUNK, StepResult, episode};

impl Episodes {
    /// Starts a curriculum over the task's levels ([`crate::Task::levels`]) and restarts all environments at the lowest
    /// level. An environment's level rises after an episode that succeeds and does not terminate. The level falls after
    /// a terminated episode.
    pub fn climb(&mut self) {
        let Some((at, levels)) = self.task.levels() else { return };
        let width = self.task.goal_dim();
        self.climbs = true;
        self.goals.chunks_exact_mut(width).for_each(|goal| goal[at] = 1.0 / levels as f64);
        (0..self.len()).for_each(|env| self.start(env));
        self.observe(|_| true);
    }

    /// Whether a curriculum over levels runs.
    pub fn climbs(&self) -> bool {
        self.climbs
    }

    /// Starts the next episode in an environment, whether or not the present one has ended.
    pub fn begin(&mut self, env: usize) {
        self.begin_numbered(&[(env, self.begun[env] + 1)]);
    }

    /// Sets commands of an environment's present episode by name, such as `vx=0.5,yaw_rate=0`.
    ///
    /// # Errors
    /// If a command is unknown, given twice, or out of range; then nothing changes.
    pub fn ask(&mut self, env: usize, commands: &str) -> Result<(), String> {
        let all = self.task.commands();
        let width = self.task.goal_dim();
        let mut asked: Vec<(usize, f64)> = Vec::new();
        for part in commands.split(',') {
            let Some((name, number)) = part.split_once('=') else { return Err(format!("`{part}` is no NAME=NUMBER")) };
            let (name, number) = (name.trim(), number.trim());
            // A command may have its old name, unless the task has a command of that name.
            let place = |name: &str| all.iter().position(|own| own.0 == name);
            let old = place(name)
                .map_or_else(|| renamed::renamed(Kind::Command, name), |_| None)
                .filter(|old| place(old.1).is_some());
            renamed::note(&format!("task {}", self.task.name()), old);
            let Some(k) = place(old.map_or(name, |old| old.1)) else {
                let own: Vec<&str> = all.iter().map(|own| &*own.0).collect();
                let own = if own.is_empty() { "it has none".into() } else { format!("choose from {}", own.join(", ")) };
                return Err(format!("task `{}` has no command `{name}`: {own}", self.task.name()));
            };
            let value = number.parse().map_err(|_| format!("`{name}` is `{number}`; a number is needed"))?;
            within(name, value, all[k].1[0]..=all[k].1[1], "")?;
            if asked.iter().any(|own| own.0 == k) {
                return Err(format!("`{name}` is there twice"));
            }
            asked.push((k, value));
        }
        asked.into_iter().for_each(|(k, value)| self.goals[env * width + k] = value);
        self.observe(|other| other == env);
        Ok(())
    }

    /// Number of the present episode of each environment, from 1.
    pub fn numbers(&self) -> &[u64] {
        &self.begun
    }

    /// Starts episodes by (environment, number), whether or not the present ones have ended. For example, an episode
    /// can be replayed from its start.
    ///
    /// # Panics
    /// If an environment does not exist.
    pub fn begin_numbered(&mut self, episodes: &[(usize, u64)]) {
        let mut begun = vec![false; self.len()];
        for &(env, number) in episodes {
            (self.begun[env], begun[env]) = (number.saturating_sub(1), true);
            self.start(env);
        }
        self.observe(|env| begun[env]);
    }

    /// Starts the first episodes of another seed.
    pub fn seeded(&mut self, seed: u64) {
        self.seed = seed;
        self.begin_numbered(&(0..self.len()).map(|env| (env, 1)).collect::<Vec<_>>());
    }

    pub(super) fn start(&mut self, env: usize) {
        self.begun[env] += 1;
        let mut rng = episode(self.seed, self.first + env, self.begun[env]);
        let width = self.task.goal_dim();
        let goal = &mut self.goals[env * width..(env + 1) * width];
        let climbs = self.climbs;
        let level = self.task.levels().filter(|_| climbs).map(|(at, _)| (at, goal[at]));
        self.task.draw_goal(&mut rng, goal);
        level.into_iter().for_each(|(at, level)| goal[at] = level);
        self.lay(env, false);
        let Simulation { batch, .. } = &self.simulation;
        let mut state = self.task.reset(&batch.system, &mut rng);
        batch.scenes[env].strew(&batch.system.robot, &mut self.works[env / CHUNK].data, &mut state, &mut rng);
        self.simulation.reset(env, &state);
    }

    /// Scales the terrain of an environment to its level. With `anew` also if the scale is right, since a GPU may have
    /// changed it.
    pub(super) fn lay(&mut self, env: usize, anew: bool) {
        let Some((at, _)) = self.task.levels() else { return };
        let level = self.goals[env * self.task.goal_dim() + at];
        let scene = &mut self.simulation.batch.scenes[env];
        if scene.terrain().is_some_and(|(_, field)| anew || field.scale() != level) {
            *scene = Arc::new(scene.scaled(level));
        }
    }

    /// Adds the errors of a step to the sums in the goals. Updates the level of each environment whose episode has
    /// ended.
    pub(super) fn rise(&mut self, result: &StepResult) {
        let Some((at, levels)) = self.task.levels() else { return };
        let steps = self.task.episode_length();
        let width = self.task.goal_dim();
        let frames = &self.simulation.batch.frames;
        let length = steps * self.task.frames();
        for (env, goal) in self.goals.chunks_exact_mut(width).enumerate() {
            let [level, total] = &mut goal[at..at + 2] else { continue };
            if 2 * frames[env] > length {
                *total += result.errors[env].unwrap_or(0.0);
            }
            if self.climbs && (result.terminated[env] || result.truncated[env]) {
                let succeeded = *total <= (steps - steps / 2) as f64;
                let by = if result.terminated[env] { -1.0 } else { f64::from(u8::from(succeeded)) };
                *level = ((*level * levels as f64).round() + by).clamp(1.0, levels as f64) / levels as f64;
            }
        }
    }
}
