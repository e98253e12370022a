//! Common imports of nerd-cli.

pub(crate) use std::collections::BTreeMap;
pub(crate) use std::path::{Path, PathBuf};
pub(crate) use std::time::{Duration, Instant};

pub(crate) use anyhow::{Context, Error, Result, anyhow, bail};
pub(crate) use itertools::Itertools;
pub(crate) use nerd_model::folder::{Model, ModelConfig};
pub(crate) use nerd_sim::prelude::*;
pub(crate) use nerd_train::bounds::{self, FRAMES, SEEDS, STARTS};
pub(crate) use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive};
pub(crate) use nerd_train::progress::bar;
pub(crate) use nerd_train::settings::{listed, settings};
pub(crate) use nerd_train::shipped::{self, results};
pub(crate) use nerd_train::spec::SolverSpec;
pub(crate) use nerd_train::{device::Device, ppo::Arena, stats::mean, stats::percentile};
pub(crate) use serde::{Deserialize, Serialize, de::DeserializeOwned};

pub(crate) use crate::error::unused;
pub(crate) use crate::experiments::{About, Experiment, Measured, built_for};
pub(crate) use crate::options::{Keys, Positive, Whole, value, word};
pub(crate) use crate::report::{
    Axis, Figure, Input, Inputs, Panel, Series, Style, Table, digits, or_dash, pair, write,
};
