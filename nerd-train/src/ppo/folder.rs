//! Policy folders: `config.json`, `policy.safetensors` and a card, `README.md`. For a task from a file, the folder also
//! keeps the task's text as `task.toml`. Later changes of the original file do not affect the policy.
//!
//! Layer K has a matrix `layerK.weight` of shape `[in, out]` and a bias `layerK.bias`. The last layer outputs the mean
//! action, the value and, if it depends on the state, the log standard deviation. Otherwise the log standard deviation
//! is the parameter `log_std`. `observation.mean` and `observation.variance` normalise the network's inputs.
//! `return.mean` and `return.variance` convert the network's normalised value to units of reward.

use nerd_model::transformer::TensorSpec;
use nerd_sim::files::renamed::{self, Kind};

use super::*;
use crate::files::{read_text, write};

/// Provenance keys of three hashes: the robot's ([`System::sha256`]), the task text's (SHA-256) and the weights'
/// ([`Policy::sha256`]).
pub(super) const ROBOT: &str = "robot";
pub(super) const TEXT: &str = "task sha256";
const WEIGHTS: &str = "weights sha256";
pub(super) const TASK: &str = "task.toml";

/// Contents of `config.json`: task, solver, settings and provenance of a policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// Name of the task; for a task from a file, its path.
    pub task: String,
    /// Solver that the policy was trained in.
    pub solver: String,
    /// Shape of the network.
    pub shape: Shape,
    /// Training settings.
    pub ppo: PpoConfig,
    /// Iterations done.
    pub iterations: u64,
    /// Mean return of the policy's training episodes, with action noise.
    pub reward: Option<f64>,
    /// Provenance by key: commit, command, seed, machine, training time (min) and hashes.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

/// Writes the folder, each file atomically, and adds the hash of the weights to the provenance.
pub fn save(folder: &Path, config: &PolicyConfig, policy: &Policy, card: &str) -> Result<()> {
    let mut file = Tensors::default();
    put(&mut file, "", policy);
    let mut config = config.clone();
    config.provenance.insert(WEIGHTS.into(), policy.sha256());
    let path = folder.join("config.json");
    let json = serde_json::to_string_pretty(&config).map_err(Error::file(&path))?;
    write(&folder.join("README.md"), card)?;
    file.put_word("task", &config.task);
    file.save(&folder.join("policy.safetensors"))?;
    // Write `config.json` last: a folder that has it is complete.
    write(&path, json + "\n")
}

/// Reads a policy's folder and finds its task by name, or by the text kept in the folder. Refuses a robot or a task
/// text that changed since training. For a task that comes with the project, prints a note instead.
pub fn load(folder: &Path) -> Result<(PolicyConfig, Policy)> {
    let (path, mut config) = config(folder)?;
    let kept = folder.join(TASK);
    let learned = config.task.clone();
    let (mut task, robot) = nerd_tasks::parts(&learned);
    let mut robot = robot.map(String::from);
    if kept.exists() {
        // `task.toml` holds the task's text at training time.
        task = kept.to_str().unwrap_or(task);
    }
    // The robot's path is relative to the training's working directory, which may be an ancestor of this folder.
    if let Some(file) = robot.as_mut().filter(|file| file.contains('.') && !Path::new(file).exists()) {
        let above = std::path::absolute(folder).map_err(Error::file(folder))?;
        match above.ancestors().map(|at| at.join(&*file)).find(|path| path.exists()) {
            Some(found) => *file = found.display().to_string(),
            None => refuse!(
                "{}: its robot {file} is neither here nor above; go to where it is, or name it in `task` of config.json",
                folder.display()
            ),
        }
    }
    config.task = task.to_string() + &robot.map_or_else(String::new, |robot| format!("@{robot}"));
    let task = named(&config.task).map_err(Error::file(&path))?;
    let differs = |key: &str, now: String| config.provenance.get(key).is_some_and(|then| *then != now);
    let robot = differs(ROBOT, task.system()?.sha256());
    let whose = own(&*task).is_some();
    let changed = match (robot, differs(TEXT, text_hash(&*task)), whose) {
        (true, _, true) => format!(
            "the file of robot `{}`, or what the task says of robots (frame_time, substeps, rotors, [terrain]), changed since the policy learned; train again",
            task.robot()
        ),
        (_, true, true) => {
            format!("{TASK} is not the text that the policy learned with; take the folder as it was, or train again")
        }
        (false, false, _) => return read(folder, config, &*task, &learned),
        // Tasks and robots that come with the project may change between versions: print a note and continue.
        (robot, ..) => {
            let what = if robot { format!("robot `{}`", task.robot()) } else { format!("task `{}`", task.name()) };
            let found = read(folder, config, &*task, &learned)?;
            tell!("note: {}: {what} of this project is another than when the policy learned", folder.display());
            return Ok(found);
        }
    };
    Err(Error::file(&path)(changed))
}

/// Name of the policy's task at training time; for a task from a file, its [`nerd_tasks::word`].
pub fn called(folder: &Path) -> Result<String> {
    let task = config(folder)?.1.task;
    Ok(if nerd_tasks::names().contains(&task.as_str()) { task } else { nerd_tasks::word(&task) })
}

/// Text of a task from a file; `None` for a task that comes with the project.
pub(super) fn own(task: &dyn Task) -> Option<&str> {
    task.text().filter(|_| !nerd_tasks::names().contains(&task.name()))
}

/// Identity of a task by content: the name of a built-in task. A task from a file is identified by the hash of its
/// text, so its path does not matter.
pub fn identity(task: &dyn Task) -> String {
    if own(task).is_none() {
        return task.name().into();
    }
    format!("task {} of {}", &text_hash(task)[..16], nerd_tasks::word(task.robot()))
}

/// SHA-256 of a task's text, or of its name if it has no text.
pub(super) fn text_hash(task: &dyn Task) -> String {
    hex(Sha256::digest(task.text().unwrap_or(task.name())))
}

/// Reads the folder of a policy of the given task, built-in or not.
pub fn load_for(folder: &Path, task: &dyn Task) -> Result<(PolicyConfig, Policy)> {
    let (path, config) = config(folder)?;
    let same = match own(task) {
        Some(text) => read_text(&folder.join(TASK)).is_ok_and(|kept| kept == text),
        None => config.task == task.name(),
    };
    if !same {
        return Err(Error::file(&path)(format!("a policy of task `{}`, not of `{}`", config.task, task.name())));
    }
    let learned = config.task.clone();
    read(folder, config, task, &learned)
}

fn config(folder: &Path) -> Result<(PathBuf, PolicyConfig)> {
    let path = folder.join("config.json");
    if !path.exists() && folder.join("policy").exists() {
        refuse!("{0}: a run, whose policy is {0}/policy", folder.display());
    }
    if folder.join("model.safetensors").exists() {
        refuse!("{}: a model, not a policy", folder.display());
    }
    let text = read_text(&path)?;
    let mut all: serde_json::Value = serde_json::from_str(&text).map_err(Error::file(&path))?;
    let before = all.clone();
    if let Some(ppo) = all.get_mut("ppo").and_then(serde_json::Value::as_object_mut) {
        ppo.retain(|key, _| !config::FORMER.contains(&key.as_str()));
    }
    let mut old = Vec::new();
    for (table, kind) in [("ppo", Kind::Ppo), ("shape", Kind::Shape)] {
        let own = all.get_mut(table).map(|table| renamed::json(kind, table));
        old.extend(own.transpose().map_err(|e| Error::file(&path)(format!("{table}: {e}")))?.unwrap_or_default());
    }
    // Parse the original text if no key was renamed or dropped: its errors name a line and a column.
    let config = if all == before { serde_json::from_str(&text) } else { serde_json::from_value(all) };
    renamed::note(&path.display().to_string(), old);
    Ok((path.clone(), config.map_err(Error::file(&path))?))
}

/// Checks and reads weights and moments; `learned` is the task's name at training time.
fn read(folder: &Path, config: PolicyConfig, task: &dyn Task, learned: &str) -> Result<(PolicyConfig, Policy)> {
    check(&config, task).map_err(Error::file(&folder.join("config.json")))?;
    let file = Tensors::open(&folder.join("policy.safetensors"))?;
    // The folder of the task's file may have changed since training, but not the file's name.
    let of = file.word("task")?;
    let name = |task: &str| nerd_tasks::word(nerd_tasks::parts(task).0);
    if name(of) != name(learned) {
        return Err(file
            .wrong(format!("it is of task `{of}`, and config.json of `{learned}`; take the folder as it was, whole")));
    }
    let policy = get(&file, "", config.shape.clone())?;
    match config.provenance.get(WEIGHTS) {
        Some(sha256) if *sha256 != policy.sha256() => {
            return Err(file
                .wrong("its weights are not those that config.json has the hash of (SHA-256 differs); take the folder as it was, whole"));
        }
        None if !folder.starts_with(crate::shipped::models()) => {
            tell!(
                "note: {}: an older policy, without the hash of its weights: whether they are its own is not known",
                folder.display()
            );
        }
        _ => {}
    }
    Ok((config, policy))
}

/// Stores weights and moments of a policy under tensor names that begin with `prefix`.
pub(super) fn put(file: &mut Tensors, prefix: &str, policy: &Policy) {
    file.put_network(&tensors(prefix, &policy.shape), &policy.flat);
    for (name, moments) in [("observation", &policy.seen), ("return", &policy.returns)] {
        file.put_f64(format!("{prefix}{name}.mean"), moments.mean.iter().copied());
        file.put_f64(format!("{prefix}{name}.variance"), moments.variance.iter().copied());
        file.put_f64(format!("{prefix}{name}.count"), [moments.count]);
    }
}

pub(super) fn get(file: &Tensors, prefix: &str, shape: Shape) -> Result<Policy> {
    let flat = file.network(&tensors(prefix, &shape))?;
    let moments = |name: &str, columns: usize| -> Result<RunningMoments> {
        let column = |what: &str, n: usize| file.f64(&format!("{prefix}{name}.{what}"), Some(n));
        Ok(RunningMoments {
            mean: column("mean", columns)?,
            variance: column("variance", columns)?,
            count: column("count", 1)?[0],
        })
    };
    let seen = moments("observation", shape.inputs())?;
    let returns = moments("return", 1)?;
    let sound = |m: &RunningMoments| {
        m.mean.iter().all(|x| x.is_finite()) && m.variance.iter().chain([&m.count]).all(|x| x.is_finite() && *x >= 0.0)
    };
    if !flat.iter().all(|w| w.is_finite()) || !sound(&seen) || !sound(&returns) {
        return Err(file.wrong("a weight or a moment is not a finite number, or a variance is below 0"));
    }
    Ok(Policy { shape, flat, seen, returns })
}

fn tensors(prefix: &str, shape: &Shape) -> Vec<TensorSpec> {
    shape
        .program()
        .tensors
        .into_iter()
        .map(|tensor| TensorSpec { name: format!("{prefix}{}", tensor.name), ..tensor })
        .collect()
}

/// Checks the settings, and compares the sizes of observation and action with the task's.
fn check(config: &PolicyConfig, task: &dyn Task) -> Result<(), String> {
    let Shape { observation, action, .. } = config.shape;
    config.shape.check().map_err(|e| format!("shape: {e}"))?;
    config.ppo.check().map_err(|e| format!("ppo: {e}"))?;
    let wanted = (task.observation_dim(), task.action_dim());
    if (observation, action) != wanted {
        return Err(format!(
            "maps {observation} to {action} numbers; task `{}` needs {} to {}",
            config.task, wanted.0, wanted.1
        ));
    }
    Ok(())
}
