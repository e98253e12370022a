//! Episodes in a model of a family that has to guess which robot it steps: each begins where a robot came in the truth under a policy, and
//! the model has seen how it came there.

use nerd_tasks::Beginning;

use super::*;
use crate::device::Device;

/// Episodes of each robot that are shown at least, and at most where its first ones end too early.
const ROUNDS: [usize; 2] = [2, 8];
pub(super) const ROBOTS: usize = 256;

/// A model of a family, and how robots are shown to it.
#[derive(Clone)]
pub struct Guess {
    /// The model's folder.
    pub folder: PathBuf,
    /// Where its network is computed.
    pub device: Device,
    /// The family.
    pub family: Arc<System>,
    /// What steps the robots that are shown.
    pub truth: Truth,
    /// Frames of each.
    pub shown: u64,
    /// Folder of the policy of the task that acts in them, by mean actions.
    pub by: PathBuf,
}

impl Guess {
    /// So many episodes in the model, of robots that have just begun `real` ones in the truth.
    pub(super) fn episodes(&self, task: Box<dyn Task>, n: usize, seed: u64, real: Episodes) -> Result<Episodes> {
        let model = Model::load(&self.folder, &self.family, None)?;
        let beginnings = self.beginnings(&*task, &model, real)?;
        let batch = Batch::new(&self.family, &self.family.scene(task.scene())?, n);
        let mut episodes = Episodes::new(task, Simulation { batch, solver: self.solver(&model, n)? }, seed);
        episodes.begin_at(beginnings)?;
        Ok(episodes)
    }

    fn solver(&self, model: &Model, n: usize) -> Result<Box<dyn Solver>> {
        if model.config.told {
            refuse!("{} is told its robots, and has nothing to guess; take a model without --told", self.folder.display());
        }
        Ok(Box::new(Neural::new(model.clone(), self.device.network(&model.weights, n)?)))
    }

    /// By robot, where its episodes are after the frames that are shown; of robots that come so far.
    fn beginnings(&self, task: &dyn Task, model: &Model, mut real: Episodes) -> Result<Vec<Vec<Beginning>>> {
        let (config, policy) = folder::load(&self.by)?;
        if config.task != task.name() {
            refuse!("{} is a policy of `{}`, not of `{}`", self.by.display(), config.task, task.name());
        }
        if self.shown == 0 || self.shown >= task.episode_length() * task.frames() || !self.shown.is_multiple_of(task.frames()) {
            let frames = task.frames();
            refuse!("{} frames shown: a multiple of {frames} below {} is needed", self.shown, task.episode_length() * frames);
        }
        let (mut solver, actor, robots) = (self.solver(model, real.len())?, Actor::new(policy), real.len());
        let mut all = vec![Vec::new(); robots];
        let bar = bar("robots shown to the model", ROUNDS[0] as u64);
        for round in 0..ROUNDS[1] {
            if round >= ROUNDS[0] && all.iter().all(|own| !own.is_empty()) {
                break;
            }
            if round > 0 {
                (0..robots).try_for_each(|env| real.begin(env))?;
            }
            self.show(&actor, &mut real, &mut *solver, &mut all)?;
            bar.add(1);
        }
        bar.finish();
        all.retain(|own| !own.is_empty());
        if all.is_empty() {
            refuse!("{}: no robot of `{}` goes on for {} frames under it", self.by.display(), self.family.name, self.shown);
        }
        Ok(all)
    }

    /// Shows the model an episode of every robot, and adds where those are then that are still in it.
    fn show(&self, actor: &Actor, real: &mut Episodes, solver: &mut dyn Solver, all: &mut [Vec<Beginning>]) -> Result<()> {
        let (mut running, mut reached) = (Running::new(real, actor.policy.shape.stack), Vec::new());
        real.trace();
        for _ in 0..self.shown / real.task.frames() {
            running.step(real, &actor.mean(&running.stack.rows), &mut reached)?;
        }
        let (trace, mut batch) = (real.trace(), real.simulation.batch.clone());
        (0..batch.len()).for_each(|env| solver.reset(env));
        batch.systems.clear();
        batch.frames.fill(0);
        let (states, torques) = (trace.states.chunks_exact(batch.states.len()), trace.torques.len() / self.shown as usize);
        for (states, torques) in states.zip(trace.torques.chunks_exact(torques)) {
            batch.states.copy_from_slice(states);
            // What ends in the model alone is in its memory no more.
            if let Err(error) = solver.step(&mut batch, torques) {
                error.faults()?;
            }
        }
        for (env, own) in all.iter_mut().enumerate() {
            if real.simulation.batch.frames[env] == self.shown && batch.frames[env] == self.shown {
                let (state, goal) = (real.simulation.batch.state(env).to_vec(), real.view(env).goal.to_vec());
                own.push(Beginning { state, goal, frame: self.shown, memory: solver.remembered(env)? });
            }
        }
        Ok(())
    }
}
