//! A chart's settings, and the methods and scene that the settings name.

use crate::prelude::*;
use nerd_cli::roll::{begun, refusal};
use nerd_cli::{describe::title, error::unused};
use nerd_sim::articulated::device::has_kernels;
use nerd_train::{comparison::Comparison, cost::powers, spec::Method as Stepping, spec::RapierSpec};

settings! {
    /// Settings of a chart: speed against accuracy.
    pub struct Chart {
        /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable
        /// .toml
        robot: String = "pendulum".into(), Text;
        /// Scene: free, plane, slope, box, steps, hills, or one of the robot's own (`list scenes` prints all)
        scene: String = "free".into(), Text;
        /// Folders of models, comma-separated [default: all models of the robot in models/]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Number of trajectories
        trajectories: usize = 64, Whole(STARTS);
        /// Frames over which the error is averaged
        frames: usize = 100, Whole(FRAMES);
        /// Largest number of substeps per frame
        max_substeps: usize = 256, Whole(SUBSTEPS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Largest distance (rad or m) of random drive targets from the default pose, drawn anew every 20 ms. Drives
        /// use the robot's gains. With 0, no torque acts
        targets: f64 = 0.0, Number(0.0..=10.0);
        /// Python that has MuJoCo (with --device cuda: MuJoCo Warp), which is drawn too [default: none]
        mujoco: Option<PathBuf> = None, Text;
        /// Device that is timed: cpu (one environment on one core) or cuda (one of many environments on a GPU)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// With --device cuda: number of environments stepped together
        envs: usize = 8192, Whole(STARTS);
    }
}

pub(super) struct Plan {
    pub system: Arc<System>,
    pub scene: Arc<Scene>,
    pub methods: Vec<Method>,
    /// Messages on the series that are left out, each with its reason.
    pub refused: Vec<String>,
    /// Whether forces act that explicit steps do not support.
    pub implicit: bool,
    pub protocol: PassiveConfig,
    /// Number of environments stepped together on a GPU; `None` on the CPU.
    pub environments: Option<usize>,
}

pub(super) struct Method {
    pub spec: SolverSpec,
    pub series: String,
    /// Truth that this method is compared with, if not the chart's reference.
    pub own: Option<Truth>,
}

impl Chart {
    pub(super) fn plan(&self) -> Result<Plan> {
        let system = System::named(&self.robot)?;
        let scene = system.scene(&self.scene)?;
        let frames = [("--trajectories", self.trajectories), ("--frames", self.frames)];
        // Counts the states of the reference and of a model's own truth, which are all kept.
        bounds::memory(&frames, 16 * system.robot.state_dim())?;
        // Counts four times the substeps, which the reference has.
        bounds::time(&[frames[0], frames[1], ("4 x --max-substeps", 4 * self.max_substeps)])?;
        let card = self.device.is_cuda();
        unused(&[("--envs", !card && self.envs != Self::default().envs)], "without --device cuda")?;
        unused(&[("--targets", self.targets > 0.0 && system.robot.joint_count() == 0)], "for a robot without joints")?;
        built_for(card)?;
        let mut models = self.model.clone();
        if models.is_empty() {
            models = shipped::folders(&shipped::models(), &system.name)?;
            // Drops models of robots whose longer names begin with this name.
            models.retain(|folder| ModelConfig::read(folder).is_ok_and(|model| model.robot == system.name));
        }
        let truth = system.spec.truth;
        let action = if self.targets > 0.0 { Action::Held(self.targets) } else { Action::Limp };
        let implicit = system.held() || action != Action::Limp;
        let mut settings = analytic(!scene.colliders.is_empty(), implicit, self.max_substeps);
        settings.push(truth.into());
        // Keeps only `articulated` on a GPU or with drives: no other solver has kernels or drives.
        settings.retain(|setting| {
            !card && action == Action::Limp
                || setting.config(&system).is_some_and(|config| !card || has_kernels(&config).is_ok())
        });
        let methods =
            settings.into_iter().chain(models.into_iter().map(SolverSpec::neural)).map(|spec| Method::new(spec, truth));
        let mut ready = Vec::new();
        let mut refused = Vec::new();
        if let Some(Err(reason)) =
            SolverSpec::from(truth).config(&system).filter(|_| card).map(|config| has_kernels(&config))
        {
            refused.push(format!("the truth, {}: left out, {reason}", truth.name()));
        }
        for method in methods.collect::<Result<Vec<Method>>>()? {
            let solver = method.spec.solver(&system, self.trajectories).map_err(|e| e.to_string());
            match solver.map_or_else(Some, |mut solver| refusal(&mut *solver, &system, &scene)) {
                None => ready.push(method),
                Some(reason) => refused.push(format!("{}: left out, {reason}", method.series)),
            }
        }
        refused.dedup();
        let protocol = PassiveConfig { starts: self.trajectories, steps: self.frames, seed: self.seed, action };
        Ok(Plan { methods: ready, refused, implicit, system, scene, protocol, environments: card.then_some(self.envs) })
    }
}

impl Plan {
    pub fn contact(&self) -> bool {
        !self.scene.colliders.is_empty()
    }

    /// Makes a batch of the chart's environments at their starts.
    pub fn begun(&self) -> Batch {
        begun(&self.system, &self.scene, self.protocol.starts, Start::Reset, self.protocol.seed)
    }

    /// Rolls out a truth from the chart's starts.
    pub fn beside(&self, truth: Box<dyn Solver>) -> Result<Comparison<'_>, StepError> {
        Comparison::with(truth, &self.system, &self.scene, self.protocol)
    }
}

/// Lists the analytic solvers, with powers of two as numbers of substeps.
fn analytic(contact: bool, implicit: bool, most: usize) -> Vec<SolverSpec> {
    let ours = |method, most| powers(most).map(move |n| SolverSpec::articulated(method, n));
    let mut specs: Vec<SolverSpec> = if implicit { Vec::new() } else { ours(Stepping::Euler, most).collect() };
    if contact || implicit {
        specs.extend(ours(Stepping::Implicit, most / 2));
    }
    if contact {
        specs.extend(powers(most / 4).map(SolverSpec::rapier));
    } else if !implicit {
        specs.extend(ours(Stepping::Rk4, most.min(32)));
    }
    // Leaves out one step with the default iterations, which the other rapier series has.
    specs.extend(
        powers(most)
            .filter(|n| *n != RapierSpec::default().iterations)
            .map(|iterations| SolverSpec::Rapier(RapierSpec { steps: 1, iterations, ..RapierSpec::default() })),
    );
    specs
}

impl Method {
    fn new(spec: SolverSpec, truth: Truth) -> Result<Self> {
        let Some(folder) = spec.folder() else {
            let whose = if spec == truth.into() { " (NeRD's truth)" } else { "" };
            return Ok(Self { series: format!("{}{whose}", spec.series()), own: None, spec });
        };
        let name = title(&spec)?;
        let own = Some(ModelConfig::truth_of(folder)?).filter(|own| *own != truth);
        let series = own.map_or(name.clone(), |own| format!("{name}, against {}", own.name()));
        Ok(Self { series, own, spec })
    }
}
