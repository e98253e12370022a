//! A training run, from its settings to the model's folder.
//!
//! ```no_run
//! use nerd_train::run::{Run, RunConfig};
//!
//! let mut config = RunConfig::recipe("quick", "pendulum", "out/pendulum")?;
//! config.updates = 12_000;
//! let model = Run::new(&config)?.train()?; // `Some("out/pendulum/model")`, or `None` if its time ran out
//! # Ok::<(), nerd_train::Error>(())
//! ```
//!
//! ```text
//! RunConfig ── Run::new ──▶ mode: the settings that its kind of run uses  mode.rs; others are refused
//!                            ├─ plan: network, learner, trainer             plan.rs
//!                            ├─ data: recorded or read, normalised         recording.rs, data.rs
//!                            ├─ updates, validation by rollouts            engine.rs, criterion.rs
//!                            └─ the best weights with a card               card.rs ──▶ OUT/model
//! ```
//!
//! The run's folder holds `run.json`, `metrics.jsonl`, `sessions.jsonl`, `last.safetensors` and `best.safetensors`.
//! Another [`Run`] with the same settings resumes it. A [`Recipe`] is a file with the settings of one run, or of
//! several that follow each other.

mod card;
mod criterion;
mod data;
mod engine;
mod memory;
mod mode;
mod plan;
mod recipe;
mod recording;
mod settings;
mod train;

use crate::checkpoint;
use crate::device::Device;
use crate::evaluate::{Action, PassiveConfig, horizon};
use crate::measured::Measured;
use crate::prelude::*;
use crate::records::claimed;
use crate::settings::{Given, Settings, settings};
use crate::shipped;
use crate::trainer::TrainerConfig;
use crate::unroll::{self, Course};
use card::Identity;
use plan::Plan;

pub use mode::{Context, Mode};
pub use recipe::Recipe;
pub use recording::RecordConfig;
pub use settings::{RunConfig, Variant};
pub use train::Run;
