//! What it costs a model to be stored in half as many bytes: its passive errors with f32 weights and with three roundings of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_model::transformer::{Storage, Weights};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use nerd_sim::range::Range;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::Experiment;
use crate::error::{Error, Result};
use crate::evaluate::{Action, PassiveConfig, passive, summary};
use crate::learner::round_hidden;
use crate::prepare;
use crate::progress::bar;
use crate::report::table::pair;
use crate::report::{Input, Inputs, Table};

/// Transitions that say what a layer's inputs are like.
const TRANSITIONS: usize = 40_000;

/// How weights are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Rounding {
    /// Not at all.
    None,
    /// Each weight to its nearest f16.
    Nearest,
    /// Each of a hidden matrix to its nearest f16; embedding, places, norms and head stay.
    Hidden,
    /// The same matrices, each error taken back in the rows behind it ([`round_hidden`]).
    Compensated,
}

impl Rounding {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Nearest, Self::Hidden, Self::Compensated];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "f32",
            Self::Nearest => "f16",
            Self::Hidden => "hidden matrices f16",
            Self::Compensated => "hidden matrices f16, compensated",
        }
    }

    /// As what it is stored.
    pub fn storage(self) -> Storage {
        match self {
            Self::None => Storage::F32,
            Self::Nearest => Storage::F16,
            Self::Hidden | Self::Compensated => Storage::Mixed,
        }
    }
}

/// A model with f32 weights, and on what its errors are looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// Name of its folder below the experiment's.
    pub folder: String,
    /// Scenes.
    pub scenes: Vec<String>,
    /// Rollouts.
    pub protocol: PassiveConfig,
}

/// The experiment.
#[derive(Clone, Debug)]
pub struct Roundings {
    /// Folder of the models' folders.
    pub parents: PathBuf,
    /// The models.
    pub subjects: Vec<Subject>,
}

/// One model, rounded one way, in one scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Name of its folder.
    pub model: String,
    /// Hash of what it was before, all in f32.
    pub from_sha256: String,
    /// Hash of the rounded model.
    pub sha256: String,
    /// How it was rounded.
    pub rounding: Rounding,
    /// Bytes of its weights' file.
    pub bytes: usize,
    /// Where.
    pub scene: String,
    /// Rollouts.
    pub protocol: PassiveConfig,
    /// Mean error of joint angles and places (rad or m).
    pub error: Vec<f64>,
    /// Its standard error over starts.
    pub standard_error: Vec<f64>,
    /// Change of the error against f32, as a share of it.
    pub change: Vec<f64>,
    /// Rollouts that diverged.
    pub diverged: usize,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Data {
    /// One for each model, rounding and scene.
    pub rows: Vec<Row>,
}

impl Roundings {
    /// The three shipped models that predict whole frames, from folders with their f32 weights, over so many starts.
    pub fn shipped(parents: PathBuf, starts: usize) -> Self {
        let subject = |folder: &str, scenes: &[&str], steps, action| Subject {
            folder: folder.into(),
            scenes: scenes.iter().map(ToString::to_string).collect(),
            protocol: PassiveConfig { starts, steps, seed: 500, action },
        };
        let subjects = vec![
            subject("cartpole", &["free"], 1000, Action::Zero),
            subject("franka", &["free"], 100, Action::Random(1.0)),
            subject("pendulum-paper", &["ground1", "ground3"], 100, Action::Zero),
        ];
        Self { parents, subjects }
    }

    /// A subject's model and robot.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn load(&self, subject: &Subject) -> Result<(Arc<System>, Model)> {
        let folder = self.parents.join(&subject.folder);
        let system = System::named(&nerd_model::folder::ModelConfig::read(&folder)?.robot)?;
        let model = Model::load(&folder, &system, None)?;
        Ok((system, model))
    }

    /// Writes a subject, rounded, into a folder; its card says what was done.
    ///
    /// # Errors
    /// If it cannot be read, rounded or written.
    pub fn write(&self, subject: &Subject, rounding: Rounding, folder: &Path) -> Result<()> {
        let (system, model) = self.load(subject)?;
        let card = self.parents.join(&subject.folder).join("README.md");
        let text = nerd_sim::files::read_text(&card).map_err(Error::file(&card))?;
        let note = format!("{} (`results/f16.md`), from the f32 weights of model {}", rounding.name(), &model.sha256()[..12]);
        let (head, tail) = text.split_once("\n\nIts errors in rollouts").unwrap_or((text.trim_end(), ""));
        let card = format!("{head}\n| storage | {note} |\n\nIts errors in rollouts{tail}");
        let mut light = rounded(&system, &model, rounding)?;
        light.config.provenance.insert("storage".into(), note);
        Ok(light.save(folder, &card, rounding.storage())?)
    }

    fn rows(&self, subject: &Subject) -> Result<Vec<Row>> {
        let (system, model) = self.load(subject)?;
        let from_sha256 = model.sha256();
        let mut rows: Vec<Row> = Vec::new();
        let progress = bar(&format!("roundings of {}", subject.folder), (Rounding::ALL.len() * subject.scenes.len()) as u64);
        for rounding in Rounding::ALL {
            let model = rounded(&system, &model, rounding)?;
            let bytes = model.weights.to_bytes(Default::default(), rounding.storage()).map_err(|e| Error::Refused(e.to_string()))?.len();
            for name in &subject.scenes {
                let (scene, protocol) = (system.scene(name)?, subject.protocol);
                let (mut truth, mut solver) = (Truth::named(&model.config.truth)?.solver(&system), Neural::on_cpu(model.clone(), &system));
                let report = passive(&system, &scene, &mut *truth, &mut solver, protocol, &mut |_| ())?;
                let error = summary(&system, &report.error);
                let before = rows.iter().find(|r| r.scene == *name).map_or_else(|| error.clone(), |r| r.error.clone());
                rows.push(Row {
                    model: subject.folder.clone(),
                    from_sha256: from_sha256.clone(),
                    sha256: model.sha256(),
                    rounding,
                    bytes,
                    scene: name.clone(),
                    protocol,
                    change: error.iter().zip(before).map(|(now, before)| now / before - 1.0).collect(),
                    error,
                    standard_error: summary(&system, &report.standard_error),
                    diverged: report.diverged,
                });
                progress.set(rows.len() as u64);
            }
        }
        progress.finish();
        Ok(rows)
    }
}

/// A model with rounded weights, as it would be read from a file.
///
/// # Errors
/// If it is no Transformer, or its truth cannot be stepped.
pub fn rounded(system: &Arc<System>, model: &Model, rounding: Rounding) -> Result<Model> {
    let weights = match rounding {
        Rounding::Compensated => {
            // As the model's own data were driven.
            let law = model.config.provenance.get("torque_scale").and_then(|law| Range::try_from(law.clone()).ok());
            let law = law.unwrap_or(Range { low: -1.0, high: 1.0 });
            let config = GenerateConfig {
                transitions: TRANSITIONS,
                shard_trajectories: 64,
                resets: 0.5,
                torque_scale: law,
                ..GenerateConfig::default()
            };
            let (truth, network) = (Truth::named(&model.config.truth)?, model.config.network);
            let solver = || truth.solver(system);
            let mut windows = prepare::generate(system, &solver, &config, network.sequence(), model.config.form(), &|_| ())?.windows;
            prepare::normalize(&mut windows, &model.normalizer);
            round_hidden(&model.weights, &windows)?
        }
        _ => model.weights.clone(),
    };
    let unfit = |e: nerd_model::transformer::WeightsError| Error::Refused(e.to_string());
    let bytes = weights.to_bytes(Default::default(), rounding.storage()).map_err(unfit)?;
    let weights = Weights::from_bytes(weights.config, &bytes).map_err(unfit)?;
    let mut model = Model { weights, ..model.clone() };
    model.stamp(system);
    Ok(model)
}

impl Experiment for Roundings {
    type Data = Data;

    fn name(&self) -> String {
        "f16".into()
    }

    fn seed(&self) -> u64 {
        self.subjects.first().map_or(0, |s| s.protocol.seed)
    }

    fn effort(&self) -> f64 {
        self.subjects.iter().map(|s| (s.scenes.len() * s.protocol.starts * s.protocol.steps) as f64).sum()
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for subject in &self.subjects {
            inputs.add(Input::robot(&self.load(subject)?.0));
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Data> {
        let rows = self.subjects.iter().map(|s| self.rows(s)).collect::<Result<Vec<_>>>()?;
        Ok(Data { rows: rows.concat() })
    }

    fn tables(&self, data: &Data) -> Result<Vec<Table>> {
        let percent = |x: &[f64]| x.iter().map(|c| format!("{:+.1} %", 100.0 * c)).collect::<Vec<_>>().join(" / ");
        let rows = data.rows.iter().map(|r| {
            vec![
                r.model.clone(),
                r.scene.clone(),
                format!("{} x {}", r.protocol.starts, r.protocol.steps),
                r.rounding.name().into(),
                format!("{:.2}", r.bytes as f64 * 1e-6),
                pair(&r.error),
                pair(&r.standard_error),
                percent(&r.change),
                r.diverged.to_string(),
                r.sha256[..12].into(),
            ]
        });
        let header =
            ["model", "scene", "starts x frames", "weights", "MB", "error (rad or m)", "standard error", "change", "diverged", "hash"];
        Ok(vec![Table::new("storage", &header).with(rows).noted(
            "Errors against the truth that each model learned, all roundings from the same starts; Franka under random torques, the others \
             without. Starts are the same for all rows, so changes are far better known than errors. Models ship as in the compensated rows.",
        )])
    }
}
