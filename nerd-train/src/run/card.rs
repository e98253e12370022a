//! The identity of a run, and the card of its model.

use nerd_model::transformer::Storage;

use super::*;
use crate::files::write;
use crate::records::rows;
use crate::verdict::recorded::recorded;
use crate::verdict::{Verdict, verdict};

/// Networks with more weights are stored in f16. A small network has so small an error that rounding to f16 would
/// dominate it.
const LARGE: usize = 1_000_000;
/// Number of starts in the verdict on a new model.
const JUDGED: usize = 16;

/// Settings and data that determine a run's bytes. Checkpoints store them, so that no run is resumed as another one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Identity {
    pub robot: String,
    /// SHA-256 of the robot alone, and of the robot with its starts, drives and controller.
    pub robot_sha256: String,
    pub system_sha256: String,
    pub truth: String,
    pub base: Base,
    pub view: View,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub told: bool,
    #[serde(skip_serializing_if = "Variant::usual")]
    pub variant: Variant,
    pub network: TransformerConfig,
    /// Frames of a rollout in training, if training goes through rollouts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unrolled: Option<usize>,
    pub learner: LearnerConfig,
    pub trainer: TrainerConfig,
    /// Number added to the variance of every target; `None` for the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    pub arithmetic: String,
    /// Number of rollouts in the criterion.
    pub rollouts: usize,
    pub frames: usize,
    pub torque_scale: f64,
    pub hold: usize,
    pub resets: f64,
    /// Policies (by content) that act in a part of the data, and their share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policies: Option<String>,
    /// Held-out trajectories of recorded motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out: Option<String>,
    pub data_sha256: String,
    pub transitions: usize,
    /// Number of transitions recorded during the run.
    pub fresh: usize,
    /// Training history and SHA-256 of the model that the run started from.
    pub from: Option<String>,
    pub from_sha256: Option<String>,
}

impl Identity {
    /// The identity of a run, except its data's hash, which stays empty.
    pub fn of(plan: &Plan) -> Self {
        let RunConfig { record, rollouts, transitions, .. } = &plan.config;
        let RecordConfig { frames, torque_scale, hold, resets, .. } = *record;
        let Form { base, view, told } = plan.mode.form();
        let parent = plan.parent.as_ref().map(|p| &p.config);
        Self {
            robot: plan.system.name.clone(),
            robot_sha256: plan.system.robot_sha256(),
            system_sha256: plan.system.sha256(),
            truth: plan.truth(),
            base,
            view,
            told,
            variant: if let Mode::Chain { .. } = plan.mode { Variant::Chain } else { Variant::Nerd },
            network: plan.network,
            unrolled: plan.mode.frames(),
            learner: plan.learner,
            trainer: plan.trainer,
            epsilon: plan.config.epsilon,
            arithmetic: plan.arithmetic.clone(),
            rollouts: *rollouts,
            frames,
            torque_scale,
            hold,
            resets,
            policies: plan.recording.pilot.as_ref().map(|p| format!("{p:?}")),
            held_out: plan.measured.as_ref().map(Measured::held_out),
            data_sha256: String::new(),
            transitions: *transitions,
            fresh: plan.config.fresh_transitions,
            from: parent.map(history),
            from_sha256: parent.map(|config| config.model_sha256.clone()),
        }
    }
}

/// Reads the state to resume from, if the folder has one. Refuses the state of another run. The data's hash and size
/// are compared only if `run` has the hash.
pub(super) fn resume(out: &Path, run: &Identity) -> Result<Option<LearnerState>> {
    let path = checkpoint::last(out);
    if !path.exists() {
        return Ok(None);
    }
    let mut found: serde_json::Value = serde_json::from_str(&checkpoint::config(&path)?).map_err(Error::file(&path))?;
    // Converted through text, like the stored identity: a direct conversion would widen f32 to f64.
    let asked = serde_json::to_string(run).map_err(Error::file(&path))?;
    let asked: serde_json::Value = serde_json::from_str(&asked).map_err(Error::file(&path))?;
    if run.data_sha256.is_empty() {
        for key in ["data_sha256", "transitions"] {
            found[key] = asked[key].clone();
        }
    }
    let said = between(&found.to_string(), &asked.to_string());
    if !said.is_empty() {
        refuse!("{} belongs to a run with other settings: {said}; use another --out, or its settings", path.display());
    }
    Ok(Some(checkpoint::load(&path, &run.network)?.0))
}

pub(super) fn model_config(run: &Identity, provenance: &BTreeMap<String, String>) -> ModelConfig {
    ModelConfig {
        robot: run.robot.clone(),
        robot_sha256: run.robot_sha256.clone(),
        // Set when the model is saved.
        model_sha256: String::new(),
        truth: run.truth.clone(),
        base: run.base,
        view: run.view,
        told: run.told,
        network: run.network,
        data_sha256: run.data_sha256.clone(),
        transitions: run.transitions + run.fresh,
        updates: run.trainer.updates,
        batch: run.learner.batch,
        provenance: provenance.clone(),
    }
}

/// The training history of a model, in one line.
fn history(config: &ModelConfig) -> String {
    let row = |k: &str| config.provenance.get(k).map_or("?", String::as_str);
    let ModelConfig { updates, batch, transitions, .. } = config;
    let run =
        format!("{} of a run of {updates} updates of {batch} windows on {transitions} transitions", row("weights"));
    // Only the policies' share is kept: their names are on that model's card.
    let acted = config.provenance.get("policies").and_then(|said| said.split_once(':'));
    let run = acted.map_or(run.clone(), |(share, _)| format!("{run}, policies {share}"));
    let run = format!(
        "{run} (`{}`, {} minutes on {}, commit {})",
        row("command"),
        row("minutes"),
        row("machine"),
        row("commit")
    );
    config.provenance.get("started from").map_or(run.clone(), |before| format!("{run}, which started from {before}"))
}

/// Writes the model folder `OUT/model` with a card made from the run's records.
pub(super) fn export(
    plan: &Plan,
    run: &Identity,
    normalizer: Normalizer,
    weights: Weights,
    chosen: String,
) -> Result<()> {
    let out = &plan.config.out;
    let mut own = vec![
        ("weights", chosen),
        ("arithmetic", run.arithmetic.clone()),
        ("optimizer", format!("{:?}", run.learner.optimizer)),
        ("schedule", format!("{:?}", run.trainer.schedule)),
    ];
    own.push(match &plan.measured {
        None => ("torque_scale", format!("U({}, 1)", run.torque_scale)),
        Some(measured) => ("held out", measured.held_out()),
    });
    let more = [("policies", plan.actors.clone()), ("started from", run.from.clone())];
    own.extend(more.into_iter().filter_map(|(name, value)| Some((name, value?))));
    let (provenance, table) = rows(out, plan.learner.seed, own)?;
    let config = model_config(run, &provenance);
    let card = format!(
        "# {} of `{}`\n\n{} ({} parameters, E {}, {} layers, window {}) that learned one frame of `{}`.\n\
         {} updates of {} windows on {} {}transitions{} (SHA-256{} `{}`).\n\n{table}\n\
         Written by `cargo xtask train`.\n",
        run.variant.name(),
        run.robot,
        if run.network.architecture == Architecture::Transformer { "A causal Transformer" } else { "A network" },
        run.network.parameters(),
        run.network.embedding,
        run.network.layers,
        run.network.history,
        run.truth,
        run.trainer.updates,
        run.learner.batch,
        run.transitions + run.fresh,
        if run.policies.is_none() && plan.measured.is_none() { "random " } else { "" },
        plan.measured.as_ref().map_or_else(String::new, |m| format!(" of {} recorded trajectories", m.size()[0])),
        if run.fresh > 0 { format!(" of the first {}", run.transitions) } else { String::new() },
        run.data_sha256,
    );
    let folder = out.join("model");
    let storage = if weights.flat.len() > LARGE { Storage::F16 } else { Storage::F32 };
    Model { config, normalizer, weights }.save(&folder, &card, storage)?;
    tell!("model written to {}", folder.display());
    // The model stays, even if its verdict fails.
    match verdict_on(plan, &folder, &card) {
        Ok(Some(verdict)) => tell!("{verdict}"),
        Ok(None) => {}
        Err(e) => tell!("no verdict on this model: {e}"),
    }
    Ok(())
}

/// The verdict on the stored model in the robot's usual scene, from starts that did not select the weights. The verdict
/// is appended to the card.
fn verdict_on(plan: &Plan, folder: &Path, card: &str) -> Result<Option<Verdict>> {
    let Plan { system, config, .. } = plan;
    let model = Model::load(folder, system, None)?;
    if let Some(measured) = &plan.measured {
        let pieces = measured.rollouts(&measured.held_out, &plan.network, JUDGED)?;
        return said(
            folder,
            card,
            recorded(measured, &pieces, &model, &[("as described", measured.described()?)], None)?,
        );
    }
    let scenes = system.usual_scenes();
    let scene = scenes.iter().find(|s| **s != "free").unwrap_or(&scenes[0]);
    // A fixed arm that holds its pose does not move, so it gets random torques.
    let action =
        if system.spec.control.is_some() && !system.robot.floating() { Action::Random(1.0) } else { Action::Zero };
    let seed = config.record.seed.wrapping_add(2_000);
    let protocol = PassiveConfig { starts: JUDGED, steps: horizon(&system.name), seed, action };
    said(folder, card, verdict(system, &system.scene(scene)?, &model, protocol)?)
}

fn said(folder: &Path, card: &str, verdict: Option<Verdict>) -> Result<Option<Verdict>> {
    if let Some(verdict) = &verdict {
        write(&folder.join("README.md"), format!("{card}\n## What it is worth\n\n{verdict}.\n"))?;
    }
    Ok(verdict)
}
