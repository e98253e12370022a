//! Common imports of the verbs.

pub(crate) use std::path::PathBuf;

pub(crate) use anyhow::{Context, Result, anyhow, bail};
pub(crate) use itertools::Itertools;
pub(crate) use nerd_lab::error::unused;
pub(crate) use nerd_sim::prelude::*;
pub(crate) use nerd_train::{device::Device, shipped::results};

pub(crate) use nerd_train::settings::listed;

pub(crate) use crate::options::{Keys, Positive, Whole, value, word};
