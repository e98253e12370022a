//! Where cases are tried: a folder for files, and small models to be spoilt.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::form::{Form, View};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{Positions, Storage, TransformerConfig, Weights};
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use tempfile::TempDir;

use crate::campaign::Program;
use crate::campaign::case::Files;

/// The robot of models.
pub const ROBOT: &str = "pendulum";

/// A folder of its own, gone with it.
pub struct Bench {
    folder: TempDir,
    /// What is tried.
    pub program: Program,
    /// The robot of the models.
    pub system: Arc<System>,
    /// Files of good models: in the paper's form, and a stream on flight.
    pub models: [Files; 2],
}

impl Bench {
    /// In memory where the system has such a folder: what is written here need not last.
    pub fn new(program: Program) -> io::Result<Self> {
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }?;
        let system = System::named(ROBOT).map_err(io::Error::other)?;
        let models = [(Base::State, Positions::Table), (Base::Flight, Positions::Rotary)];
        let [paper, stream] = models.map(|(base, positions)| tiny(&system, base, positions, &folder.path().join("tiny")));
        Ok(Self { folder, program, system, models: [paper?, stream?] })
    }

    /// A folder in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A folder in it, with nothing inside.
    pub fn empty(&self, name: &str) -> io::Result<PathBuf> {
        let path = self.path(name);
        if path.exists() {
            std::fs::remove_dir_all(&path)?;
        }
        std::fs::create_dir_all(&path)?;
        Ok(path)
    }
}

/// Writes files into a folder.
pub fn write(folder: &Path, files: &Files) -> io::Result<()> {
    std::fs::create_dir_all(folder)?;
    files.iter().try_for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes))
}

/// A model of random weights.
fn tiny(system: &Arc<System>, base: Base, positions: Positions, folder: &Path) -> io::Result<Files> {
    let form = Form::from(base);
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let network = TransformerConfig {
        inputs,
        outputs,
        embedding: 16,
        layers: 2,
        heads: 2,
        block: 8,
        history: 4,
        head: 8,
        positions,
        architecture: Default::default(),
    };
    let config = ModelConfig {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        truth: Truth::Articulated.name(),
        base,
        view: View::Own,
        network,
        // Saving makes it.
        model_sha256: String::new(),
        data_sha256: "0".repeat(64),
        transitions: 1000,
        updates: 1,
        batch: 1,
        provenance: BTreeMap::new(),
    };
    let moments = |width: usize| Moments { mean: vec![0.0; width], variance: vec![1e-3; width], epsilon: 1e-5 };
    let normalizer = Normalizer { inputs: moments(inputs), outputs: moments(outputs) };
    Model { config, normalizer, weights: Weights::init(network, 1) }
        .save(folder, "a tiny model\n", Storage::F32)
        .map_err(io::Error::other)?;
    let read = |name: &str| Ok((name.to_string(), std::fs::read(folder.join(name))?));
    ["config.json", "normalizer.json", "model.safetensors"].into_iter().map(read).collect()
}
