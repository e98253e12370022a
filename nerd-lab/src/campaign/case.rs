//! Fuzz cases: mutates valid files of one kind, then reads them as a user's files are read. The same seed and case
//! number give the same files.

use nerd_sim::{log::Log, rollout::States};
use nerd_tasks::FileTask;
use nerd_train::ppo::{PpoConfig, folder};
use nerd_train::run::Recipe;
use nerd_train::settings::Given;
use rand::RngExt;

use super::energy;
use super::text::{Dice, Dictionary, byte};
use super::tree::Element;
use crate::prelude::*;

/// Kind of input that is mutated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, strum::VariantArray)]
pub enum Kind {
    Mjcf,
    Urdf,
    Robot,
    Task,
    Settings,
    Recipe,
    Log,
    Csv,
    Npz,
    Policy,
    Model,
    Energy,
}

const MJCF: [&str; 4] = [
    include_str!("seeds/arm.xml"),
    include_str!("seeds/feet.xml"),
    include_str!("seeds/parts.xml"),
    include_str!("seeds/slide.xml"),
];
const TASK: &str = "robot = \"cartpole\"\nsteps = 20\nframes = 2\nsubsteps = 4\nobservation = [\"q\", \"qd\", \"wide\"]\nreward = { up = \"cos(q[1])\", \
                    calm = \"-0.1 * mean(action.squared())\" }\nterminated = \"norm(qd) > 100\"\nerror = \"norm(q - [0, goal])\"\ntolerance = \"0.1 rad\"\n[command]\n\
                    goal = \"U(-1, 1)\"\n[let]\nwide = \"max(q[0], 0.5 * goal)\"\n";
const SETTINGS: &str = "environments = 64\nhorizon = 16\niterations = 10\nminibatch = 256\nepochs = 4\nhidden = [32, 32]\nactivation = \"relu\"\nstack = 2\n\
                        state_dependent_std = true\ngamma = 0.99\nclip_coef = 0.2\nlearning_rate = 3e-4\ntarget_kl = 0.008\n";
const RECIPE: &str = "robot = \"pendulum\"\nout = \"out\"\nbase = \"trapezoid\"\nembedding = 48\nlayers = 2\nhistory = 4\ntransitions = 1000\nframes = 20\n\
                      torque-scale = -1\n[[run]]\nupdates = 100\nrate = 1e-3\n[[run]]\nupdates = 50\nhuber = 0.02\nminutes = 3\n";
const LOG: &str = "file = \"log.npz\"\nrobot = \"pendulum\"\nscene = \"free\"\ntime = \"t\"\ncost = 60.5\nunits = { angle = \"rad\", time = \"s\" }\n[[joint]]\n\
                   name = \"joint1\"\nposition = \"q.0\"\nvelocity = \"qd.0\"\n[[joint]]\nname = \"joint2\"\nposition = \"q.1\"\nvelocity = \"qd.1\"\n";
const CSV: &str =
    "traj,step,q1,q2,qd1,qd2,tau1,tau2\n0,0,0.1,0.2,0,0,1,0\n0,1,,,,,0.5,0\n1,0,-1,0.5,0,1,0,0\n1,1,,,,,0,0\n";
const NPZ: &[u8] = include_bytes!("seeds/log.npz");

/// Outcome of a fuzz case: refused with a message, accepted, or a fault with its description.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    Refused,
    Accepted,
    Fault(String),
}

impl Kind {
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Makes the files of case `number`, as (name, bytes). `judge` opens the first file, or the folder of all.
    pub fn make(self, seed: u64, number: u64) -> Result<Vec<(String, Vec<u8>)>> {
        let dice = &mut stream(seed.wrapping_mul(31).wrapping_add(self as u64), number);
        let toml = |dice: &mut Dice, text: &str| edited(dice, Dictionary::toml(), text);
        let one = |name: &str, bytes: Vec<u8>| vec![(name.to_string(), bytes)];
        let read = |folder: &Path, name: &str| {
            std::fs::read(folder.join(name)).map_err(nerd_cli::error::file(&folder.join(name)))
        };
        Ok(match self {
            Self::Mjcf => one("robot.xml", changed(dice, &MJCF)?),
            Self::Urdf | Self::Robot => {
                let robots =
                    ["cartpole", "pendulum", "cube", "ant"].map(|name| (name, System::texts(name).unwrap_or_default()));
                let k = dice.random_range(0..robots.len());
                let (name, (spec, xml)) = robots[k];
                match self {
                    Self::Urdf if dice.random() => one(&format!("{name}.urdf"), edited(dice, Dictionary::urdf(), xml)),
                    Self::Urdf => one(&format!("{name}.urdf"), changed(dice, &[xml])?),
                    _ => vec![(format!("{name}.urdf"), xml.into()), (format!("{name}.toml"), toml(dice, spec))],
                }
            }
            Self::Task => one("task.toml", toml(dice, TASK)),
            Self::Settings => one("settings.toml", toml(dice, SETTINGS)),
            Self::Recipe => one("recipe.toml", toml(dice, RECIPE)),
            Self::Log => vec![("log.toml".into(), toml(dice, LOG)), ("log.npz".into(), NPZ.into())],
            Self::Npz => {
                let mut bytes = NPZ.to_vec();
                (0..dice.random_range(1..4)).for_each(|_| byte(dice, &mut bytes));
                vec![("log.toml".into(), LOG.into()), ("log.npz".into(), bytes)]
            }
            Self::Csv => one("states.csv", edited(dice, Dictionary::csv(), CSV)),
            Self::Energy => energy::draw(dice)?,
            Self::Policy | Self::Model => {
                let (folder, names): (_, &[&str]) = match self {
                    Self::Policy => (
                        shipped::models().join("policies/cartpole-swingup-neural-200"),
                        &["config.json", "policy.safetensors"],
                    ),
                    _ => (shipped::models().join("pendulum"), &["config.json", "normalizer.json", "model.safetensors"]),
                };
                let mut files = Vec::new();
                let odd = dice.random_range(0..names.len());
                for (k, name) in names.iter().enumerate() {
                    let mut bytes = read(&folder, name)?;
                    match k == odd {
                        true if name.ends_with("json") => Dictionary::model().change(dice, &mut bytes),
                        true => byte(dice, &mut bytes),
                        false => {}
                    }
                    files.push((name.to_string(), bytes));
                }
                files
            }
        })
    }

    /// Writes a case's files below `folder` and reads them; robots are also stepped. With `card`, the kind `Energy` is
    /// stepped on a GPU.
    pub fn judge(self, folder: &Path, files: &[(String, Vec<u8>)], card: bool) -> Outcome {
        // Gives each kind its own folder: files left by another kind could change what is read.
        let folder = &folder.join(self.name());
        let made = std::fs::create_dir_all(folder).err();
        if let Some(e) =
            made.or_else(|| files.iter().find_map(|(name, bytes)| std::fs::write(folder.join(name), bytes).err()))
        {
            return Outcome::Fault(e.to_string());
        }
        let path = folder.join(&files[0].0);
        let read = || -> Result<()> {
            let text = || nerd_sim::files::read_text(&path);
            match self {
                Self::Mjcf | Self::Urdf | Self::Robot => moved(System::named(&path.display().to_string())?)?,
                Self::Task => drop(FileTask::new("task.toml", &text()?, None)?),
                Self::Settings => drop(PpoConfig::from_text(&text()?)?),
                Self::Recipe => drop(Recipe::read(&path, &Given::new())?),
                Self::Log | Self::Npz => drop(Log::read(&path, None)?),
                Self::Csv => drop(States::read(&path, &*System::named("pendulum")?)?),
                Self::Policy => drop(folder::load(folder)?),
                Self::Model => {
                    let system = System::named("pendulum")?;
                    Model::load(folder, &system, None)?;
                }
                Self::Energy => {}
            }
            Ok(())
        };
        if self == Self::Energy {
            match energy::judge(files, card) {
                Ok(None) => return Outcome::Accepted,
                Ok(Some(gain)) => return Outcome::Fault(gain),
                Err(e) => return Outcome::Fault(format!("{e:#}")),
            }
        }
        match read() {
            Ok(()) => Outcome::Accepted,
            Err(e) if e.to_string().trim().is_empty() => Outcome::Fault("a refusal without words".into()),
            Err(_) => Outcome::Refused,
        }
    }
}

/// Returns `text` with random edits; new words come from the dictionary `words`.
fn edited(dice: &mut Dice, words: Dictionary, text: &str) -> Vec<u8> {
    let mut text = text.as_bytes().to_vec();
    words.change(dice, &mut text);
    text
}

/// Picks one of the XML `texts` and mutates its elements one to three times.
fn changed(dice: &mut Dice, texts: &[&str]) -> Result<Vec<u8>> {
    let trees = texts.iter().map(|text| Element::read(text)).collect::<Result<Vec<_>>>()?;
    let others = trees.iter().flat_map(Element::all).cloned().collect_vec();
    let mut own = trees[dice.random_range(0..trees.len())].clone();
    (0..dice.random_range(1..4)).for_each(|_| own.change(dice, &others));
    let mut text = String::new();
    own.write(&mut text);
    Ok(text.into())
}

/// Steps a robot two frames from its default state without torques. Panics if a state is not finite.
fn moved(system: Arc<System>) -> Result<()> {
    let scene = system.scene(system.usual_scenes()[0])?;
    let mut batch = Batch::new(&system, &scene, 1);
    batch.reset(0, &system.default_state());
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let torques = vec![0.0; system.robot.joint_count()];
    for _ in 0..2 {
        solver.step(&mut batch, &torques)?;
        if batch.state(0).iter().any(|x| !x.is_finite()) {
            panic!("a state that is not finite, and no error");
        }
    }
    Ok(())
}
