//! Measurements of solvers, models and policies. An experiment is a struct of settings; [`conduct`] measures it and
//! writes `NAME/result.json`, `NAME/README.md` and its figures.

pub mod calibrated;
#[cfg(feature = "cuda")]
pub mod card;
pub mod carried;
pub mod games;
pub mod passive;
pub mod policies;

use serde_json::{Map, Value};

use crate::report::artifact::{Artifact, may_write};
use crate::{prelude::*, report::Provenance};

/// Name, inputs and effort of a result.
pub struct About {
    /// Folder name in `results`.
    pub name: String,
    pub seed: u64,
    /// Size of the measurement, such as rollouts times frames or episodes; a smaller one never replaces a larger one.
    pub effort: f64,
    pub inputs: Inputs,
}

pub trait Experiment {
    fn about(&self) -> Result<About>;

    /// Runs the measurement; progress goes to standard error.
    fn measure(&self) -> Result<Measured>;
}

#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Fields of the result's file, by name.
    pub data: Map<String, Value>,
    pub tables: Vec<Table>,
    pub figures: Vec<(String, Figure)>,
}

impl Measured {
    pub fn new(data: &impl Serialize, tables: Vec<Table>) -> Result<Self> {
        match serde_json::to_value(data)? {
            Value::Object(data) => Ok(Self { data, tables, figures: Vec::new() }),
            other => bail!("a result is an object, not {other}"),
        }
    }

    #[must_use]
    pub fn with(mut self, name: &str, figure: impl Into<Option<Figure>>) -> Self {
        self.figures.extend(figure.into().map(|figure| (name.into(), figure)));
        self
    }
}

/// A solver's errors, microseconds of a frame of one environment, and GPU memory (MiB).
pub struct Timed {
    pub report: PassiveReport,
    pub microseconds: f64,
    pub memory: Option<f64>,
}

/// Refuses a GPU if the program was built without the feature `cuda`.
pub fn built_for(card: bool) -> Result<()> {
    if card && !cfg!(feature = "cuda") {
        bail!("--device cuda needs a build with `--features cuda`");
    }
    Ok(())
}

/// Measures an experiment and writes its result into its own folder in `out`. A result with more effort is never
/// overwritten ([`may_write`]); this is checked before measuring.
pub fn conduct(experiment: &dyn Experiment, out: &Path) -> Result<Artifact> {
    let About { name, seed, effort, inputs } = experiment.about()?;
    let provenance = Provenance::now(seed);
    may_write(out, &name, &provenance, effort)?;
    let Measured { data, tables, figures } = experiment.measure()?;
    let artifact = Artifact { provenance, inputs, effort, tables, data };
    artifact.write(out, &name)?;
    for (file, figure) in figures {
        figure.save(&out.join(&name).join(file + ".svg"))?;
    }
    tell!("written to {}", out.join(name).display());
    Ok(artifact)
}
