//! Recording of a robot's motion: into a folder by the command `dataset`, in memory by `train`.

use nerd_sim::dataset::{Manifest, Pilot};

use super::*;
use crate::bounds::{self, FRAMES, SEEDS};
use crate::device::truth_on_card;
use crate::ppo::Policies;
use crate::prepare::{Prepared, generate};

/// Most trajectories in a shard of motions. On the CPU they are few, so that all threads have work; on a GPU, which all
/// threads share, many.
const ON_CPU: usize = 16;
const ON_CARD: usize = 256;

settings! {
    /// Settings of a recording. The defaults are the paper's.
    pub struct RecordConfig {
        # "Recording"
        /// Solver that is recorded: articulated, paper (the reference simulator's method) or rapier [default: the
        /// robot's own, paper for robots NAME-paper, else articulated]
        truth: Option<Truth> = None, Words(&["articulated", "paper", "rapier"]);
        /// Frames per trajectory. Short trajectories give more starts and first contacts
        frames: usize = 100, Whole(FRAMES), "N";
        /// Lower bound of the factor on random torques, drawn once per trajectory from U(this, 1). Factors below 0
        /// count as 0. With -1, half of the trajectories are passive, as in evaluations
        torque_scale: f64 = 1.0, Number(-10.0..=1.0), "FACTOR";
        /// Largest number of frames over which a random action stays constant. The number is drawn once per trajectory
        hold: usize = 1, Whole(FRAMES), "FRAMES";
        /// Share of trajectories that start from the ranges of evaluations and tasks, in place of the training ranges
        resets: f64 = 0.0, Number(0.0..=1.0), "SHARE";
        /// Folders of policies, comma-separated, that act in part of the trajectories, each in its own task. Action
        /// noise is added. A quarter of these trajectories begin fast, and in a quarter several policies alternate
        /// [default: none]
        policy: Vec<PathBuf> = Vec::new(), Texts, "FOLDERS";
        /// Share of trajectories in which the policies of --policy act
        policy_share: f64 = 0.5, Number(0.0..=1.0), "SHARE";
        /// Seed of the data, and in a training run of initial weights and windows (the paper: 0; validation: 10)
        seed: u64 = 0, Whole(SEEDS);
    }
}

impl RecordConfig {
    /// The solver that is recorded as truth: the one in these settings, else the robot's own.
    pub fn truth(&self, system: &System) -> Truth {
        self.truth.unwrap_or(system.spec.truth)
    }

    /// The generator's settings for `transitions` transitions, rounded up to whole trajectories. Reads the policies.
    pub fn of(&self, system: &System, transitions: usize) -> Result<GenerateConfig> {
        if let Err(reason) = self.truth(system).check(&system.robot, system.spec.self_collision) {
            refuse!("--truth: {reason}");
        }
        let Self { frames, hold, resets, seed, .. } = *self;
        let torque_scale = Range { low: self.torque_scale, high: 1.0 };
        let pilot = self.pilot(system)?;
        let config =
            GenerateConfig { transitions, seed, torque_scale, frames, hold, resets, pilot, ..Default::default() };
        config.check(system)?;
        Ok(config)
    }

    /// The policies that act in a part of the data, and their share.
    fn pilot(&self, system: &System) -> Result<Option<(Arc<dyn Pilot>, f64)>> {
        if self.policy.is_empty() {
            if self.policy_share != Self::default().policy_share {
                refuse!("--policy-share means nothing without --policy");
            }
            return Ok(None);
        }
        let mut policies = Vec::new();
        for folder in &self.policy {
            let (config, policy) = crate::ppo::folder::load(&shipped::find(folder))?;
            let task = nerd_tasks::named(&config.task)?;
            // A policy of the nominal robot acts on all of a family. A task may give its robot other substeps, or
            // rotors.
            let its = task.system()?;
            let alike = system.alike(&its).and_then(|()| match its.name == system.name || system.spec.vary.is_some() {
                true => Ok(()),
                false => Err("its name is another".into()),
            });
            if let Err(why) = alike {
                refuse!("{} acts on `{}`, not on `{}`: {why}", folder.display(), task.robot(), system.name);
            }
            policies.push((task.into(), policy));
        }
        Ok(Some((Arc::new(Policies::new(policies)), self.policy_share)))
    }

    /// Policies and their share of the trajectories, for a card: names of their folders and first digits of their
    /// hashes.
    pub(super) fn actors(&self) -> Result<String> {
        if self.policy.is_empty() || self.policy_share == 0.0 {
            return Ok("in none of the trajectories".into());
        }
        let name = |folder: &PathBuf| -> Result<String> {
            let sha256 = crate::ppo::folder::load(&shipped::find(folder))?.1.sha256();
            // A run keeps its policy in the folder `policy`.
            let whole = if folder.ends_with("policy") { folder.parent() } else { None }.unwrap_or(folder);
            Ok(format!("{} {}", whole.file_name().unwrap_or_default().to_string_lossy(), &sha256[..8]))
        };
        let names = self.policy.iter().map(name).collect::<Result<Vec<_>>>()?;
        Ok(format!("in {} % of the trajectories: {}", (1e4 * self.policy_share).round() / 100.0, names.join(", ")))
    }

    /// Records `transitions` transitions into a folder; existing shards stay.
    pub fn write(&self, system: &Arc<System>, transitions: usize, folder: &Path) -> Result<Manifest> {
        let robot = &system.robot;
        // Memory holds three copies of a shard: as recorded, as bytes, and while written.
        let trajectories = transitions.div_ceil(self.frames.max(1)).min(GenerateConfig::default().shard_trajectories);
        let row = robot.state_dim() + robot.joint_count() + 7 * robot.contact_points.len();
        bounds::memory(&[("trajectories of a shard", trajectories), ("--frames", self.frames)], 24 * row)?;
        bounds::time(&[("--transitions", transitions), ("substeps", system.spec.substeps)])?;
        let config = self.of(system, transitions)?;
        let _claim = claimed(folder)?;
        let bar = bar("transitions", (config.trajectories() * config.frames) as u64);
        let mut solver = self.truth(system).solver(system);
        let truth = self.truth(system).name();
        let tell = &mut |done: usize, _: usize| bar.set(done as u64);
        let manifest = nerd_sim::dataset::generate(system, &mut *solver, &truth, &config, folder, tell)?;
        bar.finish();
        Ok(manifest)
    }

    /// Records motions in memory; on CUDA the articulated truth runs on the GPU in f64.
    pub(super) fn motions(
        &self,
        system: &Arc<System>,
        config: &GenerateConfig,
        device: Device,
    ) -> Result<Trajectories> {
        let bar = bar("recording transitions", (config.trajectories() * config.frames) as u64);
        let tell = |n: usize| bar.add(n as u64);
        let record = |on_card: bool| {
            let most = if on_card { ON_CARD } else { ON_CPU };
            let config = GenerateConfig { shard_trajectories: config.shard_trajectories.min(most), ..config.clone() };
            let solver = || if on_card { truth_on_card(system) } else { self.truth(system).solver(system) };
            unroll::motions(system, &solver, &config, &tell)
        };
        let on_card = device == Device::Cuda && self.truth(system) == Truth::Articulated;
        let motions = match record(on_card) {
            // The robot may be too large for the GPU, or have no kernels: it is recorded on the CPU. Other errors recur
            // there.
            Err(error) if on_card => {
                tell!("{error}; it is recorded on the CPU");
                bar.set(0);
                record(false)?
            }
            recorded => recorded?,
        };
        bar.finish();
        Ok(motions)
    }

    pub(super) fn tokens(
        &self,
        system: &Arc<System>,
        config: &GenerateConfig,
        form: (usize, Form),
    ) -> Result<Prepared> {
        let bar = bar("recording transitions", (config.trajectories() * config.frames) as u64);
        let tell = |n: usize| bar.add(n as u64);
        let prepared = generate(system, &|| self.truth(system).solver(system), config, form, &tell)?;
        bar.finish();
        Ok(prepared)
    }
}
