//! What a learner will see of a data set on the disk.
//!
//! Every number of a token and of a target is drawn as a histogram; those of contact points only where the mask lets them
//! through. Beside that: how often anything is seen and touched, how often an angle wraps, which trajectories no learner
//! should see, and range, mean and spread of every column. The tokens are those that training makes, not normalised.

mod columns;
mod picture;
mod words;

use std::path::Path;
use std::sync::Arc;

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_sim::dataset::{DatasetError, Manifest, Recording};
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

pub use columns::{Block, Column};

use crate::error::{Result, refuse};
use nerd_train::bounds::figures;
use nerd_train::prepare::tokens;
use nerd_train::progress::bar;

/// What a data set holds.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Inspection {
    /// Robot.
    pub robot: String,
    /// [`nerd_sim::dataset::sha256_of`] the shards.
    pub sha256: String,
    /// Largest number that a state may hold.
    pub bound: f64,
    /// What is counted beside the columns.
    pub counts: Counts,
    /// Those of a token, then those of a target.
    pub columns: Vec<Column>,
}

/// What is counted beside the columns.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Counts {
    /// Trajectories.
    pub trajectories: u64,
    /// Trajectories left out since a number of theirs is none.
    pub not_finite: u64,
    /// Trajectories left out since they go beyond the bound.
    pub beyond: u64,
    /// Transitions of the others, which is tokens.
    pub tokens: u64,
    /// Tokens with a point that the mask lets through.
    pub tokens_seeing: u64,
    /// Tokens with a point that touches.
    pub tokens_touching: u64,
    /// Points, over all tokens, that the mask lets through.
    pub points_seen: u64,
    /// Points, over all tokens, that touch.
    pub points_touching: u64,
    /// Transitions in which each endless joint's angle wraps.
    pub wraps: Vec<(String, u64)>,
}

impl Inspection {
    /// Looks through the data of `system` in a folder, twice; trajectories that are not finite or go beyond `bound` are left out
    /// and counted.
    ///
    /// # Errors
    /// If the data are not those of the manifest and of `system`, or nothing is left of them.
    pub fn of(folder: &Path, manifest: &Manifest, system: &Arc<System>, bound: f64) -> Result<Self> {
        manifest.check(system, &manifest.truth).map_err(|reason| DatasetError::Format { path: folder.into(), reason })?;
        let (mut columns, mut counts) = (columns::columns(system), Counts::default());
        let (mut hashes, mut held) = (Vec::new(), (0, manifest.frames));
        let bar = bar("shards, twice", 2 * manifest.shards.len() as u64);
        for (k, name) in manifest.shards.iter().enumerate() {
            let recording = manifest.shard(folder, name, system)?;
            let kept = counts.sift(&recording, bound);
            counts.take(system, &recording, &kept);
            each(system, &recording, &kept, &mut columns, Column::add)?;
            hashes.push(recording.sha256());
            held = (held.0 + recording.trajectories, recording.frames);
            bar.set(k as u64 + 1);
        }
        // What training would refuse.
        manifest.holds(folder, hashes, held.0, held.1)?;
        columns.iter_mut().for_each(|c| c.close(counts.tokens));
        for (k, name) in manifest.shards.iter().enumerate() {
            let recording = manifest.shard(folder, name, system)?;
            let kept = Counts::default().sift(&recording, bound);
            each(system, &recording, &kept, &mut columns, Column::bin)?;
            bar.set((manifest.shards.len() + k) as u64 + 1);
        }
        bar.finish();
        for c in columns.iter().filter(|c| c.count > 0) {
            let whose = format!("{}: mean or spread of column `{}`, which --bound {bound} lets through,", folder.display(), c.name);
            figures(&whose, &[c.mean, c.std, c.std_of_all])?;
        }
        let Counts { tokens, not_finite, beyond, .. } = counts;
        if tokens == 0 {
            refuse!("{}: no trajectory is left to look at ({not_finite} not finite, {beyond} beyond {bound})", folder.display());
        }
        Ok(Self { robot: system.name.clone(), sha256: manifest.sha256.clone(), bound, counts, columns })
    }

    /// Draws a histogram of every column into `stem`.svg and `stem`.png.
    ///
    /// # Errors
    /// If they cannot be drawn or written.
    pub fn draw(&self, stem: &Path) -> Result<()> {
        let title = format!(
            "{}: {} tokens, every input and target, over mean ± 4 standard deviations at most, heights by the root of the count",
            self.robot, self.counts.tokens
        );
        picture::draw(&title, &self.columns, self.counts.tokens, stem)
    }
}

impl Counts {
    /// Which trajectories a learner may see.
    fn sift(&mut self, recording: &Recording, bound: f64) -> Vec<bool> {
        let part = |x: &[f64], i: usize| x[i * x.len() / recording.trajectories..(i + 1) * x.len() / recording.trajectories].to_vec();
        let look = |i: usize| {
            let states = part(&recording.states, i);
            let others = [&recording.torques, &recording.gravity, &recording.normals, &recording.points].map(|x| part(x, i));
            let finite = states.iter().chain(others.iter().flatten()).all(|x| x.is_finite());
            let finite = finite && !part(&recording.depths, i).iter().any(|x| x.is_nan());
            let beyond = finite && states.iter().any(|x| x.abs() > bound);
            self.trajectories += 1;
            self.not_finite += u64::from(!finite);
            self.beyond += u64::from(beyond);
            finite && !beyond
        };
        (0..recording.trajectories).map(look).collect()
    }

    /// Counts what is no column's.
    fn take(&mut self, system: &System, recording: &Recording, kept: &[bool]) {
        let (f, robot) = (recording.frames, &system.robot);
        let (d, points) = (robot.state_dim(), robot.contact_points.len());
        let endless: Vec<(usize, &str)> =
            robot.joints().enumerate().filter(|(_, j)| j.wraps()).map(|(i, j)| (robot.root_coords() + i, j.name.as_str())).collect();
        if self.wraps.is_empty() {
            self.wraps = endless.iter().map(|(_, name)| (name.to_string(), 0)).collect();
        }
        for row in (0..recording.trajectories * f).filter(|row| kept[row / f]) {
            self.tokens += 1;
            let near = recording.depths[row * points..(row + 1) * points].iter().zip(&robot.contact_points);
            let (mut seen, mut touching) = (0, 0);
            for (depth, point) in near {
                seen += u64::from(*depth < point.threshold());
                touching += u64::from(*depth < point.radius);
            }
            self.points_seen += seen;
            self.points_touching += touching;
            self.tokens_seeing += u64::from(seen > 0);
            self.tokens_touching += u64::from(touching > 0);
            let at = (row / f * (f + 1) + row % f) * d;
            for ((k, _), (_, wraps)) in endless.iter().zip(&mut self.wraps) {
                let turn = recording.states[at + d + k] - recording.states[at + k];
                *wraps += u64::from(turn.abs() > std::f64::consts::PI);
            }
        }
    }
}

/// Hands every number of every token and target to its column.
fn each(system: &Arc<System>, recording: &Recording, kept: &[bool], all: &mut [Column], take: fn(&mut Column, f64)) -> Result<()> {
    let windows = tokens(system, recording, 1, Base::State)?;
    let (inputs, points) = (Features::inputs(system, Base::State), &system.robot.contact_points);
    let rows = windows.x.chunks_exact(windows.inputs).zip(windows.y.chunks_exact(windows.outputs)).enumerate();
    for (row, (x, y)) in rows.filter(|(row, _)| kept[row / recording.frames]) {
        for (k, column) in all.iter_mut().enumerate() {
            let seen = |point: usize| recording.depths[row * points.len() + point] < points[point].threshold();
            if column.contact.is_none_or(seen) {
                take(column, f64::from(if k < inputs { x[k] } else { y[k - inputs] }));
            }
        }
    }
    Ok(())
}
