//! What a learner will see of a data set on the disk: how often anything touches, which trajectories no learner should
//! see, and range, mean and spread of every column; of contact points only where the mask lets them through. The tokens are those that training makes, not normalised.

mod columns;

use nerd_model::base::Base;
use nerd_sim::dataset::{Manifest, Recording};
use nerd_train::{bounds::figures, prepare::tokens};

pub use columns::Kind;

use crate::prelude::*;

#[derive(Clone, Debug)]
pub struct Inspection {
    pub robot: String,
    pub bound: f64,
    pub counts: Counts,
    /// Those of a token, then those of a target.
    pub kinds: Vec<Kind>,
}

#[derive(Clone, Debug, Default)]
pub struct Counts {
    pub trajectories: u64,
    /// Trajectories left out since one of their numbers is not finite.
    pub not_finite: u64,
    /// Trajectories left out since they go beyond the bound.
    pub beyond: u64,
    /// Transitions of the others, which is tokens.
    pub tokens: u64,
    /// Tokens with a point that touches.
    pub touching: u64,
}

impl Inspection {
    /// Looks through the data of `system` in a folder; trajectories that are not finite or go beyond `bound` are left out and
    /// counted.
    pub fn of(folder: &Path, manifest: &Manifest, system: &Arc<System>, bound: f64) -> Result<Self> {
        manifest.check(folder, system, &manifest.truth)?;
        let ((mut kinds, places), mut counts) = (columns::columns(system), Counts::default());
        let (mut hashes, mut held, points) = (Vec::new(), (0, manifest.frames), &system.robot.contact_points);
        let bar = bar("shards", manifest.shards.len() as u64);
        for (k, name) in manifest.shards.iter().enumerate() {
            let recording = manifest.shard(folder, name, system)?;
            let kept = counts.sift(&recording, bound);
            let windows = tokens(system, &recording, 1, Base::State);
            let rows = windows.x.chunks_exact(windows.inputs).zip(windows.y.chunks_exact(windows.outputs)).enumerate();
            for (row, (x, y)) in rows.filter(|(row, _)| kept[row / recording.frames]) {
                let depths = &recording.depths[row * points.len()..][..points.len()];
                counts.tokens += 1;
                counts.touching += u64::from(depths.iter().zip(points).any(|(depth, point)| *depth < point.radius));
                for (x, (kind, contact)) in x.iter().chain(y).zip(&places) {
                    if contact.is_none_or(|point| depths[point] < points[point].threshold()) {
                        kinds[*kind].add(f64::from(*x));
                    }
                }
            }
            hashes.push(recording.sha256());
            held = (held.0 + recording.trajectories, recording.frames);
            bar.set(k as u64 + 1);
        }
        // What training would refuse.
        manifest.holds(folder, hashes, held.0, held.1)?;
        bar.finish();
        for kind in kinds.iter().filter(|kind| kind.count > 0) {
            let whose = format!("{}: mean or spread of `{}`, which --bound {bound} lets through,", folder.display(), kind.name);
            figures(&whose, &[kind.mean, kind.std()])?;
        }
        let Counts { tokens, not_finite, beyond, .. } = counts;
        if tokens == 0 {
            bail!("{}: no trajectory is left to look at ({not_finite} not finite, {beyond} beyond {bound})", folder.display());
        }
        Ok(Self { robot: system.name.clone(), bound, counts, kinds })
    }

    /// What is counted beside the columns, and as which share of what.
    pub fn counted(&self) -> Table {
        let Self { robot, counts, kinds, bound } = self;
        let row = |what: String, n: u64, of: u64| vec![what, n.to_string(), format!("{:.3}", 100.0 * n as f64 / of.max(1) as f64)];
        let mut rows = vec![
            row("trajectories not finite, left out".into(), counts.not_finite, counts.trajectories),
            row(format!("trajectories beyond {bound}, left out"), counts.beyond, counts.trajectories),
        ];
        if kinds.iter().any(|kind| kind.name == "contact depths") {
            rows.push(row("tokens with a point that touches".into(), counts.touching, counts.tokens));
        }
        let (targets, inputs): (Vec<_>, Vec<_>) = kinds.iter().partition(|kind| kind.name.starts_with('\u{394}'));
        let [inputs, targets] = [inputs, targets].map(|kinds| kinds.iter().map(|kind| kind.columns).sum::<usize>());
        let constant = kinds.iter().filter(|kind| kind.count > 0 && kind.constant()).map(|kind| kind.name.as_str()).collect::<Vec<_>>();
        let idle = if constant.is_empty() { String::new() } else { format!(" Constant, nothing to learn from: {}.", constant.join(", ")) };
        let note = format!(
            "{robot}: {} trajectories, {} tokens of {inputs} inputs and {targets} targets.{idle}",
            counts.trajectories, counts.tokens
        );
        Table::new("counts", &["what", "number", "share (%)"]).with(rows).noted(&note)
    }

    pub fn table(&self) -> Table {
        let rows = self.kinds.iter().filter(|kind| kind.count > 0).map(|kind| {
            let name = if kind.columns > 1 { format!("{} ({})", kind.name, kind.columns) } else { kind.name.clone() };
            let seen = 100.0 * kind.count as f64 / (self.counts.tokens * kind.columns as u64) as f64;
            [name, format!("{seen:.3}")].into_iter().chain([kind.min, kind.mean, kind.max, kind.std()].map(digits)).collect()
        });
        Table::new("columns", &["column", "seen (%)", "least", "mean", "most", "std"]).with(rows)
    }
}

impl Counts {
    /// Which trajectories a learner may see.
    fn sift(&mut self, recording: &Recording, bound: f64) -> Vec<bool> {
        let n = recording.trajectories;
        let look = |i: usize| {
            let part = |x: &'_ [f64]| -> Vec<f64> { x[i * x.len() / n..(i + 1) * x.len() / n].to_vec() };
            let states = part(&recording.states);
            let others = [&recording.torques, &recording.gravity, &recording.normals, &recording.points].map(|x| part(x));
            let finite = states.iter().chain(others.iter().flatten()).all(|x| x.is_finite());
            let finite = finite && !part(&recording.depths).iter().any(|x| x.is_nan());
            let beyond = finite && states.iter().any(|x| x.abs() > bound);
            self.trajectories += 1;
            self.not_finite += u64::from(!finite);
            self.beyond += u64::from(beyond);
            finite && !beyond
        };
        (0..n).map(look).collect()
    }
}
