//! A calibrated robot as a file: where it is described, in which scene and solver, and what was found of it.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{CalibrateError, Engine, Parameter, Subject};
use crate::system::System;

/// What a TOML of a calibrated robot says; [`Self::subject`] makes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Saved {
    /// A built-in robot's name, or its file: beside this one, or from where the program stands.
    pub robot: String,
    /// Scene of its measurements.
    pub scene: String,
    /// Solver it was calibrated in.
    pub engine: Engine,
    /// Names of the parameters and their values.
    pub parameters: Vec<(String, f64)>,
}

impl Saved {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, or says something else.
    pub fn read(path: &Path) -> Result<Self, CalibrateError> {
        let bad = |reason: String| CalibrateError::File(path.into(), reason.trim().replace('\n', " "));
        let text = crate::files::read_text(path).map_err(|e| bad(e.to_string()))?;
        let mut saved: Self = toml::from_str(&text).map_err(|e| bad(e.to_string()))?;
        let beside: PathBuf = path.with_file_name(&saved.robot);
        if beside.exists() {
            saved.robot = beside.display().to_string();
        }
        Ok(saved)
    }

    /// As a file has it.
    ///
    /// # Errors
    /// If a value is no number.
    pub fn text(&self) -> Result<String, CalibrateError> {
        let what = "# A calibrated robot; nerd_sim::calibrate::Saved reads it.\n";
        let text = toml::to_string(self).map_err(|e| CalibrateError::File("a calibrated robot".into(), e.to_string()))?;
        Ok(what.to_string() + &text)
    }

    /// The robot with its parameters set, in its scene and solver.
    ///
    /// # Errors
    /// If there is no such robot, scene or parameter.
    pub fn subject(&self) -> Result<Subject, CalibrateError> {
        let system = System::named(&self.robot)?;
        let named = |(name, _): &(String, f64)| Parameter::named(&system, name);
        let parameters = self.parameters.iter().map(named).collect::<Result<Vec<_>, _>>()?;
        let values: Vec<f64> = self.parameters.iter().map(|p| p.1).collect();
        Subject::new(&system, &self.scene, self.engine)?.with(&parameters, &values)
    }
}
