//! Recipes: files with the settings of one run or of a chain of runs. Each run starts from the weights of the run
//! before.
//!
//! ```toml
//! robot = "cube"              # settings of all runs, with the keys of `RunConfig`
//! base = "trapezoid"
//!
//! [[run]]                     # settings of each run
//! updates = 70000
//!
//! [[run]]
//! updates = 72000
//! huber = 0.02
//! ```
//!
//! A recipe of several runs keeps them in `OUT/1`, `OUT/2` and so on; the last model is the result. Shipped recipes are
//! in `nerd-train/assets/runs`.

use serde_json::Value;

use super::*;

macro_rules! shipped {
    ($($name:literal)+) => { &[$(($name, include_str!(concat!("../../assets/runs/", $name, ".toml")))),+] };
}

const SHIPPED: &[(&str, &str)] = shipped!("paper" "small" "quick" "urdf" "cartpole" "pendulum" "cube" "franka" "ant" "anymal" "chain"
    "chain-large" "cartpole-paper" "pendulum-paper" "ant-paper" "franka-paper" "anymal-paper" "cube-paper" "pendulum-family"
    "franka-family" "ant-family" "anymal-family" "cube-family" "cube-single" "elbow-family" "elbow-single"
    "ant-rapier");

/// Keys of settings that concern recording.
const RECORDS: [&str; 7] =
    ["transitions", "fresh-transitions", "torque-scale", "hold", "resets", "policy", "policy-share"];

/// Old keys of a file with their new ones; old keys are read for one version.
const RENAMED: [(&str, &str); 4] = [
    ("rate", "learning-rate"),
    ("last-rate", "final-learning-rate"),
    ("told", "condition-on-params"),
    ("fresh", "fresh-transitions"),
];

/// Runs to train one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Settings of the runs, each with its folder.
    pub runs: Vec<RunConfig>,
}

impl Recipe {
    /// Names of the shipped recipes: general ones for any robot, and one for each shipped model.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SHIPPED.iter().map(|(name, _)| *name)
    }

    /// One run with the paper's settings, overridden by `given`.
    pub fn plain(given: &Given) -> Result<Self> {
        Ok(Self { runs: vec![under(RunConfig::default(), given)?] })
    }

    /// The shipped recipe `name`, overridden by `given`.
    pub fn named(name: &str, given: &Given) -> Result<Self> {
        let Some((_, text)) = SHIPPED.iter().find(|(known, _)| *known == name) else {
            refuse!("--recipe {name}: choose from {}; of your own give the file", Self::names().join(", "));
        };
        let path = PathBuf::from(format!("nerd-train/assets/runs/{name}.toml"));
        let recipe = Self::parse(&path, text, &Given::new())?;
        let own = &recipe.runs[0].robot;
        let asked = given.get("robot").and_then(Value::as_str);
        if let Some(asked) = asked.filter(|asked| !own.is_empty() && own != asked) {
            refuse!("--recipe {name} trains `{own}`, not `{asked}`");
        }
        Self::parse(&path, text, given)
    }

    /// The recipe in a file, overridden by `given`.
    pub fn read(path: &Path, given: &Given) -> Result<Self> {
        Self::parse(path, &crate::files::read_text(path)?, given)
    }

    fn parse(path: &Path, text: &str, given: &Given) -> Result<Self> {
        let wrong = |reason: String| Error::file(path)(reason);
        let table: toml::Table = toml::from_str(text).map_err(|e| wrong(e.to_string()))?;
        let mut common = match serde_json::to_value(table) {
            Ok(Value::Object(common)) => common,
            _ => return Err(wrong("no table of settings".into())),
        };
        rename(&mut common, path);
        let runs = common.remove("run");
        let first = RunConfig::default().with(&common).map_err(wrong)?;
        let Some(runs) = runs else {
            return Ok(Self { runs: vec![under(first, given)?] });
        };
        let mut own: Vec<Given> =
            serde_json::from_value(runs).map_err(|e| wrong(format!("`run`: {e}; `[[run]]` is needed")))?;
        if own.is_empty() {
            return Err(wrong("`run` is empty".into()));
        }
        own.iter_mut().for_each(|own| rename(own, path));
        let mut runs: Vec<RunConfig> = Vec::new();
        for (k, own) in own.iter().enumerate() {
            // The recipe sets each run's folder. A later run starts from the previous run's model, with that model's
            // normaliser.
            let theirs = if k == 0 { &["out"][..] } else { &["out", "from", "epsilon"] };
            if let Some(key) = theirs.iter().find(|key| own.contains_key(**key)) {
                return Err(wrong(format!("run {}: `{key}` does not belong in its [[run]]: leave it out", k + 1)));
            }
            let own = first.with(own).map_err(|e| wrong(format!("run {}: {e}", k + 1)))?;
            let next = link(own, given)?;
            // An empty folder name stays empty, so that the check of the settings refuses it.
            let out =
                if next.out.as_os_str().is_empty() { next.out.clone() } else { next.out.join(format!("{}", k + 1)) };
            runs.push(match runs.last() {
                None => RunConfig { out, ..next },
                // A run from a model uses the model's normaliser.
                Some(before) => RunConfig { from: Some(before.out.join("model")), epsilon: None, out, ..next },
            });
        }
        Ok(Self { runs })
    }

    /// Trains all runs that are not done. Returns the folder of the last model; `None` if time ran out.
    pub fn train(&self) -> Result<Option<PathBuf>> {
        if let [one] = &self.runs[..] {
            return Run::new(one)?.train();
        }
        self.runs.iter().try_for_each(|run| run.check().map(drop))?;
        let mut last = None;
        let cache = Arc::default();
        for run in &self.runs {
            if let Some(done) = run.made()? {
                last = Some(done);
                continue;
            }
            let mut next = Run::new(run)?;
            next.cache.clone_from(&cache);
            last = next.train()?;
            if last.is_none() || run.finish {
                break;
            }
        }
        Ok(last)
    }
}

impl RunConfig {
    /// A shipped recipe of one run, for any robot: `paper`, `small`, `quick` or `urdf`.
    pub fn recipe(name: &str, robot: &str, out: impl Into<PathBuf>) -> Result<Self> {
        let given =
            Self::new(robot, out).given().into_iter().filter(|(key, _)| key == "robot" || key == "out").collect();
        match &Recipe::named(name, &given)?.runs[..] {
            [one] => Ok(one.clone()),
            runs => refuse!("recipe {name} has {} runs, one is needed", runs.len()),
        }
    }

    /// The folder of the run's model, if it exists and loads.
    pub fn made(&self) -> Result<Option<PathBuf>> {
        let done = self.out.join("model");
        let system = self.system()?;
        let truth = self.log().map_or_else(|| self.record.truth(&system).name(), |log| Measured::name(&log));
        match Model::load(&done, &system, Some(&truth)) {
            Ok(_) => return Ok(Some(done)),
            Err(e) if done.exists() => tell!("{e}; it is made again"),
            Err(_) => {}
        }
        Ok(None)
    }
}

/// Gives old keys of a file their new names, and prints a note. If a file has both names, the old one stays and is
/// refused later.
fn rename(given: &mut Given, path: &Path) {
    for (old, new) in RENAMED {
        if !given.contains_key(new)
            && let Some(value) = given.remove(old)
        {
            tell!("note: {}: `{old}` is `{new}`; old names are read for one version", path.display());
            given.insert(new.into(), value);
        }
    }
}

/// A file's run, overridden by `given`. If `given` names a model to start from, the model's epsilon replaces the
/// file's.
fn under(own: RunConfig, given: &Given) -> Result<RunConfig> {
    let mut run = own.with(given)?;
    if given.contains_key("from") && !given.contains_key("epsilon") {
        run.epsilon = None;
    }
    // With a log, a recipe's settings of recording have no effect; only those in `given` are refused.
    if let Some(key) = RECORDS.iter().find(|key| given.contains_key(**key) && run.log().is_some()) {
        refuse!("--{key}: nothing is recorded where --data names a log; leave it out");
    }
    Ok(run)
}

/// One of several runs of a recipe, overridden by `given`. The runs differ in length, so `updates` and `transitions` in
/// `given` are upper bounds for each run. With small bounds, a recipe is rehearsed.
fn link(own: RunConfig, given: &Given) -> Result<RunConfig> {
    let most = (own.updates, own.transitions);
    let mut run = under(own, given)?;
    run.updates = run.updates.min(most.0);
    run.transitions = run.transitions.min(most.1);
    if given.contains_key("updates") && !given.contains_key("validate-every") {
        run.validate_every = None;
    }
    if given.contains_key("transitions") {
        run.fresh_transitions = run.fresh_transitions.min(run.transitions);
    }
    Ok(run)
}
