//! Learned models as folders, each with the calibrated robot that it moves.

use std::path::Path;

use nerd_model::folder::Model;
use nerd_model::transformer::Storage;
use nerd_sim::calibrate::Saved;
use nerd_sim::log::{Log, specified};

use super::{Calibrated, Calibration, Learned};
use crate::error::{Error, Result};

impl Calibration {
    /// Writes the models of the first split into a folder, one each by its way of learning.
    pub(super) fn keep(&self, folder: &Path, log: &Log, fitted: &Calibrated, learned: &[Learned], models: &[Model]) -> Result<()> {
        let (spec, system) = specified(&self.log)?;
        let beside = self.log.with_file_name(&spec.robot);
        let robot = match beside.exists() {
            true => std::fs::canonicalize(&beside).map_err(Error::file(&beside))?.display().to_string(),
            false => spec.robot,
        };
        let (subject, parameters) = self.subject(log, "articulated")?;
        let values = fitted.splits.first().map(|split| split.fit.values.clone()).unwrap_or_default();
        let named = parameters.iter().map(|p| p.name.clone()).zip(values).collect();
        let saved = Saved { robot, scene: log.scene.clone(), engine: subject.engine, parameters: named };
        let calibrated = saved.subject()?;
        for (row, model) in learned.iter().zip(models) {
            let (own, mut model) = (folder.join(&row.way), model.clone());
            model.stamp(&calibrated.system);
            let off = row.after.first().map(super::Scored::words).unwrap_or_default();
            let card = format!(
                "# {}, {}\n\nLearned from measured trajectories by `cargo xtask calibrate`. It moves the robot of `calibrated.toml`. Rollouts \
                 of {} frames on trajectories that it has not seen are {off} off.\n",
                system.name, row.way, self.frames
            );
            std::fs::create_dir_all(&own).map_err(Error::file(&own))?;
            let path = own.join("calibrated.toml");
            nerd_sim::files::write(&path, saved.text()?.as_bytes()).map_err(Error::file(&path))?;
            model.save(&own, &card, Storage::F32)?;
        }
        Ok(())
    }
}
