//! Splits recorded motion, a log ([`nerd_sim::log`]), into three parts. The first trains models, the second chooses
//! their best weights, and only verdicts use the third.

use std::collections::HashMap;

use nerd_sim::calibrate::{CalibrateError, Engine, FitConfig, Parameter, Subject};
use nerd_sim::log::{Log, LogError, Trajectory};
use nerd_sim::truth::RECORDED;

use crate::evaluate::{Pieces, horizon};
use crate::prelude::*;

part!(LogError, CalibrateError);

/// Of [`HELD_OUT`] trajectories, one is held out. Of [`CHOOSES`] others, one chooses the weights.
const HELD_OUT: usize = 5;
const CHOOSES: usize = 6;
/// Most held-out trajectories that a model card names. If more are held out, the card states the rule that chose them.
const NAMED: usize = 100;
/// Cutting trajectories into pieces loses at most one window in this many.
const LOST: usize = 100;
/// Most trials (recorded rollouts) that a calibration fits.
const TRIALS: usize = 200;

/// A log with its trajectories in three parts: for training, for choosing the weights, and held out.
pub struct Measured {
    /// `recorded NAME`, the truth's name on cards.
    pub truth: String,
    /// Robot, scene, notes and all trajectories.
    pub log: Log,
    /// SHA-256 of all trajectories as read.
    pub sha256: String,
    /// Trajectories for training.
    pub learned: Vec<Trajectory>,
    /// Trajectories for choosing the weights.
    pub choosing: Vec<Trajectory>,
    /// Held-out trajectories, for verdicts.
    pub held_out: Vec<Trajectory>,
    /// Whether the default rule chose the held-out trajectories.
    by_rule: bool,
}

impl Measured {
    /// The log at `data`, if there is one: a TOML file, or `log.toml` in a folder.
    pub fn path(data: &Path) -> Option<PathBuf> {
        let inside = data.join("log.toml");
        if inside.is_file() {
            return Some(inside);
        }
        data.extension().is_some_and(|e| e == "toml").then(|| data.into())
    }

    /// Name of the truth of a log: the file's name up to the first dot, or the folder's name if the file is `log.toml`.
    pub fn name(path: &Path) -> String {
        let stem = |path: &Path| {
            path.file_name().map(|name| name.to_string_lossy().split('.').next().unwrap_or_default().to_string())
        };
        let folder = || stem(std::path::absolute(path).ok()?.parent()?);
        let name = stem(path).filter(|name| name != "log").or_else(folder);
        format!("{RECORDED}{}", name.unwrap_or_default())
    }

    /// Reads a log and holds out the trajectories with these names. Without names, it holds out every fifth trajectory.
    /// If the log has fewer than five, it holds out the last fifth of each.
    pub fn read(path: &Path, held_out: &[u64]) -> Result<Self> {
        let log = Log::read(path, None)?;
        if let Some(id) = held_out.iter().find(|id| log.trajectories.iter().all(|t| t.id != **id)) {
            refuse!("--held-out {id}: {} has no such trajectory", path.display());
        }
        Ok(Self::parted(path, log, held_out))
    }

    /// Reads a log and holds out the trajectories that the model's card names. If the model learned other data, it
    /// holds out the same as [`Measured::read`] without names.
    pub fn of(path: &Path, model: &Model) -> Result<Self> {
        let log = Log::read(path, None)?;
        let mut ids = Self::named(&model.config);
        ids.retain(|id| log.trajectories.iter().any(|t| t.id == *id));
        let found = Self::parted(path, log, &ids);
        if found.sha256 == model.config.data_sha256 {
            return Ok(found);
        }
        // The linear map and the calibrated solver learn from this log. Hold out a part that neither of them has seen.
        tell!("{}: the model learned other data (`{}`)", path.display(), model.config.truth);
        Ok(Self::parted(path, Log { notes: Vec::new(), ..found.log }, &[]))
    }

    /// Names of the held-out trajectories on a model's card.
    pub fn named(config: &ModelConfig) -> Vec<u64> {
        let said = config.provenance.get("held out").map_or("", String::as_str);
        said.split(", ").filter_map(|id| id.parse().ok()).collect()
    }

    fn parted(path: &Path, log: Log, held_out: &[u64]) -> Self {
        log.notes.iter().for_each(|note| tell!("{}: {note}", path.display()));
        let mut hash = Sha256::new();
        for trajectory in &log.trajectories {
            hash.update(trajectory.id.to_le_bytes());
            hash.update((trajectory.states.len() as u64).to_le_bytes());
            trajectory.states.iter().chain(&trajectory.torques).flatten().for_each(|x| hash.update(x.to_le_bytes()));
        }
        let sha256 = hex(hash.finalize());
        let (all, by_rule) = (log.trajectories.clone(), held_out.is_empty());
        let (rest, held_out) = match held_out {
            [] => parted(all, HELD_OUT),
            ids => all.into_iter().partition(|t| !ids.contains(&t.id)),
        };
        let (learned, choosing) = parted(rest, CHOOSES);
        Self { truth: Self::name(path), log, sha256, learned, choosing, held_out, by_rule }
    }

    /// The held-out trajectories in words, for a model card.
    pub fn held_out(&self) -> String {
        let mut ids = self.held_out.iter().map(|t| t.id).collect_vec();
        ids.dedup();
        if self.learned.iter().any(|t| ids.contains(&t.id)) {
            return format!("the last 1/{HELD_OUT} of each trajectory");
        }
        if self.by_rule && ids.len() > NAMED {
            return format!("every {HELD_OUT}th trajectory, {} in all", ids.len());
        }
        ids.iter().map(u64::to_string).join(", ")
    }

    /// Number of trajectories and of frames in the training part.
    pub fn size(&self) -> [usize; 2] {
        [self.learned.len(), self.learned.iter().map(Trajectory::frames).sum()]
    }

    /// Cuts a part into pieces of about `length` frames. At least 99 % of all sequences of `sequence` frames lie whole
    /// in one piece.
    pub fn recording(&self, part: &[Trajectory], length: usize, sequence: usize) -> Result<Trajectories> {
        let mut lengths = part.iter().map(Trajectory::frames).filter(|n| *n >= sequence).collect_vec();
        lengths.sort_unstable();
        let windows = |n: &usize| n + 1 - sequence;
        let mut left = lengths.iter().map(windows).sum::<usize>() / LOST;
        let mut pieces = length.max(sequence);
        for n in lengths.iter().filter(|n| **n < length) {
            if windows(n) > left {
                pieces = pieces.min(*n);
                break;
            }
            left -= windows(n);
        }
        Ok(self.log.recording(part, pieces, sequence - 1)?)
    }

    /// Cuts at most `most` pieces for rollouts from a part. A piece has `before` frames of history, then `frames`
    /// frames. In each trajectory, pieces start `every` frames apart.
    pub fn pieces(&self, part: &[Trajectory], [before, frames, every]: [usize; 3], most: usize) -> Result<Pieces> {
        let length = before + frames;
        let starts = part.iter().flat_map(|t| t.starts(length, every).map(move |first| (t, first))).collect_vec();
        if starts.is_empty() {
            let longest = part.iter().map(Trajectory::frames).max().unwrap_or(0);
            refuse!(
                "`{}`: no trajectory of its part has {length} frames, the longest {longest}; ask for fewer",
                self.truth
            );
        }
        let short = part.iter().filter(|t| t.frames() < length).count();
        if short > 0 {
            tell!("{short} of {} trajectories have less than {length} frames, and no rollout", part.len());
        }
        self.cut(&starts, [before, frames], most)
    }

    /// Cuts at most `most` pieces at `starts`, each given as trajectory and first frame.
    fn cut(&self, starts: &[(&Trajectory, usize)], [before, frames]: [usize; 2], most: usize) -> Result<Pieces> {
        let starts = starts.iter().step_by(starts.len().div_ceil(most.max(1))).copied();
        Ok(Pieces { system: self.log.system.clone(), before, all: self.log.cut(starts, before + frames)? })
    }

    /// Held-out pieces whose rollouts begin at the first states of another log's trajectories. Also returns the other
    /// log's states after each frame, `[frame][piece][q, qd]`. With both, another simulator, or the same one with
    /// another step, is compared with the recording. `frames` defaults to the median length of the other log's
    /// trajectories; shorter ones are left out.
    pub fn beside(
        &self,
        other: &Log,
        before: usize,
        frames: Option<usize>,
        most: usize,
    ) -> Result<(Pieces, Vec<Vec<f64>>)> {
        let key = |state: &[f64]| state.iter().map(|x| x.to_bits()).collect_vec();
        let others: HashMap<Vec<u64>, &Trajectory> =
            other.trajectories.iter().map(|t| (key(&t.states[0]), t)).collect();
        let times = [other.system.frame_time, self.log.system.frame_time];
        if times[0] != times[1] {
            refuse!("--beside: its frames last {} s, those of what was held out {} s", times[0], times[1]);
        }
        if others.len() < other.trajectories.len() {
            refuse!(
                "--beside: two of its trajectories begin in one state, so it is not clear which of them goes on as what was held out"
            );
        }
        let frames = frames.unwrap_or_else(|| median(others.values().map(|t| t.frames())));
        let starts = self.held_out.iter().flat_map(|t| t.starts(frames, 1).skip(before).map(move |first| (t, first)));
        let there = |(t, first): &(&Trajectory, usize)| {
            others.get(&key(&t.states[*first])).is_some_and(|t| t.frames() >= frames)
        };
        let starts = starts.filter(there).map(|(t, first)| (t, first - before)).collect_vec();
        if starts.is_empty() {
            refuse!(
                "--beside: none of its trajectories has {frames} frames from a state that was held out, {before} frames or more after its trajectory's start"
            );
        }
        let pieces = self.cut(&starts, [before, frames], most)?;
        let start = |piece: usize| others.get(&key(pieces.all.state(piece, before))).copied();
        let of = (0..pieces.count()).filter_map(start).collect_vec();
        let states = (1..=frames).map(|frame| of.iter().flat_map(|t| t.states[frame].clone()).collect()).collect();
        Ok((pieces, states))
    }

    /// Cuts pieces to evaluate a network. A piece has the history that the network reads, then the robot's [`horizon`];
    /// both are shortened to fit into the median trajectory.
    pub fn rollouts(&self, part: &[Trajectory], network: &TransformerConfig, most: usize) -> Result<Pieces> {
        let most_have = median(part.iter().map(Trajectory::frames));
        let before = (network.reach() - 1).min(most_have / 2);
        let frames = horizon(&self.log.system.name).min(most_have - before);
        self.pieces(part, [before, frames, frames], most)
    }

    /// The articulated solver with the parameters in the robot's file.
    pub fn described(&self) -> Result<Subject> {
        let engine = Engine::Articulated(ArticulatedConfig::accurate(&self.log.system));
        Ok(Subject::new(&self.log.system, &self.log.scene, engine)?)
    }

    /// The articulated solver calibrated on the training part, over rollouts of `frames` frames. Fits the parameters
    /// that free motion may determine, and for driven logs those of the drives.
    pub fn calibrated(&self, frames: usize, evaluations: usize) -> Result<Subject> {
        let (subject, log) = (self.described()?, Log { trajectories: self.learned.clone(), ..self.log.clone() });
        let mut parameters = Parameter::usual(&log.system, &log.scene, false)?;
        if log.driven() {
            parameters.extend(Parameter::driven(&log.system)?);
        }
        let (bar, mut before) = (bar("calibration", evaluations as u64), 0);
        let fit = subject.fit(
            &parameters,
            &log.trials(frames + 1, frames),
            FitConfig { evaluations, trials: TRIALS, ..FitConfig::default() },
            &mut |done, _| {
                bar.add(done.saturating_sub(before) as u64);
                before = done;
            },
        )?;
        bar.finish();
        Ok(subject.with(&parameters, &fit.values)?)
    }
}

fn median(lengths: impl Iterator<Item = usize>) -> usize {
    let mut lengths = lengths.collect_vec();
    lengths.sort_unstable();
    lengths.get(lengths.len() / 2).copied().unwrap_or(0)
}

/// Sets apart every `every`-th trajectory name. With fewer than `every` names, sets apart the last `1 / every` of each
/// trajectory.
fn parted(all: Vec<Trajectory>, every: usize) -> (Vec<Trajectory>, Vec<Trajectory>) {
    let mut ids = all.iter().map(|t| t.id).collect_vec();
    ids.dedup();
    if ids.len() >= every {
        let apart = |id: u64| ids.binary_search(&id).is_ok_and(|k| k % every == every - 1);
        return all.into_iter().partition(|t| !apart(t.id));
    }
    let ends = all.into_iter().map(|t| {
        let at = t.frames() - t.frames() / every;
        let part = |range: std::ops::RangeInclusive<usize>| Trajectory {
            id: t.id,
            states: t.states[range.clone()].to_vec(),
            torques: t.torques[range].to_vec(),
        };
        (part(0..=at), part(at..=t.frames()))
    });
    ends.unzip()
}
