//! What is drawn: a chart's settings, and all that they name.

use crate::{choice::describe, error::unused, prelude::*, roll::refusal};
use nerd_sim::articulated::device::has_kernels;
use nerd_train::cost::powers;

settings! {
    /// Speed against accuracy.
    pub struct Chart {
        /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf or MJCF (.xml)
        robot: String = "pendulum".into(), Text;
        /// Scene: free, a scene of the robot (ground, or ground1 .. ground6 for the pendulum), plane, slope, box, steps, hills
        scene: String = "free".into(), Text;
        /// Model folders, comma-separated [default: all of the robot in models/]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Trajectories
        starts: usize = 64, Whole(STARTS);
        /// Frames over which the error is the mean
        frames: usize = 100, Whole(FRAMES);
        /// Largest number of substeps
        substeps: usize = 256, Whole(SUBSTEPS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Joints are held by drives with the robot's gains, at random targets within so much (rad or m) of the default pose, new every 20 ms
        /// [default: limp]
        targets: f64 = 0.0, Number(0.0..=10.0);
        /// Python that has MuJoCo, or with --device cuda MuJoCo Warp, to draw that engine too [default: none]
        mujoco: Option<PathBuf> = None, Text;
        /// What is timed: a frame of one environment on one core (cpu), or of one among many on a GPU (cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// With --device cuda: environments that are stepped together
        environments: usize = 8192, Whole(STARTS);
    }
}

pub(super) struct Plan {
    pub system: Arc<System>,
    pub scene: Arc<Scene>,
    pub methods: Vec<Method>,
    /// Series that cannot take part, and why.
    pub refused: Vec<String>,
    /// Whether nothing of it steps explicitly.
    pub implicit: bool,
    pub protocol: PassiveConfig,
    /// How many are stepped together on a GPU, if that is timed.
    pub environments: Option<usize>,
}

pub(super) struct Method {
    pub setting: Setting,
    pub series: String,
    /// What it is compared with, if that is not the chart's reference.
    pub own: Option<Truth>,
}

impl Chart {
    pub(super) fn plan(&self) -> Result<Plan> {
        let system = System::named(&self.robot)?;
        let scene = system.scene(&self.scene)?;
        let frames = [("--starts", self.starts), ("--frames", self.frames)];
        // Every state of the reference is kept, and of a model's own truth.
        bounds::memory(&frames, 16 * system.robot.state_dim())?;
        // The reference has four times the substeps.
        bounds::time(&[frames[0], frames[1], ("4 x --substeps", 4 * self.substeps)])?;
        let card = self.device.is_cuda();
        unused(&[("--environments", !card && self.environments != Self::default().environments)], "without --device cuda")?;
        unused(&[("--targets", self.targets > 0.0 && system.robot.joint_count() == 0)], "for a robot without joints")?;
        if card && !cfg!(feature = "cuda") {
            bail!("--device cuda needs a build with `--features cuda`");
        }
        let mut models = self.model.clone();
        if models.is_empty() {
            models = shipped::folders(&shipped::models(), &system.name)?;
            // Of this robot, not of one whose name begins alike.
            models.retain(|folder| ModelConfig::read(folder).is_ok_and(|model| model.robot == system.name));
        }
        let truth = system.spec.truth;
        let action = if self.targets > 0.0 { Action::Held(self.targets) } else { Action::Limp };
        let implicit = system.held() || action != Action::Limp;
        let mut settings = analytic(!scene.colliders.is_empty(), implicit, self.substeps);
        settings.push(truth.into());
        // No other has kernels, or drives.
        settings.retain(|setting| {
            !card && action == Action::Limp || setting.articulated(&system).is_some_and(|config| !card || has_kernels(&config).is_ok())
        });
        let methods = settings.into_iter().chain(models.into_iter().map(Setting::Neural)).map(|setting| Method::new(setting, truth));
        let (mut ready, mut refused) = (Vec::new(), Vec::new());
        if let Some(Err(reason)) = Setting::from(truth).articulated(&system).filter(|_| card).map(|config| has_kernels(&config)) {
            refused.push(format!("the truth, {}: left out, {reason}", truth.name()));
        }
        for method in methods.collect::<Result<Vec<Method>>>()? {
            let solver = method.setting.solver(&system).map_err(|e| e.to_string());
            match solver.map_or_else(Some, |mut solver| refusal(&mut *solver, &system, &scene)) {
                None => ready.push(method),
                Some(reason) => refused.push(format!("{}: left out, {reason}", method.series)),
            }
        }
        refused.dedup();
        let protocol = PassiveConfig { starts: self.starts, steps: self.frames, seed: self.seed, action };
        Ok(Plan { methods: ready, refused, implicit, system, scene, protocol, environments: card.then_some(self.environments) })
    }
}

impl Plan {
    pub fn contact(&self) -> bool {
        !self.scene.colliders.is_empty()
    }
}

/// Analytic solvers at powers of two of substeps.
fn analytic(contact: bool, implicit: bool, most: usize) -> Vec<Setting> {
    let mut settings: Vec<Setting> = if implicit { Vec::new() } else { powers(most).map(Setting::Euler).collect() };
    if contact || implicit {
        settings.extend(powers(most / 2).map(Setting::Implicit));
    }
    if contact {
        settings.extend(powers(most / 4).map(Setting::RapierSteps));
    } else if !implicit {
        settings.extend(powers(most.min(32)).map(Setting::Rk4));
    }
    settings.extend(powers(most).map(Setting::Rapier));
    settings
}

impl Method {
    fn new(setting: Setting, truth: Truth) -> Result<Self> {
        let Setting::Neural(folder) = &setting else {
            let whose = if setting == truth.into() { " (NeRD's truth)" } else { "" };
            return Ok(Self { series: format!("{}{whose}", setting.series()), own: None, setting });
        };
        let name = describe(&ModelConfig::read(folder)?);
        let own = Some(ModelConfig::truth_of(folder)?).filter(|own| *own != truth);
        let series = own.map_or(name.clone(), |own| format!("{name}, against {}", own.name()));
        Ok(Self { series, own, setting })
    }
}
