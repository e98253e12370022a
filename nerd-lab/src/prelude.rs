//! Common imports of nerd-lab.

pub(crate) use std::collections::BTreeMap;
pub(crate) use std::path::{Path, PathBuf};
pub(crate) use std::time::{Duration, Instant};

pub(crate) use anyhow::{Context, Error, Result, anyhow, bail};
pub(crate) use itertools::Itertools;
pub(crate) use nerd_model::folder::{Model, ModelConfig};
pub(crate) use nerd_sim::prelude::*;
pub(crate) use nerd_train::bounds::{self, FRAMES, SEEDS, STARTS, SUBSTEPS};
pub(crate) use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport};
pub(crate) use nerd_train::progress::{self, bar};
pub(crate) use nerd_train::spec::SolverSpec;
pub(crate) use nerd_train::{device::Device, settings::settings, shipped, stats::mean, stats::percentile};
pub(crate) use serde::{Deserialize, Serialize};

pub(crate) use nerd_cli::experiments::{About, Experiment, Measured, Timed, built_for};
pub(crate) use nerd_cli::report::{Axis, Figure, Input, Inputs, Series, Style, Table, digits, or_dash, pair, write};
