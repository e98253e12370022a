//! What is measured of solvers, models and policies. Each experiment is its settings; [`Experiment`] says what it measures and
//! how that is shown, [`conduct`] does it and writes the result.
//!
//! ```text
//! settings ── inputs ──▶ what it depends on ─┐
//!          └─ measure ─▶ data ── tables ─────┼──▶ NAME.json, NAME.md
//!                             └─ pictures ───┴──▶ NAME.svg, NAME.png
//! ```

pub mod ablations;
pub mod calibrated;
#[cfg(feature = "cuda")]
pub mod cards;
pub mod changes;
pub mod chart;
pub mod cost;
#[cfg(feature = "cuda")]
pub mod device;
pub mod games;
pub mod grow;
pub mod horizons;
pub mod judges;
pub mod learned;
pub mod motions;
pub mod passive;
pub mod policies;
pub mod stability;
pub mod substeps;

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::Result;
use crate::report::artifact::{Artifact, may_write};
use crate::report::{Inputs, Provenance, Table};

/// Something to measure.
pub trait Experiment {
    /// What is measured, as it stands in the result's file.
    type Data: Serialize + DeserializeOwned;

    /// Name of its result: `results/NAME.json`.
    fn name(&self) -> String;

    /// Its seed.
    fn seed(&self) -> u64;

    /// What a better measurement has more of: rollouts times frames, games, updates.
    fn effort(&self) -> f64;

    /// What it depends on, as that is now.
    ///
    /// # Errors
    /// If one of them cannot be read.
    fn inputs(&self) -> Result<Inputs>;

    /// Measures; progress goes to standard error.
    ///
    /// # Errors
    /// If it cannot be measured to the end.
    fn measure(&self) -> Result<Self::Data>;

    /// What was measured, as people read it.
    ///
    /// # Errors
    /// If a name in it is unknown.
    fn tables(&self, data: &Self::Data) -> Result<Vec<Table>>;

    /// Draws into `STEM.svg` and `STEM.png`, if there is something to see.
    ///
    /// # Errors
    /// If it cannot be drawn or written.
    fn pictures(&self, data: &Self::Data, stem: &Path) -> Result<()> {
        let _ = (data, stem);
        Ok(())
    }
}

/// Measures an experiment and writes `NAME.json`, `NAME.md` and its pictures into a folder. A result with more behind it is
/// never overwritten ([`may_write`]), which is said before anything is measured.
///
/// # Errors
/// Those of the experiment, and of the files.
pub fn conduct<E: Experiment>(experiment: &E, out: &Path) -> Result<Artifact<E::Data>> {
    let (name, provenance) = (experiment.name(), Provenance::now(experiment.seed()));
    may_write(out, &name, &provenance, experiment.effort())?;
    let inputs = experiment.inputs()?;
    let data = experiment.measure()?;
    let artifact = Artifact { provenance, inputs, effort: experiment.effort(), tables: experiment.tables(&data)?, data };
    artifact.write(out, &name)?;
    experiment.pictures(&artifact.data, &out.join(&name))?;
    Ok(artifact)
}
