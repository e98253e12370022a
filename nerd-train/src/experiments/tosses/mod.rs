//! 537 real tosses of an acrylic cube, predicted open loop from measured states; see [`nerd_sim::measured`].
//!
//! The body is the published one (edge 0.1048 m, 0.37 kg, 8.1e-4 kg m^2, mu 0.18, restitution 0.125); nothing is fitted but
//! in the table that says so. Windows of 80 samples at every fourth sample, and whole tosses. Two scales of length: as
//! published, and metric. Beside the methods two predictors that know no contact. Then, one change at a time, what the errors
//! come from. Some minutes on two cores.

mod changes;
mod methods;
mod rows;
mod tables;

use std::path::{Path, PathBuf};

use nerd_model::pick;
use nerd_sim::measured::*;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Experiment;
use crate::error::{Error, Result, refuse};
use crate::progress::bar;
use crate::report::frames::{Curve, draw};
use crate::report::inputs::hex;
use crate::report::{Input, Inputs, Table};

pub use changes::{Effect, Line};
pub use rows::Row;

use methods::{Method, all, pair};
use rows::Trials;

/// The tosses, and how they are cut.
#[derive(Clone, Debug)]
pub struct Tosses {
    folder: PathBuf,
    tosses: Vec<Toss>,
    every: usize,
    seed: u64,
}

/// All that was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Measured {
    /// Tosses.
    pub tosses: usize,
    /// Windows of them.
    pub windows: usize,
    /// Predictors and solvers.
    pub rows: Vec<Row>,
    /// What the errors come from.
    pub lines: Vec<Line>,
    /// Noise of the measured velocities.
    pub noise: Noise,
    /// Prediction with that noise on its start against that without.
    pub floor: Score,
    /// What can be had by fitting.
    pub fit: Fitted,
}

/// The fitted table.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Fitted {
    /// What was chosen.
    #[serde(flatten)]
    pub fit: Fit,
    /// Of the settings of the first table, on the odd half: rapier from starts as measured, rapier, articulated.
    pub odd_before: [Score; 3],
}

/// Rows of the picture.
const DRAWN: [&str; 6] = [
    "articulated implicit x16",
    "articulated implicit x1",
    "rapier 4 x 1",
    "articulated paper, its own cube",
    "no motion",
    "flight, frozen at the first touch",
];

impl Tosses {
    /// The tosses of a folder in windows that begin at every `every`-th sample; `seed` is that of the noise put on velocities.
    ///
    /// # Errors
    /// If there are no tosses, or none is as long as a window.
    pub fn new(folder: &Path, every: usize, seed: u64) -> Result<Self> {
        let found = Self { folder: folder.into(), tosses: read(folder)?, every, seed };
        if found.windows() == 0 {
            refuse!("{}: no toss has {WINDOW} samples, which a window is", folder.display());
        }
        Ok(found)
    }

    fn windows(&self) -> usize {
        windows(&self.tosses, self.every, 1.0).len()
    }

    /// The best table for the second of the two solvers that are taken apart.
    fn fit(raw: &[Trial], lifted: &[Trial]) -> Result<Fitted> {
        let [first, ours] = pair(&Cube::default(), 1, false)?;
        let mut shown = None;
        let fit = fit(&|_| ours.setting.solver(), lifted, &mut |done, of| {
            shown.get_or_insert_with(|| bar("settings", of as u64)).set(done as u64)
        })?;
        shown.into_iter().for_each(|bar| bar.finish());
        let of = |method: &Method, trials: &[Trial]| -> Result<Score> {
            let odd = half(trials, true);
            Ok(against(&odd, &method.roll(&odd)?.0).brief())
        };
        Ok(Fitted { fit, odd_before: [of(&first, raw)?, of(&first, lifted)?, of(&ours, lifted)?] })
    }
}

impl Experiment for Tosses {
    type Data = Measured;

    fn name(&self) -> String {
        "tosses".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.windows() * WINDOW) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut all = Sha256::new();
        for file in ["tosses.csv", "tosses_meta.csv"] {
            let path = self.folder.join(file);
            all.update(std::fs::read(&path).map_err(Error::file(&path))?);
        }
        let mut inputs = Inputs(vec![Input::Data { name: "cube tosses".into(), sha256: hex(&all.finalize()) }]);
        inputs.add(Input::robot(&*System::named("cube")?));
        for solver in [pick::Setting::Implicit(16), pick::Setting::Paper, pick::Setting::RapierSteps(1)] {
            inputs.add(Input::motion("cube", "ground", &solver)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Measured> {
        let trials = Trials::new(&self.tosses, self.every);
        let methods = all()?;
        let mut rows = vec![Row::floor("no motion", &trials, still), Row::floor("flight, frozen at the first touch", &trials, flight)];
        let bar = bar("methods", methods.len() as u64);
        for (k, method) in methods.iter().enumerate() {
            rows.push(Row::of(method, &trials)?);
            bar.set(k as u64 + 1);
        }
        bar.finish();
        let (lines, noise, floor) = changes::lines(&self.tosses, self.every, self.seed)?;
        let fit = Self::fit(&trials.raw, &trials.lifted)?;
        Ok(Measured { tosses: self.tosses.len(), windows: trials.raw.len(), rows, lines, noise, floor, fit })
    }

    fn tables(&self, data: &Measured) -> Result<Vec<Table>> {
        Ok(data.tables())
    }

    fn pictures(&self, data: &Measured, stem: &Path) -> Result<()> {
        let row = |name: &&str| data.rows.iter().find(|r| r.method == **name);
        fn curve(r: &Row) -> Curve<'_> {
            Curve { name: &r.method, by_frame: &r.lifted.by_step, dashed: r.microseconds.is_none() }
        }
        let floor = Curve { name: "what noise on velocities does", by_frame: &data.floor.by_step, dashed: true };
        let curves: Vec<Curve> = DRAWN.iter().filter_map(row).map(curve).chain([floor]).collect();
        draw("Cube tosses", "1/148 s", &curves, stem)
    }
}
