//! `cargo xtask inspect FOLDER`: what a learner will see of a data set that `dataset` wrote.
//!
//! Every number of a token and of a target is drawn as a histogram; those of contact points only where the mask lets them
//! through. Beside that: how often anything is seen and touched, how often an angle wraps, which trajectories no learner
//! should see, and range, mean and spread of every column. The tokens are those that training makes, not normalised.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_sim::dataset::{Manifest, Recording, check_header, read_shard, sha256_of};
use nerd_sim::prelude::*;
use nerd_train::prepare::tokens;
use serde::Serialize;

mod columns;
mod picture;

use columns::{Block, Column, columns};

use crate::numbers::{self, positive};
use crate::provenance::Provenance;
use crate::table::{digits, markdown};

/// Show what a data set holds.
#[derive(clap::Args, Clone, Debug)]
pub struct InspectArgs {
    /// Folder that `dataset` wrote
    #[arg(required_unless_present = "data")]
    pub folder: Option<PathBuf>,
    /// The same
    #[arg(long, conflicts_with = "folder")]
    pub data: Option<PathBuf>,
    /// Robot: built in, or the path of a .urdf [default: the one the folder names]
    #[arg(long)]
    pub robot: Option<String>,
    /// Largest number a state may hold; a trajectory beyond it is left out and counted
    #[arg(long, default_value_t = 1e3, value_parser = positive)]
    pub bound: f64,
    /// Folder for inspect.json, .svg and .png [default: the data's]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// What is counted beside the columns.
#[derive(Clone, Debug, Default, Serialize)]
struct Counts {
    trajectories: u64,
    /// Trajectories left out.
    not_finite: u64,
    beyond: u64,
    /// Transitions of the others, which is tokens.
    tokens: u64,
    /// Tokens with a point that the mask lets through, and with one that touches.
    tokens_seeing: u64,
    tokens_touching: u64,
    /// Points, over all tokens: let through, touching.
    points_seen: u64,
    points_touching: u64,
    /// Transitions in which each endless joint's angle wraps.
    wraps: Vec<(String, u64)>,
}

/// Runs the verb.
pub fn run(args: InspectArgs) -> Result<()> {
    let folder = args.folder.as_ref().or(args.data.as_ref()).context("no folder to inspect")?;
    let manifest = Manifest::read(folder)
        .with_context(|| format!("no data set to inspect; make one with `cargo xtask dataset --out {}`", folder.display()))?;
    let robot = args.robot.as_ref().unwrap_or(&manifest.robot);
    let system = System::named(robot)
        .with_context(|| format!("{} is of robot `{1}`; name its file: --robot PATH/{1}.urdf", folder.display(), manifest.robot))?;
    let wrong = |reason: String| anyhow!("{}: {reason}", folder.display());
    manifest.check(&system, &manifest.truth).map_err(wrong)?;
    let (mut all, mut counts, mut hashes) = (columns(&system), Counts::default(), Vec::new());
    let mut held = (0, manifest.frames);
    let bar = crate::common::bar("shards, twice", 2 * manifest.shards.len() as u64);
    for pass in 0..2 {
        for (k, name) in manifest.shards.iter().enumerate() {
            let path = folder.join(name);
            let recording = shard(&system, &manifest, &path)?;
            let kept = kept(&recording, args.bound, if pass == 0 { Some(&mut counts) } else { None });
            if pass == 0 {
                count(&system, &recording, &kept, &mut counts);
                hashes.push(recording.sha256());
                held = (held.0 + recording.trajectories, recording.frames);
            }
            each(&system, &recording, &kept, &mut all, if pass == 0 { Column::add } else { Column::bin })?;
            bar.set((pass * manifest.shards.len() + k + 1) as u64);
        }
        // What `train --data` would refuse.
        if pass == 0 && sha256_of(std::mem::take(&mut hashes)) != manifest.sha256 {
            let manifest = folder.join("manifest.json");
            bail!("{}: the shards are not those it was written for (SHA-256 differs); make the data set anew", manifest.display());
        }
        if pass == 0 {
            manifest.holds(held.0, held.1).map_err(wrong)?;
            all.iter_mut().for_each(|c| c.close(counts.tokens));
        }
    }
    bar.finish();
    for c in all.iter().filter(|c| c.count > 0) {
        let whose = format!("{}: mean or spread of column `{}`, which --bound {} lets through,", folder.display(), c.name, args.bound);
        numbers::figures(&whose, &[c.mean, c.std, c.std_of_all])?;
    }
    if counts.tokens == 0 {
        bail!(
            "{}: no trajectory is left to look at ({} not finite, {} beyond {})",
            folder.display(),
            counts.not_finite,
            counts.beyond,
            args.bound
        );
    }
    println!("{}", words(&system, &all, &counts, args.bound));
    println!("{}", table(&all, counts.tokens));
    let json = serde_json::json!({
        "provenance": Provenance::now(manifest.seed),
        "robot": system.name,
        "sha256": manifest.sha256,
        "bound": args.bound,
        "counts": counts,
        "columns": all,
    });
    let stem = args.out.as_ref().unwrap_or(folder).join("inspect");
    crate::files::write(&stem.with_extension("json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    let title = format!(
        "{}: {} tokens, every input and target, over mean ± 4 standard deviations at most, heights by the root of the count",
        system.name, counts.tokens
    );
    Ok(picture::draw(&title, &all, counts.tokens, &stem)?)
}

/// A shard, if it is of this system and of the manifest's truth.
fn shard(system: &System, manifest: &Manifest, path: &Path) -> Result<Recording> {
    let (recording, header) = read_shard(path)?;
    let checked = check_header(&header, system, &manifest.truth).and_then(|()| recording.check(&system.robot));
    checked.map(|()| recording).map_err(|reason| anyhow!("{}: {reason}", path.display()))
}

/// Which trajectories a learner may see.
fn kept(recording: &Recording, bound: f64, mut counts: Option<&mut Counts>) -> Vec<bool> {
    let part = |x: &[f64], i: usize| x[i * x.len() / recording.trajectories..(i + 1) * x.len() / recording.trajectories].to_vec();
    let look = |i: usize| {
        let states = part(&recording.states, i);
        let others = [&recording.torques, &recording.gravity, &recording.normals, &recording.points].map(|x| part(x, i));
        let finite = states.iter().chain(others.iter().flatten()).all(|x| x.is_finite());
        let finite = finite && !part(&recording.depths, i).iter().any(|x| x.is_nan());
        let beyond = finite && states.iter().any(|x| x.abs() > bound);
        if let Some(counts) = &mut counts {
            counts.trajectories += 1;
            counts.not_finite += u64::from(!finite);
            counts.beyond += u64::from(beyond);
        }
        finite && !beyond
    };
    (0..recording.trajectories).map(look).collect()
}

/// Counts what is no column's.
fn count(system: &System, recording: &Recording, kept: &[bool], counts: &mut Counts) {
    let (f, robot) = (recording.frames, &system.robot);
    let (d, points) = (robot.state_dim(), robot.contact_points.len());
    let endless: Vec<(usize, &str)> =
        robot.joints().enumerate().filter(|(_, j)| j.wraps()).map(|(i, j)| (robot.root_coords() + i, j.name.as_str())).collect();
    if counts.wraps.is_empty() {
        counts.wraps = endless.iter().map(|(_, name)| (name.to_string(), 0)).collect();
    }
    for row in (0..recording.trajectories * f).filter(|row| kept[row / f]) {
        counts.tokens += 1;
        let near = recording.depths[row * points..(row + 1) * points].iter().zip(&robot.contact_points);
        let (mut seen, mut touching) = (0, 0);
        for (depth, point) in near {
            seen += u64::from(*depth < point.threshold());
            touching += u64::from(*depth < point.radius);
        }
        counts.points_seen += seen;
        counts.points_touching += touching;
        counts.tokens_seeing += u64::from(seen > 0);
        counts.tokens_touching += u64::from(touching > 0);
        let at = (row / f * (f + 1) + row % f) * d;
        for ((k, _), (_, wraps)) in endless.iter().zip(&mut counts.wraps) {
            let turn = recording.states[at + d + k] - recording.states[at + k];
            *wraps += u64::from(turn.abs() > std::f64::consts::PI);
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

/// The counts in words.
fn words(system: &System, all: &[Column], counts: &Counts, bound: f64) -> String {
    let share = |n: u64, of: u64| format!("{:.3} %", 100.0 * n as f64 / of.max(1) as f64);
    let points = counts.tokens * system.robot.contact_points.len() as u64;
    let mut text = format!(
        "{}: {} tokens of {} inputs and {} targets; {} of {} trajectories left out ({} not finite, {} beyond {bound})\n",
        system.name,
        counts.tokens,
        Features::inputs(system, Base::State),
        Features::outputs(system),
        counts.not_finite + counts.beyond,
        counts.trajectories,
        counts.not_finite,
        counts.beyond,
    );
    if points > 0 {
        text += &format!(
            "contact: {} of tokens see a point within the mask, {} touch; {} of points are seen, {} touch\n",
            share(counts.tokens_seeing, counts.tokens),
            share(counts.tokens_touching, counts.tokens),
            share(counts.points_seen, points),
            share(counts.points_touching, points)
        );
    }
    for (joint, n) in &counts.wraps {
        text += &format!("angle of `{joint}` wraps in {} of transitions\n", share(*n, counts.tokens));
    }
    let constant: Vec<&str> = all.iter().filter(|c| c.count > 0 && c.constant()).map(|c| c.name.as_str()).collect();
    if !constant.is_empty() {
        text += &format!("constant, nothing to learn from: {}\n", constant.join(", "));
    }
    text
}

/// Range, mean and spread; a kind of contact number takes one row for all points.
fn table(all: &[Column], tokens: u64) -> String {
    let shared = |b: Block| matches!(b, Block::Normal | Block::Point | Block::Depth);
    let row = |name: &str, seen: f64, figures: [f64; 4]| {
        let seen = format!("{:.3}", 100.0 * seen);
        [name.to_string(), seen].into_iter().chain(figures.map(digits)).collect::<Vec<_>>()
    };
    let mut rows = Vec::new();
    for block in Block::ALL {
        let of: Vec<&Column> = all.iter().filter(|c| c.block == block).collect();
        if !shared(block) {
            let seen = |c: &Column| c.count as f64 / tokens as f64;
            rows.extend(of.iter().map(|c| row(&c.name, seen(c), [c.min, c.mean, c.max, c.std])));
            continue;
        }
        let n = of.iter().map(|c| c.count as f64).sum::<f64>();
        let there = of.iter().filter(|c| c.count > 0);
        if n > 0.0 {
            let mean = there.clone().map(|c| c.mean * c.count as f64).sum::<f64>() / n;
            let square = there.clone().map(|c| (c.std * c.std + (c.mean - mean).powi(2)) * c.count as f64).sum::<f64>() / n;
            let ends = there.fold((f64::MAX, f64::MIN), |e, c| (e.0.min(c.min), e.1.max(c.max)));
            let name = format!("{} ({})", block.name(), of.len());
            rows.push(row(&name, n / (tokens * of.len() as u64) as f64, [ends.0, mean, ends.1, square.sqrt()]));
        }
    }
    markdown(&["column", "seen (%)", "least", "mean", "most", "std"], &rows)
}
