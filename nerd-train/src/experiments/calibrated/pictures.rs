//! Errors by frame, and measured motions with their predictions.

use std::path::Path;

use nerd_sim::log::specified;
use nerd_sim::prelude::*;

use super::CalibratedAll;
use super::rest::Shown;
use crate::error::Result;
use crate::report::frames::{Curve, draw};
use crate::report::replay::Replay;
use crate::report::write;

impl CalibratedAll {
    /// Draws errors by frame into `STEM-frames`, and writes a page for each trajectory that is shown.
    pub(super) fn draw(&self, stem: &Path) -> Result<()> {
        let beside = |what: &str| stem.with_file_name(format!("{}-{what}", stem.file_name().unwrap_or_default().to_string_lossy()));
        let (_, system) = specified(&self.settings.log)?;
        let curve = |c: &'_ super::rest::Course| (c.name.clone(), c.by_frame.clone());
        let all: Vec<(String, Vec<[f64; 2]>)> = self.rest.courses.iter().map(curve).collect();
        if !all.is_empty() && system.robot.floating() {
            let curves: Vec<Curve> = all.iter().map(|(name, by_frame)| Curve { name, by_frame, dashed: false }).collect();
            draw(&format!("Measured {}", self.robot), &format!("{:.4} s", system.frame_time), &curves, &beside("frames"))?;
        }
        for (shown, replay) in self.rest.shown.iter().zip(self.replays()?) {
            write(&beside(&shown.what).with_extension("html"), replay.html().as_bytes())?;
        }
        Ok(())
    }

    /// Trajectories that are shown: measured, and as the first calibrated solver and the first model predict them.
    ///
    /// # Errors
    /// If the log's robot cannot be read.
    pub fn replays(&self) -> Result<Vec<Replay>> {
        let (spec, system) = specified(&self.settings.log)?;
        let mut batch = Batch::new(&system, &system.scene(&spec.scene)?, 1);
        let mut one = |shown: &Shown| {
            let title = format!("{} {}, predicted from its start: {}", self.robot, shown.id, shown.what);
            let mut replay = Replay::new(&title, &batch, system.frame_time);
            for (name, motion) in &shown.tracks {
                replay.begin(name);
                for q in motion {
                    batch.reset(0, &[&q[..], &vec![0.0; system.robot.nv()]].concat());
                    replay.add(&batch);
                }
            }
            replay
        };
        Ok(self.rest.shown.iter().map(&mut one).collect())
    }
}
