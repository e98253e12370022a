//! A policy is a folder: `config.json`, `policy.safetensors` and a card, `README.md`; of a task from a file that file's text, too, by which
//! the policy is played from then on, whatever becomes of the file.
//!
//! Weights are named `layerK.weight` `[in, out]` and `layerK.bias`; the last layer's outputs are mean action, value and, unless it is a
//! parameter (`log_std`), the logarithm of the spread. `observation.mean` and `observation.variance` normalise inputs, `return.mean` and
//! `return.variance` the value.

use nerd_model::transformer::TensorSpec;

use super::*;

/// In its provenance: [`System::sha256`] of its robot, SHA-256 of its task's text, and [`Policy::sha256`].
pub(super) const ROBOT: &str = "robot";
pub(super) const TEXT: &str = "task sha256";
const WEIGHTS: &str = "weights sha256";
pub(super) const TASK: &str = "task.toml";

/// What was learned, where, how; `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// Task.
    pub task: String,
    /// What the policy was trained in.
    pub solver: String,
    /// Shape of the network.
    pub shape: Shape,
    /// How it was trained.
    pub ppo: PpoConfig,
    /// Iterations done.
    pub iterations: u64,
    /// Mean return of its own noisy episodes.
    pub reward: Option<f64>,
    /// Commit, command, seed, machine, minutes.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

/// Writes the folder, each file whole or not at all, with the hash of the weights in its provenance.
pub fn save(folder: &Path, config: &PolicyConfig, policy: &Policy, card: &str) -> Result<()> {
    let mut file = Tensors::default();
    put(&mut file, "", policy);
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        nerd_sim::files::write(&path, text.as_bytes()).map_err(Error::file(&path))
    };
    let mut config = config.clone();
    config.provenance.insert(WEIGHTS.into(), policy.sha256());
    let json = serde_json::to_string_pretty(&config).map_err(Error::file(&folder.join("config.json")))?;
    write("README.md", card.into())?;
    file.put_word("task", &config.task);
    file.save(&folder.join("policy.safetensors"))?;
    // Last: a folder that has it is whole.
    write("config.json", json + "\n")
}

/// Reads the folder of a policy of a built-in task.
pub fn load(folder: &Path) -> Result<(PolicyConfig, Policy)> {
    let (path, mut config) = config(folder)?;
    let (kept, learned) = (folder.join(TASK), config.task.clone());
    let (mut task, robot) = nerd_tasks::parts(&learned);
    let mut robot = robot.map(String::from);
    if kept.exists() {
        // As it was when the policy learned.
        task = kept.to_str().unwrap_or(task);
    }
    // From another folder than that of its training: what the robot's path is from one above the policy's.
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
        (_, true, true) => format!("{TASK} is not the text that the policy learned with; take the folder as it was, or train again"),
        (false, false, _) => return read(folder, config, &*task, &learned),
        // What comes with the project is made better now and then.
        (robot, ..) => {
            let what = if robot { format!("robot `{}`", task.robot()) } else { format!("task `{}`", task.name()) };
            let found = read(folder, config, &*task, &learned)?;
            tell!("note: {}: {what} of this project is another than when the policy learned", folder.display());
            return Ok(found);
        }
    };
    Err(Error::file(&path)(changed))
}

/// What the task of a policy's folder was called when it learned: its name, or of one from a file as [`nerd_tasks::word`] has it.
pub fn called(folder: &Path) -> Result<String> {
    let task = config(folder)?.1.task;
    Ok(if nerd_tasks::names().contains(&task.as_str()) { task } else { nerd_tasks::word(&task) })
}

/// The text of a task that does not come with the project.
pub(super) fn own(task: &dyn Task) -> Option<&str> {
    task.text().filter(|_| !nerd_tasks::names().contains(&task.name()))
}

/// A task by content: its name, and of one from a file the text in place of where it is.
pub fn identity(task: &dyn Task) -> String {
    if own(task).is_none() {
        return task.name().into();
    }
    format!("task {} of {}", &text_hash(task)[..16], nerd_tasks::word(task.robot()))
}

/// SHA-256 of a task's text, or of its name where it has none.
pub(super) fn text_hash(task: &dyn Task) -> String {
    Sha256::digest(task.text().unwrap_or(task.name())).iter().map(|b| format!("{b:02x}")).collect()
}

/// Reads the folder of a policy of this task, built-in or not.
pub fn load_for(folder: &Path, task: &dyn Task) -> Result<(PolicyConfig, Policy)> {
    let (path, config) = config(folder)?;
    let same = match own(task) {
        Some(text) => nerd_sim::files::read_text(&folder.join(TASK)).is_ok_and(|kept| kept == text),
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
    let text = nerd_sim::files::read_text(&path).map_err(Error::file(&path))?;
    let config = serde_json::from_str(&text).map_err(Error::file(&path))?;
    Ok((path, config))
}

/// `learned` is what the task was called when it did.
fn read(folder: &Path, config: PolicyConfig, task: &dyn Task, learned: &str) -> Result<(PolicyConfig, Policy)> {
    check(&config, task).map_err(Error::file(&folder.join("config.json")))?;
    let file = Tensors::open(&folder.join("policy.safetensors"))?;
    // Where the task's file is may have changed since, its name did not.
    let of = file.word("task")?;
    let name = |task: &str| nerd_tasks::word(nerd_tasks::parts(task).0);
    if name(of) != name(learned) {
        return Err(file.wrong(format!("it is of task `{of}`, and config.json of `{learned}`; take the folder as it was, whole")));
    }
    let policy = get(&file, "", config.shape.clone())?;
    match config.provenance.get(WEIGHTS) {
        Some(sha256) if *sha256 != policy.sha256() => {
            return Err(file
                .wrong("its weights are not those that config.json has the hash of (SHA-256 differs); take the folder as it was, whole"));
        }
        None if !folder.starts_with(crate::shipped::models()) => {
            tell!("note: {}: an older policy, without the hash of its weights: whether they are its own is not known", folder.display());
        }
        _ => {}
    }
    Ok((config, policy))
}

/// A policy's network and moments, under names that begin so.
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
        Ok(RunningMoments { mean: column("mean", columns)?, variance: column("variance", columns)?, count: column("count", 1)?[0] })
    };
    let (seen, returns) = (moments("observation", shape.inputs())?, moments("return", 1)?);
    let sound = |m: &RunningMoments| {
        m.mean.iter().all(|x| x.is_finite()) && m.variance.iter().chain([&m.count]).all(|x| x.is_finite() && *x >= 0.0)
    };
    if !flat.iter().all(|w| w.is_finite()) || !sound(&seen) || !sound(&returns) {
        return Err(file.wrong("a weight or a moment is not a finite number, or a variance is below 0"));
    }
    Ok(Policy { shape, flat, seen, returns })
}

fn tensors(prefix: &str, shape: &Shape) -> Vec<TensorSpec> {
    shape.program().tensors.into_iter().map(|tensor| TensorSpec { name: format!("{prefix}{}", tensor.name), ..tensor }).collect()
}

/// Says what of a policy does not fit its task.
fn check(config: &PolicyConfig, task: &dyn Task) -> Result<(), String> {
    let Shape { observation, action, .. } = config.shape;
    config.shape.check().map_err(|e| format!("shape: {e}"))?;
    config.ppo.check().map_err(|e| format!("ppo: {e}"))?;
    let wanted = (task.observation_dim(), task.action_dim());
    if (observation, action) != wanted {
        return Err(format!("maps {observation} to {action} numbers; task `{}` needs {} to {}", config.task, wanted.0, wanted.1));
    }
    Ok(())
}
