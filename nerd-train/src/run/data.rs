//! Training and validation data of a run: windows of tokens, or motions of a chain or a robot.

use nerd_model::chain::{Chain, ChainSolver};
use nerd_model::trapezoid;

use super::*;
use crate::prepare::{Prepared, moments, normalize, read, tokens};
use crate::unroll::chain::{Cable, Loss, scales};
use crate::unroll::robot::Robot;

/// Number of validation transitions, and offset of their seed from the training seed (paper).
const VALIDATION: (usize, u64) = (200_000, 10);

pub(super) struct Data {
    pub sha256: String,
    pub transitions: usize,
    /// Number of possible first frames of a training sample.
    pub windows: usize,
    pub judge: Judge,
    pub sets: Sets,
}

pub(super) struct Judge {
    pub normalizer: Normalizer,
    pub motions: Option<Arc<Trajectories>>,
}

/// Training and validation data, by the way in which the run trains.
pub(super) enum Sets {
    Windows([Arc<Windows>; 2]),
    Cable(Box<Course<Cable>>),
    Robot(Box<Course<Robot>>),
}

/// Motions that earlier runs have read or recorded; the runs of a recipe share most of them.
#[derive(Default)]
pub(super) struct Cache(Mutex<Vec<(String, Arc<Trajectories>)>>);

/// Number of entries in the cache: motions for training and for validation.
const KEPT: usize = 2;

impl Cache {
    /// The motions stored under `name`, or else the result of `make`, which is then stored.
    fn get(
        &self,
        name: impl std::fmt::Debug,
        make: impl FnOnce() -> Result<Trajectories>,
    ) -> Result<Arc<Trajectories>> {
        let name = format!("{name:?}");
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, found)) = all.iter().find(|(known, _)| *known == name) {
            return Ok(found.clone());
        }
        let made = Arc::new(make()?);
        all.push((name, made.clone()));
        let old = all.len().saturating_sub(KEPT);
        all.drain(..old);
        Ok(made)
    }
}

impl Data {
    /// Records or reads the data of a run.
    pub fn of(plan: &Plan, cache: &Cache) -> Result<Self> {
        if plan.mode.frames().is_some() { Self::motions(plan, cache) } else { Self::windows(plan) }
    }

    fn windows(plan: &Plan) -> Result<Self> {
        let Plan { config, system, .. } = plan;
        let record = &config.record;
        let sequence = plan.network.sequence();
        let form = plan.mode.form();
        let (mut training, mut validation) = match &plan.measured {
            Some(measured) => {
                let part = |part: &[_]| {
                    Ok::<_, Error>(tokens(system, &measured.recording(part, record.frames, sequence)?, sequence, form))
                };
                (
                    Prepared { windows: part(&measured.learned)?, sha256: measured.sha256.clone() },
                    part(&measured.choosing)?,
                )
            }
            None => {
                let training = match &config.data {
                    Some(folder) => read(system, &record.truth(system).name(), folder, sequence, form)?,
                    None => record.tokens(system, &plan.recording, (sequence, form))?,
                };
                let validation = validation(plan, VALIDATION.0.min(config.transitions));
                (training, record.tokens(system, &validation, (sequence, form))?.windows)
            }
        };
        let windows = &training.windows;
        if windows.is_empty() || validation.is_empty() {
            refuse!(
                "{} trajectories of {} frames hold no sequence of {sequence} tokens",
                windows.trajectories(),
                windows.frames
            );
        }
        let own = || {
            let mut own = moments(windows);
            own.outputs.epsilon = config.epsilon.unwrap_or(own.outputs.epsilon);
            if form.base == Base::Trapezoid {
                trapezoid::level(&system.robot, system.frame_time, &mut own.outputs);
            }
            own
        };
        let normalizer = plan.parent.as_ref().map_or_else(own, |p| p.normalizer.clone());
        normalize(&mut training.windows, &normalizer);
        normalize(&mut validation, &normalizer);
        let windows = training.windows;
        Ok(Self {
            sha256: training.sha256,
            transitions: windows.trajectories() * windows.frames,
            windows: windows.len(),
            judge: Judge { normalizer, motions: None },
            sets: Sets::Windows([Arc::new(windows), Arc::new(validation)]),
        })
    }

    fn motions(plan: &Plan, cache: &Cache) -> Result<Self> {
        let Plan { config, system, .. } = plan;
        let record = &config.record;
        let truth = record.truth(system).name();
        let recorded = |what: &GenerateConfig| {
            cache.get((&config.robot, &truth, what, config.device), || record.motions(system, what, config.device))
        };
        let frames = plan.mode.frames().unwrap_or(1);
        let (motions, validation) = match &plan.measured {
            Some(measured) => {
                let part =
                    |part: &[_]| Ok::<_, Error>(Arc::new(measured.recording(part, record.frames, frames)?.bare()));
                (part(&measured.learned)?, part(&measured.choosing)?)
            }
            None => {
                let motions = match &config.data {
                    Some(folder) => cache.get(folder, || Ok(unroll::read(system, &truth, folder)?))?,
                    None => recorded(&plan.recording)?,
                };
                (motions, recorded(&validation(plan, config.rollouts.max(1) * record.frames))?)
            }
        };
        let (train, choosing) = (motions.clone(), validation.clone());
        let (normalizer, sets) = match (&plan.mode, &plan.parent) {
            (Mode::Rollouts { .. }, Some(Model { normalizer, .. })) => {
                let body = Robot::new(system, plan.mode.form(), normalizer, &motions);
                (normalizer.clone(), Sets::Robot(Box::new(Course { body, train, validation: choosing, frames })))
            }
            (_, parent) => {
                let chain = Chain::of(system)?;
                let (own, velocity) = scales(&chain, &motions);
                let normalizer = parent.as_ref().map_or(own, |p| p.normalizer.clone());
                let scale = ChainSolver::scale(&normalizer)?;
                let body = Cable { loss: Loss::new(&scale, velocity, frames), chain, scale };
                (normalizer, Sets::Cable(Box::new(Course { body, train, validation: choosing, frames })))
            }
        };
        Ok(Self {
            sha256: plan.measured.as_ref().map_or_else(|| unroll::sha256(&motions), |measured| measured.sha256.clone()),
            transitions: motions.count * motions.frames,
            windows: motions.count * motions.frames,
            judge: Judge { normalizer, motions: matches!(plan.mode, Mode::Chain { .. }).then_some(validation) },
            sets,
        })
    }
}

fn validation(plan: &Plan, transitions: usize) -> GenerateConfig {
    GenerateConfig { transitions, seed: plan.config.record.seed + VALIDATION.1, ..plan.recording.clone() }
}
